"""Steps: instruction sets, calls and their parts, targets. (Interruption: test_interrupts.py.)"""

import itertools
import os
import subprocess
import sys

import numpy as np
import pytest
from helpers import assert_same, moving, random_inputs, state_of, unchanged

from uvms_gym import Simulator, scene_names

DTYPES = ["float64", "float32"]


@pytest.mark.parametrize(
    ("name", "error"), [("mmx", 'ValueError: UVMS_INSTRUCTION_SET="mmx": this machine offers'), ("", "")]
)
def test_unknown_lanes_are_refused_and_an_empty_name_counts_as_none(name: str, error: str) -> None:
    command = [sys.executable, "-c", "import uvms_gym; uvms_gym.Simulator('free-body', 2).step()"]
    environment = os.environ | {"UVMS_INSTRUCTION_SET": name}
    result = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert result.returncode == bool(error)
    assert error in result.stderr and bool(result.stderr) == bool(error)


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")  # Euler's method errs by percents.
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("integrator", ["mk4", "mk1", "quaternion-rk4"])
@pytest.mark.parametrize("name", scene_names())
def test_ten_substeps_are_ten_steps(name: str, integrator: str, dtype: str) -> None:
    a, b = (moving(name, integrator=integrator, dtype=dtype) for _ in range(2))
    inputs = random_inputs(a)
    if "joint_target" in inputs:
        inputs["joint_target"] = inputs["joint_target"][:, :, 0]
    a.step(**inputs, substeps=10)
    for _ in range(10):
        b.step(**inputs)
    assert_same(state_of(a), state_of(b))


def test_parts_of_long_calls_make_no_difference() -> None:
    """1000 instances are interrupted for signals every 65 steps, one instance is not: nor does its target's clock."""
    many, one = moving("petasus-pum", 1000), moving("petasus-pum", 1)
    target = np.zeros((1, 5, 4))
    target[0, :, 1:] = [0.1, 0.2, -0.1]
    many.step(joint_target=np.repeat(target, 1000, axis=0), substeps=150)
    one.step(joint_target=target, substeps=150)
    assert_same({part: value[:1] for part, value in state_of(many).items()}, state_of(one))


def test_a_target_is_a_polynomial_in_the_time_since_the_call() -> None:
    s = Simulator("petasus-pum", dt=0.001)
    s.set_state(time=100.0)
    target = np.zeros((1, 5, 4))
    target[0, 2] = [0.55, 0.2, -0.3, 0.4]
    q, qd = s.q[0, 2], s.qd[0, 2]
    servo = s.scene["arm"]["links"][2]["joint"]["servo"]
    command = s.joint_torques(joint_target=target)["command"][0, 2]
    assert command == pytest.approx(servo["kp"] * (0.55 - q) + servo["kd"] * (0.2 - qd), rel=1e-12)
    position = Simulator("petasus-pum")
    assert np.array_equal(
        position.joint_torques(joint_target=target[:, :, 0])["command"],
        position.joint_torques(joint_target=target[:, :, :1])["command"],
    )


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("num_envs", [1, 20])
@pytest.mark.parametrize("integrator", ["mk4", "mk54", "ros2"])
def test_a_target_of_fewer_terms_is_one_that_ends_in_zeros(integrator: str, num_envs: int, dtype: str) -> None:
    """Constants and lines take a way of their own."""
    states = []
    target = np.tile([0.1, 0.2, -0.3, 0.4], (num_envs, 5, 1))
    for terms in (1, 2, 3):
        short, long = (moving("petasus-pum", num_envs, integrator=integrator, dtype=dtype) for _ in range(2))
        short.step(joint_target=target[:, :, :terms], substeps=20)
        long.step(joint_target=np.where(np.arange(4) < terms, target, 0.0), substeps=20)
        assert_same(state_of(short), state_of(long))
        states.append(short.q)
    assert all(np.abs(a - b).max() > 1e-4 for a, b in itertools.pairwise(states))


@pytest.mark.parametrize("dtype", DTYPES)
def test_time_is_the_sum_of_steps(dtype: str) -> None:
    s = Simulator("free-body", dt=0.01, dtype=dtype)
    s.set_state(time=1000.0)
    s.step(substeps=100_000)
    s.step()
    assert s.time[0] == pytest.approx(1000.0 + 100_001 * float(np.dtype(dtype).type(0.01)), rel=1e-14)


def test_forward_dynamics_is_what_a_small_step_does() -> None:
    for name in scene_names():
        s = moving(name, dt=1e-7, integrator="mk1")
        inputs, before = random_inputs(s), state_of(s)
        with unchanged(s):
            a = s.forward_dynamics(**inputs)
        s.step(**inputs)
        rates = np.hstack([s.twist - before["twist"], s.qd - before["qd"]]) / 1e-7
        assert np.allclose(rates, a, rtol=1e-6, atol=1e-6 * np.abs(a).max()), name


@pytest.mark.parametrize("integrator", ["mk4", "rk4-normalise"])
def test_steady_travel_in_single_precision_gathers_no_rounding(integrator: str) -> None:
    s = Simulator("free-body", 32, dt=0.001, dtype="float32", integrator=integrator)
    rng = np.random.default_rng(0)
    current = rng.uniform(-0.3, 0.3, (32, 3))
    twist = np.zeros((32, 6))
    twist[:, :3] = rng.uniform(-0.5, 0.5, (32, 3))
    s.set_state(twist=twist, current=current)
    travelled = 10.0 * s.twist[:, :3]
    s.step(substeps=10_000)
    # Every step adds the same number to the position, and so rounds the same way: uncompensated, up to 1e-3 m in all.
    np.testing.assert_allclose(s.position, travelled, rtol=0, atol=1e-4)
