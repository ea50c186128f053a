"""Recommended training: algorithms that follow one another, each in a folder of its own within the run's folder."""

import json
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from uvms_gym import MLP, StepWarning
from uvms_gym._files import write
from uvms_gym.controllers.registry import ControllerWarning, make_controller
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.training import native
from uvms_gym.training.evaluation import episode_steps, run_episodes
from uvms_gym.training.export import write_card
from uvms_gym.training.finished import is_finished
from uvms_gym.training.hyperparameters import give_way, read_hyperparameters
from uvms_gym.training.run import POLICY, SEED_STRIDE, Outcome, Settings, interrupt_event, latest_checkpoint

#: Episodes that prices are taken from, and the pose error at which the reward bends, relative to the reference's.
EPISODES, SCALE = 256, 1.5


def read_recipe(
    env: str,
    scene: str | None = None,
    file: Path | None = None,
    *,
    arguments: Mapping[str, Any] | None = None,
    step: float | None = None,
) -> dict[str, Any]:
    """Read the recipe of an environment, by Gymnasium's id: the reason `why`, and `stages` by algorithm, in order.

    A stage has its algorithm's hyperparameters, and `teacher` if it has one. The file has `prices`, the arguments of
    `priced`, in place of the reward.

    Parameters
    ----------
    env : str
    scene : str or None
        Name of the scene, which may have an entry of its own, `ENV/SCENE`.
    file : Path or None
        YAML with recipes; None: the package's.
    arguments, step
        Arguments of the user's, and the task's default step, s, as in `give_way`.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It has no recipe for this environment.
    """
    found = read_hyperparameters(env, file, variant=scene, algo="recommended")
    why, stages = found.pop("why"), dict[str, dict[str, Any]]()
    for algo, own in found.items():
        usual = read_hyperparameters(env, variant="start" if stages else None, algo=algo)
        given = give_way({**usual, **own}, arguments or {}, step)
        if prices := given.pop("prices", None):
            chosen = {**given["env_kwargs"], **(arguments or {})}
            given["env_kwargs"]["reward"] = priced(env, chosen, **prices)
        stages[algo] = given
    return {"why": why, "stages": stages}


def priced(
    env: str, env_kwargs: Mapping[str, Any], *, reference: str, effort: float, action_rate: float
) -> dict[str, float]:
    """Weights of the reward for which effort and changes of the action have their price on every vehicle.

    Parameters
    ----------
    env, env_kwargs
        Environment, by Gymnasium's id, and its arguments.
    reference : str
        Classical controller.
    effort, action_rate : float
        Costs of the reference's effort and of its changes of the action, relative to the cost of its pose error.

    Returns
    -------
    dict
        `pose`, 1; `pose_scale`, 1.5 times the reference's median pose error, m; `effort` and `action_rate`.
    """
    scale, costs = 1.0, dict[str, float]()
    for term in ("effort", "action_rate", "pose"):
        # A reward of this term only.
        weights = {"pose": 0.0, "effort": 0.0, "action_rate": 0.0, "pose_scale": scale} | {term: 1.0}
        envs = gymnasium.make_vec(env, num_envs=EPISODES, **{**env_kwargs, "reward": weights})
        with warnings.catch_warnings():
            # Gains and steps that are not for this environment are a scale, too.
            warnings.simplefilter("ignore", ControllerWarning)
            warnings.simplefilter("ignore", StepWarning)
            controller = make_controller(reference, envs)
            stats = run_episodes(envs, controller, SEED_STRIDE, episode_steps(env, env_kwargs))
        scale = _rounded(SCALE * float(np.median(pose_rms(stats, envs.unwrapped.task))))  # type: ignore[attr-defined]
        costs[term] = -float(stats.returns.mean())
        envs.close()
    effort, action_rate = effort * costs["pose"] / costs["effort"], action_rate * costs["pose"] / costs["action_rate"]
    return {"pose": 1.0, "pose_scale": scale, "effort": _rounded(effort), "action_rate": _rounded(action_rate)}


def _rounded(value: float) -> float:
    """Number with two digits: the last bits of episodes have no say in weights."""
    return float(f"{value:.2g}")


def rescaled(recipe: Mapping[str, Any], steps: int) -> dict[str, Any]:
    """Recipe with this number of steps in all, shared among its stages as before."""
    share = steps / sum(stage["n_timesteps"] for stage in recipe["stages"].values())
    stages = {
        algo: stage | {"n_timesteps": max(1, round(share * stage["n_timesteps"]))}
        for algo, stage in recipe["stages"].items()
    }
    return {**recipe, "stages": stages}


def summary(recipe: Mapping[str, Any]) -> str:
    """Stages of a recipe in a few words."""
    parts = (
        f"{' '.join((algo, *([stage['teacher']] if 'teacher' in stage else [])))} for {stage['n_timesteps']:.3g} steps"
        for algo, stage in recipe["stages"].items()
    )
    return ", then ".join(parts)


def stages(settings: Settings, folder: Path) -> Iterator[tuple[Settings, Path]]:
    """Settings and folder of each stage; all but the first begin with the policy of the one before."""
    start = None
    for number, (algo, given) in enumerate(settings.hyperparameters["stages"].items(), 1):
        own, place = {name: value for name, value in given.items() if name != "teacher"}, folder / f"{number}-{algo}"
        yield replace(settings, algo=algo, hyperparameters=own, teacher=given.get("teacher"), start=start), place
        start = str((place / POLICY).resolve())


def check(settings: Settings) -> None:
    """Make the learner of each stage once: errors as in its class."""
    for stage, _ in stages(settings, Path()):
        native.check(replace(stage, start=None))


def train(
    settings: Settings,
    folder: Path,
    *,
    agent: Path | None = None,
    tensorboard_log: Path | None = None,
    verbose: int = 0,
    origin: Mapping[str, str] | None = None,
    tick: Callable[[int], object] = lambda steps: None,
    report: Callable[[dict[str, Any]], object] = lambda evaluation: None,
) -> Outcome:
    """Train stage by stage; the last stage's policy is the run's.

    A run goes on in the first stage in `folder` that is not finished, at its latest checkpoint: `agent` has no effect.
    Other parameters, errors and stops as in `uvms_gym.training.ppo.train`.
    """
    if is_finished(folder / POLICY):
        raise ValueError(f"the run has taken its {settings.steps} steps; --algo shac --start FILE improves its policy")
    settings.save(folder)
    notes = {"recipe": summary(settings.hyperparameters), **(origin or {})}
    logs = None if tensorboard_log is None else tensorboard_log / folder.name
    steps, seconds, outcome = 0, 0.0, None
    with interrupt_event() as interrupted:
        for stage, place in stages(settings, folder):
            outcome = _finished(stage, place)
            if outcome is None:
                place.mkdir(exist_ok=True)
                outcome = native.train(
                    stage,
                    place,
                    agent=_checkpoint(place),
                    tensorboard_log=logs,
                    origin=notes,
                    tick=tick,
                    report=partial(_report, report, steps, seconds),
                    interrupted=interrupted,
                )
            steps, seconds = steps + outcome.steps, seconds + outcome.seconds
            outcome = replace(outcome, steps=steps, seconds=seconds)
            if not outcome.finished:
                return outcome
    assert outcome is not None
    write(folder / POLICY, outcome.policy.read_bytes())
    write_card(folder)
    return replace(outcome, policy=folder / POLICY)


def _report(report: Callable[[dict[str, Any]], object], steps: int, seconds: float, found: dict[str, Any]) -> None:
    """Report an evaluation of a stage with the steps and seconds of the whole run; a start is reported once."""
    if found["steps"] or not steps:
        report({**found, "steps": found["steps"] + steps, "seconds": found["seconds"] + seconds})


def _finished(stage: Settings, place: Path) -> Outcome | None:
    """Outcome of a stage that is finished."""
    if not is_finished(place / POLICY):
        return None
    notes = MLP.load(place / POLICY).notes
    evaluation = json.loads(notes["evaluation"])
    end = place / f"{stage.env}.zip"
    return Outcome(int(notes["steps"]), float(notes["seconds"]), True, end, place / POLICY, evaluation)


def _checkpoint(place: Path) -> Path | None:
    """Latest checkpoint of a stage; None: it has none yet."""
    try:
        return latest_checkpoint(place)
    except (OSError, ValueError):
        return None
