import json
import math
import warnings
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym import Simulator, load_scene
from uvms_gym._scene import joints
from uvms_gym.cli import accuracy, main
from uvms_gym.studies.accuracy import conservation, work_precision
from uvms_gym.studies.accuracy import driven_motion as motion
from uvms_gym.studies.accuracy.work_precision import Setting
from uvms_gym.studies.numerics import state_errors

PNG = b"\x89PNG\r\n\x1a\n"
EXPLICIT = ("mk1", "mk2", "mk3", "mk4")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("accuracy")
    arguments = ["--scene", "bluerov2-heavy-alpha5", "--integrator", "mk4", "--integrator", "mk2"]
    arguments += ["--step", "0.1", "--step", "0.02", "--step", "0.01", "--time", "1", "--episodes", "4", "--seed", "3"]
    file = out / "numbers/accuracy.json"
    assert main(["accuracy", *arguments, "--out", str(out), "--json", str(file)]) == 0
    data = json.loads(file.read_text())
    assert data == json.loads((out / "accuracy.json").read_text())
    assert all((out / name).read_bytes().startswith(PNG) for name in ("accuracy.png", "drift.png"))
    return data


def test_every_setting_is_there_with_errors_cost_and_warnings(run: dict[str, Any]) -> None:
    (result,) = run["results"].values()
    found = [(row["integrator"], row["precision"], row["step"]) for row in result["rows"]]
    assert found == [(i, p, h) for i in ("mk4", "mk2") for p in ("f64", "f32") for h in (0.01, 0.02, 0.1)]
    for row in result["rows"][:2]:
        assert 1e-13 < row["end_effector"]["median"] <= row["end_effector"]["worst"] < 1e-6
        assert 0.0 < row["end_effector"]["rms_median"] < 1e-6
        assert all(row[name]["median"] > 0.0 for name in work_precision.QUANTITIES)
        # From 10 ns to 10 us a step.
        assert 10.0 < row["cost"] * row["step"] < 1e4
        assert (row["warned_early"], row["warned_later"], row["diverged"]) == (False, False, 0)
    # Half the step: more than half the cost off.
    assert result["rows"][0]["cost"] > 1.3 * result["rows"][1]["cost"]
    assert len(result["drift"]) == len(found)


def test_json_has_circumstances_uncertainty_and_motion(run: dict[str, Any]) -> None:
    assert run["circumstances"]["arguments"]["seed"] == 3
    assert run["circumstances"]["arguments"]["step"] == [0.01, 0.02, 0.1]
    assert run["circumstances"]["machine"]["cores"] >= 1
    (result,) = run["results"].values()
    assert 0.0 < result["reference"]["uncertainty"]["end_effector"]["median"] < 1e-11
    assert result["character"]["path"] > 0.1
    assert result["recommended"]["f64"]["step"] == 0.02
    # Criteria stated for ten seconds are left out; orders hold for any time.
    assert [criterion["met"] for criterion in run["criteria"]] == [True]


def test_what_diverges_is_shown_as_such(run: dict[str, Any]) -> None:
    (result,) = run["results"].values()
    lost = [row for row in result["rows"] if (row["integrator"], row["step"]) == ("mk2", 0.1)]
    # Of four episodes, in each precision; actuators that saturate keep the fourth finite.
    assert [row["diverged"] for row in lost] == [3, 3]
    # Nothing wrong was silent.
    assert all(row["warned_early"] or row["warned_later"] for row in lost)
    row = lost[0] | {"end_effector": {"median": math.inf}, "warned_early": True}
    assert accuracy._cell(row, 0.0) == "divergedw"
    assert (
        accuracy._cell(row | {"end_effector": {"median": 1e-5}, "warned_early": False, "warned_later": False}, 0.0)
        == "1.0e-5!"
    )
    # A line that is drawn or fitted has no such points.
    assert all(0.1 not in entry["steps"] for entry in result["orders"].values())


def test_errors_fall_with_the_order_of_the_method() -> None:
    scene = work_precision.without_kinks(load_scene("bluerov2-heavy"))
    settings = [Setting(name, "f64", step) for name in EXPLICIT for step in (0.0025, 0.005, 0.01)]
    result = work_precision.study(scene, settings, episodes=4, seconds=2.0, seed=1, repeats=0)
    # Next to no damping is left: MK1 makes the swings of roll and pitch grow at any step, slowly.
    orders = work_precision.orders(result["rows"], {})
    for name, order in zip(EXPLICIT, range(1, 5), strict=True):
        assert orders[name]["order"] == pytest.approx(order, abs=0.15), name


def test_the_references_agree_far_below_the_errors_that_they_measure() -> None:
    setting = Setting("mk4", "f64", 0.01)
    result = work_precision.study(load_scene("petasus-pum"), [setting], episodes=4, seconds=1.0, seed=0, repeats=0)
    uncertainty = result["reference"]["uncertainty"]
    assert all(uncertainty[name]["worst"] < 1e-10 for name in work_precision.QUANTITIES)
    assert result["rows"][0]["end_effector"]["median"] > 10.0 * uncertainty["end_effector"]["median"]


def test_a_scene_that_defeats_the_reference_is_refused() -> None:
    scene = load_scene("petasus-pum")
    scene["arm"]["links"][4]["joint"]["servo"] = {"kp": 1e8, "kd": 1e5}
    del scene["arm"]["links"][4]["joint"]["effort"]
    with pytest.raises(ValueError, match="too stiff"):
        work_precision.study(scene, [], episodes=2, seconds=1.0, seed=0, repeats=0)


def test_references_are_c2_splines() -> None:
    driven = motion.driven_motion(load_scene("petasus-pum"), 3, 2.0, 0)
    pieces = driven.target
    h = motion.PERIOD
    a, b, c, d = np.moveaxis(pieces, -1, 0)
    ends = (a + h * (b + h * (c + h * d)), b + h * (2.0 * c + h * 3.0 * d), 2.0 * c + 6.0 * h * d)
    for end, start in zip(ends, (a, b, 2.0 * c), strict=True):
        np.testing.assert_allclose(end[:-1], start[1:], atol=1e-12)
    assert np.abs(c).max() > 0.1


def test_the_driven_motion_is_work_within_limits() -> None:
    scene = load_scene("petasus-pum")
    driven = motion.driven_motion(scene, 16, 10.0, 0)
    simulator = Simulator(scene, 16)
    simulator.set_state(**driven.start)
    assert np.linalg.norm(simulator.current, axis=1).max() <= motion.CURRENT
    limits = np.array([[joint["limits"]["lower"], joint["limits"]["upper"]] for joint in joints(scene)])
    effort = np.array([joint["effort"] for joint in joints(scene)])
    fastest = 0.0
    for i in range(100):
        torques = simulator.joint_torques(joint_target=driven.target[i])
        assert (np.abs(torques["command"]) < 0.5 * effort).all()
        simulator.step(**driven.inputs(i), substeps=10)
        # The soft servos of this arm may touch an end stop, but no instance leans on it.
        assert (simulator.q > limits[:, 0] - 0.05).all() and (simulator.q < limits[:, 1] + 0.05).all()
        fastest = max(fastest, float(np.abs(simulator.qd).max()))
    assert 0.4 < fastest < 1.0
    track = motion.follow(driven, {"dt": 0.01}, 10)
    character = motion.character(driven, track)
    assert 1.0 < character["path"] < 10.0
    assert 0.5 < character["turn"] < 10.0
    assert 0.4 < character["max_reference_rate"] <= 0.55


def test_a_motion_is_the_same_again_and_tiled_repeats_it() -> None:
    a, b = (motion.driven_motion(load_scene("bluerov2-heavy-alpha5"), 3, 0.5, 7) for _ in range(2))
    assert a.wrench.tobytes() == b.wrench.tobytes()
    assert all(a.start[name].tobytes() == b.start[name].tobytes() for name in a.start)
    tiled = a.tiled(8)
    np.testing.assert_array_equal(tiled.target[:, 7], a.target[:, 1])
    other = motion.driven_motion(load_scene("bluerov2-heavy-alpha5"), 3, 0.5, 8)
    assert np.abs(other.wrench - a.wrench).max() > 0.1


@pytest.mark.parametrize(("call", "warned"), [(0, (True, False)), (3, (False, True)), (None, (False, False))])
def test_early_and_later_warnings_are_distinguished(
    call: int | None, warned: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    driven = motion.driven_motion(load_scene("bluerov2-heavy"), 2, 0.5, 0)

    class Warner:
        def __init__(self, *arguments: Any, **options: Any) -> None:
            self.simulator, self.calls = Simulator(*arguments, **options), 0

        def __getattr__(self, name: str) -> Any:
            return getattr(self.simulator, name)

        def step(self, **inputs: Any) -> None:
            if self.calls == call:
                warnings.warn("too large a step", UserWarning, stacklevel=2)
            self.calls += 1
            self.simulator.step(**inputs)

    monkeypatch.setattr(motion, "Simulator", Warner)
    track = motion.follow(driven, {"dt": 0.05}, 5)
    assert (track.warned_early, track.warned_later) == warned


def test_errors_are_distances_and_angles() -> None:
    angle = 1e-9
    turn = np.array([[1.0, -angle, 0.0], [angle, 1.0, 0.0], [0.0, 0.0, 1.0]])
    truth = motion.Track(
        np.zeros((1, 2, 3)), np.tile(np.eye(3), (1, 2, 1, 1)), np.zeros((1, 2, 2)), np.zeros((1, 2, 3)), False, False
    )
    q = np.array([[[0.1, -0.2], [np.nan, 0.0]]])
    off = truth._replace(rotation=truth.rotation @ turn, position=truth.position + np.array([3.0, 4.0, 0.0]), q=q)
    errors = state_errors(off, truth)
    np.testing.assert_allclose(errors["attitude"], angle, rtol=1e-9)
    np.testing.assert_allclose(errors["position"], 5.0)
    assert errors["joints"].tolist() == [[0.2, np.inf]]
    assert work_precision._row(Setting("mk4", "f64", 0.1), off, truth, 0.0)["diverged"] == 2
    far = truth._replace(position=np.full((1, 2, 3), 1e300), rotation=np.full((1, 2, 3, 3), np.nan))
    row = work_precision._row(Setting("mk4", "f64", 0.1), far, truth, 0.0)
    assert (row["position"]["median"], row["attitude"]["rms_worst"], row["diverged"]) == (np.inf, np.inf, 2)


def _rows(errors: dict[float, float], **changes: Any) -> list[dict[str, Any]]:
    common = {"integrator": "mk4", "precision": "f64", "tolerance": None, "diverged": 0, "floor": False}
    common |= {"warned_early": False, "warned_later": False} | changes
    return [common | {"step": h, "cost": 400.0 / h, "end_effector": {"median": e}} for h, e in errors.items()]


def test_error_at_a_cost_lies_on_the_line_of_log_over_log() -> None:
    rows = _rows({h: 3.0 * h**2 for h in (0.01, 0.02, 0.05)})
    for step in (0.005, 0.01, 0.03, 0.1):
        assert work_precision.at_cost(rows, "mk4", 400.0 / step) == pytest.approx(3.0 * step**2)
    assert work_precision.at_cost(rows, "mk3", 1.0) is None


def test_the_recommended_step_is_accurate_stable_and_not_warned_of() -> None:
    def step(rows: list[dict[str, Any]], stable: float = 1.0) -> float | None:
        row = work_precision.recommend({"rows": rows, "stable_steps": {"mk4": stable}}, "f64")
        return None if row is None else row["step"]

    rows = _rows({0.01: 1e-9, 0.02: 1e-8, 0.05: 5e-7, 0.1: 2e-6})
    assert step(rows) == 0.05
    assert step(rows, 0.06) == 0.02
    assert step(rows, 0.001) is None
    rows[2]["warned_later"] = True
    assert step(rows) == 0.02
    rows[1]["diverged"] = 1
    assert step(rows) == 0.01


@pytest.mark.parametrize("name", uvms_gym.scene_names())
def test_every_shipped_scene_can_be_stripped_of_what_dissipates(name: str) -> None:
    (fine,) = conservation.drifts(load_scene(name), [Setting("mk4", "f64", 0.005)], episodes=2, seconds=1.0, seed=0)
    for quantity in conservation.QUANTITIES:
        assert quantity not in fine or fine[quantity]["worst"] < 1e-8


def test_nothing_dissipates_in_the_stripped_scene() -> None:
    scene = load_scene("petasus-pum")
    settings = [Setting("mk4", "f64", step) for step in (0.01, 0.02)]
    fine, coarse = conservation.drifts(scene, settings, episodes=4, seconds=2.0, seed=0)
    for quantity in conservation.QUANTITIES:
        assert fine[quantity]["median"] < 1e-8
        assert coarse[quantity]["median"] == pytest.approx(16.0 * fine[quantity]["median"], rel=0.5)
    # What is stripped is what dissipates, and the scene that was given keeps it.
    assert scene == load_scene("petasus-pum")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(conservation, "conservative", lambda scene: scene)
        (drag,) = conservation.drifts(scene, settings[:1], episodes=4, seconds=2.0, seed=0)
    assert drag["energy"]["median"] > 1e-2
