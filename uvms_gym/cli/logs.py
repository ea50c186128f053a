"""Logs of `uvms validate` and `uvms fit`: options, reading, and tables of errors."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from uvms_gym import Log
from uvms_gym.cli.common import line, user_errors
from uvms_gym.cli.options import ranged
from uvms_gym.cli.output import table
from uvms_gym.identification import Table
from uvms_gym.identification.recordings import CHANNELS
from uvms_gym.identification.validation import select

Logs = Annotated[Path, Argument(metavar="LOGS", help="Directory of the logs, or a bag.")]
Map = Annotated[Path, Option("--map", metavar="FILE", help="Map of the logs' channels (docs/logs.md).")]
#: Step of replays.
LogStep = Annotated[
    float | None,
    ranged("Maximum step, s. [default: 0.005 to 0.05, by joints and thrusters, or the scene's]", 1e-5, 1.0, "--dt"),
]
Window = Annotated[
    float | None,
    ranged(
        "Cut every trial into pieces of this length, s, each from its own start. [default: whole trials]", 1.0, 600.0
    ),
]
Period = Annotated[float, ranged("Interval between compared samples, s.", 0.01, 1.0)]


def read_logs(
    scene: str, path: Path, map_file: Path, trials: Sequence[str] = (), window: float | None = None
) -> list[Log]:
    """Logs of a directory or a bag: all, or the trials that match patterns; in pieces of a length, s."""
    with user_errors():
        logs = Log.read_all(path, map_file, scene=scene)
        wanted = select([log.name for log in logs], trials or ["*"])
    logs = [log for log in logs if log.name in wanted]
    for text in remarks(logs):
        line(text)
    with user_errors():
        return logs if window is None else [piece for log in logs for piece in log.pieces(window)]


def remarks(logs: Sequence[Log]) -> list[str]:
    """One line for each reason for which rows of a channel were left out, and for each note, over all logs."""
    texts = []
    for kind in dict.fromkeys(kind for log in logs for kind in log.channels):
        channels = [log.channels[kind] for log in logs if kind in log.channels]
        rows = sum(channel.rows for channel in channels)
        dropped = sum((Counter(channel.dropped) for channel in channels), Counter[str]())
        notes = Counter(note for channel in channels for note in channel.notes)
        texts += [f"{kind}: {count} of {rows} rows left out: {reason}" for reason, count in dropped.items()]
        texts += [f"{kind}: {note} ({count} of {len(logs)} trials)" for note, count in notes.items()]
    return texts


def print_errors(title: str, errors: Table, predictor: str | None = None) -> None:
    """Print the RMS of each channel: by trial of one predictor, or by predictor as the mean over the trials."""
    names = errors.channels
    if predictor is None:
        title = f"{title} ({len(errors.trials)} trials)"
        rows = {name: [means[channel] for channel in names] for name, means in errors.means.items()}
    else:
        columns = [list(CHANNELS).index(name) for name in names]
        rows = dict(zip(errors.trials, errors.errors[predictor][:, columns].tolist()))
    header = ("trial" if predictor else "predictor", *(f"{name} {CHANNELS[name][0]}" for name in names))
    table(title, header, [(name, *(f"{error:.3g}" for error in row)) for name, row in rows.items()])
