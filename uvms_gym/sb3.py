"""Stable-Baselines3 on the native vector environments; needs `stable-baselines3`.

```python
from stable_baselines3 import PPO
from uvms_gym.sb3 import make_vec_env

venv = make_vec_env("UVMS-StationKeep-v0", n_envs=64, seed=0)
PPO("MlpPolicy", venv).learn(100_000)
```
"""

import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from uvms_gym._core import Simulator
from uvms_gym._extras import extra

with extra("train"):
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

_FINAL = ("final_obs", "final_info")


def make_vec_env(
    id: str | gymnasium.envs.registration.EnvSpec,
    n_envs: int = 1,
    seed: int | None = None,
    *,
    monitor: bool = True,
    **kwargs: Any,
) -> "NativeVecEnv":
    """Make `n_envs` instances of an environment for Stable-Baselines3.

    Parameters
    ----------
    id : str or EnvSpec
        Id or spec for `gymnasium.make_vec`.
    n_envs : int
        Number of instances.
    seed : int or None
        Instance i starts its first episode with `seed + i`; None: drawn by NumPy's global generator, as in
        Stable-Baselines3.
    monitor : bool
        See `NativeVecEnv`.
    **kwargs
        Arguments of the environment, `max_episode_steps` and `render_mode` among them.
    """
    envs = gymnasium.make_vec(id, num_envs=n_envs, autoreset_mode=AutoresetMode.SAME_STEP.value, **kwargs)
    venv = NativeVecEnv(envs, monitor=monitor)
    venv.seed(seed)
    venv.action_space.seed(seed)
    return venv


class NativeVecEnv(VecEnv):
    """Stable-Baselines3 `VecEnv` over a Gymnasium vector environment, with same-step autoreset.

    Observations, rewards, dones, reset infos, and the infos of instances whose episode has just ended equal those of
    a `DummyVecEnv` of single environments in a `Monitor`, bit for bit. The infos of all other instances are separate
    empty dicts; the metrics of all instances are arrays in `infos`.

    Attributes and methods of single instances: `set_attr` sets an attribute beside the environment, which `get_attr`
    finds first, as `DummyVecEnv` does with the outermost wrapper. `get_attr` gives `episode` of the instance only, its
    own spaces, and otherwise the vector environment's attributes. `env_method` calls `reset`, `render`, `snapshot`,
    `get_state` and `set_state`.

    Parameters
    ----------
    envs : gymnasium.vector.VectorEnv
        With same-step autoreset, wrapped or not; or with autoreset disabled, such as wrappers want that look at the
        state with which an episode ends.
    monitor : bool
        Give `episode` (return r, length l, time t in s since this was made) where an episode ends, and answer for a
        `Monitor`. Without it `VecMonitor` may do so, which warns otherwise.

    Raises
    ------
    TypeError, ValueError
        `envs` is no vector environment, or resets with the next step.
    """

    infos: Mapping[str, Any]
    """Infos of the last `reset` or step of the vector environment."""
    spec: gymnasium.envs.registration.EnvSpec | None
    """Spec of the environment."""

    def __init__(self, envs: VectorEnv[Any, Any, Any], *, monitor: bool = True) -> None:
        if not isinstance(envs, VectorEnv):
            raise TypeError(f"envs must be a gymnasium vector environment, not {type(envs).__name__}")
        mode = envs.metadata.get("autoreset_mode")
        if mode not in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
            raise ValueError(f"autoreset_mode of envs is {mode}, but must be 'SameStep' (or 'Disabled')")
        self.envs, self.spec = envs, envs.spec
        self._resets = mode is AutoresetMode.SAME_STEP
        self.monitor = monitor
        self.infos = {}
        self._own: list[dict[str, Any]] = [{} for _ in range(envs.num_envs)]
        self._returns = np.zeros(envs.num_envs)
        self._lengths = np.zeros(envs.num_envs, dtype=np.int64)
        self._begun = time.time()
        self._actions: Any = None
        self._started = False
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = self._attribute("metadata", 0)

    def reset(self) -> NDArray[Any]:
        """Start episodes of all instances with the seeds and options set before."""
        observations, infos = self._start(range(self.num_envs), self._seeds, self._options)
        self.reset_infos = infos
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions (n, a) of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step; observations (n, d), rewards float32 (n,), dones bool (n,), infos.

        Raises
        ------
        ValueError
            An action is not finite, or the shape is wrong; nothing has changed then.
        """
        observations, rewards, terminated, truncated, self.infos = self.envs.step(self._actions)
        dones = terminated | truncated
        self._returns += rewards
        self._lengths += 1
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        where = np.flatnonzero(dones)
        if where.size:
            observations, finals, ended, started = self._restart(observations, dones)
            limited = (truncated & ~terminated).tolist()
            spent = round(time.time() - self._begun, 6)
            for i, final, info, new in zip(where.tolist(), finals, ended, started, strict=True):
                if self.monitor:
                    info["episode"] = {"r": round(float(self._returns[i]), 6), "l": int(self._lengths[i]), "t": spent}
                info["TimeLimit.truncated"] = limited[i]
                info["terminal_observation"] = final
                infos[i], self.reset_infos[i] = info, new
            self._returns[where] = 0.0
            self._lengths[where] = 0
        return observations, rewards.astype(np.float32), dones, infos

    def _restart(
        self, observations: NDArray[Any], dones: NDArray[np.bool_]
    ) -> tuple[NDArray[Any], Iterable[NDArray[Any]], list[dict[str, Any]], list[dict[str, Any]]]:
        """Observations after the restart of `dones`; their last observations, last infos and first infos."""
        given, where = self.infos, np.flatnonzero(dones)
        if self._resets:
            started = {key: value for key, value in given.items() if key not in _FINAL}
            return observations, given["final_obs"][where], _rows(given["final_info"], where), _rows(started, where)
        again, infos = self.envs.reset(options={"reset_mask": dones})
        return again, observations[where], _rows(given, where), _rows(infos, where)

    def close(self) -> None:
        """Close the environment."""
        self.envs.close()

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Complete state, without the seed of the next `reset`."""
        state = cast(Any, self.envs.unwrapped).get_state()
        return {**state, "returns": self._returns.copy(), "lengths": self._lengths.copy()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from the state of a `NativeVecEnv` of the same environment.

        Raises
        ------
        ValueError, TypeError
            The state is not one of such an environment.
        """
        cast(Any, self.envs.unwrapped).set_state(state)
        self._returns, self._lengths = np.array(state["returns"]), np.array(state["lengths"])
        self._started = True

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """One picture (height, width, 3) of each instance."""
        if self.render_mode != "rgb_array":
            warnings.warn(f"render_mode is {self.render_mode!r}, but must be 'rgb_array' for pictures", stacklevel=2)
            return [None] * self.num_envs
        return list(cast(Any, self.envs.render()))

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of each of the instances."""
        return [self._attribute(attr_name, i) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of each of the instances, beside the environment itself."""
        for i in self._get_indices(indices):
            self._own[i][attr_name] = value

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call `reset`, `render`, `snapshot`, `get_state` or `set_state` of each of the instances.

        Raises
        ------
        AttributeError
            Any other method.
        """
        method: Callable[..., list[Any]] | None = getattr(self, f"_{method_name}_of", None)
        if method is None:
            raise AttributeError(
                f"{method_name!r} cannot be called on single instances; possible: 'reset', 'render', 'snapshot', "
                "'get_state' and 'set_state'. Call methods of all instances together on `envs`."
            )
        chosen = [range(self.num_envs)[i] for i in self._get_indices(indices)]
        return method(chosen, *method_args, **method_kwargs)

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """True for `Monitor`, whose part this class plays, and for wrappers around the vector environment."""
        wrapped = self.monitor and issubclass(Monitor, wrapper_class)
        wrapped = wrapped or any(isinstance(env, wrapper_class) for env in _layers(self.envs))
        return [wrapped for _ in self._get_indices(indices)]

    def _start(
        self, indices: Iterable[int], seeds: Sequence[int | None], options: Sequence[Mapping[str, Any]]
    ) -> tuple[NDArray[Any], list[dict[str, Any]]]:
        """Start episodes of some instances; observations of all, and infos of those.

        Seeds and options have one entry per instance. One call of the environment covers the instances with the same
        names of options.
        """
        if len(options) != self.num_envs:
            raise ValueError(f"options of {len(options)} instances were set, but there are {self.num_envs}")
        alike: dict[Any, list[int]] = {}
        for i in indices:
            kinds = sorted((name, "" if _is_numeric(value) else repr(value)) for name, value in options[i].items())
            alike.setdefault(tuple(kinds), []).append(i)
        observations: NDArray[Any] = np.empty(0)
        infos: dict[int, dict[str, Any]] = {}
        for group in alike.values():
            mask = np.zeros(self.num_envs, dtype=np.bool_)
            mask[group] = True
            # Numbers have one row per instance.
            given = {
                name: np.stack([options[i if mask[i] else group[0]][name] for i in range(self.num_envs)])
                if _is_numeric(value)
                else value
                for name, value in options[group[0]].items()
            }
            if not mask.all():
                given["reset_mask"] = mask
                if not self._started:
                    # The first reset must cover all instances.
                    self.envs.reset(seed=cast(Any, list(seeds)))
            observations, self.infos = self.envs.reset(seed=cast(Any, list(seeds)), options=given or None)
            self._started = True
            infos.update(zip(group, _rows(self.infos, np.array(group)), strict=True))
            self._returns[group] = 0.0
            self._lengths[group] = 0
        return observations, [infos[i] for i in sorted(infos)]

    def _attribute(self, name: str, i: int) -> Any:
        if name in self._own[i]:
            return self._own[i][name]
        found = {"observation_space": "single_observation_space", "action_space": "single_action_space"}.get(name, name)
        for env in _layers(self.envs):
            if hasattr(env, found):
                value = getattr(env, found)
                break
        else:
            raise AttributeError(f"{type(self.envs.unwrapped).__name__} has no attribute {name!r}")
        i = range(self.num_envs)[i]
        if name == "metadata":
            return {key: entry for key, entry in value.items() if key != "autoreset_mode"}
        if name == "episode":
            return {key: rows[i : i + 1] for key, rows in value.items()}
        return value

    def _reset_of(
        self, indices: list[int], *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> list[tuple[NDArray[Any], dict[str, Any]]]:
        observations, infos = self._start(indices, [seed] * self.num_envs, [options or {}] * self.num_envs)
        of = dict(zip(sorted(set(indices)), infos, strict=True))
        return [(observations[i].copy(), of[i]) for i in indices]

    def _render_of(self, indices: list[int]) -> list[Any]:
        pictures = cast(Any, self.envs.render())
        return [None if pictures is None else pictures[i] for i in indices]

    def _snapshot_of(self, indices: list[int]) -> list[Simulator]:
        snapshot = cast(Any, self.envs.unwrapped).snapshot()
        (scene, _), options = snapshot.__getnewargs_ex__()
        state = snapshot.__getstate__()
        snapshots = []
        for i in indices:
            one = Simulator(scene, 1, **options)
            one.__setstate__(state[i : i + 1])
            snapshots.append(one)
        return snapshots

    def _get_state_of(self, indices: list[int]) -> list[dict[str, NDArray[Any]]]:
        state = cast(Any, self.envs.unwrapped).get_state()
        return [{part: rows[i : i + 1].copy() for part, rows in state.items()} for i in indices]

    def _set_state_of(self, indices: list[int], state: Mapping[str, NDArray[Any]]) -> list[None]:
        states = cast(Any, self.envs.unwrapped).get_state()
        for part, rows in states.items():
            rows[indices] = state[part]
        cast(Any, self.envs.unwrapped).set_state(states)
        return [None] * len(indices)


def _layers(envs: Any) -> Iterable[Any]:
    """Wrappers of a vector environment, outermost first, and the environment."""
    while envs is not envs.unwrapped:
        yield envs
        envs = envs.env
    yield envs


def _rows(infos: Mapping[str, Any], where: NDArray[np.intp]) -> list[dict[str, Any]]:
    """Infos of some instances in the form of single environments."""
    rows: list[dict[str, Any]] = [{} for _ in where]
    for key, values in infos.items():
        if (mask := infos.get(f"_{key}")) is None:
            continue
        parts = _rows(values, where) if isinstance(values, Mapping) else values[where]
        if isinstance(parts, np.ndarray) and parts.ndim == 1:
            parts = parts.tolist()
        for row, part, present in zip(rows, parts, mask[where].tolist(), strict=True):
            if present:
                row[key] = part
    return rows


def _is_numeric(value: Any) -> bool:
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except ValueError:
        # Rows of different lengths, which the environment refuses.
        return False
