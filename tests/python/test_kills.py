"""Stopped at any instant, commands lose nothing that was whole, and go on to the result of a run without a stop."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

# Pictures are read.
pytest.importorskip("PIL")
from kills import CASES, WAYS, Lab


def stop(place: Path, names: list[str], ways: Sequence[str], count: int, seed: int = 0) -> Counter[str]:
    """Stop the cases in turn, in all ways, at so many random instants; returns what happened."""
    lab, rng, found = Lab(place, names), np.random.default_rng(seed), Counter[str]()
    for i in range(count):
        name, way = names[i % len(names)], ways[i // len(names) % len(ways)]
        found[f"{name} {way} {lab.stop(name, way, rng.uniform(0.0, 1.1), i)}"] += 1
    return found


@pytest.mark.parametrize(("name", "ways"), [("export", WAYS), ("compare", ["KILL", "disk"])])
def test_a_stopped_command_loses_nothing_and_goes_on(name: str, ways: Sequence[str], tmp_path: Path) -> None:
    stop(tmp_path, [name], ways, len(ways))


@pytest.mark.learning
@pytest.mark.parametrize(
    ("name", "ways"), [("train", ["KILL", "TERM"]), ("resume", ["KILL", "disk"]), ("tune", ["KILL"]), ("fit", ["TERM"])]
)
def test_stopped_training_loses_nothing_and_goes_on(name: str, ways: Sequence[str], tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("cma")
    stop(tmp_path, [name], ways, len(ways))


@pytest.mark.nightly
def test_200_random_instants_of_all_commands(tmp_path: Path) -> None:
    found = stop(tmp_path, list(CASES), WAYS, 200)
    print("\n".join(f"{what}: {times}" for what, times in sorted(found.items())))
    assert sum(times for what, times in found.items() if what.endswith("stopped")) > 80
