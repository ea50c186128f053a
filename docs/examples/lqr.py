"""LQR from `Simulator.linearize`: exact derivatives about the trim of a scene; needs SciPy.

`linearize` gives z' = A z + B u for z = [xi; dq; dV; dq'] in local SE(3) coordinates and
u = [dF; dtau]. Of a vehicle without an arm, z holds the pose error and the twist, as observations
do.
"""

from typing import Any

import gymnasium
import numpy as np

import uvms_gym

SCENE = "bluerov2-heavy"


class LQR:
    """Linear-quadratic regulator with the wrench of trim fed forward."""

    def __init__(self, env: Any, errors: list[float], wrench: list[float]) -> None:
        from scipy.linalg import solve_continuous_are

        inner = env.unwrapped
        simulator = uvms_gym.Simulator(inner.options.scene)
        self.trim = simulator.trim()["wrench"][0]
        a, b = (matrix[0] for matrix in simulator.linearize(wrench=self.trim))
        # Bryson's rule: weights are inverse squares of acceptable errors, rates and wrenches.
        q, r = np.diag(1.0 / np.square(errors)), np.diag(1.0 / np.square(wrench))
        self.gain = b.T @ solve_continuous_are(a, b, q, r) / np.diag(r)[:, None]
        self.poles = np.linalg.eigvals(a - b @ self.gain)
        self.limits = np.concatenate([block.high for block in inner.action_layout])
        self.scale = np.concatenate([block.scale for block in inner.layout[:4]])

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Actions for one observation (d,) or n of them (n, d)."""
        z = np.asarray(observation)[..., :12] * self.scale
        action = np.clip((self.trim - z @ self.gain.T) / self.limits, -1.0, 1.0)
        return action.astype(np.float32), state


def main(num_envs: int = 64, steps: int = 400) -> dict[str, float]:
    """Print and return the median RMS position error, m, of the LQR and of the scene's PD."""
    envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs, scene=SCENE)
    regulator = LQR(envs, [0.05] * 3 + [0.1] * 3 + [0.2] * 3 + [0.5] * 3, [20.0] * 3 + [2.0] * 3)
    rates = regulator.poles.real
    print(f"slowest pole {rates.max():.2f} 1/s, fastest {rates.min():.2f} 1/s")
    results = {}
    for name, controller in (("LQR", regulator), ("PD", uvms_gym.PD(envs))):
        observations, infos = envs.reset(seed=0)
        state = None
        for _ in range(steps):
            actions, state = controller.predict(observations, state)
            observations, *_, infos = envs.step(actions)
        results[name] = float(np.median(infos["rms_position_error"]))
        print(f"{name:4} {100 * results[name]:.2f} cm")
    return results


if __name__ == "__main__":
    main()
