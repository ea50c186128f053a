"""Synthetic logs: a scene simulated, with the noise, rates and lags of real recordings."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import Log, Simulator
from uvms_gym.identification.replay import equilibrium
from uvms_gym.logs import Imu, Joints, Pose, Thrusters, Twist, rotations

Floats = NDArray[np.float64]

#: Interval of the simulated samples, s.
PERIOD = 0.05
#: Physics steps in it.
SUBSTEPS = 2


@dataclass(frozen=True)
class Sensors:
    """Noise, rates and lags; the defaults are those of the pool data set.

    Attributes
    ----------
    attitude_noise, attitude_drift : float
        White noise of roll, pitch and yaw, and standard deviation of an error that changes slowly, deg.
    drift_time : float
        Time over which that error is correlated, s.
    gyro_noise : float
        White noise of angular velocity, rad/s.
    position_noise, velocity_noise : float
        White noise of position, m, and of velocity, m/s.
    joint_lag, joint_jitter : float
        Lateness of the stamps of joint states, s, and its deviation from sample to sample.
    joint_zeros : tuple of float
        Zeros of the joints that the log does not correct, rad or m; empty: none.
    thruster_lag : float
        Lateness of the stamps of commands, s.
    """

    attitude_noise: float = 0.03
    attitude_drift: float = 0.2
    drift_time: float = 5.0
    gyro_noise: float = 0.0012
    position_noise: float = 0.002
    velocity_noise: float = 0.005
    joint_lag: float = 0.23
    joint_jitter: float = 0.02
    joint_zeros: tuple[float, ...] = ()
    thruster_lag: float = 0.0


def arm_motion(scene: dict[str, Any], periods: int, rng: np.random.Generator) -> Floats:
    """(periods, joints, 4) cubics of joints that move between random positions, at rest in between."""
    simulator = Simulator(scene)
    joints = [link["joint"] for link in scene.get("arm", {}).get("links", [])]
    time = PERIOD * np.arange(periods + 1)
    q = np.empty((periods + 1, simulator.num_joints))
    qd = np.zeros_like(q)
    for k in range(simulator.num_joints):
        limits = joints[k].get("limits") or {}
        low, high = limits.get("lower", -1.5), limits.get("upper", 1.5)
        at, now = float(rng.uniform(low, high)), float(rng.uniform(0.5, 2.0))
        q[:, k] = at
        while now < time[-1]:
            to = float(rng.uniform(low, high))
            length = max(abs(to - at) / 0.4, 1.0)
            s = np.clip((time - now) / length, 0.0, 1.0)
            moving = time >= now
            q[moving, k] = at + (to - at) * (s * s * (3.0 - 2.0 * s))[moving]
            qd[moving, k] = ((to - at) / length * 6.0 * s * (1.0 - s))[moving]
            at, now = to, now + length + float(rng.uniform(0.5, 2.0))
    d = np.diff(q, axis=0) / PERIOD
    return np.stack(
        [q[:-1], qd[:-1], (3.0 * d - 2.0 * qd[:-1] - qd[1:]) / PERIOD, (qd[:-1] + qd[1:] - 2.0 * d) / PERIOD**2],
        axis=-1,
    )


def synthetic_log(
    scene: dict[str, Any],
    name: str,
    duration: float,
    rng: np.random.Generator,
    *,
    sensors: Sensors | None = None,
    driven: bool = False,
    current: float = 0.0,
) -> Log:
    """Log of a simulated trial.

    Parameters
    ----------
    scene : dict
        Complete scene: the truth.
    name : str
        Name of the trial.
    duration : float
        Length, s.
    rng : numpy.random.Generator
        Source of motion and noise.
    sensors : Sensors, optional
        Noise, rates and lags.
    driven : bool
        True: random thruster commands, and a velocity log (twist).
    current : float
        Speed of a horizontal current in a random direction, m/s.
    """
    sensors = sensors or Sensors()
    periods = int(duration / PERIOD)
    cubics = arm_motion(scene, periods, rng)
    joints = cubics.shape[1]
    simulator = Simulator(scene, 1, dt=PERIOD / SUBSTEPS, threads=1, prescribed_joints=joints > 0)
    commands = _commands(simulator, periods, rng) if driven else None
    heading = rng.uniform(-np.pi, np.pi)
    up = equilibrium(scene, cubics[:1, :, 0])[0]
    rpy = np.array([[np.arctan2(up[1], up[2]), -np.arcsin(up[0]), heading]])
    twist = np.concatenate([rng.normal(0.0, 0.01, 3), rng.normal(0.0, 0.005, 3)])
    water = current * np.array([np.cos(heading + 1.0), np.sin(heading + 1.0), 0.0])
    state: dict[str, Any] = {"position": np.zeros(3), "quaternion": rotations.from_rpy(rpy)[0], "twist": twist}
    if joints:
        state |= {"q": cubics[0, :, 0], "qd": cubics[0, :, 1]}
    simulator.set_state(current=water, **state)
    quaternion, velocity, position = np.empty((periods + 1, 4)), np.empty((periods + 1, 6)), np.empty((periods + 1, 3))
    for k in range(periods + 1):
        quaternion[k], velocity[k], position[k] = simulator.quaternion[0], simulator.twist[0], simulator.position[0]
        if k < periods:
            inputs: dict[str, Any] = {"joint_target": cubics[k][None]} if joints else {}
            if commands is not None:
                inputs["thrust"] = commands[k]
            simulator.step(substeps=SUBSTEPS, **inputs)
    return _log(simulator, name, sensors, cubics, commands, (quaternion, velocity, position), rng)


def _commands(simulator: Simulator, periods: int, rng: np.random.Generator) -> Floats:
    """(periods, thrusters) commands: random wrenches, each held for 1 to 3 s."""
    commands = np.empty((periods, simulator.num_thrusters))
    B = simulator.thruster_configuration
    k = 0
    while k < periods:
        wrench = rng.normal(0.0, [12.0, 12.0, 12.0, 1.0, 1.0, 2.0])
        length = int(rng.uniform(1.0, 3.0) / PERIOD)
        commands[k : k + length] = np.clip(np.linalg.pinv(B) @ wrench, *simulator.thruster_limits.T)
        k += length
    return commands


def _log(
    simulator: Simulator,
    name: str,
    sensors: Sensors,
    cubics: Floats,
    commands: Floats | None,
    motion: tuple[Floats, Floats, Floats],
    rng: np.random.Generator,
) -> Log:
    """Log of what sensors tell of a motion."""
    quaternion, velocity, position = motion
    count = len(position)
    time = PERIOD * np.arange(count, dtype=np.float64)
    common: dict[str, Any] = {"source": name, "gap": 0.5, "rows": count, "dropped": {}}
    drift = np.empty((count, 3))
    drift[0], keep = rng.normal(size=3), np.exp(-PERIOD / sensors.drift_time)
    for k in range(1, count):
        drift[k] = keep * drift[k - 1] + np.sqrt(1.0 - keep * keep) * rng.normal(size=3)
    wrong = sensors.attitude_drift * drift + sensors.attitude_noise * rng.normal(size=(count, 3))
    rpy = rotations.to_rpy(quaternion) + np.radians(wrong)
    noisy = rotations.canonical(rotations.from_rpy(rpy))
    gyro = velocity[:, 3:] + sensors.gyro_noise * rng.normal(size=(count, 3))
    channels: dict[str, Any] = {
        "pose": Pose(
            time=time,
            position=position + sensors.position_noise * rng.normal(size=(count, 3)),
            quaternion=noisy,
            **common,
        ),
        "imu": Imu(time=time.copy(), angular_velocity=gyro, quaternion=noisy.copy(), **common),
    }
    if cubics.shape[1]:
        q = np.concatenate([cubics[:, :, 0], cubics[-1:] @ PERIOD ** np.arange(4)])
        # Beyond both ends the joints rest.
        more = 20
        q = np.concatenate([np.repeat(q[:1], more, axis=0), q, np.repeat(q[-1:], more, axis=0)])
        late = sensors.joint_lag + sensors.joint_jitter * rng.normal(size=len(q))
        stamps: Floats = np.sort(PERIOD * (np.arange(len(q), dtype=np.float64) - more) + late)
        zeros = np.array(sensors.joint_zeros) if sensors.joint_zeros else 0.0
        names = tuple(simulator.joint_names)
        channels["joints"] = Joints(time=stamps, position=q + zeros, names=names, **(common | {"rows": len(q)}))
    if commands is not None:
        channels["thrusters"] = Thrusters(
            time=np.append(time[:-1], time[-1]) + sensors.thruster_lag,
            command=np.concatenate([commands, commands[-1:]]),
            names=tuple(simulator.thruster_names),
            **common,
        )
        noise = sensors.velocity_noise * rng.normal(size=(count, 3))
        channels["twist"] = Twist(time=time.copy(), velocity=velocity[:, :3] + noise, **common)
    return Log(name=name, start=float(time[0]), end=float(time[-1]), **channels)
