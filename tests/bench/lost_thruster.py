"""Detection of a thruster that dies in a storm: false alarms, delays, and errors beside other controllers.

Episodes without and with a death after 5 to 15 s. A false alarm is one before a death or of another thruster; the
storm's own weak thruster (50 to 80 %) is taken out in "no fault" and kept in "weak thruster". Prints tables of
Markdown: `python tests/bench/lost_thruster.py`.
"""

import argparse
import warnings
from typing import Any

import gymnasium
import numpy as np

import uvms_gym

ENV, SEED, STEPS = "UVMS-StationKeep-Storm-v0", 6_000_000, 200
CONDITIONS: dict[str, Any] = {
    "no fault": None,
    "weak thruster": {"gain": [0.5, 0.8], "time": [0.0, 8.0]},
    "death": {"gain": 0.0, "time": [5.0, 15.0]},
}


def run(scene: str, name: str, loss: Any, episodes: int) -> list[str]:
    """Pose error and its tail, mm; share of episodes with a false alarm; share found, and delays, s."""
    envs: Any = gymnasium.make_vec(
        ENV, num_envs=episodes, scene=scene, disturbance={"base": "storm", "thrusters": loss}
    )
    controller: Any = uvms_gym.make_controller(name, envs)
    observations, _ = envs.reset(seed=SEED)
    gains = np.stack([envs.unwrapped.disturbance(i, STEPS)["gains"] for i in range(episodes)])
    dies = (gains == 0.0).any(axis=(1, 2))
    which = np.where(dies, gains.min(axis=1).argmin(axis=1), -1)
    when = np.where(dies, (gains.min(axis=2) == 0.0).argmax(axis=1), STEPS)
    looks = "lost_thruster" in controller.memory_layout
    state, squares = None, np.zeros(episodes)
    false, found = np.zeros(episodes, bool), np.full(episodes, -1)
    for step in range(STEPS):
        actions, state = controller.predict(observations, state)
        observations, *_, infos = envs.step(actions)
        squares += infos["pose_error"] ** 2
        if looks:
            lost, dead = controller.lost_thruster(state), step >= when
            false |= (lost >= 0) & ~(dead & (lost == which))
            found = np.where((found < 0) & dead & (lost == which), step - when, found)
    errors = np.sort(1000.0 * np.sqrt(squares / STEPS))
    middle = errors[episodes // 4 : episodes - episodes // 4].mean()
    cells = [f"{middle:.1f}", ", ".join(f"{x:.0f}" for x in (*np.quantile(errors, [0.95, 0.999]), errors[-1]))]
    cells.append(f"{100.0 * false.mean():.1f}" if looks else "")
    if looks and dies.any():
        seen = 0.1 * found[found >= 0]
        cells += [f"{100.0 * (found[dies] >= 0).mean():.1f}", "{:.1f}, {:.1f}".format(*np.quantile(seen, [0.5, 0.9]))]
    return cells + [""] * (5 - len(cells))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", nargs="+", default=["petasus-pum", "bluerov2-heavy-alpha5"])
    parser.add_argument("--controller", nargs="+", default=["dob", "dob/fault-tolerant", "mpc", "mpc/fault-tolerant"])
    parser.add_argument("--episodes", type=int, default=1024)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    titles = "condition", "controller", "pose, mm", "95th, 99.9th percentile, worst, mm", "false alarms, %"
    for scene in given.scene:
        print(
            f"\n{scene}:\n\n| {' | '.join((*titles, 'found, %', 'delay: median, 90th percentile, s'))} |\n{'|---' * 7}|"
        )
        for condition, loss in CONDITIONS.items():
            for name in given.controller:
                print(
                    f"| {' | '.join((condition, f'`{name}`', *run(scene, name, loss, given.episodes)))} |", flush=True
                )


if __name__ == "__main__":
    main()
