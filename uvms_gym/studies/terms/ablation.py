"""Cost of each term of a scene per step, and error of the driven motion without it."""

import gc
import math
import time
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.accuracy.driven_motion import PERIOD, Motion, Track, driven_motion, follow
from uvms_gym.studies.numerics import Floats, state_errors
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.terms.scene_terms import ALL, CURRENT, Term, edited, terms_of

#: Maximum step of runs, s, where none is given; length of the motion and instants of errors, s.
STEP, TIME, INSTANTS = 0.005, 10.0, (1.0, 10.0)
#: Measurement of cost: instances, timed steps, interleaved rounds of all variants, and batches of rounds, each with its
#: own simulators: their places in memory make a greater difference than many a term.
TIMED, TIMED_STEPS, ROUNDS, BATCHES = 512, 20, 3, 31
#: Copies of the whole scene among the variants; the differences between them are noise.
COPIES = 4
#: Half width of intervals in standard deviations: 0.2 % of all fail, rarely one in a table of twenty.
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
    """Terms of a scene with their costs and effects."""

    #: Integrator and step, s, of all runs.
    integrator: str
    step: float
    #: All terms, present or not.
    terms: list[Term]
    #: Cost of a step of the whole scene, ns per instance.
    step_cost: float
    #: Saving without each removable term, by name.
    savings: dict[str, Saving]
    #: (times, 3) median error of the integration at `INSTANTS`: position (m), attitude (rad), end effector (m).
    integration_error: Floats
    #: Median errors (times, 3) without each removable term, by name.
    errors: dict[str, Floats]

    @property
    def removable(self) -> list[Term]:
        """Terms that can be removed."""
        return [term for term in self.terms if term.remove is not None]

    def as_data(self) -> dict[str, Any]:
        """Results as dictionaries."""
        return {
            "integrator": self.integrator,
            "step": self.step,
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


def ablate(scene: dict[str, Any], episodes: int, seed: int, step: float | None = None) -> Ablation:
    """Measure costs and effects of all terms over an ensemble of driven motions.

    Runs have the scene's integrator and a step, s, that divides the drive's period; None: the scene's, at most `STEP`.
    """
    terms = terms_of(scene)
    if step is None:
        step = PERIOD / math.ceil(PERIOD / min(STEP, Simulator(scene).dt) - 1e-9)
    with warnings.catch_warnings():
        # A scene without a term may be stiff at this step; its error shows that.
        warnings.simplefilter("ignore")
        motion = driven_motion(scene, episodes, TIME, seed)
        removable = [term for term in terms if term.remove is not None]
        floor, errors = trajectory_errors(motion, removable, step)
        whole, savings = step_costs(motion.tiled(TIMED), removable, seed, step)
    return Ablation(Simulator(scene).integrator, step, terms, whole, savings, floor, errors)


def without_term(motion: Motion, term: Term) -> Motion:
    """The same start and drive of the scene without a term."""
    assert term.remove is not None
    start = motion.start
    if term.name in (CURRENT, ALL):
        start = start | {"current": np.zeros_like(start["current"])}
    return motion._replace(scene=edited(motion.scene, term.remove), start=start)


def trajectory_errors(motion: Motion, terms: Sequence[Term], step: float = STEP) -> tuple[Floats, dict[str, Floats]]:
    """Median errors (times, 3) of the motion: of the integration, by half the step, and without each term, by name.

    Infinite where a motion is not finite.
    """
    samples = round(TIME / INSTANTS[0])
    rows = [round(t / INSTANTS[0]) - 1 for t in INSTANTS]

    def end(motion: Motion, step: float) -> Track:
        track = follow(motion, {"dt": step}, samples)
        parts = {name: getattr(track, name)[rows] for name in ("position", "rotation", "q", "end_effector")}
        return track._replace(**parts)

    reference = end(motion, step)
    floor = _distance(reference, end(motion, 0.5 * step))
    motions = {term.name: without_term(motion, term) for term in terms}
    ends = {name: end(other, step) for name, other in tracked(motions.items(), "errors")}
    return floor, {name: _distance(reference, other) for name, other in ends.items()}


def _distance(a: Track, b: Track) -> Floats:
    """Medians over instances of the distances of two runs in `QUANTITIES`, (times, 3)."""
    errors = state_errors(b, a)
    return np.stack([np.median(errors[name], axis=-1) for name in QUANTITIES], axis=-1)


def step_costs(motion: Motion, terms: Sequence[Term], seed: int, step: float = STEP) -> tuple[float, dict[str, Saving]]:
    """Cost of a step of the whole scene, ns per instance, and savings without each term.

    All variants take turns in each round, in random order, on one thread, through the same part of the motion.
    """
    motions = [*(motion for _ in range(COPIES)), *(without_term(motion, term) for term in terms)]
    rng = np.random.default_rng(seed)
    times = np.empty((BATCHES, ROUNDS, len(motions)))
    collects = gc.isenabled()
    gc.disable()
    simulators: dict[int, Simulator] = {}
    try:
        for batch in tracked(times, "costs"):
            # Old simulators live until all new ones do, so that these lie elsewhere in memory.
            order = rng.permutation(len(motions)).tolist()
            simulators = {k: Simulator(motions[k].scene, TIMED, dt=step, threads=1) for k in order}
            for row in [batch[0], *batch]:
                for k in rng.permutation(len(motions)).tolist():
                    row[k] = _timed(simulators[k], motions[k])
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
