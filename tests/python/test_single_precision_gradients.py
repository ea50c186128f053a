"""Derivatives of steps in single precision equal derivatives in double precision from the same state."""

from typing import Any

import numpy as np
import pytest
from helpers import is_fixed
from test_gradients import PARAMETERS, case, moving, scenes

from uvms_gym import Simulator


def in_double(single: Simulator, scene: dict[str, Any], options: dict[str, Any]) -> Simulator:
    """A simulator in double precision in the states and with the factors of one in single precision."""
    double = Simulator(scene, single.num_envs, **options | {"dtype": "float64"})
    parts = ["position", "rotation", "q", "qd", "current", "current_acceleration"]
    parts += [] if is_fixed(single) else ["twist"]
    parts += ["thrust"] if single.state_size > 12 + 2 * single.num_joints else []
    double.set_state(**{name: getattr(single, name) for name in parts})
    double.scale_parameters(**single.parameters)
    return double


def derivatives(s: Simulator, inputs: dict[str, Any]) -> list[np.ndarray]:
    """Jacobians and products of three steps."""
    arguments: dict[str, Any] = inputs | {"substeps": 3, "parameters": PARAMETERS}
    jacobians, random = s.step_jacobians(**arguments), np.random.default_rng(3)
    tangents = {name: random.normal(size=jacobian.shape[2]) for name, jacobian in jacobians.items()}
    cotangents = s.step_vjp(random.normal(size=s.state_size), **arguments)
    return [*jacobians.values(), *cotangents.values(), s.step_jvp(tangents, **arguments)]


@pytest.mark.parametrize("integrator", ["mk4", "mk54", "ros2"])
@pytest.mark.parametrize("name", scenes())
def test_derivatives_equal_derivatives_in_double_precision(name: str, integrator: str) -> None:
    scene, options = scenes()[name], {"integrator": integrator, "dtype": "float32", "tolerance": 1e-5}
    s, _, inputs = case(scene, options, 3)
    rows = {key: value[None] for key, value in inputs.items()}
    # A state that is set and one after steps; those plan the sub-intervals of adaptive integrators.
    for moved in (False,) if integrator == "mk54" else (False, True):
        if moved:
            s.step(substeps=20)
        before = s.__getstate__()
        found = derivatives(s, rows)
        assert np.array_equal(s.__getstate__(), before)
        for got, expected in zip(found, derivatives(in_double(s, scene, options), rows), strict=True):
            assert np.array_equal(got, expected)


def test_the_minimum_tolerance_is_the_limit_of_single_precision() -> None:
    found = []
    for tolerance in (1e-9, 8 * 2.0**-23):
        options = {"integrator": "mk54", "dt": 0.2, "tolerance": tolerance}
        s, inputs = moving(3, dtype="float32", **options)
        found.append(s.step_jacobians(**inputs)["state"])
    assert np.array_equal(*found)


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_states_that_are_lost_have_no_derivatives_and_the_copy_counts_as_memory() -> None:
    s, inputs = moving(3, dtype="float32", error_estimate=False)
    memory, twist = s.bytes_per_env, s.twist
    twist[1] = 1e30
    s.set_state(twist=twist)
    s.step()
    jacobian = s.step_jacobians(**inputs)["state"]
    assert np.array_equal(np.isnan(jacobian).any(axis=(1, 2)), [False, True, False])
    assert np.isfinite(jacobian[[0, 2]]).all()
    assert s.bytes_per_env == memory + moving(3, error_estimate=False)[0].bytes_per_env
