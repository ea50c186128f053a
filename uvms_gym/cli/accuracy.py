"""`uvms accuracy`: error against cost of every integrator, step and precision, and what follows from it."""

import math
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import uvms_gym
from uvms_gym.cli import conservation, work_precision
from uvms_gym.cli.accuracy_plots import drift_picture, work_precision_picture
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
    table,
    write_json,
)
from uvms_gym.cli.hard.report import run_hard
from uvms_gym.cli.motion import CURRENT, LEAD, PERIOD
from uvms_gym.cli.scenes import read_scene
from uvms_gym.cli.work_precision import PRECISIONS, Setting, at_cost, find

FILES = ("accuracy.json", "accuracy.png", "drift.png")
EPISODES, MOST_EPISODES, MOST_TIME = 64, 10_000, 1000.0
#: Steps that the reference is much finer than, and tolerances that single digits of a double allow.
LEAST_STEP, LEAST_TOLERANCE, MOST_TOLERANCE = 5e-4, 1e-11, 0.1
#: Episodes, time and steps of a quick look.
QUICK_EPISODES, QUICK_TIME, QUICK_REPEATS = 16, 2.0, 3
QUICK_STEPS, QUICK_TOLERANCES = (0.005, 0.01, 0.02, 0.05), (1e-4, 1e-6, 1e-8)
#: The step that bars and comparison are stated for, s, and the time and scene they are stated for.
STEP, TIME, SCENE = 0.01, 10.0, "petasus-pum"
#: Greatest median errors of MK4 at the end effector, m; least ratio of the rival's error; greatest slip of an order.
BARS, LEAST_RATIO, MOST_SLIP = {"f64": 1e-7, "f32": 1e-5}, 1000.0, 0.2
RIVAL = "semi-implicit-euler"
#: Steps and episodes that orders without kinks are taken from.
SMOOTH_STEPS, SMOOTH_EPISODES = (0.002, 0.005, 0.01, 0.02), 16


def accuracy(
    scene: Annotated[
        list[str] | None, typer.Option(help="Scene: name or TOML file; may be repeated. Without it: all shipped ones.")
    ] = None,
    integrator: Annotated[
        list[str] | None, typer.Option(help="Integrator; may be repeated. Without it: all of them.")
    ] = None,
    step: Annotated[
        list[float] | None,
        typer.Option(help=f"Step, s, that divides {PERIOD:g} s; may be repeated. Without it: 0.001 to 0.1."),
    ] = None,
    tolerance: Annotated[
        list[float] | None,
        typer.Option(help="Tolerance of the adaptive method; may be repeated. Without it: 1e-3 to 1e-10."),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option("--time", help=f"Simulated time, s, a multiple of {PERIOD:g} s. Without it: {TIME:g}."),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option(help=f"Instances with their own start and drive, 2 to {MOST_EPISODES}. Without it: {EPISODES}."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of starts and drives. Without it: 0.")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer steps and instances, and 2 s of motion.")] = False,
    hard: Annotated[bool, typer.Option("--hard", help="Run the hard cases instead, at their own steps.")] = False,
    case: Annotated[
        list[str] | None, typer.Option(help="Part of a hard case's name; may be repeated. Without it: all of them.")
    ] = None,
    out: Out = Path("out/accuracy"),
    json_file: Json = None,
) -> int:
    """Measure error against cost of every integrator, step and precision over a driven motion.

    Prints tables and the recommended step of each scene, and writes two pictures and accuracy.json to --out.
    """
    if hard:
        if quick or not all(x is None for x in (scene, integrator, step, tolerance, seconds, episodes, seed)):
            raise fail("--hard takes no options but --case, --out and --json")
        return run_hard(out, json_file, case or ())
    if case:
        raise fail("--case is for --hard")
    arguments = _arguments(scene, integrator, step, tolerance, seconds, episodes, seed, quick)
    loaded = {name: read_scene(name) for name in arguments["scene"]}
    prepare(out, json_file, FILES)
    begun = time.perf_counter()
    results = _results(loaded, arguments, out)
    for name, result in results.items():
        _print(name, result, arguments)
    _print_summary(results)
    checks = bars(results, arguments["time"])
    if checks:
        rows = [(what, found, bar, "met" if met else "MISSED") for what, found, bar, met in checks]
        table("Bars", ("what", "found", "bar", ""), rows)
    spent = time.perf_counter() - begun
    console.print(f"{out}: {', '.join(FILES)} ({spent:.0f} s)", markup=False, soft_wrap=True)
    data = {
        "circumstances": circumstances("accuracy", arguments) | {"seconds": spent},
        "results": results,
        "bars": [dict(zip(("what", "found", "bar", "met"), check, strict=True)) for check in checks],
    }
    for path in {out / FILES[0], json_file or out / FILES[0]}:
        write_json(path, data)
    return 0


def bars(results: dict[str, Any], seconds: float) -> list[tuple[str, str, str, bool]]:
    """Set what was found against the bars, as far as this run can tell: what, found, bar, met."""
    checks = []
    for name, result in results.items():
        for precision, bar in BARS.items():
            row = find(result["rows"], "mk4", precision, STEP)
            if row is not None and seconds == TIME:
                error = row["end_effector"]["median"]
                what = f"{name}: MK4 {precision} at {STEP:g} s, median error at the end effector"
                checks.append((what, f"{error:.1e} m", f"{bar:g} m", error < bar))
        comparison = result["comparison"]
        if comparison is not None and name == SCENE and seconds == TIME:
            what = f"{name}: error of {RIVAL} at equal cost over MK4's at {STEP:g} s"
            checks.append((what, f"{comparison['ratio']:.2g}", f"{LEAST_RATIO:g}", comparison["ratio"] > LEAST_RATIO))
    known = work_precision.integrators()
    slips = [
        (abs(entry["order"] - known[method]["order"]), f"{method} {entry['order']:.2f}, {name}")
        for name, result in results.items()
        for method, entry in result["smooth_orders"].items()
    ]
    if slips:
        slip, where = max(slips)
        what = f"orders without quadratic drag, farthest from theory ({where})"
        checks.append((what, f"{slip:.2f}", f"{MOST_SLIP:g}", slip < MOST_SLIP))
    return checks


def _arguments(
    scene: Sequence[str] | None,
    integrator: Sequence[str] | None,
    step: Sequence[float] | None,
    tolerance: Sequence[float] | None,
    seconds: float | None,
    episodes: int | None,
    seed: int | None,
    quick: bool,
) -> dict[str, Any]:
    """Check options, and fill in defaults."""
    known = work_precision.integrators()
    for name in integrator or ():
        if name not in known:
            raise fail(f"unknown integrator {name!r}; known: {', '.join(known)}")
    for h in step or ():
        check_range("--step", h, LEAST_STEP, PERIOD)
        if not _divides(h, PERIOD):
            raise fail(f"--step is {h:g}, but must divide the control period of {PERIOD:g} s, as 0.02 or 0.05 do")
    for bound in tolerance or ():
        check_range("--tolerance", bound, LEAST_TOLERANCE, MOST_TOLERANCE)
    seconds = (QUICK_TIME if quick else TIME) if seconds is None else seconds
    check_range("--time", seconds, PERIOD, MOST_TIME)
    if not _divides(PERIOD, seconds):
        raise fail(f"--time is {seconds:g}, but must be a multiple of the control period of {PERIOD:g} s")
    episodes = (QUICK_EPISODES if quick else EPISODES) if episodes is None else episodes
    check_range("--episodes", episodes, 2, MOST_EPISODES)
    check_range("--seed", seed or 0, 0, math.inf)
    scenes = list(scene or uvms_gym.scenes())
    for name in scenes:
        if scenes.count(name) > 1:
            raise fail(f"scene {name!r} is given twice")
    return {
        "scene": scenes,
        "integrator": list(dict.fromkeys(integrator or known)),
        "step": sorted(set(step or (QUICK_STEPS if quick else work_precision.STEPS))),
        "tolerance": sorted(set(tolerance or (QUICK_TOLERANCES if quick else work_precision.TOLERANCES)), reverse=True),
        "time": seconds,
        "episodes": episodes,
        "seed": seed or 0,
        "repeats": QUICK_REPEATS if quick else work_precision.REPEATS,
    }


def _results(loaded: dict[str, Any], arguments: dict[str, Any], out: Path) -> dict[str, Any]:
    """Study all scenes, and draw the pictures."""
    settings = work_precision.settings(*(arguments[key] for key in ("integrator", "step", "tolerance")))
    ticks = work_precision.ticks(settings, arguments["repeats"]) + len(settings)
    results = {}
    with progress() as bar:
        for name, description in loaded.items():
            task = bar.add_task(str(description["name"]), total=ticks)
            try:
                results[name] = _study(description, settings, arguments, partial(bar.advance, task))
            except ValueError as error:
                raise fail(f"{name}: {error}") from None
        task = bar.add_task("pictures", total=None)
        work_precision_picture(out / "accuracy.png", results, arguments["time"])
        drift_picture(out / "drift.png", results, arguments["time"])
    return results


def _study(
    scene: dict[str, Any], settings: Sequence[Setting], arguments: dict[str, Any], tick: work_precision.Tick
) -> dict[str, Any]:
    episodes, repeats = arguments["episodes"], arguments["repeats"]
    run: dict[str, Any] = {"seconds": arguments["time"], "seed": arguments["seed"]}
    result = work_precision.study(scene, settings, episodes=episodes, repeats=repeats, tick=tick, **run)
    result["drift"] = conservation.drifts(scene, settings, episodes=episodes, tick=tick, **run)
    names = dict.fromkeys(setting.integrator for setting in settings if setting.tolerance is None)
    smooth = [Setting(name, "f64", step) for name in names for step in SMOOTH_STEPS]
    still = work_precision.without_kinks(scene)
    few = min(episodes, SMOOTH_EPISODES)
    rows = work_precision.study(still, smooth, episodes=few, repeats=0, **run)["rows"]
    result["smooth_orders"] = work_precision.orders(rows, result["stable_steps"])
    result["recommended"] = {precision: work_precision.recommend(result, precision) for precision in PRECISIONS}
    result["comparison"] = _comparison(result["rows"])
    return result


def _comparison(rows: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """What the rival makes of the CPU time that MK4 takes at `STEP`."""
    row = find(rows, "mk4", "f64", STEP)
    rival = None if row is None else at_cost(rows, RIVAL, row["cost"])
    if row is None or rival is None:
        return None
    error = row["end_effector"]["median"]
    return {"cost": row["cost"], "error": error, "rival_error": rival, "ratio": rival / error}


def _print(name: str, result: dict[str, Any], arguments: dict[str, Any]) -> None:
    steps, tolerances, seconds = (arguments[key] for key in ("step", "tolerance", "time"))
    fixed = [row for row in result["rows"] if row["tolerance"] is None]
    adaptive = [row for row in result["rows"] if row["tolerance"] is not None]
    doubt = result["reference"]["doubt"]["end_effector"]["median"]
    lines = []
    for method, precision in dict.fromkeys((row["integrator"], row["precision"]) for row in fixed):
        cells = [row for row in fixed if (row["integrator"], row["precision"]) == (method, precision)]
        order = ""
        if precision == "f64":
            found = (result[part].get(method, {}).get("order", math.nan) for part in ("orders", "smooth_orders"))
            order = " ".join("-" if math.isnan(x) else f"{x:.1f}" for x in found)
        per_step = [row["cost"] * row["step"] for row in cells]
        lines.append((method, precision, *(_cell(row, doubt) for row in cells), order, f"{np.nanmedian(per_step):.0f}"))
    title = f"{name}: median error at the end effector after {seconds:g} s, m ({arguments['episodes']} instances)"
    if lines:
        table(title, ("integrator", "", *(f"{step:g} s" for step in steps), "order", "ns/step"), lines, text_columns=2)
    lines = []
    for method, precision in dict.fromkeys((row["integrator"], row["precision"]) for row in adaptive):
        mine = [row for row in adaptive if (row["integrator"], row["precision"]) == (method, precision)]
        by_tolerance = {row["tolerance"]: row for row in mine}
        picked = [by_tolerance.get(tolerance) for tolerance in tolerances]
        lines.append((method, precision, "error, m", *(_cell(row, doubt) if row else "" for row in picked)))
        lines.append(("", "", "CPU, us/s", *(f"{1e-3 * row['cost']:.3g}" if row else "" for row in picked)))
    if lines:
        header = ("integrator", "", "", *(f"{tolerance:.0e}" for tolerance in tolerances))
        table(f"{name}: the same by tolerance", header, lines, text_columns=3)
    _print_drift(name, result["drift"], seconds)
    found = result["character"]
    say(
        f"The motion (median instance): path {found['path']:.1f} m, turn {found['turn']:.1f} rad, joints' travel "
        f"{found['joint_travel']:.1f} rad. Reference: {result['reference']['method']}; "
        f"{' and '.join(result['reference']['checks'])} differ from it by up to {doubt:.0e} m (median)."
    )


def _print_drift(name: str, rows: Sequence[dict[str, Any]], seconds: float) -> None:
    fixed = [row for row in rows if row["tolerance"] is None]
    if not fixed:
        return
    steps = sorted({row["step"] for row in fixed})
    # One step says it: orders are in the picture, and all else in the file.
    step = STEP if STEP in steps else steps[len(steps) // 2]
    quantities = [quantity for quantity in conservation.QUANTITIES if quantity in fixed[0]]
    lines = []
    for method in dict.fromkeys(row["integrator"] for row in fixed):
        by_precision = [find(fixed, method, precision, step) for precision in PRECISIONS]
        lines.append((method, *(_number(row[q]["median"]) for row in by_precision if row for q in quantities)))
    header = ("integrator", *(f"{q} {precision}" for precision in PRECISIONS for q in quantities))
    table(f"{name}: relative drift in {seconds:g} s where nothing dissipates, h = {step:g} s (median)", header, lines)


def _print_summary(results: dict[str, Any]) -> None:
    lines = []
    for name, result in results.items():
        for precision, row in result["recommended"].items():
            if row is None:
                lines.append((name, precision, "none", "", "", ""))
                continue
            error = row["end_effector"]
            numbers = (_number(error["median"]), _number(error["worst"]), f"{1e-3 * row['cost']:.3g}")
            lines.append((name, precision, f"{row['step']:g}", *numbers))
    header = ("scene", "", "MK4 step, s", "error, m", "worst, m", "CPU, us per s")
    table("Recommended steps", header, lines, text_columns=2)
    most = ", ".join(f"{bar:g} m in {precision}" for precision, bar in work_precision.RECOMMENDED.items())
    say(
        f"The recommended step is the greatest of MK4 whose median error at the end effector stays below {most}, "
        f"that is {work_precision.STABILITY_MARGIN:g} times smaller than the greatest stable step, and at which no "
        "instance diverges and nothing warns. CPU: microseconds of one thread per simulated second and instance."
    )
    for name, result in results.items():
        if comparison := result["comparison"]:
            say(
                f"{name}: {RIVAL} at the cost of MK4 at {STEP:g} s ({1e-3 * comparison['cost']:.3g} us per s) errs by "
                f"{comparison['rival_error']:.1e} m, {comparison['ratio']:.1e} times as much as MK4."
            )
    bad = [row for result in results.values() for row in result["rows"] if row["diverged"]]
    silent = sum(not (row["warned_early"] or row["warned_later"]) for row in bad)
    say(
        f"<: below {work_precision.FLOOR:g} times the doubt of the reference. !: some instances diverged (not finite, "
        f"or off by more than {work_precision.LOST:g} m or rad). w: warned. Of "
        f"{len(bad)} runs with diverged instances {silent} did not warn. Orders: of this motion, and without "
        f"quadratic drag. Currents up to {CURRENT:g} m/s, drive held over {PERIOD:g} s, {LEAD:g} s of "
        "motion before the start."
    )


def _cell(row: dict[str, Any], doubt: float) -> str:
    error = row["end_effector"]["median"]
    warned = "w" if row["warned_early"] or row["warned_later"] else ""
    if not error <= work_precision.LOST:
        return f"diverged{warned}"
    if row["floor"]:
        return f"<{_number(work_precision.FLOOR * doubt, 0)}{warned}"
    return f"{_number(error)}{'!' if row['diverged'] else ''}{warned}"


def _number(value: float, decimals: int = 1) -> str:
    """Write one or two digits, and the exponent without zeros."""
    if not math.isfinite(value):
        return "diverged"
    mantissa, exponent = f"{value:.{decimals}e}".split("e")
    return f"{mantissa}e{int(exponent)}" if value else "0"


def _divides(part: float, whole: float) -> bool:
    return math.isclose(round(whole / part) * part, whole, rel_tol=1e-9)
