"""Text of the interface for readers: signatures, `repr`, docstrings that tools show, and types in an editor."""

import ast
import importlib
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import pytest
from helpers import SMALL, policy

import uvms_gym
from uvms_gym.rollouts import RolloutStats

MODULES = ("", ".envs", ".controllers", ".identification", ".logs", ".planning", ".rollouts", ".disturbances")
#: Longest signature: all options of docking.
LONGEST = 1300


def public() -> Iterator[tuple[str, Any]]:
    """Public functions, classes and methods, by their qualified names."""
    for suffix in MODULES:
        module = importlib.import_module(f"uvms_gym{suffix}")
        names = getattr(module, "__all__", [name for name in vars(module) if not name.startswith("_")])
        for name in names:
            thing = getattr(module, name)
            if not callable(thing) or not thing.__module__.startswith("uvms_gym"):
                continue
            yield name, thing
            for key, member in vars(thing).items() if inspect.isclass(thing) else ():
                if not key.startswith("_") and (callable(member) or isinstance(member, property)):
                    yield f"{name}.{key}", member


THINGS = dict(public())


def test_signatures_are_readable() -> None:
    signatures = {}
    for name, thing in THINGS.items():
        try:
            signatures[name] = str(inspect.signature(thing))
        except (TypeError, ValueError):
            continue
    assert len(signatures) > 100
    # NumPy's aliases are not spelled out, some 300 characters each.
    spelled = [name for name, text in signatures.items() if re.search("_SupportsArray|NestedSequence|dtype\\[", text)]
    assert spelled == []
    assert [name for name, text in signatures.items() if len(text) > LONGEST] == []
    assert len(signatures["MLP"]) < 500 and len(signatures["optimize_trajectory"]) < 600


def test_docstrings_are_read_as_meant() -> None:
    fields = {name: inspect.getdoc(thing) or "" for name, thing in THINGS.items()}
    # Documentation tools take words before a colon for the type of a property, and one name for each attribute.
    first = {name: fields[name].split("\n\n")[0] for name, thing in THINGS.items() if isinstance(thing, property)}
    assert [name for name, text in first.items() if ": " in re.sub("`[^`]*`", "", text)] == []
    attributes = {name: re.findall(r"Attributes\n-+\n(.*?)(?:\n\n|$)", text, re.S) for name, text in fields.items()}
    assert [name for name, found in attributes.items() if found and re.search(r"^\w+, .* : ", found[0], re.M)] == []
    assert [name for name, text in fields.items() if "as are errors" in text or "Alias for field" in text] == []


def test_every_field_of_the_statistics_has_its_meaning_once() -> None:
    text = inspect.getdoc(RolloutStats) or ""
    for name in RolloutStats.__dataclass_fields__:
        assert len(re.findall(rf"^{name} : .*\n    \w", text, re.M)) == 1, name
        assert not hasattr(RolloutStats, name)


def test_repr_says_what_a_thing_is() -> None:
    env = gymnasium.make("UVMS-StationKeep-Storm-v0", scene=uvms_gym.load_scene(SMALL)).unwrapped
    assert repr(env).startswith(
        f"StationKeepEnv(UVMS-StationKeep-Storm-v0, scene='{SMALL}', substeps=10, disturbance='storm'"
    )
    envs = uvms_gym.envs.EETrackVectorEnv(3, dt=0.01)
    assert repr(envs) == "EETrackVectorEnv(num_envs=3, scene='petasus-pum', dt=0.01)"
    learned = policy()
    assert repr(learned).startswith(
        f"MLP(sizes={learned.sizes}, history=1, residual=False, task='UVMS-StationKeep', scene='{SMALL}'"
    )
    stats = uvms_gym.envs.StationKeepVectorEnv(2, scene=SMALL)
    stats.reset(seed=0)
    rollout = uvms_gym.Rollout(stats, uvms_gym.PD(stats))
    rollout.run(3)
    assert repr(rollout).startswith("Rollout(StationKeepVectorEnv(num_envs=2, ") and "PD(kp=" in repr(rollout)
    assert repr(rollout.pop_stats()) == "RolloutStats(2 instances, 6 control periods, 0 episodes over)"
    picture = uvms_gym.Renderer("petasus-pum", width=320, height=240, distance=2.5)
    assert repr(picture) == "Renderer('petasus-pum', width=320, height=240, distance=2.500)"
    assert all(len(repr(thing)) < 600 for thing in (env, envs, learned, rollout))


SCRIPT = """
from typing import cast

import gymnasium
import numpy as np

import uvms_gym

env = gymnasium.make("UVMS-StationKeep-v0", scene="bluerov2-heavy")
task = cast(uvms_gym.envs.StationKeepEnv, env.unwrapped)
names: tuple[str, ...] = task.metric_names
pid: uvms_gym.controllers.Controller = uvms_gym.PID(env)
action, memory = pid.predict(np.zeros(24, np.float32))
envs = uvms_gym.envs.StationKeepVectorEnv(8, disturbance="storm")
envs.reset(seed=0)
rollout = uvms_gym.Rollout(envs, uvms_gym.make_controller("pd", envs))
rollout.run(10)
stats: uvms_gym.rollouts.RolloutStats = rollout.pop_stats()
print(stats.rms("position_error"), {name: level.components for name, level in uvms_gym.disturbance_levels().items()})
simulator = uvms_gym.Simulator("petasus-pum", 4)
simulator.step(thrust=np.zeros((4, 6)))
"""
WRONG = "simulator.step(thurst=np.zeros((4, 6)))\nuvms_gym.envs.StationKepEnv()\n"


def test_submodules_that_importing_the_package_loads_are_declared_for_editors() -> None:
    code = "import sys, uvms_gym; print(*(name for name in sys.modules if name.startswith('uvms_gym.')))"
    loaded = subprocess.run(
        [sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    public = {name.split(".")[1] for name in loaded if not name.split(".")[1].startswith("_")}
    tree = ast.parse(Path(uvms_gym.__file__).read_text())
    declared = {alias.asname for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert {"envs", "controllers"} <= public <= declared


@pytest.mark.nightly
def test_pyright_is_content_with_a_users_script_and_finds_its_mistakes(tmp_path: Path) -> None:
    pytest.importorskip("basedpyright")
    settings = {"typeCheckingMode": "standard", "extraPaths": [str(Path(uvms_gym.__file__).parents[1])]}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    (tmp_path / "right.py").write_text(SCRIPT)
    (tmp_path / "wrong.py").write_text(SCRIPT + WRONG)
    command = [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
    found: dict[str, list[str]] = {"right.py": [], "wrong.py": []}
    for one in json.loads(done.stdout)["generalDiagnostics"]:
        if one["severity"] == "error":
            found[Path(one["file"]).name].append(one["message"])
    assert found["right.py"] == []
    assert all(any(word in message for message in found["wrong.py"]) for word in ("thurst", "StationKepEnv"))
