"""The checker of vector environments: content with what keeps the contract, and naming what does not."""

import re

import gymnasium as gym
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from helpers import small, task_ids
from toys import TOYS, Walk, Walks

from uvms_gym.testing import RULES, Violation, check_vector_env

MODES = list(AutoresetMode)


def uvms(name, mode, n, **options):
    options = {"scene": small(name), "max_episode_steps": 4, **options}
    return gym.make_vec(name, n, autoreset_mode=mode, **options), lambda: gym.make(name, **options)


# Random torques hurl an arm about.
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
@pytest.mark.parametrize("name", task_ids())
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("n", [1, 3])
def test_our_environments_keep_the_contract(name, mode, n):
    envs, single = uvms(name, mode, n)
    check_vector_env(envs, single=single, steps=14)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("n", [1, 3])
def test_toys_that_keep_it_pass(mode, n):
    check_vector_env(Walks(mode, n), single=Walk, steps=30)
    check_vector_env(Walks(mode, n, "rgb_array"), steps=30)
    check_vector_env(gym.wrappers.vector.TransformReward(Walks(mode, n), lambda rewards: 2.0 * rewards), steps=30)


@pytest.mark.parametrize("mode", MODES)
def test_gymnasiums_cart_poles_pass_as_far_as_they_go(mode):
    # SyncVectorEnv steps some before it sees that others have no action, and takes the mask from the caller's dict.
    check_vector_env(SyncVectorEnv([lambda: gym.make("CartPole-v1")] * 3, autoreset_mode=mode), single="CartPole-v1",
                     skip={"actions", "options"})  # fmt: skip


@pytest.mark.parametrize(("toy", "mode", "kwargs", "rule", "words"), TOYS)
def test_toys_that_break_a_rule_are_found(toy, mode, kwargs, rule, words):
    with pytest.raises(Violation, match=rf"^{rule}: .*{words}"):
        check_vector_env(toy(mode, **kwargs), single=Walk, steps=30)


def test_every_rule_has_a_toy_that_breaks_it():
    assert {param.values[3] for param in TOYS} == set(RULES)


def test_gymnasiums_own_cart_pole_vector_is_found_out():
    with pytest.raises(Violation):
        check_vector_env(gym.make_vec("CartPole-v1", 3), single="CartPole-v1")


def test_accidents_say_where_they_happened():
    class Falls(Walks):
        def step(self, actions):
            if self.at is not None:
                raise KeyError("at")
            return super().step(actions)

    with pytest.raises(KeyError) as caught:
        check_vector_env(Falls())
    assert caught.value.__notes__ == ["This came up when check_vector_env checked the rule 'results'."]


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"env": gym.make("CartPole-v1")}, TypeError, "must be a gymnasium.vector.VectorEnv, not"),
        ({"skip": ["speed"]}, ValueError, "unknown rule 'speed'; known: metadata"),
        ({"steps": 1}, ValueError, "steps is 1"),
        ({"steps": 2}, Violation, "no episode ended within 2 steps"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, error, words):
    with pytest.raises(error, match=re.escape(words)):
        check_vector_env(**{"env": Walks(), **arguments})
