"""Neural policies, by themselves or as corrections to a controller, without torch."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uvms_gym import _core
from uvms_gym._files import read, write
from uvms_gym._task.options import native
from uvms_gym.controllers.base import Controller, options_of


class MLP(Controller):
    """A neural network: layers `W x + b` with an activation between them, in float32.

    Its action is the mean, as with `deterministic=True` in training. Files are safetensors; they hold the
    policy's environment (task, scene, kind of action, control period, names and sizes of the observation's blocks), and
    are refused by another. `uvms_gym.make_controller` also compares scales, limits and the conditions of the training.

    Parameters
    ----------
    env : gymnasium.Env, gymnasium.vector.VectorEnv, VecEnv or None
        Environment of the policy.
    weights : sequence of array_like (outputs, inputs)
        One per layer, as in torch.
    biases : sequence of array_like (outputs,)
        One per layer.
    activation : str
        "tanh", "relu" or "elu", after every layer but the last.
    output : str
        "clip": the last layer's numbers are clipped to [-1, 1]. "tanh": they are squashed by it, as in SAC.
    mean, variance : array_like (inputs,) or None
        Normalisation of observations, as in VecNormalize (its `obs_rms.mean` and `obs_rms.var`):
        `clip((x - mean) / sqrt(variance + epsilon), -clip, clip)`. None: no normalisation.
    epsilon, clip : float
        As in VecNormalize (`epsilon`, `clip_obs`).
    history : int
        Number of stacked observations: the last ones, oldest first, and zeros before an episode's first, as in
        `VecFrameStack`. They are the controller's state, which `predict` takes and returns.
    residual : bool
        True for a residual policy: it reads a base controller's action after the observation. See `Residual`.
    notes : mapping of str to str, or None
        Free text: seeds, steps, scores.
    **options
        Without `env`: arguments of its environment, and `task`. Without both the policy's environment is unknown.

    Raises
    ------
    ValueError
        Layers do not fit together or to the environment, or a number is not finite.
    TypeError
        `env` is something else, or options are given besides.
    """

    native: _core.Mlp

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
        history: int = 1,
        residual: bool = False,
        notes: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        if (mean is None) != (variance is None):
            raise ValueError("give both mean and variance, or neither")
        given = None if mean is None else (_array("mean", mean, 1), _array("variance", variance, 1), epsilon, clip)
        self.native = _core.Mlp(
            [_array(f"weights[{i}]", layer, 2) for i, layer in enumerate(weights)],
            [_array(f"biases[{i}]", layer, 1) for i, layer in enumerate(biases)],
            activation=activation,
            output=output,
            history=history,
            normalisation=given,
            task=_task(type(self).__name__, env, options),
            residual=residual,
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
            Meaning as in `MLP`; the activation is not in the arrays.

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
    def load(cls, file: str | os.PathLike[str], env: Any = None, *, residual: bool = False, **options: Any) -> Self:
        """Read a policy from a safetensors file, and check that it is for `env` (or `options`), if given.

        With `residual` it must be a residual policy, without it must not.

        Raises
        ------
        OSError
            The file cannot be read, is no regular file, or has more than 100 MB.
        ValueError
            It holds no policy, or one of another environment; the message names the difference.
        """
        task = _task(cls.__name__, env, options)
        try:
            policy = _core.Mlp.from_bytes(read(file))
            if policy.residual and not residual:
                raise ValueError("this is a residual policy; load it with residual=True or through Residual")
            if task is not None:
                policy.check(task, residual=residual)
        except ValueError as error:
            raise ValueError(f"{os.fspath(file)}: {error}") from None
        self = cls.__new__(cls)
        self.native = policy
        return self

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the policy to a safetensors file. Equal policies make equal files.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        write(file, self.native.to_bytes())

    @property
    def sizes(self) -> list[int]:
        """Entries of the input, and of all layers' results."""
        return self.native.sizes

    @property
    def spec(self) -> dict[str, Any] | None:
        """Environment of the policy; None if unknown.

        Its keys are task, scene, end_effector, action, actions, control_period (s) and observation.
        """
        return self.native.spec

    @property
    def history(self) -> int:
        """Number of stacked observations."""
        return self.native.history

    @property
    def residual(self) -> bool:
        """True for a residual policy."""
        return self.native.residual

    @property
    def notes(self) -> dict[str, str]:
        """Notes in the policy's file, such as seeds, steps and scores."""
        return self.native.notes

    def __repr__(self) -> str:
        spec = self.spec or {}
        kind = {"history": self.history, "residual": self.residual}
        kind |= {name: spec[name] for name in ("task", "scene", "action", "control_period") if name in spec}
        return f"MLP(sizes={self.sizes}, {', '.join(f'{name}={value!r}' for name, value in kind.items())})"

    def __getstate__(self) -> bytes:
        return self.native.to_bytes()

    def __setstate__(self, data: bytes) -> None:
        self.native = _core.Mlp.from_bytes(data)


class Residual(Controller):
    """A base controller and a residual policy that corrects it. [Sil18]

    The network reads the observation and then the controller's action; the action is
    `clip(base + limit * clip(network))`, each clip to [-1, 1].

    Parameters
    ----------
    base : Controller
        Base controller.
    correction : MLP
        Residual policy (`residual=True`): it reads d + a entries and gives a.
    limit : float
        Maximum correction of an entry of the action, in [0, 1].

    Raises
    ------
    ValueError
        The network reads or gives other entries, or the limit is out of range.
    """

    def __init__(self, base: Controller, correction: MLP, limit: float = 0.3) -> None:
        self.base, self.correction, self.limit = base, correction, float(limit)
        self.native = correction.native.correcting(base.native, self.limit)

    def __repr__(self) -> str:
        return f"Residual({self.base!r}, {self.correction!r}, limit={self.limit:g})"

    def __reduce__(self) -> Any:
        return type(self), (self.base, self.correction, self.limit)


def _array(name: str, given: ArrayLike | None, dimensions: int) -> NDArray[np.float32]:
    array = np.asarray(given, dtype=np.float32)
    if array.ndim != dimensions:
        raise ValueError(f"{name} has shape {array.shape}, but must have {dimensions} dimensions")
    return array


def _task(controller: str, env: Any, given: dict[str, Any]) -> _core.Task | None:
    return native(options_of(controller, env, given)) if env is not None or given else None
