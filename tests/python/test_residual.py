"""Learned corrections to a controller."""

import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from helpers import SMALL, layers, observations

from uvms_gym import MLP, PD, PID, Residual
from uvms_gym.envs.station_keep import StationKeepEnv
from uvms_gym.training.evaluation import run_episodes

ENV = StationKeepEnv(scene=SMALL)


def correction(seed: int = 0) -> MLP:
    """A network that reads 24 entries and 6 of an action, and whose actions are often clipped."""
    return MLP(ENV, **layers((30, 7, 6), seed), residual=True)


@pytest.mark.parametrize("kind", [PD, PID])
def test_val_the_action_is_the_bases_and_a_share_of_the_networks(kind: type[PD] | type[PID]) -> None:
    base, network, rows = kind(ENV), correction(), observations(50)
    corrected = Residual(base, network, 0.4)
    theirs, state = base.predict(rows)
    ours, remembered = corrected.predict(rows)
    more = network.predict(np.concatenate([rows, theirs], axis=1))[0]
    expected = np.clip(theirs + np.float32(0.4) * np.clip(more, -1.0, 1.0), -1.0, 1.0)
    np.testing.assert_array_equal(ours, expected)
    assert np.abs(ours - theirs).max() > 0.1
    if state is not None:
        np.testing.assert_array_equal(remembered, state)
    again = pickle.loads(pickle.dumps(corrected))
    np.testing.assert_array_equal(again.predict(rows)[0], ours)


def test_the_network_may_see_the_past() -> None:
    base = PID(ENV)
    network = MLP(ENV, **layers((60, 7, 6)), history=2, residual=True)
    corrected, rows = Residual(base, network, 0.4), [observations(9, seed) for seed in (1, 2, 3)]
    state = own = past = None
    for row in rows:
        theirs, own = base.predict(row, own)
        now = np.concatenate([row, theirs], axis=1)
        stacked = np.concatenate([np.zeros_like(now) if past is None else past, now], axis=1)
        more = MLP(**layers((60, 7, 6))).predict(stacked)[0]
        actions, state = corrected.predict(row, state)
        np.testing.assert_array_equal(actions, np.clip(theirs + np.float32(0.4) * more, -1.0, 1.0))
        past = now


def test_without_corrections_it_is_the_base() -> None:
    envs = gym.make_vec("UVMS-StationKeep-v0", num_envs=5, scene=SMALL)
    controllers = (PID(ENV), Residual(PID(ENV), correction(), 0.0), Residual(PID(ENV), correction(), 0.5))
    plain, zero, corrected = (run_episodes(envs, controller, 0, 20).returns for controller in controllers)
    np.testing.assert_array_equal(plain, zero)
    assert (plain != corrected).all()


def test_a_network_says_whether_it_corrects(tmp_path: Path) -> None:
    file = tmp_path / "correction.safetensors"
    correction().save(file)
    assert MLP.load(file, ENV, residual=True).residual
    with pytest.raises(ValueError, match=r"correction.safetensors: this is a residual policy; load it with"):
        MLP.load(file, ENV)
    plain = MLP(ENV, **layers((24, 7, 6)))
    plain.save(file)
    with pytest.raises(ValueError, match=r"its observation is nothing, the environment's base_action \(6\)"):
        MLP.load(file, ENV, residual=True)
    with pytest.raises(ValueError, match=r"reads 24 observation entries and gives 6 .* the environment has 30"):
        Residual(PD(ENV), plain)
    for limit in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match=rf"limit is (?i:{limit:g}), but must be in \[0, 1\]"):
            Residual(PD(ENV), correction(), limit)
