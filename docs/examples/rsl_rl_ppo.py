"""PPO of RSL-RL on the native vector environment; needs `rsl-rl-lib`.

RSL-RL has a vector environment of its own on torch tensors: `RslRlVecEnv` adapts the native one. A
time limit is told apart by `time_outs`, which RSL-RL bootstraps from.
"""

from typing import Any

import gymnasium
import numpy as np
import torch
from rsl_rl.env import VecEnv
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

import uvms_gym  # noqa: F401 (registers the environments)

NETWORK = {"class_name": "MLPModel", "hidden_dims": [64, 64], "activation": "tanh"}


class RslRlVecEnv(VecEnv):
    """A native vector environment in `SameStep` mode."""

    def __init__(self, envs: gymnasium.vector.VectorEnv, seed: int = 0) -> None:
        self.envs, self.num_envs = envs, envs.num_envs
        self.num_actions = envs.single_action_space.shape[0]
        self.max_episode_length = envs.spec.max_episode_steps
        self.episode_length_buf = torch.zeros(self.num_envs, dtype=torch.long)
        self.device, self.cfg = "cpu", {}
        self.observations, _ = envs.reset(seed=seed)

    def get_observations(self) -> TensorDict:
        """Present observations."""
        return TensorDict(
            {"policy": torch.from_numpy(self.observations)}, batch_size=[self.num_envs]
        )

    def step(
        self, actions: torch.Tensor
    ) -> tuple[TensorDict, torch.Tensor, torch.Tensor, dict[str, Any]]:
        """One control period of all instances."""
        clipped = np.clip(actions.numpy(), -1.0, 1.0)
        self.observations, rewards, terminated, truncated, _ = self.envs.step(clipped)
        dones = torch.from_numpy(terminated | truncated)
        self.episode_length_buf = (self.episode_length_buf + 1) * ~dones
        extras = {"time_outs": torch.from_numpy(truncated & ~terminated)}
        return self.get_observations(), torch.from_numpy(rewards).float(), dones.long(), extras


def main(frames: int = 1_000_000, num_envs: int = 256, folder: str | None = None) -> OnPolicyRunner:
    """Train, and return the runner; `runner.get_inference_policy()` is the policy."""
    env = RslRlVecEnv(
        gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs, autoreset_mode="SameStep")
    )
    deviation = {"class_name": "GaussianDistribution", "init_std": 0.37, "std_type": "log"}
    config = {
        "num_steps_per_env": 32,
        "save_interval": 1_000_000,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": {**NETWORK, "distribution_cfg": deviation},
        "critic": NETWORK,
        "algorithm": {
            "class_name": "PPO",
            "learning_rate": 1e-3,
            "schedule": "fixed",
            "num_learning_epochs": 4,
            "num_mini_batches": 4,
            "gamma": 0.95,
            "lam": 0.95,
            "entropy_coef": 0.0,
        },
    }
    runner = OnPolicyRunner(env, config, log_dir=folder, device="cpu")
    runner.learn(max(1, frames // (num_envs * 32)))
    return runner


if __name__ == "__main__":
    main()
