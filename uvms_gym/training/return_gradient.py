"""Gradient of the discounted return by recorded actions, through simulator, observation and policy. [Xu22], [Hee15]

Episodes run in the task's environment with all its disturbances. Cotangents go backwards along their recorded states by
the adjoint of the nominal simulator, which knows neither current nor payload nor the drawn parameters. In calm water
the gradient is that of the environment, in the storm it has a cosine of 0.98 with it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uvms_gym import Simulator
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.networks import GAIN, Actor
from uvms_gym.training.task_gradient import StationKeeping

Floats = NDArray[np.float64]

#: Greatest step of the nominal simulator, s, by a linearly implicit method.
STEP = 0.1


@dataclass(frozen=True)
class Windows:
    """H successive steps of b episodes, time first."""

    inputs: Tensor
    """Inputs of the policy (H, b, h d)."""
    perfect: Tensor
    """Perfect observations (H + 1, b, d)."""
    actions: Tensor
    """Actions (H, b, a), not clipped."""
    alive: Tensor
    """True for steps up to the end of the episode (H, b)."""
    by_end: Tensor | None = None
    """Gradient of the value beyond the last step by the last perfect observations (b, d)."""


class ReturnGradient:
    """Gradient of the discounted return of station keeping by actions.

    Parameters
    ----------
    envs : TaskVectorEnv
        Environment of the episodes.
    rows : int
        Number of episodes b in windows.
    gamma : float
        Discount of a control period.

    Raises
    ------
    ValueError
        The environment has another task, or actions other than wrenches.
    """

    def __init__(self, envs: TaskVectorEnv, rows: int, gamma: float) -> None:
        self.task, self.gamma = StationKeeping(envs), gamma
        self.substeps = int(np.ceil(self.task.period / STEP - 1e-9))
        scene, dt = envs._native.scene, self.task.period / self.substeps
        self.simulator = Simulator(scene, rows, dt=dt, integrator="ros2", threads=1)
        self._home = self.simulator.q

    def __call__(self, windows: Windows, pull: Callable[[int, Tensor], Tensor]) -> Tensor:
        """Gradients (H, b, a) of the returns from each action on.

        Parameters
        ----------
        windows : Windows
        pull : callable
            Cotangent (b, h d) of the policy's input at step t from that of its action (b, a).
        """
        task, perfect = self.task, windows.perfect.numpy().astype(float)
        parts, delay, width = task.parts, task.delay, len(task.scale)
        raw, on = windows.actions.numpy().astype(float), windows.alive.numpy()[..., None]
        (steps, rows, _), size = raw.shape, perfect.shape[-1]
        history = windows.inputs.shape[-1] // size
        clipped, before = np.clip(raw, -1.0, 1.0), perfect[:-1, :, parts["previous_action"]]
        # Cotangents are of the return from the first step on.
        weight = self.gamma ** np.arange(steps + 1.0)[:, None, None]
        thrusts, by_action = task.thrusts(clipped)
        by_thrust, by_change = weight[:-1] * task.by_thrust(thrusts), weight[:-1] * task.by_change(clipped - before)
        states, jacobians = self._states(perfect)
        if self.simulator.state_size > 12 + 2 * task.joints:
            # Thrusters with dynamics: derivatives hardly depend on the thrusts, which are not observed.
            states["thrust"] = task.thrusts(before)[0]
        on_measured = np.zeros((steps + 1, rows, width))
        on_measured[1:, :, :6] = weight[:-1] * task.by_pose(perfect[1:])
        on_integral = np.zeros((rows, 6))
        # Observations from before the windows have rows, too.
        on_observation = np.zeros((steps + history, rows, size), dtype=np.float32)
        if windows.by_end is not None:
            by_end = weight[-1] * on[-1] * windows.by_end.numpy()
            on_measured[-1] += by_end[:, :width]
            on_observation[-1, :, width:] = by_end[:, width:]
        gradient, on_previous, on_state = np.empty_like(raw), 0.0, np.zeros((rows, self.simulator.state_size))
        for t in reversed(range(steps)):
            seen = on_observation[t + history]
            on_integral += seen[:, parts["error_integral"]]
            if t + 1 >= delay:
                on_measured[t + 1 - delay] += seen[:, :width]
                on_measured[t + 1 - delay, :, :6] += task.gain * on_integral
            on_integral *= task.keep
            self._measure(on_measured[t + 1], jacobians[t + 1], on_state)
            self.simulator.set_state(**{name: values[t] for name, values in states.items()})
            found = self.simulator.step_vjp(
                on_state * on[t], thrust=thrusts[t], substeps=self.substeps, **self._hold(states, t)
            )
            on_state, on_thrust = found["state"], found["thrust"] + by_thrust[t]
            on_action = np.einsum("bm,bma->ba", on_thrust, by_action[t]) + by_change[t] + on_previous
            on_action += seen[:, parts["previous_action"]]
            # Beyond the limits only a way back counts.
            on_action *= ((np.abs(raw[t]) < 1.0) | (on_action * raw[t] < 0.0)) & on[t]
            on_previous = -by_change[t] * on[t]
            gradient[t] = on_action / weight[t]
            if t > 0:
                stack = pull(t, torch.from_numpy(on_action.astype(np.float32))).numpy()
                on_observation[t : t + history] += stack.reshape(rows, history, size).transpose(1, 0, 2)
        return torch.from_numpy(gradient.astype(np.float32))

    def _states(self, perfect: Floats) -> tuple[dict[str, Floats], Floats]:
        """Arguments of `Simulator.set_state`, with the target at the origin, and Jacobians of observed pose errors."""
        n, scaled = self.task.joints, perfect[..., : len(self.task.scale)] * self.task.scale
        position, quaternion, jacobians = self.task.poses(perfect)
        states = {"position": position, "quaternion": quaternion, "twist": scaled[..., 6:12]}
        if n:
            states |= {"q": self._home + scaled[..., 12 : 12 + n], "qd": scaled[..., 12 + n :]}
        return states, jacobians

    def _hold(self, states: dict[str, Floats], t: int) -> dict[str, Any]:
        """Targets of the joints: on with their rates."""
        return {"joint_target": np.stack([states["q"][t], states["qd"][t]], axis=-1)} if self.task.joints else {}

    def _measure(self, on_measured: Floats, jacobian: Floats, on_state: Floats) -> None:
        """Add the cotangent of a state (b, s) from that of its measured entries (b, 12 + 2n)."""
        n, physical = self.task.joints, on_measured / self.task.scale
        on_state[:, :6] += np.einsum("bi,bij->bj", on_measured[:, :6], jacobian)
        on_state[:, 6 : 6 + n] += physical[:, 12 : 12 + n]
        on_state[:, 6 + n : 12 + n] += physical[:, 6:12]
        on_state[:, 12 + n : 12 + 2 * n] += physical[:, 12 + n :]


def forward(actor: Actor, inputs: Tensor) -> tuple[Tensor, Callable[[int, Tensor], Tensor]]:
    """Mean actions (H, b, a) for inputs (H, b, h d), and the pull-back from actions to inputs at a step."""
    linears = [layer for layer in actor.layers if isinstance(layer, nn.Linear)]
    weights = [layer.weight * (GAIN if layer is linears[0] else 1.0) for layer in linears]
    slopes, x = [], inputs
    for weight, layer in zip(weights[:-1], linears, strict=False):
        x = actor.layers[1](nn.functional.linear(x, weight, layer.bias))
        slopes.append(1.0 - x.detach() ** 2)
    mean = nn.functional.linear(x, weights[-1], linears[-1].bias)
    first, *others = (weight.detach() for weight in weights)

    def pull(t: int, cotangent: Tensor) -> Tensor:
        for weight, slope in zip(reversed(others), reversed(slopes), strict=True):
            cotangent = (cotangent @ weight) * slope[t]
        return cotangent @ first

    return mean, pull
