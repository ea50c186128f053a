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
from helpers import LEAVING, assert_parity, idle, make, other_than, same, scenes_with_thrusters, task_ids

pytestmark = pytest.mark.parametrize("task", task_ids())
MODES = list(AutoresetMode)


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
def test_arguments_are_plain(task, mode):
    envs = make(task, 3, autoreset_mode=mode, copy=False, render_mode=None)
    assert envs.metadata["autoreset_mode"] is AutoresetMode(mode)
    assert envs.copy is False
    assert envs.render_mode is None
    if isinstance(mode, str):
        json.dumps(envs.spec.kwargs)
    assert gym.make_vec(envs.spec).num_envs == 3
    with pytest.raises(gym.error.Error, match="vector_kwargs"):
        make(task, 3, vector_kwargs={"autoreset_mode": mode})
    with pytest.raises(ValueError, match="Later"):
        make(task, 3, autoreset_mode="Later")


def test_metadata_belongs_to_the_instance(task):
    one, other = make(task, 3, autoreset_mode="SameStep"), make(task, 3)
    assert one.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert other.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
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
    # Instances that diverge one after another.
    leaving = {name: np.tile(value, (n, 1)) for name, value in LEAVING.items()}
    leaving["position"][:, 0] -= 0.06 * (np.arange(n) % 4)

    def reset(step, native, sync):
        if step == 2 and n > 1:
            # From here on episodes are out of phase.
            options = {"reset_mask": np.arange(n) % 2 == 1}
            assert same(native.reset(options=options), sync.reset(options=dict(options)))
        if step == 8:
            got = native.reset(options=leaving)
            for i, mask in enumerate(np.eye(n, dtype=np.bool_)):
                expected = sync.reset(options={"reset_mask": mask, **{name: rows[i] for name, rows in leaving.items()}})
            assert same(got[0], expected[0])

    native = make(task, n, autoreset_mode=mode, threads=threads, **kwargs)
    assert_parity(native, lambda: make(task, **kwargs), 14, reset, maximum=0.1)


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
    envs = make(task, 3)
    observations, _ = envs.reset(seed=5)
    for i in range(3):
        assert same(make(task).reset(seed=5 + i)[0], observations[i])
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
    envs = make(task, 3, disturbance=None)
    _, infos = envs.reset(seed=0, options={"current": currents, "position": position})
    np.testing.assert_array_equal(infos["current_y"], currents[:, 1])
    np.testing.assert_array_equal(envs.snapshot().position, [position] * 3)


# Episodes


def test_masked_resets_leave_others_and_the_options_alone(task):
    envs = make(task, 3, autoreset_mode="Disabled", max_episode_steps=2)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        envs.step(idle(envs))
    observations, _ = envs.reset(seed=0)
    mask = np.array([True, False, True])
    options = {"reset_mask": mask, "position": [0.0, 0.0, 0.2]}
    kept = copy.deepcopy(options)
    after, _ = envs.reset(options=options)
    assert same(options, kept)
    assert options["reset_mask"] is mask
    assert same(after[1], observations[1])
    assert not same(after[0], observations[0])
    envs.step(idle(envs))
    envs.step(idle(envs))
    with pytest.raises(gym.error.ResetNeeded, match="over"):
        envs.step(idle(envs))
    with pytest.raises(gym.error.ResetNeeded, match="never reset"):
        make(task, 3).reset(options={"reset_mask": mask})


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
    envs = make(task, 3, autoreset_mode="Disabled")
    envs.reset(seed=0)
    before = envs.get_state()
    with pytest.raises(error, match="reset_mask"):
        envs.reset(options={"reset_mask": wrong})
    assert same(envs.get_state(), before)


def test_statistics_survive_a_masked_reset(task):
    envs = make(task, 3, autoreset_mode="Disabled", max_episode_steps=4)
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


# Pictures


def test_pictures_are_a_sequence_drawn_as_it_is_read(task):
    envs = make(task, 256, render_mode="rgb_array")
    envs.reset(seed=0)
    begun = time.process_time()
    frames = envs.render()
    one = frames[200]
    assert time.process_time() - begun < 1.0, "256 pictures were drawn"
    assert isinstance(frames, Sequence)
    assert len(frames) == 256
    assert one.dtype == np.uint8
    assert one.shape == (480, 640, 3)
    single = make(task, render_mode="rgb_array")
    single.reset(seed=200)
    assert same(single.render(), one)


# Wrappers


def test_vector_wrappers_work(task):
    envs = make(task, 3, max_episode_steps=5)
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
    single = make(task)
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
