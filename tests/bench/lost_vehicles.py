"""Storm episodes in which a controller loses the vehicle, by scene.

A vehicle counts as lost where its pose error exceeds 0.5 m after the first 2 s, or the episode diverges. Gains as
shipped; seeds of nothing else. Prints a table of Markdown: `python tests/bench/lost_vehicles.py`.
"""

import argparse
import warnings

import gymnasium
import numpy as np

import uvms_gym

ENV, SEED, STEPS, START, LIMIT = "UVMS-StationKeep-Storm-v0", 7_000_000, 200, 20, 0.5
SCENES = ("petasus-pum", "bluerov2-heavy", "bluerov2-heavy-alpha5", "bluerov2-alpha5-pool", "rexrov")


def run(scene: str, name: str, episodes: int) -> tuple[int, int, float, float]:
    """Lost vehicles, episodes; 99.9th percentile and maximum of the episodes' maximum errors, m."""
    envs = gymnasium.make_vec(ENV, num_envs=episodes, scene=scene)
    controller = uvms_gym.make_controller(name, envs)
    observations, _ = envs.reset(seed=SEED)
    state, worst = None, np.zeros(episodes)
    for step in range(STEPS):
        actions, state = controller.predict(observations, state)
        observations, _, ended, _, infos = envs.step(actions)
        if step >= START:
            worst = np.maximum(worst, np.where(ended, np.inf, infos["pose_error"]))
    return int((worst > LIMIT).sum()), episodes, float(np.quantile(worst, 0.999)), float(worst.max())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", nargs="+", default=["pd", "mpc", "nmpc"])
    parser.add_argument("--episodes", type=int, default=4096)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print(f"| scene | controller | beyond {LIMIT} m | 99.9th percentile, worst, m |\n|---|---|---|---|")
    for scene in SCENES:
        for name in given.controller:
            lost, episodes, high, worst = run(scene, name, given.episodes)
            print(f"| `{scene}` | `{name}` | {lost} of {episodes} | {high:.3f}, {worst:.3f} |", flush=True)


if __name__ == "__main__":
    main()
