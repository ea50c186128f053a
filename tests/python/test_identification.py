"""Fits of scenes to logs: keys, replays, intervals, files and commands."""

import copy
import json
import tomllib
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym import _rotations as rotations
from uvms_gym import identification
from uvms_gym.cli import main
from uvms_gym.identification import files, least_squares, scene_keys
from uvms_gym.identification.recordings import record
from uvms_gym.identification.replay import Corrections, Replay, equilibrium, stated_step
from uvms_gym.studies.identification.synthetic import Sensors, synthetic_log

POOL = Path(__file__).parents[1] / "data" / "pool"
SCENE = "bluerov2-alpha5-pool"
EXACT = Sensors(0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def logs_of(scene: dict[str, Any], count: int, duration: float = 8.0, seed: int = 0, **options: Any) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [synthetic_log(scene, f"trial-{k}", duration, rng, **options) for k in range(count)]


def changed(scene: dict[str, Any], values: dict[str, float | list[float]]) -> dict[str, Any]:
    """Scene with other values of keys."""
    scene = copy.deepcopy(scene)
    for key, value in values.items():
        scene_keys.write(scene, key, value if isinstance(value, list) else [value])
    return uvms_gym.load_scene(scene | {"provenance": {}})


# Keys


def test_keys_lead_to_numbers_lists_and_all_elements() -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy-alpha5")
    assert scene_keys.read(scene, "arm.links[wrist].body.mass") == [0.333]
    assert scene_keys.read(scene, "arm.links[3].body.inertia[1]") == [scene["arm"]["links"][3]["body"]["inertia"][1][1]]
    assert len(scene_keys.read(scene, "arm.links.body.mass")) == 4
    assert scene_keys.expand(scene, "vehicle.body.damping.linear[3:5]") == [
        "vehicle.body.damping.linear[3]",
        "vehicle.body.damping.linear[4]",
    ]
    assert len(scene_keys.expand(scene, "vehicle.body.center_of_buoyancy")) == 3
    assert scene_keys.expand(scene, "arm.links.body.damping.quadratic") == ["arm.links.body.damping.quadratic"]


@pytest.mark.parametrize(
    "key", ["vehicle.body.weigth", "arm.links[gripper].body.mass", "vehicle.name", "vehicle..mass"]
)
def test_keys_that_lead_nowhere_are_named(key: str) -> None:
    with pytest.raises(ValueError, match=r"weigth|gripper|vehicle"):
        scene_keys.read(uvms_gym.load_scene("bluerov2-heavy-alpha5"), key)


def test_rotational_inertia_acts_by_its_sum_alone() -> None:
    """A rigid tensor scaled down with the rest in the added mass moves as before, for any sum, and passes the check."""
    scene = uvms_gym.load_scene("bluerov2-heavy")
    rng = np.random.default_rng(0)
    twist, nominal = rng.normal(size=6), uvms_gym.Simulator(scene)
    nominal.set_state(twist=twist)
    scaled = copy.deepcopy(scene)
    sums = [scene_keys.read(scaled, f"vehicle.body.rotational_inertia[{k}]")[0] for k in range(3)]
    scene_keys.write(scaled, "vehicle.body.rotational_inertia[0]", [0.1])
    scene_keys.write(scaled, "vehicle.body.rotational_inertia[0]", [sums[0]])
    assert scaled["vehicle"]["body"]["inertia"] != scene["vehicle"]["body"]["inertia"]
    other = uvms_gym.Simulator(scaled)
    other.set_state(twist=twist)
    np.testing.assert_allclose(other.forward_dynamics(), nominal.forward_dynamics(), rtol=1e-12)
    lone = copy.deepcopy(scene)
    lone["vehicle"]["body"]["inertia"][0] = 0.9
    with pytest.raises(uvms_gym.SceneError):
        uvms_gym.load_scene(lone)
    scene_keys.write(scene, "vehicle.body.rotational_inertia[0]", [0.9])
    uvms_gym.load_scene(scene)


# Replays


def test_equilibrium_leaves_no_moment() -> None:
    scene = uvms_gym.load_scene(SCENE)
    q = np.random.default_rng(1).uniform(0.2, 3.0, (20, 4))
    up = equilibrium(scene, q)
    rpy = np.stack([np.arctan2(up[:, 1], up[:, 2]), -np.arcsin(up[:, 0]), np.zeros(20)], axis=-1)
    simulator = uvms_gym.Simulator(scene, 20)
    simulator.set_state(quaternion=rotations.from_rpy(rpy), q=q)
    np.testing.assert_allclose(simulator.equations()["g"][:, 3:6], 0.0, atol=1e-12)
    simulator.set_state(quaternion=rotations.from_rpy(rpy + np.array([0.01, 0.0, 0.0])), q=q)
    assert (np.abs(simulator.equations()["g"][:, 3]) > 0.01).all()


def test_replay_reproduces_a_log_without_noise() -> None:
    scene = uvms_gym.load_scene(SCENE)
    logs = logs_of(scene, 2, sensors=EXACT)
    found = identification.validate(scene, logs)
    means = found.table.means
    assert means["replay"]["roll"] < 0.02 and means["replay"]["pitch"] < 0.02
    assert means["balance"]["roll"] > 5 * means["replay"]["roll"]
    assert means["constant"]["roll"] > 2 * means["balance"]["roll"]


def test_lag_shifts_joints_and_commands() -> None:
    scene = uvms_gym.load_scene(SCENE)
    log = logs_of(scene, 1, sensors=EXACT, driven=True)[0]
    recording = record(log)
    now, later = recording.cubics(0.0), recording.cubics(recording.period)
    np.testing.assert_allclose(later[:-2, :, 0], now[1:-1, :, 0], atol=1e-3)
    assert np.abs(later[:, :, 0] - now[:, :, 0]).max() > 0.01
    fine = 2000
    times = recording.start + 0.013 + recording.period / fine * (np.arange(fine) + 0.5)
    expected = log.thrusters.command_at(times).mean(axis=0)
    np.testing.assert_allclose(recording.commands(0.013)[0, 0], expected, atol=0.05)


def test_zeros_shift_joints() -> None:
    scene = uvms_gym.load_scene(SCENE)
    replay = Replay([record(log) for log in logs_of(scene, 1, sensors=EXACT)])
    zeros = np.array([0.1, 0.0, -0.2, 0.0])
    np.testing.assert_allclose(
        replay.cubics(Corrections(zeros))[0, 0, :, 0], replay.cubics(Corrections())[0, 0, :, 0] - zeros
    )


def test_a_replay_has_steps_up_to_the_one_that_a_scene_states() -> None:
    scene = uvms_gym.load_scene(SCENE)
    recordings = [record(log) for log in logs_of(scene, 1, sensors=EXACT)]
    usual, period = Replay(recordings), recordings[0].period
    assert Replay(recordings, step=stated_step(scene)).substeps == usual.substeps
    assert Replay(recordings, step=stated_step({**scene, "integration": {"step": 1.0}})).substeps == usual.substeps
    short = stated_step({**scene, "integration": {"step": 0.0019}})
    assert Replay(recordings, step=short).substeps == np.ceil(period / 0.0019)
    # A step that is asked for comes before both, shorter or longer.
    for dt in (0.0007, 2.0 * period / usual.substeps):
        for step in (np.inf, short):
            assert Replay(recordings, step=step, dt=dt).substeps == np.ceil(period / dt - 1e-9)


# Fits


FREE = ["vehicle.body.center_of_buoyancy", "vehicle.body.rotational_inertia[0:2]", "vehicle.body.damping.linear[3:5]"]


@pytest.fixture(scope="module")
def synthetic() -> tuple[dict[str, Any], dict[str, float], list[Any]]:
    """Scene to start from, true values, and logs of a true scene that differs from it."""
    scene = uvms_gym.load_scene(SCENE)
    values = {
        "vehicle.body.center_of_buoyancy[0]": 0.0155,
        "vehicle.body.center_of_buoyancy[1]": -0.006,
        "vehicle.body.center_of_buoyancy[2]": 0.0101,
        "vehicle.body.rotational_inertia[0]": 0.62,
        "vehicle.body.rotational_inertia[1]": 0.41,
        "vehicle.body.damping.linear[3]": 0.45,
        "vehicle.body.damping.linear[4]": 0.21,
    }
    return scene, values, logs_of(changed(scene, values), 8, sensors=Sensors(joint_lag=0.0))


def test_fit_returns_true_values_within_its_intervals(synthetic: Any) -> None:
    scene, values, logs = synthetic
    found = identification.fit(scene, logs, FREE, hold_out=["trial-0"], balance=False)
    assert found.solution.converged and found.held_out == ("trial-0",) and len(found.train) == 7
    inside = [found.intervals[key][0] <= value <= found.intervals[key][1] for key, value in values.items()]
    assert sum(inside) >= 6, found.intervals
    for key, value in values.items():
        assert abs(found.values[key] - value) < 0.25 * abs(value), key
    held = found.table.of(found.held_out).means
    assert held["fitted"]["roll"] < 0.4 and held["start"]["roll"] > 2 * held["fitted"]["roll"]
    # Errors of the attitude that drift by trial make residuals far from independent.
    naive = found.uncertainty.naive
    assert np.median(found.uncertainty.deviations / naive) > 1.5
    assert found.undetermined == [] and found.at_bounds == []


def test_what_data_leave_open_is_named(synthetic: Any) -> None:
    scene, _, logs = synthetic
    found = identification.fit(scene, logs[:4], ["vehicle.body.center_of_buoyancy[2]", "vehicle.body.added_mass[0]"])
    ((share, direction),) = found.undetermined
    assert share > 0.8 and list(direction) == ["vehicle.body.added_mass[0]"]
    assert found.uncertainty.shares[0] < 0.01


def test_interruption_keeps_the_best_values(synthetic: Any) -> None:
    scene, _, logs = synthetic
    costs = []

    def stop(stage: str, iteration: int, cost: float) -> None:
        costs.append(cost)
        if iteration == 2:
            raise KeyboardInterrupt

    found = identification.fit(scene, logs[:3], FREE, report=stop, balance=False)
    assert found.solution.interrupted and not found.solution.converged and len(costs) == 2
    assert found.solution.cost == costs[-1] < costs[0]
    assert np.isfinite(found.uncertainty.deviations).all()


@pytest.mark.parametrize("stage", ["balance", "validate"])
def test_an_interruption_elsewhere_is_no_silent_change_of_numbers(
    stage: str, synthetic: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, _, logs = synthetic

    def stop(at: str, iteration: int, cost: float) -> None:
        if at == stage:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        if stage == "balance":
            identification.fit(scene, logs[:2], FREE, report=stop)
        else:
            # Once, in the search of the states at the start.
            first = iter([True])
            step = least_squares._step
            monkeypatch.setattr(
                least_squares, "_step", lambda *given: stop(stage, 0, 0.0) if next(first, False) else step(*given)
            )
            identification.validate(scene, logs[:2])


def test_lags_and_zeros_of_the_map_are_found() -> None:
    scene = uvms_gym.load_scene(SCENE)
    zeros = (0.05, -0.04, 0.03, 0.0)
    logs = logs_of(scene, 6, sensors=Sensors(joint_lag=0.12, joint_zeros=zeros, attitude_drift=0.05))
    free = [f"map.joints.axes.{name}.zero" for name in ("shoulder", "upper-arm", "elbow")] + ["map.joints.time.lag"]
    found = identification.fit(scene, logs, free, balance=False)
    np.testing.assert_allclose(list(found.values.values()), [*zeros[:3], 0.12], atol=0.02)


def test_driven_vehicle_gives_back_drag_added_mass_and_lag() -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy")
    for thruster in scene["vehicle"]["thrusters"]:
        thruster |= {"map": "t200", "lag": 0.15}
    scene = uvms_gym.load_scene(scene)
    values = {
        "vehicle.body.damping.quadratic[0]": 25.0,
        "vehicle.body.damping.quadratic[5]": 1.1,
        "vehicle.body.added_mass[0]": 8.0,
        "vehicle.body.added_mass[2]": 11.0,
    }
    truth = changed(scene, values | {"vehicle.thrusters.lag": [0.2] * 8})
    logs = logs_of(truth, 3, 10.0, driven=True, current=0.15)
    found = identification.fit(scene, logs, [*values, "vehicle.thrusters.lag"], period=0.05)
    for key, value in (values | {"vehicle.thrusters.lag": 0.2}).items():
        assert abs(found.values[key] / value - 1.0) < 0.06, (key, found.values[key])


@pytest.mark.parametrize(
    ("free", "options", "message"),
    [
        ([], {}, "no parameter"),
        (["vehicle.body.mass", "vehicle.body.mass"], {}, "twice"),
        (["map.imu.gain"], {}, "map.imu.gain"),
        (["map.joints.axes.gripper.zero"], {}, "gripper"),
        (["arm.base.damping.linear[0]"], {}, "must be > 0"),
        (["vehicle.body.mass"], {"priors": {"vehicle.body.volume": 1.0}}, "not free"),
        (["vehicle.body.mass"], {"priors": {"vehicle.body.mass": 0.0}}, "must be > 0"),
        (["vehicle.body.mass"], {"hold_out": ["007-*"]}, "007"),
        (["vehicle.body.mass"], {"hold_out": ["trial-*"]}, "at least 2"),
        (["vehicle.body.mass"], {"channels": ["velocity x"]}, "velocity x"),
    ],
)
def test_errors_name_key_or_trial(synthetic: Any, free: list[str], options: dict[str, Any], message: str) -> None:
    scene, _, logs = synthetic
    with pytest.raises(ValueError, match=message):
        identification.fit(scene, logs[:2], free, **options)


# Files and commands


def test_toml_reads_back() -> None:
    data = {"start": 9.5, "joints": {"time": {"lag": 0.1}, "axes": {"a b": {"zero": -1e-5}}}, "list": ["x", True, 2]}
    assert tomllib.loads(files.to_toml(data)) == data
    whole = tomllib.loads((POOL / "map.toml").read_text())
    assert tomllib.loads(files.to_toml(whole)) == whole


def test_shipped_scene_carries_its_intervals() -> None:
    ranges = identification.ranges(SCENE)
    scene = uvms_gym.load_scene(SCENE)
    assert len(ranges) == 12
    for key, (low, high) in ranges.items():
        assert low <= scene_keys.read(scene, key)[0] <= high, key
    envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=4, scene=SCENE, randomize=ranges)
    given = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=4, scene=SCENE)
    ends = []
    for batch in (envs, given):
        batch.reset(seed=0)
        for _ in range(20):
            observations, *_ = batch.step(np.zeros(batch.action_space.shape, np.float32))
        ends.append(observations)
    assert np.isfinite(ends[0]).all() and (ends[0] != ends[1]).any(axis=1).all()


def test_shipped_scene_predicts_pool_trials_better_than_balance() -> None:
    logs = uvms_gym.Log.read_all(POOL, POOL / "map-fitted.toml", scene=SCENE)
    means = identification.validate(SCENE, logs).table.means
    for channel, bound in {"roll": 0.5, "pitch": 0.4, "gyro x": 0.2, "gyro y": 0.25}.items():
        assert means["replay"][channel] < bound
        assert means["replay"][channel] < means["balance"][channel]
    start = identification.validate(tomllib.loads((POOL / "start.toml").read_text()), logs).table.means
    assert start["replay"]["roll"] > 2.0 * means["replay"]["roll"]


def test_commands_write_scene_map_and_ranges(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "fitted.toml"
    command = ["fit", str(POOL / "start.toml"), str(POOL), "--map", str(POOL / "map.toml"), "--out", str(out)]
    free = ["vehicle.body.center_of_buoyancy", "vehicle.body.rotational_inertia[0]", "map.joints.axes.shoulder.zero"]
    status = main([*command, *(part for key in free for part in ("--free", key)), "--no-balance"])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    assert "clustered by trial" in printed.out
    scene = uvms_gym.load_scene(out)
    assert scene["name"] == "fitted"
    assert scene["provenance"]["vehicle.body.center_of_buoyancy[0]"].startswith("fitted: to 2 trials of pool, 95 %")
    ranges = tomllib.loads((tmp_path / "fitted-randomize.toml").read_text())
    assert ranges == identification.ranges(out) and len(ranges) == 4
    data = json.loads((tmp_path / "fitted.json").read_text())
    fitted_map = tomllib.loads((tmp_path / "fitted-map.toml").read_text())
    zero = fitted_map["joints"]["axes"]["shoulder"]["zero"]
    assert zero == pytest.approx(data["parameters"]["map.joints.axes.shoulder.zero"]["value"], rel=1e-5)
    assert (
        main(["validate", str(out), str(POOL), "--map", str(tmp_path / "fitted-map.toml"), "--out", str(tmp_path)]) == 0
    )
    assert "balance" in capsys.readouterr().out
    assert (tmp_path / "replays.png").stat().st_size > 10_000
    assert main([*command, "--free", "vehicle.body.mass"]) == 2
    assert "exists" in capsys.readouterr().err


@pytest.mark.nightly
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    from uvms_gym.studies.identification.coverage import coverage

    found = coverage(200, scene=POOL / "start.toml", seed=1)
    assert 0.90 <= found.overall <= 0.98, found.by_key
