"""Assessment of scenes against closed forms, and doubts about numbers that cannot be."""

import copy
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym import SceneError

G = 9.81


def thruster(name: str, position: list[float], axis: list[float], limits: tuple[float, float]) -> dict[str, Any]:
    return {"name": name, "position": position, "axis": axis, "limits": list(limits)}


def box(**body: Any) -> dict[str, Any]:
    """A neutral body of 100 kg whose buoyancy acts 0.04 m above its centre of mass, with eight thrusters."""
    body = {
        "mass": 100.0,
        "inertia": [5.0, 8.0, 9.0],
        "volume": 0.1,
        "center_of_buoyancy": [0.0, 0.0, 0.04],
        "added_mass": [50.0, 60.0, 70.0, 1.0, 2.0, 3.0],
        "damping": {"linear": [10.0] * 6, "quadratic": [50.0] * 6},
    } | body
    corners = [(x, y) for x in (0.3, -0.3) for y in (0.2, -0.2)]
    level = [
        thruster(f"h{k}", [x, y, 0.0], [1.0, float(np.sign(x * y)), 0.0], (-40.0, 40.0))
        for k, (x, y) in enumerate(corners)
    ]
    upward = [thruster(f"v{k}", [x, y, 0.0], [0.0, 0.0, 1.0], (-40.0, 50.0)) for k, (x, y) in enumerate(corners)]
    water = {"density": 1000.0, "gravity": [0.0, 0.0, -G]}
    return {"name": "box", "water": water, "vehicle": {"name": "box", "body": body, "thrusters": level + upward}}


def test_val_righting_moment_and_equilibrium_of_a_box() -> None:
    trim = uvms_gym.assess_scene(box())["trim"]
    assert trim["righting_moment"] == pytest.approx(100.0 * G * 0.04, rel=1e-12)
    assert trim["equilibrium"] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert trim["net_weight"] == pytest.approx(0.0, abs=1e-9)
    # A centre of mass to port and forward: gravity passes through both centres at the equilibrium.
    y, x = 0.01, 0.02
    trim = uvms_gym.assess_scene(box(center_of_mass=[x, y, 0.0]))["trim"]
    lever = np.array([x, y, -0.04])
    assert trim["righting_moment"] == pytest.approx(100.0 * G * np.linalg.norm(lever), rel=1e-12)
    roll, pitch = trim["equilibrium"]
    down = np.array([np.sin(pitch), -np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])
    assert down == pytest.approx(lever / np.linalg.norm(lever), abs=1e-12)
    # The bow, where the mass is, goes down: pitch about y to port is positive.
    assert pitch > 0.0 > roll
    trim = uvms_gym.assess_scene(box(center_of_buoyancy=[0.0, 0.0, 0.0]))["trim"]
    assert trim["righting_moment"] == pytest.approx(0.0, abs=1e-9) and trim["equilibrium"] is None


def test_val_thrust_to_hold_a_heavy_box_by_hand() -> None:
    """10 kg too heavy: 98.1 N on four thrusters of 50 N upward, and of 40 N where the box floats up."""
    for mass, limit in ((110.0, 50.0), (90.0, 40.0)):
        trim = uvms_gym.assess_scene(box(mass=mass))["trim"]
        assert trim["net_weight"] == pytest.approx((mass - 100.0) * G, rel=1e-12)
        level, upward = trim["thrusts"][:4], trim["thrusts"][4:]
        assert all(force == pytest.approx(0.0, abs=1e-9) and share == 0.0 for force, share in level)
        for force, share in upward:
            assert force == pytest.approx((mass - 100.0) * G / 4.0, rel=1e-9)
            assert share == pytest.approx(10.0 * G / 4.0 / limit, rel=1e-9)
        assert np.array(trim["missing"]) == pytest.approx(np.zeros(6), abs=1e-9)
    bare = box(mass=110.0)
    bare["vehicle"]["thrusters"] = []
    trim = uvms_gym.assess_scene(bare)["trim"]
    assert trim["thrusts"] == [] and trim["missing"][2] == pytest.approx(10.0 * G, rel=1e-9)


def test_val_authority_of_known_thrusters() -> None:
    by_axis = {entry["axis"]: entry for entry in uvms_gym.assess_scene(box())["authority"]}
    diagonal = 4.0 * 40.0 / np.sqrt(2.0)
    expected = {
        "surge": (diagonal, diagonal, diagonal, 150.0),
        "sway": (diagonal, diagonal, diagonal, 160.0),
        "heave": (4 * 50.0, 4 * 40.0, 4 * 40.0, 170.0),
        "roll": (0.2 * 180.0, 0.2 * 180.0, 0.2 * 160.0, 6.0),
        "pitch": (0.3 * 180.0, 0.3 * 180.0, 0.3 * 160.0, 10.0),
    }
    for axis, (ahead, back, alone, inertia) in expected.items():
        entry = by_axis[axis]
        assert entry["maximum"] == pytest.approx([ahead, back], rel=1e-9), axis
        assert entry["alone"] == pytest.approx(alone, rel=1e-9), axis
        assert entry["acceleration"] == pytest.approx(alone / inertia, rel=1e-9), axis
    # Without the last upward thruster heave takes two opposite ones, of which each has to balance the other's moment.
    scene = box()
    del scene["vehicle"]["thrusters"][4:]
    entries = {entry["axis"]: entry for entry in uvms_gym.assess_scene(scene)["authority"]}
    assert entries["heave"]["alone"] == entries["heave"]["acceleration"] == 0.0


def test_val_rates_of_a_joint_by_their_causes() -> None:
    """A uniform link on a fixed base: I = I_c + m c^2 + rotor."""
    joint = {
        "kind": "revolute", "axis": [0.0, 0.0, 1.0], "rotor_inertia": 0.01,
        "friction": {"viscous": 0.3, "coulomb": 0.2, "coulomb_speed": 0.05, "static": 0.25, "stribeck_speed": 1.0},
        "spring": {"stiffness": 20.0}, "detent": {"torque": 0.4, "period": 0.5},
        "limits": {"lower": -1.0, "upper": 1.0, "stiffness": 30.0}, "servo": {"kp": 12.0, "kd": 9.0},
    }  # fmt: skip
    link = {
        "name": "l",
        "joint": joint,
        "body": {"mass": 2.0, "inertia": [0.1, 0.2, 0.3], "center_of_mass": [0.5, 0, 0]},
    }
    scene = {
        "name": "s", "water": {"density": 0.0, "gravity": [0.0, 0.0, 0.0]},
        "vehicle": {"name": "v", "fixed": True, "body": {"mass": 1.0, "inertia": [1.0, 1.0, 1.0]}},
        "arm": {"name": "a", "mount": {"frame": {"position": [0, 0, 0], "rpy": [0, 0, 0]}}, "links": [link]},
    }  # fmt: skip
    assessed = uvms_gym.assess_scene(scene)
    assert assessed["trim"] is None and assessed["authority"] == []
    (found,) = assessed["joints"]
    inertia = 0.3 + 2.0 * 0.25 + 0.01
    assert found["inertia"] == pytest.approx(inertia, rel=1e-12)
    assert found["friction"] == pytest.approx((0.3 + 0.25 / 0.05) / inertia, rel=1e-12)
    assert found["servo"] == pytest.approx(max(-np.roots([inertia, 9.0, 12.0])), rel=1e-9)
    assert found["end_stop"] == pytest.approx(np.sqrt(30.0 / inertia), rel=1e-12)
    assert found["spring"] == pytest.approx(np.sqrt(20.0 / inertia), rel=1e-12)
    assert found["detent"] == pytest.approx(np.sqrt(0.4 * 2.0 * np.pi / 0.5 / inertia), rel=1e-12)
    # Too fast for 0.01 s: the doubt names the cause.
    assert uvms_gym.lint_scene(scene) == []
    joint["friction"] |= {"coulomb": 20.0, "static": 20.0}
    (doubt,) = uvms_gym.lint_scene(scene)
    assert (
        doubt.startswith("arm.links[0].joint.friction (l): the rate of 4.9") and "too fast for mk4 at 0.01 s" in doubt
    )
    scene["integration"] = {"integrator": "ros2", "step": 0.01}
    assert uvms_gym.lint_scene(scene) == []


@pytest.mark.parametrize("name", ["petasus-pum", "bluerov2-heavy-two-alpha5"])
def test_val_inertias_by_the_mass_matrix(name: str) -> None:
    """A joint moves against `1 / (M^-1)_kk`, all else free; thrust moves vehicle and arm as one body."""
    found = uvms_gym.assess_scene(name)
    mass = uvms_gym.Simulator(name).mass_matrix()[0]
    free, one = np.linalg.inv(mass).diagonal(), np.linalg.inv(mass[:6, :6]).diagonal()
    assert [joint["inertia"] for joint in found["joints"]] == pytest.approx(list(1.0 / free[6:]), rel=1e-9)
    reached = [entry["alone"] for entry in found["authority"]]
    assert [entry["acceleration"] for entry in found["authority"]] == pytest.approx(list(one * reached), rel=1e-9)
    # Neither is the diagonal of M.
    assert np.max(np.abs(mass.diagonal()[6:] * free[6:] - 1.0)) > 0.01
    assert np.max(np.abs(mass.diagonal()[:6] * one - 1.0)) > 0.01


def doubts(change: Any) -> list[str]:
    scene = copy.deepcopy(uvms_gym.load_scene("bluerov2-heavy-alpha5"))
    change(scene)
    return uvms_gym.lint_scene(scene)


@pytest.mark.parametrize("name", uvms_gym.scene_names())
def test_shipped_scenes_have_no_doubts_but_the_known_ones(name: str) -> None:
    known = {
        "bluerov2-alpha5-pool": [],
        "remus-100": [
            "vehicle.thrusters: the vehicle cannot keep its station: no thrust in sway, heave, yaw",
            "vehicle.thrusters: no control of roll, pitch: the righting moment levels the vehicle",
        ],
    }
    found = uvms_gym.lint_scene(name)
    assert len(found) == len(known.get(name, []))
    assert all(doubt.startswith(start) for doubt, start in zip(found, known.get(name, []), strict=True))


def twice(scene: dict[str, Any]) -> None:
    thrusters = scene["vehicle"]["thrusters"]
    thrusters.append({**thrusters[2], "name": "again"})


def one_way(scene: dict[str, Any]) -> None:
    for one in scene["vehicle"]["thrusters"]:
        one["limits"] = [0.0, 40.0]


def along(scene: dict[str, Any]) -> None:
    for one in scene["vehicle"]["thrusters"]:
        one["axis"] = [0.0, 0.0, 1.0] if "vertical" in one["name"] else [1.0, 0.0, 0.0]


def five(scene: dict[str, Any]) -> None:
    del scene["vehicle"]["thrusters"][5:]


def unrighted(scene: dict[str, Any]) -> None:
    five(scene)
    body = scene["vehicle"]["body"]
    body["center_of_buoyancy"] = body["center_of_mass"]


def heavy(scene: dict[str, Any]) -> None:
    body = scene["vehicle"]["body"]
    body["mass"] *= 2.0
    body.pop("weight", None)


@pytest.mark.parametrize(
    ("change", "start"),
    [
        (lambda s: s["arm"]["links"][1]["body"].update(volume=1.0), "arm.links[1].body.volume"),
        (lambda s: s["arm"]["links"][1]["body"].update(volume=1.0), "arm: all bodies of the arm weigh"),
        (lambda s: s["arm"]["links"][1]["body"].update(volume=1e-6), "arm.links[1].body.volume"),
        (lambda s: s["arm"]["links"][0]["joint"]["limits"].update(upper=180.0), "arm.links[0].joint.limits.upper"),
        (lambda s: s["arm"]["mount"]["frame"].update(rpy=[180.0, 0.0, 0.0]), "arm.mount.frame.rpy[0]: 180 rad"),
        (lambda s: s["vehicle"]["body"].update(center_of_mass=[0.2, 0, 0]), "vehicle.body.center_of_buoyancy: the"),
        (lambda s: s["arm"]["links"][1]["joint"].update(effort=1e-3), "arm.links[1].joint.effort: holding the arm"),
        (twice, "vehicle.thrusters[8] (again): has the place of"),
        (one_way, "vehicle.thrusters: all that act in heave push in the"),
        (heavy, "vehicle.thrusters: "),
        (along, "vehicle.thrusters: the vehicle cannot keep its station: no thrust in sway"),
        (five, "vehicle.thrusters: no control of roll, pitch: the righting moment levels the vehicle"),
        (
            unrighted,
            "vehicle.thrusters: the vehicle cannot keep its station: thrust in heave, roll, pitch only together",
        ),
    ],
)
def test_slips_are_doubted_by_key(change: Any, start: str) -> None:
    found = doubts(change)
    assert any(doubt.startswith(start) for doubt in found), found


def test_rounded_matrices_are_made_symmetric_with_a_note_and_others_refused() -> None:
    table = np.diag([800.0, 1200.0, 3660.0, 535.0, 843.0, 224.0])
    table[2, 5], table[5, 2] = 10.774, 10.775
    scene = box(mass=1800.0, inertia=[500.0, 800.0, 700.0], volume=1.8, added_mass=table.tolist())
    (note,) = [doubt for doubt in uvms_gym.lint_scene(scene) if "symmetric" in doubt]
    assert note.startswith("vehicle.body.added_mass: entries [2][5] and [5][2] are 10.774 and 10.775")
    used = np.array(uvms_gym.load_scene(scene)["vehicle"]["body"]["added_mass"])
    assert used[2][5] == used[5][2] == pytest.approx(10.7745, rel=1e-12)
    # Beyond 1e-3 of the size that the entry can have, sqrt(3660 * 224).
    limit = 1e-3 * np.sqrt(3660.0 * 224.0)
    for difference, refused in ((0.99 * limit, False), (1.01 * limit, True)):
        table[5, 2] = table[2, 5] + difference
        scene["vehicle"]["body"]["added_mass"] = table.tolist()
        if refused:
            with pytest.raises(
                SceneError, match=r"added_mass: not symmetric: entries \[2\]\[5\] and \[5\]\[2\] are 10.774"
            ):
                uvms_gym.load_scene(scene)
        else:
            uvms_gym.load_scene(scene)
