"""Contract of Gymnasium for single environments, for every id."""

import copy
import json
import pickle
import sys
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils import seeding
from helpers import LEAVING, control_rate, fake_moviepy, idle, other_than, same, scenes_with_thrusters, small, task_ids

import uvms_gym

TASKS = task_ids()
pytestmark = pytest.mark.parametrize("task", TASKS)


def make(task, **kwargs):
    """The environment with Gymnasium's wrappers."""
    return gym.make(task, **{"scene": small(task), **kwargs})


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
    # 20 s.
    assert spec.max_episode_steps == 20.0 * control_rate(task)
    json.dumps(spec.kwargs)


@pytest.mark.parametrize("kind", ["json", "pickle"])
def test_specs_survive(task, kind):
    env = make(task, action="thrusters", reward={"pose": 0.2}, substeps=2, max_episode_steps=3)
    survive = {
        "json": lambda spec: EnvSpec.from_json(spec.to_json()),
        "pickle": lambda s: pickle.loads(pickle.dumps(s)),
    }
    other = gym.make(survive[kind](env.spec))
    assert same(other.reset(seed=1), env.reset(seed=1))
    for _ in range(3):
        got, expected = other.step(idle(env)), env.step(idle(env))
        assert same(got, expected)
    assert got[3] is True


def test_stable_baselines3_does_not_take_it_for_a_goal_environment(task):
    assert not hasattr(bare(task), "compute_reward")
    assert not hasattr(gym.make_vec(task), "compute_reward")


# Values


def test_results_are_the_callers_own(task):
    env = make(task)
    results = [env.reset(seed=0), *(env.step(idle(env)) for _ in range(3)), env.reset()]
    for i, result in enumerate(results):
        assert result[0].flags.writeable
        for before in results[:i]:
            assert not np.shares_memory(result[0], before[0])
            assert result[-1] is not before[-1]
    # What a caller writes does not come back.
    one, other = make(task), make(task)
    for env in (one, other):
        env.reset(seed=0)
    for k in range(4):
        got, expected = one.step(other_than(k, one)), other.step(other_than(k, other))
        assert same(got, expected)
        got[0][:] = 7.0
        got[-1].clear()


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


def test_observations_lie_in_their_space_to_the_end(task):
    env = make(task, max_episode_steps=None)
    observation, _ = env.reset(seed=0, options=LEAVING)
    terminated = False
    for _ in range(30):
        assert observation in env.observation_space
        if terminated:
            break
        observation, _, terminated, _, _ = env.step(np.sign(other_than(0, env)))
    assert terminated


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


CONTROLLERS = {"StationKeep": uvms_gym.PD, "EETrack": uvms_gym.ResolvedMotion, "Dock": uvms_gym.DockPD}


def test_observations_are_of_order_one(task):
    for scene in scenes_with_thrusters():
        # Untuned controllers do not stand every delay.
        envs = gym.make_vec(task, 32, scene=scene, max_episode_steps=None, dt=0.01, substeps=5, thruster_lag=None)
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


def test_without_a_seed_the_operating_system_gives_one(task):
    assert not same(*(bare(task).reset()[0] for _ in range(2)))
    env = bare(task)
    first, _ = env.reset()
    assert same(bare(task).reset(seed=env.np_random_seed)[0], first)


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
        np.testing.assert_array_equal(getattr(simulator, name), [options[name]])
    np.testing.assert_allclose(simulator.quaternion, [options["attitude"]], atol=1e-15)
    np.testing.assert_array_equal(episode["current"], [options["current"]])
    if "EETrack" not in task:  # whose reference starts at home
        np.testing.assert_array_equal(episode["target_position"], [options["target_position"]])
    assert (info["current_x"], info["current_y"], info["current_z"]) == (0.0, 0.2, 0.0)
    if "StationKeep" in task:
        assert info["position_error"] == pytest.approx(0.5)
        assert info["attitude_error"] == pytest.approx(0.0, abs=1e-7)


# Step


def test_a_step_before_the_first_reset_is_refused(task):
    for env in (make(task), bare(task)):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            env.step(idle(env))


def test_divergence_terminates_and_wants_a_reset(task):
    env = bare(task)
    env.reset(seed=0, options=LEAVING)
    ends = [env.step(idle(env))[2:4]]
    while not ends[-1][0]:
        ends.append(env.step(idle(env))[2:4])
        assert len(ends) < 30
    assert ends[-1] == (True, False)
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        env.step(idle(env))
    env.reset()
    env.step(idle(env))


def test_a_time_out_is_a_truncation_by_gymnasium(task):
    env = make(task, max_episode_steps=3)
    env.reset(seed=0)
    assert [env.step(idle(env))[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]
    inner = bare(task, substeps=1)
    inner.reset(seed=0)
    assert not any(inner.step(idle(inner))[3] for _ in range(420))


BAD = [
    ("nan", lambda a: np.where(np.arange(a.size) == 0, np.nan, a)),
    ("inf", lambda a: np.where(np.arange(a.size) == a.size - 1, np.inf, a)),
    ("-inf", lambda a: np.full(a.size, -np.inf, np.float32)),
    ("short", lambda a: a[:-1]),
    ("long", lambda a: np.append(a, 0.0)),
    ("deep", lambda a: a[None]),
    ("scalar", lambda a: np.float32(0.0)),
    ("text", lambda a: a.astype(str)),
    ("complex", lambda a: a.astype(complex)),
    ("none", lambda a: None),
    ("ragged", lambda a: [1.0, [2.0]]),
    ("masked", lambda a: np.ma.array(a, mask=a == a)),
]


@pytest.mark.parametrize(("name", "spoil"), BAD, ids=[name for name, _ in BAD])
def test_bad_actions_are_refused_and_change_nothing(task, name, spoil):
    env = bare(task)
    env.reset(seed=0)
    env.step(other_than(0, env))
    before = env.get_state()
    with pytest.raises(ValueError, match=r"^action") as refused:
        env.step(spoil(idle(env)))
    assert name in ("nan", "inf", "-inf", "masked") or str(env.action_space.shape) in str(refused.value)
    # One error, not one on top of another.
    assert refused.value.__context__ is None or refused.value.__suppress_context__
    assert same(env.get_state(), before)


def test_actions_are_read_wherever_they_lie(task):
    action = other_than(2, bare(task))
    frozen = action.copy()
    frozen.flags.writeable = False
    apart = np.full((len(action), 2), np.nan, dtype=np.float32)
    apart[:, 0] = action
    odd = np.frombuffer(b"\0" + action.tobytes(), dtype=np.float32, offset=1)
    assert not odd.flags.aligned
    results = []
    for one in (action, frozen, apart[:, 0], action[::-1].copy()[::-1], odd):
        env = bare(task)
        env.reset(seed=0)
        results.append(env.step(one))
    assert all(same(result, results[0]) for result in results)


@pytest.mark.parametrize("dtype", [np.float64, np.float16, np.int64, np.uint8])
def test_actions_of_any_real_type_are_clipped(task, dtype):
    one, other = bare(task), bare(task)
    one.reset(seed=0)
    other.reset(seed=0)
    wild = np.abs(other_than(1, one, 4.0)).astype(dtype)
    wild[:3] = 0, 1, 100
    if dtype is np.float64:
        wild[:2] = 1e300, -1e300
    assert same(one.step(wild), other.step(np.clip(wild.astype(np.float64), -1.0, 1.0).astype(np.float32)))


# State


def copies(env, task):
    """The environment as it stands, in all ways that there are."""
    yield copy.deepcopy(env)
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        yield pickle.loads(pickle.dumps(env, protocol))
    fresh = make(task)
    fresh.reset()
    fresh.unwrapped.set_state(env.unwrapped.get_state())
    yield fresh


def test_copies_in_mid_episode_go_on_alike(task):
    env = make(task)
    env.reset(seed=11)
    for k in range(4):
        env.step(other_than(k, env))
    others = list(copies(env, task))
    for k in range(8):
        expected = env.step(other_than(k, env))
        for other in others:
            assert same(other.step(other_than(k, env)), expected)
    expected = env.reset()
    for other in others:
        assert same(other.reset(), expected), "the stream of episodes goes on alike, too"


def test_copies_do_not_touch_each_other(task):
    env = make(task)
    env.reset(seed=11)
    state = env.unwrapped.get_state()
    others = list(copies(env, task))
    for other in others:
        other.step(np.ones(env.action_space.shape))
    assert same(env.unwrapped.get_state(), state)


def test_a_state_is_a_copy(task):
    env = bare(task)
    env.reset(seed=0)
    state = env.get_state()
    kept = copy.deepcopy(state)
    for part in state.values():
        part[:] = np.nan
    assert same(env.get_state(), kept)


# Rendering


def test_frame_rate_is_that_of_control(task):
    one, other, third = bare(task), make(task, substeps=1), make(task, dt=0.02, substeps=1)
    dt = one.unwrapped.options.dt
    assert [env.metadata["render_fps"] for env in (one, other, third)] == [control_rate(task), 1.0 / dt, 50.0]
    assert type(one).metadata["render_fps"] == 20.0


def test_rendering_without_a_mode_warns(task):
    env = bare(task)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render mode"):
        assert env.render() is None


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
