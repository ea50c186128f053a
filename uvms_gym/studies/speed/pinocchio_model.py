"""Pinocchio model of a scene's rigid bodies, and batches of its forward dynamics in C++."""

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.rigid_bodies import joint_order, rigid_bodies
from uvms_gym.studies.speed.timing import Case

VERSION = pin.__version__
#: States of one call.
BATCH = 256
#: Forward dynamics of a fourth-order step.
STAGES = 4


def build(scene: dict[str, Any]) -> Any:
    """Make the model: a free-flyer, and joints about or along z, Pinocchio's fastest kind."""
    vehicle, *links = rigid_bodies(scene)
    model = pin.Model()
    model.gravity = pin.Motion(np.array(scene["water"]["gravity"]), np.zeros(3))
    index = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), vehicle.name)
    model.appendBodyToJoint(index, _inertia(vehicle), pin.SE3.Identity())
    turns = [np.eye(4)]
    for link in links:
        # The body's frame is rotated so that the joint's axis is z, and back for the bodies that it carries.
        turn = np.eye(4)
        turn[:3, :3] = np.linalg.qr(np.column_stack([link.axis, np.eye(3)]))[0][:, [1, 2, 0]]
        turn[:3, 2] = link.axis
        turn[:3, 0] *= np.linalg.det(turn)
        kind = pin.JointModelPZ() if link.prismatic else pin.JointModelRZ()
        # The universe is Pinocchio's joint 0.
        carrier = link.parent or 0
        place = _se3(np.linalg.inv(turns[carrier]) @ link.frame.matrix @ turn)
        index = model.addJoint(carrier + 1, kind, place, link.name)
        model.appendBodyToJoint(index, _inertia(link), _se3(np.linalg.inv(turn)))
        turns.append(turn)
    model.armature = np.array([0.0] * 6 + [float((link.joint or {}).get("rotor_inertia", 0.0)) for link in links])
    return model


def _se3(transform: NDArray[Any]) -> Any:
    return pin.SE3(transform[:3, :3], transform[:3, 3])


def _inertia(link: Any) -> Any:
    return pin.Inertia(link.matter.mass, link.matter.center_of_mass, link.matter.inertia)


def acceleration(model: Any, state: dict[str, Floats], wrench: Floats, torque: Floats) -> Floats:
    """[V'; q''] at a state with the names of `Simulator.set_state`; Pinocchio's free-flyer has the body twist, too."""
    place, order = pin.SE3ToXYZQUAT(pin.SE3(state["rotation"], state["position"])), joint_order(model.names[2:])
    q, v = np.concatenate([place, state["q"][order]]), np.concatenate([state["twist"], state["qd"][order]])
    found = pin.aba(model, model.createData(), q, v, np.concatenate([wrench, torque[order]]))
    return np.concatenate([found[:6], found[6:][np.argsort(order)]])


class Dynamics(Case):
    """Articulated-body dynamics of a batch of states on one thread; a unit of work is `STAGES` states.

    `abaInParallel` loops in C++: a batch costs one call from Python, which needs no correction.
    """

    timed = "a timed acceleration by Pinocchio"

    def __init__(self, scene: dict[str, Any], seed: int) -> None:
        if not hasattr(pin, "abaInParallel"):
            raise ImportError(f"Pinocchio {VERSION} lacks abaInParallel; run: pip install 'pin>=4.1'")
        model = build(scene)
        rng = np.random.default_rng(seed)
        self.name, self.pool = scene["name"], pin.ModelPool(model, 1)
        places = [pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)) for _ in range(BATCH)]
        # Columns, as Eigen has them: nothing is copied.
        self.q = np.asfortranarray(np.transpose(places))
        self.v, self.tau, self.found = (np.asfortranarray(rng.normal(size=(model.nv, BATCH))) for _ in range(3))
        self.work = BATCH / STAGES

    def step(self) -> None:
        """One call."""
        pin.abaInParallel(1, self.pool, self.q, self.v, self.tau, self.found)

    def results(self) -> tuple[Floats]:
        """Accelerations."""
        return (self.found,)


class Single(Case):
    """Function of model, configuration, velocity and force, by one call from Python for each state."""

    timed = "a timed result by Pinocchio"

    def __init__(self, scene: dict[str, Any], function: str, seed: int) -> None:
        self.name, self.work, self.call, self.model = scene["name"], 1, getattr(pin, function), build(scene)
        rng, model = np.random.default_rng(seed), self.model
        self.data, self.q = model.createData(), pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
        self.v, self.tau = (rng.normal(size=model.nv) for _ in range(2))

    def step(self) -> None:
        """One call."""
        self.call(self.model, self.data, self.q, self.v, self.tau)

    def results(self) -> tuple[Floats]:
        """Accelerations."""
        return (self.data.ddq,)
