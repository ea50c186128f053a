"""Cost of contact per step: a vehicle with an arm without contact, near a plane, on a plane, and at a lever."""

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from uvms_gym import Simulator, StepWarning, load_scene
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.timing import Case, interleave, summary

SCENE, STEP = "bluerov2-heavy-alpha5", 0.01
#: Instances, and steps of a motion from its start.
INSTANCES, STEPS = 1024, 50
#: Force on the vehicle towards the plane beyond its weight in water, N, and its sway at the lever, m/s.
LOAD, SWAY = 20.0, 0.1
#: Corners of skids: half lengths and height, m; radius of the spheres, m.
_SKID, _RADIUS = (0.2, 0.07, 0.2, -0.17), 0.02
DTYPES = ("float64", "float32")


def cases() -> dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]]:
    """Scenes, starts and inputs by name."""
    bare = load_scene(SCENE)
    x, inner, y, z = _SKID
    skids = [
        {"name": f"skid {k}", "on": "vehicle", "position": [along, across, z], "radius": _RADIUS}
        for k, (along, across) in enumerate((i, j) for i in (x, inner, -inner, -x) for j in (y, -y))
    ]
    floor = {"name": "floor", "kind": "plane", "frame": {"position": [0.0, 0.0, z - _RADIUS]}}
    pressed = {"wrench": [0.0, 0.0, -LOAD, 0.0, 0.0, 0.0]}

    def skidding(**law: float) -> dict[str, Any]:
        return bare | {"contact": {"spheres": skids, "shapes": [floor], **law}}

    tip = Simulator(bare).end_effector_pose()[0, :3, 3]
    finger = {"name": "finger", "on": "wrist", "position": bare["arm"]["end_effector"]["position"], "radius": 0.01}
    bar = {"name": "bar", "on": "lever", "kind": "box", "size": [0.2, 0.02, 0.02], "frame": {"position": [-0.1, 0, 0]}}

    def levered(away: float, slip_speed: float = 0.01) -> dict[str, Any]:
        frame = {"position": (tip + np.array([0.1 + away, 0.02, 0.0])).tolist()}
        friction = {"viscous": 0.08, "coulomb": 0.01, "coulomb_speed": 0.05}
        joint = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "frame": frame, "rotor_inertia": 0.002}
        lever = {"name": "lever", "joint": joint | {"friction": friction}}
        return bare | {"contact": {"spheres": [finger], "shapes": [bar], "slip_speed": slip_speed}, "fixtures": [lever]}

    sway = {"twist": [0.0, SWAY, 0.0, 0.0, 0.0, 0.0]}
    return {
        "no contact": (bare, {}, pressed),
        "8 spheres, 0.3 m above a plane": (skidding(), {"position": [0.0, 0.0, 0.3]}, {}),
        "8 spheres rest on a plane, slip speed 10 mm/s": (skidding(slip_speed=0.01), {}, pressed),
        "8 spheres rest on a plane, slip speed 1 mm/s": (skidding(slip_speed=0.001), {}, pressed),
        "lever, 1 m away": (levered(1.0), sway, {}),
        "lever, turned by a finger, slip speed 10 mm/s": (levered(0.0), sway, {}),
        "lever, turned by a finger, slip speed 1 mm/s": (levered(0.0, 0.001), sway, {}),
    }


class _Motion(Case):
    """Steps from a start; a unit of work is a step of an instance."""

    def __init__(self, name: str, dtype: str, n: int) -> None:
        scene, self.start, self.inputs = cases()[name]
        self.name, self.work = name, n * STEPS
        self.simulator = Simulator(scene, n, dt=STEP, dtype=dtype, threads=1, error_estimate=False)
        self.inputs["joint_target"] = self.simulator.q

    def step(self) -> None:
        """One motion."""
        self.simulator.reset()
        if self.start:
            self.simulator.set_state(**self.start)
        with warnings.catch_warnings():
            # The estimate of a step's error is relative to the motion, and bodies at rest hardly move.
            warnings.simplefilter("ignore", StepWarning)
            self.simulator.step(substeps=STEPS, **self.inputs)

    def results(self) -> tuple[Floats, ...]:
        """Positions and joints."""
        return self.simulator.position, self.simulator.q


def study(repeats: int = 11, n: int = INSTANCES, dtypes: Sequence[str] = DTYPES) -> dict[str, Any]:
    """Time steps of all cases in turns, on one thread.

    Returns
    -------
    dict
        `instances`, and in `cases` by name: `nanoseconds` per step and instance (a summary) by dtype, and at the end of
        the motion the number of `touching` spheres and the `turn` of the fixture, rad, or None.
    """
    timed = {(name, dtype): _Motion(name, dtype, n) for name in cases() for dtype in dtypes}
    samples = interleave(timed, repeats)
    rows: dict[str, Any] = {}
    for (name, dtype), times in samples.items():
        simulator = timed[name, dtype].simulator
        touching = int((simulator.contacts()["depth"][0] > 0.0).sum()) if "contact" in simulator.scene else 0
        turn = float(simulator.q[0, -1]) if simulator.scene.get("fixtures") else None
        row = rows.setdefault(name, {"touching": touching, "turn": turn, "nanoseconds": {}})
        row["nanoseconds"][dtype] = summary(1e9 * np.asarray(times.cpu))
    return {"scene": SCENE, "step": STEP, "instances": n, "cases": rows}
