"""Whole comparisons: contenders under conditions, their summaries as data, and verification of stored results."""

import json
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import uvms_gym
from uvms_gym.controllers import registry
from uvms_gym.studies.comparison.conditions import DEPARTURES, Condition, informed, make_conditions
from uvms_gym.studies.comparison.contenders import Contender, EpisodeScores, make_contender, make_envs, run
from uvms_gym.studies.comparison.own import PREFIX
from uvms_gym.studies.comparison.summary import KEPT, Summary, summarise

#: Note in place of a controller without a shipped policy.
NO_POLICY = "no policy"
#: Arguments of environments that results hold by name; the others are in `env_kwargs`.
STORED = ("action", "max_current")
#: Relative tolerance of stored numbers, which other machines reproduce.
TOLERANCE = 1e-4

Tick = Callable[[int], object]


class Comparison(NamedTuple):
    """A condition with its contenders, and the reasons for missing ones."""

    condition: Condition
    contenders: dict[str, Contender]
    missing: dict[str, str]

    @property
    def work(self) -> int:
        """Control periods of an episode by all controllers, all training seeds."""
        return self.condition.steps * sum(len(contender.controllers) for contender in self.contenders.values())


def make_comparisons(
    conditions: Sequence[Condition], names: Sequence[str] | None = None, frontier: bool = False
) -> list[Comparison]:
    """Make all controllers of all conditions.

    Parameters
    ----------
    conditions : sequence of Condition
    names : sequence of str or None
        Controllers; each takes part in the tasks that it suits. None: all of each task with a shipped policy.
    frontier : bool
        Without `names`: also variants along the frontier, and bounds.

    Raises
    ------
    ValueError, TypeError
        A controller is unknown or suits no task, has no policy, does not fit, or a file is broken.
    OSError
        A file cannot be read.
    """
    for name in names or ():
        if not any(_suits(name, condition) for condition in conditions):
            registry.check_name(name, conditions[0].designed["task"])
    return [
        make_comparison(condition, (registry.names if frontier else registry.rivals)(condition.designed["task"]))
        if names is None
        else make_comparison(condition, [name for name in names if _suits(name, condition)], required=True)
        for condition in conditions
    ]


def _suits(name: str, condition: Condition) -> bool:
    return name in registry.names(condition.designed["task"]) or name.startswith((registry.MLP_PREFIX, PREFIX))


def make_comparison(condition: Condition, names: Sequence[str], required: bool = False) -> Comparison:
    """Make the controllers of a condition; those without a policy are missing, or an error if `required`.

    Raises
    ------
    ValueError, TypeError, OSError
        See `make_comparisons`.
    """
    contenders, missing = {}, {}
    for name in names:
        try:
            contenders[name] = make_contender(condition, name)
        except registry.Unavailable:
            if required:
                raise
            missing[name] = NO_POLICY
        except (ValueError, TypeError) as error:
            raise ValueError(f"{condition.env}: {error}") from None
    if not contenders:
        raise ValueError(f"{condition.name}: there is no controller for it")
    return Comparison(condition, contenders, missing)


def run_all(
    comparison: Comparison,
    episodes: int,
    seed: int,
    tick: Tick = lambda steps: None,
    kept: MutableMapping[str, EpisodeScores] | None = None,
) -> dict[str, EpisodeScores]:
    """Run all contenders over the episodes with seeds from `seed` on; `tick` is told the control periods of each part.

    Those in `kept` are not run again; each of the others is added to it at its end.

    Raises
    ------
    ValueError, TypeError, gymnasium.error.Error
        The environment refuses its arguments, or a controller does not fit it.
    """
    found: dict[str, EpisodeScores] = {}
    kept = {} if kept is None else kept
    for name, contender in comparison.contenders.items():
        if scores := kept.get(name):
            found[name] = scores
            tick(comparison.condition.steps * len(contender.controllers))
    for bound in (False, True):
        contenders = {
            name: one for name, one in comparison.contenders.items() if one.bound is bound and name not in found
        }
        if contenders:
            condition = informed(comparison.condition) if bound else comparison.condition
            envs = make_envs(condition, episodes)
            try:
                for name, contender in contenders.items():
                    found[name] = kept[name] = run(envs, condition, contender, seed, tick)
            finally:
                envs.close()
    return {name: found[name] for name in comparison.contenders}


def scores_by_name(comparison: Comparison, runs: Mapping[str, EpisodeScores]) -> dict[str, NDArray[np.float64]]:
    """All scores (S, N) by "condition/controller/metric/part"."""
    return {
        "/".join((comparison.condition.name, name, metric, part)): matrix
        for name, scored in runs.items()
        for metric, parts in scored.scores.items()
        for part, matrix in parts.items()
    }


def as_data(comparison: Comparison, summary: Summary) -> dict[str, Any]:
    """Condition and statistics as a dictionary, which `verify` reads."""
    condition, profiles = comparison.condition, dict(summary.profiles)
    data = {key: value for key, value in summary._asdict().items() if key not in ("thresholds", "profiles")}
    return {
        "env": condition.env,
        "scene": condition.scene,
        "disturbance": condition.level,
        "condition": condition.departure,
        "summary": DEPARTURES[condition.departure].summary,
        "options": {key: value for key, value in condition.options.items() if key != "scene"},
        "steps": condition.steps,
        **data,
        "missing": comparison.missing,
        "profiles": {"thresholds": summary.thresholds, **profiles},
    }


def verify(path: Path, full: bool = False, tolerance: float = TOLERANCE) -> list[str]:
    """Run stored comparisons again.

    Parameters
    ----------
    path : Path
        A compare.json, or the results.json of shipped policies.
    full : bool
        Compare all statistics over all episodes, not only the stored scores of the first episodes.
    tolerance : float
        Relative tolerance of numbers.

    Returns
    -------
    list of str
        A line for each difference.

    Raises
    ------
    ValueError
        The file holds no results, or a controller does not exist any more.
    OSError
        A file cannot be read.
    """
    differences = []
    for stored, comparison, seed, episodes in _read(path):
        name_of = comparison.condition.name
        differences += [f"{name_of}, {name}: {reason}" for name, reason in comparison.missing.items()]
        runs = run_all(comparison, episodes if full else min(episodes, KEPT), seed)
        summary = summarise(comparison.contenders, runs, seed) if full else None
        with _readable(path):
            pairs = list(_pairs(stored["controllers"], runs, summary))
        for what, old, new in pairs:
            if old.shape != new.shape:
                differences.append(f"{name_of}, {what}: shape {old.shape} is stored, {new.shape} found")
            elif not np.allclose(new, old, rtol=tolerance, atol=1e-9):
                worst = np.unravel_index(np.argmax(np.abs(new - old)), old.shape)
                differences.append(f"{name_of}, {what}: {old[worst]:.9g} is stored, {new[worst]:.9g} found")
    return differences


def _pairs(
    expected: Mapping[str, Any], runs: Mapping[str, EpisodeScores], summary: Summary | None
) -> Iterator[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
    """Names, stored and new values: of the first episodes, and of all statistics of a summary."""
    for name, scored in runs.items():
        for metric, rows in expected[name]["kept"].items():
            yield f"{name}, {metric}", np.asarray(rows, dtype=np.float64), scored.scores[metric]["whole"][:, :KEPT]
    for name, entry in summary.controllers.items() if summary else ():
        for metric, parts in entry["metrics"].items():
            for part, estimates in parts.items():
                for kind, estimate in estimates.items():
                    value = np.asarray(expected[name]["metrics"][metric][part][kind]["value"], dtype=np.float64)
                    yield f"{name}, {metric}, {part}, {kind}", value, np.asarray(estimate.value)


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Errors about the content of a file, as one that names the file."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} holds no results of uvms compare: {type(error).__name__}: {error}") from None


def _read(path: Path) -> list[tuple[dict[str, Any], Comparison, int, int]]:
    """Read stored results, each with its comparison, the seed of the first episode and the number of episodes."""
    with _readable(path):
        data = json.loads(path.read_text(encoding="utf-8"))
        arguments, results = data["circumstances"]["arguments"], data["results"]
        options = {name: arguments[name] for name in STORED if name in arguments} | arguments.get("env_kwargs", {})
        found = []
        for stored in results:
            scenes = {stored["scene"]: uvms_gym.load_scene(stored["scene"])}
            levels = [] if stored["disturbance"] is None else [stored["disturbance"]]
            (condition,) = make_conditions([stored["env"]], scenes, levels, [stored["condition"]], **options)
            comparison = make_comparison(condition, list(stored["controllers"]))
            episodes = min(int(entry["episodes"]) for entry in stored["controllers"].values())
            found.append((stored, comparison, int(arguments["seed"]), episodes))
        if not found:
            raise ValueError("the list of results is empty")
    return found
