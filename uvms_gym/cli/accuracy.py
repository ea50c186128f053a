"""`uvms accuracy`: error against cost of every integrator, step and precision; with --env certificates."""

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from typer import Option

import uvms_gym
from uvms_gym.cli import certificate
from uvms_gym.cli.common import check_known, check_list, fail, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import EnvKwargs, environment_arguments
from uvms_gym.cli.options import Json, Out, ranged, several, within
from uvms_gym.cli.output import name_files, say, scientific, table, write_results
from uvms_gym.studies.accuracy import conservation, plots, study, work_precision
from uvms_gym.studies.accuracy.driven_motion import CURRENT, LEAD, PERIOD
from uvms_gym.studies.accuracy.episodes import divides
from uvms_gym.studies.accuracy.study import BASELINE, STEP, TIME
from uvms_gym.studies.accuracy.work_precision import FLOOR, PRECISIONS, STABILITY_MARGIN, by_method, find
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.records import circumstances

FILES = ("accuracy.json", "accuracy.png", "drift.png")
EPISODES, MOST_EPISODES, MOST_TIME = 64, 10_000, 1000.0
#: Minimum step, s: the reference is much finer.
MIN_STEP = 5e-4
#: Episodes, time, repeats, steps and tolerances of --quick.
QUICK_EPISODES, QUICK_TIME, QUICK_REPEATS = 16, 2.0, 3
QUICK_STEPS, QUICK_TOLERANCES = (0.005, 0.01, 0.02, 0.05), (1e-4, 1e-6, 1e-8)


def _numbers(text: str, default: str, minimum: float, most: float) -> Any:
    return several(text, default, "NUMBER", callback=within(minimum, most))


def accuracy(
    env: Annotated[
        list[str] | None,
        Option(help="Environment, by Gymnasium's id: certify its accuracy over its own episodes; may be repeated."),
    ] = None,
    scene: Annotated[
        list[str] | None, several("Scene: name or TOML file", "all shipped scenes; with --env the environment's")
    ] = None,
    env_kwargs: EnvKwargs = None,
    dt: Annotated[
        list[float] | None,
        _numbers("With --env: step, s, that divides the control period", "0.001 to 0.05", MIN_STEP, 1.0),
    ] = None,
    dtype: Annotated[list[str] | None, several("With --env: float64 or float32", "both")] = None,
    integrator: Annotated[list[str] | None, several("Integrator")] = None,
    step: Annotated[
        list[float] | None, _numbers(f"Step, s, that divides {PERIOD:g} s", "0.001 to 0.1", MIN_STEP, PERIOD)
    ] = None,
    tolerance: Annotated[
        list[float] | None, _numbers("Tolerance of the adaptive method", "1e-3 to 1e-10", 1e-11, 0.1)
    ] = None,
    seconds: Annotated[
        float | None,
        ranged(f"Simulated time, s, a multiple of {PERIOD:g} s. [default: {TIME:g}]", PERIOD, MOST_TIME, "--time"),
    ] = None,
    episodes: Annotated[
        int | None,
        ranged(
            f"Instances, each with its own start and drive, 2 to {MOST_EPISODES}. [default: {EPISODES}]",
            2,
            MOST_EPISODES,
        ),
    ] = None,
    seed: Annotated[int, ranged("Seed of starts and drives.", 0)] = 0,
    quick: Annotated[bool, Option("--quick", help="Fewer steps and instances, and 2 s of motion.")] = False,
    out: Out = Path("out/accuracy"),
    json_file: Json = None,
) -> None:
    """Measure error against cost of every integrator, step and precision over a driven motion.

    Prints tables and the recommended step of each scene, and writes two pictures and accuracy.json to --out.

    With --env: errors of an environment's own episodes against a converged reference under the same actions, with a
    verdict and the recommended step; writes certificate.json and certificate.png. --dt, --dtype and --integrator select
    configurations.
    """
    if env:
        for option, given in (("step", step), ("tolerance", tolerance), ("time", seconds), ("quick", quick)):
            if given:
                raise fail(f"--{option} is not for --env, which has --dt, --dtype, --integrator and --episodes")
        chosen: dict[str, Any] = {"integrator": integrator or [], "dtype": dtype or [], "step": dt or []}
        named = {"scene": scene, "dt": dt, "dtype": dtype, "integrator": integrator}
        arguments = environment_arguments(env_kwargs, **named)
        own = {key: value for key, value in arguments.items() if not named.get(key)}
        certificate.certify(env, own, scene or [], chosen, episodes, seed, out, json_file)
        return
    for option, value in (("dt", dt), ("dtype", dtype), ("env-kwargs", env_kwargs)):
        if value:
            raise fail(f"--{option} needs --env; scenes have --step")
    known = work_precision.integrators()
    check_known("integrator", integrator or (), known)
    for h in step or ():
        if not divides(h, PERIOD):
            raise fail(f"--step is {h:g}, but must divide the control period of {PERIOD:g} s, as 0.02 or 0.05 do")
    seconds = (QUICK_TIME if quick else TIME) if seconds is None else seconds
    if not divides(PERIOD, seconds):
        raise fail(f"--time is {seconds:g}, but must be a multiple of the control period of {PERIOD:g} s")
    episodes = (QUICK_EPISODES if quick else EPISODES) if episodes is None else episodes
    arguments = {
        "scene": check_list("scene", scene, uvms_gym.scene_names()),
        "integrator": list(dict.fromkeys(integrator or known)),
        "step": sorted(set(step or (QUICK_STEPS if quick else work_precision.STEPS))),
        "tolerance": sorted(set(tolerance or (QUICK_TOLERANCES if quick else work_precision.TOLERANCES)), reverse=True),
        "time": seconds,
        "episodes": episodes,
        "seed": seed,
        "repeats": QUICK_REPEATS if quick else work_precision.REPEATS,
    }
    loaded = {name: read_scene(name) for name in arguments["scene"]}
    prepare(out, json_file, FILES)
    begun = time.perf_counter()
    settings = work_precision.settings(*(arguments[key] for key in ("integrator", "step", "tolerance")))
    run = {key: arguments[key] for key in ("episodes", "seed", "repeats")} | {"seconds": seconds}
    results = {}
    with progress():
        for name, loaded_scene in tracked(loaded.items(), "scenes"):
            with user_errors(f"{name}: "):
                results[name] = study.study_scene(loaded_scene, settings, **run)
        spent = time.perf_counter() - begun
        criteria = study.criteria(results, arguments["time"])
        about = circumstances("accuracy", arguments) | {"seconds": spent}
        write_results(out, FILES, json_file, {"circumstances": about, "results": results, "criteria": criteria})
        with user_errors(verb="write"):
            plots.plot_work_precision(out / "accuracy.png", results, seconds)
            plots.plot_drift(out / "drift.png", results, seconds)
    for name, result in results.items():
        _print(name, result, arguments)
    _print_summary(results)
    if criteria:
        rows = [(what, found, bound, "met" if met else "MISSED") for what, found, bound, met in criteria]
        table("Criteria", ("criterion", "found", "bound", ""), rows)
    name_files(out, FILES, f" ({spent:.0f} s)")


def _print(name: str, result: dict[str, Any], arguments: dict[str, Any]) -> None:
    steps, tolerances, seconds = (arguments[key] for key in ("step", "tolerance", "time"))
    fixed = [row for row in result["rows"] if row["tolerance"] is None]
    adaptive = [row for row in result["rows"] if row["tolerance"] is not None]
    uncertainty = result["reference"]["uncertainty"]["end_effector"]["median"]
    lines = []
    for (method, precision), rows in by_method(fixed).items():
        order = ""
        if precision == "f64":
            found = (result[part].get(method, {}).get("order", math.nan) for part in ("orders", "smooth_orders"))
            order = " ".join("-" if math.isnan(x) else f"{x:.1f}" for x in found)
        per_step = np.nanmedian([row["cost"] * row["step"] for row in rows])
        lines.append((method, precision, *(_cell(row, uncertainty) for row in rows), order, f"{per_step:.0f}"))
    title = f"{name}: median error at the end effector after {seconds:g} s, m ({arguments['episodes']} instances)"
    if lines:
        table(title, ("integrator", "", *(f"{step:g} s" for step in steps), "order", "ns/step"), lines, text_columns=2)
    lines = []
    for (method, precision), rows in by_method(adaptive).items():
        by_tolerance = {row["tolerance"]: row for row in rows}
        picked = [by_tolerance.get(tolerance) for tolerance in tolerances]
        lines.append((method, precision, "error, m", *(_cell(row, uncertainty) if row else "" for row in picked)))
        lines.append(("", "", "CPU, us/s", *(f"{1e-3 * row['cost']:.3g}" if row else "" for row in picked)))
    if lines:
        header = ("integrator", "", "", *(f"{tolerance:.0e}" for tolerance in tolerances))
        table(f"{name}: the same by tolerance", header, lines, text_columns=3)
    _print_drift(name, result["drift"], seconds)
    found = result["character"]
    say(
        f"The motion (median instance): path {found['path']:.1f} m, turn {found['turn']:.1f} rad, joints' travel "
        f"{found['joint_travel']:.1f} rad. Reference: {result['reference']['method']}; "
        f"{' and '.join(result['reference']['checks'])} differ from it by up to {uncertainty:.0e} m (median)."
    )


def _print_drift(name: str, rows: Sequence[dict[str, Any]], seconds: float) -> None:
    fixed = [row for row in rows if row["tolerance"] is None]
    if not fixed:
        return
    steps = sorted({row["step"] for row in fixed})
    # One step is enough: the picture shows orders, and the file has all numbers.
    step = STEP if STEP in steps else steps[len(steps) // 2]
    quantities = [quantity for quantity in conservation.QUANTITIES if quantity in fixed[0]]
    lines = []
    for method in dict.fromkeys(row["integrator"] for row in fixed):
        by_precision = [find(fixed, method, precision, step) for precision in PRECISIONS]
        lines.append((method, *(scientific(row[q]["median"]) for row in by_precision if row for q in quantities)))
    header = ("integrator", *(f"{q} {precision}" for precision in PRECISIONS for q in quantities))
    table(f"{name}: relative drift in {seconds:g} s without dissipation, h = {step:g} s (median)", header, lines)


def _print_summary(results: dict[str, Any]) -> None:
    lines = []
    for name, result in results.items():
        for precision, row in result["recommended"].items():
            if row is None:
                lines.append((name, precision, "none", "", "", ""))
                continue
            error = row["end_effector"]
            numbers = (scientific(error["median"]), scientific(error["worst"]), f"{1e-3 * row['cost']:.3g}")
            lines.append((name, precision, f"{row['step']:g}", *numbers))
    header = ("scene", "", "MK4 step, s", "error, m", "worst, m", "CPU, us per s")
    table("Recommended steps", header, lines, text_columns=2)
    most = ", ".join(f"{bound:g} m in {precision}" for precision, bound in work_precision.RECOMMENDED.items())
    say(
        f"The recommended step is the maximum of MK4 with a median error at the end effector below {most}, at least "
        f"{STABILITY_MARGIN:g} times smaller than the maximum stable step, without diverged instances and without "
        "warnings. CPU: microseconds of one thread per simulated second and instance."
    )
    for name, result in results.items():
        if comparison := result["comparison"]:
            say(
                f"{name}: the error of {BASELINE} at the cost of MK4 at {STEP:g} s ({1e-3 * comparison['cost']:.3g} us "
                f"per s) is {comparison['baseline_error']:.1e} m, {comparison['ratio']:.1e} times the error of MK4."
            )
    bad = [row for result in results.values() for row in result["rows"] if row["diverged"]]
    silent = sum(not (row["warned_early"] or row["warned_later"]) for row in bad)
    say(
        f"<: below {FLOOR:g} times the uncertainty of the reference. !: some instances diverged (not finite, or an "
        f"error above {work_precision.DIVERGED:g} m or rad). w: warned. {silent} of {len(bad)} runs with diverged "
        "instances did not warn. Orders: of this motion, and without quadratic damping. Currents up to "
        f"{CURRENT:g} m/s, drive constant over {PERIOD:g} s, {LEAD:g} s of motion before the start."
    )


def _cell(row: dict[str, Any], uncertainty: float) -> str:
    error = row["end_effector"]["median"]
    warned = "w" if row["warned_early"] or row["warned_later"] else ""
    if not error <= work_precision.DIVERGED:
        return f"diverged{warned}"
    if row["floor"]:
        return f"<{scientific(FLOOR * uncertainty, 0)}{warned}"
    return f"{scientific(error)}{'!' if row['diverged'] else ''}{warned}"
