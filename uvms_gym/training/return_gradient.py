"""Gradient of the discounted return by recorded actions, through simulator, task and policy. [Xu22], [Hee15]

Episodes run in the task's environment with all its disturbances. Cotangents go backwards along their recorded frames:
through observation, reward and forces by the derivatives of the task's kernels, through the physics by the adjoint of
a simulator with the drawn parameters and the recorded current, which knows neither pushes nor lost thrusters. In calm
water the gradient equals the environment's, in the storm it has a cosine of 0.98 with it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uvms_gym import Simulator
from uvms_gym._core import Task
from uvms_gym._task.jacobians import base_actions, base_vjp
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.networks import Actor

Floats = NDArray[np.float64]

#: Maximum gradient of an episode's window over the median: near divergence gradients grow without bound.
OUTLYING = 3.0
#: Maximum step of the simulator, s, by a linearly implicit method.
STEP = 0.1
#: Actions are differentiated just within their bounds, where clipping has not set in.
WITHIN = 1.0 - 1e-6


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
    states: Tensor
    """States of the frames (H + 1, b, .)."""
    memories: Tensor
    """Memories of the frames (H + 1, b, .)."""
    factors: Tensor
    """Drawn factors on each episode's parameters (b, k): see `ReturnGradient.factors`."""
    by_end: Tensor | None = None
    """Gradient of the value beyond the last step by the last perfect observations (b, d)."""


class ReturnGradient:
    """Gradient of a task's discounted return by actions.

    Parameters
    ----------
    envs : TaskVectorEnv
        Environment of the episodes.
    rows : int
        Number of episodes b in windows.
    gamma : float
        Discount of a control period.
    posture : float
        Price of joint coordinates away from home, on top of the task's reward.
    """

    def __init__(self, envs: TaskVectorEnv, rows: int, gamma: float, posture: float = 0.0) -> None:
        options: Any = envs.options
        # A task of its own: another thread may collect episodes of the environment.
        arguments, keywords = envs._native.__getnewargs_ex__()
        self.native = Task(*arguments, **{**keywords, "num_envs": 1})
        self.gamma, self.posture = gamma, posture
        self.residual = options.action == "residual"
        period = self.native.control_period
        self.substeps = int(np.ceil(period / STEP - 1e-9))
        self.simulator = Simulator(self.native.scene, rows, dt=period / self.substeps, integrator="ros2", threads=1)
        self.limits = np.asarray(self.simulator.thruster_limits)
        #: Number of joint coordinates, those of fixtures included.
        self.joints = self.simulator.num_joints
        blocks = {block.name: block for block in envs.layout}
        #: Entries of joint coordinates in an observation, and their scales.
        self.coordinates, self.scale = slice(0, 0), np.zeros(0)
        #: Number of the robot's joints.
        self.driven = 0
        if "joint_position" in blocks:
            block = blocks["joint_position"]
            self.coordinates, self.scale, self.driven = block.slice, np.array(block.scale), len(block.scale)
        self._names = tuple(self.simulator.parameters)

    def posture_costs(self, perfect: Tensor) -> Tensor:
        """Costs (..., T) of postures after each step, from perfect observations (..., T + 1, d)."""
        return self.posture * perfect[..., 1:, self.coordinates].square().sum(dim=-1)

    def __call__(self, windows: Windows, pull: Callable[[int, Tensor], Tensor]) -> Tensor:
        """Gradients (H, b, a) of the returns from each action on.

        Parameters
        ----------
        windows : Windows
        pull : callable
            Cotangent (b, h d) of the policy's input at step t from the cotangent of its action (b, a).
        """
        native, (s, w, c, d, a, _) = self.native, self.native.gradient_widths
        states, memories, raw = windows.states.numpy(), windows.memories.numpy(), windows.actions.numpy().astype(float)
        on, (steps, rows, _) = windows.alive.numpy()[..., None], raw.shape
        # The last row of a memory is the age of measurements, where they are late.
        ages = memories[..., -1].astype(int) if native.late else np.zeros(memories.shape[:2], int)
        every, history = np.arange(rows), windows.inputs.shape[-1] // d
        clipped, observed = np.clip(raw, -WITHIN, WITHIN), windows.inputs[..., -d:].numpy()
        base: Any = [None] * steps
        if self.residual:
            base = base_actions(native, observed.reshape(-1, d)).reshape(raw.shape)
        frames = [x.reshape(-1, x.shape[-1]) for x in (memories[:-1], clipped, *([base] if self.residual else []))]
        forces, targets = (x.reshape(steps, rows, -1) for x in native.forces(*frames))
        # Cotangents, of the return from the first step on, of each frame: observation, reward, measurement, memory.
        weight = self.gamma ** np.arange(steps + 1.0)[:, None, None]
        # Observations from before the windows have rows, too.
        given = np.zeros((steps + history, rows, d + 1 + w + c))
        on_observation, on_measurement = given[..., :d], given[history - 1 :, :, d + 1 : d + 1 + w]
        given[history:, :, d] = (weight[:-1] * on)[..., 0]
        postures = windows.perfect[1:, :, self.coordinates].numpy()
        on_measurement[1:, :, 12 : 12 + self.driven] = -2.0 * self.posture * weight[:-1] * on * postures / self.scale
        if windows.by_end is not None:
            on_observation[-1] = weight[-1] * on[-1] * windows.by_end.numpy()
        gradient, on_memory = np.empty_like(raw), np.zeros((rows, c))
        on_state = np.zeros((rows, self.simulator.state_size))
        self.simulator.scale_parameters(**dict(zip(self._names, windows.factors.numpy().T, strict=True)))
        for t in reversed(range(steps)):
            # The critic sees the last observation.
            given[t + history, :, d + 1 + w :] = on_memory
            last, age = t + 1 == steps, ages[t + 1]
            fresh = (age == 0).tolist()
            found = native.evaluate_vjp(
                states[t + 1, :, : s + 6], memories[t + 1], memories[t], fresh, given[t + history], perfect=last
            )
            on_state[:, :s] += found[:, :s]
            known = (age > 0) & (age <= t + 1)
            on_measurement[t + 1 - age[known], every[known]] += found[known, s : s + w]
            # An ended episode may have left a state that is none.
            state = np.where(on[t], states[t], states[0])
            inputs = self._set_state(state, states[t + 1, :, s + 6 : s + 12], forces[t], targets[t])
            stepped = self.simulator.step_vjp(on_state * on[t], substeps=self.substeps, **inputs)
            on_state = stepped["state"]
            on_force = np.concatenate([stepped[name] for name in ("thrust", "joint_torque") if name in stepped], axis=1)
            on_force = on_force[:, : forces.shape[-1]]
            on_acted = np.concatenate([on_force, found[:, s + w :]], axis=1) * on[t]
            acted = native.act_vjp(memories[t], clipped[t], on_acted, base[t])
            on_action, on_base, on_memory = acted[:, :a], acted[:, a : 2 * a], acted[:, 2 * a :]
            # Beyond the limits only a way back counts.
            on_action = on_action * ((np.abs(raw[t]) < 1.0) | (on_action * raw[t] < 0.0))
            gradient[t] = on_action / weight[t]
            if t > 0:
                stack = pull(t, torch.from_numpy(on_action.astype(np.float32))).numpy()
                on_observation[t : t + history] += stack.reshape(rows, history, d).transpose(1, 0, 2)
                if self.residual:
                    on_observation[t + history - 1] += base_vjp(native, observed[t], on_base)
        size = np.nan_to_num(np.linalg.norm(gradient, axis=(0, 2)), nan=np.inf)
        gradient *= np.minimum(1.0, OUTLYING * np.median(size) / np.maximum(size, 1e-30))[:, None]
        return torch.from_numpy(np.nan_to_num(gradient).astype(np.float32))

    def _set_state(self, state: Floats, flow: Floats, forces: Floats, targets: Floats) -> dict[str, Any]:
        """Set the simulator to states and flow; returns inputs of the step."""
        n, m, simulator = self.joints, len(self.limits), self.simulator
        more: dict[str, Any] = {"q": state[:, 18 : 18 + n], "qd": state[:, 18 + n : 18 + 2 * n]} if n else {}
        if simulator.state_size > 12 + 2 * n:
            more["thrust"] = np.clip(state[:, -m:], *self.limits.T)
        simulator.set_state(
            rotation=state[:, :9].reshape(-1, 3, 3),
            position=state[:, 9:12],
            twist=state[:, 12:18],
            current=flow[:, :3],
            current_acceleration=flow[:, 3:],
            **more,
        )
        inputs: dict[str, Any] = {"thrust": forces[:, :m]}
        fixtures = n - self.driven
        if forces.shape[1] > m:
            inputs["joint_torque"] = np.pad(forces[:, m:], [(0, 0), (0, fixtures)])
        elif n:
            inputs["joint_target"] = np.pad(targets.reshape(len(state), -1, 4), [(0, 0), (0, fixtures), (0, 0)])
        return inputs

    def factors(self, envs: TaskVectorEnv) -> Tensor:
        """Factors (n, k) on the parameters of all instances, as drawn for their episodes."""
        drawn = envs.snapshot().parameters
        return torch.from_numpy(np.stack([drawn[name] for name in self._names], axis=-1))


def forward(actor: Actor, inputs: Tensor) -> tuple[Tensor, Callable[[int, Tensor], Tensor]]:
    """Mean actions (H, b, a) for inputs (H, b, h d), and the pull-back from actions to inputs at a step."""
    linears = actor.linears
    weights = [actor.first_weight(), *(layer.weight for layer in linears[1:])]
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
