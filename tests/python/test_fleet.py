"""Training of the policy for any vehicle: drawn vehicles, the network in torch, gradients, resumption."""

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym.training.vehicles import Vehicle, draw_vehicle

torch = pytest.importorskip("torch")
from uvms_gym.controllers.plant import FEATURES, SEEN  # noqa: E402
from uvms_gym.controllers.universal import UniversalPolicy  # noqa: E402
from uvms_gym.training import fleet  # noqa: E402
from uvms_gym.training.fleet import Fleet, FleetSettings  # noqa: E402
from uvms_gym.training.universal import Sizes, UniversalNet, action_gradient, averages, forward  # noqa: E402

pytestmark = pytest.mark.learning
SMALL = FleetSettings(frames=6400, vehicles=2, episodes=4, spans=(2, 1, 1))


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few gradient steps, and prices from few episodes; sums of torch depend on the number of threads."""
    torch.set_num_threads(1)
    monkeypatch.setattr(fleet, "UPDATES", 20)
    monkeypatch.setattr(fleet, "IMITATED", (2, 64))
    monkeypatch.setattr("uvms_gym.training.recommended.EPISODES", 8)


@pytest.fixture(scope="module")
def drawn() -> list[Vehicle]:
    return [draw_vehicle(7, k) for k in range(40)]


def test_drawn_vehicles_are_new_and_different_ones(drawn: list[Vehicle]) -> None:
    assert draw_vehicle(7, 3) == drawn[3] and draw_vehicle(8, 3).scene != drawn[3].scene
    masses = np.array([one.scene["vehicle"]["body"]["mass"] for one in drawn])
    assert masses.min() < 20.0 and masses.max() > 1000.0
    assert 5 < sum("arm" in one.scene for one in drawn) < 30
    assert {one.env_kwargs["disturbance"]["delay"]["periods"] for one in drawn} >= {1, 2}
    shipped = {uvms_gym.load_scene(name)["vehicle"]["body"]["mass"] for name in uvms_gym.scene_names()}
    assert not shipped & set(masses)


def test_drawn_vehicles_can_be_and_can_keep_station(drawn: list[Vehicle]) -> None:
    for one in drawn[:12]:
        found = uvms_gym.assess_scene(one.scene)
        assert all(axis["alone"] > 0.0 for axis in found["authority"])
        assert not [text for text in uvms_gym.lint_scene(one.scene) if "density" in text]
        body = one.scene["vehicle"]["body"]
        a, b, c = body["inertia"]
        # Moments of inertia of a rigid body.
        assert a + b > c and b + c > a and c + a > b
        envs = gymnasium.make_vec(fleet.ENV, num_envs=4, **one.env_kwargs, **fleet.STEP)
        with fleet.quiet():
            controller = uvms_gym.make_controller("mpc", envs)
            envs.reset(seed=0)
            rollout = uvms_gym.Rollout(envs, controller)
            rollout.run(100)
        assert not rollout.pop_stats().terminated.any()


def test_torch_and_the_shipped_form_have_the_same_actions() -> None:
    run = Fleet(SMALL)
    one = run.vehicles[0]
    episodes = one.run(run.net, [0, 1, 2, 3], torch.zeros((4, 200, 6)))
    seen = averages(episodes.observations, one.plant, run.net.spans).flatten(0, 1)
    out, _ = forward(run.net.weights(torch.from_numpy(one.plant.features).float()), seen)
    actions = out.detach() @ torch.from_numpy(one.plant.acted).float().T
    assert torch.allclose(actions, episodes.actions.flatten(0, 1), atol=1e-5)


def test_val_the_pull_back_is_autograds() -> None:
    net, generator = UniversalNet(Sizes(spans=(2, 1)), 0), torch.Generator().manual_seed(0)
    features = torch.randn((6, len(FEATURES)), generator=generator)
    seen = torch.randn((7, 2, len(SEEN), 6), generator=generator, requires_grad=True)
    out, pull = forward(net.weights(features), seen)
    cotangent = torch.randn((3, 6), generator=generator)
    (expected,) = torch.autograd.grad((out[2:5] * cotangent).sum(), seen)
    assert torch.allclose(pull(slice(2, 5), cotangent), expected[2:5], atol=1e-6)


def test_val_the_gradient_is_the_change_of_the_return(monkeypatch: pytest.MonkeyPatch) -> None:
    """In calm water, by differences of the policy's last weights."""
    run = Fleet(replace(SMALL, episodes=8))
    one, net = run.vehicles[0], run.net
    calm = {**one.kwargs, "disturbance": "calm", "dtype": "float64", "dt": 0.01, "substeps": 10}
    calm["reward"] = {**calm["reward"], "effort": 0.1, "action_rate": 0.1}
    one.envs = fleet.TrainingEnvs(fleet.ENV, calm, 8, sum(net.spans))
    rows, horizon = 8, 12
    by_return = fleet.ReturnGradient(one.envs.inner, rows, 0.9)
    monkeypatch.setattr("uvms_gym.training.return_gradient.OUTLYING", 1e9)
    weight = net.given["out"]

    def run_episodes(frames: bool = False) -> Any:
        return one.run(net, list(range(8)), torch.zeros((8, horizon, 6)), frames=frames)

    episodes = run_episodes(True)
    seen = averages(episodes.observations, one.plant, net.spans)
    windows = torch.arange(rows), torch.zeros(rows, dtype=torch.long)
    factors = by_return.factors(one.envs.inner)
    found = action_gradient(net, one.plant, by_return, episodes, factors, seen, windows, horizon)
    # The return from the first action on has each gradient times its discount.
    discount = 0.9 ** torch.arange(horizon)[:, None, None]
    (expected,) = torch.autograd.grad((found.gradient * discount * found.actions).sum(), weight)
    direction = torch.randn(weight.shape, generator=torch.Generator().manual_seed(1))
    values = []
    for sign in (1.0, -1.0):
        with torch.no_grad():
            weight += sign * 1e-3 * direction
        values.append(float((run_episodes().rewards.double() * 0.9 ** torch.arange(horizon)).sum()))
        with torch.no_grad():
            weight -= sign * 1e-3 * direction
    change = (values[0] - values[1]) / 2e-3
    assert change == pytest.approx(float((expected * direction).sum()), rel=0.02)


def test_a_resumed_run_has_the_bits_of_one_without_a_stop() -> None:
    whole = Fleet(SMALL)
    assert len(list(whole.imitate())) == fleet.ROUNDS
    whole.iterate()
    state = copy.deepcopy(whole.state())
    resumed = Fleet(SMALL, state)
    for run in (whole, resumed):
        run.iterate()
    assert whole.steps == resumed.steps == 3200
    for name, array in whole.net.arrays().items():
        np.testing.assert_array_equal(array, resumed.net.arrays()[name])
    assert not np.array_equal(whole.net.arrays()["out"], state["net"]["given.out"].numpy())


def test_a_longer_memory_begins_with_the_same_actions(tmp_path: Path) -> None:
    short = UniversalNet(Sizes(spans=(2, 1)), 0)
    policy = short.policy(np.array([np.full(len(FEATURES), x) for x in (-9.0, 9.0)]), {"conditions": "{}"})
    policy.save(tmp_path / "start.safetensors")
    longer = UniversalNet(Sizes(spans=(4, 2, 1)), 1)
    longer.load(UniversalPolicy.load(tmp_path / "start.safetensors"))
    seen = torch.randn((5, 3, len(SEEN), 6))
    features = torch.randn((6, len(FEATURES)))
    one, _ = forward(short.weights(features), seen[:, 1:])
    other, _ = forward(longer.weights(features), seen)
    assert torch.allclose(one, other, atol=1e-6)
    with pytest.raises(ValueError, match=r"averages are \(2, 1\), but must be the last of \(2, 2\)"):
        UniversalNet(Sizes(spans=(2, 2)), 0).load(policy)
    with pytest.raises(ValueError, match=r"mix_.* has shape"):
        UniversalNet(Sizes(spans=(2, 1), mix_units=5), 0).load(policy)
