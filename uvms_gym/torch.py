"""The step in torch: a function of tensors with gradients; needs `torch`.

```python
import torch
from uvms_gym import Simulator
from uvms_gym.torch import state, step

sim = Simulator("bluerov2-heavy", num_envs=8)
thrust = torch.zeros(8, 8, dtype=torch.float64, requires_grad=True)
x = state(sim)
for _ in range(20):
    x = step(sim, x, {"thrust": thrust}, substeps=5)
x[:, :3].square().sum().backward()
```
"""

from collections.abc import Mapping
from typing import Any

from uvms_gym import _step
from uvms_gym._core import Simulator
from uvms_gym._extras import extra

with extra("train"):
    import torch
    from torch.autograd.function import once_differentiable


def state(simulator: Simulator) -> torch.Tensor:
    """Present states for `step`.

    Returns
    -------
    torch.Tensor (N, 13 + 2n) or (N, 13 + 2n + m)
        Position (3), m; quaternion [w, x, y, z] (4); q (n); absolute body twist (6); q' (n); thrusts (m) of thrusters
        with dynamics, N.
    """
    return torch.from_numpy(_step.state(simulator))


def step(
    simulator: Simulator,
    state: torch.Tensor,
    inputs: Mapping[str, torch.Tensor] | None = None,
    *,
    parameters: Mapping[str, torch.Tensor] | None = None,
    substeps: int = 1,
) -> torch.Tensor:
    """Step all instances from `state`; a function of tensors with gradients by all of them.

    Derivatives come from `Simulator.step_vjp`, once differentiable. The simulator is working memory and stays as it
    is; it gives the water's velocity. Each call stores a checkpoint until it has been differentiated
    (`Simulator.__getstate__`, about 1 kB per instance). Tensors are shared with NumPy's arrays, not copied.

    Parameters
    ----------
    simulator : Simulator
        With an integrator that has derivatives of steps; of either dtype.
    state : torch.Tensor (N, 13 + 2n [+ m])
        See `state`. Quaternions of any length; twists of a fixed vehicle are ignored.
    inputs : dict of torch.Tensor
        Inputs of `Simulator.step`, of one instance or of all (leading N): thrust (m,), wrench (6,), joint_torque (n,),
        joint_target (n, k <= 4), external (n + 1, 6), fin (k,), and pose_target (7,), position and quaternion.
    parameters : dict of torch.Tensor () or (N,)
        Factors on parameters, see `Simulator.scale_parameters`.
    substeps : int
        Number of steps of `dt`.

    Returns
    -------
    torch.Tensor
        Next states, in the layout of `state`; quaternions are continuous.

    Raises
    ------
    TypeError, ValueError
        A tensor is none, is not on the CPU, is not of dtype float64 or has the wrong shape; an input or parameter is
        unknown; the simulator has no derivatives of steps.
    """
    inputs, parameters = inputs or {}, parameters or {}
    call = _step.call_of(simulator, inputs, parameters, substeps)
    given = zip(call.arguments, (state, *inputs.values(), *parameters.values()), strict=True)
    next_state: torch.Tensor = _Step.apply(call, *(_checked(name, value, simulator) for name, value in given))
    return next_state


def _checked(name: str, value: object, simulator: Simulator) -> torch.Tensor:
    if not isinstance(value, torch.Tensor):
        raise TypeError(f"{name} must be a torch.Tensor, but is {type(value).__name__}")
    if value.device.type != "cpu":
        raise ValueError(f"{name} is on device {value.device}, but must be on the CPU")
    if value.dtype != torch.float64:
        raise ValueError(f"{name} has dtype {value.dtype}, but must have torch.float64")
    return value.expand(_step.shape_of(name, value.shape, simulator))


class _Step(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, call: _step.Call, *tensors: torch.Tensor) -> torch.Tensor:
        end, ctx.checkpoint = _step.run(call, [tensor.detach().numpy() for tensor in tensors])
        ctx.call, result = call, torch.from_numpy(end)
        ctx.save_for_backward(*tensors, result)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, cotangent: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        *values, end = (tensor.detach().numpy() for tensor in ctx.saved_tensors)
        gradients = _step.pull_back(ctx.call, values, end, ctx.checkpoint, cotangent.numpy())
        return None, *map(torch.from_numpy, gradients)
