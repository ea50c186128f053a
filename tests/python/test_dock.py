"""Docking as Python sees it: motion of a floating dock, metrics, the classical controller, parity.

Contact with a cradle is in `test_dock_cradle.py`.
"""

import gymnasium as gym
import numpy as np
import pytest
from helpers import assert_parity, run

import uvms_gym
from uvms_gym import DockPD
from uvms_gym.envs import DockEnv, DockVectorEnv

ENV = "UVMS-Dock-v0"
ARM, BARE = "bluerov2-heavy-alpha5", "bluerov2-heavy"
OWN = ("docked", "time_to_dock", "approach_speed", "contact_force", "peak_force", "impulse", "reward_docking")
WAVES = {"waves": {"height": 1.0, "period": [5.0, 6.0], "depth": 3.0, "trains": 2}}
CALM = {"max_current": 0.0}


def test_docking_adds_its_own_metrics():
    assert set(DockEnv().metric_names) - set(gym.make("UVMS-StationKeep-v0").unwrapped.metric_names) == set(OWN)


def still(env, steps=60):
    """Poses of the dock and its velocities by the observations, of a vehicle without control."""
    layout = {block.name: block for block in env.layout}
    envs, seen = env, []
    observations, _ = envs.reset(seed=5)
    for _ in range(steps):
        state, episode = envs.snapshot(), envs.episode
        linear, angular = (
            observations[0, layout[name].offset :][:3] * layout[name].scale[0]
            for name in ("relative_velocity", "relative_angular_velocity")
        )
        rotation = state.rotation[0]
        velocity = rotation @ (state.twist[0, :3] - linear), rotation @ (state.twist[0, 3:] - angular)
        seen.append((episode["target_position"][0], episode["target_rotation"][0], *velocity))
        observations = envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))[0]
    return [np.array(part) for part in zip(*seen, strict=True)]


def test_the_dock_moves_with_the_waves_as_the_relative_velocity_says():
    period = 0.02
    position, rotation, velocity, angular = still(
        DockVectorEnv(1, scene=BARE, dock="floating", disturbance=WAVES, dt=0.01, substeps=2, dock_tilt=1.0), 300
    )
    change = (position[2:] - position[:-2]) / (2.0 * period)
    np.testing.assert_allclose(change, velocity[1:-1], atol=2e-4)
    skew = (rotation[2:] - rotation[:-2]) / (2.0 * period) @ rotation[1:-1].transpose(0, 2, 1)
    turning = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    np.testing.assert_allclose(turning, angular[1:-1], atol=2e-4)
    # Half the water's motion: within half the amplitude of both trains, and not still.
    reach = np.linalg.norm(position, axis=1).max()
    assert 0.05 < reach < 0.5 * 1.0 and np.abs(angular).max() > 1e-3


def test_the_dock_stands_still_without_waves():
    for disturbance in (None, "gusts", {"base": "storm", "waves": None}):
        position, rotation, velocity, angular = still(
            DockVectorEnv(1, scene=BARE, dock="floating", disturbance=disturbance), 20
        )
        assert not position.any() and (rotation == np.eye(3)).all()
        if disturbance != {"base": "storm", "waves": None}:  # whose sensors have noise
            np.testing.assert_allclose(velocity, 0.0, atol=1e-6)
            np.testing.assert_allclose(angular, 0.0, atol=1e-6)


def test_without_amplitude_the_dock_stands_still_in_waves():
    options = {"dock": "floating", "disturbance": WAVES, "dock_sway": 0.0, "dock_heave": 0.0, "dock_tilt": 0.0}
    position, *_ = still(DockVectorEnv(1, scene=BARE, **options), 20)
    assert not position.any()


def test_the_vector_environment_is_the_single_one_with_a_moving_arm():
    arguments = {"scene": ARM, "dock": "floating", "dtype": "float32", "disturbance": "storm", "arm": "moving"}
    envs = DockVectorEnv(3, max_episode_steps=25, **arguments)
    assert_parity(envs, lambda: gym.wrappers.TimeLimit(DockEnv(**arguments), 25), 60)


def test_joints_stay_at_home_unless_the_arm_moves():
    rates = {}
    for arm in ("stowed", "moving"):
        envs = DockVectorEnv(4, scene=ARM, arm=arm)
        envs.reset(seed=0)
        for _ in range(100):
            envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))
        rates[arm] = np.abs(envs.episode["joint_reference_rate"]).max()
    assert rates["stowed"] == 0.0 < 0.02 < rates["moving"]


def dockings(scene, episodes=64, steps=400, **options):
    """Final metrics of episodes under the classical controller."""
    envs = DockVectorEnv(episodes, scene=scene, **options)
    stats = run(envs, DockPD(envs), steps, seed=100)
    assert not stats.terminated.any()
    return stats.last


@pytest.mark.parametrize("dock", ["cradle", "floating"])
@pytest.mark.parametrize("scene", ["petasus-pum", ARM, BARE, "rexrov"])
def test_the_classical_controller_docks_in_calm_water(scene, dock):
    last = dockings(scene, dock=dock, **CALM)
    assert last["success"].mean() >= 0.95
    docked = last["success"] == 1.0
    assert (last["time_to_dock"][docked] < 20.0 + 1e-9).all()
    # The limit is 0.5 m/s; near the dock the PD slows down.
    assert (last["approach_speed"][docked] > 0.02).all() and (last["approach_speed"] < 0.6).all()


@pytest.mark.parametrize(
    ("dock", "disturbance", "minimum"),
    [("floating", "waves", 0.9), ("floating", "storm", 0.5), ("cradle", "waves", 0.9), ("cradle", "storm", 0.6)],
)
def test_the_classical_controller_docks_in_waves(dock, disturbance, minimum):
    last = dockings("petasus-pum", 128, dock=dock, disturbance=disturbance)
    assert last["success"].mean() >= minimum


def test_metrics_keep_their_laws_under_the_controller():
    envs = DockVectorEnv(16, scene=BARE, dock="floating", autoreset_mode="Disabled", disturbance="waves")
    observations, infos = envs.reset(seed=3)
    controller, period, hold = DockPD(envs), 1.0 / envs.metadata["render_fps"], np.zeros(16)
    layout = {block.name: block for block in envs.layout}
    velocity = layout["relative_velocity"]
    before, success = np.zeros(16), np.zeros(16)
    for step in range(1, 380):
        observations, _, _, _, infos = envs.step(controller.predict(observations)[0])
        speed = np.linalg.norm(observations[:, velocity.offset :][:, :3] * velocity.scale[0], axis=1)
        holds = (infos["position_error"] < 0.1) & (infos["attitude_error"] < 0.15) & (speed < 0.1 + 1e-6)
        hold = np.where(holds, hold + period, 0.0)
        assert (hold[infos["docked"] == 1.0] > 2.0 - 1e-9).all()
        time = infos["time_to_dock"]
        np.testing.assert_allclose(time, np.where(success == 1.0, before, step * period), rtol=1e-12)
        success = np.maximum(success, infos["docked"])
        np.testing.assert_array_equal(infos["success"], success)
        before = time.copy()
    assert success.mean() > 0.5


def test_success_ends_the_episode_on_request():
    envs = DockVectorEnv(8, scene=BARE, terminate_on_success=True, **CALM)
    stats = run(envs, DockPD(envs), 400, seed=1)
    ended = stats.terminated
    assert ended.any()
    np.testing.assert_array_equal(stats.last["success"] == 1.0, ended)
    np.testing.assert_array_equal(stats.last["docked"][ended], 1.0)
    assert (stats.last["diverged"] == 0.0).all()


def test_the_dock_is_drawn():
    env = gym.make(ENV, scene=BARE, dock="floating", render_mode="rgb_array", start_distance=2.5)
    env.reset(seed=0, options={"position": [-2.0, 0.0, 0.0]})
    first = env.render()
    env.reset(seed=0, options={"position": [-2.0, 0.0, 0.0], "target_position": [0.5, 0.5, 0.0]})
    assert first.shape == (480, 640, 3) and (first != env.render()).any()
    np.testing.assert_array_equal(env.unwrapped.episode["target_position"], [[0.5, 0.5, 0.0]])


def test_controllers_by_name():
    env = gym.make(ENV, scene=BARE)
    assert isinstance(uvms_gym.make_controller("dock-pd", env), DockPD)
    with pytest.raises(ValueError, match="not for UVMS-Dock; for it: none, "):
        uvms_gym.make_controller("pd", env)
