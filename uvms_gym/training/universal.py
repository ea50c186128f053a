"""Policy for any vehicle in torch, and its gradients on one of the drawn vehicles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import linear, pad

from uvms_gym import MLP
from uvms_gym.controllers.plant import FEATURES, SEEN, Floats, Plant, stack_shares
from uvms_gym.controllers.universal import UniversalPolicy, Weights, fold, weights
from uvms_gym.training.episodes import Episodes
from uvms_gym.training.networks import Tanh
from uvms_gym.training.return_gradient import ReturnGradient, Windows


@dataclass(frozen=True)
class Sizes:
    """Sizes of the policy."""

    spans: tuple[int, ...] = (16, 8, 4, 2, 1, 1, 1, 1)
    """Number of successive observations in each average, oldest first."""
    axis_units: int = 20
    """Units of each axis in the first layer."""
    axis_hidden: int = 16
    """Units of each axis in the second layer."""
    shared_units: int = 40
    """Units of the first layer that see all axes."""
    experts: int = 8
    """Number of sets of weights that are mixed by an axis's features."""
    mix_units: int = 24
    """Units between features and mixture."""


class UniversalNet(nn.Module):
    """Policy for any vehicle with its parameters as tensors, at random: the first expert is the mean policy."""

    def __init__(self, sizes: Sizes, seed: int) -> None:
        super().__init__()
        generator = torch.Generator().manual_seed(seed)

        def normal(*shape: int, inputs: int, gain: float = 1.0) -> Tensor:
            return torch.randn(shape, generator=generator) * (gain / math.sqrt(inputs))

        self.spans = sizes.spans
        s, f, p, e = len(sizes.spans), len(SEEN), len(FEATURES), sizes.experts
        k, n, m, h = sizes.axis_units, sizes.axis_hidden, sizes.shared_units, sizes.mix_units
        first = torch.zeros(e)
        first[0] = 1.0
        share = 0.5 + 0.5 * first
        given = {
            "mix_in": normal(h, p, inputs=p),
            "mix_bias": torch.zeros(h),
            "mix_out": normal(e, h, inputs=h),
            "mix_offset": first,
            "scale_in": torch.zeros(f, p),
            "scale_out": torch.zeros(p),
            "axis_in": normal(e, k, s, f, inputs=s * f) * share[:, None, None, None],
            "axis_hidden": normal(e, n, k, inputs=k) * share[:, None, None],
            "out": normal(e, n, inputs=n, gain=0.2) * share[:, None],
            "shared_in": normal(m, s, f, 6, inputs=6 * s * f),
            "shared_bias": normal(m, 6, p, inputs=6 * p, gain=0.3),
            "shared_hidden": normal(6, n, m, inputs=m, gain=0.1),
        }
        self.given = nn.ParameterDict({name: nn.Parameter(value) for name, value in given.items()})

    def weights(self, features: Tensor) -> Weights:
        """Weights for a vehicle with features (6, p)."""
        return weights(torch, dict(self.given.items()), features)

    def arrays(self) -> dict[str, Any]:
        """Parameters as arrays in double precision."""
        return {name: value.detach().double().numpy() for name, value in self.given.items()}

    def network(self, at: Plant, env: Any) -> MLP:
        """The policy for one vehicle."""
        layers, biases = fold(self.arrays(), self.spans, at)
        return MLP(env, weights=layers, biases=biases, history=sum(self.spans))

    def policy(self, limits: Floats, notes: Mapping[str, str]) -> UniversalPolicy:
        """Policy without torch; see `UniversalPolicy`."""
        arrays = {name: value.detach().numpy().copy() for name, value in self.given.items()}
        return UniversalPolicy(arrays, self.spans, limits, notes)

    def load(self, policy: UniversalPolicy) -> None:
        """Load a policy of the same sizes; one with fewer averages has no weights on the older ones.

        Raises
        ------
        ValueError
            The policy has other sizes, or its averages are not the last ones here.
        """
        if self.spans[-len(policy.spans) :] != policy.spans:
            raise ValueError(f"the policy's averages are {policy.spans}, but must be the last of {self.spans}")
        older = len(self.spans) - len(policy.spans)
        by_average = {"axis_in": 2, "shared_in": 1}
        for name, target in self.given.items():
            array = torch.from_numpy(np.array(policy.parameters[name]))
            if name in by_average:
                # Zeros for the older averages.
                array = pad(array, (0, 0) * (array.dim() - 1 - by_average[name]) + (older, 0))
            if array.shape != target.shape:
                raise ValueError(
                    f"the policy's {name} has shape {tuple(array.shape)}, but must have {tuple(target.shape)}"
                )
            with torch.no_grad():
                target.copy_(array)


def forward(own: Weights, seen: Tensor) -> tuple[Tensor, Callable[[slice, Tensor], Tensor]]:
    """Accelerations (n, 6) by averages (n, s, f, 6), and the pull-back from those of some rows to their averages."""
    tanh, (axes, k, s, f) = Tanh(), own.axis_in.shape
    (m, *_), hidden_units = own.shared_in.shape, own.axis_hidden.shape[1]
    flat = seen.reshape(-1, s * f * axes)
    by_axis = flat.view(-1, s * f, axes).permute(2, 0, 1)
    axis_in, shared_in = own.axis_in.reshape(axes, k, s * f), own.shared_in.reshape(m, -1)
    shared_hidden = own.shared_hidden.reshape(axes * hidden_units, m)
    first = tanh(torch.bmm(by_axis, axis_in.transpose(1, 2)))
    shared = tanh(linear(flat, shared_in, own.shared_bias))
    coupled = linear(shared, shared_hidden).view(-1, axes, hidden_units).permute(1, 0, 2)
    hidden = tanh(torch.bmm(first, own.axis_hidden.transpose(1, 2)) + coupled)
    out = torch.bmm(hidden, own.out[:, :, None])[:, :, 0].T
    on_first, on_shared, on_hidden = (1.0 - x.detach() ** 2 for x in (first, shared, hidden))
    axis_in, shared_in, shared_hidden = axis_in.detach(), shared_in.detach(), shared_hidden.detach()
    axis_hidden, last = own.axis_hidden.detach(), own.out.detach()

    def pull(rows: slice, cotangent: Tensor) -> Tensor:
        at_hidden = cotangent.T[:, :, None] * last[:, None, :] * on_hidden[:, rows]
        at_first = torch.bmm(at_hidden, axis_hidden) * on_first[:, rows]
        at_shared = (at_hidden.permute(1, 0, 2).reshape(-1, axes * hidden_units) @ shared_hidden) * on_shared[rows]
        found: Tensor = torch.bmm(at_first, axis_in).permute(1, 2, 0).reshape(-1, s, f, axes)
        found += (at_shared @ shared_in).view(-1, s, f, axes)
        return found

    return out, pull


def averages(observations: Tensor, at: Plant, spans: Sequence[int]) -> Tensor:
    """Averages (n, T, s, f, 6) of the seen quantities of stacked observations (n, h - 1 + T, d) at every step."""
    seen = torch.from_numpy(at.seen.astype(np.float32))
    rows = torch.einsum("ntd,fid->ntfi", observations, seen).double()
    total = pad(rows.cumsum(dim=1), (0, 0, 0, 0, 1, 0))
    steps, ends = rows.shape[1] - sum(spans) + 1, np.cumsum(spans).tolist()
    parts = [
        (total[:, end : end + steps] - total[:, end - span : end - span + steps]) / span
        for span, end in zip(spans, ends, strict=True)
    ]
    return torch.stack(parts, dim=2).float()


@dataclass(frozen=True)
class ActionGradient:
    """Gradient of the return by a policy's actions over windows of a vehicle's episodes."""

    actions: Tensor
    """Actions (H, b, 6) with their dependence on the parameters."""
    gradient: Tensor
    """Gradients (H, b, 6) of the return from each action on."""
    size: float
    """Root mean square of the gradients by accelerations."""

    def backward(self, weight: float) -> None:
        """Add to the parameters' gradients those of the negative mean return, by a weight."""
        loss = (self.gradient * self.actions).sum() * (-weight / self.actions[..., 0].numel())
        loss.backward()  # type: ignore[no-untyped-call]


def action_gradient(
    net: UniversalNet,
    at: Plant,
    by_return: ReturnGradient,
    episodes: Episodes,
    factors: Tensor,
    seen: Tensor,
    windows: tuple[Tensor, Tensor],
    horizon: int,
) -> ActionGradient:
    """Gradient of the return by the actions of a policy.

    Parameters
    ----------
    net : UniversalNet
    at : Plant
        Vehicle.
    by_return : ReturnGradient
    episodes : Episodes
        Episodes with frames.
    factors : Tensor (n, k)
        Drawn factors of their parameters.
    seen : Tensor (n, T, s, f, 6)
        As `averages` has them.
    windows : (b,), (b,)
        Instances and first steps of windows.
    horizon : int
        Steps H of a window.
    """
    assert episodes.states is not None and episodes.memories is not None
    instances, first = windows
    steps = first + torch.arange(horizon + 1)[:, None]
    now, rows = steps[:-1], len(first)
    acted, features = (torch.from_numpy(x.astype(np.float32)) for x in (at.acted, at.features))
    per_entry = torch.from_numpy(at.seen.astype(np.float32)).flatten(0, 1)
    shares = torch.from_numpy(stack_shares(net.spans).astype(np.float32))
    out, pull = forward(net.weights(features), seen[instances, now].flatten(0, 1))

    def back(t: int, cotangent: Tensor) -> Tensor:
        by_average = pull(slice(t * rows, (t + 1) * rows), cotangent @ acted).flatten(2) @ per_entry
        return (by_average.transpose(1, 2) @ shares).transpose(1, 2).flatten(1)

    taken = Windows(
        # Only their number is asked for.
        inputs=torch.zeros(1).expand(horizon, rows, episodes.history * episodes.observations.shape[-1]),
        perfect=episodes.perfect[instances, steps],
        actions=episodes.actions[instances, now],
        alive=episodes.alive[instances, now],
        states=episodes.states[instances, steps],
        memories=episodes.memories[instances, steps],
        factors=factors[instances],
    )
    with torch.no_grad():
        gradient = by_return(taken, back)
        size = float((gradient @ acted).square().mean().sqrt())
    return ActionGradient((out @ acted.T).view(horizon, rows, -1), gradient, size)
