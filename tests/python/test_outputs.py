"""Arrays that vector environments return: one that somebody holds stays as it is, any other is written to again."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers import LEAVING, same, small, task_ids

pytestmark = pytest.mark.parametrize("task", task_ids())

STEPS = 12


def make(task, **kwargs):
    # Episodes end now and then, each time of all instances.
    return gym.make_vec(task, 5, scene=small(task), max_episode_steps=4, **kwargs)


def actions(envs, step):
    shape = envs.action_space.shape
    return np.random.default_rng(step).uniform(-0.1, 0.1, shape).astype(np.float32)


def copied(result):
    """A step's arrays and measures, as they are now."""
    *arrays, infos = result
    measures = {name: value.copy() for name, value in infos.items() if isinstance(value, np.ndarray)}
    return [array.copy() for array in arrays], measures


def steps(envs, look, **options):
    """What `look` gives of each of some steps, from a fresh start."""
    envs.reset(seed=3, options=options)
    return [look(envs.step(actions(envs, k))) for k in range(STEPS)]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_steps_are_the_same_whether_or_not_those_before_are_held(task, mode):
    results = steps(make(task, autoreset_mode=mode), lambda result: (result, copied(result)))
    dropped = steps(make(task, autoreset_mode=mode), copied)
    for (held, at_once), alone in zip(results, dropped, strict=True):
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
def test_whoever_holds_a_part_holds_it_for_good(task, part):
    # (Leaving at first, so that episodes terminate, too.)
    for now, then in steps(make(task), lambda result: (part(result), np.array(part(result))), **LEAVING):
        assert np.array_equal(now, then)


def test_what_nobody_holds_is_written_to_again(task):
    assert len(set(steps(make(task), lambda result: result[0].ctypes.data))) <= 2


def reshape(array):
    array.shape = array.size


def retype(array):
    array.dtype = np.uint8


def lock(array):
    array.flags.writeable = False


@pytest.mark.filterwarnings("ignore:Setting the:DeprecationWarning")
@pytest.mark.parametrize("spoil", [reshape, retype, lock])
@pytest.mark.parametrize("which", [0, 1, 2, 3])
def test_what_is_no_longer_what_it_was_is_not_written_to_again(task, spoil, which):
    def look(result):
        seen = copied(result)
        spoil(result[which])
        return seen

    for spoiled, plain in zip(steps(make(task), look), steps(make(task), copied), strict=True):
        assert same(spoiled, plain)
