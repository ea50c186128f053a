"""Driven motion of the accuracy study: tracking work in a current, the same for every method and step.

A vehicle in a steady current is driven by wrenches while its arm follows a reference. Wrenches are constant and
references are cubics over control periods of 0.1 s, whatever the step, so every step divides the intervals on which the
drive is smooth. The references are C2 splines and the study starts amid the motion: a servo released away from its
equilibrium rings at the arm's fastest rates, and this ringing would dominate all errors.
"""

import math
import warnings
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator, StepWarning
from uvms_gym._scene import joints
from uvms_gym.logs.interpolation import hermite
from uvms_gym.studies.numerics import Floats

#: Control period, s: wrenches are constant over it, and joint references are one cubic.
PERIOD = 0.1
#: Duration of the motion before the study starts, and its step, s.
LEAD, LEAD_STEP = 3.0, 1e-3
#: Maximum speed of the current, m/s; maximum angle between it and the horizontal, rad.
CURRENT, CURRENT_TILT = 0.3, 0.25
#: Maximum tilt and maximum speeds at the start of the lead, rad, m/s and rad/s.
TILT, SPEED, SPIN = 0.3, 0.2, 0.2
#: Maximum accelerations by the wrenches, m/s^2 and rad/s^2.
PUSH, TWIST = 0.2, 0.3
#: A drive is two sinusoids: bands of frequency, Hz, of wrenches and joints, and share of each in the maximum value.
WRENCH_BANDS, JOINT_BANDS, SHARES = ((0.05, 0.1), (0.1, 0.2)), ((0.1, 0.15), (0.15, 0.3)), (0.7, 0.3)
#: Maximum rate of a joint's reference, rad/s, and minimum drawn share of it.
RATE, MIN_SHARE = 0.5, 0.6
#: Travel of a prismatic joint for one radian of a revolute one, m.
PRISMATIC_PER_RADIAN = 0.25
#: Distance of references from the joints' limits, rad: soft servos overshoot and yield to the water.
MARGIN = 0.3


class Motion(NamedTuple):
    """Start and drive of an ensemble of N instances over T seconds."""

    scene: dict[str, Any]
    time: float
    #: Arguments of `Simulator.set_state` at the start of the study.
    start: dict[str, Floats]
    #: (periods, N, 6) wrenches on the vehicle, N and N m.
    wrench: Floats
    #: (periods, N, n, 4) cubics of the joints' references.
    target: Floats
    #: True where joints have servos, which follow the references.
    servos: bool

    def inputs(self, period: int) -> dict[str, Floats]:
        """Arguments of `Simulator.step` over a control period."""
        inputs = {"wrench": self.wrench[period]}
        if self.servos:
            inputs["joint_target"] = self.target[period]
        return inputs

    def tiled(self, count: int) -> "Motion":
        """Repeat instances until there are `count`."""
        rows = np.arange(count) % len(self.wrench[0])
        start = {name: values[rows] for name, values in self.start.items()}
        return self._replace(start=start, wrench=self.wrench[:, rows], target=self.target[:, rows])


class Track(NamedTuple):
    """States of a run at the end of every sample: (samples, N, ...)."""

    position: Floats
    rotation: Floats
    q: Floats
    end_effector: Floats
    #: Warnings within the first control period, and after it.
    warned_early: bool
    warned_later: bool


def driven_motion(scene: dict[str, Any], episodes: int, time: float, seed: int) -> Motion:
    """Draw the drive of an ensemble, and run it for `LEAD` seconds before the start."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(scene, episodes, dt=LEAD_STEP)
    fixed = bool(scene["vehicle"]["fixed"])
    leads = round(LEAD / PERIOD)
    periods = leads + round(time / PERIOD)
    state = _start(rng, simulator, fixed)
    wrench = np.zeros((periods, episodes, 6)) if fixed else _wrenches(rng, simulator, periods)
    target = _references(rng, simulator, periods)
    servos = any("servo" in joint for joint in joints(scene))
    motion = Motion(scene, LEAD, state, wrench, target, servos)
    simulator.set_state(**state)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StepWarning)
        for i in range(leads):
            simulator.step(**motion.inputs(i), substeps=round(PERIOD / LEAD_STEP))
    if not np.isfinite(simulator.twist).all():
        raise ValueError(f"the motion is not finite by MK4 at {LEAD_STEP:g} s: the scene is too stiff")
    start = {name: getattr(simulator, name) for name in ("position", "quaternion", "twist", "q", "qd", "current")}
    if fixed:
        del start["twist"]
    else:
        # Single precision resolves positions better near the origin.
        start["position"] = np.zeros_like(start["position"])
    return Motion(scene, time, start, wrench[leads:], target[leads:], servos)


def follow(motion: Motion, options: dict[str, Any], samples: int) -> Track:
    """Run the motion with options of the simulator; `samples` divides the number of control periods."""
    every = len(motion.wrench) // samples
    rows = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        simulator = Simulator(motion.scene, len(motion.wrench[0]), **options)
        simulator.set_state(**motion.start)
        early = 0
        for i in range(len(motion.wrench)):
            simulator.step(**motion.inputs(i), substeps=round(PERIOD / simulator.dt))
            early = len(caught) if i == 0 else early
            if (i + 1) % every == 0:
                end = simulator.end_effector_pose()[:, :3, 3]
                rows.append((simulator.position, simulator.rotation, simulator.q, end))
    position, rotation, q, end_effector = (np.array(column) for column in zip(*rows, strict=True))
    return Track(position, rotation, q, end_effector, warned_early=early > 0, warned_later=len(caught) > early)


def character(motion: Motion, track: Track) -> dict[str, float]:
    """Extent and speed of the motion, so that a reader can judge how typical it is."""
    steps = np.linalg.norm(np.diff(track.position, axis=0, prepend=0.0), axis=-1)
    traces = np.einsum("kiab,kiab->ki", track.rotation[1:], track.rotation[:-1])
    turned = np.arccos(np.clip(0.5 * (traces - 1.0), -1, 1))
    tilt = np.arccos(np.clip(track.rotation[:, :, 2, 2], -1.0, 1.0))
    references = motion.target[..., 1]
    return {
        "path": float(np.median(steps.sum(axis=0))),
        "turn": float(np.median(turned.sum(axis=0))),
        "max_tilt": float(tilt.max()),
        "joint_travel": float(np.median(np.ptp(track.q, axis=0))) if track.q.size else 0.0,
        "max_reference_rate": float(np.abs(references).max()) if references.size else 0.0,
    }


def _start(rng: np.random.Generator, simulator: Simulator, fixed: bool) -> dict[str, Floats]:
    count = simulator.num_envs
    heading, rise = rng.uniform(-math.pi, math.pi, count), rng.uniform(-CURRENT_TILT, CURRENT_TILT, count)
    way = np.stack([np.cos(rise) * np.cos(heading), np.cos(rise) * np.sin(heading), np.sin(rise)], axis=-1)
    state: dict[str, Floats] = {"current": rng.uniform(0.0, CURRENT, (count, 1)) * way}
    yaw, lean, side = rng.uniform(-math.pi, math.pi, count), rng.uniform(0.0, TILT, count), rng.uniform(size=count)
    twist = np.concatenate([_in_ball(rng, count, SPEED), _in_ball(rng, count, SPIN)], axis=-1)
    if not fixed:
        # First a tilt about a horizontal axis, then yaw.
        side = 2.0 * math.pi * side
        w, x, y = np.cos(lean / 2), np.sin(lean / 2) * np.cos(side), np.sin(lean / 2) * np.sin(side)
        c, s = np.cos(yaw / 2), np.sin(yaw / 2)
        state["quaternion"] = np.stack([c * w, c * x - s * y, c * y + s * x, s * w], axis=-1)
        state["twist"] = twist
    return state


def _in_ball(rng: np.random.Generator, count: int, radius: float) -> Floats:
    ways = rng.normal(size=(count, 3))
    ways *= radius * rng.uniform(size=(count, 1)) / np.linalg.norm(ways, axis=-1, keepdims=True)
    return ways


def _wrenches(rng: np.random.Generator, simulator: Simulator, periods: int) -> Floats:
    """Wrenches (periods, N, 6) scaled by the inertia of vehicle, added mass and arm along each axis."""
    maximum = np.diagonal(simulator.mass_matrix()[0])[:6] * np.repeat([PUSH, TWIST], 3)
    times = PERIOD * np.arange(0.5, periods, dtype=np.float64)
    held: Floats = maximum * _sinusoids(rng, times, (simulator.num_envs, 6), WRENCH_BANDS)[0]
    return held


def _references(rng: np.random.Generator, simulator: Simulator, periods: int) -> Floats:
    """Sinusoids about home (periods, N, n, 4) as C2 cubic splines, away from the joints' limits."""
    shape = (simulator.num_envs, simulator.num_joints)
    knots = PERIOD * np.arange(periods + 1, dtype=np.float64)
    value, rate, reach = _sinusoids(rng, knots, shape, JOINT_BANDS, rates=True)
    centre, size = np.zeros(shape), np.zeros(shape)
    for k, joint in enumerate(joints(simulator.scene)):
        unit = PRISMATIC_PER_RADIAN if joint["kind"] == "prismatic" else 1.0
        size[:, k] = unit * RATE * rng.uniform(MIN_SHARE, 1.0, shape[0])
        centre[:, k] = joint.get("home", 0.0)
        if limits := joint.get("limits"):
            low, high = limits["lower"], limits["upper"]
            margin = min(MARGIN * unit, 0.25 * (high - low))
            size[:, k] = np.minimum(size[:, k], (0.5 * (high - low) - margin) / reach[:, k])
            swing = size[:, k] * reach[:, k] + margin
            centre[:, k] = np.clip(centre[:, k], low + swing, high - swing)
    return _spline(centre + size * value, size * rate[[0, -1]])


def _sinusoids(
    rng: np.random.Generator,
    times: Floats,
    shape: tuple[int, ...],
    bands: tuple[tuple[float, float], ...],
    rates: bool = False,
) -> tuple[Floats, Floats, Floats]:
    """Sums of sinusoids (times, *shape) with the maximum value, or maximum rate, 1; their rates and amplitudes."""
    value, rate, reach = np.zeros((len(times), *shape)), np.zeros((len(times), *shape)), np.zeros(shape)
    for (low, high), share in zip(bands, SHARES, strict=True):
        angular = 2.0 * math.pi * rng.uniform(low, high, shape)
        size = share / angular if rates else np.full(shape, share)
        phase = angular * times.reshape(-1, *(1 for _ in shape)) + rng.uniform(-math.pi, math.pi, shape)
        value += size * np.sin(phase)
        rate += size * angular * np.cos(phase)
        reach += size
    return value, rate, reach


def _spline(values: Floats, end_rates: Floats) -> Floats:
    """Cubics (k, ..., 4) of the C2 spline through `values` (k + 1, ...) with given rates at both ends."""
    count = len(values)
    matrix = 4.0 * np.eye(count) + np.eye(count, k=1) + np.eye(count, k=-1)
    matrix[0], matrix[-1] = np.eye(count)[[0, -1]]
    right = np.empty_like(values)
    right[1:-1] = 3.0 / PERIOD * (values[2:] - values[:-2])
    right[[0, -1]] = end_rates
    slopes = np.asarray(np.linalg.solve(matrix, right.reshape(count, -1)), dtype=np.float64).reshape(values.shape)
    return hermite((values[:-1], slopes[:-1]), (values[1:], slopes[1:]), PERIOD)
