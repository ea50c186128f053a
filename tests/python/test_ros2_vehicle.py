"""Simulated vehicle, sensors, deadman and observations of the nodes of ROS 2, without ROS."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from uvms_gym import make_controller
from uvms_gym.ros2.observer import Observer
from uvms_gym.ros2.vehicle import ATMOSPHERE, DEADMAN, Measurement, SimulatedVehicle

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


def test_specific_force_is_the_change_of_velocity_less_gravity() -> None:
    one = vehicle("UVMS-StationKeep-v0", disturbance="calm", start_angle=0.0)
    np.testing.assert_allclose(one.measurement.specific_force, [0.0, 0.0, 9.81], atol=1e-12)
    velocity = np.zeros(3)
    for _ in range(10):
        one.command_wrench([40.0, 5.0, 10.0, 2.0, 0.0, 3.0])
        one.step()
        rotation = one.env.snapshot().rotation[0]
        velocity = velocity + one.period * (rotation @ one.measurement.specific_force + [0.0, 0.0, -9.81])
    assert velocity[0] > 0.02
    np.testing.assert_allclose(velocity, rotation @ one.measurement.twist[:3], atol=1e-12)


def test_pressure_grows_with_depth() -> None:
    one = vehicle("UVMS-StationKeep-v0", disturbance="calm")
    depth = 10.0 - one.measurement.position[2]
    assert one.measurement.pressure == pytest.approx(ATMOSPHERE + 1000.0 * 9.81 * depth, rel=1e-12)


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
    with pytest.raises(ValueError, match="noise and delay are for station keeping, not for ee-track"):
        vehicle("UVMS-EETrack-v0", disturbance="storm")


def test_a_vehicle_out_of_bounds_is_refused() -> None:
    env = make("UVMS-StationKeep-v0")
    observer = Observer(env, make_controller("pd", env))
    m = vehicle("UVMS-StationKeep-v0").measurement
    seen = observer.observe(m.position + 20.0, m.quaternion, m.twist, m.q, m.qd)
    with pytest.raises(ValueError, match="beyond the bounds of the task"):
        observer.act(seen)
