"""What a cell's scores say: statistics of every controller, and of every controller against the others."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvms_gym.cli.compare_runs import METRICS, Entrant, Scored
from uvms_gym.cli.statistics import Draws, Estimate, Profile, Sample, Scores
from uvms_gym.controllers.registry import LEARNED, MLP_PREFIX

Floats = NDArray[np.float64]

#: What decides who wins.
HEADLINE = "pose"
#: Classical controllers that others are set against, if they take part.
RIVALS = (
    "pd",
    "pd-restoring",
    "pid",
    "dob",
    "dob-delay",
    "dob-calm",
    "computed-torque",
    "mpc",
    "resolved",
    "resolved-pid",
    "resolved-dob",
)
#: Thresholds of performance profiles.
THRESHOLDS = 80
#: Episodes whose scores are kept one by one, to be reproduced.
KEPT = 16


class Summary(NamedTuple):
    """Statistics of a cell.

    Attributes
    ----------
    controllers : dict
        Per controller: seeds, episodes, seconds, origin, and `metrics`: per metric and part the estimates `iqm` (where
        the metric is a share, `mean`) and `p95`.
    against : dict
        Per rival and controller the ratios of headline, errors and costs, and more against the baseline.
    baseline : str
        Controller that all others are set against in all.
    winner, runner_up : str
        Least error, and least error but for that.
    margin : Estimate
        Error of the winner over that of the runner-up.
    thresholds : Floats
        Of the profiles.
    profiles : dict
        Per controller but `none`.
    """

    controllers: dict[str, Any]
    against: dict[str, dict[str, Any]]
    baseline: str
    winner: str
    runner_up: str | None
    margin: Estimate | None
    thresholds: Floats
    profiles: dict[str, Profile]


class _Statistics(NamedTuple):
    """Of one controller, metric and part."""

    mean: Sample
    p95: Sample
    profile: Profile


def is_learned(name: str) -> bool:
    """Whether a controller is a trained policy, or has one."""
    return name in LEARNED or name.startswith(MLP_PREFIX)


def baseline(names: Any) -> str:
    """Controller to set others against: the paper's PD, or what stands for it; else another rival, else the first."""
    return next((name for name in ("pd", "resolved", *RIVALS) if name in names), next(iter(names)))


def rivals(names: Any) -> list[str]:
    """Classical controllers to set others against; the baseline if there are none."""
    return [name for name in names if name in RIVALS] or [baseline(names)]


def summarise(entrants: Mapping[str, Entrant], runs: Mapping[str, Scored], seed: int) -> Summary:
    """Estimate every metric of every controller, and set each against the others."""
    names = list(runs)
    episodes = next(iter(runs.values())).scores[HEADLINE]["whole"].shape[1]
    draws = Draws(episodes, seed)
    # Where nothing is controlled, errors are of another size.
    profiled = [name for name in names if name != "none"] or names
    thresholds = _thresholds([runs[name].scores[HEADLINE]["whole"] for name in profiled])

    def estimate(name: str) -> tuple[str, dict[tuple[str, str], _Statistics]]:
        found = {}
        for metric, description in METRICS.items():
            for part in description.parts:
                scores = Scores(runs[name].scores[metric][part], draws)
                asked = thresholds if (metric, part) == (HEADLINE, "whole") else ()
                found[metric, part] = _Statistics(*scores.statistics(description.cut, thresholds=asked))
        return name, found

    against: dict[str, dict[str, Any]] = {}
    first = baseline(names)

    def compare(name: str) -> dict[str, Any]:
        return _against(runs[name].scores, runs[first].scores, draws)

    with ThreadPoolExecutor(2) as pool:
        found = dict(pool.map(estimate, names))
        others = [name for name in names if name != first]
        compared = dict(zip(others, pool.map(compare, others), strict=True))
    for rival in rivals(names):
        against[rival] = {name: _ratios(found[name], found[rival]) for name in names if name != rival}
    for name in others:
        for metric, parts in compared[name].items():
            for part, values in parts.items():
                against[first][name].setdefault(metric, {}).setdefault(part, {}).update(values)
    headline = {name: found[name][HEADLINE, "whole"].mean for name in names}
    ranking = sorted(names, key=lambda name: headline[name].value)
    margin = headline[ranking[0]].over(headline[ranking[1]]).estimate() if len(names) > 1 else None
    return Summary(
        {name: _described(entrants[name], runs[name], found[name]) for name in names},
        against,
        first,
        ranking[0],
        ranking[1] if len(names) > 1 else None,
        margin,
        np.asarray(thresholds),
        {name: found[name][HEADLINE, "whole"].profile for name in profiled},
    )


def _described(entrant: Entrant, run: Scored, found: Mapping[tuple[str, str], _Statistics]) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    for (metric, part), statistics in found.items():
        mean = "iqm" if METRICS[metric].cut else "mean"
        metrics.setdefault(metric, {})[part] = {mean: statistics.mean.estimate()}
        if METRICS[metric].cut:
            metrics[metric][part]["p95"] = statistics.p95.estimate()
    scores = run.scores[HEADLINE]["whole"]
    return {
        "training_seeds": entrant.seeds,
        "origin": entrant.origin,
        "episodes": scores.shape[1],
        "seconds": run.seconds,
        "metrics": metrics,
        "kept": {metric: run.scores[metric]["whole"][:, :KEPT] for metric in (HEADLINE, "effort")},
    }


def _ratios(mine: Mapping[tuple[str, str], _Statistics], theirs: Mapping[tuple[str, str], _Statistics]) -> Any:
    """Ratios of means and 95th percentiles to a rival's, of what is not negative and mostly not 0."""
    result: dict[str, Any] = {}
    for (metric, part), statistics in mine.items():
        if METRICS[metric].cut and METRICS[metric].less:
            other = theirs[metric, part]
            result.setdefault(metric, {})[part] = {
                "ratio": statistics.mean.over(other.mean).estimate(),
                "p95_ratio": statistics.p95.over(other.p95).estimate(),
            }
    return result


def _against(mine: Any, theirs: Any, draws: Draws) -> dict[str, Any]:
    """Paired differences and the probability of improvement over the baseline, for the errors."""
    result: dict[str, Any] = {}
    for metric, description in METRICS.items():
        if not description.error:
            continue
        for part in description.parts:
            # Several seeds of the baseline are as one: their mean in each episode.
            x, y = mine[metric][part], theirs[metric][part]
            result.setdefault(metric, {})[part] = {
                "difference": Scores(x - y.mean(axis=0), draws).statistics()[0].estimate(),
                "probability_of_improvement": Scores(x, draws).improvement(Scores(y, draws)).estimate(),
            }
    return result


def _thresholds(scores: list[Floats]) -> list[float]:
    """Thresholds from where profiles leave 0 to where they reach 1, or nearly so."""
    low = min(float(np.quantile(score, 0.005)) for score in scores)
    high = max(float(np.quantile(score, 0.98)) for score in scores)
    if not 0.0 < low < high:
        return list(np.linspace(0.0, max(high, 1e-9), THRESHOLDS))
    return list(np.geomspace(low, high, THRESHOLDS))
