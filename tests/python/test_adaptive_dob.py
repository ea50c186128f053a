"""Adaptive DOB: the bank tells delay and thrust from innovations; with models alike it is the DOB."""

from typing import Any

import numpy as np
import pytest

from uvms_gym.controllers import DOB, AdaptiveDOB
from uvms_gym.envs.station_keep import StationKeepVectorEnv

#: Innovations of a vehicle that is the nominal model but for its thrust or delay, under sensors without noise.
SHARP = {"innovation": [0.01, 0.03], "memory_time": 0.0}


def driven(disturbance: Any, *controllers: Any, steps: int, seed: int = 1, envs: int = 8) -> tuple[list[Any], list[Any]]:
    """Actions and state of each controller at the end, where the first one acts."""
    env = StationKeepVectorEnv(envs, disturbance=disturbance, substeps=10, thruster_lag=0.1, max_episode_steps=None)
    made = [make(env) for make in controllers]
    observation, _ = env.reset(seed=seed)
    states: list[Any] = [None] * len(made)
    actions: list[Any] = states[:]
    for _ in range(steps):
        for k, controller in enumerate(made):
            actions[k], states[k] = controller.predict(observation, states[k])
        observation, *_ = env.step(actions[0])
    return actions, [controller.probabilities(s) if hasattr(controller, "probabilities") else s for controller, s in
                     zip(made, states, strict=True)]


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_arm_tells_the_delay(delay: int) -> None:
    storm = {"base": "storm-wide", "delay": {"periods": delay}}
    _, (found,) = driven(storm, lambda env: AdaptiveDOB(env, delay=3), steps=25)
    assert (found.sum(axis=-1)[:, delay] > 0.95).all(), found.sum(axis=-1)


@pytest.mark.parametrize("delay", [0, 2])
def test_the_vehicle_alone_tells_the_delay(delay: int) -> None:
    calm = {"delay": {"periods": delay}, "arm": {"amplitude": 0.0}}
    _, (found,) = driven(calm, lambda env: AdaptiveDOB(env, delay=3, thrust_factors=[1.0] * 3, **SHARP), steps=60)
    assert (found.sum(axis=-1)[:, delay] > 0.9).all(), found.sum(axis=-1)


@pytest.mark.parametrize(("factor", "place"), [(0.5, 0), (1.0, 1), (2.0, 2)])
def test_the_vehicle_tells_its_thrust(factor: float, place: int) -> None:
    calm = {"parameters": {"thrust": [factor, factor]}}
    _, (found,) = driven(calm, lambda env: AdaptiveDOB(env, **SHARP), steps=60)
    assert (found.argmax(axis=-1) == place).all() and (found[..., place] > 0.9).all(), found


def test_without_excitation_no_model_is_preferred() -> None:
    """Weights are equal before all models have predicted a measurement."""
    _, (found,) = driven("storm-wide", lambda env: AdaptiveDOB(env, delay=3), steps=4)
    np.testing.assert_array_equal(found, np.full((8, 4, 3), 1.0 / 12.0))


@pytest.mark.parametrize("delay", [0, 2])
def test_with_models_alike_it_is_the_dob(delay: int) -> None:
    """One delay has all the probability when the arm tells it; factors of 1 change nothing."""
    gains: Any = {"acceleration_noise": [0.3, 1.0], "prediction_horizon": 0.05}
    (bank, alone), (found, _) = driven(
        {"base": "storm", "delay": {"periods": delay}},
        lambda env: AdaptiveDOB(
            env, thrust_factors=[1.0] * 3, delay_schedule=[0.0, 0.0], joint_innovation=[1e-3, 5e-3], **gains
        ),
        lambda env: DOB(env, delay=None, **gains),
        steps=60,
    )
    assert (found.sum(axis=-1)[:, delay] > 1.0 - 1e-6).all()
    np.testing.assert_allclose(bank, alone, atol=1e-5)


def test_the_order_of_models_does_not_matter() -> None:
    orders = ([0.5, 1.0, 2.0], [2.0, 0.5, 1.0])
    makers = [lambda env, order=order: AdaptiveDOB(env, delay=2, thrust_factors=order) for order in orders]
    (one, other), (found, permuted) = driven("storm-wide", *makers, steps=40)
    np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(found, permuted[..., [1, 2, 0]], atol=1e-9)


def test_delays_and_factors_are_checked() -> None:
    env = StationKeepVectorEnv(1)
    for gains, message in (
        ({"delay": 11}, "delay is 11 control periods, but at most 10 are supported"),
        ({"thrust_factors": [1.0, 0.0, 2.0]}, r"gain thrust_factors is \[1.0, 0.0, 2.0\], but must be above 0"),
        ({"innovation": [0.0, 1.0]}, r"gain innovation is \[0.0, 1.0\], but must be above 0"),
    ):
        with pytest.raises(ValueError, match=message):
            AdaptiveDOB(env, **gains)
