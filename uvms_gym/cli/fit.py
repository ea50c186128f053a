"""`uvms fit`: numbers of a scene from logs."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from typer import Option

import uvms_gym
from uvms_gym._files import read_text, write
from uvms_gym.cli.common import check_list, fail, line, prepare, progress, user_errors
from uvms_gym.cli.environments import Integrator
from uvms_gym.cli.logs import Logs, LogStep, Map, Period, Window, print_errors, read_logs
from uvms_gym.cli.options import SceneArgument, several
from uvms_gym.cli.output import say, table, write_json
from uvms_gym.identification import Fit, files
from uvms_gym.identification import fit as run
from uvms_gym.identification.least_squares import ITERATIONS
from uvms_gym.identification.recordings import CHANNELS, PERIOD
from uvms_gym.studies.identification.plots import plot_intervals
from uvms_gym.studies.records import circumstances

#: Exit status of a fit that was interrupted; its results are written.
INTERRUPTED = 130


def fit(
    scene: SceneArgument,
    logs: Logs,
    map_file: Map,
    free: Annotated[
        list[str],
        Option(
            metavar="KEY",
            help="Free number: of the scene, as vehicle.body.center_of_buoyancy or vehicle.body.damping.linear[3:6], "
            "or of the map, as map.joints.axes.wrist.zero or map.joints.time.lag; may be repeated.",
        ),
    ],
    out: Annotated[
        Path, Option(metavar="FILE", help="Scene to write; beside it FILE-map.toml, FILE-randomize.toml, .json, .png.")
    ],
    hold_out: Annotated[
        list[str] | None, several('Trial that the fit does not see, or pattern such as "004-*"', "none")
    ] = None,
    prior: Annotated[
        list[str] | None,
        several("Standard deviation of a prior, relative for positive quantities", "by quantity", "KEY=NUMBER"),
    ] = None,
    channel: Annotated[
        list[str] | None,
        several(f"Channel that counts, of {', '.join(CHANNELS)}", "roll, pitch, gyro x, y; all with thrusters"),
    ] = None,
    window: Window = None,
    period: Period = PERIOD,
    integrator: Integrator = None,
    dt: LogStep = None,
    balance: Annotated[bool, Option(help="Fit static balance as well, for comparison.")] = True,
    name: Annotated[str | None, Option(help="Name of the fitted scene. [default: the name of FILE]")] = None,
    force: Annotated[bool, Option("--force", help="Overwrite existing files.")] = False,
) -> int:
    """Fit numbers of a scene to logs: all trials as one batch, joints as logged, robust, with priors from the scene.

    Prints values with standard deviations clustered by trial, what the data leave open, and errors on trials fitted and
    held out; writes the fitted scene, whose provenance holds the intervals. Ctrl-C, or SIGTERM, ends at the best values
    so far.
    """
    free, hold_out = check_list("--free", free, []), check_list("--hold-out", hold_out, [])
    channels = check_list("--channel", channel, []) or None
    priors = dict(_prior(text) for text in check_list("--prior", prior, []))
    if out.suffix != ".toml":
        raise fail(f"--out is {str(out)!r}, but must end in .toml")
    written = [out, *(out.with_name(f"{out.stem}{end}") for end in ("-map.toml", "-randomize.toml", ".json", ".png"))]
    for file in written:
        if file.exists() and not force:
            raise fail(f"{file} exists: give another --out, or --force to overwrite it")
        prepare(None, file)
    read = read_logs(scene, logs, map_file, window=window)
    data = tomllib.loads(read_text(map_file))
    with progress() as bar:
        task = bar.add_task("fitting", total=ITERATIONS)

        def report(stage: str, iteration: int, cost: float) -> None:
            bar.update(task, description=f"{stage}: cost {cost:.6g}", completed=iteration)

        with user_errors():
            found = run(
                scene,
                read,
                free,
                hold_out=hold_out,
                map_data=data,
                priors=priors,
                channels=channels,
                balance=balance,
                period=period,
                integrator=integrator,
                dt=dt,
                report=report,
            )
    given: dict[str, Any] = {
        "scene": scene,
        "logs": logs,
        "map": map_file,
        "free": free,
        "hold_out": hold_out,
        "window": window,
    }
    given |= {"prior": priors, "channel": channels, "period": period, "integrator": integrator, "dt": dt}
    _write(written, found, data, name or out.stem, logs.resolve().name, circumstances("fit", given))
    _print(found)
    line(", ".join(map(str, written)))
    return INTERRUPTED if found.solution.interrupted else int(not found.solution.converged)


def _prior(text: str) -> tuple[str, float]:
    key, _, number = text.rpartition("=")
    try:
        return key, float(number)
    except ValueError:
        raise fail(f'--prior "{text}" is not KEY=NUMBER') from None


def _print(found: Fit) -> None:
    rows = []
    for p, share in zip(found.parameters, found.uncertainty.shares):
        low, high = found.intervals[p.key]
        note = "at its bound" if p.key in found.at_bounds else "open" if share > 0.5 else ""
        numbers = (p.start, found.values[p.key], found.deviations[p.key], low, high)
        rows.append((p.key, note, *(f"{number:.4g}" for number in numbers), f"{100 * share:.0f}"))
    header = ("parameter", "", "start", "value", "deviation", "low", "high", "% of prior")
    table(f"Fit to {len(found.train)} trials: values, 95 % intervals clustered by trial", header, rows, text_columns=2)
    pairs = [(a, b, f"{c:+.2f}") for a, b, c in found.strongest_correlations()[:10]]
    if pairs:
        table("Strongest correlations", ("parameter", "parameter", "correlation"), pairs, text_columns=2)
    for share, direction in found.undetermined:
        names = ", ".join(f"{entry:+.2f} {key}" for key, entry in direction.items())
        say(f"not determined by the data, {100 * share:.0f} % of the prior's variance: {names}")
    for key, value in found.values.items():
        if key.endswith(".lag") and value < 0.0:
            say(f"{key} is negative, as if stamps came before what they stamp: the clocks of the logs may differ")
    if found.at_bounds:
        say(f"at a bound: {', '.join(found.at_bounds)}")
    print_errors("Trials fitted: RMS errors, mean over the trials", found.table.of(found.train))
    if found.held_out:
        held = found.table.of(found.held_out)
        print_errors("Trials held out: RMS errors, mean over the trials", held)
        print_errors("Trials held out, by trial", held, "fitted")
    if not found.solution.converged:
        say("not converged: interrupted, or too many iterations; these are the best values so far")


def _write(
    written: Sequence[Path], found: Fit, data: dict[str, Any], name: str, source: str, about: dict[str, Any]
) -> None:
    heading = f"# Fitted by uvms fit to {len(found.train)} trials of {source}: {', '.join(found.train)}.\n"
    fitted = files.fitted_scene(found, source, name)
    texts = (
        heading + uvms_gym.dump_scene(fitted),
        heading + files.to_toml(files.fitted_map(found, data)),
        heading + "# 95 % intervals, for randomize= of environments.\n" + files.to_toml(files.ranges(fitted)),
    )
    write_json(written[3], {"circumstances": about, **files.as_data(found)})
    with user_errors(verb="write"):
        for file, text in zip(written, texts):
            write(file, text)
        plot_intervals(written[4], found)
