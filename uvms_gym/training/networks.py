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

    The first layer sees averages of successive observations: long memories need few weights.

    Parameters
    ----------
    spans : sequence of int
        Number of observations in each average, oldest first; h in all.
    sizes : sequence of int
        Entries d of an observation, hidden layers, actions.
    log_std : float
        Logarithm of the initial standard deviation.
    """

    def __init__(self, spans: Sequence[int], sizes: Sequence[int], log_std: float = 0.0) -> None:
        super().__init__()
        self.layers = layers([len(spans) * sizes[0], *sizes[1:]], 0.1)
        self.log_std = nn.Parameter(torch.full((sizes[-1],), log_std))
        self.spans = tuple(spans)
        #: Average that each observation belongs to, and its share there.
        self._of = torch.repeat_interleave(torch.arange(len(spans)), torch.tensor(spans))
        self._shares = 1.0 / torch.tensor(spans)[self._of]

    @property
    def linears(self) -> list[nn.Linear]:
        """Layers with weights."""
        return [layer for layer in self.layers if isinstance(layer, nn.Linear)]

    def first_weight(self) -> Tensor:
        """Weights (k, h d) of the first layer on the stacked observations."""
        weight = self.linears[0].weight * GAIN
        if len(self.spans) == len(self._of):
            return weight
        by_average = weight.view(len(weight), len(self.spans), -1)
        whole: Tensor = by_average[:, self._of] * self._shares[:, None]
        return whole.flatten(1)

    def forward(self, inputs: Tensor) -> Tensor:
        """Mean of the action."""
        # Weights are fewer than inputs.
        mean: Tensor = self.layers[1:](linear(inputs, self.first_weight(), self.linears[0].bias))
        return mean

    def log_prob(self, mean: Tensor, actions: Tensor) -> Tensor:
        """Logarithm of the density of actions, up to a constant."""
        scaled = (actions - mean) * torch.exp(-self.log_std)
        return -(0.5 * scaled**2 + self.log_std).sum(dim=-1)

    def network(self, env: Any = None, notes: Mapping[str, str] | None = None) -> MLP:
        """Policy without torch, of the mean action."""
        state = {name: array.detach().numpy() for name, array in self.layers.state_dict().items()}
        state["0.weight"] = self.first_weight().detach().numpy()
        return MLP.from_state_dict(state, env, history=len(self._of), notes=notes)

    def policy(self, env: Any, notes: Mapping[str, str] | None = None) -> MLP:
        """`network`, checked.

        Raises
        ------
        RuntimeError
            Its actions are not the actor's.
        """
        policy, history = self.network(env, notes), len(self._of)
        size = policy.sizes[0] // history
        rows = np.random.default_rng(0).normal(size=(256, history * size), scale=1.0 / GAIN).astype(np.float32)
        with torch.no_grad():
            expected = self(torch.from_numpy(rows)).clamp(-1.0, 1.0).numpy()
        past, now = np.split(rows, [(history - 1) * size], axis=1)
        check_actions(policy.predict(now, past if history > 1 else None)[0], expected)
        return policy

    def load(self, policy: MLP) -> None:
        """Load the weights of a policy with layers of the same sizes; one with a shorter history has none further back.

        Raises
        ------
        ValueError
            The policy has other layers, a longer history, another activation, or normalises observations.
        """
        data = policy.native.to_bytes()
        start = 8 + int.from_bytes(data[:8], "little")
        header = json.loads(data[8:start])
        form = json.loads(header["__metadata__"]["uvms_gym"])
        own, total = self.linears, len(self._of)
        size = own[0].in_features // len(self.spans)
        if policy.history > total:
            raise ValueError(f"the policy's frame_stack is {policy.history}, but must be at most {total}")
        sizes = [policy.history * size, *(layer.out_features for layer in own)]
        wanted = {"sizes": sizes, "activation": "tanh", "output": "clip", "normalisation": None}
        for name, value in wanted.items():
            if form[name] != value:
                raise ValueError(f"the policy's {name} is {form[name]}, but must be {value}")
        for i, layer in enumerate(own):
            for part, target in (("weight", layer.weight), ("bias", layer.bias)):
                begin, end = header[f"layers.{i}.{part}"]["data_offsets"]
                array = np.frombuffer(data[start + begin : start + end], dtype="<f4").astype(np.float32)
                given = torch.from_numpy(array).view(len(target), -1)
                if (i, part) == (0, "weight"):
                    recent = given.view(len(target), policy.history, size) / GAIN
                    by_average = torch.zeros(len(target), len(self.spans), size)
                    given = by_average.index_add(1, self._of[total - policy.history :], recent)
                with torch.no_grad():
                    target.copy_(given.view(target.shape))


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
