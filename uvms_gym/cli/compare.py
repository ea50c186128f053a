"""`uvms compare`: controllers over the same seeded episodes."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import typer

from uvms_gym.cli import compare_plots, compare_report
from uvms_gym.cli.common import (
    Json,
    Out,
    check_range,
    circumstances,
    console,
    fail,
    prepare,
    progress,
    say,
    write_json,
)
from uvms_gym.cli.compare_cells import CONDITIONS, DESIGN, Cell, cells
from uvms_gym.cli.compare_runs import Entrant, enter, make, run
from uvms_gym.cli.compare_summary import KEPT, Summary, summarise
from uvms_gym.cli.scenes import read_scene
from uvms_gym.cli.statistics import CONFIDENCE, RESAMPLES
from uvms_gym.controllers import registry

#: Most episodes of one run, so that a slip of the keyboard does not ask for all memory.
MOST_EPISODES = 100_000
#: Greatest speed of the current that can be asked for, m/s.
MOST_CURRENT = 10.0
#: What is printed where there is no policy.
NO_POLICY = "no policy"
KNOWN = f"{', '.join(registry.NAMES)}, {registry.MLP_PREFIX}FILE"
#: By how much stored numbers may differ from those of another machine, relatively.
TOLERANCE = 1e-4


class Contest(NamedTuple):
    """A cell with those who take part, and why others do not."""

    cell: Cell
    entrants: dict[str, Entrant]
    missing: dict[str, str]


def compare(
    env: Annotated[
        list[str] | None,
        typer.Option(help="Environment, by Gymnasium's id; may be repeated. [default: UVMS-StationKeep-Storm-v0]"),
    ] = None,
    scene: Annotated[
        list[str] | None,
        typer.Option(help="Scene: name or TOML file; may be repeated. [default: petasus-pum]"),
    ] = None,
    controllers: Annotated[
        str | None,
        typer.Option(help=f"Any of {KNOWN}, separated by commas. [default: all that there is all for]"),
    ] = None,
    episodes: Annotated[
        int, typer.Option(help=f"Episodes of each controller in each cell, 2 to {MOST_EPISODES}.")
    ] = 1024,
    seed: Annotated[int, typer.Option(help="Episode i has the seed SEED + i.")] = 0,
    cell: Annotated[
        list[str] | None,
        typer.Option(help=f"Conditions; may be repeated. Any of {', '.join(CONDITIONS)}. [default: {DESIGN}]"),
    ] = None,
    off_design: Annotated[bool, typer.Option("--off-design", help="All conditions.")] = False,
    disturbance: Annotated[
        list[str] | None,
        typer.Option(
            help="Level of disturbances, such as storm, in place of the environment's; may be repeated. "
            "`uvms disturbances` lists them."
        ),
    ] = None,
    current: Annotated[
        float | None,
        typer.Option(
            help=f"Greatest speed of the drawn current where nothing else disturbs, 0 to {MOST_CURRENT:g} m/s."
        ),
    ] = None,
    action: Annotated[Literal["wrench", "thrusters"], typer.Option(help="What controllers command.")] = "wrench",
    check: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Instead of all this, run again what a compare.json or results.json holds."),
    ] = None,
    out: Out = Path("out/compare"),
    json_file: Json = None,
) -> None:
    """Compare controllers over paired seeded episodes.

    Prints interquartile means with 95 % intervals, and writes pictures, compare.json and scores.npz to --out.
    """
    if check is not None:
        _check(check)
        return
    check_range("--episodes", episodes, 2, MOST_EPISODES)
    check_range("--seed", seed, 0, math.inf)
    envs, scenes = env or ["UVMS-StationKeep-Storm-v0"], scene or ["petasus-pum"]
    conditions = list(CONDITIONS) if off_design else (cell or [DESIGN])
    levels = disturbance or []
    for option, given in (("env", envs), ("scene", scenes), ("cell", conditions), ("disturbance", levels)):
        for name in given:
            if given.count(name) > 1:
                raise fail(f"{option} {name!r} is given twice")
    arguments: dict[str, Any] = {"action": action}
    if current is not None:
        check_range("--current", current, 0.0, MOST_CURRENT)
        arguments["max_current"] = current
    asked = None if controllers is None else _names(controllers)
    found = cells(envs, scenes, {name: read_scene(name) for name in scenes}, levels, conditions, arguments)
    contests = _contests(found, asked)
    several = len(contests) > len({contest.cell.group for contest in contests})
    pictures = ["compare.png", "profiles.png", *(["off-design.png"] if several else [])]
    files = ["compare.json", "scores.npz", *pictures]
    prepare(out, json_file, files)
    with progress() as bar:
        work = sum(len(e.controllers) * c.cell.steps for c in contests for e in c.entrants.values())
        task = bar.add_task("comparing", total=work)

        def tick(steps: int) -> None:
            bar.advance(task, steps)

        scores: dict[str, Any] = {}
        summaries = []
        for contest in contests:
            bar.update(task, description=contest.cell.label)
            summaries.append(_settle(contest, episodes, seed, scores, tick))
        bar.update(task, description="pictures")
        _draw(out, contests, summaries, several)
    _print(contests, summaries)
    data = {
        "circumstances": circumstances(
            "compare",
            {
                "env": envs,
                "scene": scenes,
                "controllers": asked,
                "episodes": episodes,
                "seed": seed,
                "cell": conditions,
                "disturbance": levels,
                **arguments,
            },
        ),
        "statistics": {"resamples": RESAMPLES, "confidence": CONFIDENCE, "seed": seed},
        "results": [_stored(contest, summary) for contest, summary in zip(contests, summaries, strict=True)],
    }
    for path in {out / "compare.json", json_file or out / "compare.json"}:
        write_json(path, data)
    try:
        np.savez(out / "scores.npz", **scores)
    except OSError as error:
        raise fail(f"cannot write {out / 'scores.npz'}: {error.strerror}") from None
    console.print(f"{out}: {', '.join(files)}", markup=False, soft_wrap=True)


def reproduce(path: Path, full: bool = False, tolerance: float = TOLERANCE) -> list[str]:
    """Run again what stored results are of, and tell where they differ, a line each.

    Parameters
    ----------
    path : Path
        A compare.json, or the results.json of shipped policies.
    full : bool
        Compare all statistics over all episodes, not only the scores of the first episodes one by one.
    tolerance : float
        Relative difference that is none.

    Raises
    ------
    TyperException
        The file cannot be read or holds no results, or a controller is no longer there.
    """
    differences = []
    for stored, contest, seed in _read(path):
        for name in stored["controllers"]:
            if name in contest.missing:
                differences.append(f"{contest.cell.name}, {name}: {contest.missing[name]}")
        any_of = next(iter(stored["controllers"].values()))
        episodes = any_of["episodes"] if full else min(any_of["episodes"], KEPT)
        batch = make(contest.cell, episodes)
        runs = {name: run(batch, contest.cell, entrant, seed) for name, entrant in contest.entrants.items()}
        batch.close()
        pairs: dict[str, tuple[Any, Any]] = {}
        for name, scored in runs.items():
            for metric, rows in stored["controllers"][name]["kept"].items():
                pairs[f"{name}, {metric}"] = rows, scored.scores[metric]["whole"][:, :KEPT]
        if full:
            summary = summarise(contest.entrants, runs, seed)
            for name, entry in summary.controllers.items():
                for metric, parts in entry["metrics"].items():
                    for part, estimates in parts.items():
                        for kind, estimate in estimates.items():
                            told = stored["controllers"][name]["metrics"][metric][part][kind]["value"]
                            pairs[f"{name}, {metric}, {part}, {kind}"] = told, estimate.value
        for what, (told, seen) in pairs.items():
            told, seen = np.asarray(told, dtype=np.float64), np.asarray(seen)
            if told.shape != seen.shape:
                differences.append(f"{contest.cell.name}, {what}: shape {told.shape} is stored, {seen.shape} found")
            elif not np.allclose(seen, told, rtol=tolerance, atol=1e-9):
                worst = np.unravel_index(np.argmax(np.abs(seen - told)), told.shape)
                differences.append(f"{contest.cell.name}, {what}: {told[worst]:.9g} is stored, {seen[worst]:.9g} found")
    return differences


def _read(path: Path) -> list[tuple[dict[str, Any], Contest, int]]:
    """Read stored results, each with what takes part and the first episode's seed."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        arguments, results = data["circumstances"]["arguments"], data["results"]
        given = {name: arguments[name] for name in ("action", "max_current") if name in arguments}
        found = []
        for stored in results:
            scene, level = stored["scene"], stored["disturbance"]
            levels = [] if level is None else [level]
            (cell,) = cells([stored["env"]], [scene], {scene: read_scene(scene)}, levels, [stored["condition"]], given)
            found.append((stored, _contest(cell, list(stored["controllers"]), False), int(arguments["seed"])))
    except OSError as error:
        raise fail(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise fail(f"{path} holds no results of uvms compare: {type(error).__name__}: {error}") from None
    return found


def _check(path: Path) -> None:
    differences = reproduce(path, full=True)
    for line in differences:
        console.print(line, markup=False, soft_wrap=True)
    if differences:
        raise fail(f"{path}: {len(differences)} numbers are not reproduced to {TOLERANCE:g}")
    console.print(f"{path}: all numbers are reproduced to {TOLERANCE:g}", markup=False, soft_wrap=True)


def _names(given: str) -> list[str]:
    names = [name.strip() for name in given.split(",") if name.strip()]
    if not names:
        raise fail(f"no controllers given; known: {KNOWN}")
    for name in names:
        if name not in registry.NAMES and not name.startswith(registry.MLP_PREFIX):
            raise fail(f"unknown controller {name!r}; known: {KNOWN}")
        if names.count(name) > 1:
            raise fail(f"controller {name!r} is given twice")
    return names


def _contests(found: Sequence[Cell], asked: list[str] | None) -> list[Contest]:
    """Make the controllers of all cells, before anything is computed."""
    for name in asked or ():
        # Other tasks may be compared along; one has to be its own.
        try:
            if not any(_suits(name, cell) for cell in found):
                registry.check_name(name, found[0].designed["task"])
        except ValueError as error:
            raise fail(str(error)) from None
    contests = []
    for cell in found:
        names = registry.names(cell.designed["task"]) if asked is None else [n for n in asked if _suits(n, cell)]
        contests.append(_contest(cell, names, asked is not None))
    return contests


def _suits(name: str, cell: Cell) -> bool:
    return name in registry.names(cell.designed["task"]) or name.startswith(registry.MLP_PREFIX)


def _contest(cell: Cell, names: Sequence[str], asked: bool) -> Contest:
    """Make the controllers of a cell; without a policy a controller is missing or, if it was asked for, an error."""
    entrants, missing = {}, {}
    for name in names:
        try:
            entrants[name] = enter(cell, name)
        except registry.Unavailable as error:
            if asked:
                raise fail(str(error)) from None
            missing[name] = NO_POLICY
    if not entrants:
        raise fail(f"{cell.name}: there is no controller for it")
    return Contest(cell, entrants, missing)


def _settle(
    contest: Contest, episodes: int, seed: int, scores: dict[str, Any], tick: Callable[[int], object]
) -> Summary:
    """Run a cell; notes all scores by cell, controller, metric and part."""
    batch = make(contest.cell, episodes)
    runs = {}
    for name, entrant in contest.entrants.items():
        runs[name] = run(batch, contest.cell, entrant, seed, tick)
        for metric, parts in runs[name].scores.items():
            for part, matrix in parts.items():
                scores["/".join((contest.cell.name, name, metric, part))] = matrix
    batch.close()
    return summarise(contest.entrants, runs, seed)


def _groups(
    contests: Sequence[Contest], summaries: Sequence[Summary]
) -> dict[str, tuple[list[Cell], list[Summary], list[Mapping[str, str]]]]:
    """Cells with their summaries and who is missing, by environment and scene."""
    groups: dict[str, tuple[list[Cell], list[Summary], list[Mapping[str, str]]]] = {}
    for contest, summary in zip(contests, summaries, strict=True):
        members = groups.setdefault(contest.cell.group, ([], [], []))
        for member, value in zip(members, (contest.cell, summary, contest.missing), strict=True):
            member.append(value)  # type: ignore[attr-defined]
    return groups


def _draw(out: Path, contests: Sequence[Contest], summaries: Sequence[Summary], several: bool) -> None:
    groups = _groups(contests, summaries)
    firsts = [(cells[0], of[0]) for cells, of, _ in groups.values()]
    compare_plots.bars(out / "compare.png", [cell for cell, _ in firsts], [summary for _, summary in firsts])
    compare_plots.profiles(out / "profiles.png", [contest.cell for contest in contests], summaries)
    if several:
        compare_plots.heat(out / "off-design.png", groups)


def _print(contests: Sequence[Contest], summaries: Sequence[Summary]) -> None:
    for group, (members, of, missing) in _groups(contests, summaries).items():
        compare_report.detail(members[0], of[0], missing[0])
        if len(members) > 1:
            compare_report.across(group, members, of, missing)
    say(compare_report.NOTES)


def _stored(contest: Contest, summary: Summary) -> dict[str, Any]:
    cell = contest.cell
    profiles: Mapping[str, Any] = summary.profiles
    return {
        "env": cell.env,
        "scene": cell.scene,
        "disturbance": cell.level,
        "condition": cell.condition,
        "summary": CONDITIONS[cell.condition].summary,
        "options": {key: value for key, value in cell.options.items() if key != "scene"},
        "steps": cell.steps,
        "baseline": summary.baseline,
        "winner": summary.winner,
        "runner_up": summary.runner_up,
        "margin": summary.margin,
        "controllers": summary.controllers,
        "missing": contest.missing,
        "against": summary.against,
        "profiles": {"thresholds": summary.thresholds, **profiles},
    }
