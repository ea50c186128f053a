"""Recordings of simulated vehicles in ROS 2 messages: MCAP."""

from __future__ import annotations

import os
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from uvms_gym import _rotations as rotations
from uvms_gym._core import Simulator
from uvms_gym._extras import extra
from uvms_gym._files import replacing

#: Topics and their types.
TOPICS = {
    "/odom": "nav_msgs/msg/Odometry",
    "/joint_states": "sensor_msgs/msg/JointState",
    "/thruster_commands": "std_msgs/msg/Float64MultiArray",
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/tf": "tf2_msgs/msg/TFMessage",
}
#: Frames of the world and of the vehicle.
WORLD, VEHICLE = "world", "base_link"


class Recorder:
    """Writer of an MCAP file, as a context; Foxglove, PlotJuggler, Rerun, `ros2 bag` and `uvms_gym.Log` read it.

    The axes are those of ROS and of the library: world z up; body x forward, y left, z up.

    Parameters
    ----------
    path : str or os.PathLike
        File to write, with the extra `ros2`. It appears when the context ends; with an error it does not.

    Raises
    ------
    ModuleNotFoundError
        The extra `ros2` is not installed.
    OSError
        The file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        with extra("ros2"):
            from mcap.writer import Writer
            from rosbags.typesys import Stores, get_typestore
        self._path, self._stack = path, ExitStack()
        self._new: Any = Writer
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._types = {name.rpartition("/")[2]: made for name, made in self._store.types.items()}

    def __enter__(self) -> Self:
        self._writer = self._new(self._stack.enter_context(replacing(self._path)))
        self._writer.start(profile="ros2", library="uvms_gym")
        self._channels = {}
        for topic, kind in TOPICS.items():
            text, _ = self._store.generate_msgdef(kind, ros_version=2)
            schema = self._writer.register_schema(kind, "ros2msg", text.encode())
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self._writer.finish()
        self._stack.__exit__(kind, error, trace)

    def add(
        self, simulator: Simulator, time: float | None = None, *, forces: ArrayLike | None = None, instance: int = 0
    ) -> None:
        """Write the present state of an instance.

        Parameters
        ----------
        simulator : Simulator
            As of `env.snapshot()`.
        time : float, optional
            Stamp, s, >= 0; default: the simulator's.
        forces : array_like (m,) or (m + n,), optional
            Thrusts, N, from now on, then torques of the joints, N m or N; without them neither commands nor wrench are
            written.
        instance : int
            Row of the simulator.

        Raises
        ------
        ValueError
            `forces` has another length.
        """
        seconds = float(np.ravel(simulator.time)[0]) if time is None else float(time)
        ns = round(seconds * 1e9)
        header = self._header(ns, WORLD)
        q, position = rotations.canonical(simulator.quaternion)[instance], simulator.position[instance]
        twist = self._make("Twist", *(self._vector(part) for part in np.split(simulator.twist[instance], 2)))
        pose, none = self._make("Pose", self._vector(position, "Point"), self._turn(q)), np.zeros(36)
        odometry = (header, VEHICLE, self._make("PoseWithCovariance", pose, none))
        self._write("/odom", ns, *odometry, self._make("TwistWithCovariance", twist, none))
        given = np.zeros(0) if forces is None else np.asarray(forces, dtype=np.float64)
        thrusters, joints = simulator.num_thrusters, list(simulator.joint_names)
        if forces is not None and given.shape not in ((thrusters,), (thrusters + len(joints),)):
            allowed = f"({thrusters},) or ({thrusters + len(joints)},)"
            raise ValueError(f"forces has shape {given.shape}, but must have {allowed}")
        if joints:
            q_qd = (np.array(row[instance], dtype=np.float64) for row in (simulator.q, simulator.qd))
            self._write("/joint_states", ns, header, joints, *q_qd, given[thrusters:])
        if forces is not None:
            thrust = given[:thrusters].copy()
            layout = self._make("MultiArrayDimension", ",".join(simulator.thruster_names), thrusters, thrusters)
            self._write("/thruster_commands", ns, self._make("MultiArrayLayout", [layout], 0), thrust)
            wrench = np.split(simulator.thruster_configuration @ thrust, 2)
            parts = self._make("Wrench", *(self._vector(part) for part in wrench))
            self._write("/wrench", ns, self._header(ns, VEHICLE), parts)
        self._write("/tf", ns, self._transforms(simulator.body_poses()[instance], ns, joints))

    def _transforms(self, poses: Any, ns: int, joints: list[str]) -> list[Any]:
        """Vehicle in the world, and every link in the vehicle."""
        links = np.linalg.inv(poses[0]) @ poses[1:]
        made = []
        for pose, parent, child in zip(
            [poses[0], *links], [WORLD, *[VEHICLE] * len(links)], [VEHICLE, *(f"{name}_link" for name in joints)]
        ):
            turn = self._turn(rotations.from_rpy(rotations.rpy_of(pose[None, :3, :3]))[0])
            transform = self._make("Transform", self._vector(pose[:3, 3]), turn)
            made.append(self._make("TransformStamped", self._header(ns, parent), child, transform))
        return made

    def _make(self, name: str, *values: Any) -> Any:
        return self._types[name](*values)

    def _header(self, ns: int, frame: str) -> Any:
        return self._make("Header", self._make("Time", ns // 10**9, ns % 10**9), frame)

    def _vector(self, values: Any, name: str = "Vector3") -> Any:
        return self._make(name, *map(float, values))

    def _turn(self, q: Any) -> Any:
        return self._make("Quaternion", *map(float, (q[1], q[2], q[3], q[0])))

    def _write(self, topic: str, ns: int, *values: Any) -> None:
        kind = TOPICS[topic]
        data = bytes(self._store.serialize_cdr(self._store.types[kind](*values), kind))
        self._writer.add_message(self._channels[topic], ns, data, ns)
