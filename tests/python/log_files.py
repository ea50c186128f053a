"""Logs of known motions, written as tables and bags in chosen conventions."""

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uvms_gym
from uvms_gym import _rotations as rotations

JOINTS = ("shoulder", "upper-arm", "elbow", "wrist")
THRUSTERS = ("left", "right")
LENGTH = {"m": 1.0, "cm": 0.01, "mm": 0.001}
ANGLE = {"rad": 1.0, "deg": np.pi / 180.0}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ACCELERATION = {"m/s2": 1.0, "mm/s2": 1e-3, "g": 9.80665}
#: Rows: axes of the logs in the library's world and body axes.
WORLD = {
    "nwu": np.eye(3),
    "enu": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "ned": np.diag([1.0, -1.0, -1.0]),
}
BODY = {"flu": np.eye(3), "frd": np.diag([1.0, -1.0, -1.0])}


@dataclass(frozen=True)
class Motion:
    """Motion of a vehicle with four joints and two thrusters, at stamps (n,); SI units, z up."""

    time: np.ndarray
    position: np.ndarray
    rotation: Rotation
    velocity: np.ndarray
    angular_velocity: np.ndarray
    specific_force: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    command: np.ndarray

    @classmethod
    def random(cls, n: int = 30, seed: int = 0, start: float = 2.0) -> "Motion":
        rng = np.random.default_rng(seed)
        time = start + np.cumsum(rng.uniform(0.02, 0.06, n))
        vectors = [np.cumsum(rng.normal(size=(n, 3)), axis=0) for _ in range(4)]
        turn = np.cumsum(0.05 * rng.normal(size=(n, 3)), axis=0)
        q, qd = (np.cumsum(0.1 * rng.normal(size=(n, 4)), axis=0) for _ in range(2))
        return cls(time, vectors[0], Rotation.from_rotvec(turn), *vectors[1:], q, qd, 20.0 * rng.normal(size=(n, 2)))


@dataclass(frozen=True)
class Convention:
    """Units, axes and orders of a log."""

    time: str = "s"
    length: str = "m"
    angle: str = "rad"
    acceleration: str = "m/s2"
    world: str = "nwu"
    body: str = "flu"
    order: str = "wxyz"
    delimiter: str = ","
    lag: float = 0.0
    sign: int = 1
    zero: float = 0.0
    scale: float = 1.0
    neutral: float = 0.0
    shuffle: int = 0


def write_table(path: Path, columns: dict[str, np.ndarray], delimiter: str = ",", shuffle: int = 0) -> None:
    """Write columns, in an order drawn at random and with one that holds no numbers."""
    columns = {**{name: [repr(float(x)) for x in column] for name, column in columns.items()}}
    columns["frame"] = ["world"] * len(next(iter(columns.values())))
    names = list(np.random.default_rng(shuffle).permutation(list(columns))) if shuffle else list(columns)
    lines = [delimiter.join(names), *(delimiter.join(cells) for cells in zip(*(columns[name] for name in names)))]
    path.write_text("\n".join(lines) + "\n")


def write_logs(folder: Path, motion: Motion, c: Convention = Convention(), trial: str = "1") -> dict[str, Any]:
    """Write all channels of a motion in a convention, and return the map that reads them."""
    W, B = WORLD[c.world], BODY[c.body]
    rotation = Rotation.from_matrix(W @ motion.rotation.as_matrix() @ B.T)
    if c.order == "rpy":
        names, turned = ("roll", "pitch", "yaw"), rotation.as_euler("ZYX")[:, ::-1] / ANGLE[c.angle]
        attitude = {"rpy": {"columns": list(names), "unit": c.angle}}
    else:
        names, xyzw = tuple("q" + letter for letter in c.order), rotation.as_quat()
        turned = xyzw if c.order == "xyzw" else xyzw[:, [3, 0, 1, 2]]
        attitude = {"quaternion": {"columns": list(names), "order": c.order}}
    stamps = {"t": (motion.time + c.lag) / TIME[c.time]}
    orientation = dict(zip(names, turned.T))
    position = dict(zip("xyz", (motion.position @ W.T / LENGTH[c.length]).T))
    velocity = dict(zip(("vx", "vy", "vz"), (motion.velocity @ B.T / LENGTH[c.length]).T))
    gyro = dict(zip(("wx", "wy", "wz"), (motion.angular_velocity @ B.T / ANGLE[c.angle]).T))
    force = dict(zip(("fx", "fy", "fz"), (motion.specific_force @ B.T / ACCELERATION[c.acceleration]).T))
    unit = ANGLE[c.angle]
    joints = {f"{name}.pos": c.sign * (motion.q[:, k] / unit + c.zero) for k, name in enumerate(JOINTS)}
    joints |= {f"{name}.vel": c.sign * motion.qd[:, k] / unit for k, name in enumerate(JOINTS)}
    commands = {name: motion.command[:, k] / c.scale + c.neutral for k, name in enumerate(THRUSTERS)}
    tables = {
        "pose": position | orientation,
        "attitude": orientation,
        "twist": velocity | gyro,
        "imu": gyro | force | orientation,
        "joints": joints,
        "thrusters": commands,
    }
    for name, columns in tables.items():
        write_table(folder / f"{trial}_{name}.csv", stamps | columns, c.delimiter, c.shuffle)
    common: dict[str, Any] = {"time": {"column": "t", "unit": c.time, "lag": c.lag}, "delimiter": c.delimiter}
    turning = {"angular_velocity": {"columns": list(gyro), "unit": f"{c.angle}/s"}}
    axes = {"world": c.world, "body": c.body}
    axis = {"sign": c.sign, "zero": c.zero, "unit": c.angle}
    channels: dict[str, Any] = {
        "pose": {"position": {"columns": list("xyz"), "unit": c.length}, **attitude, **axes},
        "attitude": {**attitude, **axes},
        "twist": {"velocity": {"columns": list(velocity), "unit": f"{c.length}/s"}, **turning, "body": c.body},
        "imu": {"specific_force": {"columns": list(force), "unit": c.acceleration}, **turning, **attitude, **axes},
        "joints": {"axes": {n: {"position": f"{n}.pos", "velocity": f"{n}.vel", **axis} for n in JOINTS}},
        "thrusters": {"axes": {n: {"command": n, "scale": c.scale, "neutral": c.neutral} for n in THRUSTERS}},
    }
    return {name: deepcopy({"file": f"{{trial}}_{name}.csv", **common, **keys}) for name, keys in channels.items()}


def write_bag(path: Path, motion: Motion, storage: str = "sqlite3", late: float = 0.1) -> dict[str, Any]:
    """Write a motion as a ROS 2 bag, recorded late, and return the map that reads it; thrusters have no header."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name.rpartition("/")[2]: name for name in store.types}
    topics = {
        **{"/pose": "PoseStamped", "/pose_cov": "PoseWithCovarianceStamped", "/odometry": "Odometry"},
        **{"/imu": "Imu", "/joint_states": "JointState", "/thrusters": "Float64MultiArray"},
    }

    def make(kind: str, *values: Any) -> Any:
        return store.types[kinds[kind]](*values)

    def three(x: np.ndarray, kind: str = "Vector3") -> Any:
        return make(kind, *map(float, x))

    cov, none, order = np.zeros(36), np.zeros(9), [2, 0, 3, 1]
    names = [JOINTS[i] for i in order]
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as bag:
        connections = {topic: bag.add_connection(topic, kinds[kind], typestore=store) for topic, kind in topics.items()}
        for k, t in enumerate(motion.time):
            ns = round(t * 1e9)
            header = make("Header", make("Time", ns // 10**9, ns % 10**9), "world")
            quaternion = make("Quaternion", *map(float, motion.rotation[k].as_quat()))
            pose = make("Pose", three(motion.position[k], "Point"), quaternion)
            with_cov = make("PoseWithCovariance", pose, cov)
            rate = three(motion.angular_velocity[k])
            twist = make("TwistWithCovariance", make("Twist", three(motion.velocity[k]), rate), cov)
            messages = {
                "/pose": (header, pose),
                "/pose_cov": (header, with_cov),
                "/odometry": (header, "base", with_cov, twist),
                "/imu": (header, quaternion, none, rate, none, three(motion.specific_force[k]), none),
                "/joint_states": (header, names, motion.q[k][order], motion.qd[k][order], np.zeros(0)),
                "/thrusters": (make("MultiArrayLayout", [], 0), motion.command[k]),
            }
            for topic, values in messages.items():
                data = store.serialize_cdr(make(topics[topic], *values), kinds[topics[topic]])
                bag.write(connections[topic], ns + round(late * 1e9), data)
    return {
        "pose": {"topic": "/pose"},
        "attitude": {"topic": "/pose_cov"},
        "twist": {"topic": "/odometry", "angular_velocity": {}},
        "imu": {"topic": "/imu", "specific_force": {}, "quaternion": {}},
        "joints": {
            "topic": "/joint_states",
            "axes": {n: {"position": f"position[{n}]", "velocity": f"velocity[{n}]"} for n in JOINTS},
        },
        "thrusters": {
            "topic": "/thrusters",
            "time": {"lag": late},
            "axes": {n: {"command": f"data[{k}]"} for k, n in enumerate(THRUSTERS)},
        },
    }


def write_zeros(path: Path, message: str) -> None:
    """Write a bag of two messages, recorded and stamped at 1 and 2 s, whose numbers are 0 and whose attitudes are 1."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = next(name for name in store.types if name.endswith(f"/msg/{message}"))

    def zeros(kind: str, second: int) -> Any:
        values: list[Any] = []
        for name, (node, detail) in store.fielddefs[kind][1]:
            if node.name == "NAME":
                values.append(zeros(detail, second))
            elif node.name == "ARRAY":
                values.append(np.zeros(detail[1]))
            else:
                values.append("" if detail[0] == "string" else second * (name == "sec") + (name == "w"))
        return store.types[kind](*values)

    with Writer(path, version=9) as bag:
        connection = bag.add_connection("/topic", kind, typestore=store)
        for second in (1, 2):
            bag.write(connection, second * 10**9, store.serialize_cdr(zeros(kind, second), kind))


MARINARIUM = Path(__file__).parents[1] / "data" / "marinarium"
MARINARIUM_PARTS = ("rosbag2_2025_11_06-manual", "rosbag2_2025_11_06-stabilized")
#: Outputs u1 to u8 by the scene's thruster that each drives, and the sign of its thrust.
MARINARIUM_SIGNS = {"front-right": 1, "front-left": 1, "rear-right": 1, "rear-left": 1}
MARINARIUM_SIGNS |= {
    "vertical-front-right": 1,
    "vertical-front-left": -1,
    "vertical-rear-right": -1,
    "vertical-rear-left": 1,
}


def write_marinarium(folder: Path, seconds: float = 9.0) -> list[np.ndarray]:
    """Write both parts as the set has them, and return their thrusts (n, 8)."""
    table = np.loadtxt(MARINARIUM / "t200-16v.csv", delimiter=",", skiprows=2)
    rng, thrusts = np.random.default_rng(0), []
    for part in MARINARIUM_PARTS:
        simulator = uvms_gym.Simulator("bluerov2-heavy", dt=0.01)
        assert simulator.thruster_names == list(MARINARIUM_SIGNS)
        rows, applied = [], []
        u = np.zeros(8)
        for k in range(round(50 * seconds)):
            if k % 25 == 0:
                u = rng.uniform(-0.45, 0.45, 8)
            rpy, nu = rotations.to_rpy(simulator.quaternion)[0], simulator.twist[0]
            rows.append([0.02 * k, *simulator.position[0], *rpy, *nu, *u])
            applied.append([sign * np.interp(x, *table.T) for sign, x in zip(MARINARIUM_SIGNS.values(), u)])
            simulator.step(thrust=np.array([applied[-1]]), substeps=2)
        names = "t,x,y,z,phi,theta,psi,u,v,w,p,q,r,u1,u2,u3,u4,u5,u6,u7,u8"
        (folder / part).mkdir(parents=True)
        np.savetxt(folder / part / "koopman_dataset_50Hz.csv", rows, "%.9g", ",", header=names, comments="")
        thrusts.append(np.array(applied))
    return thrusts
