"""A training run: settings, folder, evaluations, export, interruption; the same for all algorithms."""

import json
import re
import signal
import threading
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from uvms_gym import MLP, Residual
from uvms_gym._files import write
from uvms_gym.controllers import Controller
from uvms_gym.controllers.contract import policy_contract
from uvms_gym.controllers.families import canonical
from uvms_gym.controllers.registry import tuned
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.evaluation import SEED, evaluate
from uvms_gym.training.export import versions
from uvms_gym.training.finished import is_finished
from uvms_gym.training.hyperparameters import count

#: Algorithms, and their titles in model cards.
ALGORITHMS = {
    "recommended": "Recipe",
    "ppo": "PPO",
    "distill": "Distillation",
    "asymmetric-ppo": "PPO with an asymmetric critic",
    "shac": "Short-horizon actor-critic",
}
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
    """Hyperparameters in rl_zoo3's format: `n_timesteps`, `n_envs` and the algorithm's; of `recommended` a recipe."""
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    """Arguments of the environment."""
    seed: int = 0
    """Seed of the network and of batches; seeds of environments start at `SEED_STRIDE * (1 + seed)`."""
    base: str | None = None
    """Name of a corrected controller; algorithm `ppo` only."""
    limit: float = 0.3
    """Maximum correction."""
    eval_freq: int = 0
    """Steps between evaluations; not positive: only at the end."""
    eval_episodes: int = 512
    """Episodes of each evaluation."""
    save_freq: int = 0
    """Steps between checkpoints; not positive: only at the end."""
    num_threads: int = 1
    """Threads of the environment, and of torch in `ppo`; -1: their defaults."""
    device: str = "cpu"
    """Device of torch; algorithm `ppo` only."""
    algo: str = "ppo"
    """One of `ALGORITHMS`."""
    teacher: str | None = None
    """Name of the imitated classical controller; algorithm `distill` only. None: the task's."""
    start: str | None = None
    """File of the policy to begin with; algorithms `asymmetric-ppo` and `shac` only. None: from scratch."""

    @property
    def steps(self) -> int:
        """Steps of all instances together."""
        if self.algo == "recommended":
            return sum(count(stage, "n_timesteps") for stage in self.hyperparameters["stages"].values())
        return count(self.hyperparameters, "n_timesteps")

    @property
    def spans(self) -> tuple[int, ...]:
        """Number of successive observations in each average of the policy's input, oldest first: `frame_stack`.

        A number h stands for h observations as they are. Errors as of `count`.
        """
        given = self.hyperparameters.get("frame_stack", 1)
        if self.algo != "ppo" and isinstance(given, list) and given:
            return tuple(count({"frame_stack": span}, "frame_stack") for span in given)
        return (1,) * count({"frame_stack": given}, "frame_stack")

    @property
    def history(self) -> int:
        """Number of observations in the policy's input."""
        return sum(self.spans)

    @property
    def kwargs(self) -> dict[str, Any]:
        """Arguments of the environment, including the hyperparameters' arguments."""
        threads = {} if self.num_threads < 0 else {"threads": self.num_threads}
        return {**threads, **self.hyperparameters.get("env_kwargs", {}), **self.env_kwargs}

    def save(self, folder: Path) -> None:
        """Write the settings into a run's folder."""
        write(folder / SETTINGS, json.dumps(asdict(self), indent=1) + "\n")

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
            settings = cls(**json.loads((folder / SETTINGS).read_text()))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{folder / SETTINGS}: {error}") from None
        if settings.algo not in ALGORITHMS:
            known = ", ".join(ALGORITHMS)
            raise ValueError(f"{folder / SETTINGS}: algo is {settings.algo!r}, but must be one of {known}")
        return settings


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


@dataclass
class Record:
    """Learning curve, time, and exported policy of a run."""

    settings: Settings
    folder: Path
    envs: TaskVectorEnv
    begun: float
    """Instant of `time.perf_counter` at which the run would have begun without a stop."""
    origin: Mapping[str, str]
    report: Callable[[dict[str, Any]], object]
    base: Controller | None = None
    curve: list[dict[str, Any]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time spent on the run so far."""
        return time.perf_counter() - self.begun

    def refuse(self, steps: int) -> None:
        """Refuse to go on with a finished run; one that was stopped before its policy was written is completed.

        Raises
        ------
        ValueError
            All files of the run are there.
        """
        if is_finished(self.folder / POLICY):
            raise ValueError(f"the run has taken its {steps} steps; n_timesteps can ask for more")

    def resume(self, steps: int) -> None:
        """Read the learning curve so far; later evaluations are forgotten."""
        if (self.folder / CURVE).exists():
            curve = json.loads((self.folder / CURVE).read_text())
            self.curve = [entry for entry in curve if entry["steps"] <= steps]

    def evaluate(self, policy: MLP, steps: int) -> tuple[dict[str, float], bool]:
        """Evaluate a policy; returns the scores, and True if it is the best so far."""
        settings, before = self.settings, round(self.seconds, 3)
        controller = policy if self.base is None else Residual(self.base, policy, settings.limit)
        scores = evaluate(settings.env, settings.kwargs, controller, settings.eval_episodes)
        found = {"steps": steps, "seconds": before, **scores}
        best = min((entry["pose"] for entry in self.curve), default=float("inf"))
        self.curve.append(found | {"episodes": settings.eval_episodes, "seed": SEED})
        write(self.folder / CURVE, json.dumps(self.curve, indent=1) + "\n")
        self.report(found)
        return scores, found["pose"] < best

    def notes(self, steps: int, threads: int, more: Mapping[str, str]) -> dict[str, str]:
        """Notes for the policy's file."""
        settings = self.settings
        notes = {
            "environment": settings.env,
            "env_kwargs": json.dumps({key: value for key, value in settings.kwargs.items() if key != "threads"}),
            "algorithm": ALGORITHMS[settings.algo],
            "hyperparameters": json.dumps(settings.hyperparameters | {"n_timesteps": settings.steps}),
            "seed": str(settings.seed),
            "steps": str(steps),
            "seconds": f"{self.seconds:.0f}",
            "threads": str(threads),
            "versions": json.dumps(versions()),
            "evaluation": json.dumps(self.curve[-1]),
            "contract": json.dumps(policy_contract(self.envs)),
            **more,
            **self.origin,
        }
        if settings.base is not None:
            base = canonical(settings.base)
            stored = tuned(base, self.envs)
            gains = json.dumps(stored["gains"] if stored else {})
            notes |= {"base": base, "base_gains": gains, "limit": f"{settings.limit:g}"}
        return notes


@contextmanager
def interrupt_event() -> Iterator[threading.Event]:
    """Event set by the first Ctrl-C or SIGTERM, which clusters send; a second one has its usual effect."""
    asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return
    usual = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in usual.items():
            signal.signal(number, handler)

    def ask(number: int, frame: Any) -> None:
        asked.set()
        restore()

    for number in usual:
        signal.signal(number, ask)
    try:
        yield asked
    finally:
        restore()


def latest_checkpoint(folder: Path) -> Path:
    """Find the checkpoint of a run with the most steps; incomplete files do not count.

    Raises
    ------
    ValueError
        The folder has none.
    """
    found = [*folder.glob(checkpoint_name("*")), *folder.glob(f"{Settings.load(folder).env}.zip")]
    steps = {path: _steps(path) for path in found}
    if not steps or max(steps.values()) < 0:
        raise ValueError(f"{folder} has no checkpoint")
    return max(steps, key=steps.__getitem__)


def _steps(path: Path) -> int:
    """Steps of a checkpoint, by its name, or by its content where the name has none; -1 if the file is incomplete."""
    try:
        with zipfile.ZipFile(path) as file:
            if file.testzip() is not None:
                return -1
            if match := re.fullmatch(checkpoint_name(r"(\d+)"), path.name):
                return int(match[1])
            if "data" in file.namelist():
                return int(json.loads(file.read("data"))["num_timesteps"])
        import torch

        return int(torch.load(path, weights_only=True)["steps"])
    except (OSError, ValueError, LookupError, RuntimeError, zipfile.BadZipFile):
        return -1


def checkpoint_name(steps: int | str) -> str:
    """Name of a checkpoint's file."""
    return f"rl_model_{steps}_steps.zip"


def passed(every: int, before: int, now: int) -> bool:
    """True if a multiple of `every` lies in (before, now]."""
    return every > 0 and now // every > before // every
