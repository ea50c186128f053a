"""Controllers with the signature of Stable-Baselines3's policies."""

from typing import Any, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym.envs._station_keep import Actions, Options, StationKeepBase, native


class PD:
    """The paper's PD on the vehicle, `F = -kp e - kd V`, from observations alone.

    [HC sec. 5.2] It reads the pose error e (body axes, attitude as rotation vector) and the body twist V; the arm is
    held by its own servos. The wrench is turned into an action of the environment's kind, clipped to [-1, 1].

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        A `UVMS-StationKeep` environment that tells scene and kind of action; wrappers do not matter, but those that
        change observations or actions change what the PD would read and say.
    kp, kd : array_like (6,) or None
        Gains per body axis [x, y, z, roll, pitch, yaw], N/m, N m/rad and N s/m, N m s/rad; the scene's own where None.
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene` and `action` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    def __init__(
        self, env: Any = None, *, kp: ArrayLike | None = None, kd: ArrayLike | None = None, **options: Unpack[Options]
    ) -> None:
        if env is not None:
            if options:
                raise TypeError(f"env tells the options: {', '.join(options)} cannot be given besides")
            options = _unwrapped(env).options
        chosen = cast(Options, {key: value for key, value in options.items() if key in ("scene", "action")})
        self._arguments = (chosen, _gains(kp), _gains(kd))
        self._pd = native(chosen).pd(*self._arguments[1:])

    @property
    def kp(self) -> NDArray[np.float64]:
        """Proportional gains (6,), N/m and N m/rad."""
        return np.array(self._pd.kp)

    @property
    def kd(self) -> NDArray[np.float64]:
        """Derivative gains (6,), N s/m and N m s/rad."""
        return np.array(self._pd.kd)

    def predict(
        self, observation: ArrayLike, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Actions, Any]:
        """Actions for one observation (d,) or for n of them (n, d).

        Parameters
        ----------
        observation : array_like (d,) or (n, d)
        state, episode_start, deterministic
            Not used: the PD has no memory. `state` is handed back.

        Returns
        -------
        action : numpy.ndarray (a,) or (n, a), float32
        state

        Raises
        ------
        ValueError
            Observations of another width, or that are not finite.
        """
        given = np.asarray(observation, dtype=np.float32)
        if given.ndim not in (1, 2):
            raise ValueError(f"observation has shape {given.shape}, but must have (d,) or (n, d)")
        rows = np.atleast_2d(given)
        if not (finite := np.isfinite(rows)).all():
            row, entry = np.argwhere(~finite)[0]
            raise ValueError(f"observation in row {row}, entry {entry} is {rows[row, entry]}, but must be finite")
        actions = self._pd.act(rows)
        return (actions[0] if given.ndim == 1 else actions), state

    def __getstate__(self) -> Any:
        return self._arguments

    def __setstate__(self, arguments: Any) -> None:
        self._arguments = arguments
        self._pd = native(arguments[0]).pd(*arguments[1:])


def _gains(given: ArrayLike | None) -> list[float] | None:
    if given is None:
        return None
    gains = np.asarray(given, dtype=np.float64)
    if gains.shape != (6,):
        raise ValueError(f"gains have shape {gains.shape}, but must have (6,)")
    return [float(gain) for gain in gains]


def _unwrapped(env: Any) -> StationKeepBase:
    """Find the environment inside wrappers and vector environments."""
    inner = getattr(env, "unwrapped", env)
    if not isinstance(inner, StationKeepBase) and hasattr(env, "get_attr"):
        inner = env.get_attr("unwrapped")[0]
    if not isinstance(inner, StationKeepBase):
        raise TypeError(f"PD takes a UVMS-StationKeep environment, single or vector, not a {type(inner).__name__}")
    return inner
