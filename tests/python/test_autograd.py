"""Bindings to torch and JAX: their gradients are differences of their values, and mistakes are refused in one line."""

from typing import Any

import numpy as np
import pytest
from helpers import random_state

from uvms_gym import Simulator, load_scene

pytest.importorskip("torch")

import torch

from uvms_gym.torch import state, step

pytestmark = pytest.mark.learning


def simulator(scene: str, lag: float | None = None, **options: Any) -> Simulator:
    given = load_scene(scene)
    if lag:
        for thruster in given["vehicle"]["thrusters"]:
            thruster.update(lag=lag, ambient_flow=0.4)
    s = Simulator(given, 2, dt=0.02, threads=1, **options)
    s.set_state(**random_state(s))
    if lag:
        s.set_state(thrust=np.linspace(-8.0, 9.0, 2 * s.num_thrusters).reshape(2, -1))
    return s


def arguments(s: Simulator) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Inputs of all kinds, some of one instance, and factors."""
    random = np.random.default_rng(1)
    n, m = s.num_joints, s.num_thrusters
    inputs = {
        "thrust": random.uniform(2.0, 8.0, m),
        "wrench": random.normal(size=(2, 6)),
        "external": 0.1 * random.normal(size=(2, n + 1, 6)),
    }
    if n:
        inputs["joint_torque"] = 0.1 * random.normal(size=(2, n))
        inputs["joint_target"] = random.normal(size=(n, 2))
    if s.scene["vehicle"].get("servo"):
        inputs["pose_target"] = random.normal(size=(2, 7))
    return inputs, {"mass": np.array(1.1), "payload": np.array([0.5, 1.0])}


CASES = (("petasus-pum", None, "mk4"), ("petasus-pum", 0.1, "ros2"), ("bluerov2-heavy", None, "mk4"))


@pytest.mark.parametrize(("scene", "lag", "integrator"), CASES)
def test_gradcheck_of_torch(scene: str, lag: float | None, integrator: str) -> None:
    s = simulator(scene, lag, integrator=integrator)
    inputs, parameters = arguments(s)
    start = state(s)
    start[:, 3:7] *= 1.3  # quaternions need not have length 1
    values = [start, *map(torch.tensor, inputs.values()), *map(torch.tensor, parameters.values())]

    def run(*values: Any) -> Any:
        given = dict(zip(inputs, values[1:], strict=False))
        factors = dict(zip(parameters, values[1 + len(inputs) :], strict=True))
        # Two calls: gradients pass through the state between them.
        middle = step(s, values[0], given, parameters=factors, substeps=2)
        return step(s, middle, given, parameters=factors)

    assert torch.autograd.gradcheck(run, [value.requires_grad_() for value in values], eps=1e-5, atol=1e-7, rtol=1e-6)


def test_steps_in_torch_are_those_of_the_simulator() -> None:
    s, plain = simulator("petasus-pum", 0.1), simulator("petasus-pum", 0.1)
    wrench, before = np.full(6, 3.0), s.__getstate__()
    ends = step(s, state(s), {"wrench": torch.tensor(wrench)}, substeps=3).numpy()
    assert np.array_equal(s.__getstate__(), before)
    plain.step(wrench=wrench, substeps=3)
    n = s.num_joints
    expected = [plain.position, plain.q, plain.twist, plain.qd, plain.thrust]
    np.testing.assert_allclose(np.delete(ends, slice(3, 7), axis=1), np.concatenate(expected, axis=1), atol=1e-13)
    assert ends.shape == (2, s.state_size + 1) == (2, 13 + 2 * n + s.num_thrusters)


def test_gradients_in_single_precision_are_those_in_double_precision_to_rounding() -> None:
    gradients = []
    for dtype in ("float64", "float32"):
        s = simulator("petasus-pum", 0.1, dtype=dtype)
        inputs, parameters = ({k: torch.tensor(v, requires_grad=True) for k, v in d.items()} for d in arguments(s))
        step(s, state(s), inputs, parameters=parameters, substeps=5).square().sum().backward()
        gradients.append([value.grad.numpy() for value in (*inputs.values(), *parameters.values())])
    for double, single in zip(*gradients, strict=True):
        np.testing.assert_allclose(single, double, rtol=1e-4, atol=1e-5 * np.abs(double).max())


def test_mistakes_in_torch_are_refused_in_one_line() -> None:
    s = simulator("bluerov2-heavy")
    good = state(s)
    for value, inputs, message in (
        (good.numpy(), {}, "state must be a torch.Tensor, but is ndarray"),
        (good.float(), {}, "state has dtype torch.float32, but must have torch.float64"),
        (good.to("meta"), {}, "state is on device meta, but must be on the CPU"),
        (good[:1], {}, r"state has shape \(1, 13\), but must have \(13,\) or \(2, 13\)"),
        (good, {"thrust": good[0, :5]}, r"thrust has shape \(5,\), but must have \(8,\) or \(2, 8\)"),
        (good, {"force": good}, "no input 'force': one of external, fin, "),
    ):
        with pytest.raises((TypeError, ValueError), match=f"^{message}") as raised:
            step(s, value, inputs)
        assert "\n" not in str(raised.value)
    with pytest.raises(ValueError, match=r"^mass has shape \(3,\), but must have \(\) or \(2,\)$"):
        step(s, good, parameters={"mass": torch.ones(3, dtype=torch.float64)})
    with pytest.raises(ValueError, match=r"^no parameter 'weight': one of mass, "):
        step(s, good, parameters={"weight": good})


@pytest.mark.parametrize(("scene", "lag", "integrator"), CASES)
def test_gradients_in_jax_are_those_in_torch(scene: str, lag: float | None, integrator: str) -> None:
    jax = pytest.importorskip("jax")
    from uvms_gym import jax as in_jax

    s = simulator(scene, lag, integrator=integrator)
    inputs, parameters = arguments(s)
    tensors = [{k: torch.tensor(v, requires_grad=True) for k, v in d.items()} for d in (inputs, parameters)]
    weights, before = np.random.default_rng(2).normal(size=s.state_size + 1), s.__getstate__()
    end = step(s, state(s), tensors[0], parameters=tensors[1], substeps=2)
    (end @ torch.tensor(weights)).sum().backward()
    s.__setstate__(before)
    with jax.enable_x64(True):

        def cost(inputs: Any, parameters: Any) -> Any:
            end = in_jax.step(s, in_jax.state(s), inputs, parameters=parameters, substeps=2)
            return (end @ weights).sum()

        for found, given in zip(jax.jit(jax.grad(cost, (0, 1)))(inputs, parameters), tensors, strict=True):
            for name, value in given.items():
                np.testing.assert_array_equal(np.asarray(found[name]), value.grad.numpy())
        assert np.array_equal(s.__getstate__(), before)
        with pytest.raises(ValueError, match=r"^state has dtype float32, but must have float64: jax\.config"):
            in_jax.step(s, np.zeros((2, s.state_size + 1), np.float32))
