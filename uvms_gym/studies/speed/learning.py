"""PPO of Stable-Baselines3: steps per second of collecting and learning."""

import time
from typing import Any

import gymnasium
import numpy as np

from uvms_gym.studies.speed.environment import ENV, SUBSTEPS
from uvms_gym.studies.speed.timing import summary

#: Steps of each instance per iteration of PPO, and its minibatch.
ROLLOUT, MINIBATCH = 16, 4096
#: Timed iterations.
ITERATIONS, QUICK_ITERATIONS = 5, 1
#: Adapter of the environment.
WRAPPER = "uvms_gym.sb3.NativeVecEnv"


def ppo_study(scene: dict[str, Any], n: int, threads: int, iterations: int, seed: int) -> dict[str, Any]:
    """Time PPO on the CPU; the first iteration is discarded."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback

    from uvms_gym.sb3 import NativeVecEnv

    class Timed(NativeVecEnv):
        """The environment, with the time of its steps in `spent`."""

        spent = 0.0

        def step_wait(self) -> Any:
            begun = time.perf_counter()
            result = super().step_wait()
            self.spent += time.perf_counter() - begun
            return result

    options: dict[str, Any] = {"scene": scene, "substeps": SUBSTEPS, "threads": threads}
    env = Timed(gymnasium.make_vec(ENV, num_envs=n, autoreset_mode="SameStep", **options))

    class Clock(BaseCallback):
        """Times of collecting and of environment steps; an iteration ends where the next starts to collect."""

        def __init__(self) -> None:
            super().__init__()
            self.marks: list[tuple[float, float, float]] = []

        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:
            self.begun, env.spent = time.perf_counter(), 0.0
            self.marks.append((self.begun, 0.0, 0.0))

        def _on_rollout_end(self) -> None:
            self.marks[-1] = (self.begun, time.perf_counter() - self.begun, env.spent)

    clock = Clock()
    work = n * ROLLOUT
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=min(MINIBATCH, work), seed=seed, device="cpu")
    model.learn(total_timesteps=work * (iterations + 1), callback=clock)
    ends = [begun for begun, _, _ in clock.marks[1:]] + [time.perf_counter()]
    whole = np.array([end - begun for end, (begun, _, _) in zip(ends, clock.marks, strict=True)])[1:]
    collecting, stepping = np.array([mark[1:] for mark in clock.marks]).T[:, 1:]
    if not all(bool(torch.isfinite(p).all()) for p in model.policy.parameters()):
        raise ValueError(f"{scene['name']}: a parameter of the timed policy is not finite")
    env.close()
    return {
        "scene": scene["name"],
        "n": n,
        "threads": threads,
        "torch_threads": torch.get_num_threads(),
        "algorithm": f"PPO, {ROLLOUT} steps of each instance, minibatches of {min(MINIBATCH, work)}, "
        f"{model.n_epochs} epochs, two layers of 64, CPU",
        "wrapper": WRAPPER,
        "steps_per_second": summary(work / whole),
        "collecting_steps_per_second": summary(work / collecting),
        "share_of_environment": summary(stepping / whole),
    }
