"""Pictures of validations and fits."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from uvms_gym.identification import Fit, Validation
from uvms_gym.identification.recordings import CHANNELS, Floats
from uvms_gym.studies.plotting import BLACK, BLUE, GREY, ORANGE, VERMILION, picture

#: Most trials in a picture.
MOST = 6
_SHOWN = ("roll", "pitch", "yaw", "gyro x", "gyro y", "gyro z")
_COLOURS = {"replay": VERMILION, "balance": BLUE, "constant": GREY}


def plot_replays(path: Path, validation: Validation, most: int = MOST) -> None:
    """Measured and predicted channels of up to `most` trials, evenly chosen."""
    count = min(most, len(validation.recordings))
    chosen = np.unique(np.linspace(0, len(validation.recordings) - 1, count).round().astype(int))
    names = [name for name in _SHOWN if name in validation.table.channels]
    with picture(path, max(6.4, 3.0 * len(chosen) + 1.0), 1.5 * len(names) + 0.9) as figure:
        axes = figure.subplots(len(names), len(chosen), squeeze=False, sharex="col")
        for column, trial in zip(axes.T, chosen):
            recording = validation.recordings[trial]
            column[0].set_title(recording.name)
            column[-1].set_xlabel("time s")
            for row, name in zip(column, names):
                k, (_, factor) = list(CHANNELS).index(name), CHANNELS[name]
                shown = slice(0, recording.periods + 1)
                predicted: Mapping[str, Floats] = validation.predicted
                row.plot(recording.time, factor * validation.measured[trial, shown, k], color=BLACK, label="measured")
                for predictor, colour in _COLOURS.items():
                    style = {"color": colour, "linewidth": 1.2 if predictor == "replay" else 0.8}
                    row.plot(recording.time, factor * predicted[predictor][trial, shown, k], label=predictor, **style)
        for row, name in zip(axes[:, 0], names):
            row.set_ylabel(f"{name} {CHANNELS[name][0]}")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def plot_intervals(path: Path, fit: Fit) -> None:
    """Intervals of all parameters in standard deviations of their priors, beside the priors."""
    u, count = fit.uncertainty, len(fit.parameters)
    at = (fit.solution.common - np.array([p.origin for p in fit.parameters])) / u.prior
    half = u.quantile * u.deviations / u.prior
    colours = [ORANGE if share > 0.5 else BLUE for share in u.shares]
    with picture(path, 8.0, 0.3 * count + 1.0) as figure:
        axis = figure.subplots()
        rows: Sequence[int] = range(count)
        axis.axvspan(-2.0, 2.0, color="#eeeeee")
        for k in rows:
            axis.plot([at[k] - half[k], at[k] + half[k]], [k, k], color=colours[k], linewidth=4.0, alpha=0.6)
            axis.plot(at[k], k, "|", color=BLACK, markersize=9)
        axis.set_yticks(list(rows), [f"{p.key} = {fit.values[p.key]:.4g}" for p in fit.parameters], fontsize=8)
        axis.set_ylim(count - 0.5, -0.5)
        axis.set_xlim(-5.0, 5.0)
        axis.set_xlabel("95 % interval less start, deviations of the prior")
        axis.set_title("grey: the prior's 95 %; orange: left open by the data", fontsize=9)
