"""The package as such."""

import inspect
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

import uvms_gym
from uvms_gym import Simulator, _core

HEAVY = ["PIL", "onnx", "rosbags", "torch", "viser", "stable_baselines3", "matplotlib", "pygame", "typer", "rich"]


def test_the_package_under_test_is_the_one_meant() -> None:
    meant = os.environ.get("UVMS_GYM_UNDER_TEST")
    if meant is not None:
        assert Path(uvms_gym.__file__).parent.parent == Path(meant)


IMPORTING = f"""
import importlib, warnings
warnings.simplefilter("error")
import gymnasium, uvms_gym
before = dict(gymnasium.registry)
uvms_gym.register_envs()
importlib.reload(uvms_gym)
assert dict(gymnasium.registry) == before
for name in [name for name in before if name.startswith("UVMS-")]:
    gymnasium.make(name).reset(seed=0)
    gymnasium.make_vec(name, 2).reset(seed=0)
import sys
sys.exit(" ".join(name for name in {HEAVY!r} if name in sys.modules) or "UVMS-Dock-v0" not in before)
"""


@pytest.mark.parametrize("first", ["", "import matplotlib"])
def test_importing_registers_once_and_pulls_in_nothing_heavy(first: str) -> None:
    result = subprocess.run([sys.executable, "-c", first + IMPORTING], capture_output=True, text=True)
    assert (result.returncode == 0) == (first == ""), result.stderr
    assert first == "" or "matplotlib" in result.stderr


@pytest.mark.parametrize(
    ("native", "message"),
    [
        (None, "native module missing in {package}: run `make run` or `pip install -e .` in the source tree"),
        ("import absent_library", "No module named 'absent_library'"),
    ],
)
def test_a_missing_native_module_is_one_line(native: str | None, message: str, tmp_path: Path) -> None:
    package = tmp_path / "uvms_gym"
    package.mkdir()
    shutil.copy(uvms_gym.__file__, package)
    if native is not None:
        (package / "_core.py").write_text(native)
    result = subprocess.run([sys.executable, "-c", "import uvms_gym"], cwd=tmp_path, capture_output=True, text=True)
    *_, last = result.stderr.splitlines()
    assert last.startswith("ModuleNotFoundError: " + message.format(package=package))


def test_everything_public_is_exported_and_typed() -> None:
    package = Path(uvms_gym.__file__).parent
    assert (package / "py.typed").is_file()
    # The environments and controllers wrap these.
    wrapped = {"ATTITUDE_LEVER", "Controller", "Mlp", "Rollout", "Task", "gain_names", "task_defaults", "tasks"}
    wrapped |= {"assemble_robot", "read_robot", "trajectory_inputs", "vehicle_terms"}
    assert set(_core.__all__) - wrapped <= set(uvms_gym.__all__)
    assert re.fullmatch(r"\d+\.\d+\.\d+", uvms_gym.__version__)


def test_everything_has_a_docstring() -> None:
    members = [value for name, value in vars(Simulator).items() if not name.startswith("_")]
    assert len(members) > 40
    for member in [Simulator, uvms_gym.SceneError, uvms_gym.scene_names, uvms_gym.load_scene, *members]:
        assert inspect.getdoc(member), member


@pytest.mark.parametrize("name", uvms_gym.scene_names())
def test_scene_files_are_package_data(name: str) -> None:
    path = Path(uvms_gym.__file__).parent / "scenes" / f"{name}.toml"
    assert uvms_gym.load_scene(path) == uvms_gym.load_scene(str(path)) == uvms_gym.load_scene(name)


def test_gymnasium_is_of_a_supported_version() -> None:
    major, minor = map(int, gymnasium.__version__.split(".")[:2])
    assert (major, minor) >= (1, 2)
