"""Figure of an episode over time: disturbances, errors and actions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uvms_gym.studies.plotting import BLUE, COLOURS, GREEN, ORANGE, PURPLE, VERMILION, legend_above, picture
from uvms_gym.viewer.curves import Curve

#: Colours of errors on white.
_INKS = {"position_error": GREEN, "end_effector_position_error": PURPLE, "attitude_error": ORANGE}


class Instant(NamedTuple):
    """A control instant: time, s; the environment's `info`; and the action before it, or None."""

    time: float
    info: Mapping[str, Any]
    action: Any


def plot_episode(
    path: Path, title: str, names: Sequence[str], curves: Sequence[Curve], instants: Sequence[Instant]
) -> None:
    """Draw disturbances, errors by `curves` and actions (entries by `names`) over time."""
    time = np.array([instant.time for instant in instants])

    def of(name: str) -> Any:
        return np.array([float(instant.info[name]) for instant in instants])

    with picture(path, 9.0, 11.0) as figure:
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
        legend_above(rest, [*rest.lines, *share.lines])
        for curve in curves:
            label = f"{curve.title}, {curve.unit}"
            errors.plot(time, curve.scale * of(curve.entry), color=_INKS[curve.entry], label=label)
        errors.set(title="Errors", ylabel="cm, °", ylim=(0.0, None))
        actions = np.array([instant.action for instant in instants if instant.action is not None])
        for k, name in enumerate(names):
            # An action acts from the instant before; beyond ten colours lines are dashed.
            held = np.concatenate([actions[:1, k], actions[:, k]])
            style: Any = {"color": f"C{k}" if k else BLUE, "linestyle": "--" if k >= 10 else "-", "linewidth": 1.0}
            acts.step(time, held, where="pre", label=name, **style)
        acts.set(title="Actions", ylabel="share of the limit", xlabel="time (s)", ylim=(-1.05, 1.05))
        for axes in (water, errors, acts):
            legend_above(axes)
