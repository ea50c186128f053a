"""Messages and tables that say a thing once, plainly, and blame the right one."""

import importlib
import re
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import pytest

import uvms_gym
from uvms_gym.cli import fit as fit_command
from uvms_gym.cli import main, play
from uvms_gym.controllers.families import CONTROLLERS, TASKS, names
from uvms_gym.envs import StationKeepEnv

REFUSED: dict[str, Any] = {
    "level": {"disturbance": "hurricane"},
    "base": {"disturbance": {"base": "hurricane"}},
    "component": {"disturbance": {"wind": 1}},
    "key": {"disturbance": {"current": {"sped": 1}}},
    "type": {"disturbance": {"current": {"speed": "x"}}},
    "parameter": {"randomize": {"wind": 1}},
    "kind": {"randomize": "x"},
    "choice": {"action": "x"},
}


@pytest.mark.parametrize("options", REFUSED.values(), ids=REFUSED)
def test_a_refused_option_is_one_line_with_its_key_once(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError) as caught:
        StationKeepEnv(**options)
    message, (key,) = str(caught.value), options
    assert message.startswith(f"{key}: ") and message == message.strip() and "\n" not in message
    assert Counter(re.findall(r"\w+(?=: )", message))[key] == 1 and f"in `{key}`" not in message


@pytest.mark.parametrize("name", [name for name in names(learned=False) if len(CONTROLLERS[name].tasks) < 3])
def test_a_controller_of_another_task_names_itself_the_task_and_the_controllers_for_it(name: str) -> None:
    kind, tasks = CONTROLLERS[name].kind, CONTROLLERS[name].tasks
    assert kind is not None
    other = next(task for task in TASKS if task not in tasks)
    env = gymnasium.make(f"{TASKS[other]}-v0")
    with pytest.raises(ValueError) as caught:
        kind(env)
    message = str(caught.value)
    own = " and ".join(TASKS[task] for task in tasks)
    assert message.startswith(f"{kind.__name__} is for {own}, not for {TASKS[other]}; controllers of ")
    fit = {CONTROLLERS[name].kind.__name__ for name in names(other, learned=False)}
    assert set(message.rpartition(": ")[2].split(", ")) == fit


def test_a_body_with_a_buoyancy_has_a_volume(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "show", "remus-100"]) == 0
    out = capsys.readouterr().out
    body = uvms_gym.load_scene("remus-100")["vehicle"]["body"]
    (row,) = re.findall(r"^vehicle  +(\S+)  +(\S+)  +(\S+)$", out, re.M)
    assert [float(cell) for cell in row] == pytest.approx(
        [body["mass"], 1e3 * 306.0 / (1030.0 * 9.81), 306.0], rel=1e-3
    )


@pytest.mark.parametrize(("scene", "unstable"), [("bluerov2-heavy", True), ("remus-100", False)])
def test_a_positive_rate_is_explained(scene: str, unstable: bool, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "show", scene]) == 0
    assert ("unstable" in capsys.readouterr().out.split("Provenance")[0]) == unstable


def test_play_alone_is_the_view_in_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[Any] = []
    module = sys.modules[play.__module__] if callable(play) else play
    monkeypatch.setattr(module, "_need", lambda *names: None)
    monkeypatch.setattr(module, "_serve", lambda *given: served.append(given))
    assert main(["play"]) == 0
    ((env, controller, seed, port),) = served
    assert (env.spec.id, controller, seed, port) == ("UVMS-StationKeep-Storm-v0", None, 0, 8080)


@pytest.mark.parametrize(
    ("module", "package", "extra"),
    [("sb3", "stable_baselines3", "train"), ("torch", "torch", "train"), ("jax", "jax", "jax")],
)
def test_a_module_without_its_extra_says_how_to_install_it(
    module: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name == f"uvms_gym.{module}" or name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)

    class Absent:
        @staticmethod
        def find_spec(name: str, *_: Any) -> None:
            if name.split(".")[0] == package:
                raise ModuleNotFoundError(f"No module named {package!r}", name=package)

    monkeypatch.setattr(sys, "meta_path", [Absent, *sys.meta_path])
    with pytest.raises(
        ModuleNotFoundError, match=rf"{package} is not installed; run: pip install 'uvms-gym\[{extra}\]'"
    ):
        importlib.import_module(f"uvms_gym.{module}")


def test_a_negative_lag_is_remarked_on(capsys: pytest.CaptureFixture[str]) -> None:
    empty = SimpleNamespace(of=lambda trials: SimpleNamespace(channels=(), means={}, trials=()))
    found: Any = SimpleNamespace(
        parameters=[],
        train=(),
        held_out=(),
        intervals={},
        at_bounds=[],
        undetermined=[],
        table=empty,
        uncertainty=SimpleNamespace(shares=[]),
        solution=SimpleNamespace(converged=True),
        strongest_correlations=lambda: [],
        values={"map.joints.time.lag": -0.011, "map.imu.time.lag": 0.011},
    )
    sys.modules[fit_command.__module__]._print(found) if callable(fit_command) else fit_command._print(found)
    out = " ".join(capsys.readouterr().out.split())
    assert "map.joints.time.lag is negative" in out and "map.imu" not in out


@pytest.mark.learning
def test_train_says_its_result_once_and_the_steps_that_were_asked(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = ["--algo", "distill", "--teacher", "pd", "-n", "30", "-params", "n_envs:2", "-params", "n_steps:20"]
    assert main(["train", *given, "--eval-episodes", "2", "--verbose", "0"]) == 0
    first, second, _ = capsys.readouterr().out.splitlines()
    assert re.match(r"40 steps, 30 asked and the last iteration completed, in \d+ s \(\d+ per second\)$", first)
    assert second.startswith("held-out episodes: pose ") and "steps" not in second
