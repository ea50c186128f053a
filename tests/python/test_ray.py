"""Training and evaluation on a local Ray. Both scripts are run as users do, in processes of their own."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym

pytest.importorskip("ray", reason="wants uvms-gym[rllib]")

TRAINING = Path(__file__).parents[2] / "training"
ENV = "UVMS-StationKeep-Storm-v0"
#: Instances, steps between updates and epochs of a training run that takes seconds.
SMALL = ["--num-envs-per-env-runner", "64", "--n-steps", "16", "--eval-freq", "2000", "--eval-episodes", "16"]


def start(script: str, *arguments: str) -> subprocess.Popen[str]:
    """Run a script with the package that is under test; Ray in it is of this machine, and tells nobody."""
    package = os.fspath(Path(uvms_gym.__file__).parents[1])
    return subprocess.Popen(
        [sys.executable, TRAINING / f"{script}.py", *arguments],
        # Ray's workers would wait for whatever else runs on the machine.
        env={**os.environ, "PYTHONPATH": package, "RAY_AUTH_MODE": "disabled", "RAY_worker_niceness": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # So that it alone is interrupted.
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str], status: int = 0) -> tuple[str, str]:
    """Wait for it; returns what it said, and complained of."""
    try:
        out, complaints = process.communicate(timeout=600)
    except subprocess.TimeoutExpired:
        # With what it started.
        os.killpg(process.pid, signal.SIGKILL)
        raise
    assert process.returncode == status, complaints[-2000:]
    return out, complaints


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training run of a few updates, with a process of Ray that steps the environments."""
    folder = tmp_path_factory.mktemp("trained")
    finish(start("train_rllib", "-n", "4000", "--num-env-runners", "1", *SMALL, "-f", str(folder)))
    return folder / f"{ENV}_1"


def test_a_short_training_run_leaves_a_policy_that_runs_natively_and_numbers(trained: Path) -> None:
    data = json.loads((trained / "train.json").read_text())
    # The script itself compares every policy that it writes with what RLlib does.
    curve = data["curve"]
    assert len(curve) >= 2 and curve[-1]["frames"] >= 4000
    assert all(np.isfinite([point["pose_error"], point["effort"]]).all() for point in curve)
    policy = uvms_gym.MLP.load(trained / f"{ENV}.safetensors", gymnasium.make(ENV))
    assert policy.sizes == [44, 64, 64, 6]
    assert policy.notes["seed"] == "0" and "RLlib" in policy.notes["algorithm"]
    # Another check than the script's own: the episodes of its last evaluation once more.
    envs = gymnasium.make_vec(ENV, num_envs=16)
    envs.reset(seed=2_000_000)
    rollout = uvms_gym.Rollout(envs, policy)
    rollout.run(200)
    tally = rollout.take()
    error = np.sqrt((tally.squares["position_error"] + 0.25 * tally.squares["attitude_error"]) / tally.steps)
    assert curve[-1]["pose_error"] == np.sort(error)[4:12].mean()


def test_an_interrupted_run_loses_nothing_and_goes_on_from_its_checkpoint(trained: Path, tmp_path: Path) -> None:
    frames = max(int(path.name.split("_")[2]) for path in trained.glob("rl_model_*_steps"))
    checkpoint = trained / f"rl_model_{frames}_steps"
    process = start("train_rllib", "-n", "100_000_000", *SMALL, "-i", str(checkpoint), "-f", str(tmp_path))
    first = process.stdout.readline()
    assert int(first.split()[0]) > frames, first
    process.send_signal(signal.SIGINT)
    out, _ = finish(process, 130)
    folder = tmp_path / f"{ENV}_1"
    last = max(int(path.name.split("_")[2]) for path in folder.glob("rl_model_*_steps"))
    assert f"rl_model_{last}_steps" in out.splitlines()[-1]
    saved = uvms_gym.MLP.load(folder / f"{ENV}.safetensors")
    assert saved.notes["frames"] == str(last)


def test_an_evaluation_is_the_same_whoever_runs_it_bit_for_bit(trained: Path, tmp_path: Path) -> None:
    policy = f"mlp:{trained / f'{ENV}.safetensors'}"
    arguments = ["--episodes", "10", "--controllers", f"none,pd,{policy}"]
    arguments += ["--disturbance", "storm", "--disturbance", "current-hard", "--seed", "7"]
    ways = {"here": ["--local"], "one": ["--block", "4", "--workers", "1"], "two": ["--block", "3", "--workers", "2"]}
    runs = {}
    for name, way in ways.items():
        finish(start("evaluate_ray", *arguments, *way, "--out", str(tmp_path / name)))
        runs[name] = json.loads((tmp_path / name / "evaluate.json").read_text())["results"]
    assert runs["here"] == runs["one"] == runs["two"]
    assert len(runs["here"]) == 6 and all(len(run["runs"]["pose_error"]) == 10 for run in runs["here"])
    # By hand, the other way round through the environment.
    envs = gymnasium.make_vec(ENV, num_envs=10, disturbance="current-hard")
    observations, _ = envs.reset(seed=7)
    pd = uvms_gym.make_controller("pd", envs)
    for _ in range(200):
        observations, _, _, _, infos = envs.step(pd.predict(observations)[0])
    (run,) = (run for run in runs["here"] if (run["disturbance"], run["controller"]) == ("current-hard", "pd"))
    np.testing.assert_allclose(run["runs"]["position_error"], infos["rms_position_error"], rtol=1e-12)


BAD: list[tuple[str, list[str], str]] = [
    ("train_rllib", ["--env", "UVMS-Nix-v0"], "UVMS-Nix"),
    ("train_rllib", ["--env", "CartPole-v1"], "no environment of uvms_gym"),
    ("train_rllib", ["--address", "127.0.0.1:1"], "nobody answers"),
    ("evaluate_ray", ["--controllers", "nix"], "unknown controller 'nix'"),
]


def test_bad_input_gives_one_line(tmp_path: Path) -> None:
    running: list[tuple[Any, str]] = [
        (start(script, *given, *(["-f", str(tmp_path)] if script == "train_rllib" else [])), expected)
        for script, given, expected in BAD
    ]
    for process, expected in running:
        _, complaints = finish(process, 2)
        assert expected in complaints and complaints.count("\n") == 1, complaints
