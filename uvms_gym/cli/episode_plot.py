"""Figure of an episode over time: disturbances, errors and actions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uvms_gym.studies.plotting import BLUE, COLOURS, GREEN, ORANGE, PURPLE, VERMILION, picture


class Instant(NamedTuple):
    """A control instant: time, s; the environment's `info`; and the action before it, or None."""

    time: float
    info: Mapping[str, Any]
    action: Any


def plot_episode(path: Path, title: str, names: Sequence[str], instants: Sequence[Instant]) -> None:
    """Draw disturbances, errors and actions (entries by `names`) over time."""
    time = np.array([instant.time for instant in instants])

    def of(name: str) -> Any:
        return np.array([float(instant.info[name]) for instant in instants])

    with picture(path, 9.0, 10.0) as figure:
        water, rest, errors, acts = figure.subplots(4, 1, sharex=True)
        for name, colour in zip("xyz", COLOURS, strict=False):
            water.plot(time, of(f"current_{name}"), color=colour, label=name)
        water.set(title=f"{title}: water at the vehicle", ylabel="m/s")
        rest.plot(time, of("disturbance_force"), color=VERMILION, label="force, N")
        rest.set(title="Other disturbances", ylabel="N", ylim=(0.0, None))
        share = rest.twinx()
        share.grid(visible=False)
        share.spines["right"].set_visible(True)
        share.plot(time, of("payload"), color=PURPLE, label="payload, kg")
        share.plot(time, of("thruster_gain"), color=ORANGE, linestyle="--", label="gain of the weakest thruster")
        share.set(ylabel="kg, 1", ylim=(0.0, None))
        lines = [*rest.lines, *share.lines]
        rest.legend(lines, [str(line.get_label()) for line in lines], ncol=3)
        errors.plot(time, 100.0 * of("position_error"), color=GREEN, label="position, cm")
        errors.plot(time, 100.0 * of("end_effector_position_error"), color=PURPLE, label="end effector, cm")
        errors.plot(time, np.rad2deg(of("attitude_error")), color=ORANGE, label="attitude, °")
        errors.set(title="Errors", ylabel="cm, °", ylim=(0.0, None))
        actions = np.array([instant.action for instant in instants if instant.action is not None])
        for k, name in enumerate(names):
            acts.step(time[1:], actions[:, k], where="pre", linewidth=1.0, label=name, color=f"C{k}" if k else BLUE)
        acts.set(title="Actions", ylabel="share of the limit", xlabel="time (s)", ylim=(-1.05, 1.05))
        for axes in (water, errors, acts):
            axes.legend(ncol=6)
