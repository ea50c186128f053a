"""`uvms validate`: replays of logs with a scene."""

from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Option

from uvms_gym.cli.common import check_list, prepare, user_errors
from uvms_gym.cli.environments import Integrator
from uvms_gym.cli.logs import Logs, LogStep, Map, Period, Window, print_errors, read_logs
from uvms_gym.cli.options import Json, Out, SceneArgument, several
from uvms_gym.cli.output import name_files, say, write_results
from uvms_gym.identification import validate as run
from uvms_gym.identification.recordings import PERIOD
from uvms_gym.studies.identification.plots import plot_replays
from uvms_gym.studies.records import circumstances

FILES = ("validate.json", "replays.png")


def validate(
    scene: SceneArgument,
    logs: Logs,
    map_file: Map,
    trial: Annotated[list[str] | None, several('Trial, or pattern such as "004-*"', "all trials")] = None,
    joints: Annotated[
        Literal["prescribed", "servos"], Option(help="Joints that move as logged, or servos of the scene that follow.")
    ] = "prescribed",
    thrusters: Annotated[Literal["log", "off"], Option(help="Thrust as commanded in the logs, or none.")] = "log",
    window: Window = None,
    period: Period = PERIOD,
    integrator: Integrator = None,
    dt: LogStep = None,
    out: Out = Path("out/validate"),
    json_file: Json = None,
) -> None:
    """Replay logs with a scene: the vehicle's motion under the logged joints and thrusters.

    Prints RMS errors, also of simple predictors that any model must beat, and writes validate.json and replays.png to
    --out.
    """
    read = read_logs(scene, logs, map_file, check_list("--trial", trial, []), window)
    prepare(out, json_file, FILES)
    with user_errors():
        given: dict[str, Any] = {
            "joints": joints,
            "thrusters": thrusters,
            "period": period,
            "integrator": integrator,
            "dt": dt,
        }
        found = run(scene, read, **given)
    arguments: dict[str, Any] = {"scene": scene, "logs": logs, "map": map_file, "trial": trial or [], "window": window}
    arguments |= given
    data = {"circumstances": circumstances("validate", arguments), "errors": found.table.as_data()}
    write_results(out, FILES, json_file, data)
    with user_errors(verb="write"):
        plot_replays(out / FILES[1], found)
    print_errors("RMS errors, mean over the trials", found.table)
    print_errors("Replay: RMS errors by trial", found.table, "replay")
    say(
        "replay: the scene's dynamics; balance: weight and buoyancy only, at the logged arm; constant: attitude and "
        "velocity in world axes of the start; constant velocity: velocities in body axes of the start; double "
        "integrator: logged thrust and inertia only. Every trial starts from the state that fits its first second."
    )
    name_files(out, FILES)
