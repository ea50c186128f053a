"""Figure of the hard cases."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym.studies.hard_cases.case import DTYPES, Case, Run, methods
from uvms_gym.studies.plotting import picture

SHORT = {"float64": "f64", "float32": "f32"}


def plot_hard_cases(path: Path, cases: Sequence[Case], runs: Sequence[Run]) -> None:
    """Decades from the bound at the recommended step, by case, integrator and precision."""
    import matplotlib as mpl

    columns = [(method.name, dtype) for dtype in DTYPES for method in methods()]
    found = {(run.case, run.method, run.dtype): run for run in runs if run.recommended}
    ratio = np.array([[_decades(found[case.name, *column]) for column in columns] for case in cases])
    plain = {"axes__grid": False, "axes__spines__top": True, "axes__spines__right": True, "font__size": 9.0}
    with picture(path, 3.5 + 0.55 * len(columns), 3.1 + 0.33 * len(cases), **plain) as figure:
        axes = figure.subplots()
        # Blue meets, red misses the bound; paler near it.
        image = axes.imshow(ratio, cmap=mpl.colormaps["RdBu_r"], vmin=-6.0, vmax=6.0, aspect="auto")
        for i, case in enumerate(cases):
            for j, column in enumerate(columns):
                run = found[case.name, *column]
                mark = {"meets": "", "warned": "w", "SILENT": "!"}[run.verdict]
                exponent = f"{math.log10(max(run.error, 1e-17)):.0f}" if math.isfinite(run.error) else "inf"
                dark = abs(ratio[i, j]) > 4.0
                axes.text(j, i, exponent + mark, ha="center", va="center", color="white" if dark else "black")
        labels = [f"{name} {SHORT[dtype]}" for name, dtype in columns]
        axes.set_xticks(range(len(columns)), labels, rotation=60, ha="right")
        axes.set_yticks(range(len(cases)), [case.name for case in cases])
        axes.axvline(len(methods()) - 0.5, color="black", linewidth=1.0)
        title = "Hard cases: decimal exponent of the relative error at the recommended step"
        axes.set_title(f"{title}\n(w: misses its bound with a warning, !: without one)", loc="left")
        layout: Any = figure.get_layout_engine()
        layout.set(h_pad=0.1)
        # Below, where one case is wide enough for the label, too.
        label = "decades above (red) or below (blue) the bound"
        figure.colorbar(image, location="bottom", label=label, shrink=0.6, aspect=40)


def _decades(run: Run) -> float:
    ratio = run.error / run.bound
    return float(np.clip(math.log10(max(ratio, 1e-12)), -6.0, 6.0)) if math.isfinite(ratio) else 6.0
