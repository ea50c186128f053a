"""Controllers with the signature of Stable-Baselines3's policies. They run natively, alone or in a closed loop."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym.envs._station_keep import Actions, Options, StationKeepBase, native

__all__ = ["MLP", "PD", "PID", "Controller", "Rest"]

Floats = NDArray[np.float64]


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


class Rest(Controller):
    """No control: every action is 0.

    Parameters
    ----------
    env, **options
        As `PD` has them.
    """

    def __init__(self, env: Any = None, **options: Unpack[Options]) -> None:
        self._options = _options(type(self).__name__, env, options)
        self.policy = native(self._options).rest()

    def __reduce__(self) -> Any:
        return _remade, (type(self), self._options, {})


class PD(Controller):
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

    policy: _core.Pd

    def __init__(
        self, env: Any = None, *, kp: ArrayLike | None = None, kd: ArrayLike | None = None, **options: Unpack[Options]
    ) -> None:
        self._options = _options(type(self).__name__, env, options)
        self.policy = native(self._options).pd(_gains(kp), _gains(kd))

    @property
    def kp(self) -> Floats:
        """Proportional gains (6,), N/m and N m/rad."""
        return np.array(self.policy.kp)

    @property
    def kd(self) -> Floats:
        """Derivative gains (6,), N s/m and N m s/rad."""
        return np.array(self.policy.kd)

    def __reduce__(self) -> Any:
        return _remade, (type(self), self._options, {"kp": self.kp, "kd": self.kd})


class PID(Controller):
    """`PD` with an integral of the pose error, `F = -kp e - kd V - ki z` with `z' = e`.

    The integral takes out what a current or a weight leaves of the error. It is the controller's state, which `predict`
    takes and gives back: without it, every call is the first of an episode. Against windup it waits on every axis whose
    wrench the thrusters do not reach, for as long as the error would drive it further that way.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        As `PD` has it; it tells the control period, too.
    kp, kd : array_like (6,) or None
        As `PD` has them.
    ki : array_like (6,) or None
        Integral gains, N/(m s) and N m/(rad s). Where None, from the others by T_i = 2 T_d: `ki = kp**2 / (2 kd)`.
        (On a critically damped PD the slowest poles then have a damping ratio of 0.69.)
    **options
        Without `env`: arguments of `StationKeepEnv`, of which `scene`, `action`, `dt` and `substeps` matter.

    Raises
    ------
    ValueError
        The scene has no gains and none are given, or a gain is negative or not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    policy: _core.Pid

    def __init__(
        self,
        env: Any = None,
        *,
        kp: ArrayLike | None = None,
        kd: ArrayLike | None = None,
        ki: ArrayLike | None = None,
        **options: Unpack[Options],
    ) -> None:
        self._options = _options(type(self).__name__, env, options)
        self.policy = native(self._options).pid(_gains(kp), _gains(kd), _gains(ki))

    @property
    def kp(self) -> Floats:
        """Proportional gains (6,), N/m and N m/rad."""
        return np.array(self.policy.kp)

    @property
    def kd(self) -> Floats:
        """Derivative gains (6,), N s/m and N m s/rad."""
        return np.array(self.policy.kd)

    @property
    def ki(self) -> Floats:
        """Integral gains (6,), N/(m s) and N m/(rad s)."""
        return np.array(self.policy.ki)

    def __reduce__(self) -> Any:
        return _remade, (type(self), self._options, {"kp": self.kp, "kd": self.kd, "ki": self.ki})


class MLP(Controller):
    """A neural network: layers `W x + b` with an activation between them, in float32.

    It says what a trained policy says with `deterministic=True`: the mean of its actions. Files are safetensors; they
    tell what environment the policy is for (task, scene, kind of action, control period, names and sizes of the
    observation's blocks), and are refused where it is another. A scene that is altered but keeps its name is the same.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        The `UVMS-StationKeep` environment that the policy is for.
    weights : sequence of array_like (outputs, inputs)
        One per layer, as torch has them.
    biases : sequence of array_like (outputs,)
        One per layer.
    activation : str
        "tanh", "relu" or "elu", after every layer but the last.
    output : str
        "clip": the last layer's numbers are clipped to [-1, 1]. "tanh": they are squashed by it, as SAC does.
    mean, variance : array_like (inputs,) or None
        What observations are normalised by first, as VecNormalize does it (its `obs_rms.mean` and `obs_rms.var`):
        `clip((x - mean) / sqrt(variance + epsilon), -clip, clip)`. Nothing where None.
    epsilon, clip : float
        As VecNormalize has them (`epsilon`, `clip_obs`).
    notes : mapping of str to str, or None
        What else is to be known: seeds, steps, scores.
    **options
        Without `env`: arguments of `StationKeepEnv` that tell what the policy is for. Without both it does not say so.

    Raises
    ------
    ValueError
        Layers do not fit together or to the environment, or a number is not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    policy: _core.Mlp

    def __init__(
        self,
        env: Any = None,
        *,
        weights: Sequence[ArrayLike],
        biases: Sequence[ArrayLike],
        activation: Literal["tanh", "relu", "elu"] = "tanh",
        output: Literal["clip", "tanh"] = "clip",
        mean: ArrayLike | None = None,
        variance: ArrayLike | None = None,
        epsilon: float = 1e-8,
        clip: float = 10.0,
        notes: Mapping[str, str] | None = None,
        **options: Unpack[Options],
    ) -> None:
        if (mean is None) != (variance is None):
            raise ValueError("give both mean and variance, or neither")
        given = None if mean is None else (_array("mean", mean, 1), _array("variance", variance, 1), epsilon, clip)
        self.policy = _core.Mlp(
            [_array(f"weights[{i}]", layer, 2) for i, layer in enumerate(weights)],
            [_array(f"biases[{i}]", layer, 1) for i, layer in enumerate(biases)],
            activation=activation,
            output=output,
            normalisation=given,
            task=_task(type(self).__name__, env, options),
            notes=dict(notes or {}),
        )

    @classmethod
    def from_state_dict(cls, state_dict: Mapping[str, ArrayLike], env: Any = None, **arguments: Any) -> Self:
        """Make a policy from the arrays of a torch module, by their names there.

        Parameters
        ----------
        state_dict : mapping of str to array_like
            `model.policy.state_dict()` of Stable-Baselines3's PPO or A2C (a `MlpPolicy` on the CPU) or SAC, or
            `state_dict()` of an `nn.Sequential`: layers are taken in the order of their numbers.
        env, **arguments
            As `MLP` has them; the activation is not in the arrays.

        Raises
        ------
        ValueError
            No layers are found under any of these names.
        """
        for hidden, last in (
            (r"mlp_extractor\.policy_net\.(\d+)", "action_net"),
            (r"actor\.latent_pi\.(\d+)", "actor.mu"),
            (r"(\d+)", None),
        ):
            found = (re.fullmatch(rf"{hidden}\.weight", name) for name in state_dict)
            numbered = sorted((int(match[1]), match[0]) for match in found if match)
            names = [name.removesuffix(".weight") for _, name in numbered]
            if last is not None and f"{last}.weight" in state_dict:
                names.append(last)
            if names:
                weights, biases = ([state_dict[f"{name}.{part}"] for name in names] for part in ("weight", "bias"))
                return cls(env, weights=weights, biases=biases, **arguments)
        raise ValueError(f"no layers found among the names {', '.join(state_dict)}")

    @classmethod
    def load(cls, file: str | os.PathLike[str], env: Any = None, **options: Unpack[Options]) -> Self:
        """Read a policy from a safetensors file, and check that it is for `env` (or `options`), if given.

        Raises
        ------
        OSError
            The file cannot be read.
        ValueError
            It holds no policy, or one for something else; the message names the difference.
        """
        task = _task(cls.__name__, env, options)
        try:
            policy = _core.Mlp.from_bytes(Path(file).read_bytes())
            if task is not None:
                policy.check(task)
        except ValueError as error:
            raise ValueError(f"{os.fspath(file)}: {error}") from None
        return cls._of(policy)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the policy to a safetensors file. Equal policies make equal files.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        Path(file).write_bytes(self.policy.to_bytes())

    @property
    def sizes(self) -> list[int]:
        """Entries of the observation and of all layers' results."""
        return self.policy.sizes

    @property
    def purpose(self) -> dict[str, Any] | None:
        """What the policy is for: task, scene, action, actions, control_period and observation."""
        return self.policy.purpose

    @property
    def notes(self) -> dict[str, str]:
        """What else is to be known of it."""
        return self.policy.notes

    @classmethod
    def _of(cls, policy: _core.Mlp) -> Self:
        self = cls.__new__(cls)
        self.policy = policy
        return self

    @classmethod
    def _unpacked(cls, data: bytes) -> Self:
        return cls._of(_core.Mlp.from_bytes(data))

    def __reduce__(self) -> Any:
        return self._unpacked, (self.policy.to_bytes(),)


def _remade(kind: type[Any], options: Options, gains: dict[str, Any]) -> Any:
    """Make a controller again after pickling."""
    return kind(**gains, **options)


def _check_finite(name: str, rows: NDArray[Any]) -> None:
    if not (finite := np.isfinite(rows)).all():
        row, entry = np.argwhere(~finite)[0]
        raise ValueError(f"{name} in row {row}, entry {entry} is {rows[row, entry]}, but must be finite")


def _gains(given: ArrayLike | None) -> list[float] | None:
    if given is None:
        return None
    gains = np.asarray(given, dtype=np.float64)
    if gains.shape != (6,):
        raise ValueError(f"gains have shape {gains.shape}, but must have (6,)")
    return [float(gain) for gain in gains]


def _array(name: str, given: ArrayLike | None, dimensions: int) -> NDArray[np.float32]:
    array = np.asarray(given, dtype=np.float32)
    if array.ndim != dimensions:
        raise ValueError(f"{name} has shape {array.shape}, but must have {dimensions} dimensions")
    return array


def _options(controller: str, env: Any, given: Options) -> Options:
    """Options that matter to a controller, of an environment or as given."""
    if env is not None:
        if given:
            raise TypeError(f"env tells the options: {', '.join(given)} cannot be given besides")
        given = _unwrapped(controller, env).options
    matters = ("scene", "action", "dt", "substeps")
    return cast(Options, {key: value for key, value in given.items() if key in matters})


def _task(controller: str, env: Any, given: Options) -> _core.StationKeep | None:
    """The task that a policy is for, if that is told."""
    return native(_options(controller, env, given)) if env is not None or given else None


def _unwrapped(controller: str, env: Any) -> StationKeepBase:
    """Find the environment inside wrappers and vector environments."""
    inner = getattr(env, "unwrapped", env)
    if not isinstance(inner, StationKeepBase) and hasattr(env, "get_attr"):
        inner = env.get_attr("unwrapped")[0]
    if not isinstance(inner, StationKeepBase):
        kind = type(inner).__name__
        raise TypeError(f"{controller} takes a UVMS-StationKeep environment, single or vector, not a {kind}")
    return inner
