"""MuJoCo model of a scene, and native rollouts of it.

One MuJoCo body per moving body, rigidly connected bodies merged; no contact, no limit, no constraint. Water is the
ellipsoid fluid model on every body; thrusters and servos are actuators.
"""

import xml.etree.ElementTree as ET
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from uvms_gym._scene import joints
from uvms_gym.export.mjcf import add_body, numbers
from uvms_gym.export.tree import Matter, angles
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.physics import THRUST, TWIST
from uvms_gym.studies.speed.rigid_bodies import joint_order, rigid_bodies
from uvms_gym.studies.speed.timing import Case

VERSION = mujoco.__version__
#: Dynamic viscosity of water, Pa s.
VISCOSITY = 1e-3
#: Disabled features, which cost time without a function here. Energy and sensors are off by default, too.
OFF = ("constraint", "contact", "limit", "equality", "frictionloss", "warmstart", "sensor", "autoreset")
#: Width of a timed finite difference, and of a reference for its error.
DIFFERENCE, WIDE = 1e-6, 1e-3
#: Instances and steps of one rollout.
BATCH, STEPS = 32, 10
STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL)


def build(
    scene: dict[str, Any],
    integrator: str = "RK4",
    step: float = 0.01,
    *,
    water: bool = True,
    weight: str = "none",
    actuators: bool = True,
) -> Any:
    """Make the model.

    `weight` is "none" (no gravity, as for a body that floats), "buoyant" (weight and, as `gravcomp`, buoyancy at the
    centre of mass) or "full" (weight only); `actuators` adds thrusters and servos.
    """
    root = ET.Element("mujoco")
    ET.SubElement(root, "compiler", angle="radian", eulerseq="XYZ")
    density, gravity = scene["water"]["density"], scene["water"]["gravity"]
    option = ET.SubElement(
        root,
        "option",
        integrator=integrator,
        timestep=repr(step),
        gravity=numbers(np.zeros(3) if weight == "none" else gravity),
        density=numbers(density if water else 0.0),
        viscosity=numbers(VISCOSITY if water else 0.0),
    )
    ET.SubElement(option, "flag", dict.fromkeys(OFF, "disable"))
    world, drives, links = ET.SubElement(root, "worldbody"), ET.SubElement(root, "actuator"), rigid_bodies(scene)
    elements: list[ET.Element] = []
    for link in links:
        elements.append(body := add_body(world if link.parent is None else elements[link.parent], link))
        assert link.matter is not None
        if weight == "buoyant":
            body.set("gravcomp", repr(link.matter.buoyancy / (link.matter.mass * float(np.linalg.norm(gravity)))))
        if water:
            _ellipsoid(body, link.matter)
    if actuators:
        ET.SubElement(elements[0], "site", name="vehicle")
        for thruster in scene["vehicle"].get("thrusters", ()):
            axis = np.array(thruster["axis"]) / np.linalg.norm(thruster["axis"])
            gear = np.concatenate([axis, np.cross(thruster["position"], axis)])
            ET.SubElement(drives, "motor", site="vehicle", gear=numbers(gear))
        for link in links:
            if link.joint and (servo := link.joint.get("servo")):
                gains = {"kp": repr(servo["kp"]), "kv": repr(servo["kd"])}
                ET.SubElement(drives, "position", gains, name=f"servo {link.coordinate}", joint=link.name)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def _ellipsoid(body: ET.Element, matter: Matter) -> None:
    """Ellipsoid of the fluid model: the one of uniform density with the body's moments."""
    principal, turn = np.linalg.eigh(matter.inertia)
    turn[:, 0] *= np.linalg.det(turn)
    axes = np.sqrt(np.maximum(2.5 / matter.mass * (principal.sum() - 2.0 * principal), 1e-4))
    place = {"pos": numbers(matter.center_of_mass), "euler": numbers(angles(turn)), "size": numbers(axes)}
    ET.SubElement(body, "geom", place, type="ellipsoid", mass="0", contype="0", conaffinity="0", fluidshape="ellipsoid")


def _order(model: Any) -> list[int]:
    """Indices in joint arrays of the model's joints, without the vehicle's."""
    return joint_order(model.joint(k).name for k in range(1, model.njnt))


def acceleration(model: Any, state: dict[str, Floats], wrench: Floats, torque: Floats) -> Floats:
    """[V'; q''] in body axes, at a state with the names of `Simulator.set_state`.

    MuJoCo's free joint has its linear velocity in world axes: v = R^T v_w, v' = R^T v_w' - omega x v.
    """
    data, turn, twist, order = mujoco.MjData(model), state["rotation"], state["twist"], _order(model)
    data.qpos[:], data.qvel[:] = coordinates(model, state)
    data.qfrc_applied[:] = np.concatenate([turn @ wrench[:3], wrench[3:], torque[order]])
    mujoco.mj_forward(model, data)
    linear = turn.T @ data.qacc[:3] - np.cross(twist[3:], twist[:3])
    return np.concatenate([linear, data.qacc[3:6], data.qacc[6:][np.argsort(order)]])


def coordinates(model: Any, state: dict[str, Floats]) -> tuple[Floats, Floats]:
    """MuJoCo's positions and velocities at a state of one instance."""
    quaternion, order = np.zeros(4), _order(model)
    mujoco.mju_mat2Quat(quaternion, np.ravel(state["rotation"]))
    positions = np.concatenate([state["position"], quaternion, state["q"][order]])
    return positions, np.concatenate([state["rotation"] @ state["twist"][:3], state["twist"][3:], state["qd"][order]])


class Rolling(Case):
    """Native rollouts of a batch on `threads` threads with as many `MjData`; a unit of work is a step of an instance.

    Every rollout continues the one before. Outputs are allocated once. `options` are further arguments of `build`.
    """

    timed = "MuJoCo's timed motion"

    def __init__(
        self,
        scene: dict[str, Any],
        integrator: str = "RK4",
        *,
        n: int = BATCH,
        steps: int = STEPS,
        threads: int = 1,
        seed: int = 0,
        **options: Any,
    ) -> None:
        model = build(scene, integrator, **options)
        rng = np.random.default_rng(seed)
        self.name, self.work, self.steps = scene["name"], n * steps, steps
        self.models, self.data = [model] * n, [mujoco.MjData(model) for _ in range(threads)]
        self.pool = Rollout(nthread=threads if threads > 1 else 0)
        size = mujoco.mj_stateSize(model, STATE)
        self.start, self.states = np.zeros((n, size)), np.zeros((n, steps, size))
        self.sensors = np.zeros((n, steps, model.nsensordata))
        home = np.array([joint.get("home", 0.0) for joint in joints(scene)])
        self.begin(TWIST * rng.normal(size=(n, 6)), home)
        limits = [thruster["limits"] for thruster in scene["vehicle"].get("thrusters", ())]
        low, high = np.array(limits, dtype=float).reshape(-1, 2).T
        self.controls = np.zeros((n, steps, model.nu))
        if model.nu:
            self.command(THRUST * rng.uniform(low, high, (n, len(limits))), home)

    def begin(self, twist: Floats, home: Floats) -> None:
        """Start vehicles at the origin with twists (n, 6), joints at rest at home (joints,)."""
        for row, speed in zip(self.start, twist, strict=True):
            state = {"position": np.zeros(3), "rotation": np.eye(3), "twist": speed, "q": home, "qd": 0.0 * home}
            # Time, positions, velocities.
            found = np.concatenate([np.zeros(1), *coordinates(self.models[0], state)])
            row[: len(found)] = found

    def command(self, thrust: Floats, target: Floats) -> None:
        """Set constant thrusts (n, m) and joint targets (n,) or (n, joints): thrusters come first."""
        model, thrusters = self.models[0], thrust.shape[1]
        driven = [i for i in range(model.nu) if model.actuator(i).name.startswith("servo")]
        others = [i for i in range(model.nu) if i not in driven]
        assert len(others) == thrusters
        self.controls[:, :, others] = thrust[:, None, :]
        order = joint_order(model.actuator(i).name for i in driven)
        self.controls[:, :, driven] = np.broadcast_to(target, (len(self.start), target.shape[-1]))[:, None, order]

    def step(self) -> None:
        """One rollout, from `start`, without checks of its arguments."""
        self.pool.rollout(
            self.models,
            self.data,
            self.start,
            self.controls,
            control_spec=CONTROL,
            skip_checks=True,
            nstep=self.steps,
            state=self.states,
            sensordata=self.sensors,
        )

    def results(self) -> tuple[Floats]:
        """States."""
        return (self.states,)

    def check(self) -> None:
        """Raise ValueError if a state is not finite; else continue from the last one."""
        super().check()
        self.start[:] = self.states[:, -1]


class Transition(Case):
    """Finite differences of a step by state and controls, `mjd_transitionFD`, at a moving state."""

    name, timed = "MuJoCo", "a timed derivative"

    def __init__(self, model: Any, seed: int, *, centred: bool = False) -> None:
        self.work, self.model, self.data, self.centred = 1, model, mujoco.MjData(model), centred
        rng = np.random.default_rng(seed)
        mujoco.mj_integratePos(model, self.data.qpos, rng.uniform(-1.0, 1.0, model.nv), 1.0)
        self.data.qvel[:] = 0.5 * rng.normal(size=model.nv)
        self.data.ctrl[:] = rng.normal(size=model.nu)
        self.A, self.B = np.zeros((2 * model.nv, 2 * model.nv)), np.zeros((2 * model.nv, model.nu))

    def step(self) -> None:
        """One call."""
        self.differences(DIFFERENCE, self.centred)

    def differences(self, width: float, centred: bool) -> Floats:
        """Derivatives (2 nv, 2 nv + nu) by differences of a width."""
        mujoco.mjd_transitionFD(self.model, self.data, width, centred, self.A, self.B, None, None)
        return np.concatenate([self.A, self.B], axis=1)

    def results(self) -> tuple[Floats]:
        """Derivatives by the state."""
        return (self.A,)


def difference_errors(model: Any, seed: int) -> dict[str, float]:
    """Maximum errors of one-sided and centred differences, relative to the maximum derivative of their column.

    The reference is Richardson's extrapolation of two wide centred differences.
    """
    step = Transition(model, seed)
    exact = (4.0 * step.differences(WIDE, True) - step.differences(2.0 * WIDE, True)) / 3.0
    scale = np.abs(exact).max(axis=0)
    return {
        name: float((np.abs(step.differences(DIFFERENCE, centred) - exact) / scale).max())
        for name, centred in (("one-sided", False), ("centred", True))
    }
