"""PPO of Stable-Baselines3 on the native vector environment; needs the extra `train`.

`uvms_gym.sb3.make_vec_env` steps all instances in one call, and gives the numbers of a
`DummyVecEnv` of monitored single environments. Observations are scaled by the environment: no
`VecNormalize`.
"""

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from uvms_gym.sb3 import make_vec_env

ENV = "UVMS-StationKeep-v0"


def main(frames: int = 1_000_000, n_envs: int = 64, episodes: int = 64) -> float:
    """Train, evaluate on held-out seeds, and return the mean return."""
    torch.set_num_threads(1)  # the simulator uses the others
    venv = make_vec_env(ENV, n_envs=n_envs, seed=0)
    model = PPO(
        "MlpPolicy", venv, n_steps=64, batch_size=1024, gamma=0.95, seed=0, device="cpu"
    ).learn(frames)
    held_out = make_vec_env(ENV, n_envs=16, seed=2_000_000)
    mean, deviation = evaluate_policy(model, held_out, n_eval_episodes=episodes)
    print(f"return {mean:.1f} +- {deviation:.1f} over {episodes} episodes")
    return float(mean)


if __name__ == "__main__":
    main()
