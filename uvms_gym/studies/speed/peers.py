"""MuJoCo and Pinocchio for comparison: the same joints and masses, in one process, interleaved."""

from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym._scene import joints
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.environment import SUBSTEPS, VectorEnv
from uvms_gym.studies.speed.physics import Setting, Stepping
from uvms_gym.studies.speed.rigid_bodies import dry
from uvms_gym.studies.speed.timing import interleave, summary

#: Names of our cases.
OURS = {"float64": "ours, f64", "float32": "ours, f32"}
#: Bound on the relative difference of dry accelerations, and number of random states.
BOUND, TRIED = 1e-10, 20
#: Packages of the peers, by module.
PACKAGES = {"mujoco": "mujoco", "pinocchio": "pin"}

#: Models of MuJoCo: title, integrator and options.
MODELS: dict[str, tuple[str, dict[str, Any]]] = {
    "MuJoCo RK4": ("RK4", {}),
    "MuJoCo RK4 with buoyancy": ("RK4", {"weight": "buoyant"}),
    "MuJoCo RK4, no thrusters, no servos": ("RK4", {"actuators": False}),
    "MuJoCo Euler": ("Euler", {}),
    "MuJoCo implicitfast": ("implicitfast", {}),
}
#: Models compared with the vector environment.
VECTOR_MODELS = ("MuJoCo RK4", "MuJoCo RK4 with buoyancy")
ABA = "Pinocchio, 4 x aba"

#: Scope of the peers' models, for reports.
SCOPE = """\
Not computed by the peers. MuJoCo's ellipsoid fluid model: its added mass is a force that follows from velocities \
alone (such as the Munk moment) and adds nothing to the inertia that accelerates, so there is no full 6x6 added mass; \
its damping comes from the sizes of the ellipsoids and five coefficients, not from linear and quadratic 6x6 matrices \
of every body; buoyancy is no part of it (the row with buoyancy has it as gravcomp, at the centre of mass and so \
without righting moment; the other rows have no gravity instead); there is one current for a whole model. End stops, \
Coulomb friction and effort limits are left out of its models, and there is no estimate of a step's error. Joints, \
masses, inertias, viscous friction, thrusters and joint servos are the same as ours. Pinocchio's aba gives \
accelerations of rigid bodies: no water, no thruster, no servo, no friction, and no integrator between the four.
Choices in the peers' favour. MuJoCo: native rollout of 32 instances (1024 take as long each) without checks, into \
arrays allocated once; fixed parts merged; constraints, contacts, limits, sensors, warm start and energy off; \
Jacobians as MuJoCo chooses them (forcing dense or sparse ones is slower). Pinocchio: the loop over states is in C++ \
(abaInParallel on one thread), without a Python call to subtract, and every joint is about z, its fastest kind. \
Ours are timed as whole Python calls with their inputs."""


def check_scene(scene: dict[str, Any]) -> None:
    """Raise ValueError for a scene that the peers' models do not cover."""
    if scene["vehicle"].get("fixed"):
        raise ValueError(f"{scene['name']} has a fixed vehicle, but vehicles of the peers' models float")


def versions() -> dict[str, str]:
    """Versions of MuJoCo and Pinocchio."""
    from uvms_gym.studies.speed import mujoco_model, pinocchio_model

    return {"mujoco": mujoco_model.VERSION, "pinocchio": pinocchio_model.VERSION}


def dry_difference(scene: dict[str, Any], seed: int = 0) -> dict[str, float]:
    """Maximum relative difference of each peer's accelerations from ours, without water, over random states."""
    from uvms_gym.studies.speed import mujoco_model, pinocchio_model

    vacuum = dry(scene)
    models = {
        "mujoco": (mujoco_model.acceleration, mujoco_model.build(vacuum, water=False, weight="full", actuators=False)),
        "pinocchio": (pinocchio_model.acceleration, pinocchio_model.build(vacuum)),
    }
    simulator = Simulator(vacuum)
    viscous = np.array([joint["friction"]["viscous"] for joint in joints(vacuum)])
    rng = np.random.default_rng(seed)
    worst = dict.fromkeys(models, 0.0)
    for _ in range(TRIED):
        state, wrench, torque = _random(rng, simulator)
        simulator.set_state(**state)
        ours = simulator.forward_dynamics(wrench=wrench, joint_torque=torque)[0]
        for name, (acceleration, model) in models.items():
            # Pinocchio has no friction.
            applied = torque - viscous * state["qd"] if name == "pinocchio" else torque
            off = np.abs(acceleration(model, state, wrench, applied) - ours).max() / np.abs(ours).max()
            worst[name] = float(np.maximum(worst[name], off))
    for name, off in worst.items():
        if not off <= BOUND:
            raise ValueError(f"{scene['name']}: dry accelerations of {name} differ by {off:.1e}: it has another model")
    return worst


def _random(rng: np.random.Generator, simulator: Simulator) -> tuple[dict[str, Floats], Floats, Floats]:
    n = simulator.num_joints
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    state = {
        "position": rng.normal(size=3),
        "rotation": turn,
        "twist": 0.5 * rng.normal(size=6),
        "q": rng.uniform(-2.0, 2.0, n),
        "qd": 0.7 * rng.normal(size=n),
    }
    return state, 20.0 * rng.normal(size=6), rng.normal(size=n)


def step_study(scene: dict[str, Any], n: int, substeps: int, repeats: int, seed: int) -> dict[str, Any]:
    """Time a step of MK4 and the steps of the peers, on one thread.

    Returns
    -------
    dict
        `seconds` of CPU time per step (a summary) by name, and `ratios` to ours by dtype and name, round by round.
    """
    from uvms_gym.studies.speed import mujoco_model, pinocchio_model

    cases: dict[str, Any] = {
        name: Stepping.of(Setting(scene, n, dtype=dtype, substeps=substeps, seed=seed)) for dtype, name in OURS.items()
    }
    for name, (integrator, options) in MODELS.items():
        cases[name] = mujoco_model.Rolling(scene, integrator, steps=substeps, seed=seed, **options)
    cases[ABA] = pinocchio_model.Dynamics(scene, seed)
    samples = interleave(cases, repeats)
    return {
        "n": n,
        "substeps": substeps,
        "instruction_set": cases[OURS["float64"]].simulator.instruction_set,
        "seconds": {name: summary(times.cpu) for name, times in samples.items()},
        "ratios": {
            dtype: {
                name: summary(times.cpu / samples[ours].cpu)
                for name, times in samples.items()
                if name not in OURS.values()
            }
            for dtype, ours in OURS.items()
        },
    }


def vector_study(scene: dict[str, Any], n: int, threads: list[int], repeats: int, seed: int) -> list[dict[str, Any]]:
    """Time of the vector environment, f64, and of MuJoCo's RK4 with the same instances, substeps and threads.

    Returns
    -------
    list of dict
        Per number of threads: `ours`, seconds per control step and instance (a summary), and in `peers` by the name of
        the model its `seconds` and their `ratio` to ours, round by round.
    """
    from uvms_gym.studies.speed import mujoco_model

    cases: dict[Any, Any] = {}
    for count in threads:
        cases[count, "ours"] = VectorEnv(scene, n, count, "float64", seed)
        for name in VECTOR_MODELS:
            integrator, options = MODELS[name]
            options = {"n": n, "steps": SUBSTEPS, "threads": count, "seed": seed, **options}
            cases[count, name] = mujoco_model.Rolling(scene, integrator, **options)
    samples = interleave(cases, repeats)
    rows = []
    for count in threads:
        ours = samples[count, "ours"].fair(count)
        theirs = {name: SUBSTEPS * samples[count, name].fair(count) for name in VECTOR_MODELS}
        against = {name: {"seconds": summary(spent), "ratio": summary(spent / ours)} for name, spent in theirs.items()}
        row: dict[str, Any] = {"scene": scene["name"], "n": n, "threads": count, "substeps": SUBSTEPS}
        rows.append(row | {"ours": summary(ours), "peers": against})
    return rows
