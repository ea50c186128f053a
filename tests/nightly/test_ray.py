"""Training and evaluation on a local Ray; runs where `uvms-gym[rllib]` is installed."""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np

import uvms_gym

TRAINING = Path(__file__).parents[2] / "training"
ENV = "UVMS-StationKeep-Storm-v0"


def run(script: str, *arguments: str) -> str:
    """Output of an example, run with the package under test."""
    package = os.fspath(Path(uvms_gym.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": package, "RAY_AUTH_MODE": "disabled", "RAY_USAGE_STATS_ENABLED": "0"}
    command = [sys.executable, str(TRAINING / script), *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_a_short_training_leaves_a_policy_that_runs_natively(tmp_path: Path) -> None:
    file = tmp_path / "ray.safetensors"
    run("ray_train.py", "--frames", "4000", "--runners", "1", "--instances", "64", "--out", str(file))
    policy = uvms_gym.MLP.load(file, gymnasium.make(ENV))
    assert policy.sizes[1:] == [64, 64, 6]
    assert np.isfinite(policy.predict(np.zeros((1, policy.sizes[0]), dtype=np.float32))[0]).all()


def test_results_do_not_depend_on_blocks() -> None:
    given = ["--controller", "none", "--controller", "pd", "--episodes", "10", "--seed", "7"]
    results = [
        [text for text in run("ray_evaluate.py", *given, "--block", block).splitlines() if ": pose error" in text]
        for block in ("4", "10")
    ]
    assert results[0] == results[1]
    assert len(results[0]) == 2
