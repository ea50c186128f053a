"""Messages that say a thing once, plainly, and name the right cause; tables on a terminal of 80 columns."""

import importlib
import json
import re
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import pytest
from helpers import SMALL, policy

import uvms_gym
from uvms_gym.cli import common, main, play
from uvms_gym.cli import fit as fit_command
from uvms_gym.cli.output import table
from uvms_gym.controllers.families import CONTROLLERS, TASKS, names
from uvms_gym.envs import StationKeepEnv
from uvms_gym.studies.accuracy.study import Criterion
from uvms_gym.studies.comparison.conditions import make_conditions
from uvms_gym.studies.comparison.summary import short_names

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


@pytest.mark.parametrize(
    ("name", "other"),
    [(name, other) for name in names(learned=False) for other in TASKS if other not in CONTROLLERS[name].tasks],
)
def test_a_controller_of_another_task_names_itself_the_task_and_the_controllers_for_it(name: str, other: str) -> None:
    kind: Any = CONTROLLERS[name].kind
    tasks = CONTROLLERS[name].tasks
    with pytest.raises(ValueError) as caught:
        kind(gymnasium.make(f"{TASKS[other]}-v0"))
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
    numbers = [body["mass"], 1e3 * 306.0 / (1030.0 * 9.81), 306.0]
    assert [float(cell) for cell in row] == pytest.approx(numbers, rel=1e-3)


@pytest.mark.parametrize(("scene", "unstable"), [("bluerov2-heavy", True), ("remus-100", True), ("rexrov", False)])
def test_a_positive_rate_is_explained(scene: str, unstable: bool, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "show", scene]) == 0
    assert ("unstable" in capsys.readouterr().out.split("Provenance")[0]) == unstable


def test_play_alone_is_the_view_in_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    served: list[Any] = []
    monkeypatch.setattr(play, "need", lambda *names: None)
    monkeypatch.setattr(play, "_serve", lambda *given: served.append(given))
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
    text = rf"{package} is not installed; run: pip install 'uvms-gym\[{extra}\]'"
    with pytest.raises(ModuleNotFoundError, match=text):
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
    fit_command._print(found)
    out = " ".join(capsys.readouterr().out.split())
    assert "map.joints.time.lag is negative" in out and "map.imu" not in out


@pytest.mark.learning
def test_train_says_its_result_once_and_the_steps_that_were_asked(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = ["--algo", "distill", "--teacher", "pd", "-n", "30", "-params", "n_envs:2", "-params", "n_steps:20"]
    assert main(["train", *given, "--eval-episodes", "2", "--verbose", "0"]) == 0
    first, second, _, last = capsys.readouterr().out.splitlines()
    assert re.match(r"40 steps, 30 asked and the last iteration completed, in \d+ s \(\d+ per second\)$", first)
    assert second.startswith("held-out episodes: pose ") and "steps" not in second
    assert re.match(r"weights: sha256 [0-9a-f]{64}$", last)


# Tables


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> pytest.CaptureFixture[str]:
    monkeypatch.setattr(common.console, "width", 80)
    return capsys


def test_a_table_fits_and_breaks_no_number_and_no_word(printed: pytest.CaptureFixture[str]) -> None:
    header = ("controller", "pose error, mm", "p95, mm", *(f"{cost} / pd" for cost in ("p95", "power", "variation")))
    numbers = ("47.62 [45.61, 49.63]", "142", "0.951 [0.912, 0.990]", "-1.0 % [-2.2, -0.1]", "10.11 [9.52, 10.73]")
    long = "a-name-that-is-much-longer-than-half-a-line-may-be"
    table("Errors", header, [("shac-distilled", *numbers), (long, *numbers)])
    lines = printed.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert all(sum(number in line for line in lines) == 2 for number in numbers)
    words = {word for name in header for word in name.split()}
    assert words <= {word for line in lines for word in line.split()}
    # What follows below begins with the names again.
    assert sum("controller" in line for line in lines) == sum("shac-distilled" in line for line in lines) > 1


def test_criteria_of_accuracy_leave_their_numbers_whole(printed: pytest.CaptureFixture[str]) -> None:
    what = "petasus-pum: MK4 f64 at 0.02 s, median error at the end effector"
    table("Criteria", ("criterion", "found", "bound", ""), [Criterion(what, "1.2e-09 m", "1e-06 m", True)])
    out = printed.readouterr().out
    assert re.search(r"criterion +found +bound", out) and re.search(r"1\.2e-09 m +1e-06 m +True", out)


def test_compare_names_policies_shortly_and_tells_their_files(
    printed: pytest.CaptureFixture[str], no_pictures: None, tmp_path: Path
) -> None:
    files = [tmp_path / "out/train/asymmetric-ppo" / f"UVMS-StationKeep-v0_{k}" / "policy.safetensors" for k in (1, 2)]
    for file in files:
        file.parent.mkdir(parents=True)
        policy().save(file)
    names = [f"mlp:{file}" for file in files]
    given = [word for name in ("pd", *names) for word in ("--controller", name)]
    given += ["--condition", "design", "--condition", "calm", "--env", "UVMS-StationKeep-v0", "--scene", SMALL]
    assert main(["compare", *given, "--episodes", "4", "--out", str(tmp_path)]) == 0
    lines = printed.readouterr().out.splitlines()
    legends = [f"policy {k}: {name}" for k, name in enumerate(names, 1)]
    assert all(lines.count(legend) == 2 for legend in legends)
    tables = [line for line in lines if line not in legends and not line.startswith(str(tmp_path))]
    assert max(map(len, tables)) <= 80
    assert not any("safetensors" in line for line in tables)
    assert sum(line.startswith("policy 1 ") for line in tables) >= 4
    assert all(line.count("[") == line.count("]") for line in tables)
    # Results keep the whole names.
    assert [*json.loads((tmp_path / "compare.json").read_text())["results"][0]["controllers"]] == ["pd", *names]


def test_short_names_are_told_apart() -> None:
    given = ["pd", "mlp:pd.safetensors", "mlp:a/x.safetensors", "mlp:b/x.safetensors", "py:c/own.py:LQR"]
    assert list(short_names(given).values()) == ["pd", "pd 1", "x 1", "x 2", "own.py:LQR"]
    assert short_names(["mlp:a/b/own.safetensors"]) == {"mlp:a/b/own.safetensors": "own"}


def test_scenes_whose_results_would_have_one_name_are_refused() -> None:
    scenes = dict.fromkeys(("a/own.toml", "b/own.toml"), SMALL)
    with pytest.raises(ValueError, match=r"a/own\.toml and b/own\.toml have the same name"):
        make_conditions(["UVMS-StationKeep-v0"], scenes)
