"""Contact beside MuJoCo, added mass as a lagged force, and cost of contact: results of docs/contact.md.

python tests/bench/contact.py [peers] [added-mass] [cost] [--out docs/_static/contact] [--picture FILE.png]

Without names all three. Prints tables, and writes a JSON file for each into the folder.
"""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from uvms_gym.studies.contact import cost, lagged_added_mass, peers
from uvms_gym.studies.contact.plots import plot_lagged_added_mass
from uvms_gym.studies.records import circumstances, write_json


def print_peers(rows: list[dict[str, Any]]) -> None:
    """Print a table for each scene."""
    for row in rows:
        time_constant, ratio = row["parameters"]
        print(f"\n{row['scene']}: {row['description']}; solref {time_constant:.5g} {ratio:.4g}\n")
        names = list(row["programs"][peers.OURS]["results"])
        steps = " | ".join(f"{1e3 * step:g} ms" for step in row["steps"])
        print(f"| program | {' | '.join(names)} | depth, mm | at rest, s | within 1 %, ms | us per s | {steps} |")
        for title, found in row["programs"].items():
            results = " | ".join(f"{found['results'][name]:.6g}" for name in names)
            coarsest = found["coarsest"]
            price = f"{1e6 * found['cost']['median']:.0f}" if found["cost"] else ""
            price += f" ({1e6 * found['cost_of_one']['median']:.0f})" if found["cost_of_one"] else ""
            off = " | ".join(f"{deviation:.1e}" for deviation in found["deviations"])
            step = f"{1e3 * coarsest:g}" if coarsest else "none"
            print(
                f"| {title} | {results} | {1e3 * found['depth']:.4f} | {found['time_to_rest']:.2f} | {step} | {price} "
                f"| {off} |"
            )


def print_added_mass(found: dict[str, Any]) -> None:
    """Print deviations by method, step and ratio."""
    print(f"\nbounds {found['bounds']}, uncertainty of the references {found['uncertainty']} m")
    for place, methods in found["errors"].items():
        print(f"\n{place}\n\n| method | step, ms | {' | '.join(f'{ratio:g}' for ratio in found['ratios'])} |")
        for method, table in methods.items():
            for step, row in zip(found["steps"], table):
                cells = " | ".join(f"{off:.1e}" if math.isfinite(off) else "diverged" for off in row)
                print(f"| {method} | {1e3 * step:g} | {cells} |")


def print_cost(found: dict[str, Any]) -> None:
    """Print times per step."""
    print(f"\n{found['scene']}, {1e3 * found['step']:g} ms, {found['instances']} instances, one thread: ns per step\n")
    for name, row in found["cases"].items():
        times = " / ".join(f"{row['nanoseconds'][dtype]['median']:.0f}" for dtype in cost.DTYPES)
        print(f"| {name} | {times} | {row['touching']} touch, turn {row['turn']} |")


SECTIONS: dict[str, tuple[Callable[[], Any], Callable[[Any], None]]] = {
    "peers": (peers.study, print_peers),
    "added-mass": (lagged_added_mass.study, print_added_mass),
    "cost": (cost.study, print_cost),
}


def main() -> None:
    """Run the sections."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], default=[])
    parser.add_argument("--out", type=Path, default=Path("docs/_static/contact"))
    parser.add_argument("--picture", type=Path, help="picture of the section added-mass")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in arguments.sections or SECTIONS:
        study, show = SECTIONS[name]
        run = circumstances("tests/bench/contact.py", {"section": name})
        found = study()
        if name == "peers":
            import mujoco

            run["mujoco"] = mujoco.__version__
        show(found)
        if name == "added-mass":
            if arguments.picture:
                plot_lagged_added_mass(arguments.picture, found)
            del found["time"], found["positions"]
        write_json(arguments.out / f"{name}.json", {"circumstances": run, "results": found})


if __name__ == "__main__":
    main()
