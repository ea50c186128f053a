"""Episodes of a comparison, and what is measured in them."""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from uvms_gym import Rollout
from uvms_gym.cli.common import fail
from uvms_gym.cli.compare_cells import Cell
from uvms_gym.controllers import MLP, Controller, Residual, registry
from uvms_gym.rollouts import Tally

Floats = NDArray[np.float64]

#: Time after which the start counts no more in the second of the two numbers, s.
SETTLED = 3.0
PARTS = ("whole", "settled")
#: What an angle weighs against a distance in the pose error, m.
LEVER = 0.5


class Metric(NamedTuple):
    """A measure of an episode.

    Attributes
    ----------
    title, unit : str
        Of tables and pictures, after `scale`.
    measure : callable
        From the tally of control periods: the measure per episode, SI.
    scale : float
        Leads from SI to the unit.
    error : bool
        Whether it is one of the errors, root mean squares over the steps.
    less : bool
        Whether less is better.
    cut : float
        What the mean over episodes leaves out at either end.
    whole : bool
        Whether it is of whole episodes alone.
    """

    title: str
    unit: str
    measure: Callable[[Tally], Floats]
    scale: float = 1.0
    error: bool = False
    less: bool = True
    cut: float = 0.25
    whole: bool = False

    @property
    def label(self) -> str:
        """Title with unit."""
        return f"{self.title}, {self.unit}" if self.unit else self.title

    @property
    def parts(self) -> tuple[str, ...]:
        """Parts of an episode that it is measured over."""
        return PARTS[:1] if self.whole else PARTS


def _mean(tally: Tally, sums: Floats) -> Floats:
    return np.asarray(sums / np.maximum(tally.steps, 1))


def _rms(entry: str) -> Callable[[Tally], Floats]:
    return lambda tally: np.sqrt(_mean(tally, tally.squares[entry]))


def _average(entry: str, sign: float = 1.0) -> Callable[[Tally], Floats]:
    return lambda tally: sign * _mean(tally, tally.sums[entry])


def _pose(tally: Tally) -> Floats:
    squares = tally.squares["position_error"] + LEVER**2 * tally.squares["attitude_error"]
    return np.sqrt(_mean(tally, squares))


METRICS: dict[str, Metric] = {
    "pose": Metric("pose", "mm", _pose, 1e3, error=True),
    "position": Metric("position", "mm", _rms("position_error"), 1e3, error=True),
    "attitude": Metric("attitude", "mrad", _rms("attitude_error"), 1e3, error=True),
    "end_effector": Metric("end effector", "mm", _rms("end_effector_position_error"), 1e3, error=True),
    "effort": Metric("effort", "%", _average("effort"), 1e2),
    "saturation": Metric("saturation", "%", _average("saturation"), 1e2),
    "variation": Metric("variation", "1e-3", _average("reward_rate", -1.0), 1e3),
    "recovery": Metric("recovery", "s", lambda tally: tally.last["recovery_time"], whole=True),
    "within": Metric("in tolerance", "% of time", _average("success"), 1e2, less=False),
    "success": Metric("success", "%", lambda tally: tally.last["success"], 1e2, less=False, cut=0.0, whole=True),
    "diverged": Metric("diverged", "%", lambda tally: tally.terminated.astype(np.float64), 1e2, cut=0.0, whole=True),
}


class Entrant(NamedTuple):
    """A controller in a cell.

    Attributes
    ----------
    name : str
    seeds : tuple of int
        Training seeds; empty for what is not trained.
    controllers : list of Controller
        One per training seed, or one.
    origin : dict
        Where it comes from: gains, or files with their digests and notes.
    """

    name: str
    seeds: tuple[int, ...]
    controllers: list[Controller]
    origin: dict[str, Any]


class Scored(NamedTuple):
    """What came of an entrant: per metric and part the scores (S, N), and the time that it took, s."""

    scores: dict[str, dict[str, Floats]]
    seconds: float


def enter(cell: Cell, name: str) -> Entrant:
    """Make a controller for a cell, with all its training seeds.

    Raises
    ------
    registry.Unavailable
        There is no policy.
    TyperException
        It does not fit, or a file is broken.
    """
    options = cell.designed
    try:
        seeds = registry.seeds(name, **options)
        made = [registry.make_controller(name, seed=seed, **options) for seed in seeds or (0,)]
        return Entrant(name, seeds, made, _origin(name, seeds, made, options))
    except registry.Unavailable:
        raise
    except OSError as error:
        raise fail(f"cannot read {error.filename}: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise fail(f"{cell.env}: {error}") from None


def _origin(entrant: str, seeds: tuple[int, ...], controllers: list[Controller], options: Any) -> dict[str, Any]:
    """Tell where controllers come from: their files, or their gains and how these were tuned (None: they are not)."""
    if entrant.startswith(registry.MLP_PREFIX):
        files = [Path(entrant.removeprefix(registry.MLP_PREFIX))]
    elif seeds:
        files = [registry.policy_file(entrant, seed, **options) for seed in seeds]
    else:
        return {"tuned": registry.tuned(entrant, **options)}
    digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    return {
        "files": [
            {"name": file.name, "sha256": digest, "notes": _notes(controller)}
            for file, digest, controller in zip(files, digests, controllers, strict=True)
        ]
    }


def _notes(controller: Controller) -> dict[str, str]:
    network = controller.correction if isinstance(controller, Residual) else controller
    return network.notes if isinstance(network, MLP) else {}


def make(cell: Cell, episodes: int) -> Any:
    """Make a cell's environment."""
    try:
        return gymnasium.make_vec(cell.env, num_envs=episodes, max_episode_steps=cell.steps, **cell.options)
    except (gymnasium.error.Error, ValueError, TypeError) as error:
        raise fail(f"{cell.env}: {str(error).split(' was raised from the environment creator')[0]}") from None


def run(
    env: Any, cell: Cell, entrant: Entrant, seed: int, tick: Callable[[int], object] = lambda steps: None
) -> Scored:
    """Run an episode of every seed from `seed` on, with each of an entrant's controllers."""
    started = time.perf_counter()
    rows = [_run(env, cell, controller, seed, tick) for controller in entrant.controllers]
    scores = {
        name: {part: np.stack([row[name][part] for row in rows]) for part in metric.parts}
        for name, metric in METRICS.items()
    }
    return Scored(scores, time.perf_counter() - started)


def _run(
    env: Any, cell: Cell, controller: Controller, seed: int, tick: Callable[[int], object]
) -> dict[str, dict[str, Floats]]:
    env.reset(seed=seed)
    period = 1.0 / env.metadata["render_fps"]
    begin = min(round(SETTLED / period), cell.steps)
    rollout = Rollout(env, controller)
    tallies = []
    for steps in (begin, cell.steps - begin):
        try:
            rollout.run(steps, tick)
        except ValueError as error:
            raise fail(f"{cell.env}: {error}") from None
        tallies.append(rollout.take())
    early, late = tallies
    whole = _sum(early, late)
    # An episode that ended before anything was settled has nothing but its whole to show; one that diverged never
    # came back.
    ended = late.steps == 0
    whole.last["recovery_time"][whole.terminated] = cell.steps * period
    result = {}
    for name, metric in METRICS.items():
        scores = {"whole": metric.measure(whole)}
        if not metric.whole:
            scores["settled"] = np.where(ended, scores["whole"], metric.measure(late))
        result[name] = scores
    return result


def _sum(early: Tally, late: Tally) -> Tally:
    """Join two parts of the same episodes."""
    ended = late.steps == 0
    return Tally(
        early.steps + late.steps,
        early.returns + late.returns,
        early.terminated | late.terminated,
        early.truncated | late.truncated,
        {name: early.sums[name] + late.sums[name] for name in early.sums},
        {name: early.squares[name] + late.squares[name] for name in early.squares},
        {name: np.where(ended, early.last[name], late.last[name]) for name in early.last},
    )
