"""`uvms scenes explain`: cost of each modelled term, and error without it."""

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from uvms_gym.cli.common import console, fail, prepare, progress, read_scene, user_errors
from uvms_gym.cli.contact_tables import show_contact
from uvms_gym.cli.environments import Integrator, stating_integration
from uvms_gym.cli.options import Json, SceneArgument, ranged
from uvms_gym.cli.output import say, table, write_json
from uvms_gym.studies.accuracy.driven_motion import CURRENT, PERIOD
from uvms_gym.studies.accuracy.episodes import divides
from uvms_gym.studies.records import circumstances
from uvms_gym.studies.terms import ablation
from uvms_gym.studies.terms.ablation import INSTANTS, STEP, TIME, Ablation, Saving
from uvms_gym.studies.terms.scene_terms import Term

MOST_EPISODES = 10_000
#: Minimum significant error, over the error of the integration.
SIGNIFICANT = 10.0
#: Errors at the end of the motion below which a term may be removed: m, rad, m.
SMALL = (1e-3, 1e-3, 1e-3)


def explain(
    scene: SceneArgument,
    episodes: Annotated[int, ranged(f"Motions of the ensemble, 1 to {MOST_EPISODES}.", 1, MOST_EPISODES)] = 64,
    seed: Annotated[int, ranged("Seed of the ensemble.", 0)] = 0,
    integrator: Integrator = None,
    dt: Annotated[
        float | None,
        ranged(f"Step, s, that divides {PERIOD:g} s. [default: the scene's, at most {STEP:g}]", 1e-4, PERIOD, "--dt"),
    ] = None,
    json_file: Json = None,
) -> None:
    """Measure the cost of each modelled term per step, and the error without it.

    Takes about ten seconds on this machine: terms are removed from the scene one at a time.
    """
    loaded = stating_integration(read_scene(scene), integrator, None)
    if dt is not None and not divides(dt, PERIOD):
        raise fail(f"--dt is {dt:g}, but must divide {PERIOD:g} s")
    prepare(None, json_file)
    with progress(), user_errors(f"{scene}: "):
        found = ablation.ablate(loaded, episodes, seed, dt)
    console.print(loaded["name"], style="bold", markup=False)
    console.print()
    show_contact(loaded)
    _print_costs(found)
    if found.removable:
        _print_errors(found)
        _print_choices(found)
        _print_conditions(episodes, found)
    else:
        say("No term of this scene can be removed.")
    if json_file is not None:
        arguments = {"scene": scene, "episodes": episodes, "seed": seed, "integrator": integrator, "dt": dt}
        write_json(json_file, circumstances("scenes explain", arguments) | found.as_data())


def _share(saving: Saving, whole: float) -> str:
    if saving.significant:
        return f"{100.0 * saving.value / whole:.1f} %"
    return f"< {100.0 * saving.noise / whole:.1f} %"


def _error(error: float, floor: float) -> str:
    """Write an error; zero only without a difference of one bit."""
    if error == 0.0:
        return "0"
    if not math.isfinite(error):
        return "not finite"
    return f"{error:.2g}" if error > SIGNIFICANT * floor else f"< {SIGNIFICANT * floor:.0e}"


def _print_costs(found: Ablation) -> None:
    def row(term: Term) -> tuple[str, ...]:
        mark = "yes" if term.present else "no"
        if term.name not in found.savings:
            return term.name, mark, "-", "-"
        saving = found.savings[term.name]
        value = f"{saving.value:.1f} ± {saving.noise:.1f}" if saving.significant else f"< {saving.noise:.1f}"
        return term.name, mark, value, _share(saving, found.step_cost)

    title = f"Terms, and savings of a step of {found.step_cost:.0f} ns per instance without each"
    table(title, ("term", "in the scene", "saves ns", "of the step"), [row(term) for term in found.terms])
    notes: dict[str, list[str]] = {}
    for term in found.terms:
        if term.note:
            notes.setdefault(term.note, []).append(term.name)
    for note, names in notes.items():
        say(f"{', '.join(names)}: {note}.")


def _print_errors(found: Ablation) -> None:
    header = ("removed", *(unit for t in INSTANTS for unit in (f"{t:g} s: m", "rad", "tip m")))
    rows = [
        (term.name, *(_error(*pair) for pair in zip(errors.flat, found.integration_error.flat, strict=True)))
        for term in found.removable
        for errors in (found.errors[term.name],)
    ]
    table("Error without each term: position, attitude, end effector (tip)", header, rows)


def _verdict(saving: Saving, errors: NDArray[np.float64]) -> str:
    if not saving.significant:
        return "keep: no measurable saving"
    if saving.value < 0.0:
        return "keep: slower without it"
    if not errors.any():
        return "no effect in these motions"
    return "removable: under 1 mm and 1 mrad" if (errors < SMALL).all() else "a trade-off"


def _print_choices(found: Ablation) -> None:
    rows = []
    for term in sorted(found.removable, key=lambda term: float(found.errors[term.name][-1, -1])):
        saving, errors = found.savings[term.name], found.errors[term.name][-1]
        tip = _error(errors[-1], found.integration_error[-1, -1])
        rows.append((term.name, _verdict(saving, errors), _share(saving, found.step_cost), tip))
    title = f"Recommendations, by the end effector's error after {TIME:g} s"
    table(title, ("removed", "recommendation", "saves", "tip m"), rows, 2)


def _print_conditions(episodes: int, found: Ablation) -> None:
    position, attitude, tip = found.integration_error[-1]
    say(
        f"Errors are medians over {episodes} motions of {TIME:g} s with random starts, wrenches, joint references and "
        f"currents up to {CURRENT:g} m/s, in open loop: a controller would reduce them. Integration errors at the step "
        f"of {found.step:g} s are {position:.0e} m, {attitude:.0e} rad and {tip:.0e} m at the end; '<': below "
        f"{SIGNIFICANT:g} times that, '0': not one bit of difference. Costs are of {found.integrator} steps in double "
        f"precision, {ablation.TIMED} instances on one thread of this machine: medians of {ablation.BATCHES} batches "
        f"of interleaved rounds, with intervals of {ablation.DEVIATIONS:g} standard deviations; '<': within noise. "
        "Savings and errors of single terms do not add up. All depend on the scene's numbers; `uvms scenes show` lists "
        "their sources."
    )
