"""Whole comparisons: contenders under conditions, and their summaries as data."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from uvms_gym.controllers import registry
from uvms_gym.controllers.families import canonical, compared, is_file, names, true_state
from uvms_gym.studies.comparison.conditions import DEPARTURES, Condition, informed
from uvms_gym.studies.comparison.contenders import Contender, EpisodeScores, make_contender, make_envs, run
from uvms_gym.studies.comparison.statistics import CONFIDENCE, RESAMPLES
from uvms_gym.studies.comparison.summary import Summary
from uvms_gym.studies.records import plain, rounded

if TYPE_CHECKING:
    from uvms_gym.studies.comparison.unfinished import Scores

#: Note in place of a controller without a shipped policy.
NO_POLICY = "no policy"
#: Arguments of environments that results hold by name; the others are in `env_kwargs`.
STORED = ("action", "max_current")

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
    conditions: Sequence[Condition], chosen: Sequence[str] | None = None, frontier: bool = False
) -> list[Comparison]:
    """Make all controllers of all conditions.

    Parameters
    ----------
    conditions : sequence of Condition
    chosen : sequence of str or None
        Controllers; each takes part in the tasks that it suits. None: all of each task, without those that lack a
        policy.
    frontier : bool
        Without `chosen`: also settings along the frontier, and bounds.

    Raises
    ------
    ValueError, TypeError
        A controller is unknown or suits no task, has no policy, does not fit, or a file is broken.
    OSError
        A file cannot be read.
    """
    chosen = None if chosen is None else [canonical(name) for name in chosen]
    for name in chosen or ():
        if not any(suits(name, condition) for condition in conditions):
            canonical(name, task=conditions[0].designed["task"])
    return [
        make_comparison(condition, compared(condition.designed["task"], frontier))
        if chosen is None
        else make_comparison(condition, [name for name in chosen if suits(name, condition)], required=True)
        for condition in conditions
    ]


def suits(name: str, condition: Condition) -> bool:
    """True for a controller of the condition's task, and for files."""
    return is_file(name) or name in names(condition.designed["task"])


def make_comparison(
    condition: Condition,
    names: Sequence[str],
    required: bool = False,
    seeds: Mapping[str, tuple[int, ...]] = {},
) -> Comparison:
    """Make the controllers of a condition; those without a policy are missing, or an error if `required`.

    `seeds` are the training seeds by controller, where they are not all that are there.

    Raises
    ------
    ValueError, TypeError, OSError
        See `make_comparisons`.
    """
    contenders, missing = {}, {}
    for name in names:
        try:
            contenders[name] = make_contender(condition, name, seeds.get(name))
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
    kept: "Scores | dict[str, EpisodeScores] | None" = None,
) -> dict[str, EpisodeScores]:
    """Run all contenders over the episodes with seeds from `seed` on.

    `tick` is called with the control periods of each part. Contenders in `kept` are not run again; the others are added
    to it when they are finished.

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
    for state in (None, "late", "present"):
        contenders = {
            name: one for name, one in comparison.contenders.items() if true_state(name) == state and name not in found
        }
        if contenders:
            condition = informed(comparison.condition, state)
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
        f"{comparison.condition.name}/{name}/{key}": matrix
        for name, scored in runs.items()
        for key, matrix in scored.scores.items()
    }


def design(comparison: Comparison) -> dict[str, Any]:
    """All about a comparison that is known before it is run."""
    condition = comparison.condition
    return {
        "env": condition.env,
        "scene": condition.scene,
        "disturbance": condition.level,
        "condition": condition.departure,
        "summary": DEPARTURES[condition.departure].summary,
        "options": {key: value for key, value in condition.options.items() if key != "scene"},
        "steps": condition.steps,
        "missing": comparison.missing,
    }


def as_data(comparison: Comparison, summary: Summary) -> dict[str, Any]:
    """Condition and statistics as a dictionary."""
    statistics = {key: value for key, value in summary._asdict().items() if key not in ("thresholds", "profiles")}
    profiles = {"thresholds": summary.thresholds, **summary.profiles}
    return {**design(comparison), **statistics, "profiles": profiles}


def as_document(
    circumstances: Mapping[str, Any], seed: int, results: Iterable[tuple[Comparison, Summary]]
) -> dict[str, Any]:
    """All that is stored of a run; `verification` makes it once more, and compares every entry."""
    return {
        "circumstances": circumstances,
        "statistics": {"resamples": RESAMPLES, "confidence": CONFIDENCE, "seed": seed},
        "results": [rounded(plain(as_data(*result))) for result in results],
    }
