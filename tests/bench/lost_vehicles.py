"""Storm episodes in which a controller loses the vehicle, by scene.

A vehicle counts as lost where its pose error exceeds 0.5 m at the end of the episode, or the episode diverges; episodes
in which it does so at any time after the first 2 s are counted, too. Gains as shipped; seeds of nothing else.
Prints a table of Markdown: `python tests/bench/lost_vehicles.py`.
"""

import argparse
import warnings

import gymnasium
import numpy as np

import uvms_gym

ENV, SEED, STEPS, START, LIMIT = "UVMS-StationKeep-Storm-v0", 7_000_000, 200, 20, 0.5
SCENES = ("petasus-pum", "bluerov2-heavy", "bluerov2-heavy-alpha5", "bluerov2-alpha5-pool", "rexrov")


def run(scene: str, name: str, episodes: int) -> tuple[int, int, float, float]:
    """Episodes beyond the limit at the end and at any time; 99.9th percentile and maximum of maximum errors, m."""
    envs = gymnasium.make_vec(ENV, num_envs=episodes, scene=scene)
    controller = uvms_gym.make_controller(name, envs)
    observations, _ = envs.reset(seed=SEED)
    state, worst, last = None, np.zeros(episodes), np.zeros(episodes)
    for step in range(STEPS):
        actions, state = controller.predict(observations, state)
        observations, _, ended, _, infos = envs.step(actions)
        last = np.where(ended | np.isinf(last), np.inf, infos["pose_error"])
        if step >= START:
            worst = np.maximum(worst, last)
    return int((last > LIMIT).sum()), int((worst > LIMIT).sum()), float(np.quantile(worst, 0.999)), float(worst.max())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--controller", nargs="+", default=["pd", "mpc", "nmpc"])
    parser.add_argument("--scene", nargs="+", default=SCENES)
    parser.add_argument("--episodes", type=int, default=4096)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    print("| scene | controller | episodes | beyond 0.5 m at the end, at any time | 99.9th percentile, worst, m |")
    print("|---|---|---|---|---|")
    for scene in given.scene:
        for name in given.controller:
            lost, beyond, high, worst = run(scene, name, given.episodes)
            print(
                f"| `{scene}` | `{name}` | {given.episodes} | {lost}, {beyond} | {high:.3f}, {worst:.3f} |", flush=True
            )


if __name__ == "__main__":
    main()
