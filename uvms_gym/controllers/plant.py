"""Physics of a vehicle as a policy for any vehicle sees it: constants, and maps of observations and actions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvms_gym._core import Simulator, Task
from uvms_gym._scene import bodies, buoyancy_of, matrix_of

Floats = NDArray[np.float64]

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
#: Quantities along each axis, made of entries of an observation.
SEEN = ("error", "velocity", "action", "integral", "arm_load", "arm_motion")
#: Constants of each axis.
FEATURES = (
    *("authority", "damping", "righting", "exposure", "turns", "vertical", "lateral"),
    *("delay", "lag", "pose_noise", "velocity_noise", "load", "arm"),
)
#: Standard deviations of the storm's sensors, m, rad, m/s and rad/s.
NOISE = {"position": 0.005, "attitude": 0.005, "linear_velocity": 0.01, "angular_velocity": 0.01}
#: Speed at which damping is taken, m/s and rad/s, and turn at which the righting moment is, rad.
SPEED, TURN = 0.3, 0.1


class Plant(NamedTuple):
    """Vehicle, sensors and thrusters as the policy sees them, in axes of the body.

    Attributes
    ----------
    features : (6, p)
        `FEATURES` by axis: logarithm of the acceleration that the thrusters reach (m/s^2; 10 rad/s^2); logarithm of the
        damping rate, 1/s; logarithm of 1 + righting stiffness over inertia, 1/s^2; displaced and added mass over
        inertia; 1 for turns, for heave and yaw, and for sway and roll; delay less one control period; logarithms of lag
        over 0.1 s and of the sensors' noise over the storm's; weight at home over a fifth of the thrust; logarithm of 1
        + ten times the arm's coupling.
    seen : (f, 6, d)
        Quantities of `SEEN` by axis, per entry of an observation.
    acted : (6, 6)
        Entries of an action per acceleration along each axis, relative to that which the thrusters reach.
    """

    features: Floats
    seen: Floats
    acted: Floats


def plant(task: Task, lag: float | None, noise: Mapping[str, float] | None) -> Plant:
    """Physics of a vehicle at home, its inertia with added mass and the arm.

    Parameters
    ----------
    task : uvms_gym._core.Task
        Station keeping with wrenches as actions.
    lag : float or None
        Thrusters' lag, s; None: the scene's.
    noise : mapping or None
        Standard deviations of the sensors by the names of `NOISE`; None: 0.

    Raises
    ------
    ValueError
        The thrusters do not push along some axis alone.
    """
    scene: dict[str, Any] = task.scene
    limits = np.array([entry["scale"][0] for entry in task.action_layout])
    if missing := [axis for axis, limit in zip(AXES, limits, strict=True) if not limit > 0.0]:
        raise ValueError(
            f"universal needs thrust along all six axes, but the thrusters of scene {scene['name']} "
            f"do not push along {', '.join(missing)} alone"
        )
    simulator = Simulator(scene, 1)
    mass = simulator.mass_matrix()[0]
    inertia, coupling = mass[:6, :6], mass[:6, 6:]
    authority = limits / inertia.diagonal()
    features = _features(simulator, scene, inertia.diagonal(), coupling, limits)
    given = {name: (noise or {}).get(name, 0.0) for name in NOISE}
    pose, attitude, velocity, rate = (math.log(max(given[name] / NOISE[name], 0.01)) for name in NOISE)
    features |= {
        "delay": sum(task.delays) / 2.0 - 1.0,
        "lag": math.log(max(mean_lag(scene) if lag is None else lag, 0.01) / 0.1),
        "pose_noise": np.repeat([pose, attitude], 3),
        "velocity_noise": np.repeat([velocity, rate], 3),
    }
    rows = np.stack([np.broadcast_to(features[name], 6) for name in FEATURES], axis=1)
    seen = _seen(task, simulator, inertia, coupling, authority, limits)
    return Plant(rows, seen, inertia * authority / limits[:, None])


def mean_lag(scene: Mapping[str, Any]) -> float:
    """Mean lag of a scene's thrusters, s."""
    thrusters, usual = scene["vehicle"]["thrusters"], scene["vehicle"].get("thruster_lag") or 0.0
    return sum(usual if one.get("lag") is None else one["lag"] for one in thrusters) / len(thrusters)


def _features(simulator: Simulator, scene: dict[str, Any], inertia: Floats, coupling: Floats, limits: Floats) -> Any:
    """Features of the vehicle alone, by name."""
    turns = np.repeat([0.0, 1.0], 3)
    rate, stiffness = np.empty(6), np.zeros(6)
    for axis in range(6):
        speeds = np.zeros((1, 6 + simulator.num_joints))
        speeds[0, axis] = SPEED
        rate[axis] = simulator.equations(speeds)["D_nu"][0, axis] / SPEED / inertia[axis]
    load = simulator.equations()["g"][0, :6]
    for axis in (3, 4):
        turn = np.zeros(4)
        turn[0], turn[axis - 2] = math.cos(0.5 * TURN), math.sin(0.5 * TURN)
        simulator.set_state(quaternion=turn)
        stiffness[axis] = (simulator.equations()["g"][0, axis] - load[axis]) / TURN / inertia[axis]
    simulator.reset()
    water, parts = scene["water"], bodies(scene)
    weight = water["density"] * math.hypot(*water["gravity"])
    lift = sum(buoyancy_of(body, water) for _, body in parts)
    displaced = water["density"] * lift / weight if weight > 0.0 else 0.0
    added = parts[0][1].get("added_mass")
    own = np.zeros(6) if added is None else matrix_of(added).diagonal()
    return {
        "authority": np.log(limits / inertia / (1.0 + 9.0 * turns)),
        "damping": np.log(np.maximum(rate, 1e-2)),
        "righting": np.log1p(np.maximum(stiffness, 0.0)),
        "exposure": (displaced * (1.0 - turns) + own) / inertia,
        "turns": turns,
        "vertical": np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]),
        "lateral": np.array([0.0, 1.0, 0.0, 1.0, 0.0, 0.0]),
        "load": 5.0 * np.abs(load) / limits,
        "arm": np.log1p(10.0 * np.abs(coupling).sum(axis=1) / inertia),
    }


def _seen(
    task: Task, simulator: Simulator, inertia: Floats, coupling: Floats, authority: Floats, limits: Floats
) -> Floats:
    """Quantities of `SEEN` along each axis per entry of an observation, (f, 6, d).

    Errors, velocities and integrals are over what is usual for the authority a: 20 mm sqrt(a) + 5 mm, 50 mm/s sqrt(a) +
    10 mm/s, with the noise of the sensors as the last terms. Past actions, and weight and momentum of the arm by its
    reference, are accelerations relative to the authority.
    """
    blocks = {block["name"]: block for block in task.layout}
    size = sum(block["length"] for block in task.layout)

    def physical(*names: str) -> Floats:
        """Physical values (6, d) of blocks with six entries in all."""
        entries = [
            (blocks[name]["offset"] + k, scale) for name in names for k, scale in enumerate(blocks[name]["scale"])
        ]
        found = np.zeros((6, size))
        for row, (entry, scale) in enumerate(entries):
            found[row, entry] = scale
        return found

    root = np.sqrt(authority)[:, None]
    seen = np.zeros((len(SEEN), 6, size))
    seen[0] = physical("position_error", "attitude_error") / (0.02 * root + 0.005)
    seen[1] = physical("linear_velocity", "angular_velocity") / (0.05 * root + 0.01)
    seen[2] = 3.0 * np.linalg.solve(inertia * authority, limits[:, None] * physical("previous_action"))
    seen[3] = physical("error_integral") / (0.05 * root + 0.01)
    if "joint_reference" in blocks:
        load = np.linalg.solve(inertia, _loads(simulator)) / authority[:, None]
        motion = np.linalg.solve(inertia, coupling) / (0.05 * root + 0.01)
        for row, columns, name in ((4, 10.0 * load, "joint_reference"), (5, motion, "joint_reference_rate")):
            block = blocks[name]
            entries = slice(block["offset"], block["offset"] + block["length"])
            seen[row, :, entries] = columns[:, : block["length"]] * np.array(block["scale"])
    return seen


def _loads(simulator: Simulator, change: float = 0.1) -> Floats:
    """Derivative of the restoring wrench by joint coordinates at home, (6, n)."""
    home, loads = simulator.q[0].copy(), np.empty((6, simulator.num_joints))
    for k in range(simulator.num_joints):
        both = []
        for q in (home[k] + change, home[k] - change):
            simulator.set_state(q=[*home[:k], q, *home[k + 1 :]])
            both.append(simulator.equations()["g"][0, :6])
        loads[:, k] = (both[0] - both[1]) / (2.0 * change)
    simulator.reset()
    return loads


def stack_shares(spans: Sequence[int]) -> Floats:
    """Shares (s, h) of the stacked observations, oldest first, in the averages of successive ones."""
    shares = np.zeros((len(spans), sum(spans)))
    ends = np.cumsum(spans)
    for row, span, end in zip(shares, spans, ends, strict=True):
        row[end - span : end] = 1.0 / span
    return shares
