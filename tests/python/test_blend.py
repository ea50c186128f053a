"""Weighted means of controllers."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from helpers import SMALL, layers, observations

from uvms_gym import DOB, MLP, PD, PID, Blend
from uvms_gym.envs.station_keep import StationKeepEnv
from uvms_gym.training.evaluation import run_episodes

ENV = StationKeepEnv(scene=SMALL)
WEIGHTS = (0.5, 0.3, 0.2)


def policy(history: int = 2) -> MLP:
    """A network with a memory, whose actions are often clipped."""
    return MLP(ENV, **layers((24 * history, 7, 6)), history=history)


def test_val_the_action_is_the_weighted_mean_and_each_has_its_own_memory() -> None:
    parts = (policy(), PID(ENV), DOB(ENV))
    blend, states, state = Blend(parts, WEIGHTS), [None] * 3, None
    for seed in range(4):
        rows, expected = observations(30, seed), np.zeros((30, 6), np.float32)
        for k, (part, weight) in enumerate(zip(parts, WEIGHTS)):
            actions, states[k] = part.predict(rows, states[k])
            expected += np.float32(weight) * actions
        actions, state = blend.predict(rows, state)
        np.testing.assert_array_equal(actions, np.clip(expected, -1.0, 1.0))
    again = pickle.loads(pickle.dumps(blend))
    np.testing.assert_array_equal(again.predict(rows, state)[0], blend.predict(rows, state)[0])


def test_val_a_guard_hands_over_where_the_pose_error_is_large() -> None:
    first, second, rows = PD(ENV), policy(), observations(200)
    scale = np.array([ENV.layout[0].scale, 0.5 * np.array(ENV.layout[1].scale)]).ravel()
    error = np.linalg.norm(rows[:, :6] * scale, axis=1)
    low, high = np.quantile(error, [0.3, 0.7])
    blend = Blend([first, second], [0.6, 0.4], (low, high), ENV)
    actions, state = blend.predict(rows)
    share = np.clip((error - low) / (high - low), 0.0, 1.0)
    np.testing.assert_allclose(state[:, blend.memory_layout["handed_over"]][:, 0], share, atol=1e-5)
    assert (share == 0.0).sum() > 10 and (share == 1.0).sum() > 10
    weight = (0.6 * (1.0 - share))[:, None]
    (a, _), (b, _) = first.predict(rows), second.predict(rows)
    np.testing.assert_allclose(actions, np.clip(weight * a + (1.0 - weight) * b, -1.0, 1.0), atol=1e-5)
    again = pickle.loads(pickle.dumps(blend))
    np.testing.assert_array_equal(again.predict(rows)[0], actions)


def test_all_weight_on_one_is_that_one_in_a_closed_loop() -> None:
    envs = gym.make_vec("UVMS-StationKeep-Storm-v0", num_envs=5, scene=SMALL)
    parts = (PID(envs), policy())
    for weights, alone in (((1.0, 0.0), parts[0]), ((0.0, 1.0), parts[1])):
        ours, theirs = (run_episodes(envs, one, 0, 20).returns for one in (Blend(parts, weights), alone))
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    ("weights", "line"),
    [
        ((0.5, 0.4), r"the sum of the weights is 0.9, but must be 1"),
        ((1.5, -0.5), r"weight is 1.5, but must be in \[0, 1\]"),
        ((float("nan"), 1.0), r"weight is NaN, but must be in \[0, 1\]"),
        ((1.0,), r"2 controllers, but 1 weights"),
    ],
)
def test_weights_are_those_of_a_mean(weights: tuple[float, ...], line: str) -> None:
    with pytest.raises(ValueError, match=line):
        Blend([PD(ENV), PID(ENV)], weights)


def test_a_guard_hands_over_from_smaller_to_larger_errors() -> None:
    for guard in ((0.2, 0.1), (-0.1, 0.2), (0.1, float("inf"))):
        with pytest.raises(ValueError, match=r"guard is .* but must be two pose errors in m, the first at least 0"):
            Blend([PD(ENV), PID(ENV)], [0.5, 0.5], guard, ENV)
    with pytest.raises(ValueError, match="guard hands over from the first controller to the second, but"):
        Blend([PD(ENV)], [1.0], (0.1, 0.2), ENV)


def test_parts_are_for_the_same_rows() -> None:
    with pytest.raises(ValueError, match=r"reads 25 observation entries and gives 6 .* the environment has 24"):
        Blend([PD(ENV), MLP(**layers((25, 7, 6)))], [0.5, 0.5])
    with pytest.raises(ValueError, match="the sum of the weights is 0, but must be 1"):
        Blend([], [])
