"""Messages and tables that say a thing once, plainly, and blame the right one."""

import re
from collections import Counter
from typing import Any

import gymnasium
import pytest

import uvms_gym
from uvms_gym.cli import main
from uvms_gym.controllers import registry
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


@pytest.mark.parametrize("name", [name for name, entry in registry.CLASSICAL.items() if len(entry.tasks) < 3])
def test_a_controller_of_another_task_names_itself_the_task_and_the_controllers_for_it(name: str) -> None:
    kind, tasks = registry.CLASSICAL[name].kind, registry.CLASSICAL[name].tasks
    other = next(task for task in registry.TASKS if task not in tasks)
    env = gymnasium.make(f"{registry.TASKS[other]}-v0")
    with pytest.raises(ValueError) as caught:
        kind(env)
    message = str(caught.value)
    own = " and ".join(registry.TASKS[task] for task in tasks)
    assert message.startswith(f"{kind.__name__} is for {own}, not for {registry.TASKS[other]}; controllers of ")
    fit = {entry.kind.__name__ for entry in registry.CLASSICAL.values() if other in entry.tasks}
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
