"""Proximal policy optimisation by Stable-Baselines3 on native environments: a run, from its start or a checkpoint."""

import io
import threading
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from uvms_gym import MLP
from uvms_gym._files import write
from uvms_gym.controllers import Controller
from uvms_gym.controllers.registry import make_controller
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.sb3 import make_vec_env
from uvms_gym.training.evaluation import episode_steps
from uvms_gym.training.export import policy_of, write_card
from uvms_gym.training.hyperparameters import arguments, count
from uvms_gym.training.run import (
    BEST,
    POLICY,
    SEED_STRIDE,
    Outcome,
    Record,
    Settings,
    checkpoint_name,
    interrupt_event,
    passed,
)
from uvms_gym.training.wrappers import History, ResidualVecEnv, StaggeredStart

#: Member of a checkpoint with which runs resume bit-identically.
_MEMBER = "continuation.npz"


def make_envs(settings: Settings) -> tuple[VecEnv, TaskVectorEnv, Controller | None]:
    """Make the environment, wrapped for Stable-Baselines3 and native, and the corrected controller.

    Raises
    ------
    ValueError, TypeError, gymnasium.error.Error
        An argument is unknown or out of range, or the environment is not one of uvms_gym.
    """
    native = make_vec_env(settings.env, count(settings.hyperparameters, "n_envs"), **settings.kwargs)
    envs = native.envs.unwrapped
    if not isinstance(envs, TaskVectorEnv):
        raise ValueError(f"{settings.env} is no environment of uvms_gym")
    venv: VecEnv = StaggeredStart(native, episode_steps(settings.env, settings.kwargs))
    base = None if settings.base is None else make_controller(settings.base, envs)
    if base is not None:
        venv = ResidualVecEnv(venv, base, settings.limit)
    if settings.history > 1:
        venv = History(venv, settings.history)
    return venv, envs, base


def make_model(settings: Settings, venv: VecEnv, **more: Any) -> PPO:
    """Make an untrained model.

    Raises
    ------
    ValueError, TypeError, AssertionError
        A hyperparameter is unknown or out of range.
    """
    given = arguments(settings.hyperparameters)
    policy = settings.hyperparameters.get("policy", "MlpPolicy")
    model = PPO(policy, venv, seed=settings.seed, device=settings.device, **given, **more)
    # The model has seeded the environments with its own seed.
    venv.seed(SEED_STRIDE * (1 + settings.seed))
    return model


def check(settings: Settings) -> None:
    """Make environment and model once: errors as in `make_envs` and `make_model`."""
    make_model(settings, make_envs(settings)[0])


def save(model: PPO, venv: VecEnv, seconds: float, path: Path) -> None:
    """Write a model in the format of Stable-Baselines3, with environments, random generators and the time so far, s.

    `stable_baselines3.PPO.load` and rl_zoo3 read it, too.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    kind, keys, *rest = np.random.get_state()  # noqa: NPY002 (Stable-Baselines3 draws from it)
    assert kind == "MT19937"
    arrays = {f"env.{name}": rows for name, rows in venv.get_state().items()}  # type: ignore[attr-defined]
    arrays |= {"torch": torch.get_rng_state().numpy(), "numpy.keys": keys, "numpy.rest": np.array(rest, dtype=float)}
    data, complete = io.BytesIO(), io.BytesIO()
    np.savez(data, seconds=seconds, **arrays)
    model.save(complete)
    with zipfile.ZipFile(complete, "a") as file:
        file.writestr(_MEMBER, data.getvalue())
    write(path, complete.getvalue())


def load(path: Path, venv: VecEnv, **arguments: Any) -> tuple[PPO, float]:
    """Read a checkpoint, and set environments and random generators; returns the model and the time so far, s.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is of another kind, or for other environments.
    """
    try:
        with zipfile.ZipFile(path) as file:
            data = file.read(_MEMBER)
    except (zipfile.BadZipFile, KeyError):
        raise ValueError(f"{path} holds no training run of `uvms train`") from None
    # The observations before the next action belong to the environments' state.
    model = PPO.load(path, env=venv, force_reset=False, **arguments)
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        venv.set_state({name.removeprefix("env."): arrays[name] for name in arrays if name.startswith("env.")})  # type: ignore[attr-defined]
        torch.set_rng_state(torch.from_numpy(arrays["torch"]))
        position, has_gauss, gauss = arrays["numpy.rest"]
        np.random.set_state(("MT19937", arrays["numpy.keys"], int(position), int(has_gauss), gauss))  # noqa: NPY002
        return model, float(arrays["seconds"])


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
    """Train, evaluate, write checkpoints and export the policy, all in `folder`.

    An interrupt (Ctrl-C, SIGTERM) stops it after the current iteration with everything saved and exported; the
    checkpoint resumes to bit-identical weights. A second interrupt is a `KeyboardInterrupt`.

    Parameters
    ----------
    settings : Settings
    folder : Path
        Existing folder.
    agent : Path or None
        Checkpoint to resume, of a run with these settings (except steps, evaluations and checkpoints).
    tensorboard_log : Path or None
        Folder for TensorBoard.
    verbose : int
        Verbosity of Stable-Baselines3.
    origin : mapping of str to str, or None
        Further notes for the policy, such as the commit.
    tick : callable
        Called with the number of new steps.
    report : callable
        Called with every evaluation.

    Raises
    ------
    ValueError, TypeError, AssertionError, gymnasium.error.Error
        A setting is unknown or out of range.
    OSError
        A file cannot be read or written.
    """
    if settings.num_threads > 0:
        torch.set_num_threads(settings.num_threads)
    venv, envs, base = make_envs(settings)
    log = {"tensorboard_log": None if tensorboard_log is None else str(tensorboard_log), "verbose": verbose}
    if agent is None:
        model, before = make_model(settings, venv, **log), 0.0
    else:
        given = arguments(settings.hyperparameters)
        schedules = {key: given[key] for key in ("learning_rate", "clip_range") if key in given}
        model, before = load(agent, venv, device=settings.device, **schedules, **log)
    record = Record(settings, folder, envs, time.perf_counter() - before, origin or {}, report, base)
    run = _Run(record, tick)
    run.init_callback(model)
    if agent is not None:
        record.resume(model.num_timesteps)
    left = settings.steps - model.num_timesteps
    if left <= 0:
        record.refuse(model.num_timesteps)
    settings.save(folder)
    finished = True
    with interrupt_event() as run.interrupted:
        try:
            model.learn(left, run, tb_log_name=settings.env, reset_num_timesteps=agent is None)
        except _Stop:
            finished = False
        # First the checkpoint: a cluster that asked to stop does not wait for an evaluation.
        name = f"{settings.env}.zip" if finished else checkpoint_name(model.num_timesteps)
        run.save(folder / name)
        if not record.curve or record.curve[-1]["steps"] != model.num_timesteps:
            run.evaluate()
        policy = run.export(folder / POLICY)
        write_card(folder)
    venv.close()
    return Outcome(model.num_timesteps, record.seconds, finished, folder / name, policy, record.curve[-1])


class _Stop(Exception):
    """Stop of a run between two iterations."""


@dataclass(eq=False)
class _Run(BaseCallback):
    """Evaluations and checkpoints between iterations of PPO, where a run can be interrupted and resumed."""

    record: Record
    tick: Callable[[int], object]
    interrupted: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        super().__init__()

    def _on_training_start(self) -> None:
        # A new run evaluates the untrained model; a resumed one did so before.
        if not self.record.curve and self.record.settings.eval_freq > 0:
            self.evaluate()
        self._last = self.model.num_timesteps

    def _on_rollout_start(self) -> None:
        now, settings = self.model.num_timesteps, self.record.settings
        if now > self._last:
            self.tick(now - self._last)
            if passed(settings.eval_freq, self._last, now):
                self.evaluate()
            if passed(settings.save_freq, self._last, now):
                self.save(self.record.folder / checkpoint_name(now))
        self._last = now
        if self.interrupted.is_set():
            raise _Stop

    def _on_step(self) -> bool:
        return True

    def policy(self, notes: Mapping[str, str] | None = None) -> MLP:
        """Current network."""
        record = self.record
        residual = record.base is not None
        return policy_of(self.model, record.envs, history=record.settings.history, residual=residual, notes=notes)  # type: ignore[arg-type]

    def evaluate(self) -> None:
        """Evaluate the model, and save it if it is the best so far."""
        scores, best = self.record.evaluate(self.policy(), self.model.num_timesteps)
        for name, value in scores.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.dump(self.model.num_timesteps)
        if best:
            self.save(self.record.folder / BEST)

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        save(self.model, self.training_env, self.record.seconds, path)  # type: ignore[arg-type]

    def export(self, path: Path) -> Path:
        """Write the policy with its notes."""
        self.policy(self.record.notes(self.model.num_timesteps, torch.get_num_threads(), {})).save(path)
        return path
