"""Instances that differ: each is the simulator of its own scene, or has factors of `Simulator.scale_parameters`."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from helpers import assert_same, state_of

from uvms_gym import SceneError, Simulator, load_scene
from uvms_gym.envs import StationKeepEnv, StationKeepVectorEnv

MASS, FRICTION, ADDED = "vehicle.body.mass", "arm.links[0].joint.friction.viscous", "vehicle.body.added_mass"
ROTOR = "arm.links[0].joint.rotor_inertia"
N = 11


def parameters(n: int = N, scene: str = "petasus-pum") -> dict[str, np.ndarray]:
    """Values around the numbers of the scene."""
    random, nominal = np.random.default_rng(1), load_scene(scene)
    body, link = nominal["vehicle"]["body"], nominal["arm"]["links"][0]
    factors = random.uniform(0.8, 1.2, (n, 8))
    return {
        MASS: body["mass"] * factors[:, 0],
        FRICTION: link["joint"]["friction"]["viscous"] * factors[:, 1],
        ADDED: np.array(body["added_mass"]) * factors[:, 2:],
    }


def scenes() -> list[dict[str, Any]]:
    """The same by hand."""
    values, all_scenes = parameters(), []
    for i in range(N):
        scene = load_scene("petasus-pum")
        scene["vehicle"]["body"]["mass"] = values[MASS][i]
        scene["vehicle"]["body"].pop("weight", None)
        scene["vehicle"]["body"]["added_mass"] = values[ADDED][i].tolist()
        scene["arm"]["links"][0]["joint"]["friction"]["viscous"] = values[FRICTION][i]
        for link in scene["arm"]["links"]:
            link["body"].pop("weight", None)
        all_scenes.append(scene)
    return all_scenes


def test_parameters_are_the_scenes_by_hand() -> None:
    thrust = np.random.default_rng(2).uniform(-20, 20, (N, Simulator("petasus-pum").num_thrusters))
    batch, by_hand = Simulator("petasus-pum", parameters=parameters()), Simulator(scenes())
    assert batch.num_envs == N
    assert [scene["vehicle"]["body"]["mass"] for scene in batch.scenes] == parameters()[MASS].tolist()
    assert np.array_equal(batch.forward_dynamics(thrust=thrust), by_hand.forward_dynamics(thrust=thrust))
    for s in (batch, by_hand):
        s.step(thrust=thrust, substeps=7)
    assert_same(state_of(batch), state_of(by_hand))
    single = Simulator(scenes()[3])
    single.step(thrust=thrust[3], substeps=7)
    assert np.array_equal(batch.twist[3], single.twist[0])


def test_homes_and_currents_are_their_own() -> None:
    keys = {"arm.links[1].joint.home": [0.1, 0.2], "water.current": [[0.1, 0, 0], [0, 0.2, 0]]}
    s = Simulator("petasus-pum", parameters=keys)
    for _ in range(2):
        joint = s.joint_names.index(load_scene("petasus-pum")["arm"]["links"][1]["name"])
        assert s.q[:, joint].tolist() == [0.1, 0.2]
        assert s.current.tolist() == [[0.1, 0, 0], [0, 0.2, 0]]
        s.step()
        s.reset()


def test_copies_and_pickles_keep_their_scenes() -> None:
    s = Simulator(scenes())
    s.step(substeps=3)
    for twin in (copy.copy(s), pickle.loads(pickle.dumps(s))):
        assert twin.scenes == s.scenes
        twin.step(substeps=3)
        reference = copy.copy(s)
        reference.step(substeps=3)
        assert_same(state_of(twin), state_of(reference))


def test_parameters_of_equal_values_give_one_scene() -> None:
    scene = load_scene("petasus-pum")
    same = Simulator("petasus-pum", parameters={MASS: np.full(3, scene["vehicle"]["body"]["mass"])})
    plain = Simulator("petasus-pum", 3)
    same.step(substeps=3)
    plain.step(substeps=3)
    assert_same(state_of(same), state_of(plain))


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        ({"parameters": {"vehicle.body.mas": [1.0, 2.0]}}, SceneError, ["vehicle.body.mas", MASS]),
        ({"parameters": {"arm.links[9].body.mass": [1.0]}}, SceneError, ["arm.links[9].body.mass", "arm.links["]),
        ({"parameters": {MASS: [20.0, -1.0]}}, SceneError, ["instance 1", MASS, "-1.0"]),
        ({"parameters": {MASS: [[20.0], [21.0]]}}, SceneError, ["instance 0", MASS]),
        ({"parameters": {ADDED: np.ones((2, 5))}}, SceneError, ["instance 0", ADDED, "5"]),
        ({"parameters": {MASS: [20.0, np.nan]}}, SceneError, ["instance 1", MASS]),
        ({"parameters": {MASS: [20.0, 21.0]}, "num_envs": 3}, ValueError, [MASS, "(2,)", "(3, ...)"]),
        ({"parameters": {MASS: ["a"]}}, TypeError, [MASS]),
        ({"parameters": {3: [1.0]}}, TypeError, ["strings", "int"]),
        ({"scene": ["petasus-pum"] * 2, "num_envs": 3}, ValueError, ["2 scenes", "num_envs is 3"]),
        ({"scene": ["petasus-pum", "bluerov2-heavy"]}, ValueError, ["scene 1 ('bluerov2-heavy')", "structure"]),
        ({"scene": []}, ValueError, ["num_envs"]),
        ({"parameters": {ROTOR: [0.1, 0.0]}}, ValueError, ["scene 1", ROTOR]),
    ],
)
def test_errors_name_instance_key_and_value(arguments: dict[str, Any], kind: type[Exception], words: list[str]) -> None:
    with pytest.raises(kind) as caught:
        Simulator(**({"scene": "petasus-pum"} | arguments))
    assert all(word in str(caught.value) for word in words), caught.value


RANGES = {MASS: 0.2, FRICTION: [0.5, 3.0], ADDED: [[50.0] * 3 + [1.5] * 3, [110.0] * 3 + [4.0] * 3], "thrust": 0.1}


def rollout(env: Any, seed: int) -> np.ndarray:
    observations = [env.reset(seed=seed)[0]]
    for k in range(6):
        action = np.full(env.action_space.shape, 0.3 * np.sin(k), np.float32)
        observations.append(env.step(action)[0])
    env.close()
    return np.array(observations)


def test_episodes_draw_numbers_of_the_scene_alike_in_one_and_in_many() -> None:
    options: dict[str, Any] = {"randomize": RANGES, "max_current": 0.0}
    many = rollout(StationKeepVectorEnv(9, **options), 3)
    again = rollout(StationKeepVectorEnv(9, threads=1, **options), 3)
    assert np.array_equal(many, again)
    for i in (0, 4, 8):
        assert np.array_equal(many[:, i], rollout(StationKeepEnv(**options), 3 + i))
    del options["randomize"]
    plain = rollout(StationKeepEnv(**options), 3)
    assert np.array_equal(plain[0], many[0, 0])
    assert not np.array_equal(plain[-1], many[-1, 0])


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ({"vehicle.body.mas": [1.0, 2.0]}, ["vehicle.body.mas", MASS]),
        ({MASS: [3.0, 1.0]}, [MASS, "[3, 1]"]),
        ({MASS: [[2.0], [1.0]]}, [MASS, "is a number"]),
        ({MASS: [-2.0, -1.0]}, [MASS, "must be > 0"]),
        ({MASS: 1.5}, [MASS, "1.5"]),
        ({"vehicle.thrusters[0].position": 0.1}, ["vehicle.thrusters[0].position", "no effect"]),
        ({"arm.links[0].joint.home": [0.1, 0.2]}, ["arm.links[0].joint.home", "no effect"]),
        ({ADDED: [1.0, 2.0]}, [ADDED, "list of 6"]),
        ({"water.current": [[0.1] * 3, [0.2] * 3]}, ["water.current", "no effect"]),
        ({"masss": 0.1}, ["masss", "key of the scene"]),
    ],
)
def test_ranges_that_cannot_be_are_refused_by_key(ranges: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        StationKeepEnv(randomize=ranges)
    assert all(word in str(caught.value) for word in words), caught.value


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


def test_a_payload_on_an_inner_link_is_the_scenes_payload() -> None:
    """An end effector on the second of four links: the payload of `scale_parameters` is a point mass there."""
    scene = copy.deepcopy(load_scene("bluerov2-heavy-alpha5"))
    arm, point = scene["arm"], {"mass": 1.5, "inertia": [1e-8] * 3}
    arm["end_effector"] = {"on": arm["links"][1]["name"], "position": [0.05, 0.0, 0.1]}

    def end(scene: dict[str, Any], payload: float) -> np.ndarray:
        s = Simulator(scene)
        s.scale_parameters(payload=payload)
        s.set_state(twist=[[0.3, -0.2, 0.1, 0.2, 0.1, -0.3]], qd=[[0.3, -0.2, 0.4, 0.1]])
        s.step(substeps=30)
        return np.concatenate([s.position[0], s.twist[0], s.q[0], s.qd[0]])

    laden = end({**scene, "payload": {"body": point}}, 0.0)
    assert np.abs(end(scene, 1.5) - laden).max() < 2e-8
    assert np.abs(end(scene, 0.0) - laden).max() > 0.1


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
