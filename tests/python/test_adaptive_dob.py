"""Adaptive DOB: the bank tells delay and thrust from innovations; with models alike it is the DOB."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from uvms_gym.controllers import DOB, AdaptiveDOB
from uvms_gym.envs.station_keep import StationKeepVectorEnv

#: For a vehicle that is the nominal model but for its thrust or delay, under sensors without noise.
SHARP: Any = {"innovation": [0.001, 0.003], "memory_time": 0.0}


def driven(disturbance: Any, steps: int, *gains: Any) -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Last actions of adaptive DOBs and their models' probabilities, in episodes of the first one."""
    env = StationKeepVectorEnv(8, disturbance=disturbance, substeps=10, thruster_lag=0.1, max_episode_steps=None)
    controllers = [AdaptiveDOB(env, **given) for given in gains]
    observation, _ = env.reset(seed=1)
    results: list[Any] = [(None, None)] * len(gains)
    for _ in range(steps):
        results = [c.predict(observation, state) for c, (_, state) in zip(controllers, results, strict=True)]
        observation, *_ = env.step(results[0][0])
    return [(action, c.probabilities(state)) for c, (action, state) in zip(controllers, results, strict=True)]


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_arm_tells_the_delay(delay: int) -> None:
    storm = {"base": "storm-wide", "delay": {"time": [0.1 * delay, 0.1 * delay]}}
    [(_, found)] = driven(storm, 25, {"delay": 3})
    assert (found.sum(axis=-1)[:, delay] > 0.99).all(), found.sum(axis=-1)


@pytest.mark.parametrize("delay", [0, 2])
def test_a_vehicle_alone_tells_the_delay(delay: int) -> None:
    still_arm = {"delay": {"periods": delay}, "arm": {"amplitude": 0.0}}
    [(_, found)] = driven(still_arm, 60, {"delay": 3, "thrust_factors": [1.0] * 3, **SHARP})
    assert (found.sum(axis=-1).argmax(axis=-1) == delay).all(), found.sum(axis=-1)


@pytest.mark.parametrize(("factor", "place"), [(0.5, 0), (1.0, 1), (2.0, 2)])
def test_a_vehicle_tells_its_thrust(factor: float, place: int) -> None:
    [(_, found)] = driven({"parameters": {"thrust": [factor, factor]}}, 60, SHARP)
    assert (found[:, 0, place] > 0.99).all(), found


def test_models_weigh_the_same_before_all_have_predicted_a_measurement() -> None:
    (_, before), (_, after) = (driven("storm-wide", steps, {"delay": 3})[0] for steps in (4, 5))
    np.testing.assert_allclose(before, np.full((8, 4, 3), 1.0 / 12.0), rtol=1e-12)
    assert (np.ptp(after, axis=(1, 2)) > 0.0).all()


@pytest.mark.parametrize("delay", [0, 2])
def test_with_models_alike_it_is_the_dob(delay: int) -> None:
    """Factors of 1 change nothing; among delays the arm tells, after a start under the mean of models, which it is."""
    disturbance = {"base": "storm", "delay": {"periods": delay}}
    gains: Any = {"acceleration_noise": [0.3, 1.0], "prediction_horizon": 0.05}
    alike: Any = {"thrust_factors": [1.0] * 3, "delay_schedule": [0.0] * 2, "joint_innovation": [1e-3, 5e-3]}
    envs = [StationKeepVectorEnv(8, disturbance=disturbance, substeps=10, thruster_lag=0.1) for _ in range(2)]
    controllers = [AdaptiveDOB(envs[0], **alike, **gains), DOB(envs[1], delay=None, **gains)]
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
        assert max(gaps) > 1e-2 and gaps[-1] < 5e-4, gaps


def test_the_order_of_models_does_not_matter() -> None:
    orders = ([0.5, 1.0, 2.0], [2.0, 0.5, 1.0])
    (one, found), (other, permuted) = driven(
        "storm-wide", 40, *({"delay": 2, "thrust_factors": order} for order in orders)
    )
    np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(found, permuted[..., [1, 2, 0]], atol=1e-9)


def test_memory_holds_weights_and_the_observers() -> None:
    env = StationKeepVectorEnv(1)
    lengths = {name: place.stop - place.start for name, place in AdaptiveDOB(env, delay=2).memory_layout.items()}
    alone = [sum(length for _, length in DOB(env, delay=delay).native.memory_layout) for delay in range(3)]
    assert lengths == {"log_weights": 9, "models": 3 * sum(alone)}


def test_delays_and_factors_are_checked() -> None:
    env = StationKeepVectorEnv(1)
    wrong: list[tuple[Any, str]] = [
        ({"delay": 11}, "delay is 11 control periods, but at most 10 are supported"),
        ({"thrust_factors": [1.0, 0.0, 2.0]}, r"gain thrust_factors is \[1.0, 0.0, 2.0\], but must be above 0"),
        ({"innovation": [0.0, 1.0]}, r"gain innovation is \[0.0, 1.0\], but must be above 0"),
    ]
    for gains, message in wrong:
        with pytest.raises(ValueError, match=message):
            AdaptiveDOB(env, **gains)
