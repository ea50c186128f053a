"""Proximal policy optimisation by Stable-Baselines3 on native environments: a run, from its start or a checkpoint."""

import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from uvms_gym import MLP, Residual
from uvms_gym.controllers import Controller
from uvms_gym.controllers.registry import make_controller, tuned
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.sb3 import make_vec_env
from uvms_gym.training import continuation
from uvms_gym.training.evaluation import SEED, episode_steps, evaluate
from uvms_gym.training.export import policy_of, versions, write_card
from uvms_gym.training.hyperparameters import arguments, count
from uvms_gym.training.wrappers import History, ResidualVecEnv, StaggeredStart

#: Distance of environments' seeds between training seeds; those below are for evaluations.
SEED_STRIDE = 10_000_000
#: Files of a run's folder.
SETTINGS, CURVE, POLICY, BEST = "config.json", "evaluations.json", "policy.safetensors", "best_model.zip"


@dataclass(frozen=True)
class Settings:
    """Settings, which determine a run bit for bit."""

    env: str
    """Gymnasium's id of a UVMS environment."""
    hyperparameters: dict[str, Any]
    """In rl_zoo3's format: `n_timesteps`, `n_envs`, `policy` and arguments of `stable_baselines3.PPO`."""
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""
    seed: int = 0
    """Seed of the network and of batches; seeds of environments start at `SEED_STRIDE * (1 + seed)`."""
    base: str | None = None
    """Name of a corrected controller."""
    limit: float = 0.3
    """Greatest correction."""
    eval_freq: int = 0
    """Steps between evaluations; not positive: only at the end."""
    eval_episodes: int = 512
    """Episodes of each evaluation."""
    save_freq: int = 0
    """Steps between checkpoints; not positive: only at the end."""
    num_threads: int = 1
    """Threads of torch and of the environment; -1: their defaults."""
    device: str = "cpu"
    """Device of torch."""

    @property
    def steps(self) -> int:
        """Steps of all instances together."""
        return count(self.hyperparameters, "n_timesteps")

    @property
    def history(self) -> int:
        """Number of observations in the policy's input: `frame_stack`."""
        return count({"frame_stack": 1, **self.hyperparameters}, "frame_stack")

    @property
    def kwargs(self) -> dict[str, Any]:
        """Arguments of the environment, including those of the hyperparameters."""
        threads = {} if self.num_threads < 0 else {"threads": self.num_threads}
        return {**threads, **self.hyperparameters.get("env_kwargs", {}), **self.env_kwargs}

    def save(self, folder: Path) -> None:
        """Write the settings into a run's folder."""
        (folder / SETTINGS).write_text(json.dumps(asdict(self), indent=1) + "\n")

    @classmethod
    def load(cls, folder: Path) -> "Settings":
        """Read the settings from a run's folder.

        Raises
        ------
        OSError
            The file does not exist.
        ValueError
            The file is of another kind.
        """
        try:
            return cls(**json.loads((folder / SETTINGS).read_text()))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{folder / SETTINGS}: {error}") from None


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    steps: int
    """Steps of all instances together, including those before a checkpoint."""
    seconds: float
    """Wall-clock time, including evaluations and the time before a checkpoint."""
    finished: bool
    """True if all steps were taken."""
    checkpoint: Path
    """Checkpoint to resume from."""
    policy: Path
    """Exported policy."""
    evaluation: dict[str, Any]
    """See `uvms_gym.training.evaluation.evaluate`."""


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


def train(
    settings: Settings,
    folder: Path,
    *,
    agent: Path | None = None,
    tensorboard_log: Path | None = None,
    verbose: int = 0,
    origin: Mapping[str, str] | None = None,
    tick: Callable[[int], object] = lambda steps: None,
    tell: Callable[[dict[str, Any]], object] = lambda evaluation: None,
) -> Outcome:
    """Train, evaluate, write checkpoints and export the policy, all in `folder`.

    An interrupt (Ctrl-C) stops it after the current iteration with everything saved and exported; the checkpoint
    resumes to bit-identical weights. A second interrupt is a `KeyboardInterrupt`.

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
    tell : callable
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
        model, before = continuation.load(agent, venv, device=settings.device, **schedules, **log)
    settings.save(folder)
    run = _Run(settings, folder, envs, base, time.perf_counter() - before, origin or {}, tick, tell)
    run.init_callback(model)
    if agent is not None and (folder / CURVE).exists():
        curve = json.loads((folder / CURVE).read_text())
        run.curve = [entry for entry in curve if entry["steps"] <= model.num_timesteps]
    left = settings.steps - model.num_timesteps
    if left <= 0:
        raise ValueError(f"the run has taken its {model.num_timesteps} steps; n_timesteps can ask for more")
    finished = True
    with continuation.interrupt_event() as run.interrupted:
        try:
            model.learn(left, run, tb_log_name=settings.env, reset_num_timesteps=agent is None)
        except _Stop:
            finished = False
        if not run.curve or run.curve[-1]["steps"] != model.num_timesteps:
            run.evaluate()
        name = f"{settings.env}.zip" if finished else _checkpoint(model.num_timesteps)
        run.save(folder / name)
        policy = run.export(folder / POLICY)
        write_card(folder)
    venv.close()
    return Outcome(model.num_timesteps, run.seconds, finished, folder / name, policy, run.curve[-1])


class _Stop(Exception):
    """Stop of a run between two iterations."""


@dataclass(eq=False)
class _Run(BaseCallback):
    """Evaluations and checkpoints between iterations of PPO, where a run can be interrupted and resumed."""

    settings: Settings
    folder: Path
    envs: TaskVectorEnv
    base: Controller | None
    begun: float
    origin: Mapping[str, str]
    tick: Callable[[int], object]
    tell: Callable[[dict[str, Any]], object]
    curve: list[dict[str, Any]] = field(default_factory=list)
    interrupted: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        super().__init__()

    @property
    def seconds(self) -> float:
        """Time spent on the run so far."""
        return time.perf_counter() - self.begun

    def _on_training_start(self) -> None:
        # A new run evaluates the untrained model; a resumed one did so before.
        if not self.curve and self.settings.eval_freq > 0:
            self.evaluate()
        self._last = self.model.num_timesteps

    def _on_rollout_start(self) -> None:
        now = self.model.num_timesteps
        if now > self._last:
            self.tick(now - self._last)
            if _passed(self.settings.eval_freq, self._last, now):
                self.evaluate()
            if _passed(self.settings.save_freq, self._last, now):
                self.save(self.folder / _checkpoint(now))
        self._last = now
        if self.interrupted.is_set():
            raise _Stop

    def _on_step(self) -> bool:
        return True

    def controller(self, notes: Mapping[str, str] | None = None) -> tuple[MLP, Controller]:
        """Current network, and the controller with it."""
        settings, residual = self.settings, self.base is not None
        policy = policy_of(self.model, self.envs, history=settings.history, residual=residual, notes=notes)  # type: ignore[arg-type]
        return policy, policy if self.base is None else Residual(self.base, policy, settings.limit)

    def evaluate(self) -> None:
        """Evaluate the model, and save it if it is the best so far."""
        episodes, before = self.settings.eval_episodes, round(self.seconds, 3)
        scores = evaluate(self.settings.env, self.settings.kwargs, self.controller()[1], episodes)
        found = {"steps": self.model.num_timesteps, "seconds": before, **scores}
        best = min((entry["pose"] for entry in self.curve), default=float("inf"))
        self.curve.append(found | {"episodes": episodes, "seed": SEED})
        (self.folder / CURVE).write_text(json.dumps(self.curve, indent=1) + "\n")
        for name, value in scores.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.dump(self.model.num_timesteps)
        if found["pose"] < best:
            self.save(self.folder / BEST)
        self.tell(found)

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        continuation.save(self.model, self.training_env, self.seconds, path)  # type: ignore[arg-type]

    def export(self, path: Path) -> Path:
        """Write the policy with its notes."""
        settings = self.settings
        notes = {
            "environment": settings.env,
            "env_kwargs": json.dumps({key: value for key, value in settings.kwargs.items() if key != "threads"}),
            "algorithm": "PPO",
            "hyperparameters": json.dumps(settings.hyperparameters | {"n_timesteps": settings.steps}),
            "seed": str(settings.seed),
            "steps": str(self.model.num_timesteps),
            "seconds": f"{self.seconds:.0f}",
            "threads": str(torch.get_num_threads()),
            "versions": json.dumps(versions()),
            "evaluation": json.dumps(self.curve[-1]),
            **self.origin,
        }
        if settings.base is not None:
            stored = tuned(settings.base, self.envs)
            gains = json.dumps(stored["gains"] if stored else {})
            notes |= {"base": settings.base, "base_gains": gains, "limit": f"{settings.limit:g}"}
        policy, _ = self.controller(notes)
        policy.save(path)
        return path


def latest_checkpoint(folder: Path) -> Path:
    """Find the newest checkpoint of a run.

    Raises
    ------
    ValueError
        The folder has none.
    """
    found = [*folder.glob(_checkpoint("*")), *folder.glob(f"{Settings.load(folder).env}.zip")]
    if not found:
        raise ValueError(f"{folder} has no checkpoint")
    return max(found, key=lambda path: path.stat().st_mtime_ns)


def _checkpoint(steps: int | str) -> str:
    return f"rl_model_{steps}_steps.zip"


def _passed(every: int, before: int, now: int) -> bool:
    """True if a multiple of `every` lies in (before, now]."""
    return every > 0 and now // every > before // every
