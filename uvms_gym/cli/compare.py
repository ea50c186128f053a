"""`uvms compare`: controllers over the same seeded episodes; `uvms verify`: stored comparisons once more."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from typer import Argument, Option

from uvms_gym._files import replacing
from uvms_gym.cli import compare_report
from uvms_gym.cli.common import check_list, fail, line, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import (
    EnvKwargs,
    Integrator,
    PeriodStep,
    check_environment,
    environment_arguments,
    with_step,
)
from uvms_gym.cli.options import CONTROLLER_HELP, Json, Out, Policies, ranged, several
from uvms_gym.cli.output import name_files, say, write_results
from uvms_gym.controllers.families import canonical
from uvms_gym.studies.comparison import plots
from uvms_gym.studies.comparison.conditions import DEPARTURES, DESIGN, make_conditions
from uvms_gym.studies.comparison.scoreboard import read_entries
from uvms_gym.studies.comparison.study import STORED, as_document, make_comparisons, run_all, scores_by_name
from uvms_gym.studies.comparison.summary import summarise
from uvms_gym.studies.comparison.unfinished import Unfinished
from uvms_gym.studies.comparison.verification import MAX_CURRENT, MAX_EPISODES, TOLERANCE
from uvms_gym.studies.comparison.verification import verify as make_again
from uvms_gym.studies.records import circumstances


def compare(
    env: Annotated[list[str] | None, several("Environment, by Gymnasium's id", "UVMS-StationKeep-Storm-v0")] = None,
    scene: Annotated[list[str] | None, several("Scene: name or TOML file", "the environment's, petasus-pum")] = None,
    env_kwargs: EnvKwargs = None,
    integrator: Integrator = None,
    dt: PeriodStep = None,
    controller: Annotated[list[str] | None, several(CONTROLLER_HELP, "every available controller")] = None,
    policies: Policies = None,
    episodes: Annotated[
        int, ranged(f"Episodes of each controller under each condition, 2 to {MAX_EPISODES}.", 2, MAX_EPISODES)
    ] = 1024,
    seed: Annotated[int, ranged("Episode i has the seed SEED + i.", 0)] = 0,
    condition: Annotated[list[str] | None, several(f"One of {', '.join(DEPARTURES)}", DESIGN)] = None,
    off_design: Annotated[bool, Option("--off-design", help="All conditions.")] = False,
    frontier: Annotated[
        bool,
        Option(
            "--frontier",
            help="Also settings along the frontier, and bounds; draws errors against variation and effort.",
        ),
    ] = False,
    disturbance: Annotated[
        list[str] | None,
        several("Level of disturbances, such as storm; `uvms disturbances` lists them", "the environment's"),
    ] = None,
    current: Annotated[
        float | None,
        ranged(
            f"Maximum speed of the random current without a disturbance, 0 to {MAX_CURRENT:g} m/s. "
            "[default: the environment's]",
            0.0,
            MAX_CURRENT,
        ),
    ] = None,
    action: Annotated[
        Literal["wrench", "thrusters"] | None, Option(help="Commanded quantity of controllers. [default: wrench]")
    ] = None,
    out: Out = Path("out/compare"),
    json_file: Json = None,
) -> None:
    """Compare controllers over paired seeded episodes.

    Prints interquartile means with 95 % intervals, and writes pictures, compare.json and scores.npz to --out. A stopped
    run keeps its finished controllers in --out; the same command goes on with the others.
    """
    with user_errors():
        controller = [canonical(name) for name in controller or ()]
    envs = check_list("env", env, ["UVMS-StationKeep-Storm-v0"])
    named = {"scene": scene, "disturbance": disturbance, "max_current": current, "action": action}
    arguments = with_step(environment_arguments(env_kwargs, integrator=integrator, **named), dt, envs)
    scenes = check_list("scene", _names(arguments, "scene"), ["petasus-pum"])
    levels = check_list("disturbance", _names(arguments, "disturbance"), [])
    options = {"action": "wrench", **{key: arguments.pop(key) for key in STORED if key in arguments}}
    given: dict[str, Any] = {
        "env": envs,
        "scene": scenes,
        # Scores do not depend on the reward.
        "env_kwargs": {key: value for key, value in arguments.items() if key != "reward"},
        "controllers": check_list("controller", controller, []) or None,
        "episodes": episodes,
        "seed": seed,
        "condition": list(DEPARTURES) if off_design else check_list("condition", condition, [DESIGN]),
        "disturbance": levels,
    }
    for name in given["env"]:
        check_environment(name)
    loaded = {name: read_scene(name) for name in scenes}
    with user_errors():
        conditions = make_conditions(given["env"], loaded, levels, given["condition"], **options, **arguments)
        comparisons = make_comparisons(conditions, given["controllers"], frontier)
    # By name, also where all are asked for: later versions have more.
    given["controllers"] = list(dict.fromkeys(name for one in comparisons for name in (*one.contenders, *one.missing)))
    departing = len(comparisons) > len({comparison.condition.group for comparison in comparisons})
    pictures = [*(["off-design.png"] if departing else []), *(["frontier.png"] if frontier else [])]
    files = ("compare.json", "scores.npz", "compare.png", "profiles.png", *pictures)
    prepare(out, json_file, files)
    with user_errors(verb="write"):
        unfinished = Unfinished(out, given | options, comparisons)
    scores: dict[str, Any] = {}
    results = []
    with progress() as bar, notice_of_kept(unfinished):
        work = sum(comparison.work for comparison in comparisons)
        task = bar.add_task("comparing", total=work)
        for number, comparison in enumerate(comparisons):
            bar.update(task, description=comparison.condition.label)
            with user_errors(f"{comparison.condition.env}: "):
                kept = unfinished.of(number, comparison)
                runs = run_all(comparison, episodes, seed, lambda steps: bar.advance(task, steps), kept)
            scores |= scores_by_name(comparison, runs)
            results.append((comparison, summarise(comparison.contenders, runs, seed)))
        with user_errors(verb="write"), replacing(out / "scores.npz") as file:
            np.savez(file, **scores)
        write_results(out, files, json_file, as_document(circumstances("compare", given | options), seed, results))
        bar.update(task, description="pictures")
        groups: dict[str, list[Any]] = {}
        for result in results:
            groups.setdefault(result[0].condition.group, []).append(result)
        with user_errors(verb="write"):
            plots.plot_bars(out / "compare.png", [members[0] for members in groups.values()])
            plots.plot_profiles(out / "profiles.png", results)
            if frontier:
                first = {members[0][0].condition.name: members[0][1].controllers for members in groups.values()}
                plots.plot_frontier(out / "frontier.png", first)
            if departing:
                plots.plot_departures(out / "off-design.png", groups)
            unfinished.remove()
    for group, members in groups.items():
        compare_report.print_detail(*members[0])
        if len(members) > 1:
            compare_report.print_across(group, members)
    say(compare_report.NOTES)
    name_files(out, files)


@contextmanager
def notice_of_kept(unfinished: Unfinished) -> Iterator[None]:
    """Say on an interruption that finished controllers are kept."""
    try:
        yield
    except KeyboardInterrupt:
        if notice := unfinished.notice:
            print(notice, file=sys.stderr)
        raise


def _names(arguments: dict[str, Any], key: str) -> list[str]:
    """Remove an argument that is a name or a list of them; a dictionary of components stays."""
    if isinstance(arguments.get(key), dict):
        return []
    value = arguments.pop(key, [])
    names = value if isinstance(value, list) else [value]
    if wrong := next((name for name in names if not isinstance(name, str)), None):
        raise fail(f"{key} is {wrong!r}, but must be a name")
    return names


def verify(
    file: Annotated[Path, Argument(metavar="FILE", help="A compare.json, or the results.json of policies.")],
    scoreboard: Annotated[
        bool, Option("--scoreboard", help="Refuse a file that does not follow the rule of the scoreboard.")
    ] = False,
    run_code: Annotated[
        bool, Option("--run-code", help="Run the code of controllers that the file names as py:FILE.py:NAME.")
    ] = False,
    policies: Policies = None,
) -> None:
    """Make a stored comparison again, and report every entry that differs; the exit status is 2 if there are any.

    Files of its controllers are looked up in the working folder. Controllers whose policies are missing are not
    checked, and named.
    """
    with user_errors():
        if scoreboard:
            read_entries(file)
        differences, unchecked = make_again(file, full=True, run_code=run_code)
    for text in (*unchecked, *differences):
        line(text)
    if differences:
        raise fail(f"{file}: entries that are not reproduced: {len(differences)} (numbers: to {TOLERANCE:g})")
    if unchecked and scoreboard:
        raise fail(f"{file}: controllers that are not checked: {len(unchecked)}")
    line(
        f"{file}: all {'other ' * bool(unchecked)}entries are reproduced, numbers to {TOLERANCE:g}; records of the run "
        "(time, versions, commit, machine) are checked for their form only"
    )
