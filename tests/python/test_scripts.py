"""Scripts in training/: they compile, also without their packages, and finished policies are told from others."""

import json
import py_compile
from pathlib import Path

import pytest
from helpers import policy

from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.training.finished import is_finished

TRAINING = Path(__file__).parents[2] / "training"
SCRIPTS = sorted(TRAINING.glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_compiles(script: Path, tmp_path: Path) -> None:
    py_compile.compile(str(script), cfile=str(tmp_path / "compiled"), doraise=True)


def test_a_policy_is_finished_where_its_run_took_all_steps(tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    assert not is_finished(file)
    notes = {"hyperparameters": json.dumps({"n_timesteps": 6_000_000})}
    for steps, finished in (("369152", False), ("6000000", True), ("6000640", True)):
        policy(notes={**notes, "steps": steps}).save(file)
        assert is_finished(file) is finished
    file.write_bytes(file.read_bytes()[:-1])
    assert not is_finished(file)
    policy().save(file)
    assert not is_finished(file)
    assert all(is_finished(path) for at in (PRETRAINED, TRAINING) for path in at.rglob("*.safetensors"))
