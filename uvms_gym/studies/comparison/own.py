"""Controllers written in Python, by file and name: loading, and episodes with Python between control periods."""

import importlib.util
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym._files import read
from uvms_gym.controllers import registry
from uvms_gym.controllers.families import CODE_PREFIX
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.rollouts import RolloutStats


def file_of(name: str) -> Path:
    """File of a controller in Python code, `py:FILE:NAME`; NAME is called with an environment as designed for."""
    return Path(name.removeprefix(CODE_PREFIX).rpartition(":")[0])


def load(name: str, envs: Any) -> Any:
    """Run the file of `py:FILE:NAME` and make its controller.

    Parameters
    ----------
    name : str
        NAME is called with `envs`, and returns an object with
        `predict(observation, state, episode_start, deterministic)`.
    envs : TaskVectorEnv
        Vector environment of one instance, as the controller is designed for.

    Raises
    ------
    ValueError
        The file has no such name, or its code raises; the message names file and line.
    OSError
        The file cannot be read.
    """
    file, attribute = file_of(name), name.rpartition(":")[2]
    if file.suffix != ".py" or not attribute:
        raise ValueError(f"controller {name!r} must be {CODE_PREFIX}FILE.py:NAME")
    # An absent file is an OSError with its name.
    read(file)
    spec = importlib.util.spec_from_file_location(f"{__name__}.{file.stem}", file)
    assert spec is not None and spec.loader is not None
    # Data classes look their module up.
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    with _errors_of(file):
        spec.loader.exec_module(module)
        made = getattr(module, attribute)(envs)
    if not hasattr(made, "predict"):
        raise ValueError(f"{name} made a {type(made).__name__}, which has no predict")
    return made


class _Single:
    """Controller of a Python file for one instance: `predict` adds the axis that vector environments have."""

    def __init__(self, name: str, controller: Any) -> None:
        self._file, self._controller = file_of(name), controller

    def predict(self, observation: Any, state: Any = None) -> tuple[Any, Any]:
        """Action of one observation; None as the state begins an episode."""
        with _errors_of(self._file):
            given = {"episode_start": np.array([state is None]), "deterministic": True}
            actions, state = self._controller.predict(observation[np.newaxis], state and state[0], **given)
            # A controller without memory returns None, too.
            return np.asarray(actions)[0], (state,)


def make_controller(name: str, env: Any) -> Any:
    """Make a controller by its name (see `uvms_gym.make_controller`), or by `py:FILE:NAME`, for a single environment.

    Raises
    ------
    ValueError, TypeError, OSError
        See `uvms_gym.make_controller` and `load`.
    """
    if not name.startswith(CODE_PREFIX):
        return registry.make_controller(name, env)
    options = env.unwrapped.options
    kind = next(kind for kind in TaskVectorEnv.__subclasses__() if isinstance(options, kind.options_class))
    return _Single(name, load(name, kind(1, options)))


class PredictRollout:
    """Episodes of a vector environment under an object with `predict`; like `Rollout`, with the same statistics.

    Parameters
    ----------
    envs : TaskVectorEnv
    controller
        See `load`.
    name : str
        Its name, `py:FILE:NAME`.
    observations : array (N, d)
        Observations after the reset.
    """

    def __init__(self, envs: Any, controller: Any, name: str, observations: Any) -> None:
        self._envs, self._controller, self._file = envs, controller, file_of(name)
        self._observations, self._state = observations, None
        self._starts = np.ones(envs.num_envs, dtype=np.bool_)
        self._over = np.zeros(envs.num_envs, dtype=np.bool_)
        self._stats = self._blank()

    def run(self, steps: int, tick: Callable[[int], object] | None = None) -> None:
        """Run `steps` control periods; `tick` is called after each.

        Raises
        ------
        ValueError
            The controller's code raises, or its actions have a wrong shape or are not finite.
        """
        for _ in range(steps):
            with _errors_of(self._file):
                actions, self._state = self._controller.predict(
                    self._observations, self._state, episode_start=self._starts, deterministic=True
                )
            self._observations, rewards, terminated, truncated, infos = self._envs.step(actions)
            running, stats = ~self._over, self._stats
            stats.steps[running] += 1
            stats.returns[running] += rewards[running]
            stats.terminated[running], stats.truncated[running] = terminated[running], truncated[running]
            for name, last in stats.last.items():
                last[running] = infos[name][running]
                stats.sums[name][running] += last[running]
                stats.squares[name][running] += last[running] ** 2
            # The step after an episode's end begins the next one, which does not count.
            self._starts = terminated | truncated
            self._over |= self._starts
            if tick is not None:
                tick(1)

    def pop_stats(self) -> RolloutStats:
        """Return the statistics so far and clear them; the controller's memory stays."""
        stats, self._stats = self._stats, self._blank()
        return stats

    def _blank(self) -> RolloutStats:
        n = self._envs.num_envs
        terminated, truncated = (np.zeros(n, dtype=np.bool_) for _ in range(2))
        sums, squares, last = ({name: np.zeros(n) for name in self._envs.metric_names} for _ in range(3))
        return RolloutStats(np.zeros(n, dtype=np.uint32), np.zeros(n), terminated, truncated, sums, squares, last)


@contextmanager
def _errors_of(file: Path) -> Iterator[None]:
    """Turn any error of a file's code into a ValueError that names its line."""
    try:
        yield
    except Exception as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == file.absolute()]
        line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else (lines or [None])[-1]
        place = f"{file}:{line}: " if line is not None else ""
        raise ValueError(f"{place}{type(error).__name__}: {error}") from None
