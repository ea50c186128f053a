"""Arrays that steps of vector environments return: new ones with `copy`, the same ones without."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers import LEAVING, other_than, same, small, task_ids

pytestmark = pytest.mark.parametrize("task", task_ids())

STEPS = 12


def make(task, **kwargs):
    # Episodes end several times, each time of all instances.
    return gym.make_vec(task, 5, scene=small(task), max_episode_steps=4, **kwargs)


def copied(result):
    """A step's arrays and metrics, as they are now."""
    *arrays, infos = result
    metrics = {name: value.copy() for name, value in infos.items() if isinstance(value, np.ndarray)}
    return [array.copy() for array in arrays], metrics


def steps(envs, read, **options):
    """Results of `read` for each of some steps, from a fresh start."""
    envs.reset(seed=3, options=options)
    return [read(envs.step(other_than(k, envs))) for k in range(STEPS)]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_steps_are_the_same_with_and_without_copies(task, mode):
    results = steps(make(task, autoreset_mode=mode), lambda result: (result, copied(result)))
    reused = steps(make(task, autoreset_mode=mode, copy=False), copied)
    for (held, at_once), alone in zip(results, reused, strict=True):
        assert same(copied(held), at_once)
        assert same(at_once, alone)


@pytest.mark.parametrize(
    "part",
    [
        lambda result: result[0],
        lambda result: result[0][1:3],
        lambda result: memoryview(result[0]),
        lambda result: result[1],
        lambda result: result[2][:1],
        lambda result: result[3],
        lambda result: result[4]["position_error"],
    ],
)
def test_copies_keep_their_contents(task, part):
    # (Leaving at first, so that episodes terminate, too.)
    for now, then in steps(make(task), lambda result: (part(result), np.array(part(result))), **LEAVING):
        assert np.array_equal(now, then)


def test_without_copies_the_arrays_are_the_same(task):
    results = steps(make(task, copy=False), lambda result: [*result[:4], result[4]["effort"]])
    for arrays in zip(*results, strict=True):
        assert all(np.shares_memory(array, arrays[0]) for array in arrays)


def test_reset_results_are_never_reused(task):
    envs = make(task, copy=False)
    observations, infos = envs.reset(seed=0)
    kept = copied((observations, infos))
    envs.step(other_than(0, envs))
    assert same(copied((observations, infos)), kept)


def test_arrays_that_cannot_be_written_to_are_refused(task):
    envs = make(task, copy=False)
    envs.reset(seed=0)
    observations, *_ = envs.step(other_than(0, envs))
    before = envs.get_state()
    observations.flags.writeable = False
    with pytest.raises(TypeError, match="not writeable"):
        envs.step(other_than(1, envs))
    assert same(envs.get_state(), before)
