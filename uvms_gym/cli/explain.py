"""`uvms scenes explain`: what each modelled term of a scene costs, and what leaving it out would change."""

import gc
import math
import time
import warnings
from collections.abc import Callable
from typing import Annotated, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from uvms_gym import Simulator
from uvms_gym.cli.common import Json, check_range, circumstances, console, prepare, progress, say, table, write_json
from uvms_gym.cli.motion import CURRENT as CURRENT_SPEED
from uvms_gym.cli.motion import Motion, driven_motion, follow
from uvms_gym.cli.scenes import Scene, read_scene
from uvms_gym.cli.terms import ALL, CURRENT, Term, edited, terms_of

Floats = NDArray[np.float64]

#: Step of all runs, s; length of the motion and the times at which errors are told, s.
STEP, TIME, TELL = 0.005, 10.0, (1.0, 10.0)
#: Measurement of cost: instances, steps that are timed, rounds in which all variants take turns, and batches of rounds,
#: each with simulators of its own: a place in memory makes more of a difference than many a term.
TIMED, TIMED_STEPS, ROUNDS, BATCHES = 512, 20, 3, 31
#: The scene itself takes so many parts in it; what these differ by is noise.
COPIES = 4
#: Intervals of +- so many standard deviations: 0.2 % of all fail, so that hardly one in a table of twenty does.
DEVIATIONS = 3.1
MOST_EPISODES = 10_000
#: An error that is this many times that of the integration itself stands out from it.
STANDS_OUT = 10.0
QUANTITIES = ("position", "attitude", "end_effector")
#: Errors after the motion that few will mind, m and rad.
SMALL = {"position": 1e-3, "attitude": 1e-3, "end_effector": 1e-3}


class Saving(NamedTuple):
    """What a step is cheaper by, ns per instance: median of paired differences, and how far noise alone reaches."""

    value: float
    noise: float

    @property
    def stands_out(self) -> bool:
        """Whether it is more than noise."""
        return abs(self.value) > self.noise


def explain(
    scene: Scene,
    episodes: Annotated[int, typer.Option(help=f"Motions of the ensemble, 1 to {MOST_EPISODES}.")] = 64,
    seed: Annotated[int, typer.Option(help="Seed of the ensemble.")] = 0,
    json_file: Json = None,
) -> None:
    """Tell what each modelled term costs per step, and the error of leaving it out.

    Measures on this machine, in some ten seconds, by taking terms out of the scene one at a time.
    """
    loaded = read_scene(scene)
    check_range("--episodes", episodes, 1, MOST_EPISODES)
    check_range("--seed", seed, 0, math.inf)
    prepare(None, json_file)
    terms = terms_of(loaded)
    removable = [term for term in terms if term.remove is not None]
    with progress() as bar, warnings.catch_warnings():
        # A scene that lacks a term may be stiff at this step; what becomes of it is shown as its error.
        warnings.simplefilter("ignore")
        task = bar.add_task("Terms", total=len(removable) + 2 + BATCHES)

        def tick() -> None:
            bar.advance(task)

        motion = driven_motion(loaded, episodes, TIME, seed)
        floor, errors = trajectory_errors(motion, removable, tick)
        whole, savings = step_costs(motion.tiled(TIMED), removable, seed, tick)
    console.print(loaded["name"], style="bold", markup=False)
    console.print()
    _print_costs(terms, whole, savings)
    if removable:
        _print_errors(removable, floor, errors)
        _print_choices(removable, whole, savings, floor, errors)
        _print_conditions(episodes, floor)
    else:
        say("Nothing of this scene can be left out.")
    if json_file is not None:
        write_json(
            json_file,
            {
                **circumstances("scenes explain", {"scene": scene, "episodes": episodes, "seed": seed}),
                "step": STEP,
                "ns_per_step": whole,
                "integration_error": _by_time(floor),
                "terms": [
                    {
                        "name": term.name,
                        "present": term.present,
                        "note": term.note,
                        "saved_ns_per_step": savings.get(term.name, None),
                        "median_error_without": _by_time(errors[term.name]) if term.name in errors else None,
                    }
                    for term in terms
                ],
            },
        )


def without_term(motion: Motion, term: Term) -> Motion:
    """Give the same start and drive to the scene that lacks the term."""
    assert term.remove is not None
    start = motion.start
    if term.name in (CURRENT, ALL):
        start = start | {"current": np.zeros_like(start["current"])}
    return motion._replace(scene=edited(motion.scene, term.remove), start=start)


def trajectory_errors(motion: Motion, terms: list[Term], tick: Callable[[], None]) -> tuple[Floats, dict[str, Floats]]:
    """Find how far the motion goes astray without each term: medians (times, quantities), infinite where it is lost.

    Beside them the error of the integration itself, by half the step.
    """
    samples = round(TIME / TELL[0])
    rows = [round(t / TELL[0]) - 1 for t in TELL]

    def end(motion: Motion, step: float) -> tuple[Floats, Floats, Floats]:
        track = follow(motion, {"dt": step}, samples)
        tick()
        return track.position[rows], track.rotation[rows], track.end_effector[rows]

    truth = end(motion, STEP)
    floor = _distance(truth, end(motion, 0.5 * STEP))
    return floor, {term.name: _distance(truth, end(without_term(motion, term), STEP)) for term in terms}


def _distance(a: tuple[Floats, Floats, Floats], b: tuple[Floats, Floats, Floats]) -> Floats:
    """Medians over instances of |position|, angle and |end effector| between two runs, (times, 3)."""
    with np.errstate(invalid="ignore"):
        chord = np.linalg.norm(a[1] - b[1], axis=(-2, -1)) / math.sqrt(8.0)
        parts = (
            np.linalg.norm(a[0] - b[0], axis=-1),
            2.0 * np.arcsin(np.minimum(chord, 1.0)),
            np.linalg.norm(a[2] - b[2], axis=-1),
        )
    lost = [np.where(np.isfinite(part), part, np.inf) for part in parts]
    return np.stack([np.median(part, axis=-1) for part in lost], axis=-1)


def step_costs(
    motion: Motion, terms: list[Term], seed: int, tick: Callable[[], None]
) -> tuple[float, dict[str, Saving]]:
    """Measure ns per MK4 step and instance of the whole scene, and what the lack of each term saves of it.

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
            # The old ones live until all new ones do, so that these lie elsewhere.
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
    """Time of a step of one instance at the start of the motion, ns, as the clock of this thread alone has it."""
    simulator.set_state(**motion.start)
    begin = time.thread_time_ns()
    simulator.step(**motion.inputs(0), substeps=TIMED_STEPS)
    return (time.thread_time_ns() - begin) / (TIMED_STEPS * TIMED)


def _half_width(sample: Floats) -> float:
    """Half the width of the interval of a median, by order statistics: a few disturbed batches do not widen it."""
    ordered = np.sort(sample)
    middle = len(ordered) // 2
    reach = min(math.ceil(0.5 * DEVIATIONS * math.sqrt(len(ordered))), middle)
    return float(max(ordered[middle + reach] - ordered[middle], ordered[middle] - ordered[middle - reach]))


def _by_time(errors: Floats) -> dict[str, dict[str, float]]:
    return {f"{t:g} s": dict(zip(QUANTITIES, row.tolist(), strict=True)) for t, row in zip(TELL, errors, strict=True)}


def _share(saving: Saving, whole: float) -> str:
    if saving.stands_out:
        return f"{100.0 * saving.value / whole:.1f} %"
    return f"< {100.0 * saving.noise / whole:.1f} %"


def _error(error: float, floor: float) -> str:
    """Write an error; zero only where not one bit differs."""
    if error == 0.0:
        return "0"
    if not math.isfinite(error):
        return "lost"
    return f"{error:.2g}" if error > STANDS_OUT * floor else f"< {STANDS_OUT * floor:.0e}"


def _print_costs(terms: list[Term], whole: float, savings: dict[str, Saving]) -> None:
    def row(term: Term) -> tuple[str, ...]:
        mark = "yes" if term.present else "no"
        if term.name not in savings:
            return term.name, mark, "-", "-"
        saving = savings[term.name]
        value = f"{saving.value:.1f} ± {saving.noise:.1f}" if saving.stands_out else f"< {saving.noise:.1f}"
        return term.name, mark, value, _share(saving, whole)

    title = f"Terms, and what a step of {whole:.0f} ns per instance saves without each"
    table(title, ("term", "in the scene", "saves ns", "of the step"), [row(term) for term in terms])
    notes: dict[str, list[str]] = {}
    for term in terms:
        if term.note:
            notes.setdefault(term.note, []).append(term.name)
    for note, names in notes.items():
        say(f"{', '.join(names)}: {note}.")


def _print_errors(terms: list[Term], floor: Floats, errors: dict[str, Floats]) -> None:
    header = ("left out", *(unit for t in TELL for unit in (f"{t:g} s: m", "rad", "tip m")))
    rows = [
        (term.name, *(_error(error, least) for error, least in zip(errors[term.name].flat, floor.flat, strict=True)))
        for term in terms
    ]
    table("Error of leaving it out: position, attitude, end effector (tip)", header, rows)


def _print_choices(
    terms: list[Term], whole: float, savings: dict[str, Saving], floor: Floats, errors: dict[str, Floats]
) -> None:
    def verdict(term: Term) -> str:
        saving, error = savings[term.name], errors[term.name][-1]
        if not saving.stands_out:
            return "keep: no saving seen"
        if saving.value < 0.0:
            return "keep: slower without it"
        if not error.any():
            return "no effect in such motions"
        if (error < list(SMALL.values())).all():
            return "may go: under 1 mm and 1 mrad"
        return "a trade"

    ordered = sorted(terms, key=lambda term: float(errors[term.name][-1, -1]))
    rows = [
        (term.name, verdict(term), _share(savings[term.name], whole), _error(errors[term.name][-1, -1], floor[-1, -1]))
        for term in ordered
    ]
    table(
        f"What to do, by the end effector's error after {TIME:g} s", ("left out", "verdict", "saves", "tip m"), rows, 2
    )


def _print_conditions(episodes: int, floor: Floats) -> None:
    say(
        f"Errors are medians over {episodes} motions of {TIME:g} s with random starts, wrenches, joint references and "
        f"currents up to {CURRENT_SPEED:g} m/s, driven open loop: a controller would hide part of them. The steps of "
        f"{STEP:g} s themselves err by {floor[-1, 0]:.0e} m, {floor[-1, 1]:.0e} rad and {floor[-1, 2]:.0e} m at the "
        f"end; '<' is what does not stand out {STANDS_OUT:g}-fold from that, '0' is no bit of difference. Costs are of "
        f"MK4 steps in double precision, {TIMED} instances on one thread of this machine: medians of {BATCHES} batches "
        f"of interleaved rounds, with intervals of {DEVIATIONS:g} standard deviations; '<' is what noise can make. "
        "Savings and errors of single terms do not add up. All of it is as good as the scene's numbers, whose sources "
        "`uvms scenes show` tells."
    )
