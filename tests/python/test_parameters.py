"""`Simulator.scale_parameters`: instances that differ in mass, added mass, drag and volume."""

import copy
import pickle

import numpy as np
import pytest
from helpers import assert_same, bodies, moving, state_of

from uvms_gym import Simulator, load_scene

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


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy"])
def test_a_payload_weighs_at_the_end_effector(scene: str) -> None:
    plain, laden = Simulator(scene, 2), Simulator(scene, 2)
    laden.scale_parameters(payload=[0.0, 2.5])
    jacobian = laden.jacobian()[1]
    extra = laden.mass_matrix()[1] - plain.mass_matrix()[1]
    assert np.allclose(extra, 2.5 * jacobian[:3].T @ jacobian[:3], atol=1e-12)
    # Its weight, through the end effector's Jacobian, and nothing else.
    light, heavy = (s.forward_dynamics() for s in (plain, laden))
    assert np.array_equal(light[0], heavy[0])
    force = laden.mass_matrix()[1] @ heavy[1] - plain.mass_matrix()[1] @ light[1]
    down = laden.end_effector_pose()[1, :3, :3].T @ [0.0, 0.0, -9.81]
    assert np.allclose(force, 2.5 * jacobian[:3].T @ down, rtol=1e-9, atol=1e-9)


def test_weak_thrusters_give_less() -> None:
    full, weak = Simulator("bluerov2-heavy", 2), Simulator("bluerov2-heavy", 2)
    weak.scale_parameters(thrust=[1.0, 0.5])
    thrust = np.tile(np.linspace(4.0, 11.0, 8), (2, 1))
    weak.step(thrust=thrust, substeps=20)
    thrust[1] *= 0.5
    full.step(thrust=thrust, substeps=20)
    assert_same(state_of(weak), state_of(full))


@pytest.mark.parametrize("name", ["bluerov2-heavy", "petasus-pum", "bluerov2-heavy-alpha5"])
def test_factors_are_those_of_a_scene_with_other_numbers(name: str) -> None:
    scene = load_scene(name)
    for body in bodies(scene):
        body["mass"] *= 1.2
        body["inertia"] = (1.2 * np.array(body["inertia"])).tolist()
        body["added_mass"] = (0.8 * np.array(body["added_mass"])).tolist()
        body["damping"]["linear"] = (0.7 * np.array(body["damping"]["linear"])).tolist()
        body["damping"]["quadratic"] = (1.5 * np.array(body["damping"]["quadratic"])).tolist()
    scene["provenance"] = {}
    twin, varied = moving(scene), moving(name)
    varied.scale_parameters(mass=1.2, added_mass=0.8, linear_damping=0.7, quadratic_damping=1.5)
    assert np.allclose(varied.mass_matrix(), twin.mass_matrix(), rtol=1e-13, atol=1e-15)
    for s in (twin, varied):
        s.step(thrust=10.0 * np.ones(s.num_thrusters), substeps=50)
    for part, value in state_of(varied).items():
        assert np.allclose(value, state_of(twin)[part], rtol=1e-11, atol=1e-12), part


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy-alpha5"])
def test_neighbours_with_other_parameters_do_not_matter(scene: str, dtype: str) -> None:
    alone, among = moving(scene, 9, dtype=dtype), moving(scene, 9, dtype=dtype)
    factors = np.linspace(0.8, 1.4, 9)
    factors[4] = 1.0
    among.scale_parameters(mass=factors, volume=factors[::-1])
    for s in (alone, among):
        s.step(substeps=20)
    untouched, neighbour = ({k: v[4:5] for k, v in state_of(s).items()} for s in (alone, among))
    assert_same(neighbour, untouched)
    assert not np.array_equal(alone.twist[0], among.twist[0])


def test_copies_keep_parameters() -> None:
    s = moving("petasus-pum", 2)
    s.scale_parameters(added_mass=[0.7, 1.3])
    copies = [copy.deepcopy(s), pickle.loads(pickle.dumps(s))]
    for other in (s, *copies):
        other.step(substeps=5)
    for other in copies:
        assert np.array_equal(other.parameters["added_mass"], [0.7, 1.3])
        assert_same(state_of(other), state_of(s))


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


def test_memory_with_parameters() -> None:
    s = Simulator("petasus-pum", 1024)
    s.scale_parameters(mass=np.linspace(0.9, 1.1, 1024))
    assert s.bytes_per_env < 3000
