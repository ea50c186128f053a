"""Base classes of controllers."""

from __future__ import annotations

import inspect
import warnings
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym._task.arguments import Actions, refuse_masked
from uvms_gym._task.base import TaskBase
from uvms_gym._task.options import native, option_names


class StateWarning(UserWarning):
    """A controller with memory was called twice without its state."""


class Controller:
    """Base class of all controllers.

    Attributes
    ----------
    native : uvms_gym._core.Controller
        The native controller, which `uvms_gym.Rollout` runs.
    """

    native: _core.Controller
    _stateless = _warned = False

    @property
    def memory_layout(self) -> dict[str, slice]:
        """Slices of a state by name; empty for a controller without memory."""
        layout, first = {}, 0
        for name, length in self.native.memory_layout:
            layout[name] = slice(first, first := first + length)
        return layout

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Any]:
        """Actions for one observation (d,) or for n of them (n, d).

        Parameters
        ----------
        observation : array_like (d,) or (n, d)
        state : array_like (m,) or (n, m), or None
            Memory of the controller: the second result of the previous call, None at the start of an episode. A
            controller without memory (m = 0) ignores it, and returns it.
        episode_start : array_like of bool () or (n,), or None
            True where an episode begins; the state of that row is reset.
        deterministic : bool
            Not used: there is no randomness.

        Returns
        -------
        action : numpy.ndarray (a,) or (n, a), float32
        state

        Raises
        ------
        ValueError
            Observations or a state of another shape, or that are not finite.

        Warns
        -----
        StateWarning
            Once, where a controller with memory is called a second time in a row without its state, and
            `episode_start` does not say that all rows begin an episode.
        """
        refuse_masked("observation", observation)
        given = np.asarray(observation, dtype=np.float32)
        if given.ndim not in (1, 2):
            raise ValueError(f"observation has shape {given.shape}, but must have (d,) or (n, d)")
        rows = np.atleast_2d(given)
        _check_finite("observation", rows)
        width = self.native.widths[1]
        memory = np.zeros((len(rows), width))
        if width and state is None:
            self._check_state(episode_start)
        elif width:
            refuse_masked("state", state)
            remembered = np.asarray(state, dtype=np.float64)
            if remembered.shape != (*given.shape[:-1], width):
                raise ValueError(f"state has shape {remembered.shape}, but must have {(*given.shape[:-1], width)}")
            kept = np.ones(len(rows), dtype=np.bool_)
            if episode_start is not None:
                kept &= ~np.asarray(episode_start, dtype=np.bool_)
            memory[kept] = np.atleast_2d(remembered)[kept]
            _check_finite("state", memory)
            self._stateless = False
        actions, memory = self.native.act(rows, memory)
        if given.ndim == 1:
            actions, memory = actions[0], memory[0]
        return actions, (memory if width else state)

    def _check_state(self, episode_start: Any) -> None:
        """Warn of a second call in a row without state in which no episode begins."""
        if self._stateless and not self._warned and (episode_start is None or not np.all(episode_start)):
            self._warned = True
            warnings.warn(
                f"{type(self).__name__} has memory, but was called twice without its state: every call counted as an "
                "episode's first; pass the previous call's state, `action, state = controller.predict(obs, state)`",
                StateWarning,
                stacklevel=3,
            )
        self._stateless = True


class ClassicalController(Controller):
    """Base class of classical controllers: gains as data, pickling, display.

    Gains are keyword arguments, `gains` returns them, and each is an attribute, too. Their names and defaults are those
    of the native controller.
    """

    #: Name of the native controller.
    kind: ClassVar[str]
    #: Tasks; without an environment the first one.
    tasks: ClassVar[tuple[str, ...]] = ("station-keep",)

    def __init_subclass__(cls, **arguments: Any) -> None:
        super().__init_subclass__(**arguments)
        if "kind" in vars(cls):
            _KINDS.append(cls)
            cls._names = _core.gain_names(cls.kind)
            keyword = inspect.Parameter.KEYWORD_ONLY
            cls.__signature__ = inspect.Signature(
                [
                    inspect.Parameter("env", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None),
                    *(inspect.Parameter(name, keyword, default=None) for name in cls._names),
                    inspect.Parameter("options", inspect.Parameter.VAR_KEYWORD),
                ]
            )

    _names: ClassVar[list[str]]
    __signature__: ClassVar[inspect.Signature]

    def __init__(self, env: Any = None, **arguments: Any) -> None:
        name = type(self).__name__
        gains = {key: arguments.pop(key) for key in self._names if key in arguments}
        if unknown := arguments.keys() - option_names():
            raise TypeError(f"{name}: unexpected argument {min(unknown)!r}; gains: {', '.join(self._names) or 'none'}")
        if env is None:
            arguments = {"task": self.tasks[0], **arguments}
        # The disturbance tells the sensors' delay, which is a gain from here on.
        options = options_of(name, env, arguments, "disturbance")
        self._check_task(options.get("task", "station-keep"))
        self.native = native(options).controller(self.kind, {key: _plain(key, gain) for key, gain in gains.items()})
        self._options = {key: value for key, value in options.items() if key != "disturbance"}

    @classmethod
    def _check_task(cls, task: str) -> None:
        """Refuse a task that the controller is not for, and name the controllers that are."""
        known = dict(_core.tasks())
        if task in known and task not in cls.tasks:
            others = [kind.__name__ for kind in _KINDS if task in kind.tasks]
            raise ValueError(
                f"{cls.__name__} is for {' and '.join(known[one] for one in cls.tasks)}, not for {known[task]}; "
                f"controllers of {known[task]}: {', '.join(others)}"
            )

    @property
    def gains(self) -> dict[str, Any]:
        """Gains by name: the keyword arguments that make the controller again."""
        return self.native.gains

    def __getattr__(self, name: str) -> Any:
        if name in type(self)._names:
            return self.gains[name]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __repr__(self) -> str:
        gains = (f"{name}={np.asarray(value).tolist()}" for name, value in self.gains.items())
        return f"{type(self).__name__}({', '.join(gains)})"

    def __reduce__(self) -> Any:
        return partial(type(self), **self.gains, **self._options), ()


#: All classes of classical controllers.
_KINDS: list[type[ClassicalController]] = []


def given_options(controller: str, env: Any, given: dict[str, Any]) -> dict[str, Any]:
    """All options of an environment, or as given."""
    if env is None:
        return given
    if given:
        raise TypeError(f"pass either env or options, not both: {', '.join(given)}")
    inner = _unwrapped(controller, env)
    return {**inner.options.to_dict(), "task": inner.task}


def options_of(controller: str, env: Any, given: dict[str, Any], *more: str) -> dict[str, Any]:
    """Options that matter to a controller, of an environment or as given; `more` of them to some."""
    common = ("task", "scene", "action", "dt", "substeps", "preview", "thruster_lag", "end_effector")
    matters = (*common, "dock", "observe_fixture", "observe_force", *more)
    return {key: value for key, value in given_options(controller, env, given).items() if key in matters}


def _plain(name: str, gain: Any) -> Any:
    if gain is None:
        return None
    array = np.asarray(gain)
    names = array.ndim == 1 and array.dtype.kind == "U"
    if array.ndim > 1 or not (array.dtype.kind in "iuf" or names):
        allowed = "a list of names" if name == "hold" else "a number or a list of numbers"
        raise ValueError(f"gain {name} is {gain!r}, but must be {allowed}")
    return array.tolist()


def _check_finite(name: str, rows: NDArray[Any]) -> None:
    if not (finite := np.isfinite(rows)).all():
        row, entry = np.argwhere(~finite)[0]
        raise ValueError(f"{name} in row {row}, entry {entry} is {rows[row, entry]}, but must be finite")


def _unwrapped(controller: str, env: Any) -> TaskBase:
    inner = getattr(env, "unwrapped", env)
    if not isinstance(inner, TaskBase) and hasattr(env, "get_attr"):
        inner = env.get_attr("unwrapped")[0]
    if not isinstance(inner, TaskBase):
        kind = type(inner).__name__
        raise TypeError(f"{controller} takes a UVMS environment, single or vector, not a {kind}")
    return inner
