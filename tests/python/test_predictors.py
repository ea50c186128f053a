"""Simple predictors beside replays of logs."""

from dataclasses import replace
from typing import Any

import numpy as np

import uvms_gym
from uvms_gym import Log, identification
from uvms_gym.identification.recordings import record
from uvms_gym.identification.replay import Replay
from uvms_gym.logs import Attitude, Thrusters

TIME = 0.1 * np.arange(60)
CHANNEL: dict[str, Any] = {"source": "made", "time": TIME, "gap": 1.0, "rows": 60, "dropped": {}}
#: Thrusts that accelerate the vehicle along x alone, m/s2.
ACCELERATION = 0.4
MASS = uvms_gym.Simulator("bluerov2-heavy").mass_matrix()[0]
COMMAND = uvms_gym.Simulator("bluerov2-heavy").allocate(ACCELERATION * MASS[:, 0])
LOG = Log(
    name="1",
    start=0.0,
    end=5.9,
    attitude=Attitude(**CHANNEL, quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (60, 1))),
    thrusters=Thrusters(**CHANNEL, names=tuple("abcdefgh"), command=np.tile(np.ravel(COMMAND), (60, 1))),
)


def replay_of(initial: list[float], **options: Any) -> Replay:
    """Replay of 4 s from known channels at the start, SI units."""
    return Replay([replace(record(LOG).first(4.0), initial=np.array(initial))], **options)


def test_constant_velocity_goes_in_a_circle() -> None:
    speed, rate, yaw = 0.4, 0.3, 0.2
    start = [0.0, 0.0, yaw, 0.0, 0.0, rate, 1.0, 2.0, -3.0, speed, 0.0, 0.0]
    found = replay_of(start).constant_velocity()[0]
    t = 0.1 * np.arange(41)
    # (The chord of each period, along its middle: the exact circle, less (rate dt)^2 / 24 of its radius.)
    chord = np.sinc(rate * 0.05 / np.pi)
    circle = (
        speed / rate / chord * np.stack([np.sin(yaw + rate * t) - np.sin(yaw), np.cos(yaw) - np.cos(yaw + rate * t)])
    )
    np.testing.assert_allclose(
        found[:, 6:9], np.column_stack([1.0 + circle[0], 2.0 + circle[1], -3.0 + 0 * t]), atol=1e-12
    )
    np.testing.assert_allclose(found[:, 2], yaw + rate * t, atol=1e-12)
    np.testing.assert_allclose(found[:, [3, 4, 5, 9, 10, 11]], np.tile(start[3:6] + start[9:], (41, 1)), atol=1e-12)


def test_the_double_integrator_accelerates_by_thrust_over_inertia() -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy")
    start = [0.0] * 9 + [0.3, 0.0, 0.0]
    found = replay_of(start).double_integrator(scene)[0]
    assert MASS[0, 0] > scene["vehicle"]["body"]["mass"] + 1.0
    t = 0.1 * np.arange(41)
    np.testing.assert_allclose(found[:, 9], 0.3 + ACCELERATION * t, rtol=1e-9)
    np.testing.assert_allclose(found[:, 6], 0.3 * t + 0.5 * ACCELERATION * t**2, atol=1e-9)
    assert np.array_equal(
        replay_of(start, thrusters=False).double_integrator(scene),
        replay_of(start).constant_velocity(),
    )
    driven = identification.validate("bluerov2-heavy", [LOG], thrusters="log")
    assert {"constant velocity", "double integrator"} < set(driven.predicted)
    assert "double integrator" not in identification.validate("bluerov2-heavy", [LOG], thrusters="off").predicted
