"""Evaluation of controllers spread by Ray over the cores of one machine or a cluster.

```sh
python training/ray_evaluate.py --controller pd --controller mlp:ray.safetensors --episodes 1024
```

An episode depends on its seed alone: results are bit-identical whatever the blocks, workers
and machines.
"""

import argparse

import gymnasium
import numpy as np
import ray

from uvms_gym import make_controller
from uvms_gym.controllers import Controller
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import interquartile_mean
from uvms_gym.training.evaluation import episode_steps, run_episodes

ENV = "UVMS-StationKeep-Storm-v0"


def episodes_of(controller: Controller, seed: int, episodes: int) -> dict[str, np.ndarray]:
    """Run the episodes with seeds from `seed` on, on one thread: RMS pose errors, m, mean power."""
    envs = gymnasium.make_vec(ENV, num_envs=episodes, threads=1)
    stats = run_episodes(envs, controller, seed, episode_steps(ENV, {}))
    return {"pose": pose_rms(stats, envs.unwrapped.task), "power": stats.mean("power")}


def evaluate(
    names: list[str],
    episodes: int,
    seed: int,
    block: int,
) -> dict[str, dict[str, np.ndarray]]:
    """Results of all episodes by controller; a block of episodes is a task of Ray on one core."""
    remote = ray.remote(num_cpus=1)(episodes_of)
    env = gymnasium.make(ENV)
    running = {
        name: [
            remote.remote(make_controller(name, env), seed + first, min(block, episodes - first))
            for first in range(0, episodes, block)
        ]
        for name in names
    }
    blocks = {name: ray.get(tasks) for name, tasks in running.items()}
    return {
        name: {metric: np.concatenate([part[metric] for part in parts]) for metric in parts[0]}
        for name, parts in blocks.items()
    }


def main() -> None:
    """Evaluate, and print interquartile means."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--controller", action="append", help="name or mlp:FILE; may be repeated")
    parser.add_argument("--episodes", type=int, default=1024)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--block", type=int, default=256, help="episodes of one task")
    parser.add_argument("--address", help="cluster, such as auto; default: this machine")
    options = parser.parse_args()
    ray.init(address=options.address)
    for name, found in evaluate(
        options.controller or ["none", "pd", "pid"], options.episodes, options.seed, options.block
    ).items():
        pose, power = (interquartile_mean(found[metric]) for metric in ("pose", "power"))
        print(f"{name}: pose error {pose:.4f} m, power {power:.4f}")
    ray.shutdown()


if __name__ == "__main__":
    main()
