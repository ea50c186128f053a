"""`uvms scenes explain`: what it takes out, what it measures, and what it says of that."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import bodies, fixed_base

pytest.importorskip("typer")

from uvms_gym import Simulator, load_scene, scene_names
from uvms_gym._rotations import about
from uvms_gym._scene import joints
from uvms_gym.cli import explain, main
from uvms_gym.identification.files import to_toml
from uvms_gym.studies.accuracy.driven_motion import Track, driven_motion
from uvms_gym.studies.terms import ablation
from uvms_gym.studies.terms import scene_terms as terms

FLOW = ("added mass", "linear damping", "quadratic damping")


def found(scene: dict[str, Any]) -> dict[str, terms.Term]:
    return {term.name: term for term in terms.terms_of(scene)}


def without(scene: dict[str, Any], name: str) -> dict[str, Any]:
    term = found(scene)[name]
    assert term.present
    assert term.remove is not None
    return load_scene(terms.edited(scene, term.remove))


def complete() -> dict[str, Any]:
    """A scene that has every term."""
    scene = load_scene("bluerov2-heavy-alpha5")
    links = scene["arm"]["links"]
    scene["arm"]["base"] = links[0]["body"] | {"mass": 0.4}
    links.append({"name": "camera", "parent": "vehicle", "joint": {"kind": "fixed"}})
    scene["payload"] = {"body": links[1]["body"] | {"mass": 0.3}}
    shape = {"name": "seabed", "kind": "plane", "frame": {"position": [0.0, 0.0, -50.0]}}
    sphere = {"name": "skid", "on": "vehicle", "position": [0.0, 0.0, -0.2], "radius": 0.02}
    scene["contact"] = {"spheres": [sphere], "shapes": [shape]}
    scene["provenance"] = {}
    for body in bodies(scene):
        matrix = np.diag(body["added_mass"]) if np.ndim(body["added_mass"]) == 1 else np.array(body["added_mass"])
        matrix[0, 1] = matrix[1, 0] = 0.1 * np.sqrt(matrix[0, 0] * matrix[1, 1])
        body["added_mass"] = matrix.tolist()
        body["damping"]["linear"] = [1.0, 1.0, 1.0, 0.1, 0.1, 0.1]
    for joint in joints(scene):
        joint["friction"] = {"viscous": 1.0, "coulomb": 0.1, "coulomb_speed": 0.05}
        joint["spring"] = {"stiffness": 0.5, "rest": 0.1}
        joint["limits"] = {"lower": -2.0, "upper": 2.0, "stiffness": 20.0, "damping": 1.0}
        joint["home"] = 0.0
        joint["effort"] = 9.0
    fins = load_scene("remus-100")["vehicle"]["fins"]
    tether = {"position": [0.0, 0.0, 0.1], "length": 20.0, "diameter": 0.01, "mass_per_length": 0.1}
    forward_damping = {"matrix": [8.0, 162.0, 108.0, 13.0, 20.0, 32.0]}
    scene["vehicle"].update(fins=fins, tether=tether, forward_damping=forward_damping, thruster_lag=0.1)
    return load_scene(scene)


@pytest.mark.parametrize("name", scene_names())
def test_terms_of_a_shipped_scene_are_those_that_its_numbers_hold(name: str) -> None:
    scene = load_scene(name)
    listed = found(scene)
    vehicle = scene["vehicle"]["body"]
    assert listed["vehicle: added mass"].present == bool(np.any(vehicle["added_mass"]))
    assert listed["vehicle: linear damping"].present == bool(np.any(vehicle["damping"]["linear"]))
    assert listed["vehicle: quadratic damping"].present == bool(np.any(vehicle["damping"]["quadratic"]))
    assert listed["vehicle: added mass, off-diagonal"].present == (name in ("rexrov", "remus-100"))
    assert listed["effort limits"].present == any("effort" in joint for joint in joints(scene))
    assert not listed["payload"].present
    for term in listed.values():
        assert term.present or term.remove is None


def test_a_complete_scene_has_every_term_and_each_can_go() -> None:
    scene = complete()
    for name, term in found(scene).items():
        assert term.present, name
        assert (term.remove is None) == (name == "joint servos"), name


def test_what_is_left_out_is_gone_and_nothing_else() -> None:
    scene = complete()
    scene["provenance"] = {}
    for term in terms.terms_of(scene):
        if term.remove is None or term.name == terms.CURRENT:
            continue
        left = found(load_scene(terms.edited(scene, term.remove)))
        gone = {name for name in found(scene) if name != terms.ALL and not left[name].present}
        group, _, kind = term.name.partition(": ")
        expected = {term.name}
        if kind == "added mass":
            expected |= {f"{term.name}, off-diagonal"}
        if kind == "added mass, damping":
            expected |= {f"{group}: {part}" for part in FLOW} | {f"{group}: added mass, off-diagonal"}
        if term.name == terms.ALL:
            expected = {name for name in left if name != "joint servos"}
        assert gone == expected, term.name
    assert scene == complete() | {"provenance": {}}, "the scene itself is as it was"


def test_weight_and_buoyancy_leave_not_even_rounding() -> None:
    for name in ("petasus-pum", "bluerov2-heavy-alpha5", "rexrov"):
        scene = load_scene(name)
        for group, moved in (("vehicle", slice(0, 1)), ("links", slice(1, None))):
            if not found(scene)[f"{group}: weight, buoyancy"].present:
                continue
            simulator = Simulator(without(scene, f"{group}: weight, buoyancy"))
            simulator.set_state(quaternion=[0.3, -0.5, 0.7, 0.2])
            restoring = simulator.body_wrenches()["restoring"][0]
            assert np.abs(restoring[moved]).max() < 1e-12
            assert np.abs(np.delete(restoring, np.r_[moved], axis=0)).max(initial=1.0) > 1e-3


def test_a_held_vehicle_and_a_base_behind_a_joint_cannot_be_left_out() -> None:
    listed = found(load_scene(fixed_base()))
    assert all(not term.present for name, term in listed.items() if name.startswith("vehicle"))
    assert listed["links: added mass"].present
    scene = complete()
    scene["arm"]["mount"]["joint"] = scene["arm"]["links"].pop(0)["joint"]
    base = found(load_scene(scene))["arm base"]
    assert base.present
    assert base.remove is None
    assert "joint" in base.note


def test_errors_are_those_of_the_motion_without_the_term() -> None:
    scene = load_scene("petasus-pum")
    motion = driven_motion(scene, 3, 10.0, 0)
    listed = found(scene)
    chosen = ["links: quadratic damping", "current", "end stops"]
    floor, errors = ablation.trajectory_errors(motion, [listed[name] for name in chosen])
    assert floor.shape == (2, 3)
    assert 0.0 < floor.max() < 1e-8
    assert not errors["end stops"].any(), "no joint gets there"
    for name in chosen[:2]:
        assert (errors[name] > 1e-4).all()
        assert (errors[name][1] > errors[name][0]).all()
    # The current, once more by hand.
    runs = []
    for start in (motion.start, motion.start | {"current": np.zeros((3, 3))}):
        simulator = Simulator(scene, 3, dt=ablation.STEP)
        simulator.set_state(**start)
        for period in range(10):
            simulator.step(**motion.inputs(period), substeps=20)
        runs.append(simulator.position)
    expected = np.median(np.linalg.norm(runs[0] - runs[1], axis=-1))
    assert errors["current"][0, 0] == pytest.approx(expected, rel=1e-12)


def test_a_lost_motion_counts_as_infinitely_far() -> None:
    rotation, zero = np.tile(np.eye(3), (2, 3, 1, 1)), np.zeros((2, 3, 3))
    here = Track(zero, rotation, zero[..., :0], zero, False, False)
    nan = here._replace(position=zero * np.nan, rotation=rotation * np.nan, end_effector=zero * np.nan)
    assert np.isposinf(ablation._distance(here, nan)).all()
    turned = here._replace(rotation=rotation @ about([0.0, 0.0, 1.0], np.pi / 2), end_effector=zero + 2.0)
    assert ablation._distance(here, turned) == pytest.approx(np.tile([0.0, np.pi / 2, 2.0 * np.sqrt(3.0)], (2, 1)))


def test_savings_stand_out_from_noise_or_are_none(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = driven_motion(load_scene("rexrov"), 2, 0.1, 0).tiled(ablation.TIMED)
    listed = found(motion.scene)
    chosen = [listed["vehicle: linear damping"], listed["vehicle: quadratic damping"]]
    rng = np.random.default_rng(0)

    def timed(simulator: Simulator, motion: Any) -> float:
        cheap = not np.any(motion.scene["vehicle"]["body"]["damping"]["quadratic"])
        disturbed = 1000.0 if rng.uniform() < 0.1 else 0.0
        return 100.0 - 7.0 * cheap + float(rng.normal()) + disturbed

    monkeypatch.setattr(ablation, "_timed", timed)
    whole, savings = ablation.step_costs(motion, chosen, 0)
    none, some = (savings[term.name] for term in chosen)
    assert whole == pytest.approx(100.0, abs=1.0)
    assert some.significant
    assert some.value == pytest.approx(7.0, abs=some.noise)
    assert not none.significant
    assert none.noise < 3.0


def test_numbers_are_written_with_what_they_are_worth() -> None:
    assert explain._error(0.0, 1e-9) == "0"
    assert explain._error(5e-9, 1e-9) == "< 1e-08"
    assert explain._error(0.01234, 1e-9) == "0.012"
    assert explain._error(np.inf, 1e-9) == "not finite"
    assert explain._share(ablation.Saving(12.0, 2.0), 100.0) == "12.0 %"
    assert explain._share(ablation.Saving(1.0, 2.0), 100.0) == "< 2.0 %"


def test_the_command_tells_terms_costs_errors_and_what_to_do(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(ablation, "BATCHES", 3)
    file = tmp_path / "deep" / "explain.json"
    arguments = ["scenes", "explain", "rexrov", "--episodes", "2", "--seed", "5", "--json", str(file)]
    assert main(arguments) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in ("Munk", "vehicle: linear damping", "Recommendations", "do not add up", "10 s: m"):
        assert words in text
    told = json.loads(file.read_text())
    assert told["arguments"] == {"scene": "rexrov", "episodes": 2, "seed": 5, "integrator": None, "dt": None}
    assert told["ns_per_step"] > 0.0
    rows = {row["name"]: row for row in told["terms"]}
    assert rows["payload"]["saved_ns_per_step"] is None
    assert rows["payload"]["median_error_without"] is None
    drag = rows["vehicle: quadratic damping"]
    assert drag["present"]
    assert set(drag["saved_ns_per_step"]) == {"value", "noise"}
    assert drag["median_error_without"]["10 s"]["position"] > drag["median_error_without"]["1 s"]["position"] > 0.0
    assert main(["scenes", "explain", "free-body", "--episodes", "2"]) == 0
    assert "No term of this scene can be removed" in capsys.readouterr().out


def test_explain_lists_contact_and_fixtures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = load_scene("free-body")
    limits = {"lower": 0.0, "upper": 3.22, "stiffness": 57.0, "damping": 5.0}
    valve = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "rotor_inertia": 0.002, "limits": limits}
    valve |= {"frame": {"position": [9.0, 0.0, 0.0]}, "friction": {"viscous": 0.083}}
    scene["fixtures"] = [{"name": "valve", "joint": valve}]
    sphere = {"name": "skid", "on": "vehicle", "position": [0.0, 0.0, -0.211], "radius": 0.023}
    rim = {"name": "rim", "on": "valve", "kind": "torus", "radius": 0.0591, "tube": 0.0062, "stiffness": 7123.0}
    panel = {"name": "panel", "kind": "box", "size": [0.02, 0.61, 0.62], "frame": {"position": [9.5, 0.0, 0.0]}}
    scene["contact"] = {"slip_speed": 0.004, "spheres": [sphere], "shapes": [panel, rim]}
    (file := tmp_path / "station.toml").write_text(to_toml(load_scene(scene)))
    assert main(["scenes", "explain", str(file), "--episodes", "2"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in (
        "skid vehicle 0 0 -0.211 0.023",
        "panel world box 0.02 x 0.61 x 0.62 9.5 0 0",
        "rim valve torus radius 0.0591, tube 0.0062 0 0 0",
        "rim 7123 2 0.0005 0.4 0.004",
        "valve revolute 0 to 3.22 0 57 0 0.083 0",
    ):
        assert words in text
