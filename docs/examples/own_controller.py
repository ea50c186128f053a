"""A controller of your own compared with a shipped one, on the same seeds.

The law is a PD with saturated error, `F = -kp sat(e) - kd V`: far off it approaches at a bounded
speed. It reads the observation alone, by `env.unwrapped.layout`.
"""

from typing import Any

import gymnasium
import numpy as np

import uvms_gym

OPTIONS = {"scene": "bluerov2-heavy", "start_distance": 2.0, "disturbance": "calm"}


class SaturatedPD:
    """PD whose position and attitude errors are limited."""

    def __init__(self, env: Any, most: float = 0.3) -> None:
        inner = env.unwrapped
        servo = (
            inner.options.scene
            if isinstance(inner.options.scene, dict)
            else uvms_gym.load_scene(inner.options.scene)
        )
        self.kp, self.kd = (np.asarray(servo["vehicle"]["servo"][gain]) for gain in ("kp", "kd"))
        self.limits = np.concatenate([block.high for block in inner.action_layout])
        self.blocks = {block.name: block for block in inner.layout}
        self.most = most

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Actions for one observation (d,) or n of them (n, d)."""
        rows = np.atleast_2d(observation)
        r, theta, v, omega = (
            rows[:, block.slice] * np.array(block.scale)
            for name in ("position_error", "attitude_error", "linear_velocity", "angular_velocity")
            for block in [self.blocks[name]]
        )
        error = np.hstack([self.saturate(r), self.saturate(theta)])
        wrench = -self.kp * error - self.kd * np.hstack([v, omega])
        action = np.clip(wrench / self.limits, -1.0, 1.0).astype(np.float32)
        return action.reshape(*np.shape(observation)[:-1], -1), state

    def saturate(self, error: np.ndarray) -> np.ndarray:
        """Error (n, 3) of at most the limit in magnitude."""
        length = np.linalg.norm(error, axis=1, keepdims=True)
        return error * np.minimum(1.0, self.most / np.maximum(length, 1e-9))


def main(num_envs: int = 64, steps: int = 400) -> dict[str, float]:
    """Print and return the median of the final position error, m, under both controllers."""
    envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs, **OPTIONS)
    results = {}
    for name, controller in (("saturated PD", SaturatedPD(envs)), ("PD", uvms_gym.PD(envs))):
        observations, infos = envs.reset(seed=0)
        state, effort = None, 0.0
        for _ in range(steps):
            actions, state = controller.predict(observations, state)
            observations, *_, infos = envs.step(actions)
            effort = max(effort, float(infos["effort"].mean()))
        results[name] = float(np.median(infos["position_error"]))
        print(f"{name:13} {results[name]:.4f} m at the end, maximum mean effort {effort:.3f}")
    return results


if __name__ == "__main__":
    main()
