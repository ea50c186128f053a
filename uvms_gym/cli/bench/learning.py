"""End to end with Stable-Baselines3: steps per second of PPO, collecting and learning."""

import time
from importlib import import_module
from typing import Any

import gymnasium
import numpy as np

from uvms_gym.cli.bench.environment import ENV, SUBSTEPS
from uvms_gym.cli.bench.timing import Tick, summary
from uvms_gym.cli.common import fail

#: Steps of each instance per iteration of PPO, and its minibatch.
ROLLOUT, MINIBATCH = 16, 4096
#: Iterations that are timed.
ITERATIONS, QUICK_ITERATIONS = 5, 1
#: What is said of the way the two are joined.
WRAPPER = "a minimal VecEnv over make_vec with same-step autoreset, inside of this benchmark"


def require() -> None:
    """Refuse where Stable-Baselines3 cannot be imported."""
    try:
        import_module("stable_baselines3")
    except ImportError as error:
        raise fail(f"--sb3 needs stable-baselines3 ({error}); run: pip install stable-baselines3") from None


def ppo_study(scene: dict[str, Any], n: int, threads: int, iterations: int, seed: int, tick: Tick) -> dict[str, Any]:
    """Let PPO collect and learn on the CPU; the first iteration is thrown away."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback

    env = _adapter(scene, n, threads)

    class Clock(BaseCallback):
        """Splits the time of an iteration; it ends where the next starts to collect."""

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
            tick()

    clock = Clock()
    work = n * ROLLOUT
    model = PPO("MlpPolicy", env, n_steps=ROLLOUT, batch_size=min(MINIBATCH, work), seed=seed, device="cpu")
    model.learn(total_timesteps=work * (iterations + 1), callback=clock)
    ends = [begun for begun, _, _ in clock.marks[1:]] + [time.perf_counter()]
    whole = np.array([end - begun for end, (begun, _, _) in zip(ends, clock.marks, strict=True)])[1:]
    collecting, stepping = np.array([mark[1:] for mark in clock.marks]).T[:, 1:]
    if not all(bool(torch.isfinite(p).all()) for p in model.policy.parameters()):
        raise fail(f"{scene['name']}: a parameter of the policy is not finite, so its time means nothing")
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


def _adapter(scene: dict[str, Any], n: int, threads: int) -> Any:
    from stable_baselines3.common.vec_env import VecEnv

    class Adapter(VecEnv):
        """The vector environment as Stable-Baselines3 wants it; notes the time of its own."""

        def __init__(self) -> None:
            self.env = gymnasium.make_vec(
                ENV, num_envs=n, scene=scene, substeps=SUBSTEPS, threads=threads, autoreset_mode="SameStep"
            )
            self.spent = 0.0
            super().__init__(n, self.env.single_observation_space, self.env.single_action_space)

        def reset(self) -> Any:
            return self.env.reset(seed=self._seeds[0])[0]

        def step_async(self, actions: Any) -> None:
            self.actions = actions

        def step_wait(self) -> Any:
            begun = time.perf_counter()
            observations, rewards, terminated, truncated, given = self.env.step(self.actions)
            done = terminated | truncated
            infos: list[dict[str, Any]] = [{} for _ in range(n)]
            for i in np.flatnonzero(done):
                infos[i] = {
                    "terminal_observation": given["final_obs"][i],
                    "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                }
            self.spent += time.perf_counter() - begun
            return observations, rewards.astype(np.float32), done, infos

        def close(self) -> None:
            self.env.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(self, attr_name, None)] * n

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise NotImplementedError

        def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **given: Any) -> list[Any]:
            raise NotImplementedError

        def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
            return [False] * n

    return Adapter()
