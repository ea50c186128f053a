"""Networks in torch: actor, and critic on perfect observations."""

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import linear

from uvms_gym import MLP
from uvms_gym.training.export import check_actions

#: Factor on observations, whose entries have standard deviations of 0.1 to 0.5 about a target.
GAIN = 4.0
#: Bound on the critic's inputs: diverging episodes reach hundreds.
_BOUND = 8.0


class _Tanh(torch.autograd.Function):
    """tanh(x) = 2 / (1 + exp(-2 x)) - 1: a third of the time of `torch.tanh` on CPU."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        y = torch.sigmoid(2.0 * x).mul_(2.0).sub_(1.0)
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> Tensor:
        (y,) = ctx.saved_tensors
        return torch.ops.aten.tanh_backward(grad, y)  # type: ignore[no-any-return]


class Tanh(nn.Module):
    """Hyperbolic tangent."""

    def forward(self, x: Tensor) -> Tensor:
        """Apply it to all elements."""
        y: Tensor = _Tanh.apply(x)
        return y


def layers(sizes: Sequence[int], last: float) -> nn.Sequential:
    """Layers with tanh between them; the weights of the last one are multiplied by `last`, its biases are 0."""
    parts: list[nn.Module] = []
    for inputs, outputs in pairwise(sizes):
        parts += [nn.Linear(inputs, outputs), Tanh()]
    end = parts[-2]
    assert isinstance(end, nn.Linear)
    with torch.no_grad():
        end.weight.mul_(last)
        end.bias.zero_()
    return nn.Sequential(*parts[:-1])


class Actor(nn.Module):
    """Normal distribution of actions (n, a), for stacked observations (n, h d): its mean.

    Parameters
    ----------
    sizes : sequence of int
        Inputs, hidden layers, actions.
    log_std : float
        Logarithm of the initial standard deviation.
    """

    def __init__(self, sizes: Sequence[int], log_std: float = 0.0) -> None:
        super().__init__()
        self.layers = layers(sizes, 0.1)
        self.log_std = nn.Parameter(torch.full((sizes[-1],), log_std))

    def forward(self, inputs: Tensor) -> Tensor:
        """Mean of the action."""
        first = self.layers[0]
        assert isinstance(first, nn.Linear)
        # Weights are fewer than inputs.
        mean: Tensor = self.layers[1:](linear(inputs, first.weight * GAIN, first.bias))
        return mean

    def log_prob(self, mean: Tensor, actions: Tensor) -> Tensor:
        """Logarithm of the density of actions, up to a constant."""
        scaled = (actions - mean) * torch.exp(-self.log_std)
        return -(0.5 * scaled**2 + self.log_std).sum(dim=-1)

    def network(self, history: int, env: Any = None, notes: Mapping[str, str] | None = None) -> MLP:
        """Policy without torch, of the mean action."""
        state = {name: array.detach().numpy() for name, array in self.layers.state_dict().items()}
        state["0.weight"] = state["0.weight"] * np.float32(GAIN)
        return MLP.from_state_dict(state, env, history=history, notes=notes)

    def policy(self, env: Any, history: int, notes: Mapping[str, str] | None = None) -> MLP:
        """`network`, checked.

        Raises
        ------
        RuntimeError
            Its actions are not the actor's.
        """
        policy = self.network(history, env, notes)
        size = policy.sizes[0] // history
        rows = np.random.default_rng(0).normal(size=(256, history * size), scale=1.0 / GAIN).astype(np.float32)
        with torch.no_grad():
            expected = self(torch.from_numpy(rows)).clamp(-1.0, 1.0).numpy()
        past, now = np.split(rows, [(history - 1) * size], axis=1)
        check_actions(policy.predict(now, past if history > 1 else None)[0], expected)
        return policy

    def load(self, policy: MLP) -> None:
        """Load the weights of a policy with layers of the same sizes.

        Raises
        ------
        ValueError
            The policy has other layers, another activation, or normalises observations.
        """
        data = policy.native.to_bytes()
        start = 8 + int.from_bytes(data[:8], "little")
        header = json.loads(data[8:start])
        form = json.loads(header["__metadata__"]["uvms_gym"])
        own = [layer for layer in self.layers if isinstance(layer, nn.Linear)]
        sizes = [own[0].in_features, *(layer.out_features for layer in own)]
        wanted = {"sizes": sizes, "activation": "tanh", "output": "clip", "normalisation": None}
        for name, value in wanted.items():
            if form[name] != value:
                raise ValueError(f"the policy's {name} is {form[name]}, but must be {value}")
        for i, layer in enumerate(own):
            for part, target in (("weight", layer.weight), ("bias", layer.bias)):
                begin, end = header[f"layers.{i}.{part}"]["data_offsets"]
                array = np.frombuffer(data[start + begin : start + end], dtype="<f4").reshape(target.shape)
                with torch.no_grad():
                    target.copy_(torch.from_numpy(array.astype(np.float32)))
        with torch.no_grad():
            own[0].weight.div_(GAIN)


class Critic(nn.Module):
    """Value of perfect observations (n, d).

    Its inputs are the observations and their squares: values are even functions of small errors, to which tanh is
    linear. Without squares it explains nothing of the returns' variance, with them a quarter after a million steps.
    """

    def __init__(self, size: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.layers = layers([2 * size, *hidden, 1], 0.1)

    def forward(self, observations: Tensor) -> Tensor:
        """Values (n,)."""
        scaled = (observations * GAIN).clamp(-_BOUND, _BOUND)
        values: Tensor = self.layers(torch.cat([scaled, 0.5 * scaled**2], dim=-1)).squeeze(-1)
        return values
