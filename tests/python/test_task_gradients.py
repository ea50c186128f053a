"""Jacobians of a control period against central differences of the environment."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from uvms_gym._core import task_defaults

N, STEPS = 3, 4
#: Change of an action, exact in single precision beside the actions.
CHANGE = 2.0**-9
SCENES = ("petasus-pum", "bluerov2-heavy", "bluerov2-heavy-alpha5", "rexrov")
LATE = {"delay": {"periods": 1}}


def prepared(env: str, **kwargs: Any) -> tuple[Any, np.ndarray, np.ndarray]:
    """Instances some steps into their episodes, their observations, and actions for the next step."""
    envs: Any = gymnasium.make_vec(env, num_envs=N, **kwargs).unwrapped
    observations, _ = envs.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(STEPS):
        observations, *_ = envs.step(0.6 * rng.uniform(-1.0, 1.0, envs.action_space.shape))
    # Away from 0, where the limits of thrusters change.
    actions = rng.choice([-1.0, 1.0], envs.action_space.shape) * rng.uniform(0.1, 0.5, envs.action_space.shape)
    actions = np.round(actions * 4096.0) / 4096.0
    return envs, observations, actions


def total(envs: Any, observations: np.ndarray, actions: np.ndarray) -> dict[str, np.ndarray]:
    """Derivatives of observation and reward by the action: derivatives of the task times derivatives of the physics."""
    task, forces = envs.jacobians(actions, observations), envs.forces(actions, observations)
    sim, m = envs.snapshot(), envs.snapshot().thruster_limits.shape[0]
    inputs: dict[str, Any] = {"thrust": forces[:, :m]}
    if forces.shape[1] > m:
        inputs["joint_torque"] = forces[:, m:]
    elif sim.num_joints:
        inputs["joint_target"] = envs._native.forces(envs._native.frames()[1], 0.0 * actions)[1].reshape(N, -1, 4)
    physics = sim.step_jacobians(**inputs, substeps=envs.options.substeps)
    state_by_force = np.concatenate([physics[name] for name in ("thrust", "joint_torque") if name in physics], axis=2)
    state = state_by_force[:, : 12 + 2 * sim.num_joints] @ task["force"]["action"]
    return {name: task[name]["action"] + task[name]["state"] @ state for name in ("observation", "reward")}


def differences(envs: Any, actions: np.ndarray) -> dict[str, np.ndarray]:
    """Central differences of observation and reward between steps from the same state."""
    start, columns = envs.get_state(), []
    for k in range(actions.shape[1]):
        ends = []
        for change in (CHANGE, -CHANGE):
            envs.set_state(start)
            observations, rewards, *_ = envs.step(actions + change * np.eye(actions.shape[1])[k])
            ends.append(np.concatenate([observations.astype(float), rewards[:, None]], axis=1))
        columns.append((ends[0] - ends[1]) / (2.0 * CHANGE))
    envs.set_state(start)
    found = np.stack(columns, axis=-1)
    return {"observation": found[:, :-1], "reward": found[:, -1:]}


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", ["wrench", "thrusters", "residual"])
@pytest.mark.parametrize("env", ["UVMS-StationKeep-v0", "UVMS-EETrack-v0", "UVMS-Dock-v0"])
def test_jacobians_of_a_period_match_differences_between_steps(env: str, action: str, scene: str) -> None:
    thruster_lag = 0.1 if scene == "rexrov" else None
    disturbance = LATE if scene == "bluerov2-heavy" else None
    envs, observations, actions = prepared(
        env, action=action, scene=scene, thruster_lag=thruster_lag, disturbance=disturbance, max_current=0.0
    )
    found, wanted = total(envs, observations, actions), differences(envs, actions)
    for name, bound in (("reward", 1e-3), ("observation", 5e-3)):
        np.testing.assert_allclose(found[name], wanted[name], atol=bound * np.abs(wanted[name]).max(), err_msg=name)


def test_the_memory_of_a_period_carries_integral_and_previous_action() -> None:
    envs, _, actions = prepared("UVMS-Dock-v0", scene="bluerov2-heavy")
    found, a = envs.jacobians(actions), 6
    change = found["reward"]["memory"][:, 0, :a]
    previous = envs.episode["action"]
    weight = task_defaults("dock")["reward"]["action_rate"] / a
    np.testing.assert_allclose(change, 2.0 * weight * (actions - previous), atol=1e-6)
    keep = np.exp(-0.1 * envs._native.control_period)
    integral = found["memory"]["memory"][:, a + 4 : a + 10, a + 4 : a + 10]
    np.testing.assert_allclose(integral, np.broadcast_to(keep * np.eye(6), integral.shape), atol=1e-12)


def test_late_measurements_are_inputs_of_their_own() -> None:
    now, _, actions = prepared("UVMS-EETrack-v0")
    late, _, _ = prepared("UVMS-EETrack-v0", disturbance=LATE)
    (one, other), width = (envs.jacobians(actions)["observation"] for envs in (now, late)), 12
    assert not one["measurement"].any() and one["state"][:, :width].any()
    assert not other["state"][:, :width].any() and other["measurement"][:, :width].any()


@pytest.mark.parametrize("routine", ["forces", "jacobians"])
def test_forces_and_jacobians_need_an_episode_and_finite_actions(routine: str) -> None:
    envs: Any = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=N).unwrapped
    actions = np.zeros((N, 6), np.float32)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"instance 0 was never reset: call reset\(\) first"):
        getattr(envs, routine)(actions)
    envs.reset(seed=0)
    actions[1, 4] = np.nan
    with pytest.raises(ValueError, match="action 4 of instance 1 is NaN: must be finite"):
        getattr(envs, routine)(actions)


def test_wrong_frames_are_refused() -> None:
    envs, _, actions = prepared("UVMS-StationKeep-v0", action="residual")
    with pytest.raises(ValueError, match="give its observations"):
        envs.jacobians(actions)
    native, rows = envs._native, envs._native.frames()[1]
    with pytest.raises(ValueError, match="memories has 3 numbers, but must have"):
        native.forces(rows[:, :1], actions)
    with pytest.raises(ValueError, match="cotangents has 3 numbers, but must have"):
        native.act_vjp(rows, actions, np.zeros((N, 1)))
