"""What all controllers have in common."""

from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym.envs._arguments import Actions
from uvms_gym.envs._base import TaskBase
from uvms_gym.envs._options import Options


class Controller:
    """What all controllers have in common: `predict`."""

    #: The controller itself.
    policy: _core.Policy

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Any]:
        """Actions for one observation (d,) or for n of them (n, d).

        Parameters
        ----------
        observation : array_like (d,) or (n, d)
        state : array_like (m,) or (n, m), or None
            What the controller remembers: the second result of the call before, None at the start of an episode. A
            controller without memory (m = 0) does not look at it, and hands it back.
        episode_start : array_like of bool () or (n,), or None
            Where it is True an episode begins, and the state of that row is forgotten.
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
        """
        given = np.asarray(observation, dtype=np.float32)
        if given.ndim not in (1, 2):
            raise ValueError(f"observation has shape {given.shape}, but must have (d,) or (n, d)")
        rows = np.atleast_2d(given)
        _check_finite("observation", rows)
        width = self.policy.widths[1]
        memory = np.zeros((len(rows), width))
        if width and state is not None:
            remembered = np.asarray(state, dtype=np.float64)
            if remembered.shape != (*given.shape[:-1], width):
                raise ValueError(f"state has shape {remembered.shape}, but must have {(*given.shape[:-1], width)}")
            kept = np.ones(len(rows), dtype=np.bool_)
            if episode_start is not None:
                kept &= ~np.asarray(episode_start, dtype=np.bool_)
            memory[kept] = np.atleast_2d(remembered)[kept]
            _check_finite("state", memory)
        actions, memory = self.policy.act(rows, memory)
        if given.ndim == 1:
            actions, memory = actions[0], memory[0]
        return actions, (memory if width else state)


def options_of(controller: str, env: Any, given: Options, *more: str) -> Options:
    """Options that matter to a controller, of an environment or as given; `more` of them to some."""
    if env is not None:
        if given:
            raise TypeError(f"env tells the options: {', '.join(given)} cannot be given besides")
        inner = _unwrapped(controller, env)
        given = {**inner.options, "task": inner.task}
    matters = ("task", "scene", "action", "dt", "substeps", "preview", "thruster_lag", *more)
    return cast(Options, {key: value for key, value in given.items() if key in matters})


def remade(kind: type[Any], options: Options, gains: dict[str, Any]) -> Any:
    """Make a controller again after pickling."""
    return kind(**gains, **options)


def _check_finite(name: str, rows: NDArray[Any]) -> None:
    if not (finite := np.isfinite(rows)).all():
        row, entry = np.argwhere(~finite)[0]
        raise ValueError(f"{name} in row {row}, entry {entry} is {rows[row, entry]}, but must be finite")


def _unwrapped(controller: str, env: Any) -> TaskBase:
    """Find the environment inside wrappers and vector environments."""
    inner = getattr(env, "unwrapped", env)
    if not isinstance(inner, TaskBase) and hasattr(env, "get_attr"):
        inner = env.get_attr("unwrapped")[0]
    if not isinstance(inner, TaskBase):
        kind = type(inner).__name__
        raise TypeError(f"{controller} takes a UVMS environment, single or vector, not a {kind}")
    return inner
