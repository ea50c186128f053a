"""Statistics of a comparison: every controller, and every controller relative to the classical ones."""

from collections import Counter
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from uvms_gym.controllers.families import MLP_PREFIX, is_bound, is_file, names, true_state
from uvms_gym.studies.comparison.contenders import Contender, EpisodeScores
from uvms_gym.studies.comparison.metrics import HEADLINE, METRICS, RANKED, Metric, by_metric
from uvms_gym.studies.comparison.statistics import Draws, Estimate, Profile, Sample, Scores
from uvms_gym.studies.numerics import Floats

#: Classical controllers that others are compared with.
BASELINES = tuple(name for name in names(learned=False) if name not in ("none", "dock-pd") and not is_bound(name))
#: Number of thresholds of performance profiles.
THRESHOLDS = 80
#: Number of episodes with individually stored scores, for verification.
KEPT = 16


class Summary(NamedTuple):
    """Statistics of a comparison.

    Attributes
    ----------
    controllers : dict
        Per controller: seeds, episodes, seconds, origin, and `metrics`: per metric and part the estimates `iqm` (for
        shares `mean`) and `p95`, of errors also the numbers `p999`, the 99.9th percentile, and `worst`.
    against : dict
        Per baseline and controller the ratios of errors and costs; differences and probabilities of improvement over
        `baseline`.
    baseline : str
        First of the baselines.
    winner, runner_up : str
        Controllers with the minimum and second minimum error, but for bounds.
    margin : Estimate
        Ratio of the winner's error to the runner-up's.
    thresholds : Floats
        Thresholds of the profiles, m.
    profiles : dict
        Performance profiles per controller, without `none`.
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
    """Statistics of one controller, metric and part."""

    mean: Sample
    p95: Sample
    profile: Profile


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Names for tables and pictures: of a file without folder and suffix, with a number where two would be alike."""
    shorts = {
        name: name.rsplit("/", 1)[-1].removeprefix(MLP_PREFIX).removesuffix(".safetensors") if is_file(name) else name
        for name in names
    }
    alike, numbers = Counter(shorts.values()), Counter[str]()
    for name, short in shorts.items():
        if short != name and alike[short] > 1:
            numbers[short] += 1
            shorts[name] = f"{short} {numbers[short]}"
    return shorts


def closed_share(summary: Summary, name: str) -> float | None:
    """Share of the gap between the baseline and the bound that a controller closes; None without.

    The bound is the best controller that receives the true state as late as the measurements; without one in the
    comparison, the best that receives the present state, which no controller on late measurements can reach.
    """
    value: dict[str, float] = {
        n: entry["metrics"][HEADLINE]["whole"]["iqm"].value for n, entry in summary.controllers.items()
    }
    by_state = {state: [value[other] for other in value if true_state(other) == state] for state in ("late", "present")}
    bounds = by_state["late"] or by_state["present"]
    if not bounds or name == summary.baseline:
        return None
    base = value[summary.baseline]
    return (base - value[name]) / (base - min(bounds))


def first_baseline(names: Any) -> str:
    """First baseline: the paper's PD or resolved motion, else another classical controller, else the first name."""
    return next((name for name in ("pd", "resolved", "dock-pd", *BASELINES) if name in names), next(iter(names)))


def baselines(names: Any) -> list[str]:
    """Classical controllers among `names`, or the first baseline."""
    return [name for name in names if name in BASELINES] or [first_baseline(names)]


def summarise(contenders: Mapping[str, Contender], runs: Mapping[str, EpisodeScores], seed: int) -> Summary:
    """Estimate every metric of every controller, and ratios to the baselines; `seed` is the seed of the resampling."""
    names = list(runs)
    episodes = next(iter(runs.values())).scores[RANKED].shape[1]
    draws = Draws(episodes, seed)
    # Errors without control have another magnitude.
    profiled = [name for name in names if name != "none"] or names
    thresholds = _thresholds([runs[name].scores[RANKED] for name in profiled])

    def estimate(name: str) -> tuple[str, dict[str, _Statistics]]:
        found = {}
        for key, scores in runs[name].scores.items():
            asked = thresholds if key == RANKED else ()
            found[key] = _Statistics(*Scores(scores, draws).statistics(_metric(key).cut, thresholds=asked))
        return name, found

    first = first_baseline(names)

    def compare(name: str) -> dict[str, Any]:
        return _against(runs[name].scores, runs[first].scores, draws)

    with ThreadPoolExecutor(2) as pool:
        found = dict(pool.map(estimate, names))
        others = [name for name in names if name != first]
        compared = dict(zip(others, pool.map(compare, others), strict=True))
    against: dict[str, dict[str, Any]] = {}
    for other in baselines(names):
        ratios = {name: _ratios(found[name], found[other]) for name in names if name != other}
        if other == first:
            for name, values in compared.items():
                ratios[name] |= {key: ratios[name].get(key, {}) | part for key, part in values.items()}
        against[other] = {name: by_metric(entries) for name, entries in ratios.items()}
    headline = {name: found[name][RANKED].mean for name in names}
    rivals = [name for name in names if not is_bound(name)] or names
    ranking = sorted(rivals, key=lambda name: headline[name].value)
    margin = headline[ranking[0]].over(headline[ranking[1]]).estimate() if len(ranking) > 1 else None
    return Summary(
        {name: _described(contenders[name], runs[name], found[name]) for name in names},
        against,
        first,
        ranking[0],
        ranking[1] if len(ranking) > 1 else None,
        margin,
        np.asarray(thresholds),
        {name: found[name][RANKED].profile for name in profiled},
    )


def _metric(key: str) -> Metric:
    return METRICS[key.split("/")[0]]


def _described(contender: Contender, run: EpisodeScores, found: Mapping[str, _Statistics]) -> dict[str, Any]:
    estimates: dict[str, dict[str, Any]] = {
        key: {"iqm": statistics.mean.estimate(), "p95": statistics.p95.estimate()}
        if _metric(key).cut
        else {"mean": statistics.mean.estimate()}
        for key, statistics in found.items()
    }
    for key, scores in run.scores.items():
        if _metric(key).error:
            estimates[key] |= {"p999": np.quantile(scores, 0.999), "worst": scores.max()}
    return {
        "training_seeds": contender.seeds,
        "origin": contender.origin,
        "episodes": run.scores[RANKED].shape[1],
        "seconds": run.seconds,
        "metrics": by_metric(estimates),
        "kept": {metric: run.scores[f"{metric}/whole"][:, :KEPT] for metric in (HEADLINE, "power")},
    }


def _ratios(mine: Mapping[str, _Statistics], theirs: Mapping[str, _Statistics]) -> dict[str, Any]:
    """Ratios of means and 95th percentiles to a baseline's, for errors and costs, by "metric/part"."""
    return {
        key: {
            "ratio": statistics.mean.over(theirs[key].mean).estimate(),
            "p95_ratio": statistics.p95.over(theirs[key].p95).estimate(),
        }
        for key, statistics in mine.items()
        if _metric(key).cut and _metric(key).less_is_better
    }


def _against(mine: Mapping[str, Floats], theirs: Mapping[str, Floats], draws: Draws) -> dict[str, Any]:
    """Paired differences and the probability of improvement over the baseline, for the errors, by "metric/part"."""
    return {
        # Seeds of the baseline are averaged in each episode.
        key: {
            "difference": Scores(x - theirs[key].mean(axis=0), draws).statistics()[0].estimate(),
            "probability_of_improvement": Scores(x, draws).improvement(Scores(theirs[key], draws)).estimate(),
        }
        for key, x in mine.items()
        if _metric(key).error
    }


def _thresholds(scores: list[Floats]) -> list[float]:
    """Thresholds over the range of the profiles between 0 and nearly 1."""
    low = min(float(np.quantile(score, 0.005)) for score in scores)
    high = max(float(np.quantile(score, 0.98)) for score in scores)
    if not 0.0 < low < high:
        return list(np.linspace(0.0, max(high, 1e-9), THRESHOLDS))
    return list(np.geomspace(low, high, THRESHOLDS))
