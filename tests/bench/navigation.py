"""Navigation filter and controllers on it: results of docs/sensors.md.

python tests/bench/navigation.py [filter] [control] [--out docs/_static/navigation]
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym.studies import navigation
from uvms_gym.studies.records import circumstances, write_json


def print_filter(found: dict[str, Any]) -> None:
    """Print NIS, NEES and errors."""
    for name, row in found["nis"].items():
        means, bands = np.array(row["mean"]), np.array(row["band"])
        inside, band = np.count_nonzero(np.abs(means - 1.0) < bands), bands.max()
        whole = f"{means.mean():.4f} (1 within {band / np.sqrt(len(means)):.4f})"
        print(f"NIS of {name}: {whole}; {inside} of {len(means)} groups within {band:.4f}")
    nees = found["nees"]
    means, inside = np.array(nees["mean"]), np.abs(np.array(nees["mean"]) - 1.0) < nees["band"]
    print(f"NEES: mean {means.mean():.4f}, {inside.mean():.0%} of the seconds within {nees['band']:.4f} of 1")
    print(", ".join(f"{name} {value:.3g}" for name, value in found["rms"].items()))
    print(f"update: {found['update_time']:.2f} us per instance")


def print_control(found: dict[str, Any]) -> None:
    """Print the table of controllers and measurements."""
    print("| controller | measurement | position, mm | attitude, degrees | power, % | estimate, mm |")
    print("|---|---|---|---|---|---|")
    for name, rows in found.items():
        for label, row in rows.items():
            parts = [np.mean(row[key]) for key in ("position_mm", "attitude_deg", "power_percent")]
            interval = 1.96 * np.std(row["position_mm"]) / np.sqrt(len(row["position_mm"]))
            estimate = "" if row["estimate_mm"] is None else f"{row['estimate_mm']:.1f}"
            print(
                f"| {name} | {label} | {parts[0]:.1f} ± {interval:.1f} | {parts[1]:.2f} | {parts[2]:.2f} | {estimate} |"
            )


SECTIONS: dict[str, tuple[Callable[[], Any], Callable[[Any], None]]] = {
    "filter": (navigation.consistency, print_filter),
    "control": (navigation.control, print_control),
}


def main() -> None:
    """Run the sections."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], default=[])
    parser.add_argument("--out", type=Path, default=Path("docs/_static/navigation"))
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.sections or SECTIONS:
        study, show = SECTIONS[name]
        run = circumstances("tests/bench/navigation.py", {"section": name})
        found = study()
        show(found)
        write_json(arguments.out / f"{name}.json", {"circumstances": run, "results": found})


if __name__ == "__main__":
    main()
