"""Accuracy of one scene: errors, costs, drift, recommended steps, and acceptance criteria."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from uvms_gym.studies.accuracy import conservation, work_precision
from uvms_gym.studies.accuracy.work_precision import PRECISIONS, Setting, at_cost, find

#: Step of criteria and of the comparison at equal cost, s, and the time, s, and scene that they are stated for.
STEP, TIME, SCENE = 0.01, 10.0, "petasus-pum"
#: Bounds on MK4's median error at the end effector, m; minimum error ratio at equal cost; maximum order deviation.
BOUNDS, MIN_RATIO, ORDER_TOLERANCE = {"f64": 1e-7, "f32": 1e-5}, 1000.0, 0.2
#: Method that MK4 is compared with at equal cost.
BASELINE = "semi-implicit-euler"
#: Steps and episodes for orders without kinks.
SMOOTH_STEPS, SMOOTH_EPISODES = (0.002, 0.005, 0.01, 0.02), 16


class Criterion(NamedTuple):
    """An acceptance criterion: text of what is bounded, found value, bound, and whether it is met."""

    what: str
    found: str
    bound: str
    met: bool


def study_scene(
    scene: dict[str, Any],
    settings: Sequence[Setting],
    *,
    episodes: int,
    seconds: float,
    seed: int,
    repeats: int,
) -> dict[str, Any]:
    """Run the whole accuracy study of a scene.

    Returns
    -------
    dict
        Results of `work_precision.study`, with `drift` by setting, `smooth_orders` without quadratic damping,
        `recommended` rows by precision, and the `comparison` at equal cost.
    """
    run: dict[str, Any] = {"seconds": seconds, "seed": seed}
    result = work_precision.study(scene, settings, episodes=episodes, repeats=repeats, **run)
    result["drift"] = conservation.drifts(scene, settings, episodes=episodes, **run)
    names = dict.fromkeys(setting.integrator for setting in settings if setting.tolerance is None)
    smooth = [Setting(name, "f64", step) for name in names for step in SMOOTH_STEPS]
    rows = work_precision.study(
        work_precision.without_kinks(scene), smooth, episodes=min(episodes, SMOOTH_EPISODES), repeats=0, **run
    )["rows"]
    result["smooth_orders"] = work_precision.orders(rows, result["stable_steps"])
    result["recommended"] = {precision: work_precision.recommend(result, precision) for precision in PRECISIONS}
    result["comparison"] = compare_at_equal_cost(result["rows"])
    return result


def compare_at_equal_cost(rows: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """Error of the baseline method at the CPU time of MK4 at `STEP`; None where either is missing."""
    row = find(rows, "mk4", "f64", STEP)
    baseline = None if row is None else at_cost(rows, BASELINE, row["cost"])
    if row is None or baseline is None:
        return None
    error = row["end_effector"]["median"]
    return {"cost": row["cost"], "error": error, "baseline_error": baseline, "ratio": baseline / error}


def criteria(results: Mapping[str, Any], seconds: float) -> list[Criterion]:
    """Acceptance criteria that results by scene can decide, after a motion of `seconds`."""
    found = []
    for name, result in results.items():
        for precision, bound in BOUNDS.items():
            row = find(result["rows"], "mk4", precision, STEP)
            if row is not None and seconds == TIME:
                error = row["end_effector"]["median"]
                what = f"{name}: MK4 {precision} at {STEP:g} s, median error at the end effector"
                found.append(Criterion(what, f"{error:.1e} m", f"{bound:g} m", error < bound))
        comparison = result["comparison"]
        if comparison is not None and name == SCENE and seconds == TIME:
            what = f"{name}: error of {BASELINE} at equal cost over the error of MK4 at {STEP:g} s"
            ratio = comparison["ratio"]
            found.append(Criterion(what, f"{ratio:.2g}", f"{MIN_RATIO:g}", ratio > MIN_RATIO))
    known = work_precision.integrators()
    deviations = [
        (abs(entry["order"] - known[method]["order"]), f"{method} {entry['order']:.2f}, {name}")
        for name, result in results.items()
        for method, entry in result["smooth_orders"].items()
    ]
    if deviations:
        deviation, where = max(deviations)
        what = f"orders without quadratic damping, maximum deviation from theory ({where})"
        found.append(Criterion(what, f"{deviation:.2f}", f"{ORDER_TOLERANCE:g}", deviation < ORDER_TOLERANCE))
    return found
