import json
import math
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tree_scenes import HAND_MADE

from uvms_gym import Simulator, load_scene
from uvms_gym._scene import joints
from uvms_gym.cli import main
from uvms_gym.studies.speed import derivatives, environment, equal_error, learning, peers, physics, timing
from uvms_gym.studies.speed.rigid_bodies import dry, rigid_bodies
from uvms_gym.studies.speed.timing import Times

PNG = b"\x89PNG\r\n\x1a\n"
GOLDEN = Path(__file__).parents[1] / "golden/scenes"
TINY = ["--scene", "bluerov2-heavy-alpha5", "--quick"]
#: Default counts of the tests.
COUNTS = {"--n": "3", "--threads": "1", "--substeps": "2", "--repeats": "2"}


def repeated(option: str, *values: int) -> list[str]:
    return [word for value in values for word in (option, str(value))]


def bench(out: Path, *more: str) -> dict[str, Any]:
    file = out / "numbers/bench.json"
    counts = [word for option, count in COUNTS.items() if option not in more for word in (option, count)]
    assert main(["bench", *TINY, *counts, *more, "--out", str(out), "--json", str(file)]) == 0
    data: dict[str, Any] = json.loads(file.read_text())
    assert data == json.loads((out / "bench.json").read_text())
    assert (out / "bench.png").read_bytes().startswith(PNG)
    return data


def assert_summary(found: dict[str, float]) -> None:
    assert found["minimum"] <= found["low"] <= found["median"] <= found["high"]


def test_every_case_is_there_with_what_ran(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = bench(
        tmp_path, "--seed", "7", *repeated("--n", 2, 9), *repeated("--substeps", 1, 3), *repeated("--threads", 1, 2)
    )
    recorded = data["circumstances"]
    assert recorded["arguments"]["seed"] == 7
    assert recorded["arguments"]["n"] == [2, 9]
    assert len(recorded["load"]["before"]) == len(recorded["load"]["after"]) == 3
    assert recorded["machine"]["cores"] == os.cpu_count()
    instruction_set = recorded["machine"]["instruction_set"]
    rows = data["results"]["physics"]
    plain = [(r["dtype"], r["threads"], r["n"], r["substeps"]) for r in rows if not r["varied"]]
    assert plain == [(d, t, n, s) for d in ("float64", "float32") for t in (1, 2) for n in (2, 9) for s in (1, 3)]
    assert [(r["threads"], r["n"], r["substeps"]) for r in rows if r["varied"]] == [(1, 9, 3)] * 2
    for row in rows:
        assert_summary(row["seconds"])
        assert row["seconds"]["minimum"] > 1e-9
        assert row["steps_per_second"] == pytest.approx(1.0 / row["seconds"]["median"])
        assert (row["scene"], row["instruction_set"]) == ("bluerov2-heavy-alpha5", instruction_set)
        assert row["bytes"] > 0
    assert [row["dtype"] for row in data["results"]["parameters"]] == ["float64", "float32"]
    assert [(row["what"], row["n"], row["threads"]) for row in data["results"]["threads"]] == [("physics", 9, 2)] * 2
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("load average", instruction_set, "times as fast as one"))


def test_other_instruction_sets_run_in_other_processes(tmp_path: Path) -> None:
    rows = bench(tmp_path, "--instruction-set", "plain", "--dtype", "float64")["results"]["physics"]
    assert [(row["instruction_set"], row["varied"]) for row in rows] == [("plain", False), ("plain", True)]
    assert "UVMS_INSTRUCTION_SET" not in os.environ


def test_environments_are_set_against_the_physics_of_the_same_substeps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(environment, "QUICK_VECTOR_SECONDS", 0.01)
    monkeypatch.setattr(environment, "SINGLE_CALLS", 5)
    found = bench(tmp_path, "--env", "--dtype", "float64")["results"]["environment"]
    (vector,), (single,), (gymnasium,) = found["vector"], found["single"], found["gymnasium"]
    assert (vector["n"], vector["threads"], vector["substeps"]) == (3, 1, 5)
    for row in (vector, single):
        for name in ("env", "physics", "physics_alone"):
            assert_summary(row[name])
        # A control step holds its physics.
        assert row["env"]["minimum"] > 0.5 * row["physics_alone"]["median"]
    # Gymnasium has that benchmark from 1.4 on.
    assert gymnasium["steps_per_second"] is None or gymnasium["steps_per_second"] > 0.0


def test_episodes_of_a_vector_environment_are_out_of_step() -> None:
    env = environment.VectorEnv(load_scene("bluerov2-heavy"), 6, 1, "float64", 0).env
    steps = env.unwrapped.episode["step"]
    assert len(set(steps.tolist())) > 3


@pytest.mark.learning
def test_ppo_learns_through_the_adapter() -> None:
    pytest.importorskip("stable_baselines3")
    found = learning.ppo_study(load_scene("bluerov2-heavy"), 4, 1, 1, 0)
    assert found["collecting_steps_per_second"]["median"] > found["steps_per_second"]["median"] > 0.0
    assert 0.0 < found["share_of_environment"]["median"] < 1.0


class Counter:
    """A case that notes who was called when."""

    def __init__(self, name: str, log: list[str]) -> None:
        self.name, self.log, self.count = name, log, 0

    def sample(self) -> Times:
        self.log.append(self.name)
        self.count += 1
        return Times(float(self.count), 0.5 * self.count)

    def check(self) -> None:
        self.log.append("check")


def test_rounds_are_interleaved_checked_and_the_first_is_thrown_away() -> None:
    log: list[str] = []
    times = timing.interleave({name: Counter(name, log) for name in "ab"}, 2)
    assert log == ["a", "check", "b", "check"] * 3
    assert times["a"].wall.tolist() == [2.0, 3.0]
    assert times["b"].fair(1).tolist() == [1.0, 1.5]
    assert times["b"].fair(2).tolist() == [2.0, 3.0]


def test_time_of_sleep_is_no_cpu_time() -> None:
    import time

    times = timing.timed(lambda: time.sleep(0.02), 2)
    assert 0.02 <= times.wall
    assert times.cpu < 0.01


@pytest.mark.parametrize("part", ["position", "rotation", "twist", "q", "qd"])
def test_a_state_that_is_not_finite_is_refused(part: str) -> None:
    state = {name: np.zeros((1, 2)) for name in ("position", "rotation", "twist", "q", "qd")}
    simulator: Any = SimpleNamespace(**state, scene_name="scene", num_envs=1)
    case = physics.Stepping(simulator, {}, 1)
    case.check()
    state[part][0, 1] = np.nan
    with pytest.raises(ValueError, match="scene: the timed motion is not finite"):
        case.check()


def test_parameters_of_its_own_are_set_on_every_instance() -> None:
    case = physics.Stepping.of(physics.Setting(load_scene("bluerov2-heavy"), n=5, varied=True))
    assert all(len(set(values.tolist())) == 5 for values in case.simulator.parameters.values())
    case.step()
    assert np.ptp(case.simulator.position, axis=0).max() > 0.0


def _row(wall: float, **changes: Any) -> dict[str, Any]:
    row = dict.fromkeys(physics.Setting._fields) | {"threads": 1, "varied": False, "substeps": 5, "n": 8}
    return (
        row | {"scene": "s", "bytes": 1, "samples": Times(np.array([wall] * 3), np.array([0.5 * wall] * 3))} | changes
    )


def test_costs_and_ratios_are_of_rows_that_differ_in_one_thing() -> None:
    rows = [_row(2.0), _row(3.0, varied=True), _row(1.25, threads=2), _row(9.0, substeps=1), _row(9.0, n=4, threads=2)]
    (cost,) = physics.parameter_costs(rows)
    assert cost["percent"]["median"] == pytest.approx(50.0)
    (ratio,) = physics.thread_speedups(rows, [], 8)
    assert (ratio["what"], ratio["ratio"]["median"]) == ("physics", pytest.approx(1.6))


def test_equal_steps_lie_on_the_line_of_log_over_log() -> None:
    steps = (1e-2, 1e-3, 1e-4)
    errors = [3.0 * h for h in steps]
    for step, outside in ((5e-3, False), (2e-4, False), (1e-8, True), (0.1, True)):
        found = equal_error.equal_step(steps, errors, 3.0 * step)
        assert found["step"] == pytest.approx(step)
        assert found["extrapolated"] == outside
    assert equal_error.equal_step(steps, [math.nan, *errors[1:]], 3e-5)["step"] == pytest.approx(1e-5)
    with pytest.raises(ValueError, match="no equal error"):
        equal_error.equal_step(steps, [math.nan, math.inf, 1.0], 1e-3)


SCENES = ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"]
RANDOM = ["random-fixed-loading-dry", "random-joint-loading-dry", "random-nine-joints-viscous"]


@pytest.mark.parametrize("scene", [*SCENES, *(str(GOLDEN / f"{name}.toml") for name in RANDOM), *HAND_MADE])
def test_val_peers_have_the_same_rigid_bodies(scene: str) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    from uvms_gym.studies.speed import mujoco_model, pinocchio_model

    loaded = load_scene(HAND_MADE[scene]() if scene in HAND_MADE else scene)
    found = peers.dry_difference(loaded)
    assert set(found) == {"mujoco", "pinocchio"}
    assert all(off < 1e-10 for off in found.values())
    masses = [link.matter.mass for link in rigid_bodies(loaded) if link.matter]
    model = mujoco_model.build(loaded)
    np.testing.assert_allclose(model.body_mass[1:], masses, rtol=1e-14)
    inertias = pinocchio_model.build(loaded).inertias
    np.testing.assert_allclose([inertias[i].mass for i in range(1, len(masses) + 1)], masses, rtol=1e-14)


def test_a_peer_with_another_mass_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    from uvms_gym.studies.speed import mujoco_model

    def heavier(scene: dict[str, Any]) -> Any:
        first, second, *others = rigid_bodies(scene)
        assert second.matter is not None
        matter = second.matter._replace(mass=second.matter.mass * (1.0 + 1e-6))
        return [first, second._replace(matter=matter), *others]

    monkeypatch.setattr(mujoco_model, "rigid_bodies", heavier)
    with pytest.raises(ValueError, match="dry accelerations of mujoco differ"):
        peers.dry_difference(load_scene("petasus-pum"))


@pytest.mark.parametrize("scene", SCENES)
def test_val_mujoco_does_what_is_said_of_it(scene: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    from uvms_gym.studies.speed import mujoco_model

    loaded = load_scene(scene)
    wet, vacuum = (mujoco_model.build(loaded, water=water) for water in (True, False))
    thrusters, joints = len(loaded["vehicle"]["thrusters"]), wet.nv - 6
    assert wet.nu == thrusters + joints
    assert (wet.geom_fluid[:, 0] > 0.0).all() and wet.ngeom == joints + 1
    data = {name: mujoco.MjData(model) for name, model in (("wet", wet), ("vacuum", vacuum))}
    # Every body's ellipsoid feels the water, ...
    data["wet"].qvel[:] = 0.3
    mujoco.mj_forward(wet, data["wet"])
    assert (np.abs(data["wet"].qfrc_fluid) > 0.0).all()
    assert data["wet"].nefc == data["wet"].ncon == 0
    # ... which adds nothing to the inertia: from rest both accelerate alike.
    for name, model in (("wet", wet), ("vacuum", vacuum)):
        data[name].qvel[:], data[name].ctrl[:] = 0.0, 1.0
        mujoco.mj_forward(model, data[name])
    np.testing.assert_array_equal(data["wet"].qacc, data["vacuum"].qacc)
    # Buoyancy carries what it does in the scene.
    buoyant = mujoco_model.build(loaded, weight="buoyant")
    carried = buoyant.body_gravcomp @ buoyant.body_mass * 9.81
    trim = Simulator(loaded).trim()["wrench"][0]
    assert carried - buoyant.body_mass.sum() * 9.81 == pytest.approx(-trim[2], abs=1e-9)
    # A thrust is the wrench that the scene makes of it.
    simulator = Simulator(loaded)
    data["wet"].ctrl[:thrusters], data["wet"].ctrl[thrusters:] = np.arange(1.0, thrusters + 1.0), 0.0
    mujoco.mj_forward(wet, data["wet"])
    wrench = simulator.thruster_configuration @ np.arange(1.0, thrusters + 1.0)
    np.testing.assert_allclose(data["wet"].qfrc_actuator[:6], wrench, rtol=1e-12, atol=1e-12)


def test_val_a_rollout_is_the_motion_of_its_inputs() -> None:
    mujoco = pytest.importorskip("mujoco")
    from uvms_gym.studies.speed import mujoco_model

    scene = load_scene("petasus-pum")
    rolling = mujoco_model.Rolling(scene, n=2, steps=3, seed=1)
    model = rolling.models[0]
    start, controls = rolling.start.copy(), rolling.controls
    assert (controls[:, :, 6:] == [0.0, 0.3, 0.6, 0.4, 0.0]).all()
    assert len(np.unique(controls[:, 0, :6])) == 12
    rolling.step()
    rolling.check()
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, start[1], mujoco_model.STATE)
    data.ctrl[:] = controls[1, 0]
    for _ in range(3):
        mujoco.mj_step(model, data)
    np.testing.assert_array_equal(rolling.start[1, 1:-1][: model.nq], data.qpos)
    rolling.states[0, 1, 4] = np.inf
    with pytest.raises(ValueError, match="MuJoCo's timed motion is not finite"):
        rolling.check()


@pytest.mark.parametrize("scene", SCENES)
def test_val_derivatives_of_pinocchio_are_those_of_linearize(scene: str) -> None:
    pin = pytest.importorskip("pinocchio")
    from uvms_gym.studies.speed import pinocchio_model

    vacuum = dry(load_scene(scene))
    simulator, model = Simulator(vacuum), pinocchio_model.build(vacuum)
    state, wrench, torque = peers._random(np.random.default_rng(0), simulator)
    simulator.set_state(**state)
    A, B = (found[0] for found in simulator.linearize(wrench=wrench, joint_torque=torque))
    rates = model.nv
    viscous = np.zeros(rates)
    viscous[6:] = [joint["friction"]["viscous"] for joint in joints(vacuum)]
    place = pin.SE3ToXYZQUAT(pin.SE3(state["rotation"], state["position"]))
    q, v = np.concatenate([place, state["q"]]), np.concatenate([state["twist"], state["qd"]])
    tau = np.concatenate([wrench, torque]) - viscous * v
    data = model.createData()
    by_q, by_v, by_tau = pin.computeABADerivatives(model, data, q, v, tau)
    expected = np.hstack([by_q, by_v - by_tau * viscous, by_tau])
    ours = np.hstack([A[rates:], B[rates:]])
    np.testing.assert_allclose(ours, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_val_peers_are_timed_and_set_against_us(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    pytest.importorskip("pinocchio")
    monkeypatch.setattr(equal_error, "QUICK_LADDERS", {"RK4": (0.02, 0.01), "Euler": (0.002, 0.001)})
    monkeypatch.setattr(equal_error, "THEIRS", 1e-3)
    monkeypatch.setattr(equal_error, "TIME", 0.2)
    monkeypatch.setattr(equal_error, "MOTIONS", 8)
    found = bench(tmp_path, "--peers", "--repeats", "1")["results"]["peers"]
    assert set(found["versions"]) == {"mujoco", "pinocchio"}
    (scene,) = found["scenes"].values()
    names = {*peers.MODELS, peers.ABA}
    assert set(scene["step"]["seconds"]) == names | set(peers.OURS.values())
    for dtype in ("float64", "float32"):
        assert set(scene["step"]["ratios"][dtype]) == names
        assert all(ratio["median"] > 0.0 for ratio in scene["step"]["ratios"][dtype].values())
    theirs = scene["equal_error"]["theirs"]
    assert theirs["Euler"]["order"] == pytest.approx(1.0, abs=0.1)
    assert theirs["RK4"]["order"] == pytest.approx(4.0, abs=0.7)
    assert theirs["Euler"]["equal"]["float64"]["step"] < 1e-4 < theirs["RK4"]["equal"]["float64"]["step"]
    assert scene["equal_error"]["uncertainty"]["theirs"] < 1e-2 * min(theirs["RK4"]["errors"])
    found_derivatives = scene["derivatives"]
    assert set(found_derivatives["seconds"]) == set(derivatives.CASES)
    assert all(seconds["minimum"] > 0.0 for seconds in found_derivatives["seconds"].values())
    assert found_derivatives["errors"]["centred"] < found_derivatives["errors"]["one-sided"] < 1e-3
    (vector,) = found["vector"]
    assert (vector["threads"], vector["substeps"]) == (1, 5)
    assert set(vector["peers"]) == set(peers.VECTOR_MODELS)
    assert all(peer["ratio"]["median"] > 0.0 for peer in vector["peers"].values())
    printed = " ".join(capsys.readouterr().out.split())
    assert "adds nothing to the inertia" in printed
    assert "no integrator between the four" in printed


def test_the_command_line_needs_neither_peers_nor_learners() -> None:
    absent = ("mujoco", "pinocchio", "stable_baselines3", "torch")
    block = f"import sys; sys.modules |= dict.fromkeys({absent})"
    code = block + "; from uvms_gym.cli import main; sys.exit(main(['bench', '--peers']))"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "'uvms-gym[peers]'" in line


def test_missing_peers_are_one_line_that_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:

    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr(timing, "import_module", absent)
    assert main(["bench", "--peers", "--out", str(tmp_path / "out")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "No module named 'mujoco'" in line
    assert "pip install 'uvms-gym[peers]'" in line
    assert main(["bench", "--sb3", "--out", str(tmp_path / "out")]) == 2
    assert "stable-baselines3" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_held_vehicle_has_no_peers() -> None:
    scene = load_scene("petasus-pum")
    scene["vehicle"]["fixed"] = True
    with pytest.raises(ValueError, match="has a fixed vehicle"):
        peers.check_scene(scene)
