"""Thrusters with dynamics and fins, from Python."""

import numpy as np
import pytest
from helpers import lagging

from uvms_gym import SceneError, Simulator


def test_thrust_is_a_state_that_follows_its_command() -> None:
    s = Simulator(lagging(), 2, dt=0.01)
    command = np.array([10.0, -5.0, 0.0, 20.0, 1.0, 2.0, 3.0, -30.0])
    s.step(thrust=command, substeps=7)
    np.testing.assert_allclose(s.thrust, np.tile(command * (1.0 - np.exp(-0.7)), (2, 1)), rtol=1e-12)
    s.set_state(thrust=command)
    np.testing.assert_array_equal(s.thrust[1], command)
    s.step(thrust=command)
    np.testing.assert_array_equal(s.thrust[1], command)
    s.set_state(position=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(s.thrust[0], command)
    s.reset()
    assert not s.thrust.any()


def test_a_factor_stretches_the_lag() -> None:
    s = Simulator(lagging(), 3)
    s.scale_parameters(thruster_lag=[1.0, 2.0, 0.0])
    np.testing.assert_array_equal(s.parameters["thruster_lag"], [1.0, 2.0, 0.0])
    s.step(thrust=np.full(8, 30.0), substeps=10)
    np.testing.assert_allclose(s.thrust[:, 0], 30.0 * (1.0 - np.exp([-1.0, -0.5, -np.inf])), rtol=1e-12)


def test_books_have_what_acts_now() -> None:
    s = Simulator(lagging())
    ask = np.full(8, 10.0)
    assert not s.body_wrenches(thrust=ask)["thrust"].any()
    s.set_state(thrust=ask)
    expected = s.thruster_configuration @ ask
    np.testing.assert_allclose(s.body_wrenches()["thrust"][0, 0], expected, atol=1e-12)


def test_thrust_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="have no dynamics"):
        Simulator("bluerov2-heavy").set_state(thrust=np.zeros(8))
    with pytest.raises(ValueError, match=r"thrust 0 of instance 0 is 61 N, but must be within \[-40, 60\]"):
        Simulator(lagging()).set_state(thrust=np.full(8, 61.0))
    with pytest.raises(SceneError, match=r"thruster_lag: is -1\.0, but must be >= 0"):
        Simulator(lagging(-1.0))
    assert not Simulator("bluerov2-heavy").thrust.any()


def test_fins_are_commanded_within_their_limits() -> None:
    s = Simulator("remus-100", 2)
    assert s.num_fins == 6
    assert s.fin_names[0] == "rudder-top"
    np.testing.assert_array_equal(s.fin_limits[[0, -1]], [[-0.237, 0.237], [0.0, 0.0]])
    s.set_state(twist=[1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    lift = s.body_wrenches(fin=np.full((2, 6), 9.0))["fins"]
    np.testing.assert_array_equal(lift, s.body_wrenches(fin=np.full(6, 0.237))["fins"])
    assert np.abs(lift[:, 0, 1]).min() > 1.0
    assert not s.body_wrenches()["fins"].any()
    s.step(fin=np.full(6, 0.1), thrust=[3.0])
    assert (s.twist[:, 5] < 0.0).all()
