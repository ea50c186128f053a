"""Synthetic logs: a scene simulated, with the noise, rates and lags of real recordings."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvms_gym import Log, Simulator, load_scene
from uvms_gym import _rotations as rotations
from uvms_gym._scene import joints
from uvms_gym.identification.parameters import Parameter, apply
from uvms_gym.identification.replay import equilibrium
from uvms_gym.logs import Imu, Joints, Pose, Thrusters, Twist
from uvms_gym.logs.interpolation import hermite

Floats = NDArray[np.float64]

#: Interval of the simulated samples, s.
PERIOD = 0.05
#: Physics steps in it.
SUBSTEPS = 2


class Sensors(NamedTuple):
    """Noise and lags; the defaults describe the pool data set."""

    #: White noise of roll, pitch and yaw, and standard deviation of an error that changes slowly, deg.
    attitude_noise: float = 0.03
    attitude_drift: float = 0.2
    #: Time over which that error is correlated, s.
    drift_time: float = 5.0
    #: White noise of angular velocity, rad/s, of position, m, and of velocity, m/s.
    gyro_noise: float = 0.0012
    position_noise: float = 0.002
    velocity_noise: float = 0.005
    #: Lateness of the stamps of joint states, s, and its deviation from sample to sample.
    joint_lag: float = 0.23
    joint_jitter: float = 0.02
    #: Zeros of the joints that the log does not correct, rad or m; empty: none.
    joint_zeros: tuple[float, ...] = ()
    #: Lateness of the stamps of commands, s.
    thruster_lag: float = 0.0


def draw_truth(
    scene: dict[str, Any], parameters: Sequence[Parameter], spread: Floats, rng: np.random.Generator
) -> tuple[dict[str, Any], Sensors, Floats]:
    """Scene and sensors that differ from a scene by random amounts, and the true coordinates (p,) of its parameters.

    `spread` (p,) are the standard deviations of the differences.
    """
    simulator = Simulator(scene)
    x = np.array([p.origin for p in parameters]) + spread * rng.normal(size=len(parameters))
    truth, corrections = apply(scene, parameters, x, simulator.joint_names, simulator.thruster_names)
    zeros = tuple(np.asarray(corrections.zeros).tolist())
    lags = {f"{channel[:-1]}_lag": corrections.lags.get(channel, 0.0) for channel in ("joints", "thrusters")}
    return load_scene(truth | {"provenance": {}}), Sensors(**lags, joint_zeros=zeros), x


def arm_motion(scene: dict[str, Any], periods: int, rng: np.random.Generator) -> Floats:
    """(periods, joints, 4) cubics of joints that move between random positions, at rest in between."""
    simulator, tables = Simulator(scene), joints(scene)
    time = PERIOD * np.arange(periods + 1)
    q = np.empty((periods + 1, simulator.num_joints))
    qd = np.zeros_like(q)
    for k in range(simulator.num_joints):
        limits = tables[k].get("limits") or {}
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
    return hermite((q[:-1], qd[:-1]), (q[1:], qd[1:]), PERIOD)


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

    `scene` is the truth; `duration` is in s; `driven` adds random thruster commands and a velocity log (twist);
    `current` is the speed, m/s, of a horizontal current in a random direction.
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
    """(periods, thrusters) commands: random wrenches, each constant for 1 to 3 s."""
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
