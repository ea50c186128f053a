"""Sensors: closed forms, statistics, timing, and repeatable noise."""

import math
from typing import Any

import numpy as np
import pytest

from uvms_gym import Sensors, Simulator

QUIET: dict[str, dict[str, Any]] = {
    "imu": {
        "gyro_noise": 0.0,
        "accelerometer_noise": 0.0,
        "gyro_bias": 0.0,
        "accelerometer_bias": 0.0,
        "gyro_walk": 0.0,
        "accelerometer_walk": 0.0,
    },
    "dvl": {"noise": 0.0, "beam_dropout": 0.0},
    "depth": {"noise": 0.0, "offset": 0.0},
    "heading": {"noise": 0.0, "bias": 0.0},
    "acoustic": {"noise": 0.0, "vertical_noise": 0.0, "outliers": 0.0, "dropout": 0.0},
}


def turned(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    if axis == "z":
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def quiet(**changes: dict[str, Any]) -> dict[str, Any]:
    return {name: {**settings, **changes.get(name, {})} for name, settings in QUIET.items()}


def test_a_resting_vehicle_feels_its_weight() -> None:
    sim = Simulator("bluerov2-heavy", 2)
    rotation = turned("z", 0.7) @ turned("x", 0.3)
    sensors = Sensors(sim, quiet())
    sim.set_state(rotation=rotation, position=[1.0, 2.0, -3.0])
    sensors.measure(sim)
    sim.set_state(time=0.01)
    imu = sensors.measure(sim)["imu"]
    assert imu["valid"].all()
    np.testing.assert_allclose(imu["specific_force"], np.tile(rotation.T @ [0, 0, 9.81], (2, 1)), atol=2e-2)
    gravity = np.array(sim.scene["water"]["gravity"])
    np.testing.assert_allclose(imu["specific_force"][0], -rotation.T @ gravity, atol=1e-12)
    np.testing.assert_allclose(imu["angular_velocity"], 0.0, atol=1e-14)


def test_a_lever_arm_adds_the_centripetal_acceleration() -> None:
    sim, rate, period, lever = Simulator("bluerov2-heavy"), 1.2, 0.01, np.array([0.4, 0.1, 0.2])
    gravity = np.array(sim.scene["water"]["gravity"])
    sensors = Sensors(sim, quiet(imu={"position": lever.tolist(), "rpy": [0.0, 0.0, math.pi / 2]}))
    for k in range(2):
        sim.set_state(rotation=turned("z", rate * k * period), twist=[0, 0, 0, 0, 0, rate], time=k * period)
        imu = sensors.measure(sim)["imu"]
    half = rate * period / 2
    centripetal = -(rate**2) * np.array([lever[0], lever[1], 0.0]) * math.sin(half) / half
    expected = turned("z", math.pi / 2).T @ (centripetal - gravity)
    np.testing.assert_allclose(imu["specific_force"][0], expected, atol=1e-9)
    np.testing.assert_allclose(imu["angular_velocity"][0], [0, 0, rate], atol=1e-12)
    np.testing.assert_allclose(imu["latest_angular_velocity"][0], [0, 0, rate], atol=1e-12)


def test_other_sensors_follow_their_closed_forms() -> None:
    sim = Simulator("bluerov2-heavy")
    rotation, twist = turned("z", 0.7), np.array([0.3, -0.2, 0.1, 0.0, 0.0, 0.5])
    at = [0.2, 0.1, -0.1]
    suite = quiet(
        dvl={"position": at, "bottom": -10.0},
        depth={"position": at, "surface": 0.5},
        acoustic={"position": at, "delay": 0},
    )
    sensors = Sensors(sim, suite)
    sim.set_state(position=[1.0, 2.0, -3.0], rotation=rotation, twist=twist)
    found = sensors.measure(sim)
    velocity = twist[:3] + np.cross(twist[3:], at)
    np.testing.assert_allclose(found["dvl"]["velocity"][0], velocity, atol=1e-12)
    angle = sensors.suite["dvl"]["beam_angle"]
    beams = [(math.cos(a) * math.sin(angle), math.sin(a) * math.sin(angle), -math.cos(angle)) for a in
             np.deg2rad([45, 135, 225, 315])]  # fmt: skip
    np.testing.assert_allclose(found["dvl"]["beams"][0], np.array(beams) @ velocity, atol=1e-12)
    np.testing.assert_allclose(found["dvl"]["range"][0], 6.9 / math.cos(angle), atol=1e-12)
    np.testing.assert_allclose(found["depth"]["depth"], 3.6, atol=1e-12)
    np.testing.assert_allclose(found["heading"]["heading"], 0.7, atol=1e-12)
    np.testing.assert_allclose(found["acoustic"]["position"][0], [1, 2, -3] + rotation @ at, atol=1e-12)


def test_bottom_lock_ends_with_altitude_and_tilt() -> None:
    sim = Simulator("bluerov2-heavy", 3)
    sensors = Sensors(sim, quiet(dvl={"maximum_range": 8.0}))
    rotations = np.stack([np.eye(3), np.eye(3), turned("x", 1.4)])
    sim.set_state(position=[[0.0, 0.0, -5.0], [0.0, 0.0, -1.0], [0.0, 0.0, -9.0]], rotation=rotations)
    dvl = sensors.measure(sim)["dvl"]
    assert dvl["valid"].tolist() == [True, False, True]
    assert np.isfinite(dvl["velocity"]).all(axis=1).tolist() == [True, False, False]
    assert np.isfinite(dvl["beams"]).sum(axis=1).tolist() == [4, 0, 2]


def record(steps: int, suite: Any, n: int = 64, dt: float = 0.01, seed: int = 0) -> list[dict[str, Any]]:
    """Readings of vehicles at rest."""
    sim = Simulator("bluerov2-heavy", n)
    sim.set_state(position=[0.0, 0.0, -5.0])
    sensors, found = Sensors(sim, suite, seed=seed), []
    for k in range(steps):
        sim.set_state(time=k * dt)
        found.append({**sensors.measure(sim), "biases": sensors.biases()})
    return found


def test_noise_has_its_density_and_biases_walk() -> None:
    walk = {"gyro_walk": 1e-3, "accelerometer_walk": 2e-3, "gyro_bias": 0.0, "accelerometer_bias": 0.0}
    found = record(201, {"imu": walk, "depth": {"rate": 100}}, n=128)
    biases = np.stack([entry["biases"]["imu"] for entry in found])
    kinds = ("specific_force", "angular_velocity", "latest_angular_velocity")
    imu = [np.concatenate([e["imu"][kind] for kind in kinds], axis=1) for e in found]
    gravity = np.array([0, 0, -Simulator("bluerov2-heavy").scene["water"]["gravity"][2], 0, 0, 0])
    truth = np.concatenate([biases + gravity, biases[..., 3:]], axis=2)
    noise = (np.stack(imu) - truth)[1:]
    deviation = noise.reshape(-1, 9).std(axis=0)
    expected = np.repeat([1.2e-3, 1.2e-4, 1.2e-4], 3) / math.sqrt(0.01)
    count = noise.shape[0] * noise.shape[1]
    np.testing.assert_allclose(deviation / expected, 1.0, atol=5 / math.sqrt(2 * count))
    for seconds in (0.5, 1.0, 2.0):
        grown = (biases[int(seconds * 100)] ** 2).mean(axis=0)
        share = grown / (np.repeat([2e-3, 1e-3], 3) ** 2 * seconds)
        assert np.all(np.abs(share - 1) < 5 * math.sqrt(2 / 128))
    depth = np.stack([entry["depth"]["depth"] - entry["biases"]["depth"] for entry in found])
    assert abs(depth.std() / 0.002 - 1) < 5 / math.sqrt(2 * depth.size)


def test_losses_have_their_rates() -> None:
    suite = {"depth": {"rate": 100, "dropout": 0.3}, "dvl": {"rate": 100, "beam_dropout": 0.1}}
    found = record(200, suite)
    valid = np.stack([entry["depth"]["valid"] for entry in found])
    assert abs(valid.mean() - 0.7) < 5 * math.sqrt(0.21 / valid.size)
    beams = np.isfinite(np.stack([entry["dvl"]["beams"] for entry in found]))
    assert abs(beams.mean() - 0.9) < 5 * math.sqrt(0.09 / beams.size)


def test_rate_and_delay_are_exact() -> None:
    found = record(301, {"acoustic": {"rate": 2, "delay": 0.32, "dropout": 0}, "depth": {"rate": 5}}, n=1)
    arrived = [k for k, entry in enumerate(found) if entry["acoustic"]["valid"][0]]
    assert arrived == [32, 82, 132, 182, 232, 282]
    np.testing.assert_allclose([found[k]["acoustic"]["time"][0] for k in arrived], np.arange(6) / 2, atol=1e-12)
    assert [k for k, entry in enumerate(found) if entry["depth"]["valid"][0]] == list(range(0, 301, 20))


def test_sensors_fail_at_a_time_and_on_demand() -> None:
    found = record(30, {"depth": {"rate": 100, "failure": 0.1}}, n=2)
    assert [entry["depth"]["valid"].all() for entry in found] == [k < 10 for k in range(30)]
    sim = Simulator("bluerov2-heavy", 2)
    sensors = Sensors(sim, ["depth"])
    sensors.fail("depth", mask=[True, False])
    assert sensors.measure(sim)["depth"]["valid"].tolist() == [False, True]
    sensors.fail("depth", False)
    sim.set_state(time=1.0)
    assert sensors.measure(sim)["depth"]["valid"].all()


def test_noise_depends_on_the_seed_and_not_on_the_batch() -> None:
    many, again, one, other = (record(30, None, n=n, seed=s) for n, s in ((4, 5), (4, 5), (1, 7), (4, 6)))
    for a, b, c, d in zip(many, again, one, other, strict=True):
        for name in ("imu", "dvl", "depth", "heading", "acoustic"):
            for key in a[name]:
                assert a[name][key].tobytes() == b[name][key].tobytes()
                assert a[name][key][2:3].tobytes() == c[name][key].tobytes()
        assert not np.array_equal(a["biases"]["imu"], d["biases"]["imu"])


@pytest.mark.parametrize(
    ("suite", "message"),
    [
        ({"sonar": True}, "suite: unknown sensor 'sonar'; known: imu, dvl, depth, heading, acoustic"),
        ({"imu": {"rat": 1}}, "imu.rat: unknown field `rat`"),
        ({"imu": {"rate": 0}}, r"imu.rate: 0 must be within \[0.001, 10000\]"),
        ({"depth": {"dropout": 2.0}}, r"depth.dropout: 2 must be within \[0, 1\]"),
        (3, "suite: must be a dict of sensors or a list of names, not 3"),
    ],
)
def test_bad_settings_are_named(suite: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sensors(Simulator("bluerov2-heavy"), suite)


def test_time_must_not_run_backward() -> None:
    sim = Simulator("bluerov2-heavy")
    sensors = Sensors(sim, ["depth"])
    sim.set_state(time=1.0)
    sensors.measure(sim)
    sim.set_state(time=0.5)
    with pytest.raises(ValueError, match=r"time of instance 0 is 0.5 s, but was 1 s"):
        sensors.measure(sim)
    sensors.reset(mask=[True])
    assert sensors.measure(sim)["depth"]["valid"].all()
    with pytest.raises(ValueError, match="no sensor named 'imu': one of depth"):
        sensors.fail("imu")
