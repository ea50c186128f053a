"""Domain randomization: parameters drawn anew in every episode, and their effect on a controller.

`randomize=` takes factors on terms of all bodies, and any number of the scene by its key. All draws
follow from the seed.
"""

import gymnasium
import numpy as np

import uvms_gym

VARIANTS = {
    "none": None,
    "all factors, 30 %": True,
    "mass and damping": {"mass": [0.8, 1.2], "linear_damping": 0.5, "quadratic_damping": 0.5},
    "one key": {"vehicle.body.center_of_buoyancy": [[-0.02, 0.0, 0.02], [0.02, 0.0, 0.06]]},
}


def main(num_envs: int = 128, steps: int = 200) -> dict[str, np.ndarray]:
    """Print and return the RMS position error of each episode, m, by variant."""
    results = {}
    for name, randomize in VARIANTS.items():
        envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs, randomize=randomize)
        envs.reset(seed=0)
        rollout = uvms_gym.Rollout(envs, uvms_gym.PD(envs))
        rollout.run(steps)
        results[name] = rollout.pop_stats().rms("position_error")
        low, median, high = 100 * np.quantile(results[name], [0.05, 0.5, 0.95])
        print(f"{name:18} {median:.1f} cm, 5 % to 95 % of the episodes {low:.1f} to {high:.1f} cm")
    return results


if __name__ == "__main__":
    main()
