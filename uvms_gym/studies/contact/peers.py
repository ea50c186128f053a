"""MuJoCo side by side with this package in contact, with equal penetration at rest and equal restitution."""

import math
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.contact.scenes import DROP, FRICTION, SAMPLE, SCENES, ContactScene, Track
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.speed.timing import Case, interleave, summary

#: Steps from the coarsest, s, and the deviation from the converged result that a step may cause.
STEPS = (0.02, 0.01, 0.005, 0.002, 0.001, 0.0005, 0.0002, 0.0001)
DEVIATION = 0.01
#: MuJoCo's impedance of contacts, the minimum of its default.
IMPEDANCE = 0.9
#: Instances of our batch.
BATCH = 256
OURS, SINGLE = "mk4", "mk4, f32"
#: Magnitude of results below which they are 0.
NOTHING = 1e-9


class Peer(NamedTuple):
    """A variant of MuJoCo: title, integrator, further options, and time constant of friction, s."""

    title: str
    integrator: str
    options: str = 'impratio="10"'
    #: None: the one of the normal direction.
    friction: float | None = 0.02


PEERS = (
    Peer("MuJoCo RK4", "RK4"),
    Peer("MuJoCo Euler", "Euler"),
    Peer("MuJoCo implicitfast", "implicitfast"),
    Peer("MuJoCo implicitfast, noslip", "implicitfast", 'impratio="10" noslip_iterations="10"'),
    Peer("MuJoCo implicitfast, one solref", "implicitfast", "", None),
)


class Contact(NamedTuple):
    """Parameters `solref` of a contact: time constant, s, and damping ratio."""

    time_constant: float
    damping_ratio: float


def mujoco_model(scene: ContactScene, contact: Contact, peer: Peer, step: float) -> Any:
    """MuJoCo's model of a scene: elliptic cones, Newton's solver."""
    import mujoco

    solref = f"{contact.time_constant!r} {contact.damping_ratio!r}"
    friction = solref if peer.friction is None else f"{peer.friction!r} 1"
    pairs = "".join(
        f'<pair geom1="{one}" geom2="{other}" condim="3" friction="{FRICTION} {FRICTION} 0 0 0" solref="{solref}" '
        f'solreffriction="{friction}" solimp="{IMPEDANCE} {IMPEDANCE} 0.001 0.5 2"/>'
        for one, other in scene.pairs
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="{peer.integrator}" cone="elliptic" tolerance="1e-12" '
        f'iterations="100" gravity="{" ".join(map(repr, scene.gravity))}" {peer.options}/>'
        '<default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{scene.bodies}</worldbody><contact>{pairs}</contact><actuator>{scene.actuators}</actuator>"
        "</mujoco>"
    )


def mujoco_start(scene: ContactScene, model: Any) -> Any:
    """MuJoCo's data at the start of a scene."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = scene.qpos, scene.qvel, 1.0
    return data


def by_mujoco(scene: ContactScene, contact: Contact, peer: Peer, step: float, time: float | None = None) -> Track:
    """Motion by MuJoCo."""
    import mujoco

    model = mujoco_model(scene, contact, peer, step)
    data = mujoco_start(scene, model)
    rows = [(data.qpos[scene.coordinate], data.qvel[scene.coordinate])]
    for _ in range(round((time or scene.time) / SAMPLE)):
        mujoco.mj_step(model, data, nstep=round(SAMPLE / step))
        rows.append((data.qpos[scene.coordinate], data.qvel[scene.coordinate]))
    mujoco.mj_forward(model, data)
    x, v = np.array(rows).T
    return Track(x, v, -float(np.min(data.contact.dist, initial=0.0)))


def by_us(scene: ContactScene, step: float, dtype: str = "float64", time: float | None = None) -> Track:
    """Motion by mk4."""
    simulator = our_simulator(scene, step, 1, dtype)

    def row() -> tuple[float, float]:
        if scene.coordinate < 0:
            return float(simulator.q[0, -1]), float(simulator.qd[0, -1])
        velocity = simulator.rotation[0] @ simulator.twist[0, :3]
        return float(simulator.position[0, scene.coordinate]), float(velocity[scene.coordinate])

    rows = [row()]
    for _ in range(round((time or scene.time) / SAMPLE)):
        simulator.step(substeps=round(SAMPLE / step), **scene.inputs)
        rows.append(row())
    x, v = np.array(rows).T
    return Track(x, v, float(simulator.contacts()["depth"].max()))


def our_simulator(scene: ContactScene, step: float, n: int, dtype: str = "float64") -> Simulator:
    """Simulator at the start of a scene."""
    simulator = Simulator(dict(scene.scene), n, dt=step, integrator=OURS, dtype=dtype, threads=1, error_estimate=False)
    if scene.start:
        simulator.set_state(**scene.start)
    return simulator


def matched(scene: ContactScene) -> Contact:
    """Parameters of MuJoCo's contact with our penetration at rest and our exit speed of `DROP`.

    Under a load F on a mass m the penetration is (1 - impedance) F/m (time constant * damping ratio)^2.
    """
    product = math.sqrt(scene.depth * scene.mass / ((1.0 - IMPEDANCE) * scene.load))
    # Without dissipation: a time constant of 1e6 s.
    ratio = _damping_ratio() if scene.scene["contact"]["dissipation"] else 1e-6 * product
    return Contact(product / ratio, ratio)


@cache
def _damping_ratio(step: float = 1e-4) -> float:
    goal = DROP.results(by_us(DROP, step))["exit speed (m/s)"]
    product = math.sqrt(DROP.depth * DROP.mass / ((1.0 - IMPEDANCE) * DROP.load))
    low, high = 0.01, 2.0
    for _ in range(30):
        middle = math.sqrt(low * high)
        track = by_mujoco(DROP, Contact(product / middle, middle), PEERS[0], step, 0.5)
        low, high = (middle, high) if DROP.results(track)["exit speed (m/s)"] > goal else (low, middle)
    return math.sqrt(low * high)


def study(scenes: Sequence[ContactScene] = SCENES, repeats: int = 7) -> list[dict[str, Any]]:
    """Results, deviations by step and costs of scenes in both programs.

    Returns
    -------
    list of dict
        Per scene: `parameters` of MuJoCo's contact, `steps`, s, and in `programs` by title: converged `results`,
        `depth` at the end, m, `time_to_rest`, s, relative `deviations` at the steps from the program's own converged
        results (the maximum over results), and the `coarsest` step, s, with and below which they are within
        `DEVIATION`, or None; at that step the `cost`, a summary of the CPU time per simulated second and instance, s,
        and `cost_of_one` for a single instance of ours.
    """
    return [_scene_study(scene, repeats) for scene in tracked(scenes, "MuJoCo in contact")]


def _scene_study(scene: ContactScene, repeats: int) -> dict[str, Any]:
    contact, steps = matched(scene), [step for step in STEPS if step > 1.5 * scene.fine]
    runs: dict[str, Callable[[float], Track]] = {
        OURS: lambda step: by_us(scene, step),
        SINGLE: lambda step: by_us(scene, step, "float32"),
    }
    for peer in PEERS:
        runs[peer.title] = partial(by_mujoco, scene, contact, peer)
    rows: dict[str, dict[str, Any]] = {}
    for title, run in runs.items():
        track = run(scene.fine)
        found = scene.results(track)
        deviations = [_deviation(scene.results(run(step)), found) for step in steps]
        rows[title] = {
            "results": found,
            "depth": track.depth,
            "time_to_rest": scene.time_to_rest(track),
            "deviations": deviations,
            "coarsest": coarsest(steps, deviations),
        }
    cases: dict[Any, Case] = {}
    for title, row in rows.items():
        if row["coarsest"] is None:
            continue
        if title in (OURS, SINGLE):
            dtype = "float32" if title == SINGLE else "float64"
            cases[title, BATCH] = _Ours(scene, row["coarsest"], BATCH, dtype)
            cases[title, 1] = _Ours(scene, row["coarsest"], 1, dtype)
        else:
            peer = next(peer for peer in PEERS if peer.title == title)
            cases[title, BATCH] = _Theirs(scene, contact, peer, row["coarsest"])
    costs = {key: summary(times.cpu) for key, times in interleave(cases, repeats).items()}
    for title, row in rows.items():
        row["cost"], row["cost_of_one"] = costs.get((title, BATCH)), costs.get((title, 1))
    named = {"scene": scene.name, "description": scene.description, "parameters": contact}
    return named | {"steps": steps, "programs": rows}


def coarsest(steps: Sequence[float], deviations: Sequence[float]) -> float | None:
    """Coarsest step from which on all deviations are within `DEVIATION`, or None; steps are in descending order."""
    found = None
    for step, off in zip(reversed(steps), reversed(deviations)):
        if not off < DEVIATION:
            break
        found = step
    return found


def _deviation(found: dict[str, float], own: dict[str, float]) -> float:
    """Maximum deviation of results, relative; absolute below `NOTHING`."""
    return max(abs(found[name] - value) / (abs(value) if abs(value) > NOTHING else 1.0) for name, value in own.items())


#: Longest motion that is timed, s.
_TIMED = 2.0


class _Ours(Case):
    """Our motion from its start; a unit of work is a simulated second of an instance."""

    def __init__(self, scene: ContactScene, step: float, n: int, dtype: str) -> None:
        self.name, self.scene, self.substeps = scene.name, scene, round(min(scene.time, _TIMED) / step)
        self.simulator = our_simulator(scene, step, n, dtype)
        self.work = n * self.substeps * step

    def step(self) -> None:
        """One motion."""
        self.simulator.reset()
        if self.scene.start:
            self.simulator.set_state(**self.scene.start)
        self.simulator.step(substeps=self.substeps, **self.scene.inputs)

    def results(self) -> tuple[Floats, ...]:
        """Positions and joints."""
        return self.simulator.position, self.simulator.q


class _Theirs(Case):
    """MuJoCo's motion of one instance from its start, by its native loop over steps."""

    def __init__(self, scene: ContactScene, contact: Contact, peer: Peer, step: float) -> None:
        import mujoco

        self.name, self.scene, self.advance = scene.name, scene, mujoco.mj_step
        self.model = mujoco_model(scene, contact, peer, step)
        self.substeps = round(min(scene.time, _TIMED) / step)
        self.work = self.substeps * step

    def step(self) -> None:
        """One motion."""
        self.data = mujoco_start(self.scene, self.model)
        self.advance(self.model, self.data, nstep=self.substeps)

    def results(self) -> tuple[Floats, ...]:
        """Positions."""
        return (self.data.qpos,)
