"""Training and evaluation on a local Ray; needs the dependency group `ray`."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import uvms_gym

TRAINING = Path(__file__).parents[2] / "training"
ENV = "UVMS-StationKeep-Storm-v0"


def start(script: str, *arguments: str) -> subprocess.Popen[str]:
    """Start an example with the package under test."""
    package = os.fspath(Path(uvms_gym.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": package, "RAY_AUTH_MODE": "disabled", "RAY_USAGE_STATS_ENABLED": "0"}
    command = [sys.executable, str(TRAINING / script), *arguments]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def run(script: str, *arguments: str) -> str:
    """Output of an example, run to its end."""
    with start(script, *arguments) as process:
        told, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors[-2000:]
    return told


def until_trained(process: subprocess.Popen[str]) -> None:
    """Wait for the line of an iteration."""
    assert process.stdout is not None
    assert any("frames: return" in line for line in iter(process.stdout.readline, ""))


def descendants(process: int) -> dict[int, str]:
    """Command lines of all processes below one."""
    parents, titles = {}, {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            # After the name in parentheses: state, parent.
            parents[int(path.name)] = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            titles[int(path.name)] = (path / "cmdline").read_text().replace("\0", " ")
    found = {process}
    while more := {child for child, parent in parents.items() if parent in found} - found:
        found |= more
    return {child: titles[child] for child in found if child in titles}


def test_a_short_training_leaves_a_policy_that_runs_natively(tmp_path: Path) -> None:
    file = tmp_path / "ray.safetensors"
    run("ray_train.py", "--frames", "4000", "--runners", "1", "--instances", "64", "--out", str(file))
    policy = uvms_gym.MLP.load(file, gymnasium.make(ENV))
    assert policy.sizes[1:] == [64, 64, 6]
    assert np.isfinite(policy.predict(np.zeros((1, policy.sizes[0]), dtype=np.float32))[0]).all()


SHORT = ["--runners", "1", "--instances", "64", "--save-every", "1"]


def test_a_training_whose_worker_is_killed_ends_with_a_policy(tmp_path: Path) -> None:
    file = tmp_path / "ray.safetensors"
    with start("ray_train.py", "--frames", "16000", *SHORT, "--out", str(file)) as process:
        until_trained(process)
        runners = [child for child, title in descendants(process.pid).items() if "EnvRunner" in title]
        assert runners
        os.kill(runners[0], signal.SIGKILL)
        told, errors = process.communicate(timeout=600)
    assert process.returncode == 0, errors[-2000:]
    assert file.exists() and int(told.splitlines()[-1].split()[0]) >= 16000


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_training_that_is_stopped_goes_on(number: signal.Signals, tmp_path: Path) -> None:
    file = tmp_path / "ray.safetensors"
    given = ["ray_train.py", "--frames", "12000", *SHORT, "--out", str(file)]
    with start(*given) as process:
        for _ in range(2):
            until_trained(process)
        process.send_signal(number)
        told, errors = process.communicate(timeout=600)
    assert not file.exists()
    if number == signal.SIGTERM:
        assert process.returncode == 0 and "the same command goes on" in told, errors[-2000:]
    before = max(int(path.name) for path in (tmp_path / "ray-state").glob("[0-9]*"))
    told = run(*given)
    assert f"going on after {before} frames" in told
    assert file.exists() and list(tmp_path.iterdir()) == [file]


def test_results_do_not_depend_on_blocks() -> None:
    given = ["--controller", "none", "--controller", "pd", "--episodes", "10", "--seed", "7"]
    results = [
        [text for text in run("ray_evaluate.py", *given, "--block", block).splitlines() if ": pose error" in text]
        for block in ("4", "10")
    ]
    assert results[0] == results[1]
    assert len(results[0]) == 2
