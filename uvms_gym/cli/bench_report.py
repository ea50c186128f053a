"""Tables of `uvms bench`."""

from collections.abc import Mapping, Sequence
from typing import Any

from uvms_gym.cli.output import say, table
from uvms_gym.studies.speed import derivatives
from uvms_gym.studies.speed.peers import ABA
from uvms_gym.studies.speed.physics import DT
from uvms_gym.studies.speed.plots import SHORT

NS, US = 1e9, 1e6


def spread(found: Mapping[str, float], scale: float = 1.0, digits: int = 0) -> str:
    """Median with quartiles."""
    median, low, high = (f"{scale * found[key]:.{digits}f}" for key in ("median", "low", "high"))
    return f"{median} [{low}, {high}]"


def print_all(results: dict[str, Any], run: dict[str, Any]) -> None:
    """Print the tables of all measured sections.

    `run` are the circumstances of the run, with its `load`.
    """
    arguments, machine = run["arguments"], run["machine"]
    before, after = (found[0] for found in (run["load"]["before"], run["load"]["after"]))
    ran = ", ".join(dict.fromkeys(row["instruction_set"] for row in results["physics"]))
    say(
        f"{machine['processor']}, {machine['cores']} cores, {ran}; load average {before:.2f} before and "
        f"{after:.2f} after; commit {(run['commit'] or 'unknown')[:12]}. Medians of {arguments['repeats']} "
        "interleaved rounds after one to warm up, [quartiles]; all states finite. Times are CPU time of the process "
        "for one thread, wall-clock time for several."
    )
    _print_physics(results["physics"])
    if results["parameters"]:
        rows = [
            (*_kind(row), row["instruction_set"], spread(row["percent"], 1.0, 1) + " %", row["bytes"])
            for row in results["parameters"]
        ]
        table("Parameters per instance", ("scene", "", "instructions", "cost", "bytes"), rows, text_columns=3)
    if results["threads"]:
        rows = []
        for row in results["threads"]:
            counts = (row[name] for name in ("n", "substeps", "threads"))
            rows.append((row["scene"], row["what"], SHORT[row["dtype"]], *counts, spread(row["ratio"], 1.0, 2)))
        header = ("scene", "", "", "n", "substeps", "threads", "times as fast as one")
        table(f"Threads, wall-clock time (load {before:.2f} to {after:.2f})", header, rows, text_columns=3)
    for section, show in (("environment", _print_environment), ("peers", _print_peers), ("learning", _print_learning)):
        if section in results:
            show(results[section])


def _kind(row: Mapping[str, Any]) -> tuple[str, str]:
    return row["scene"], SHORT[row["dtype"]]


def _print_physics(found: Sequence[dict[str, Any]]) -> None:
    rows = []
    names = dict.fromkeys(row["integrator"] for row in found)
    for row in found:
        if not row["varied"]:
            counts = (row[name] for name in ("instruction_set", "threads", "n", "substeps"))
            times = (spread(row["seconds"], NS), f"{NS * row['seconds']['minimum']:.0f}")
            rows.append((*_kind(row), *counts, *times, f"{1e-6 * row['steps_per_second']:.3f}", row["bytes"]))
    name = ", ".join(name.upper() if name.startswith("mk") else name for name in names)
    header = ("scene", "", "instructions", "threads", "n", "substeps", "ns", "minimum", "M steps/s", "bytes")
    table(f"{name}: ns per step and instance, bytes per instance", header, rows, text_columns=3)


def _print_environment(found: dict[str, Any]) -> None:
    rows = []
    for row in found["vector"]:
        times = (f"{NS * row[name]['median']:.0f}" for name in ("env", "physics", "physics_alone"))
        shares = (f"{spread(row[name], 1.0, 1)} %" for name in ("percent", "percent_of_alone"))
        rows.append([*_kind(row), row["threads"], row["n"], *times, *shares])
    substeps = found["vector"][0]["substeps"]
    parts = ("env", "physics", "alone", "above physics", "above alone")
    header: tuple[str, ...] = ("scene", "", "threads", "n", *parts)
    table(f"make_vec: ns per control step ({substeps} substeps) and instance", header, rows, text_columns=2)
    rows = []
    for row in found["single"]:
        times = (spread(row[name], US, 1) for name in ("env", "physics", "physics_alone", "above", "above_alone"))
        rows.append([*_kind(row), *times])
    header = ("scene", "", *parts)
    table(f"make: us per control step ({substeps} substeps), one environment", header, rows, text_columns=2)
    rows = []
    for row in found["gymnasium"]:
        rate = row["steps_per_second"]
        rate = "Gymnasium lacks it" if rate is None else f"{rate:.0f}"
        rows.append([row["scene"], row["threads"], row["n"], rate])
    header = ("scene", "threads", "n", "control steps per second")
    table("gymnasium.utils.performance.benchmark_vector_step", header, rows)
    say(
        "Episodes of make_vec are out of phase: some of them end and restart at every step. Physics is a Python call "
        "of Simulator.step with the same substeps, thrusts and cubic joint references; alone is the cost of as many "
        "more substeps within a call, physics only. One environment is timed with all wrappers of make, call by call, "
        "in wall-clock time. Gymnasium's benchmark draws its random actions while it measures."
    )


def _print_peers(found: dict[str, Any]) -> None:
    names = ", ".join(f"{name} {version}" for name, version in found["versions"].items())
    for scene, result in found["scenes"].items():
        step, off = result["step"], result["dry_difference"]
        rows = []
        for name, seconds in step["seconds"].items():
            ratios = (step["ratios"][dtype].get(name) for dtype in SHORT)
            cells = ("" if ratio is None else spread(ratio, 1.0, 1) for ratio in ratios)
            rows.append([name, spread(seconds, NS), f"{NS * seconds['minimum']:.0f}", *cells])
        title = f"{scene}: ns per step and instance, one thread ({names})"
        table(title, ("program", "ns", "minimum", "times ours, f64", "times ours, f32"), rows)
        say(
            f"Ours: MK4, {step['n']} instances, {step['substeps']} substeps per call, {step['instruction_set']}. "
            f"{ABA}: the dynamics of four states. Without water the accelerations of MuJoCo's model differ from ours "
            f"by {off['mujoco']:.0e} relative, and Pinocchio's by {off['pinocchio']:.0e}, over random states."
        )
        _print_equal(scene, result["equal_error"], step["seconds"])
        _print_derivatives(scene, result["derivatives"])
    if found["vector"]:
        rows = []
        for row in found["vector"]:
            for name, peer in row["peers"].items():
                times = (spread(row["ours"], US, 2), spread(peer["seconds"], US), spread(peer["ratio"], 1.0, 1))
                rows.append([row["scene"], name, row["threads"], *times])
        header = ("scene", "program", "threads", "make_vec", "theirs", "ratio")
        n, substeps = (found["vector"][0][what] for what in ("n", "substeps"))
        title = f"make_vec, f64, {n} instances, against {substeps} steps of MuJoCo: us per control step and instance"
        table(title, header, rows, text_columns=2)
    for paragraph in found["scope"].splitlines():
        say(paragraph)


def _print_equal(scene: str, found: dict[str, Any], seconds: dict[str, Any]) -> None:
    rows = []
    for dtype, short in SHORT.items():
        ours = DT / seconds[f"ours, {short}"]["median"]
        rows.append([f"ours, MK4 {short}", f"{found['ours'][dtype]:.1e}", f"{DT:g}", "", f"{ours:.3g}", ""])
        for integrator, their in found["theirs"].items():
            equal = their["equal"][dtype]
            rate = equal["step"] / seconds[f"MuJoCo {integrator}"]["median"]
            step = f"{equal['step']:.1e}{' *' if equal['extrapolated'] else ''}"
            cells = [step, f"{their['order']:.2f}", f"{rate:.3g}", f"{ours / rate:.3g}"]
            rows.append([f"MuJoCo {integrator}", "the same", *cells])
    title = f"{scene}: simulated seconds per second at equal error, one thread"
    table(title, ("program", "error, m", "step, s", "order", "s per s", "ours is times as fast"), rows)
    say(
        "Error: median distance of the vehicle's position from a fine reference of the same program after "
        f"{found['time']:g} s of {found['motions']} motions (random initial twist, constant thrusts, arm at home). "
        f"Doubling the references' steps changes them by {found['uncertainty']['ours']:.0e} m (ours) and "
        f"{found['uncertainty']['theirs']:.0e} m (MuJoCo's). *: extrapolated on the line through the nearest two steps."
    )


def _print_derivatives(scene: str, found: dict[str, Any]) -> None:
    rows = []
    for name, what in derivatives.CASES.items():
        ratio = found["ratios"].get(name)
        times = spread(found["seconds"][name], US, 1), "" if ratio is None else spread(ratio, 1.0, 2)
        rows.append([name, *what, *times])
    title = f"{scene}: us for all derivatives of a state, one thread"
    table(title, ("program", "of", "water", "us", "times ours"), rows, text_columns=3)
    errors = ", ".join(f"{error:.0e} {name}" for name, error in found["errors"].items())
    say(
        f"{derivatives.SCOPE} Errors of MuJoCo's, over the maximum derivative of a column: {errors}. Of Pinocchio's, "
        f"{spread(found['call'], US, 1)} us of the call from Python are subtracted, as measured with aba."
    )


def _print_learning(found: dict[str, Any]) -> None:
    rows = [
        ("collecting and learning, steps/s", spread(found["steps_per_second"])),
        ("collecting alone, steps/s", spread(found["collecting_steps_per_second"])),
        ("share of the environment", f"{spread(found['share_of_environment'], 100.0, 1)} %"),
    ]
    title = f"{found['scene']}: Stable-Baselines3, {found['n']} environments, {found['threads']} threads"
    table(title, ("quantity", "found"), rows)
    say(f"{found['algorithm']}, torch on {found['torch_threads']} threads. The VecEnv is {found['wrapper']}.")
