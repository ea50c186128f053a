"""Adaptive resolved motion: the bank tells delay and thrust; with models alike it is resolved motion."""

import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import uvms_gym
from uvms_gym.controllers import AdaptiveResolvedMotion, ResolvedMotion
from uvms_gym.envs import EETrackVectorEnv

#: For a vehicle that is the nominal model but for its thrust or delay, under sensors without noise.
SHARP: Any = {"innovation": [0.0005, 0.0015, 0.0015], "memory_time": 0.0}
ALIKE: Any = {"thrust_factors": [1.0] * 3}
#: Gains that stand a delay of 0.3 s.
CALM: Any = {"pose_gain": 1.0, "twist_gain": 2.5, "joint_gain": 4.0}


def make(n: int, disturbance: Any, **options: Any) -> EETrackVectorEnv:
    return EETrackVectorEnv(
        n, disturbance=disturbance, dt=0.01, substeps=10, thruster_lag=0.1, **{"max_episode_steps": None, **options}
    )


def driven(disturbance: Any, steps: int, *gains: Any) -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Last actions of controllers and their models' probabilities, in episodes of the first one."""
    env = make(8, disturbance, reference="spline")
    controllers = [AdaptiveResolvedMotion(env, **given) for given in gains]
    observation, _ = env.reset(seed=1)
    results: list[Any] = [(None, None)] * len(gains)
    for _ in range(steps):
        results = [c.predict(observation, state) for c, (_, state) in zip(controllers, results, strict=True)]
        observation, *_ = env.step(results[0][0])
    return [(action, c.probabilities(state)) for c, (action, state) in zip(controllers, results, strict=True)]


@pytest.mark.parametrize("delay", [0, 1, 2, 3])
def test_the_delay_is_told(delay: int) -> None:
    [(_, found)] = driven({"delay": {"periods": delay}}, 90, {"delay": 3, **CALM, **ALIKE, **SHARP})
    assert (found.sum(axis=-1)[:, delay] > 0.99).all(), found.sum(axis=-1)


@pytest.mark.parametrize("delay", [0, 1, 2, 3])
def test_the_delay_of_a_vehicle_known_poorly_is_told_in_a_storm(delay: int) -> None:
    storm = {"base": "storm-wide", "delay": {"time": [0.1 * delay, 0.1 * delay]}}
    [(_, found)] = driven(storm, 60, {"delay": 3, **CALM})
    assert (found.sum(axis=-1).argmax(axis=-1) == delay).mean() > 0.8, found.sum(axis=-1)


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize(("factor", "place"), [(0.5, 0), (1.0, 1), (2.0, 2)])
def test_the_thrust_is_told(factor: float, place: int, delay: int) -> None:
    disturbance = {"parameters": {"thrust": [factor, factor]}, "delay": {"periods": delay}}
    [(_, found)] = driven(disturbance, 90, {"delay": 3, "thrust_factors": [0.5, 1.0, 2.0], **CALM, **SHARP})
    assert (found[:, delay, place] > 0.99).all(), found


def test_models_weigh_the_same_before_all_have_predicted_a_measurement() -> None:
    (_, before), (_, after) = (driven("storm-wide", steps, {"delay": 3})[0] for steps in (4, 5))
    np.testing.assert_allclose(before, np.full((8, 4, 3), 1.0 / 12.0), rtol=1e-12)
    assert (np.ptp(after, axis=(1, 2)) > 0.0).all()


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_with_models_alike_it_is_resolved_motion(delay: int) -> None:
    """Factors of 1 change nothing; among delays, after a start under the mean of models, the true one is told."""
    gains: Any = {**CALM, "observer_bandwidth": [4.0, 4.0, 8.0], "lag_compensation": 0.5}
    envs = [make(8, {"base": "storm", "noise": None, "delay": {"periods": delay}}) for _ in range(2)]
    controllers = [
        AdaptiveResolvedMotion(envs[0], **ALIKE, **gains, innovation=[0.1, 0.2, 0.005]),
        ResolvedMotion(envs[1], **{**gains, "delay": None}),
    ]
    assert controllers[0].delay == controllers[1].delay == delay
    observations = [env.reset(seed=1)[0] for env in envs]
    states: list[Any] = [None, None]
    gaps = []
    for _ in range(150):
        actions = []
        for k in range(2):
            action, states[k] = controllers[k].predict(observations[k], states[k])
            observations[k], *_ = envs[k].step(action)
            actions.append(action)
        gaps.append(np.abs(actions[0] - actions[1]).max())
    if delay == 0:
        assert max(gaps) < 1e-5, gaps
    else:
        assert max(gaps) > 1e-2 and gaps[-1] < 2e-3, gaps


def test_gains_decrease_with_the_delay() -> None:
    (plain, _), (scheduled, _) = driven("storm-wide", 1, {"delay": 0}, {"delay": 0, "delay_schedule": [5.0, 5.0]})
    np.testing.assert_array_equal(plain, scheduled)
    (plain, _), (scheduled, _) = driven("storm-wide", 1, {"delay": 3}, {"delay": 3, "delay_schedule": [5.0, 5.0]})
    assert np.square(scheduled).sum() < np.square(plain).sum()


def test_a_command_is_what_a_model_asks_for_over_its_factor() -> None:
    gains: Any = {"delay": 0, **CALM}
    (one, _), (two, _) = driven(None, 1, {**gains, **ALIKE}, {**gains, "thrust_factors": [2.0] * 3})
    within = np.abs(one[:, :6]) < 1.0
    assert within.any() and np.abs(one[:, :6][within]).max() > 0.01
    np.testing.assert_allclose(2.0 * two[:, :6][within], one[:, :6][within], rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(two[:, 6:], one[:, 6:])


def test_memory_holds_weights_and_models() -> None:
    controller = AdaptiveResolvedMotion(make(1, None), delay=2)
    lengths = {name: place.stop - place.start for name, place in controller.memory_layout.items()}
    assert lengths == {"log_weights": 9, "periods": 1, "models": 9 * (11 + 11 + 6), "efforts": 2 * 11}


def test_it_errs_less_than_one_model_on_vehicles_known_poorly() -> None:
    env = make(32, "storm-wide", max_episode_steps=120)

    def error(controller: Any) -> float:
        env.reset(seed=11)
        rollout = uvms_gym.Rollout(env, controller)
        rollout.run(120)
        stats = rollout.pop_stats()
        squares = stats.squares["position_error"] + stats.squares["attitude_error"] / 4
        return float(np.median(np.sqrt(squares / stats.steps)))

    gains: Any = {**CALM, "observer_bandwidth": [4.0, 4.0, 8.0]}
    assert error(AdaptiveResolvedMotion(env, **gains)) < 0.9 * error(ResolvedMotion(env, **gains, delay=2))


def test_what_cannot_be_is_refused() -> None:
    env = make(1, None)
    wrong: list[tuple[Any, str]] = [
        ({"delay": 11}, "delay is 11 control periods, but at most 10 are supported"),
        ({"thrust_factors": [1.0, 0.0, 2.0]}, "gain thrust_factors is [1.0, 0.0, 2.0], but must be above 0"),
        ({"thrust_factors": [1.0, 2.0]}, "gain thrust_factors is [1.0,2.0], but must be 3 numbers"),
        ({"innovation": [0.1, 0.0, 1.0]}, "gain innovation is [0.1, 0.0, 1.0], but must be above 0"),
        ({"memory_time": -1.0}, "gain memory_time"),
        ({"delay_schedule": [0.0, float("nan")]}, "gain delay_schedule[1]"),
        ({"pose_gain": -1.0}, "gain pose_gain"),
    ]
    for gains, message in wrong:
        with pytest.raises(ValueError, match=re.escape(message)):
            AdaptiveResolvedMotion(env, **gains)
    with pytest.raises(ValueError, match="state has shape"):
        AdaptiveResolvedMotion(env).probabilities(np.zeros(3))
    with pytest.raises(ValueError, match="is for UVMS-EETrack, not for UVMS-StationKeep; controllers of"):
        AdaptiveResolvedMotion(scene="petasus-pum", task="station-keep")
