"""Training goes on after every stop: from the checkpoint with the most steps, or anew where there is none."""

import json
import os
import shutil
import signal
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("stable_baselines3")

from uvms_gym import MLP
from uvms_gym._files import lock
from uvms_gym.cli import main
from uvms_gym.training import native, ppo
from uvms_gym.training.finished import is_finished
from uvms_gym.training.hyperparameters import read_hyperparameters
from uvms_gym.training.run import CURVE, POLICY, SETTINGS, Settings, latest_checkpoint

pytestmark = pytest.mark.learning

ENV = "UVMS-StationKeep-Storm-v0"
SHORT = {"max_episode_steps": 12, "disturbance": "current"}
TINY = {
    "ppo": {"n_envs": 8, "n_steps": 8, "batch_size": 32, "n_epochs": 1, "learning_rate": 1e-3},
    "distill": {"n_envs": 4, "net_arch": [8], "batch_size": 16, "n_updates": 1, "frame_stack": 1},
}


def settings(algo: str = "ppo", steps: int = 192, **options: Any) -> Settings:
    found = TINY["ppo"] if algo == "ppo" else read_hyperparameters(ENV, algo=algo) | TINY[algo]
    return Settings(ENV, found | {"n_timesteps": steps}, SHORT, algo=algo, **{"eval_episodes": 2} | options)


def trainer(algo: str) -> Any:
    return ppo.train if algo == "ppo" else native.train


@pytest.fixture(scope="module", params=["ppo", "distill"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """Folder of a run that went to its end, on to more steps, and was stopped by SIGTERM."""
    algo, folder = request.param, tmp_path_factory.mktemp(request.param)
    train = trainer(algo)
    first = train(settings(algo, 192, save_freq=64), folder)
    assert first.finished
    more, stop = settings(algo, 1920), lambda steps: signal.raise_signal(signal.SIGTERM)
    stopped = train(more, folder, agent=first.checkpoint, tick=stop)
    assert not stopped.finished and stopped.checkpoint.exists() and stopped.steps > first.steps
    assert MLP.load(stopped.policy).notes["steps"] == str(stopped.steps)
    return algo, folder


def test_a_copied_run_resumes_from_the_checkpoint_with_the_most_steps(run: tuple[str, Path], tmp_path: Path) -> None:
    _, folder = run
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    found = sorted(copy.glob("rl_model_*_steps.zip"), key=lambda path: int(path.name.split("_")[2]))
    assert len(found) >= 3
    # Copied in another order.
    for age, path in enumerate([*found, copy / f"{ENV}.zip"]):
        os.utime(path, (1000 - age, 1000 - age))
    assert latest_checkpoint(copy) == found[-1]
    found[-1].write_bytes(found[-1].read_bytes()[:-1])
    for path in found[1:-1]:
        path.unlink()
    # The end of the first part: its steps stand in the file.
    assert latest_checkpoint(copy) == copy / f"{ENV}.zip"
    for path in copy.glob("*.zip"):
        path.write_bytes(b"")
    with pytest.raises(ValueError, match="has no checkpoint"):
        latest_checkpoint(copy)


def test_a_run_that_was_stopped_before_its_policy_was_written_is_completed(run: tuple[str, Path]) -> None:
    algo, folder = run
    chosen = settings(algo, 192)
    end = folder / f"{ENV}.zip"
    (folder / POLICY).unlink()
    (folder / CURVE).unlink()
    outcome = trainer(algo)(chosen, folder, agent=end)
    assert outcome.finished and is_finished(outcome.policy)
    with pytest.raises(ValueError, match=f"has taken its {outcome.steps} steps"):
        trainer(algo)(settings(algo, 10), folder, agent=end)
    assert Settings.load(folder) == chosen


def command(*arguments: str) -> list[str]:
    pairs = [f"{key}:{value}" for key, value in TINY["distill"].items() if key != "n_envs"]
    more = [word for pair in pairs for word in ("-params", pair)]
    keys = [word for key, value in SHORT.items() for word in ("--env-kwargs", f"{key}:{value}")]
    return ["train", "--algo", "distill", "--n-envs", "4", "--eval-episodes", "2", *more, *keys, *arguments]


def test_the_command_exports_finished_policies_only_and_goes_on_from_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = tmp_path / "policies/distilled.safetensors"
    iterate = native.LEARNERS["distill"].iterate

    def interrupted(learner: Any) -> None:
        iterate(learner)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(native.LEARNERS["distill"], "iterate", interrupted)
    assert main(command("-n", "192", "-f", str(tmp_path / "logs"), "--export", str(policy))) == 130
    folder = tmp_path / "logs/distill" / f"{ENV}_1"
    assert f"to resume: uvms train -i {folder} --export {policy}" in capsys.readouterr().out
    assert (folder / POLICY).exists() and not policy.exists()
    monkeypatch.undo()
    with lock(folder):
        assert main(["train", "-i", str(folder)]) == 2
    assert "is in use by another run" in capsys.readouterr().err
    assert main(["train", "-i", str(folder), "--export", str(policy)]) == 0
    assert is_finished(policy) and "resuming " in capsys.readouterr().out
    # After a kill between the end and the export.
    policy.unlink()
    assert main(["train", "-i", str(folder), "--export", str(policy)]) == 0
    assert is_finished(policy)
    # After a kill before the first checkpoint.
    begun = tmp_path / "begun"
    begun.mkdir()
    shutil.copy(folder / SETTINGS, begun)
    assert main(["train", "-i", str(begun)]) == 0
    assert (begun / POLICY).exists() and "starting anew" in capsys.readouterr().out
    curves = [json.loads((place / CURVE).read_text()) for place in (folder, begun)]
    assert curves[0][-1]["pose"] == curves[1][-1]["pose"]
    # What is there without its checkpoints is not overwritten.
    for path in begun.glob("*.zip"):
        path.unlink()
    assert main(["train", "-i", str(begun)]) == 2
    assert "has no checkpoint" in capsys.readouterr().err


def test_a_full_disk_keeps_the_checkpoint(run: tuple[str, Path], tmp_path: Path) -> None:
    from test_files import full_disk

    algo, folder = run
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    before = {path: path.read_bytes() for path in copy.glob("*.zip")}
    agent = latest_checkpoint(copy)
    with full_disk(3000), pytest.raises(OSError) as raised:
        trainer(algo)(settings(algo, 1920, save_freq=1), copy, agent=agent)
    assert raised.value.filename.startswith(str(copy))
    assert {path: path.read_bytes() for path in copy.glob("*.zip")} == before
    assert all(zipfile.is_zipfile(path) for path in before)
    assert Settings.load(copy)
