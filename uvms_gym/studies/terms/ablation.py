"""Cost of each term of a scene per step, and error of the driven motion without it."""

import gc
import math
import time
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.accuracy.driven_motion import Motion, driven_motion, follow
from uvms_gym.studies.numerics import Floats, rotation_distance
from uvms_gym.studies.terms.scene_terms import ALL, CURRENT, Term, edited, terms_of

Tick = Callable[[], None]

#: Step of all runs, s; length of the motion and instants of errors, s.
STEP, TIME, INSTANTS = 0.005, 10.0, (1.0, 10.0)
#: Measurement of cost: instances, timed steps, interleaved rounds of all variants, and batches of rounds, each with its
#: own simulators: their places in memory make a greater difference than many a term.
TIMED, TIMED_STEPS, ROUNDS, BATCHES = 512, 20, 3, 31
#: Copies of the whole scene among the variants; the differences between them are noise.
COPIES = 4
#: Half width of intervals in standard deviations: 0.2 % of all fail, hardly one in a table of twenty.
DEVIATIONS = 3.1
QUANTITIES = ("position", "attitude", "end_effector")


class Saving(NamedTuple):
    """Saving per step, ns per instance: median of paired differences, and half width of its interval."""

    value: float
    noise: float

    @property
    def significant(self) -> bool:
        """True if it exceeds the noise."""
        return abs(self.value) > self.noise


class Ablation(NamedTuple):
    """Terms of a scene with their costs and effects.

    Attributes
    ----------
    terms : list of Term
        All terms, present or not.
    step_cost : float
        Cost of a step of the whole scene, ns per instance.
    savings : dict
        Saving without each removable term, by name.
    integration_error : numpy.ndarray (times, 3)
        Median error of the integration at `INSTANTS`: position (m), attitude (rad), end effector (m).
    errors : dict
        Median errors (times, 3) without each removable term, by name.
    """

    terms: list[Term]
    step_cost: float
    savings: dict[str, Saving]
    integration_error: Floats
    errors: dict[str, Floats]

    @property
    def removable(self) -> list[Term]:
        """Terms that can be removed."""
        return removable(self.terms)

    def as_data(self) -> dict[str, Any]:
        """Results as dictionaries."""
        return {
            "step": STEP,
            "ns_per_step": self.step_cost,
            "integration_error": _by_time(self.integration_error),
            "terms": [
                {
                    "name": term.name,
                    "present": term.present,
                    "note": term.note,
                    "saved_ns_per_step": self.savings.get(term.name),
                    "median_error_without": _by_time(self.errors[term.name]) if term.name in self.errors else None,
                }
                for term in self.terms
            ],
        }


def ablate(scene: dict[str, Any], episodes: int, seed: int, tick: Tick = lambda: None) -> Ablation:
    """Measure costs and effects of all terms over an ensemble of driven motions; `tick` is called `ticks(scene)` times.

    Raises
    ------
    ValueError
        The scene is too stiff for the motion.
    """
    terms = terms_of(scene)
    with warnings.catch_warnings():
        # A scene without a term may be stiff at this step; its error shows that.
        warnings.simplefilter("ignore")
        motion = driven_motion(scene, episodes, TIME, seed)
        floor, errors = trajectory_errors(motion, removable(terms), tick)
        whole, savings = step_costs(motion.tiled(TIMED), removable(terms), seed, tick)
    return Ablation(terms, whole, savings, floor, errors)


def ticks(scene: dict[str, Any]) -> int:
    """Number of calls of `tick` by `ablate`."""
    return len(removable(terms_of(scene))) + 2 + BATCHES


def removable(terms: Sequence[Term]) -> list[Term]:
    """Terms that can be removed."""
    return [term for term in terms if term.remove is not None]


def without_term(motion: Motion, term: Term) -> Motion:
    """The same start and drive of the scene without a term."""
    assert term.remove is not None
    start = motion.start
    if term.name in (CURRENT, ALL):
        start = start | {"current": np.zeros_like(start["current"])}
    return motion._replace(scene=edited(motion.scene, term.remove), start=start)


def trajectory_errors(motion: Motion, terms: Sequence[Term], tick: Tick) -> tuple[Floats, dict[str, Floats]]:
    """Median errors (times, 3) of the motion: of the integration, by half the step, and without each term, by name.

    Infinite where a motion is not finite.
    """
    samples = round(TIME / INSTANTS[0])
    rows = [round(t / INSTANTS[0]) - 1 for t in INSTANTS]

    def end(motion: Motion, step: float) -> tuple[Floats, Floats, Floats]:
        track = follow(motion, {"dt": step}, samples)
        tick()
        return track.position[rows], track.rotation[rows], track.end_effector[rows]

    reference = end(motion, STEP)
    floor = _distance(reference, end(motion, 0.5 * STEP))
    return floor, {term.name: _distance(reference, end(without_term(motion, term), STEP)) for term in terms}


def _distance(a: tuple[Floats, Floats, Floats], b: tuple[Floats, Floats, Floats]) -> Floats:
    """Medians over instances of |position|, angle and |end effector| between two runs, (times, 3)."""
    with np.errstate(invalid="ignore"):
        parts = (
            np.linalg.norm(a[0] - b[0], axis=-1),
            rotation_distance(a[1], b[1]),
            np.linalg.norm(a[2] - b[2], axis=-1),
        )
    return np.stack([np.median(np.where(np.isfinite(part), part, np.inf), axis=-1) for part in parts], axis=-1)


def step_costs(motion: Motion, terms: Sequence[Term], seed: int, tick: Tick) -> tuple[float, dict[str, Saving]]:
    """Cost of an MK4 step of the whole scene, ns per instance, and savings without each term.

    All variants take turns in each round, in random order, on one thread, through the same part of the motion.
    """
    motions = [*(motion for _ in range(COPIES)), *(without_term(motion, term) for term in terms)]
    rng = np.random.default_rng(seed)
    times = np.empty((BATCHES, ROUNDS, len(motions)))
    collects = gc.isenabled()
    gc.disable()
    simulators: dict[int, Simulator] = {}
    try:
        for batch in times:
            # Old simulators live until all new ones do, so that these lie elsewhere in memory.
            order = rng.permutation(len(motions)).tolist()
            simulators = {k: Simulator(motions[k].scene, TIMED, dt=STEP, threads=1) for k in order}
            for row in [batch[0], *batch]:
                for k in rng.permutation(len(motions)).tolist():
                    row[k] = _timed(simulators[k], motions[k])
            tick()
    finally:
        if collects:
            gc.enable()
    whole = times[..., :COPIES].mean(axis=-1)
    saved = np.median(whole[..., None] - times, axis=1)
    bias = float(np.abs(np.median(saved[:, :COPIES], axis=0)).max())
    samples = zip(terms, saved[:, COPIES:].T, strict=True)
    savings = {term.name: Saving(float(np.median(sample)), bias + _half_width(sample)) for term, sample in samples}
    return float(np.median(whole)), savings


def _timed(simulator: Simulator, motion: Motion) -> float:
    """CPU time of a step of one instance at the start of the motion, ns."""
    simulator.set_state(**motion.start)
    begin = time.thread_time_ns()
    simulator.step(**motion.inputs(0), substeps=TIMED_STEPS)
    return (time.thread_time_ns() - begin) / (TIMED_STEPS * TIMED)


def _half_width(sample: Floats) -> float:
    """Half width of the interval of a median, by order statistics: a few disturbed batches do not widen it."""
    ordered = np.sort(sample)
    middle = len(ordered) // 2
    reach = min(math.ceil(0.5 * DEVIATIONS * math.sqrt(len(ordered))), middle)
    return float(max(ordered[middle + reach] - ordered[middle], ordered[middle] - ordered[middle - reach]))


def _by_time(errors: Floats) -> dict[str, dict[str, float]]:
    rows = zip(INSTANTS, errors.tolist(), strict=True)
    return {f"{t:g} s": dict(zip(QUANTITIES, row, strict=True)) for t, row in rows}
