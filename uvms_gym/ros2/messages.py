"""Messages of ROS 2 from measurements and commands, and back.

Frames of this package are those of REP 103: world ENU with z up, body x forward, y left, z up; SI units. Quaternions
are [x, y, z, w] in messages and [w, x, y, z] here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uvms_gym import _rotations
from uvms_gym._extras import extra
from uvms_gym.ros2.instruments import Floats
from uvms_gym.ros2.vehicle import Measurement

with extra("ros2-node"):
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import TransformStamped, TwistWithCovarianceStamped, WrenchStamped
    from nav_msgs.msg import Odometry
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import FluidPressure, Imu, JointState
    from std_msgs.msg import Header

#: Frames of world and vehicle.
WORLD, BODY = "odom", "base_link"
#: Topics of sensors by their message types.
SENSORS = {
    "odom": Odometry,
    "joint_states": JointState,
    "imu": Imu,
    "pressure": FluidPressure,
    "dvl": TwistWithCovarianceStamped,
    "/clock": Clock,
}
#: Topics of commands by their message types.
COMMANDS = {"thrusts": JointState, "wrench": WrenchStamped, "joint_targets": JointState}
if find_spec("tf2_msgs") is not None:
    from tf2_msgs.msg import TFMessage

    SENSORS["/tf"] = TFMessage


def stamp_of(time: float) -> Any:
    """Stamp of a time, s."""
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    return Time(sec=seconds, nanosec=nanoseconds)


def time_of(stamp: Any) -> float:
    """Time of a stamp, s."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def sensor_messages(m: Measurement, deviations: Mapping[str, float], joints: Sequence[str]) -> dict[str, Any]:
    """Messages by topic, of the instruments those that have arrived; `deviations` are of the pose's noise.

    Covariances are variances of the noise; 0 without noise or where it is unknown.
    """
    stamp = stamp_of(m.time)
    pose = _blocks(deviations, "position", "attitude")
    odom = Odometry(header=Header(stamp=stamp, frame_id=WORLD), child_frame_id=BODY)
    _set(odom.pose.pose.position, m.position)
    _set_quaternion(odom.pose.pose.orientation, m.quaternion)
    odom.pose.covariance = pose.ravel()
    _set(odom.twist.twist.linear, m.twist[:3])
    _set(odom.twist.twist.angular, m.twist[3:])
    odom.twist.covariance = _blocks(deviations, "linear_velocity", "angular_velocity").ravel()
    made: dict[str, Any] = {
        "odom": odom,
        "joint_states": joint_message(stamp, joints, position=m.q, velocity=m.qd),
        "/clock": Clock(clock=stamp),
    }
    if "/tf" in SENSORS:
        moved = TransformStamped(header=odom.header, child_frame_id=BODY)
        _set(moved.transform.translation, m.position)
        _set_quaternion(moved.transform.rotation, m.quaternion)
        made["/tf"] = TFMessage(transforms=[moved])
    for name, reading in m.readings.items():
        header = Header(stamp=stamp_of(reading.time), frame_id=f"{name}_link" if reading.mounted else BODY)
        values, covariance = reading.values, reading.covariance
        if name == "imu":
            imu = Imu(header=header)
            turn = _rotations.from_rpy(reading.rpy[None])[0]
            _set_quaternion(imu.orientation, _rotations.multiply(m.quaternion, turn))
            _set(imu.angular_velocity, values["angular_velocity"])
            _set(imu.linear_acceleration, values["specific_force"])
            imu.orientation_covariance = pose[3:, 3:].ravel()
            imu.angular_velocity_covariance = covariance["angular_velocity"].ravel()
            imu.linear_acceleration_covariance = covariance["specific_force"].ravel()
            made["imu"] = imu
        elif name == "dvl":
            dvl = TwistWithCovarianceStamped(header=header)
            _set(dvl.twist.twist.linear, values["velocity"])
            # A DVL measures no rates: their variance is infinite.
            variances = np.diag([0.0, 0.0, 0.0, np.inf, np.inf, np.inf])
            variances[:3, :3] = covariance["velocity"]
            dvl.twist.covariance = variances.ravel()
            made["dvl"] = dvl
        else:
            pressure, variance = float(values["pressure"][0]), float(covariance["pressure"][0, 0])
            made["pressure"] = FluidPressure(header=header, fluid_pressure=pressure, variance=variance)
    return made


def pose_and_twist(odom: Any) -> tuple[Floats, Floats, Floats]:
    """Position (3,), quaternion (4,) [w, x, y, z] and twist (6,), body axes, of an Odometry.

    Raises
    ------
    ValueError
        A number is not finite, or the quaternion's norm is not 1.
    """
    pose, twist = odom.pose.pose, odom.twist.twist
    quaternion = np.array([pose.orientation.w, *_get(pose.orientation)])
    values = _get(pose.position), quaternion, np.concatenate([_get(twist.linear), _get(twist.angular)])
    if not all(np.isfinite(value).all() for value in values):
        raise ValueError("odom has numbers that are not finite")
    if abs(norm := float(np.linalg.norm(quaternion)) - 1.0) > 1e-3:
        raise ValueError(f"the quaternion of odom has the norm {1.0 + norm:.4g}, but must have 1")
    return values


def by_name(topic: str, message: Any, names: Sequence[str], field: str) -> Floats:
    """Numbers (n,) of a JointState in the order of `names`; without names in the message in its own order.

    Raises
    ------
    ValueError
        A name is missing, or there are other counts of numbers than of names.
    """
    given, values = list(message.name), np.asarray(getattr(message, field), dtype=np.float64)
    if len(values) != len(given or names):
        raise ValueError(f"{topic} has {len(values)} numbers in {field} for {len(given or names)} names")
    if missing := [name for name in names if given and name not in given]:
        raise ValueError(f"{topic} lacks {', '.join(missing)}; it has {', '.join(given)}")
    return values[[given.index(name) for name in names]] if given else values


def wrench_of(message: Any) -> Floats:
    """Wrench (6,), N and N m, body axes, of a WrenchStamped."""
    return np.concatenate([_get(message.wrench.force), _get(message.wrench.torque)])


def wrench_message(stamp: Any, wrench: Floats) -> Any:
    """WrenchStamped of a wrench (6,), N and N m, body axes."""
    message = WrenchStamped()
    message.header.stamp, message.header.frame_id = stamp, BODY
    _set(message.wrench.force, wrench[:3])
    _set(message.wrench.torque, wrench[3:])
    return message


def joint_message(stamp: Any, names: Sequence[str], **fields: ArrayLike) -> Any:
    """JointState with position, velocity or effort (n,) by name."""
    message = JointState(name=list(names), **{field: np.asarray(value).tolist() for field, value in fields.items()})
    message.header.stamp = stamp
    return message


def _blocks(deviations: Mapping[str, float], *names: str) -> Floats:
    """Covariance (6, 6) of two independent, isotropic vectors."""
    return np.diag(np.repeat([float(deviations.get(name, 0.0)) ** 2 for name in names], 3))


def _set(message: Any, values: Floats) -> None:
    message.x, message.y, message.z = map(float, values)


def _set_quaternion(message: Any, q: Floats) -> None:
    message.w = float(q[0])
    _set(message, q[1:])


def _get(message: Any) -> Floats:
    return np.array([message.x, message.y, message.z])
