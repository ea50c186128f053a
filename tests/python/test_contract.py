"""What Gymnasium and Stable-Baselines3 expect of the environments."""

import json
import os
import pickle
import signal
import threading
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from helpers import LEAVING, same

import uvms_gym  # noqa: F401 (registers)
from uvms_gym.envs.station_keep import INFO, StationKeepEnv, StationKeepVectorEnv

ENV = "UVMS-StationKeep-v0"
SMALL = "bluerov2-heavy"
ARM = "bluerov2-heavy-alpha5"
SCENES = ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"]
MODES = list(AutoresetMode)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", ["wrench", "thrusters"])
def test_environment_checkers_are_content(scene, action):
    from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

    env = gym.make(ENV, scene=scene, action=action)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)
        check_env_for_sb3(env)


def test_ids_lead_to_the_environment():
    assert gym.make(ENV).spec.max_episode_steps == 400
    assert isinstance(gym.make(f"uvms_gym:{ENV}").unwrapped, StationKeepEnv)
    with pytest.warns(UserWarning, match="latest versioned environment"):
        assert isinstance(gym.make("UVMS-StationKeep").unwrapped, StationKeepEnv)
    assert isinstance(gym.make_vec(ENV), StationKeepVectorEnv)
    assert isinstance(gym.make_vec(ENV, 2, vectorization_mode="sync"), SyncVectorEnv)


def test_asynchronous_vector_environment_works():
    envs = gym.make_vec(ENV, 2, vectorization_mode="async", scene=SMALL)
    native = gym.make_vec(ENV, 2, scene=SMALL)
    try:
        assert same(envs.reset(seed=1)[0], native.reset(seed=1)[0])
        actions = native.action_space.sample()
        assert same(envs.step(actions)[0], native.step(actions)[0])
    finally:
        envs.close()


def test_specs_survive_json_and_pickle():
    env = gym.make(ENV, scene=SMALL, action="thrusters", reward={"pose": 0.2})
    for spec in (EnvSpec.from_json(env.spec.to_json()), pickle.loads(pickle.dumps(env.spec))):
        assert same(gym.make(spec).reset(seed=1), env.reset(seed=1))
    envs = gym.make_vec(ENV, 3, scene=SMALL, autoreset_mode="SameStep", max_episode_steps=7)
    json.dumps(envs.spec.kwargs)
    for spec in (envs.spec, pickle.loads(pickle.dumps(envs.spec))):
        again = gym.make_vec(spec)
        assert (again.num_envs, again.metadata) == (3, envs.metadata)
        assert same(again.reset(seed=1), envs.reset(seed=1))


def test_metadata_belongs_to_the_instance():
    envs = StationKeepVectorEnv(2, scene=SMALL, dt=0.02, autoreset_mode="Disabled")
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    assert envs.metadata["render_fps"] == 10.0
    assert gym.make(ENV, scene=SMALL, dt=0.02).metadata["render_fps"] == 10.0
    assert StationKeepEnv(scene=SMALL).metadata["render_fps"] == 20.0
    with pytest.raises(ValueError, match="Later"):
        StationKeepVectorEnv(2, scene=SMALL, autoreset_mode="Later")


def test_seeds_decide_everything():
    one, other = StationKeepEnv(scene=SMALL), StationKeepEnv(scene=SMALL)
    big = 2**130 + 7
    for seed in (0, 1, 2**64 - 1, big):
        assert same(one.reset(seed=seed), other.reset(seed=seed))
        assert same(one.reset(), other.reset())
        assert not same(one.reset()[0], one.reset()[0])
    assert not same(one.reset(seed=0)[0], one.reset(seed=1)[0])
    fresh = [StationKeepEnv(scene=SMALL).reset()[0] for _ in range(2)]
    assert not same(*fresh), "without a seed, the operating system gives one"
    env = StationKeepEnv(scene=SMALL)
    first, _ = env.reset()
    assert same(StationKeepEnv(scene=SMALL).reset(seed=env.np_random_seed)[0], first)


def test_vector_seeds_are_those_of_singles():
    envs = StationKeepVectorEnv(3, scene=SMALL)
    observations, _ = envs.reset(seed=5)
    for i in range(3):
        assert same(StationKeepEnv(scene=SMALL).reset(seed=5 + i)[0], observations[i])
    assert same(envs.reset(seed=[5, 6, 7])[0], observations)
    assert same(envs.reset(seed=(5, np.int64(6), 7))[0], observations)
    mixed, _ = envs.reset(seed=[None, 6, None])
    assert same(mixed[1], observations[1])
    assert not same(mixed[0], observations[0])
    fresh = StationKeepVectorEnv(3, scene=SMALL)
    first, _ = fresh.reset()
    assert same(StationKeepVectorEnv(3, scene=SMALL).reset(seed=fresh.np_random_seed)[0], first)
    for seed in ([1, 2], [1, 2, -3]):
        with pytest.raises(ValueError, match="seed"):
            envs.reset(seed=seed)


def singles(num_envs, mode, **options):
    make = lambda: gym.make(ENV, max_episode_steps=4, **options)  # noqa: E731
    return SyncVectorEnv([make] * num_envs, autoreset_mode=mode)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("num_envs", "threads", "options"),
    [
        (1, None, {"scene": ARM}),
        (2, 2, {"scene": ARM, "dtype": "float32"}),
        (7, 1, {"scene": SMALL, "action": "thrusters"}),
        (8, 3, {"scene": SMALL, "integrator": "rk4-normalise"}),
        (9, 2, {"scene": "petasus-pum"}),
        (64, 2, {"scene": SMALL}),
    ],
)
def test_native_is_a_sync_vector_of_singles(mode, num_envs, threads, options):
    options = {**options, "substeps": 2}
    native = gym.make_vec(ENV, num_envs, autoreset_mode=mode, threads=threads, max_episode_steps=4, **options)
    sync = singles(num_envs, mode, **options)
    assert native.metadata == sync.metadata
    assert native.observation_space == sync.observation_space
    assert native.action_space == sync.action_space
    native.action_space.seed(0)
    assert same(native.reset(seed=3), sync.reset(seed=3))
    over = np.zeros(num_envs, dtype=np.bool_)
    for step in range(14):
        if mode is AutoresetMode.DISABLED and over.any():
            options = {"reset_mask": over}
            assert same(native.reset(options=dict(options)), sync.reset(options=dict(options)))
        if step == 6:
            # Some leave early, so that episodes get out of phase.
            seed = [None] * num_envs
            assert same(native.reset(seed=seed, options=LEAVING), sync.reset(seed=seed, options=LEAVING))
        actions = native.action_space.sample()
        got, expected = native.step(actions), sync.step(actions)
        assert same(got, expected), step
        over = got[2] | got[3]


@pytest.mark.parametrize("mode", MODES)
def test_parity_holds_where_episodes_end_out_of_phase(mode):
    options = {"scene": SMALL, "max_current": 0.5}
    native = gym.make_vec(ENV, 3, autoreset_mode=mode, max_episode_steps=9, **options)
    sync = SyncVectorEnv([lambda: gym.make(ENV, max_episode_steps=9, **options)] * 3, autoreset_mode=mode)
    starts = {name: np.array([value, np.zeros_like(value), value]) for name, value in LEAVING.items()}
    starts["attitude"][1] = LEAVING["attitude"]
    native.reset(seed=0, options=starts)
    for i, env in enumerate(sync.envs):
        sync._env_obs[i], _ = env.reset(seed=i, options={name: rows[i] for name, rows in starts.items()})
    ends = []
    for _ in range(16):
        actions = np.ones((3, 6), dtype=np.float32)
        got, expected = native.step(actions), sync.step(actions)
        assert same(got, expected)
        over = got[2] | got[3]
        ends.append(over)
        if mode is AutoresetMode.DISABLED and over.any():
            assert same(native.reset(options={"reset_mask": over}), sync.reset(options={"reset_mask": over}))
    together = np.array(ends)
    assert together.any(axis=0).all()
    assert (together[:, 0] != together[:, 1]).any()


def test_masked_resets_are_checked_and_leave_the_options_alone():
    envs = gym.make_vec(ENV, 3, scene=SMALL, autoreset_mode="Disabled", max_episode_steps=2)
    observations, _ = envs.reset(seed=0)
    mask = np.array([True, False, True])
    options = {"reset_mask": mask}
    after, infos = envs.reset(options=options)
    assert options == {"reset_mask": mask}
    assert same(after[1], observations[1])
    assert not same(after[0], observations[0])
    for name in INFO:
        assert same(infos[f"_{name}"], mask)
        assert infos[name][1] == 0.0
    for wrong, error in (
        ([True, False, True], TypeError),
        (np.array([1, 0, 1]), TypeError),
        (mask[:2], ValueError),
        (np.zeros(3, dtype=np.bool_), ValueError),
    ):
        before = envs.unwrapped.get_state()
        with pytest.raises(error, match="reset_mask"):
            envs.reset(options={"reset_mask": wrong})
        assert same(envs.unwrapped.get_state(), before)
    actions = np.zeros(envs.action_space.shape)
    envs.step(actions)
    envs.step(actions)
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        envs.step(actions)
    fresh = gym.make_vec(ENV, 3, scene=SMALL, autoreset_mode="Disabled")
    with pytest.raises(gym.error.ResetNeeded, match="never reset"):
        fresh.reset(options={"reset_mask": mask})


def test_a_step_before_the_first_reset_is_refused():
    env, envs = StationKeepEnv(scene=SMALL), StationKeepVectorEnv(2, scene=SMALL)
    for one in (env, envs, gym.make(ENV)):
        with pytest.raises(gym.error.ResetNeeded, match="reset"):
            one.step(one.action_space.sample())


def test_a_diverged_single_environment_wants_a_reset():
    env = StationKeepEnv(scene=SMALL)
    env.reset(seed=0, options=LEAVING)
    for _ in range(10):
        _, _, terminated, truncated, _ = env.step(np.zeros(6))
        if terminated:
            break
    assert terminated
    assert truncated is False
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        env.step(np.zeros(6))
    env.reset()
    env.step(np.zeros(6))


@pytest.mark.parametrize("make", [lambda: StationKeepEnv(scene=SMALL), lambda: StationKeepVectorEnv(3, scene=SMALL)])
def test_bad_actions_change_nothing(make):
    env = make()
    env.reset(seed=0)
    env.step(env.action_space.sample())
    before = env.get_state()
    good = np.zeros(env.action_space.shape, dtype=np.float32)
    bad = []
    for value in (np.nan, np.inf, -np.inf):
        action = good.astype(np.float64)
        action.flat[-1] = value
        bad.append(action)
    bad += [
        good[..., :-1],
        good[None],
        np.float32(0.0),
        good.astype(str),
        good.astype(complex),
        None,
        [],
        "idle",
        [1.0, [2.0]],
    ]
    for action in bad:
        with pytest.raises(ValueError, match="action"):
            env.step(action)
        assert same(env.get_state(), before), action
    env.step(good.tolist())


def test_actions_beyond_the_range_are_clipped():
    one, other = StationKeepEnv(scene=SMALL), StationKeepEnv(scene=SMALL)
    one.reset(seed=0)
    other.reset(seed=0)
    wild = np.array([3.0, -2.0, 0.5, 1e300, -7.0, -1e300])
    assert same(one.step(wild), other.step(np.clip(wild, -1.0, 1.0)))


@pytest.mark.parametrize("scene", SCENES)
def test_observations_lie_in_their_space(scene):
    envs = gym.make_vec(ENV, 16, scene=scene, action="thrusters", max_current=1.0, max_episode_steps=40)
    envs.action_space.seed(1)
    observations, _ = envs.reset(seed=1)
    for _ in range(120):
        assert envs.observation_space.contains(observations)
        # Full thrust, held: as far as an episode can go.
        observations, rewards, *_, infos = envs.step(np.sign(envs.action_space.sample()))
        assert np.isfinite(rewards).all()
        assert all(np.isfinite(infos[name]).all() for name in INFO)


def test_results_are_the_callers_own():
    for copy in (True, False):
        envs = StationKeepVectorEnv(2, scene=SMALL, copy=copy)
        results = [envs.reset(seed=0)[:1], *(envs.step(np.zeros((2, 6))) for _ in range(3))]
        arrays = [x for result in results for x in result if isinstance(x, np.ndarray)]
        arrays += [x for result in results[1:] for x in result[4].values()]
        for i, a in enumerate(arrays):
            assert a.flags.writeable
            assert not any(np.shares_memory(a, b) for b in arrays[:i])


def test_truncation_is_not_termination():
    env = gym.make(ENV, scene=SMALL, max_episode_steps=3)
    env.reset(seed=0)
    flags = [env.step(np.zeros(6))[2:4] for _ in range(3)]
    assert flags == [(False, False), (False, False), (False, True)]
    for never in (None, 0):
        envs = StationKeepVectorEnv(1, scene=SMALL, substeps=1, max_episode_steps=never)
        envs.reset(seed=0)
        assert not any(envs.step(np.zeros((1, 6)))[3].any() for _ in range(450))
    envs = gym.make_vec(ENV, 2, scene=SMALL, substeps=1)
    envs.reset(seed=0)
    assert [step for step in range(401) if envs.step(np.zeros((2, 6)))[3].all()] == [399]


def test_wrappers_work():
    env = gym.make(ENV, scene=SMALL, max_episode_steps=5)
    env = gym.wrappers.RescaleAction(env, np.float32(-2.0), np.float32(2.0))
    env = gym.wrappers.RecordEpisodeStatistics(env)
    env = gym.wrappers.NormalizeObservation(env)
    env = gym.wrappers.FrameStackObservation(env, 3)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (3, 24)
    total = 0.0
    for _ in range(5):
        observation, reward, _, truncated, info = env.step(env.action_space.sample())
        total += reward
    assert truncated
    assert info["episode"]["r"] == pytest.approx(total)
    assert np.isfinite(observation).all()


def test_vector_wrappers_work():
    envs = gym.make_vec(ENV, 3, scene=SMALL, max_episode_steps=5)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs = gym.wrappers.vector.NormalizeObservation(envs)
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(5):
        _, rewards, _, truncated, infos = envs.step(envs.action_space.sample())
        total += rewards
    assert truncated.all()
    np.testing.assert_allclose(infos["episode"]["r"], total)
    listed = gym.wrappers.vector.DictInfoToList(gym.make_vec(ENV, 2, scene=SMALL))
    assert listed.reset(seed=0)[1][1].keys() == set(INFO)


def test_rendering_without_a_mode_warns():
    env, envs = StationKeepEnv(scene=SMALL), StationKeepVectorEnv(2, scene=SMALL)
    with pytest.warns(UserWarning, match="render mode"):
        assert env.render() is None
    with pytest.warns(UserWarning, match="render mode"):
        assert envs.render() == (None, None)


def test_forked_children_step():
    envs = StationKeepVectorEnv(1024, scene=SMALL, threads=2, substeps=1)
    envs.reset(seed=0)
    actions = np.zeros(envs.action_space.shape, dtype=np.float32)
    envs.step(actions)
    expected = pickle.loads(pickle.dumps(envs)).step(actions)[0]
    with warnings.catch_warnings():
        # Python warns of threads of others, such as those of numerical libraries.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os._exit(0 if same(envs.step(actions)[0], expected) else 1)
    killer = threading.Timer(20.0, os.kill, (child, signal.SIGKILL))
    killer.start()
    _, status = os.waitpid(child, 0)
    killer.cancel()
    assert os.waitstatus_to_exitcode(status) == 0
