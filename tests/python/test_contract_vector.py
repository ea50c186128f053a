"""Contract of Gymnasium's vector environments, for every id."""

import copy
import json
import os
import pickle
import signal
import threading
import time
import warnings
from collections.abc import Sequence

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils import performance
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from helpers import LEAVING, control_rate, idle, other_than, same, scenes_with_thrusters, small, task_ids

pytestmark = pytest.mark.parametrize("task", task_ids())
MODES = list(AutoresetMode)


def make(task, n=3, **kwargs):
    return gym.make_vec(task, n, **{"scene": small(task), **kwargs})


def singles(task, n, mode, **kwargs):
    kwargs = {"scene": small(task), **kwargs}
    return SyncVectorEnv([lambda: gym.make(task, **kwargs)] * n, autoreset_mode=mode)


# Making them


def test_the_native_one_is_the_default_and_others_work(task):
    native = make(task, 2)
    assert type(native).__name__.endswith("VectorEnv")
    assert not isinstance(native, SyncVectorEnv)
    starts = native.reset(seed=1)
    steps = native.step(other_than(0, native))
    for mode in ("sync", "async"):
        envs = make(task, 2, vectorization_mode=mode)
        try:
            assert same(envs.reset(seed=1), starts)
            assert same(envs.step(other_than(0, native)), steps)
        finally:
            envs.close()


@pytest.mark.parametrize("mode", [*MODES, *(mode.value for mode in MODES)])
def test_arguments_are_plain_and_recreate_it(task, mode):
    kwargs = {"autoreset_mode": mode, "threads": 2, "copy": False, "max_episode_steps": 3, "render_mode": None}
    envs = make(task, action="thrusters", reward={"pose": 0.2}, **kwargs)
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert envs.copy is False
    assert envs.render_mode is None
    if isinstance(mode, str):
        json.dumps(envs.spec.kwargs)
    for spec in (envs.spec, pickle.loads(pickle.dumps(envs.spec))):
        again = gym.make_vec(spec)
        assert (again.num_envs, again.metadata) == (3, envs.metadata)
        assert same(again.reset(seed=1), envs.reset(seed=1))
        for _ in range(3):
            got, expected = again.step(idle(envs)), envs.step(idle(envs))
            assert same(got, expected)
        assert got[3].all()
    with pytest.raises(gym.error.Error, match="vector_kwargs"):
        make(task, vector_kwargs={"autoreset_mode": mode})
    with pytest.raises(ValueError, match="Later"):
        make(task, autoreset_mode="Later")


def test_metadata_belongs_to_the_instance(task):
    one, other = make(task, autoreset_mode="SameStep"), make(task, dt=0.02, substeps=1)
    assert one.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert other.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert (one.metadata["render_fps"], other.metadata["render_fps"]) == (control_rate(task), 50.0)
    assert "autoreset_mode" not in type(one).metadata


# Numbers


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("n", "threads", "kwargs"),
    [
        (1, None, {}),
        (2, 2, {"dtype": "float32"}),
        (7, 1, {"action": "thrusters"}),
        (8, 3, {"integrator": "rk4-normalise"}),
        (9, 2, {"scene": "petasus-pum"}),
        (64, 2, {"privileged": True, "action": "residual"}),
        (3, 1, {"disturbance": {"base": "storm-hard", "delay": 0.1, "noise": {"bias": 1}}}),
    ],
)
def test_native_is_a_sync_vector_of_singles(task, mode, n, threads, kwargs):
    kwargs = {**kwargs, "substeps": 2, "max_episode_steps": 4}
    native = make(task, n, autoreset_mode=mode, threads=threads, **kwargs)
    sync = singles(task, n, mode, **kwargs)
    assert native.metadata == sync.metadata
    assert native.observation_space == sync.observation_space
    assert native.action_space == sync.action_space
    assert same(native.reset(seed=3), sync.reset(seed=3))
    # Instances that diverge one after another.
    leaving = {name: np.tile(value, (n, 1)) for name, value in LEAVING.items()}
    leaving["position"][:, 0] -= 0.06 * (np.arange(n) % 4)
    over = np.zeros(n, dtype=np.bool_)
    ends = 0
    for step in range(14):
        if mode is AutoresetMode.DISABLED and over.any():
            assert same(native.reset(options={"reset_mask": over}), sync.reset(options={"reset_mask": over.copy()}))
        if step == 2 and n > 1:
            # From here on episodes are out of phase.
            mask = np.arange(n) % 2 == 1
            options = {"reset_mask": mask}
            assert same(native.reset(options=options), sync.reset(options=dict(options)))
        if step == 8:
            got = native.reset(options=leaving)
            for i, mask in enumerate(np.eye(n, dtype=np.bool_)):
                expected = sync.reset(options={"reset_mask": mask, **{name: rows[i] for name, rows in leaving.items()}})
            assert same(got[0], expected[0])
        actions = other_than(step, native)
        got, expected = native.step(actions), sync.step(actions)
        assert same(got, expected), step
        over = got[2] | got[3]
        ends += over.any()
    assert ends > 1


@pytest.mark.parametrize(
    ("n", "options"), [(9, {}), (300, {}), (530, {"autoreset_mode": "SameStep", "dtype": "float32"})]
)
def test_the_number_of_threads_changes_no_bit(task, n, options):
    runs = []
    for threads in (1, 2, 3, 16):
        envs = make(task, n, threads=threads, substeps=1, max_episode_steps=3, **options)
        results = [envs.reset(seed=0)]
        results += [envs.step(other_than(k, envs)) for k in range(5)]
        runs.append(results)
    assert all(same(run, runs[0]) for run in runs[1:])


def test_an_instance_is_the_same_wherever_it_is(task):
    many, few = make(task, 20), make(task, 3)
    for envs in (many, few):
        envs.reset(seed=list(range(envs.num_envs)) if envs is many else [17, 2, 11])
    for k in range(3):
        actions = other_than(k, many)
        got, expected = few.step(actions[[17, 2, 11]]), many.step(actions)
        assert same(got[0], expected[0][[17, 2, 11]])
        assert same(got[1], expected[1][[17, 2, 11]])


# Full torque hurls an arm about.
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_observations_lie_in_their_space_at_full_thrust(task):
    for scene in scenes_with_thrusters():
        envs = make(task, 16, scene=scene, action="thrusters", max_current=1.0, max_episode_steps=40)
        observations, infos = envs.reset(seed=1)
        for k in range(100):
            assert envs.observation_space.contains(observations)
            assert all(np.isfinite(infos[name]).all() for name in infos)
            # Full thrust, held: as far as an episode can go.
            observations, rewards, *_, infos = envs.step(np.sign(other_than(k // 50, envs)))
            assert np.isfinite(rewards).all()


# Seeds


def test_seeds_are_those_of_singles(task):
    envs = make(task)
    observations, _ = envs.reset(seed=5)
    for i in range(3):
        assert same(gym.make(task, scene=small(task)).reset(seed=5 + i)[0], observations[i])
    assert same(envs.reset(seed=[5, 6, 7])[0], observations)
    assert same(envs.reset(seed=(5, np.int64(6), 7))[0], observations)
    mixed, _ = envs.reset(seed=[None, 6, None])
    assert same(mixed[1], observations[1])
    assert not same(mixed[0], observations[0])
    for seed in ([1, 2], [1, 2, -3], -1):
        with pytest.raises((ValueError, gym.error.Error), match="seed"):
            envs.reset(seed=seed)


def test_reset_options_have_one_row_per_instance(task):
    currents, position = np.diag([0.1, 0.1, 0.1]), [0.0, 0.0, 0.5]
    envs = make(task, disturbance=None)
    _, infos = envs.reset(seed=0, options={"current": currents, "position": position})
    np.testing.assert_array_equal(infos["current_y"], currents[:, 1])
    np.testing.assert_array_equal(envs.snapshot().position, [position] * 3)


def test_without_a_seed_the_operating_system_gives_one(task):
    envs = make(task)
    first, _ = envs.reset()
    assert not same(make(task).reset()[0], first)
    assert same(make(task).reset(seed=envs.np_random_seed)[0], first)
    assert not same(first[0], first[1])


# Episodes


def test_next_step_is_the_default(task):
    envs = make(task, max_episode_steps=2)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    envs.reset(seed=0)
    last = [envs.step(idle(envs)) for _ in range(2)][-1]
    assert last[3].all()
    observations, rewards, terminated, truncated, _ = envs.step(idle(envs) + 1.0)
    assert (rewards == 0.0).all()
    assert not (terminated | truncated).any()
    fresh = make(task)
    fresh.reset(seed=0)
    assert same(observations, fresh.reset()[0])
    # Gymnasium's wrapper takes no other mode.
    gym.wrappers.vector.NormalizeObservation(make(task))
    for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
        with pytest.raises((ValueError, AssertionError)):
            gym.wrappers.vector.NormalizeObservation(make(task, autoreset_mode=mode))


def test_same_step_gives_the_last_of_the_old_and_the_first_of_the_new(task):
    envs, plain = make(task, autoreset_mode="SameStep", max_episode_steps=2), make(task, max_episode_steps=2)
    for one in (envs, plain):
        one.reset(seed=0)
        one.step(idle(one))
    observations, rewards, *flags, infos = envs.step(idle(envs))
    last = plain.step(idle(plain))
    assert same([rewards, *flags], list(last[1:4]))
    assert same(np.stack(infos["final_obs"]), last[0])
    assert same(infos["final_info"], last[4])
    assert infos["_final_obs"].all()
    assert infos["_final_info"].all()
    fresh = make(task)
    fresh.reset(seed=0)
    assert same((observations, {k: v for k, v in infos.items() if "final_" not in k}), fresh.reset())


def test_masked_resets_leave_others_and_the_options_alone(task):
    envs = make(task, autoreset_mode="Disabled", max_episode_steps=2)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        envs.step(idle(envs))
    observations, _ = envs.reset(seed=0)
    mask = np.array([True, False, True])
    options = {"reset_mask": mask, "position": [0.0, 0.0, 0.2]}
    kept = copy.deepcopy(options)
    after, infos = envs.reset(options=options)
    assert same(options, kept)
    assert options["reset_mask"] is mask
    assert same(after[1], observations[1])
    assert not same(after[0], observations[0])
    for name in [name for name in infos if not name.startswith("_")]:
        assert same(infos[f"_{name}"], mask)
        assert infos[name][1] == 0.0
    envs.step(idle(envs))
    envs.step(idle(envs))
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        envs.step(idle(envs))
    with pytest.raises(gym.error.ResetNeeded, match="never reset"):
        make(task).reset(options={"reset_mask": mask})


@pytest.mark.parametrize(
    ("wrong", "error"),
    [
        ([True, False, True], TypeError),
        (np.array([1, 0, 1]), TypeError),
        (np.array([True, False]), ValueError),
        (np.zeros(3, dtype=np.bool_), ValueError),
    ],
)
def test_masks_that_are_none_are_refused(task, wrong, error):
    envs = make(task, autoreset_mode="Disabled")
    envs.reset(seed=0)
    before = envs.get_state()
    with pytest.raises(error, match="reset_mask"):
        envs.reset(options={"reset_mask": wrong})
    assert same(envs.get_state(), before)


def test_statistics_survive_a_masked_reset(task):
    envs = make(task, autoreset_mode="Disabled", max_episode_steps=4)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs.reset(seed=0)
    total = np.zeros(3)
    mask = np.array([True, False, False])
    for k in range(4):
        if k == 2:
            envs.reset(options={"reset_mask": mask})
            total[mask] = 0.0
        _, rewards, _, truncated, infos = envs.step(idle(envs))
        total += rewards
    assert truncated.tolist() == [False, True, True]
    np.testing.assert_allclose(infos["episode"]["r"][1:], total[1:])
    assert infos["episode"]["l"].tolist()[1:] == [4, 4]


def test_episodes_are_truncated_by_their_own_limit(task):
    envs = make(task, substeps=1)
    envs.reset(seed=0)
    limit = gym.spec(task).max_episode_steps
    assert [step for step in range(limit + 1) if envs.step(idle(envs))[3].all()] == [limit - 1]
    for never in (None, 0):
        envs = make(task, 1, substeps=1, max_episode_steps=never)
        envs.reset(seed=0)
        assert not any(envs.step(idle(envs))[3].any() for _ in range(420))


def test_time_out_and_divergence_are_told_apart(task):
    envs = make(task, 2, max_episode_steps=30)
    starts = {name: np.stack([value, np.zeros_like(value)]) for name, value in LEAVING.items()}
    starts["attitude"][1] = LEAVING["attitude"]
    envs.reset(seed=0, options=starts)
    ends = {}
    for step in range(30):
        _, _, terminated, truncated, _ = envs.step(idle(envs))
        assert not (terminated & truncated).any()
        for i in np.flatnonzero(terminated | truncated):
            ends.setdefault(int(i), (step, bool(terminated[i])))
    assert ends[0][1]
    assert ends[1] == (29, False)


def test_bad_actions_change_nothing(task):
    envs = make(task)
    envs.reset(seed=0)
    before = envs.get_state()
    good = idle(envs)
    last = good.copy()
    last[2, -1] = np.nan
    for bad in (last, np.full_like(good, np.inf), good[:2], good[:, :-1], good[None], good[0], None, [], "idle"):
        with pytest.raises(ValueError, match="action"):
            envs.step(bad)
        assert same(envs.get_state(), before)
    assert same(make_and_step(task, 3.0 * good + 5.0), make_and_step(task, good + 1.0))


def test_actions_are_read_wherever_they_lie(task):
    actions = other_than(2, make(task))
    frozen = actions.copy()
    frozen.flags.writeable = False
    apart = np.full((3 * actions.shape[0], 2 * actions.shape[1]), np.nan, dtype=np.float32)
    apart[::3, ::2] = actions
    odd = np.frombuffer(b"\0" + actions.tobytes(), dtype=np.float32, offset=1).reshape(actions.shape)
    assert not odd.flags.aligned
    expected = make_and_step(task, actions)
    for given in (frozen, apart[::3, ::2], actions[::-1].copy()[::-1], np.asfortranarray(actions), odd):
        assert same(make_and_step(task, given), expected)


def make_and_step(task, actions):
    envs = make(task)
    envs.reset(seed=0)
    return envs.step(actions)


def test_results_are_the_callers_own(task):
    envs = make(task, 2)
    results = [envs.reset(seed=0)[:1], *(envs.step(idle(envs)) for _ in range(3))]
    arrays = [x for result in results for x in result if isinstance(x, np.ndarray)]
    arrays += [x for result in results[1:] for x in result[4].values()]
    for i, a in enumerate(arrays):
        assert a.flags.writeable
        assert not any(np.shares_memory(a, b) for b in arrays[:i])


@pytest.mark.parametrize(("mode", "dtype"), [("NextStep", "float64"), ("SameStep", "float32")])
def test_copies_in_mid_episode_go_on_alike(task, mode, dtype):
    options = {"max_episode_steps": 6, "autoreset_mode": mode, "dtype": dtype}
    envs = make(task, **options)
    envs.reset(seed=11)
    for k in range(4):
        envs.step(other_than(k, envs))
    others = [copy.deepcopy(envs), pickle.loads(pickle.dumps(envs)), make(task, **options)]
    others[2].reset()
    others[2].set_state(envs.get_state())
    for k in range(8):
        expected = envs.step(other_than(k, envs))
        assert all(same(other.step(other_than(k, envs)), expected) for other in others)
    expected = envs.reset()
    assert all(same(other.reset(), expected) for other in others)


# Pictures


def test_rendering_without_a_mode_warns(task):
    envs = make(task, 2)
    envs.reset(seed=0)
    with pytest.warns(UserWarning, match="render mode"):
        assert envs.render() == (None, None)


def test_pictures_are_a_sequence_drawn_as_it_is_read(task):
    envs = make(task, 256, render_mode="rgb_array")
    envs.reset(seed=0)
    begun = time.perf_counter()
    frames = envs.render()
    one = frames[200]
    assert time.perf_counter() - begun < 1.0, "256 pictures were drawn"
    assert isinstance(frames, Sequence)
    assert len(frames) == 256
    assert one.dtype == np.uint8
    assert one.shape == (480, 640, 3)
    single = gym.make(task, scene=small(task), render_mode="rgb_array")
    single.reset(seed=200)
    assert same(single.render(), one)


# Wrappers


def test_vector_wrappers_work(task):
    envs = make(task, max_episode_steps=5)
    envs = gym.wrappers.vector.RecordEpisodeStatistics(envs)
    envs = gym.wrappers.vector.NormalizeObservation(envs)
    envs.reset(seed=0)
    total = np.zeros(3)
    for _ in range(5):
        _, rewards, _, truncated, infos = envs.step(idle(envs))
        total += rewards
    assert truncated.all()
    np.testing.assert_allclose(infos["episode"]["r"], total)
    listed = gym.wrappers.vector.DictInfoToList(make(task, 2))
    single = gym.make(task, scene=small(task))
    assert listed.reset(seed=0)[1][1] == single.reset(seed=1)[1]


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_gymnasiums_benchmark_runs(task):
    if not hasattr(performance, "benchmark_vector_step"):
        pytest.skip("since Gymnasium 1.4")
    assert performance.benchmark_vector_step(make(task, 8), target_duration=0.02, seed=0) > 0.0


# Processes, threads, signals


def test_forked_children_step(task):
    envs = make(task, 1024, threads=2, substeps=1)
    envs.reset(seed=0)
    envs.step(idle(envs))
    expected = pickle.loads(pickle.dumps(envs)).step(idle(envs))[0]
    with warnings.catch_warnings():
        # Python warns of threads of others, such as those of numerical libraries.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os._exit(0 if same(envs.step(idle(envs))[0], expected) else 1)
    killer = threading.Timer(20.0, os.kill, (child, signal.SIGKILL))
    killer.start()
    _, status = os.waitpid(child, 0)
    killer.cancel()
    assert os.waitstatus_to_exitcode(status) == 0


def test_an_interrupt_stops_a_loop_of_steps(task):
    # Short episodes: left to itself for as many steps as a fast machine takes, an arm gets too wild for these.
    envs = make(task, 64, max_episode_steps=20)
    envs.reset(seed=0)
    timer = threading.Timer(0.05, signal.raise_signal, (signal.SIGINT,))
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            # Here, so that a machine that is slow at this moment is not interrupted outside.
            timer.start()
            begun = time.perf_counter()
            while time.perf_counter() - begun < 10.0:
                envs.step(idle(envs))
    finally:
        timer.join()
        signal.signal(signal.SIGINT, previous)
    assert np.isfinite(envs.step(idle(envs))[0]).all()
