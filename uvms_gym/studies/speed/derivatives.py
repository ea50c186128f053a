"""Derivatives beside MuJoCo's and Pinocchio's: of a step, and of accelerations, on one thread."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.physics import DT, start
from uvms_gym.studies.speed.rigid_bodies import dry
from uvms_gym.studies.speed.timing import Case, interleave, summary

#: Steps of a call of ours, where it is not one.
STEPS = 10
OURS, ABA = "ours, MK4", "Pinocchio, computeABADerivatives"
#: Cases by name: what is differentiated, and water.
CASES: dict[str, tuple[str, str]] = {
    OURS: ("step", "all"),
    f"ours, MK4, {STEPS} a call": ("step", "all"),
    "ours, Euler": ("step", "all"),
    f"ours, Euler, {STEPS} a call": ("step", "all"),
    "MuJoCo Euler, mjd_transitionFD": ("step", "ellipsoids"),
    "MuJoCo Euler, mjd_transitionFD, centred": ("step", "ellipsoids"),
    "ours, Euler, dry": ("step", "none"),
    f"ours, Euler, dry, {STEPS} a call": ("step", "none"),
    "MuJoCo Euler, mjd_transitionFD, dry": ("step", "none"),
    ABA: ("acceleration", "none"),
}

#: Scope of the derivatives, for reports.
SCOPE = """\
Derivatives of a step differentiate the state after it by the state before and by thrusts (dry: a wrench) and joint \
torques; MuJoCo's by thrusts and joint targets. Euler is semi-implicit. Ours are exact to rounding, MuJoCo's finite \
differences. computeABADerivatives gives the exact derivatives of accelerations only, by configuration, velocity and \
force: a step of fourth order needs four, and the products between them, which are not timed."""


class Jacobians(Case):
    """Derivatives of the steps of a moving instance by one call from Python; a unit of work is one step."""

    timed = "a timed derivative"

    def __init__(self, scene: dict[str, Any], integrator: str, steps: int, seed: int) -> None:
        self.name, self.work = scene["name"], steps
        self.simulator = Simulator(scene, dt=DT, integrator=integrator, threads=1, error_estimate=False)
        self.inputs: dict[str, Any] = start(self.simulator, np.random.default_rng(seed)) | {"substeps": steps}
        self.inputs.pop("joint_target", None)
        self.inputs["joint_torque"] = np.zeros(self.simulator.num_joints)
        if not scene["water"]["density"]:
            self.inputs["wrench"] = np.zeros(6)
            self.inputs.pop("thrust", None)

    def step(self) -> None:
        """One call."""
        self.found = self.simulator.step_jacobians(**self.inputs)

    def results(self) -> Iterable[Floats]:
        """Derivatives."""
        return self.found.values()


def study(scene: dict[str, Any], repeats: int, seed: int) -> dict[str, Any]:
    """Time derivatives at a moving state, interleaved.

    Returns
    -------
    dict
        `seconds` of CPU time per state (a summary) and `ratios` to ours, round by round, by the names of `CASES`;
        `call`: seconds of Python and conversion in a call of Pinocchio, which are subtracted; `errors` of MuJoCo's
        finite differences, one-sided and centred.
    """
    from uvms_gym.studies.speed import mujoco_model, pinocchio_model

    vacuum, euler = dry(scene), "semi-implicit-euler"
    wet, still = (mujoco_model.build(scene, "Euler", DT, water=water) for water in (True, False))
    timed = (
        Jacobians(scene, "mk4", 1, seed),
        Jacobians(scene, "mk4", STEPS, seed),
        Jacobians(scene, euler, 1, seed),
        Jacobians(scene, euler, STEPS, seed),
        mujoco_model.Transition(wet, seed),
        mujoco_model.Transition(wet, seed, centred=True),
        Jacobians(vacuum, euler, 1, seed),
        Jacobians(vacuum, euler, STEPS, seed),
        mujoco_model.Transition(still, seed),
        pinocchio_model.Single(scene, "computeABADerivatives", seed),
    )
    cases: dict[str, Any] = dict(zip(CASES, timed, strict=True))
    cases |= {"aba": pinocchio_model.Single(scene, "aba", seed), "batch": pinocchio_model.Dynamics(scene, seed)}
    seconds = {name: times.cpu for name, times in interleave(cases, repeats).items()}
    call = seconds.pop("aba") - seconds.pop("batch") / pinocchio_model.STAGES
    seconds[ABA] = seconds[ABA] - call
    return {
        "seconds": {name: summary(spent) for name, spent in seconds.items()},
        "ratios": {name: summary(spent / seconds[OURS]) for name, spent in seconds.items() if name != OURS},
        "call": summary(call),
        "errors": mujoco_model.difference_errors(wet, seed),
    }
