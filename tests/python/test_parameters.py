"""`Simulator.scale_parameters`: instances that differ in mass, added mass, drag and volume."""

import numpy as np
import pytest
from helpers import assert_same, state_of

from uvms_gym import Simulator

NAMES = ["mass", "added_mass", "linear_damping", "quadratic_damping", "volume", "payload", "thrust", "thruster_lag"]
NEUTRAL = {name: float(name != "payload") for name in NAMES}


def test_parameters_start_at_one_and_stay_through_reset() -> None:
    s = Simulator("petasus-pum", 3)
    assert list(s.parameters) == NAMES
    assert all((factor == NEUTRAL[name]).all() for name, factor in s.parameters.items())
    s.scale_parameters(mass=[0.9, 1.0, 1.1], volume=1.05)
    s.reset()
    assert np.array_equal(s.parameters["mass"], [0.9, 1.0, 1.1])
    assert np.array_equal(s.parameters["volume"], [1.05] * 3)
    s.scale_parameters(mass=1.0, volume=1.0)
    assert all((factor == NEUTRAL[name]).all() for name, factor in s.parameters.items())


def test_weak_thrusters_give_less() -> None:
    full, weak = Simulator("bluerov2-heavy", 2), Simulator("bluerov2-heavy", 2)
    weak.scale_parameters(thrust=[1.0, 0.5])
    thrust = np.tile(np.linspace(4.0, 11.0, 8), (2, 1))
    weak.step(thrust=thrust, substeps=20)
    thrust[1] *= 0.5
    full.step(thrust=thrust, substeps=20)
    assert_same(state_of(weak), state_of(full))


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"mass": 0.0}, "mass of instance 0 is 0"),
        ({"mass": -1.0}, "mass of instance 0 is -1"),
        ({"volume": [1.0, np.nan]}, "volume of instance 1 is NaN"),
        ({"linear_damping": [1.0, 2.0, 3.0]}, r"linear_damping has shape \(3,\)"),
    ],
)
def test_bad_factors_change_nothing(factors: dict[str, object], words: str) -> None:
    s = Simulator("petasus-pum", 2)
    s.scale_parameters(added_mass=1.1)
    with pytest.raises(ValueError, match=words):
        s.scale_parameters(quadratic_damping=2.0, **factors)
    assert (s.parameters["added_mass"] == 1.1).all()
    assert (s.parameters["quadratic_damping"] == 1.0).all()
