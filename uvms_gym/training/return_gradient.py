"""Gradient of the discounted return by recorded actions, through simulator, observation and policy. [Xu22], [Hee15]

Episodes run in the task's environment with all its disturbances. Cotangents go backwards along their recorded states by
the adjoint of a simulator with the drawn parameters, which knows neither current nor lost thrusters. In calm water the
gradient is that of the environment, in the storm it has a cosine of 0.98 with it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from uvms_gym import Simulator
from uvms_gym.envs import TaskVectorEnv
from uvms_gym.training.episodes import Episodes
from uvms_gym.training.networks import GAIN, Actor
from uvms_gym.training.station_gradient import StationKeeping
from uvms_gym.training.task_gradient import TaskGradient
from uvms_gym.training.tracking_gradient import EndEffectorTracking

Floats = NDArray[np.float64]

#: Maximum gradient of an episode's window over the median: near divergence gradients grow without bound.
OUTLYING = 3.0
#: Tasks with derivatives.
TASKS: dict[str, type[TaskGradient]] = {"station-keep": StationKeeping, "ee-track": EndEffectorTracking}
#: Maximum step of the simulator, s, by a linearly implicit method.
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
    ages: Tensor
    """Age of measurements of each episode, control periods (b,)."""
    factors: Tensor
    """Drawn factors on each episode's parameters (b, k), those of `ReturnGradient.factors`."""
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
        Price of joint coordinates away from home.

    Raises
    ------
    ValueError
        The environment has a task without derivatives, or actions other than wrenches.
    """

    def __init__(self, envs: TaskVectorEnv, rows: int, gamma: float, posture: float = 0.0) -> None:
        if envs.task not in TASKS:
            raise ValueError(f"gradients of the return are known for {' and '.join(TASKS)}, not for {envs.task}")
        self.task, self.gamma = TASKS[envs.task](envs, posture), gamma
        self.substeps = int(np.ceil(self.task.period / STEP - 1e-9))
        scene, dt = envs._native.scene, self.task.period / self.substeps
        self.simulator = Simulator(scene, rows, dt=dt, integrator="ros2", threads=1)
        self._names = tuple(self.simulator.parameters)

    def __call__(self, windows: Windows, pull: Callable[[int, Tensor], Tensor]) -> Tensor:
        """Gradients (H, b, a) of the returns from each action on.

        Parameters
        ----------
        windows : Windows
        pull : callable
            Cotangent (b, h d) of the policy's input at step t from that of its action (b, a).
        """
        task, perfect = self.task, windows.perfect.numpy().astype(float)
        parts, width, m = task.parts, len(task.scale), task.thrusters
        raw, on = windows.actions.numpy().astype(float), windows.alive.numpy()[..., None]
        (steps, rows, _), size = raw.shape, perfect.shape[-1]
        history, ages, every = windows.inputs.shape[-1] // size, windows.ages.numpy(), np.arange(rows)
        clipped, before = np.clip(raw, -1.0, 1.0), perfect[:-1, :, parts["previous_action"]]
        # Cotangents are of the return from the first step on.
        weight = self.gamma ** np.arange(steps + 1.0)[:, None, None]
        forces, by_action = task.forces(clipped)
        by_force, by_change = weight[:-1] * task.by_force(forces), weight[:-1] * task.by_change(clipped - before)
        states, (by_motion, by_coordinates) = task.states(perfect), task.geometry(perfect)
        if self.simulator.state_size > 12 + 2 * task.joints:
            # Thrusters with dynamics: derivatives hardly depend on the thrusts, which are not observed.
            states["thrust"] = task.forces(before)[0][..., :m]
        on_measured = np.zeros((steps + 1, rows, width))
        on_measured[1:, :, :6] = weight[:-1] * task.by_pose(perfect[1:])
        on_measured[1:, :, task.coordinates] += weight[:-1] * task.by_posture(perfect[1:])
        on_integral = np.zeros((rows, 6))
        # Observations from before the windows have rows, too.
        on_observation = np.zeros((steps + history, rows, size), dtype=np.float32)
        on_reference = np.zeros_like(perfect[0, :, task.reference])
        if windows.by_end is not None:
            by_end = weight[-1] * on[-1] * windows.by_end.numpy()
            on_measured[-1] += by_end[:, :width]
            on_measured[-1, :, :6] += task.ahead(by_end)
            on_reference += by_end[:, task.reference]
            for name in ("previous_action", "error_integral"):
                on_observation[-1, :, parts[name]] = by_end[:, parts[name]]
        gradient, on_previous, on_state = np.empty_like(raw), 0.0, np.zeros((rows, self.simulator.state_size))
        self.simulator.scale_parameters(**dict(zip(self._names, windows.factors.numpy().T, strict=True)))
        for t in reversed(range(steps)):
            seen = on_observation[t + history].astype(float)
            on_integral += seen[:, parts["error_integral"]]
            known = ages <= t + 1
            of = (t + 1 - ages[known], every[known])
            measured = seen[:, :width]
            measured[:, :6] += task.ahead(seen) + task.gain * on_integral
            on_measured[of] += measured[known]
            on_integral *= task.keep
            on_reference += seen[:, task.reference]
            on_pose = np.concatenate([on_measured[t + 1, :, :6], on_reference], axis=-1)
            on_reference[:] = 0.0
            on_motion = on_pose[:, None, :] @ by_motion[t + 1]
            on_state[:, : 6 + task.joints] += (on_motion @ by_coordinates[t + 1])[:, 0]
            task.measure(on_measured[t + 1], perfect[t + 1], on_state)
            state = {name: values[t] for name, values in states.items()}
            self.simulator.set_state(**state)
            found = self.simulator.step_vjp(on_state * on[t], substeps=self.substeps, **task.inputs(forces[t], state))
            on_state, on_force = found["state"], by_force[t]
            on_force[:, :m] += found["thrust"]
            if "joint_torque" in found:
                on_force[:, m:] += found["joint_torque"]
            on_action = np.einsum("bf,bfa->ba", on_force, by_action[t]) + by_change[t] + on_previous
            on_action += seen[:, parts["previous_action"]]
            # Beyond the limits only a way back counts.
            on_action *= ((np.abs(raw[t]) < 1.0) | (on_action * raw[t] < 0.0)) & on[t]
            on_previous = -by_change[t] * on[t]
            gradient[t] = on_action / weight[t]
            if t > 0:
                stack = pull(t, torch.from_numpy(on_action.astype(np.float32))).numpy()
                on_observation[t : t + history] += stack.reshape(rows, history, size).transpose(1, 0, 2)
        size = np.nan_to_num(np.linalg.norm(gradient, axis=(0, 2)), nan=np.inf)
        gradient *= np.minimum(1.0, OUTLYING * np.median(size) / np.maximum(size, 1e-30))[:, None]
        return torch.from_numpy(np.nan_to_num(gradient).astype(np.float32))

    def factors(self, envs: TaskVectorEnv) -> Tensor:
        """Factors (n, k) on the parameters of all instances, as drawn for their episodes."""
        drawn = envs.snapshot().parameters
        return torch.from_numpy(np.stack([drawn[name] for name in self._names], axis=-1))

    def ages(self, episodes: Episodes) -> Tensor:
        """Ages of measurements (n,), control periods: those at which perfect observations come closest to them."""
        (minimum, most), steps = self.task.ages, episodes.alive.shape[1]
        width, first = len(self.task.scale), min(most, steps - 1)
        seen = episodes.observations[:, episodes.history - 1 + first :, :width]
        alive, distances = episodes.alive[:, first:, None], []
        for age in range(minimum, most + 1):
            past = max(first - age, 0)
            apart = (seen - episodes.perfect[:, past : past + seen.shape[1], :width]) * alive
            distances.append(apart.square().sum(dim=(1, 2)))
        return minimum + torch.stack(distances).argmin(dim=0)


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
