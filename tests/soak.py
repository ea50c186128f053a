"""Random actions in every environment, scene, kind of action and disturbance, for as many steps as asked.

    python tests/soak.py --steps 1e8

Each combination runs in both precisions and with two numbers of substeps. Nothing may panic, no observation, reward
or measure may be other than finite, no observation may leave its space, and memory may not grow after the first round.
Prints what ran; exits with 1 at the first thing that is wrong, naming where.
"""

import argparse
import itertools
import math
import resource
import sys
import time
import warnings
from pathlib import Path

import gymnasium
import numpy as np

import uvms_gym

ROUNDS = 4
#: Growth of memory after the first round that counts as noise of the allocator, bytes.
SLACK = 64 * 2**20
ACTIONS = ("wrench", "thrusters", "residual")


def resident() -> int:
    """Bytes of memory in use."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def combinations() -> list[tuple[str, str, str, str]]:
    """All that can be made: id, scene, action, disturbance."""
    ids = sorted(name for name in gymnasium.registry if name.startswith("UVMS-"))
    levels = list(uvms_gym.disturbance_levels())
    found = []
    for env_id, scene, action in itertools.product(ids, uvms_gym.scene_names(), ACTIONS):
        try:
            gymnasium.make_vec(env_id, num_envs=1, scene=scene, action=action).close()
        except ValueError:
            continue  # No task for this scene, or no action of this kind.
        found += [(env_id, scene, action, level) for level in levels]
    return found


def soak(which: tuple[str, str, str, str], steps: int, seed: int) -> tuple[int, int]:
    """Make about so many steps; how many were made, and how many episodes ended."""
    env_id, scene, action, level = which
    n = 256
    random = np.random.default_rng([seed, *map(ord, "".join(which))])
    dtype = ("float64", "float32")[seed % 2]
    envs = gymnasium.make_vec(
        env_id, num_envs=n, scene=scene, action=action, disturbance=level, dtype=dtype, substeps=(5, 2)[seed // 2 % 2]
    )
    space = envs.observation_space
    observations, _ = envs.reset(seed=seed)
    width = envs.action_space.shape
    ended = 0
    calls = math.ceil(steps / n)
    # From timid to bang-bang, held for a while so that vehicles get somewhere.
    held = np.zeros(width, dtype=np.float32)
    for call in range(calls):
        if call % 10 == 0:
            held = np.clip(random.normal(size=width) * random.choice([0.1, 0.5, 3.0]), -1, 1).astype(np.float32)
        observations, rewards, terminated, truncated, infos = envs.step(held)
        ended += int((terminated | truncated).sum())
        if not (np.abs(observations) <= space.high).all():
            raise AssertionError(f"{which}, {dtype}, call {call}: observation beyond its space or not finite")
        if not np.isfinite(rewards).all():
            raise AssertionError(f"{which}, {dtype}, call {call}: reward {rewards[~np.isfinite(rewards)][0]}")
        for name, values in infos.items():
            if values.dtype == np.float64 and not np.isfinite(values).all():
                raise AssertionError(f"{which}, {dtype}, call {call}: {name} is not finite")
    envs.close()
    return calls * n, ended


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=float, default=1e8, help="environment steps in all (default: 1e8)")
    steps = parser.parse_args().steps
    warnings.simplefilter("ignore", uvms_gym.StepWarning)
    everything = combinations()
    share = math.ceil(steps / (len(everything) * ROUNDS))
    began, done, ended, memory = time.monotonic(), 0, 0, []
    for number in range(ROUNDS):
        for which in everything:
            try:
                made, over = soak(which, share, number)
            except BaseException as error:
                if isinstance(error, KeyboardInterrupt):
                    raise
                print(f"{which}: {type(error).__name__}: {str(error)[:300]}", file=sys.stderr)
                return 1
            done, ended = done + made, ended + over
        memory.append(resident())
        minutes = (time.monotonic() - began) / 60
        state = f"{done:.3g} steps, {ended} episodes ended, {memory[-1] / 2**20:.0f} MiB, {minutes:.1f} min"
        print(f"round {number + 1}: {state}")
    if memory[-1] - memory[0] > SLACK:
        print(f"memory grew from {memory[0]} to {memory[-1]} bytes", file=sys.stderr)
        return 1
    print(f"{done} steps, {len(everything)} combinations of environment, scene, action and disturbance: nothing wrong")
    return 0


if __name__ == "__main__":
    sys.exit(main())
