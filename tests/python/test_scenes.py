"""Scenes from names, paths and dicts."""

import copy
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import assert_same, moving, state_of
from hypothesis import given
from hypothesis import strategies as st

from uvms_gym import SceneError, Simulator, load_scene, scene_names


def paths(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to everything below the root."""
    items = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    return [p for key, value in items for p in [(*path, key), *paths(value, (*path, key))]]


def set_at(root: Any, path: tuple[Any, ...], value: Any) -> None:
    for key in path[:-1]:
        root = root[key]
    root[path[-1]] = value


@pytest.mark.parametrize("name", scene_names())
def test_a_dict_means_the_same_as_the_file(name: str) -> None:
    scene = load_scene(name)
    assert load_scene(scene) == scene
    a, b = moving(name), moving(scene)
    assert a.scene == b.scene == scene
    for simulator in (a, b):
        simulator.step(substeps=5)
    assert_same(state_of(a), state_of(b))


def test_numpy_and_tuples_mean_the_same_as_lists() -> None:
    scene = load_scene("petasus-pum")
    other = copy.deepcopy(scene)
    body = other["vehicle"]["body"]
    body["added_mass"] = np.array(body["added_mass"])
    body["mass"] = np.float32(64.0)
    body["center_of_mass"] = tuple(np.float64(x) for x in body["center_of_mass"])
    other["vehicle"]["fixed"] = np.bool_(False)
    other["water"]["density"] = np.int64(1000)
    other["name"] = np.str_(scene["name"])
    scene["vehicle"]["body"]["mass"] = 64.0
    assert load_scene(other) == load_scene(scene)


def test_the_scene_of_a_simulator_is_a_copy() -> None:
    simulator = Simulator("free-body")
    simulator.scene["water"]["density"] = -1.0
    assert simulator.scene == load_scene("free-body")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("water", "density"), -1.0, r"water\.density.*-1"),
        (("water", "density"), "salty", r"water\.density.*salty"),
        (("water", "density"), math.nan, r"water\.density.*NaN"),
        (("water", "density"), None, r"water\.density.*NoneType"),
        (("water", "density"), 2**70, r"water\.density.*64 bits"),
        (("water", "color"), "blue", r"water\.color.*blue"),
        (("vehicle", "body", "mass"), 1j, r"vehicle\.body\.mass.*complex"),
        (("vehicle", "body", "center_of_mass"), [0.0, 0.0], r"vehicle\.body\.center_of_mass.*\[0\.0, 0\.0\]"),
        (("vehicle", "body", "center_of_mass"), np.array([0.0, np.inf, 0.0]), r"center_of_mass\[1\].*inf"),
        (("arm", "links", 2, "joint", "axis"), [0, 0, 0], r"arm\.links\[2\]\.joint\.axis.*nonzero length"),
        (("arm", "links", 1, "joint", "kind"), {1: 2}, r"arm\.links\[1\]\.joint\.kind.*int"),
        (("arm", "links", 1, "joint", "home"), np.array([object()]), r"arm\.links\[1\]\.joint\.home\[0\].*object"),
        (("name",), "\ud800", "name.*Unicode"),
    ],
)
def test_an_error_names_key_and_value(path: tuple[Any, ...], value: Any, message: str) -> None:
    scene = load_scene("petasus-pum")
    set_at(scene, path, value)
    with pytest.raises(SceneError, match=message) as caught:
        Simulator(scene)
    assert str(caught.value).startswith("<dict>: ")


def test_the_error_of_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(SceneError, match=r"'nemo'.*petasus-pum"):
        Simulator("nemo")


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"nowhere\.toml"):
        load_scene("nowhere.toml")
    path = tmp_path / "broken.toml"
    path.write_text("name = 'x'\nwater = {")
    with pytest.raises(SceneError, match=r"broken\.toml: line 2"):
        load_scene(path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(SceneError, match=r"broken\.toml"):
        load_scene(str(path))
    with pytest.raises(SceneError):
        load_scene(tmp_path)
    with pytest.raises(SceneError):
        load_scene("a\0b.toml")


@pytest.mark.parametrize("scene", [None, 3, b"free-body", ["free-body"], object()])
def test_what_is_no_scene_is_a_type_error(scene: Any) -> None:
    with pytest.raises(TypeError, match="name, a path or a dict"):
        load_scene(scene)


def test_a_dict_without_end_is_refused() -> None:
    scene = load_scene("free-body")
    scene["water"]["water"] = scene
    with pytest.raises(SceneError, match="nested too deeply"):
        load_scene(scene)
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(SceneError, match="nested too deeply"):
        load_scene({"name": endless})


LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-3, 3),
    st.floats(),
    st.sampled_from([0.0, -0.0, 1e-300, 1e-12, 1e12, 1e300, -1.0]),
    st.text(max_size=5),
    st.binary(max_size=3),
    st.just(np.eye(6)),
    st.just(np.zeros(6)),
    st.just(np.array(1.5, dtype=np.float16)),
    st.just(object()),
)
JUNK = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=6) | st.dictionaries(st.text(max_size=3) | st.integers(), inner, max_size=3),
    max_leaves=6,
)
ALL = {name: load_scene(name) for name in scene_names()}


@given(data=st.data())
def test_any_dict_is_simulated_or_refused(data: st.DataObject) -> None:
    scene = copy.deepcopy(ALL[data.draw(st.sampled_from(sorted(ALL)))])
    for _ in range(data.draw(st.integers(1, 3))):
        there = paths(scene)
        set_at(scene, data.draw(st.sampled_from(there)), data.draw(JUNK))
    try:
        simulator = Simulator(scene)
    except SceneError as error:
        assert str(error)
    except ValueError as error:
        assert "mass matrix" in str(error) or "thruster" in str(error), error
    else:
        simulator.step(substeps=2)
        simulator.energy()
        simulator.trim()


@given(scene=st.dictionaries(st.text(max_size=5), JUNK, max_size=4))
def test_any_other_dict_is_refused(scene: dict[str, Any]) -> None:
    with pytest.raises(SceneError):
        load_scene(scene)


def test_added_mass_may_differ_across_the_diagonal_by_the_rounding_of_published_digits() -> None:
    added = np.diag([800.0, 1200.0, 3660.0, 535.0, 843.0, 224.0])
    body = {"mass": 1800.0, "inertia": [500.0, 800.0, 700.0], "volume": 1.8}

    def scene(upper: float, lower: float) -> dict[str, Any]:
        added[2, 5], added[5, 2] = upper, lower
        return {
            "name": "r",
            "water": {"density": 1028.0, "gravity": [0.0, 0.0, -9.81]},
            "vehicle": {"name": "r", "body": body | {"added_mass": added.tolist()}},
        }

    read = load_scene(scene(10.774, 10.775))["vehicle"]["body"]["added_mass"]
    assert read[2][5] == read[5][2] == (10.774 + 10.775) / 2
    # The bound is 1e-3 of the root of 3660 times 224, 0.905.
    load_scene(scene(10.0, 10.9))
    for upper, lower in ((10.774, -10.774), (10.0, 10.91)):
        with pytest.raises(SceneError, match=r"not symmetric: entries \[2\]\[5\] and \[5\]\[2\] are"):
            load_scene(scene(upper, lower))
