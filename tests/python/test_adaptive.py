"""Adaptive controllers: the bank finds delay and thrust from innovations; with models alike it is one model."""

import re
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers import run
from numpy.typing import NDArray

from uvms_gym.controllers import DOB, AdaptiveDOB, AdaptiveResolvedMotion, ResolvedMotion
from uvms_gym.envs import EETrackVectorEnv, StationKeepVectorEnv


class Bank(NamedTuple):
    """Adaptive controller; with one model; its environment; gains that stand a delay of 0.3 s; gains of `SHARP`."""

    kind: Any
    one: Any
    env: Any
    calm: dict[str, Any]
    innovation: list[float]


STATION = Bank(AdaptiveDOB, DOB, StationKeepVectorEnv, {}, [0.001, 0.003])
CALM: Any = {"pose_gain": 1.0, "twist_gain": 2.5, "joint_gain": 4.0}
TRACK = Bank(AdaptiveResolvedMotion, ResolvedMotion, EETrackVectorEnv, CALM, [0.0005, 0.0015, 0.0015])
BANKS = pytest.mark.parametrize("bank", [STATION, TRACK], ids=["station-keep", "ee-track"])
ALIKE: Any = {"thrust_factors": [1.0] * 3}


def sharp(bank: Bank) -> dict[str, Any]:
    """Gains for a vehicle that is the nominal model but for its thrust or delay, under sensors without noise."""
    return {"innovation": bank.innovation, "memory_time": 0.0, **bank.calm}


def make(bank: Bank, n: int, disturbance: Any, **options: Any) -> Any:
    common: Any = {"dt": 0.01, "substeps": 10, "thruster_lag": 0.1, "max_episode_steps": None}
    return bank.env(n, disturbance=disturbance, **{**common, **options})


def driven(
    bank: Bank, disturbance: Any, steps: int, *gains: Any
) -> list[tuple[NDArray[np.float32], NDArray[np.float64]]]:
    """Last actions of controllers and their models' probabilities, in episodes of the first one."""
    env = make(bank, 8, disturbance, **({"reference": "spline"} if bank is TRACK else {}))
    controllers = [bank.kind(env, **given) for given in gains]
    observation, _ = env.reset(seed=1)
    results: list[Any] = [(None, None)] * len(gains)
    for _ in range(steps):
        results = [c.predict(observation, state) for c, (_, state) in zip(controllers, results, strict=True)]
        observation, *_ = env.step(results[0][0])
    return [(action, c.probabilities(state)) for c, (action, state) in zip(controllers, results, strict=True)]


def storm(delay: int) -> dict[str, Any]:
    return {"base": "storm-wide", "delay": {"time": [0.1 * delay, 0.1 * delay]}}


def still_arm(delay: int) -> dict[str, Any]:
    return {"delay": {"periods": delay}, "arm": {"amplitude": 0.0}}


@pytest.mark.parametrize(
    ("bank", "delays", "disturbance", "steps", "gains", "sure"),
    [
        (STATION, (0, 1, 3), storm, 25, {}, True),
        (STATION, (0, 2), still_arm, 60, {**ALIKE, **sharp(STATION)}, None),
        (TRACK, (0, 1, 2, 3), lambda delay: {"delay": {"periods": delay}}, 90, {**ALIKE, **sharp(TRACK)}, True),
        (TRACK, (0, 1, 2, 3), storm, 60, CALM, False),
    ],
    ids=["by the arm", "without arm", "by the model", "in a storm"],
)
def test_the_delay_is_found(bank: Bank, delays: Any, disturbance: Any, steps: int, gains: Any, sure: Any) -> None:
    for delay in delays:
        [(_, found)] = driven(bank, disturbance(delay), steps, {"delay": 3, **gains})
        by_delay = found.sum(axis=-1)
        right = by_delay.argmax(axis=-1) == delay
        assert right.mean() > 0.8 if sure is False else right.all(), by_delay
        assert sure is not True or (by_delay[:, delay] > 0.99).all(), by_delay


@pytest.mark.parametrize(("factor", "place"), [(0.5, 0), (1.0, 1), (2.0, 2)])
@pytest.mark.parametrize(("bank", "delay"), [(STATION, 0), (TRACK, 0), (TRACK, 2)])
def test_the_thrust_is_found(bank: Bank, delay: int, factor: float, place: int) -> None:
    disturbance = {"parameters": {"thrust": [factor, factor]}, "delay": {"periods": delay}}
    gains = {"delay": 3 if bank is TRACK else 0, "thrust_factors": [0.5, 1.0, 2.0], **sharp(bank)}
    [(_, found)] = driven(bank, disturbance, 90 if bank is TRACK else 60, gains)
    assert (found[:, delay, place] > 0.99).all(), found


@BANKS
def test_models_weigh_the_same_before_all_have_predicted_a_measurement(bank: Bank) -> None:
    (_, before), (_, after) = (driven(bank, "storm-wide", steps, {"delay": 3})[0] for steps in (4, 5))
    np.testing.assert_allclose(before, np.full((8, 4, 3), 1.0 / 12.0), rtol=1e-12)
    assert (np.ptp(after, axis=(1, 2)) > 0.0).all()


@pytest.mark.parametrize(("bank", "delay"), [(STATION, 0), (STATION, 2), (TRACK, 0), (TRACK, 1), (TRACK, 2)])
def test_models_alike_are_one_model(bank: Bank, delay: int) -> None:
    """Factors of 1 change nothing; the true delay is found after a start under the mean of models."""
    if bank is STATION:
        gains: Any = {"acceleration_noise": [0.3, 1.0], "prediction_horizon": 0.05}
        own: Any = {"delay_schedule": [0.0] * 2, "joint_innovation": [1e-3, 5e-3]}
    else:
        gains = {**CALM, "observer_bandwidth": [4.0, 4.0, 8.0], "lag_compensation": 0.5}
        own = {"innovation": [0.1, 0.2, 0.005]}
    disturbance = {"base": "storm", "delay": {"periods": delay}, **({} if bank is STATION else {"noise": None})}
    envs = [make(bank, 8, disturbance) for _ in range(2)]
    controllers = [bank.kind(envs[0], **ALIKE, **own, **gains), bank.one(envs[1], delay=None, **gains)]
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
        assert max(gaps) > 1e-2 and gaps[-1] < (5e-4 if bank is STATION else 2e-3), gaps


def test_the_order_of_models_does_not_matter() -> None:
    orders = ([0.5, 1.0, 2.0], [2.0, 0.5, 1.0])
    (one, found), (other, permuted) = driven(
        STATION, "storm-wide", 40, *({"delay": 2, "thrust_factors": order} for order in orders)
    )
    np.testing.assert_allclose(one, other, atol=1e-6)
    np.testing.assert_allclose(found, permuted[..., [1, 2, 0]], atol=1e-9)


def test_gains_decrease_with_the_delay() -> None:
    (plain, _), (scheduled, _) = driven(TRACK, "storm-wide", 1, {"delay": 0}, {"delay": 0, "delay_schedule": [5.0] * 2})
    np.testing.assert_array_equal(plain, scheduled)
    (plain, _), (scheduled, _) = driven(TRACK, "storm-wide", 1, {"delay": 3}, {"delay": 3, "delay_schedule": [5.0] * 2})
    assert np.square(scheduled).sum() < np.square(plain).sum()


def test_a_command_is_what_a_model_asks_for_over_its_factor() -> None:
    gains: Any = {"delay": 0, **CALM}
    (one, _), (two, _) = driven(TRACK, None, 1, {**gains, **ALIKE}, {**gains, "thrust_factors": [2.0] * 3})
    within = np.abs(one[:, :6]) < 1.0
    assert within.any() and np.abs(one[:, :6][within]).max() > 0.01
    np.testing.assert_allclose(2.0 * two[:, :6][within], one[:, :6][within], rtol=1e-5, atol=1e-7)
    np.testing.assert_array_equal(two[:, 6:], one[:, 6:])


def test_memory_has_weights_and_models() -> None:
    def lengths(bank: Bank) -> dict[str, int]:
        layout = bank.kind(make(bank, 1, None), delay=2).memory_layout
        return {name: place.stop - place.start for name, place in layout.items()}

    env = StationKeepVectorEnv(1)
    alone = [sum(length for _, length in DOB(env, delay=delay).native.memory_layout) for delay in range(3)]
    assert lengths(STATION) == {"log_weights": 9, "models": 3 * sum(alone)}
    assert lengths(TRACK) == {"log_weights": 9, "periods": 1, "models": 9 * (11 + 11 + 6), "efforts": 2 * 11}


def test_it_errs_less_than_one_model_on_vehicles_known_poorly() -> None:
    env = make(TRACK, 32, "storm-wide", max_episode_steps=120)

    def error(controller: Any) -> float:
        stats = run(env, controller, 120, seed=11)
        squares = stats.squares["position_error"] + stats.squares["attitude_error"] / 4
        return float(np.median(np.sqrt(squares / stats.steps)))

    gains: Any = {**CALM, "observer_bandwidth": [4.0, 4.0, 8.0]}
    assert error(AdaptiveResolvedMotion(env, **gains)) < 0.9 * error(ResolvedMotion(env, **gains, delay=2))


BAD: list[tuple[Any, str]] = [
    ({"delay": 11}, "delay is 11 control periods, but at most 10 are supported"),
    ({"thrust_factors": [1.0, 0.0, 2.0]}, "gain thrust_factors is [1.0, 0.0, 2.0], but must be above 0"),
    ({"thrust_factors": [1.0, 2.0]}, "gain thrust_factors is [1.0,2.0], but must be 3 numbers"),
    ({"memory_time": -1.0}, "gain memory_time"),
    ({"delay_schedule": [0.0, float("nan")]}, "gain delay_schedule[1]"),
]


@pytest.mark.parametrize(
    ("bank", "gains", "message"),
    [
        *((bank, *row) for bank in (STATION, TRACK) for row in BAD),
        (STATION, {"innovation": [0.0, 1.0]}, "gain innovation is [0.0, 1.0], but must be above 0"),
        (TRACK, {"innovation": [0.1, 0.0, 1.0]}, "gain innovation is [0.1, 0.0, 1.0], but must be above 0"),
        (TRACK, {"pose_gain": -1.0}, "gain pose_gain"),
    ],
)
def test_gains_that_cannot_be_are_refused(bank: Bank, gains: Any, message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        bank.kind(make(bank, 1, None), **gains)


def test_states_and_tasks_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="state has shape"):
        AdaptiveResolvedMotion(make(TRACK, 1, None)).probabilities(np.zeros(3))
    refusal = "is for UVMS-EETrack and UVMS-Button and UVMS-Valve, not for UVMS-StationKeep; controllers of"
    with pytest.raises(ValueError, match=refusal):
        AdaptiveResolvedMotion(scene="petasus-pum", task="station-keep")
