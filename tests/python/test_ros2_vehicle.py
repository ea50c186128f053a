"""Simulated vehicle, sensors, deadman and observations of the nodes of ROS 2, without ROS."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from uvms_gym import Sensors, Simulator, make_controller
from uvms_gym.ros2.instruments import ATMOSPHERE, Instruments
from uvms_gym.ros2.observer import Observer
from uvms_gym.ros2.vehicle import DEADMAN, Measurement, SimulatedVehicle

STORM = "UVMS-StationKeep-Storm-v0"


def make(env: str, **options: Any) -> Any:
    return gymnasium.make(env, disable_env_checker=True, **options).unwrapped


def vehicle(env: str = STORM, seed: int = 0, **options: Any) -> SimulatedVehicle:
    return SimulatedVehicle(make(env, **{**options, "action": "thrusters"}), seed)


def observed(observer: Observer, m: Measurement) -> Any:
    return observer.observe(m.position, m.quaternion, m.twist, m.q, m.qd)


@pytest.mark.parametrize(
    ("env", "controller", "options"),
    [
        (STORM, "dob", {}),
        (STORM, "ppo", {}),
        (STORM, "pid", {"action": "thrusters"}),
        ("UVMS-StationKeep-v0", "pd", {"scene": "bluerov2-heavy"}),
        ("UVMS-EETrack-v0", "resolved-dob", {}),
        ("UVMS-Dock-v0", "dock-pd", {}),
        ("UVMS-Button-v0", "resolved-dob", {}),
    ],
)
def test_a_controller_on_measurements_acts_as_in_the_environment(
    env: str, controller: str, options: dict[str, Any]
) -> None:
    """Entries agree to rounding, storm, noise, delay and the arm's motion included."""
    own = make(env, **options)
    control, thrusters = make_controller(controller, own), own.options.action == "thrusters"
    observation, _ = own.reset(seed=3)
    simulated, state = vehicle(env, 3, **options), None
    observer = Observer(make(env, **options), make_controller(controller, own), 3)
    for _ in range(60):
        seen = observed(observer, simulated.measurement)
        np.testing.assert_allclose(seen, observation, rtol=0, atol=5e-6)
        action, state = control.predict(observation, state)
        observation, *_, info = own.step(action)
        command, m = observer.act(seen), len(simulated.thrusters)
        if thrusters:
            simulated.command_thrust(command[:m])
        else:
            simulated.command_wrench(command[:6])
        if observer.joint_targets is not None:
            simulated.command_joints(*observer.joint_targets)
        elif simulated.driven:
            simulated.command_joints((), effort=command[m if thrusters else 6 :])
        simulated.step()
    assert simulated.info["rms_position_error"] == pytest.approx(info["rms_position_error"], rel=1e-6)


def test_the_deadman_stops_thrusters_and_holds_joints() -> None:
    calm = {"disturbance": "calm", "arm_amplitude": 0.4}
    one = vehicle("UVMS-StationKeep-v0", **calm)
    targets, rates = np.linspace(0.1, 0.2, 5) + one.measurement.q, np.full(5, 0.1)
    for _ in range(4):
        one.command_thrust(np.full(len(one.thrusters), 3.0))
        one.command_joints(targets, rates)
        one.step()
    twin = vehicle("UVMS-StationKeep-v0", **calm)
    state = one.env.get_state()
    silences = []
    for _ in range(20):
        silences.append(one.silent)
        one.step()
    # The last command was given one period before the first of these steps.
    assert silences == [k + 1 >= round(DEADMAN / one.period) for k in range(20)]
    assert not one.env.episode["joint_reference_rate"].any()
    assert np.abs(one.measurement.qd).max() < 5e-3 and np.allclose(one.measurement.q, targets, atol=0.02)
    twin.env.set_state(state)
    twin.time = one.time
    for k in range(20):
        running = k + 1 < round(DEADMAN / one.period)
        twin.command_thrust(np.full(len(one.thrusters), 3.0 if running else 0.0))
        twin.command_joints(targets, rates if running else ())
        twin.step()
    np.testing.assert_allclose(one.measurement.twist, twin.measurement.twist, rtol=0, atol=1e-12)


def test_a_reset_begins_the_next_episode_without_commands() -> None:
    one = vehicle(seed=5)
    one.command_thrust(np.full(len(one.thrusters), 50.0))
    one.step()
    again = one.reset()
    assert (again.time, one.episode, one.silent) == (0.0, 1, True)
    env = make(STORM, action="thrusters")
    env.reset(seed=5)
    env.reset()
    np.testing.assert_array_equal(env.snapshot().position, one.env.snapshot().position)


@pytest.mark.parametrize(
    "suite",
    [
        {},
        {
            "imu": {"dropout": 0.3, "failure": 1.5},
            "dvl": {"rate": 2.0, "beam_dropout": 0.4, "rpy": [0.0, 0.0, 0.5]},
            "depth": {"delay": 0.25, "noise": 0.5, "surface": 30.0},
        },
    ],
)
def test_instruments_read_what_sensors_of_the_same_declaration_read(suite: dict[str, Any]) -> None:
    """Noise, rate, delay, drop-outs and failures included, over two episodes and a failure on demand."""
    env = make(STORM, action="thrusters")
    one = SimulatedVehicle(env, 7, suite)
    # By default the surface is 10 m above the world's origin.
    twin = Sensors(env.snapshot(), {"imu": True, "dvl": True, "depth": {"surface": 10.0}, **suite}, seed=7)
    counts = dict.fromkeys(twin.suite, 0)
    weight = 9.81 * env.snapshot().scene["water"]["density"]
    for k in range(60):
        if k == 30:
            one.reset()
            twin.reset()
        if k in (40, 45):
            one.instruments.fail("depth", k == 40)
            twin.fail("depth", k == 40)
        if k:
            one.command_wrench([20.0, 5.0, 10.0, 2.0, 0.0, 3.0])
        if k not in (0, 30):
            one.step()
        expected, found = twin.measure(env.snapshot()), one.measurement.readings
        for name in twin.suite:
            values = {key: rows[0] for key, rows in expected[name].items()}
            if name == "depth":
                values["pressure"] = ATMOSPHERE + weight * np.maximum(0.0, values["depth"])
            valid = values["valid"] and np.isfinite(values.get("velocity", 0.0)).all()
            assert (name in found) == valid, (k, name)
            if valid:
                counts[name] += 1
                assert found[name].time == values["time"]
                for key, value in found[name].values.items():
                    np.testing.assert_allclose(value, values[key], rtol=1e-12, atol=0)
    assert all(count > 5 for count in counts.values()) and (not suite or counts["imu"] < 40)


def test_covariances_are_variances_of_the_readings() -> None:
    """Noise of a vehicle at rest in calm water, by 4000 readings; biases are in no covariance."""
    quiet = dict.fromkeys(("gyro_bias", "accelerometer_bias", "gyro_walk", "accelerometer_walk"), 0.0)
    simulator, period = Simulator("free-body"), 0.1
    suite = {"imu": quiet, "dvl": {"beam_dropout": 0.0, "rate": 20.0}, "depth": {"offset": 0.0, "rate": 20.0}}
    instruments = Instruments(simulator, suite, 3, period)
    taken: dict[str, list[Any]] = {}
    for k in range(4000):
        simulator.set_state(position=np.zeros(3), time=k * period)
        readings = instruments.read(simulator)
        for reading in readings.values():
            for key, value in reading.values.items():
                taken.setdefault(key, []).append(value)
    covariances = {key: value for reading in readings.values() for key, value in reading.covariance.items()}
    assert covariances.keys() == taken.keys()
    for key, covariance in covariances.items():
        np.testing.assert_allclose(np.var(taken[key], axis=0), np.diag(covariance), rtol=0.1)


@pytest.mark.parametrize(
    ("suite", "message"),
    [
        ({"sonar": True}, "sensors: unknown sensor 'sonar'; the node publishes imu, dvl, depth"),
        ({"imu": {"rate": -1.0}}, r"sensors: imu\.rate: -1 must be within"),
        ({"depth": {"rte": 1.0}}, r"sensors: depth\.rte: unknown field"),
        ({"depth": 3}, "sensors: depth"),
    ],
)
def test_bad_settings_of_instruments_are_one_line(suite: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        SimulatedVehicle(make(STORM, action="thrusters"), 0, suite)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (lambda v: v.command_thrust([1.0]), "thrusts have 1 numbers, but must have 6"),
        (lambda v: v.command_wrench([np.nan] * 6), r"wrench are \[nan.*must be finite"),
        (lambda v: v.command_joints([0.0] * 4), "positions have 4 numbers, but must have 5"),
    ],
)
def test_bad_commands_are_refused_and_change_nothing(command: Any, message: str) -> None:
    one = vehicle()
    with pytest.raises(ValueError, match=message):
        command(one)
    assert one.silent


def test_noise_is_for_station_keeping() -> None:
    with pytest.raises(ValueError, match="noise, delay and gaps are for station keeping, not for ee-track"):
        vehicle("UVMS-EETrack-v0", disturbance="storm")


def test_a_vehicle_out_of_bounds_is_refused() -> None:
    env = make("UVMS-StationKeep-v0")
    observer = Observer(env, make_controller("pd", env))
    m = vehicle("UVMS-StationKeep-v0").measurement
    seen = observer.observe(m.position + 20.0, m.quaternion, m.twist, m.q, m.qd)
    with pytest.raises(ValueError, match="beyond the bounds of the task"):
        observer.act(seen)
