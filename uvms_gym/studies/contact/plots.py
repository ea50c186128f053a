"""Figure of added mass as a lagged force."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym.studies.contact.lagged_added_mass import DISTANCE, NATIVE
from uvms_gym.studies.plotting import BLACK, BLUE, GREY, ORANGE, VERMILION, picture

#: Ratios of the motions that are drawn.
SHOWN = (3.0, 8.0)


def plot_lagged_added_mass(path: Path, data: Mapping[str, Any]) -> None:
    """Deviation by ratio of added mass to mass at the shown step, and motions before the wall."""
    ratios, row = np.array(data["ratios"]), list(data["steps"]).index(data["shown"])
    suite = next(iter(data["bounds"]))
    styles = {suite: (VERMILION, "o"), NATIVE: (ORANGE, "s"), "semi-implicit-euler": (BLACK, "^"), "mk4": (BLUE, "D")}
    labels = {
        suite: suite,
        NATIVE: "lagged force, alpha 0.3 (lagged-added-mass)",
        "semi-implicit-euler": "exact added mass, semi-implicit Euler",
        "mk4": "exact added mass, mk4",
    }
    with picture(path, 10.0, 4.4) as figure:
        left, right = figure.subplots(1, 2)
        for name, (colour, marker) in styles.items():
            errors = np.array(data["errors"]["wall"][name][row], dtype=np.float64)
            finite = np.isfinite(errors)
            left.semilogy(ratios[finite], errors[finite], marker + "-", color=colour, label=labels[name])
            level = 1.0 if name == suite else 0.5
            left.semilogy(ratios[~finite], np.full((~finite).sum(), level), "x", color=colour, markersize=8.0)
        for name, limit in data["bounds"].items():
            left.axvline(limit, color=styles[name][0], linestyle=":", linewidth=1.2)
        left.text(ratios[0], 0.6, "x: diverged", color=GREY, fontsize=9.0, va="center")
        step = 1e3 * data["shown"]
        left.set(
            title=f"Maximum error of the position in 3 s, h = {step:g} ms",
            xlabel="added mass / mass",
            ylabel="error (m)",
            ylim=(1e-10, 3.0),
        )
        for ratio, line in zip(SHOWN, ("-", "--"), strict=True):
            k = int(np.flatnonzero(ratios == ratio)[0])
            for name, (colour, _) in styles.items():
                x = np.array([row[k] for row in data["positions"][name]], dtype=np.float64)
                if name in ("mk4", suite):
                    label = f"{'exact' if name == 'mk4' else suite}, {ratio:g}"
                    right.plot(data["time"], 1e3 * x, line, color=colour, label=label)
        right.axhline(1e3 * DISTANCE, color=GREY, linewidth=1.0)
        right.set(title="Plate at the wall, by ratio", xlabel="time (s)", ylabel="position (mm)", ylim=(75.0, 108.0))
        right.legend(loc="lower right")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=2)
