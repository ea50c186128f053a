"""Contenders of a comparison: controllers with all their training seeds, and their scores over episodes."""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from uvms_gym import Rollout
from uvms_gym._files import read
from uvms_gym.controllers import MLP, Blend, Residual, registry
from uvms_gym.controllers.families import CODE_PREFIX, MLP_PREFIX, is_file, true_state
from uvms_gym.rollouts import RolloutStats
from uvms_gym.studies.comparison.conditions import Condition, informed
from uvms_gym.studies.comparison.metrics import METRICS, SETTLED
from uvms_gym.studies.comparison.own import PredictRollout, file_of, load
from uvms_gym.studies.numerics import Floats


class Contender(NamedTuple):
    """A controller under a condition.

    Attributes
    ----------
    name : str
    seeds : tuple of int
        Training seeds; empty for classical controllers.
    controllers : list
        One per training seed, or one; of `py:FILE:NAME` any object with `predict`.
    origin : dict
        Gains and their tuning, or files with digests and notes.
    """

    name: str
    seeds: tuple[int, ...]
    controllers: list[Any]
    origin: dict[str, Any]


class EpisodeScores(NamedTuple):
    """Scores (S, N) of a contender by "metric/part", seeds by episodes, and the time of the run, s."""

    scores: dict[str, Floats]
    seconds: float


def make_contender(condition: Condition, name: str, seeds: tuple[int, ...] | None = None) -> Contender:
    """Make a controller for a condition, with these training seeds, or all that are there.

    Raises
    ------
    registry.Unavailable
        A policy is missing.
    ValueError, TypeError
        The controller does not fit, or a file is broken.
    OSError
        A file cannot be read.
    """
    if name.startswith(CODE_PREFIX):
        options = {key: value for key, value in condition.designed.items() if key not in ("task", "reward")}
        made = load(name, gymnasium.make_vec(condition.env, num_envs=1, **options))
        return Contender(name, (), [made], {"files": [_file(file_of(name), made)]})
    options = informed(condition._replace(options=condition.designed), true_state(name)).options
    files = registry.policies(**options).get(name, {})
    seeds = seeds or tuple(files)
    made = [registry.make_controller(name, seed=seed, **options) for seed in seeds or (0,)]
    paths = [Path(name.removeprefix(MLP_PREFIX))] if is_file(name) else [files[seed] for seed in seeds]
    origin = (
        {"files": [_file(*pair) for pair in zip(paths, made)]} if paths else {"tuned": registry.tuned(name, **options)}
    )
    return Contender(name, seeds, made, origin)


def _file(file: Path, controller: Any) -> dict[str, Any]:
    network = _network(controller)
    notes = network.notes if isinstance(network, MLP) else {}
    return {"name": file.name, "sha256": hashlib.sha256(read(file)).hexdigest(), "notes": notes}


def _network(controller: Any) -> Any:
    """The policy of a controller that corrects or weighs one, or the controller."""
    if isinstance(controller, Residual):
        return controller.correction
    return _network(controller.controllers[0]) if isinstance(controller, Blend) else controller


def make_envs(condition: Condition, episodes: int) -> Any:
    """Make the vector environment of a condition.

    Raises
    ------
    ValueError, TypeError, gymnasium.error.Error
        The environment refuses its arguments.
    """
    return gymnasium.make_vec(condition.env, num_envs=episodes, max_episode_steps=condition.steps, **condition.options)


def run(
    envs: Any, condition: Condition, contender: Contender, seed: int, tick: Callable[[int], object] = lambda steps: None
) -> EpisodeScores:
    """Run an episode of every seed from `seed` on, with each controller of a contender.

    Raises
    ------
    ValueError
        A controller does not fit the environment.
    """
    started = time.perf_counter()
    rows = []
    for controller in contender.controllers:
        observations, _ = envs.reset(seed=seed)
        rollout: Any = (
            PredictRollout(envs, controller, contender.name, observations)
            if contender.name.startswith(CODE_PREFIX)
            else Rollout(envs, controller)
        )
        rows.append(_run(envs, condition, rollout, tick))
    scores = {key: np.stack([row[key] for row in rows]) for key in rows[0]}
    return EpisodeScores(scores, time.perf_counter() - started)


def _run(
    envs: Any, condition: Condition, rollout: Rollout | PredictRollout, tick: Callable[[int], object]
) -> dict[str, Floats]:
    period = 1.0 / envs.metadata["render_fps"]
    begin = min(round(SETTLED / period), condition.steps)
    parts = []
    for steps in (begin, condition.steps - begin):
        rollout.run(steps, tick)
        parts.append(rollout.pop_stats())
    early, late = parts
    episode = _sum(early, late)
    # Episodes that end before the settled part have the score of the whole episode there; diverged ones never recover.
    ended = late.steps == 0
    episode.last["recovery_time"][episode.terminated] = condition.steps * period
    scores = {}
    for name, metric in METRICS.items():
        scores[f"{name}/whole"] = metric.measure(episode)
        if not metric.whole_episode:
            scores[f"{name}/settled"] = np.where(ended, scores[f"{name}/whole"], metric.measure(late))
    return scores


def _sum(early: RolloutStats, late: RolloutStats) -> RolloutStats:
    """Statistics of two consecutive parts of the same episodes."""
    ended = late.steps == 0
    return RolloutStats(
        early.steps + late.steps,
        early.returns + late.returns,
        early.terminated | late.terminated,
        early.truncated | late.truncated,
        {name: early.sums[name] + late.sums[name] for name in early.sums},
        {name: early.squares[name] + late.squares[name] for name in early.squares},
        {name: np.where(ended, early.last[name], late.last[name]) for name in early.last},
    )
