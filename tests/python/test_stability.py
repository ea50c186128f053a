"""Modes, stable steps, and warnings of steps that are not."""

import copy
import json
import math
import pickle
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym import Simulator, StepWarning, load_scene
from uvms_gym.cli import main
from uvms_gym.envs.station_keep import StationKeepEnv, StationKeepVectorEnv

ENV = "UVMS-StationKeep-v0"
#: Step that is unstable for `stiff()` at some states, though not at those that these runs come to, s.
UNSTABLE = 0.008


def stiff(factor: float = 10.0, name: str = "bluerov2-heavy-alpha5") -> dict[str, Any]:
    """A scene with other gains of the joint servos, under a name of its own."""
    scene = copy.deepcopy(load_scene(name))
    scene["name"] = "stiff"
    for link in scene.get("arm", {}).get("links", []):
        for gain in ("kp", "kd"):
            link["joint"]["servo"][gain] *= factor
    return scene


@contextmanager
def caught() -> Iterator[list[warnings.WarningMessage]]:
    """Every StepWarning, whether it was shown before or not."""
    with warnings.catch_warnings(record=True) as record:
        warnings.simplefilter("always")
        yield record
    assert all(issubclass(w.category, StepWarning) for w in record), record


def servoed(simulator: Simulator, steps: int = 1) -> None:
    """Step with the joint servos on."""
    simulator.step(joint_target=simulator.q, substeps=steps)


def test_modes_are_the_eigenvalues_of_the_linearization() -> None:
    s = Simulator("rexrov")
    a, _ = s.linearize()
    largest = max(np.linalg.eigvals(a[0]), key=abs)
    modes = s.modes(0.0, joint_servos=False, vehicle_servo=False)
    assert abs(modes[0]["rate"]) == pytest.approx(abs(largest), rel=1e-9)
    assert all(mode["where"] == "at home, at rest" and not mode["end_stop"] for mode in modes)


def test_modes_are_sorted_and_tell_what_moves_where() -> None:
    modes = Simulator("petasus-pum").modes()
    sizes = [abs(mode["rate"]) for mode in modes]
    assert sizes == sorted(sizes, reverse=True)
    assert any(mode["end_stop"] for mode in modes)
    for mode in modes:
        assert mode.keys() == {"rate", "time_constant", "period", "what", "where", "end_stop"}
        assert mode["time_constant"] == pytest.approx(1.0 / abs(mode["rate"].real))
        assert mode["period"] == (2.0 * math.pi / mode["rate"].imag if mode["rate"].imag else math.inf)
        assert mode["what"].startswith(("joint ", "vehicle "))


def test_stiffer_gains_and_faster_motion_are_faster_modes() -> None:
    rate = [abs(Simulator(stiff(factor)).modes()[0]["rate"]) for factor in (1.0, 10.0, 100.0)]
    assert 5.0 < rate[1] / rate[0] < 20.0 and 5.0 < rate[2] / rate[1] < 20.0
    s = Simulator("bluerov2-heavy-alpha5")
    slow, fast = s.modes(0.1), s.modes([3.0, 3.0, 3.0, 9.0, 9.0, 9.0])
    assert fast[0]["where"].endswith("pitch at 9.00 rad/s") and abs(fast[0]["rate"]) > 1.2 * abs(slow[0]["rate"])


def test_stable_steps_name_every_integrator_and_order_them() -> None:
    s = Simulator("petasus-pum")
    steps = s.stable_steps()
    assert {"mk4", "mk3", "mk2", "mk1"} <= steps.keys()
    for name in steps:
        assert Simulator("free-body", integrator=name).stable_steps() == dict.fromkeys(steps, math.inf)
    assert steps["mk4"] > steps["mk3"] > steps["mk2"] >= 0.999 * steps["mk1"] > 0.01
    # Servos and end stops ask for smaller steps.
    assert s.stable_steps(joint_servos=False, vehicle_servo=False)["mk4"] > s.stable_steps(end_stops=False)["mk4"]
    assert s.stable_steps(end_stops=False)["mk4"] >= steps["mk4"]


@pytest.mark.parametrize(
    ("speed", "error", "text"),
    [
        (-1.0, ValueError, "speed is -1"),
        (math.nan, ValueError, "speed is NaN"),
        (math.inf, ValueError, "speed is inf"),
        ([1.0, 2.0], ValueError, "speed has shape"),
        ("fast", TypeError, "speed must be"),
    ],
)
def test_a_bad_speed_is_refused(speed: Any, error: type[Exception], text: str) -> None:
    s = Simulator("rexrov")
    for ask in (s.modes, s.stable_steps):
        with pytest.raises(error, match=text):
            ask(speed)


@pytest.mark.parametrize("name", uvms_gym.scene_names())
@pytest.mark.parametrize(("integrator", "dt"), [("mk4", 0.02), ("mk3", 0.02), ("mk2", 0.02), ("ros2", 0.01)])
def test_nobody_is_warned_of_a_shipped_scene_at_its_step(name: str, integrator: str, dt: float) -> None:
    s = Simulator(name, dt=dt, integrator=integrator)
    with caught() as record:
        s.step(substeps=10)
        if s.num_joints:
            servoed(s, 10)
        if s.scene["vehicle"].get("servo"):
            s.step(pose_target=(np.zeros(3), np.eye(3)), substeps=10)
    assert not record
    steps = s.stable_steps(end_stops=False)
    assert steps["mk1"] > 0.01 and steps[integrator] >= s.stable_steps()[integrator]


def test_an_unstable_step_is_warned_of_once_and_by_its_numbers() -> None:
    s = Simulator(stiff(), 3, dt=UNSTABLE)
    stable = s.stable_steps(vehicle_servo=False, end_stops=False)["mk4"]
    with caught() as record:
        s.step(substeps=2)
        assert not record, "the servos are off"
        servoed(s)
        servoed(s)
        copy.deepcopy(s).step(joint_target=s.q)
    assert len(record) == 1
    text = str(record[0].message)
    parts = ("'stiff'", "'mk4'", "dt = 0.008 s", "joint 3 (wrist)", "1/s", f"{stable:.3g}")
    assert [part for part in parts if part not in text] == []
    assert "\n" not in text
    assert record[0].filename == __file__


#: Motions that are too much for an integrator: scene, step (s), twist, joint rate, factor on the servos' gains.
TOO_MUCH = {
    "spin": ("petasus-pum", 0.1, [2.0, 2.0, 2.0, 3.0, 3.0, 3.0], 4.0, 1.0),
    "stiff servos": ("bluerov2-heavy-alpha5", 0.02, [0.0] * 6, 1.0, 20.0),
    "fast": ("rexrov", 0.5, [40.0, 0.0, 0.0, 0.0, 0.0, 1.0], 0.0, 1.0),
}


@pytest.mark.parametrize("motion", TOO_MUCH)
def test_a_warning_names_integrators_that_help(motion: str) -> None:
    name, dt, twist, rate, factor = TOO_MUCH[motion]

    def run(integrator: str) -> list[str]:
        s = Simulator(stiff(factor, name), dt=dt, integrator=integrator)
        n = s.num_joints
        s.set_state(twist=twist, qd=rate * np.resize([1.0, -1.0], n))
        with caught() as record:
            for _ in range(30):
                s.step(joint_target=np.full(n, 0.5) if n else None)
        return [str(w.message) for w in record]

    def bounded(texts: list[str]) -> bool:
        return not any("unstable" in text or "not finite" in text for text in texts)

    runs = {entry: run(entry) for entry in ("mk4", "mk3", "mk2", "ros2", "ros3", "mk54")}
    assert sum(map(len, runs.values())) > 3
    for integrator, texts in runs.items():
        for text in texts:
            others = re.findall("'(.*?)'", text.rpartition(";")[2])
            assert integrator not in others, text
            for other in others:
                assert bounded(runs[other]) if not bounded([text]) else not runs[other], f"{text}\n{runs[other]}"


@pytest.mark.parametrize("way", [lambda s: s, lambda s: pickle.loads(pickle.dumps(s))], ids=["itself", "pickle"])
def test_as_an_error_the_warning_comes_before_the_step(way: Any) -> None:
    s = way(Simulator(stiff(), dt=UNSTABLE))
    with pytest.raises(StepWarning, match="unstable"):
        servoed(s)
    assert s.time[0] == 0.0
    servoed(s)
    assert s.time[0] == UNSTABLE


@pytest.mark.parametrize(
    ("make", "given", "count"),
    [
        (StationKeepEnv, {"scene": stiff(), "dt": UNSTABLE}, 1),
        (gymnasium.make, {"id": ENV, "scene": stiff(), "dt": UNSTABLE}, 1),
        (StationKeepVectorEnv, {"num_envs": 5, "scene": stiff(), "dt": UNSTABLE}, 1),
        (StationKeepVectorEnv, {"num_envs": 5, "scene": "bluerov2-heavy-alpha5", "dt": 0.02}, 0),
    ],
)
def test_environments_warn_once_at_the_users_line(make: Any, given: dict[str, Any], count: int) -> None:
    env = make(**given)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    with caught() as record:
        env.reset(seed=1)
        for _ in range(3):
            env.step(action)
    assert len(record) == count
    assert all(warning.filename == __file__ and "'stiff'" in str(warning.message) for warning in record)


def test_the_command_line_shows_modes_and_stable_steps(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "rates.json"
    assert main(["scenes", "check", "petasus-pum", "--speed", "0.5", "--json", str(file)]) == 0
    shown = capsys.readouterr().out
    assert all(part in shown for part in ("no fault found", "Fastest modes", "stable step", "mk4", "joint 0 (yaw)"))
    data = json.loads(file.read_text())
    s = Simulator("petasus-pum")
    assert data["speed"] == 0.5
    assert [complex(*mode["rate"]) for mode in data["modes"]] == [mode["rate"] for mode in s.modes(0.5)]
    # JSON has no infinity.
    steps = {name: step if math.isfinite(step) else None for name, step in s.stable_steps(0.5).items()}
    assert data["stable_steps"]["servos on, at end stops"] == steps
    assert main(["scenes", "show", "free-body"]) == 0
    assert "any" in capsys.readouterr().out


def damped() -> dict[str, Any]:
    """A body whose surge decays at 4 1/s."""
    scene = copy.deepcopy(load_scene("free-body"))
    scene["water"]["density"] = 1000.0
    scene["vehicle"]["body"]["damping"] = {"linear": [4.0, 0.0, 0.0, 0.0, 0.0, 0.0]}
    return scene


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_a_motion_that_the_steps_do_not_follow_is_warned_of_once(dtype: str) -> None:
    s = Simulator(damped(), 150, dt=0.6, dtype=dtype)
    twist = np.zeros((150, 6))
    s.set_state(twist=twist)
    with caught() as record:
        s.step(substeps=3)
        assert not record, "nothing moves"
        twist[[77, 133], 0] = 1.0
        s.set_state(twist=twist)
        s.step(substeps=3)
        s.step(substeps=3)
        copy.copy(s).step()
    assert len(record) == 1
    text = str(record[0].message)
    numbers = ("instance 77 and 1 more of 150", "t = 3.6", "dt = 0.6 s", "4.00 1/s", "h*lambda = 2.40", "limit ")
    assert [part for part in ("'free-body'", *numbers) if part not in text] == []
    assert "\n" not in text and record[0].filename == __file__
    # The warning comes after the step.
    assert s.time[0] == pytest.approx(5.4)


def test_an_adaptive_integrator_has_nothing_to_warn_of() -> None:
    s = Simulator(stiff(), dt=0.02, integrator="mk54")
    with caught() as record:
        servoed(s, 5)
    assert not record


def test_a_diverging_episode_is_warned_of_before_it_is_replaced() -> None:
    scene = stiff(100.0)
    for link in scene["arm"]["links"]:
        # It would bound the servo's torque, and so the motion.
        del link["joint"]["effort"]
    envs = StationKeepVectorEnv(3, scene=scene, dt=0.01, autoreset_mode="SameStep")
    with caught() as record:
        envs.reset(seed=1)
        for _ in range(4):
            envs.step(np.zeros((3, 6)))
    before, during = (str(w.message) for w in record)
    assert "unstable" in before and "instance 2" in during
    assert all(w.filename == __file__ for w in record)
