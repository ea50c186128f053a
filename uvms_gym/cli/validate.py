"""`uvms validate`: replays of logs with a scene."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, Option

import uvms_gym
from uvms_gym.cli.common import check_list, check_range, hold, prepare, several, user_errors
from uvms_gym.cli.output import Json, Out, name_files, say, table, write_results
from uvms_gym.identification import Table
from uvms_gym.identification import validate as run
from uvms_gym.identification.recordings import CHANNELS, PERIOD
from uvms_gym.identification.validation import select
from uvms_gym.studies.identification.plots import plot_replays
from uvms_gym.studies.records import circumstances

FILES = ("validate.json", "replays.png")

Scene = Annotated[str, Argument(metavar="SCENE", help="Name of a shipped scene, or path of a TOML file.")]
Logs = Annotated[Path, Argument(metavar="LOGS", help="Directory of the logs, or a bag.")]
Map = Annotated[Path, Option("--map", metavar="FILE", help="Map of the logs' channels (docs/logs.md).")]
Period = Annotated[float, Option(help="Interval between compared samples, s.")]


def validate(
    scene: Scene,
    logs: Logs,
    map_file: Map,
    trial: Annotated[list[str] | None, several('Trial, or pattern such as "004-*"', "all trials")] = None,
    joints: Annotated[
        Literal["prescribed", "servos"], Option(help="Joints that move as logged, or servos of the scene that follow.")
    ] = "prescribed",
    thrusters: Annotated[Literal["log", "off"], Option(help="Thrust as commanded in the logs, or none.")] = "log",
    period: Period = PERIOD,
    out: Out = Path("out/validate"),
    json_file: Json = None,
) -> None:
    """Replay logs with a scene: the vehicle's motion under the logged joints and thrusters.

    Prints RMS errors beside those of a constant predictor and one of static balance, and writes validate.json and
    replays.png to --out.
    """
    check_range("--period", period, 0.01, 1.0)
    read = read_logs(scene, logs, map_file, check_list("--trial", trial, []))
    prepare(out, json_file, FILES)
    hold(out)
    with user_errors():
        found = run(scene, read, joints=joints, thrusters=thrusters, period=period)
    arguments: dict[str, Any] = {"scene": scene, "logs": logs, "map": map_file, "trial": trial or []}
    arguments |= {"joints": joints, "thrusters": thrusters, "period": period}
    data = {"circumstances": circumstances("validate", arguments), "errors": found.table.as_data()}
    write_results(out, FILES, json_file, data)
    with user_errors(verb="write"):
        plot_replays(out / FILES[1], found)
    print_means("RMS errors, mean over the trials", found.table)
    print_trials("Replay: RMS errors by trial", found.table, "replay")
    say(
        "constant: attitude and velocity of the start; balance: weight and buoyancy alone, at the logged arm; replay: "
        "the scene's dynamics. Every trial starts from the state that fits its first second."
    )
    name_files(out, FILES)


def read_logs(scene: str, path: Path, map_file: Path, trials: Sequence[str] = ()) -> list[uvms_gym.Log]:
    """Logs of a directory or a bag, all or those that match patterns.

    Raises
    ------
    TyperException
        Scene, map, file or trial that cannot be read.
    """
    with user_errors():
        logs = uvms_gym.Log.read_all(path, map_file, scene=scene)
        wanted = select([log.name for log in logs], trials) if trials else [log.name for log in logs]
    return [log for log in logs if log.name in wanted]


def print_means(title: str, errors: Table) -> None:
    """Print the mean RMS of each predictor and channel."""
    shown = errors.channels
    header = ("predictor", *(f"{name} {CHANNELS[name][0]}" for name in shown))
    rows = [(predictor, *(f"{row[name]:.3g}" for name in shown)) for predictor, row in errors.means.items()]
    table(f"{title} ({len(errors.trials)} trials)", header, rows)


def print_trials(title: str, errors: Table, predictor: str) -> None:
    """Print the RMS of each trial and channel."""
    shown = errors.channels
    columns = [list(CHANNELS).index(name) for name in shown]
    header = ("trial", *(f"{name} {CHANNELS[name][0]}" for name in shown))
    rows = [(trial, *(f"{row[k]:.3g}" for k in columns)) for trial, row in zip(errors.trials, errors.errors[predictor])]
    table(title, header, rows)
