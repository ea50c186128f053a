"""Sizes of all noises and biases of the sensors, by many instances at rest."""

import math
from typing import Any

import numpy as np
import pytest

from uvms_gym import Sensors, Simulator

N = 4000
#: Standard deviations in docs/sensors.md: biases of an episode, and noise of a reading.
BIASES = {"imu": [0.02] * 3 + [1e-3] * 3, "depth": [0.02], "heading": [0.035]}
NOISES = {"depth": ("depth", [0.002]), "heading": ("heading", [0.01]), "dvl": ("beams", [0.005] * 4)}


def read(suite: Any, position: Any = (0.0, 0.0, -5.0), **state: Any) -> tuple[dict[str, Any], Sensors]:
    """First readings of vehicles at rest."""
    simulator = Simulator("free-body", N)
    simulator.set_state(position=position, **state)
    sensors = Sensors(simulator, suite, seed=3)
    return sensors.measure(simulator), sensors


def assert_deviation(values: Any, expected: Any) -> None:
    """Standard deviations of columns, and means of 0, within five of their own deviations."""
    values, expected = np.asarray(values), np.asarray(expected)
    assert np.all(np.abs(values.std(axis=0) / expected - 1.0) < 5.0 / math.sqrt(2 * len(values)))
    assert np.all(np.abs(values.mean(axis=0)) < 5.0 * expected / math.sqrt(len(values)))


@pytest.mark.parametrize("name", BIASES)
def test_biases_of_an_episode_have_their_size(name: str) -> None:
    _, sensors = read([name])
    assert_deviation(sensors.biases()[name], BIASES[name])


@pytest.mark.parametrize("name", NOISES)
def test_noise_of_a_reading_has_its_size(name: str) -> None:
    key, expected = NOISES[name]
    found, sensors = read([name])
    true = {"depth": 5.0, "heading": 0.0, "dvl": 0.0}[name] + sensors.biases().get(name, np.zeros((N, 1)))
    values = (found[name][key] - true)[np.isfinite(found[name][key]).all(axis=1)]
    assert len(values) > 0.8 * N
    assert_deviation(values, expected)


def test_biases_are_in_the_readings() -> None:
    quiet = {"depth": {"noise": 0.0}, "heading": {"noise": 0.0}}
    found, sensors = read(quiet)
    for name, true in (("depth", 5.0), ("heading", 0.0)):
        np.testing.assert_allclose(found[name][name], true + sensors.biases()[name], atol=1e-12)


def test_fixes_have_the_noise_outliers_and_losses_of_their_settings() -> None:
    truth = [0.0, 0.0, -5.0]
    fixes, _ = read({"acoustic": {"delay": 0.0, "vertical_noise": 0.6, "outliers": 0.0}})
    here = fixes["acoustic"]["valid"]
    assert abs(here.mean() - 0.95) < 5.0 * math.sqrt(0.05 * 0.95 / N)
    assert_deviation(fixes["acoustic"]["position"][here] - truth, [0.3, 0.3, 0.6])
    fixes, _ = read({"acoustic": {"delay": 0.0, "noise": 0.0, "vertical_noise": 0.0, "outliers": 0.2, "dropout": 0.0}})
    apart = fixes["acoustic"]["position"] - truth
    wild = np.abs(apart).max(axis=1) > 1e-9
    assert abs(wild.mean() - 0.2) < 5.0 * math.sqrt(0.2 * 0.8 / N)
    assert_deviation(apart[wild], [5.0] * 3)
    fixes, _ = read({"acoustic": {"delay": 0.0, "noise": 0.0, "vertical_noise": 0.0, "dropout": 0.0}})
    wild = np.abs(fixes["acoustic"]["position"] - truth).max(axis=1) > 1e-9
    assert abs(wild.mean() - 0.02) < 5.0 * math.sqrt(0.02 * 0.98 / N)


def test_a_dvl_near_the_bottom_has_no_reading_and_its_axes_turn_with_its_mounting() -> None:
    quiet = {"noise": 0.0, "beam_dropout": 0.0}
    heights = np.linspace(0.01, 0.2, N)
    position = np.column_stack([np.zeros((N, 2)), heights - 10.0])
    found, _ = read({"dvl": quiet}, position)
    # The range along a beam is the altitude over the cosine of its angle.
    np.testing.assert_array_equal(np.isfinite(found["dvl"]["velocity"][:, 0]), heights / math.cos(0.4363) >= 0.05)
    twist = [0.3, -0.2, 0.1, 0.0, 0.0, 0.0]
    found, _ = read({"dvl": {**quiet, "rpy": [0.0, 0.0, math.pi / 2]}}, twist=twist)
    np.testing.assert_allclose(found["dvl"]["velocity"][0], [-0.2, -0.3, 0.1], atol=1e-12)
