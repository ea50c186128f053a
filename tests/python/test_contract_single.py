"""Contract of Gymnasium for single environments, for every id."""

import copy
import json
import sys
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils import seeding
from helpers import LEAVING, control_rate, fake_moviepy, idle, make, other_than, same, scenes_with_thrusters, task_ids

import uvms_gym

pytestmark = pytest.mark.parametrize("task", task_ids())


def bare(task, **kwargs):
    return make(task, **kwargs).unwrapped


# Registration


def test_ids_lead_to_the_environment(task):
    kind = type(bare(task))
    assert task.endswith("-v0")
    assert type(gym.make(f"uvms_gym:{task}").unwrapped) is kind
    with pytest.warns(UserWarning, match="latest versioned environment"):
        assert type(gym.make(task.removesuffix("-v0")).unwrapped) is kind


def test_specs_are_plain_data(task):
    spec = gym.spec(task)
    assert isinstance(spec.entry_point, str)
    assert isinstance(spec.vector_entry_point, str)
    assert spec.additional_wrappers == ()
    # 20 s, for a valve 40 s.
    assert spec.max_episode_steps == (40.0 if "Valve" in task else 20.0) * control_rate(task)
    json.dumps(spec.kwargs)


def test_stable_baselines3_does_not_take_it_for_a_goal_environment(task):
    assert not hasattr(bare(task), "compute_reward")
    assert not hasattr(gym.make_vec(task), "compute_reward")


# Values


def test_an_action_is_not_kept(task):
    one, other = make(task), make(task)
    one.reset(seed=0)
    other.reset(seed=0)
    action = other_than(0, one)
    for k in range(3):
        action[:] = other_than(k, one)
        expected = other.step(action.copy())
        got = one.step(action)
        assert same(action, other_than(k, one))
        action[:] = 1.0
        assert same(got, expected)


def test_results_are_of_pythons_own_types(task):
    env = make(task)
    _, info = env.reset(seed=0)
    _, reward, terminated, truncated, later = env.step(idle(env))
    assert type(reward) is float
    assert type(terminated) is bool
    assert type(truncated) is bool
    assert {type(value) for value in [*info.values(), *later.values()]} <= {float, int, bool, str}
    assert info.keys() == later.keys()


def test_spaces_are_finite_float32_boxes(task):
    for scene in scenes_with_thrusters():
        env = bare(task, scene=scene)
        for space in (env.observation_space, env.action_space):
            assert isinstance(space, gym.spaces.Box)
            assert space.dtype == np.float32
            assert np.isfinite(space.low).all()
            assert np.isfinite(space.high).all()
            assert (space.low < space.high).all()
        assert (env.action_space.low == -1.0).all()
        assert (env.action_space.high == 1.0).all()


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_observations_are_clipped_to_their_bounds_not_beyond(task, dtype):
    env = bare(task, dtype=dtype, disturbance=None)
    high = env.observation_space.high
    # A torrent: in no time it is faster than what is shown.
    options = {**LEAVING, "twist": [9.9999, 0, 0, 0, 0, 0], "current": [40.0, 0, 0]}
    observation, _ = env.reset(seed=0, options=options)
    assert observation in env.observation_space
    observation, _, terminated, _, _ = env.step(idle(env))
    assert terminated
    assert observation in env.observation_space
    assert (np.abs(observation) == high).any(), "nothing was clipped, so this shows nothing"


CONTROLLERS = {"StationKeep": uvms_gym.PD, "Dock": uvms_gym.DockPD, "": uvms_gym.ResolvedMotion}


# An untuned controller bangs the tool on the panel, which is chaotic.
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_observations_are_of_order_one(task):
    # Untuned controllers do not stand every delay.
    substeps = 10 if "Button" in task or "Valve" in task else 5
    options = {"max_episode_steps": None, "dt": 0.05 / substeps, "substeps": substeps, "thruster_lag": None}
    for scene in scenes_with_thrusters():
        envs = gym.make_vec(task, 32, scene=scene, **options)
        observations, _ = envs.reset(seed=0)
        policy = next(kind for name, kind in CONTROLLERS.items() if name in task)(envs)
        seen = []
        for _ in range(100):
            observations, *_ = envs.step(policy.predict(observations)[0])
            seen.append(observations)
        for block in envs.layout:
            part = np.array(seen)[:, :, block.slice]
            size = np.sqrt(np.mean(part**2))
            assert size < 20.0, (scene, block.name, size)
            # Actions and directions are bounded by themselves.
            bound = np.max(np.array(block.high) / block.scale)
            assert block.name in ("previous_action", "up") or np.abs(part).max() < bound, block.name


# Reset


def test_seeds_decide_everything(task):
    one, other = bare(task), bare(task)
    for seed in (0, 1, 2**64 - 1, 2**130 + 7):
        assert same(one.reset(seed=seed), other.reset(seed=seed))
        assert same(one.reset(), other.reset())
        assert not same(one.reset()[0], one.reset()[0])
    assert not same(one.reset(seed=0)[0], one.reset(seed=1)[0])
    first = one.reset(seed=0)[0]
    for seed in (2**64, 2**65, 2**128):
        assert not same(one.reset(seed=seed)[0], first)


def test_a_reset_seeds_the_generator_of_gymnasium(task):
    env = bare(task)
    env.reset(seed=5)
    assert env.np_random_seed == 5
    assert env.np_random.bit_generator.state == seeding.np_random(5)[0].bit_generator.state
    before = env.np_random
    env.reset()
    assert env.np_random is before
    with pytest.raises(gym.error.Error):
        env.reset(seed=-1)


def test_options_set_state_target_and_current_and_stay_the_callers(task):
    env = bare(task, disturbance=None, scene="bluerov2-heavy-alpha5")
    half, n = np.sqrt(0.5), 4
    options = {"position": [0.3, -0.2, 0.1], "attitude": [half, 0, 0, half], "twist": [0.1, 0, 0, 0, 0, 0.1]}
    options |= {"q": [0.1] * n, "qd": [-0.1] * n, "current": [0.0, 0.2, 0.0]}
    options |= {"target_position": [0.3, -0.2, 0.6], "target_attitude": [half, 0, 0, half]}
    kept = copy.deepcopy(options)
    _, info = env.reset(seed=0, options=options)
    assert options == kept
    simulator, episode = env.snapshot(), env.episode
    for name in ("position", "twist", "q", "qd"):
        # Fixtures come behind the robot's joints.
        given = getattr(simulator, name)[:, : len(options[name])]
        np.testing.assert_array_equal(given, [options[name]])
    np.testing.assert_allclose(simulator.quaternion, [options["attitude"]], atol=1e-15)
    np.testing.assert_array_equal(episode["current"], [options["current"]])
    if "StationKeep" in task:  # whose target is neither a dock in the world nor a reference from home on
        np.testing.assert_array_equal(episode["target_position"], [options["target_position"]])
    assert (info["current_x"], info["current_y"], info["current_z"]) == (0.0, 0.2, 0.0)
    if "StationKeep" in task:
        assert info["position_error"] == pytest.approx(0.5)
        assert info["attitude_error"] == pytest.approx(0.0, abs=1e-7)


# Step


@pytest.mark.parametrize("thrust", [0.0, 1.0])
def test_divergence_terminates_within_the_space_and_wants_a_reset(task, thrust):
    env = bare(task)
    results = [(*env.reset(seed=0, options=LEAVING), False, False)]
    while not results[-1][2]:
        assert len(results) < 30
        results.append(env.step(thrust * np.sign(other_than(0, env))))
        assert not results[-1][3]
    assert all(result[0] in env.observation_space for result in results)
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        env.step(idle(env))
    env.reset()
    env.step(idle(env))


# State


def test_a_state_is_a_copy(task):
    env = bare(task)
    env.reset(seed=0)
    state = env.get_state()
    kept = copy.deepcopy(state)
    for part in state.values():
        part[:] = np.nan
    assert same(env.get_state(), kept)


# Rendering


def test_pictures_are_those_of_the_state(task):
    env = make(task, render_mode="rgb_array")
    env.reset(seed=0)
    frame = env.render()
    assert frame.dtype == np.uint8
    assert frame.shape == (480, 640, 3)
    assert same(env.render(), frame)
    env.unwrapped.render()[:] = 0
    assert same(env.render(), frame)
    other = make(task, render_mode="rgb_array")
    other.reset(seed=0)
    assert same(other.render(), frame)
    for _ in range(10):
        env.step(np.full(env.action_space.shape, 0.1))
    assert not same(env.render(), frame)


# Wrappers


def test_wrappers_of_actions_observations_and_statistics_work(task):
    env = make(task, max_episode_steps=5)
    env = gym.wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0))
    env = gym.wrappers.RecordEpisodeStatistics(env)
    env = gym.wrappers.NormalizeObservation(env)
    env = gym.wrappers.FrameStackObservation(env, 3)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (3, *make(task).observation_space.shape)
    total = 0.0
    for k in range(5):
        observation, reward, _, truncated, info = env.step(2.0 * other_than(k, env))
        total += reward
        assert np.isfinite(observation).all()
    assert truncated
    assert info["episode"]["r"] == pytest.approx(total)
    assert info["episode"]["l"] == 5


def test_a_rescaled_action_is_the_action(task):
    plain, scaled = make(task), gym.wrappers.RescaleAction(make(task), np.float32(-2.0), np.float32(2.0))
    plain.reset(seed=0)
    scaled.reset(seed=0)
    action = other_than(0, plain)
    np.testing.assert_allclose(scaled.step(2.0 * action)[0], plain.step(action)[0], rtol=1e-4, atol=1e-5)


def test_videos_are_recorded(task, tmp_path, monkeypatch):
    env = make(task, render_mode="rgb_array", max_episode_steps=4)
    clips = fake_moviepy(monkeypatch)
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "videos"), episode_trigger=lambda episode: episode == 0)
    env.reset(seed=0)
    for _ in range(4):
        env.step(idle(env))
    env.close()
    assert clips == [(5, (480, 640, 3), control_rate(task))]


def test_human_rendering_shows_the_pictures(task, monkeypatch):
    env = make(task, render_mode="rgb_array")
    # A window there is not everywhere.
    pygame = mock.MagicMock()
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    env = gym.wrappers.HumanRendering(env)
    env.reset(seed=0)
    env.step(idle(env))
    assert env.render() is None
    shown = [call.args[0] for call in pygame.surfarray.make_surface.call_args_list]
    assert len(shown) >= 2
    assert shown[0].shape == (640, 480, 3)
