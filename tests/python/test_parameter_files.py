"""Vehicles from YAML of hydrodynamic parameters."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uvms_gym import SceneError, Simulator, import_robot
from uvms_gym.robots import import_with_notes


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def error_of(path: Path, **options: Any) -> str:
    with pytest.raises(SceneError) as caught:
        import_robot(path, **options)
    text = str(caught.value)
    assert "\n" not in text and text.startswith(str(path))
    return text[len(str(path)) :]


TABLES = """/**:
  ros__parameters:
    model: {{name: tub}}
    mass: 20.0
    inertial: {{ixx: 0.5, iyy: 0.8, izz: 0.9, ixy: 0.01, ixz: 0.0, iyz: 0.0}}
    cog: [0.0, 0.01, -0.02]
    cob: [0, 0, 0.03]
    volume: 0.0201
    density: 1025.0
    Ma: {added}
    linear_damping: [-5, -8, -9, -0.2, -0.3, -2e-1]
    quad_damping: [30, 50, 60, 1.5, 2, 2]
"""
ADDED = """[[10, 0, 0, 0, 1, 0], [0, 18, 0, -1, 0, 0], [0, 0, 22, 0, 0, 0],
      [0, -1, 0, 0.3, 0, 0], [1, 0, 0, 0, 0.4, 0], [0, 0, 0, 0, 0, 0.3]]"""

DERIVATIVES = """
m: 20.0
g: 9.81
rho: 1000
W: 196.2
B: 197.0
Ix: 0.5
I_y: 0.8
Izz: 0.9
zG: 0.02
z_b: -0.01
added: [{X_udot: -10}, {Yvdot: -18}, {Zw_dot: -22}, {K_p_dot: -0.3}, {Mdq: -0.4}, {N_rdot: -0.3}]
coupled: [{Y_rdot: 0.5}, {N_vdot: 0.5}]
linear: {Xu: -5, Y_v: -8, Z_w_l: -9, Kp: -0.2, M_q: -0.3, N_r: -0.2}
X_uu: -30
Y_v|v|: -50
Zwabsw: -60
Kp_q: -1.5
Mqaq: -2
Nrr: -2
Y_ur: -3
X_wq: -4
pid: {Kp: 50, Ki: 2, Kd: 1}
"""


def yaml_scene(folder: Path, text: str, name: str = "tub.yaml") -> tuple[dict[str, Any], list[str]]:
    pytest.importorskip("yaml")
    return import_with_notes(written(folder, text, name))


def full(table: list[Any]) -> Any:
    """A matrix that a scene may state by its diagonal."""
    return np.diag(table) if np.ndim(table) == 1 else np.array(table)


def test_tables_of_parameters_are_a_vehicle(tmp_path: Path) -> None:
    scene, _ = yaml_scene(tmp_path, TABLES.format(added=ADDED))
    body = scene["vehicle"]["body"]
    assert body["mass"] == 20.0 and body["volume"] == pytest.approx(0.0201)
    np.testing.assert_allclose(body["center_of_mass"], [0.0, 0.01, -0.02])
    np.testing.assert_allclose(body["center_of_buoyancy"], [0.0, 0.0, 0.03])
    added = full(body["added_mass"])
    # uuv_simulator multiplies its matrices with the twist in axes z down.
    np.testing.assert_allclose(np.diag(added), [10, 18, 22, 0.3, 0.4, 0.3])
    assert added[0, 4] == added[4, 0] == -1.0 and added[1, 3] == added[3, 1] == 1.0
    np.testing.assert_allclose(np.diag(full(body["damping"]["linear"])), [5, 8, 9, 0.2, 0.3, 0.2])
    np.testing.assert_allclose(np.diag(full(body["damping"]["quadratic"])), [30, 50, 60, 1.5, 2, 2])
    assert scene["water"]["density"] == 1025.0
    Simulator(scene).step()


def test_derivatives_are_a_vehicle(tmp_path: Path) -> None:
    scene, notes = yaml_scene(tmp_path, DERIVATIVES)
    body = scene["vehicle"]["body"]
    np.testing.assert_allclose(body["center_of_mass"], [0.0, 0.0, -0.02])
    np.testing.assert_allclose(body["center_of_buoyancy"], [0.0, 0.0, 0.01])
    added = full(body["added_mass"])
    np.testing.assert_allclose(np.diag(added), [10, 18, 22, 0.3, 0.4, 0.3])
    # Sway and yaw both change sign: their product keeps it.
    assert added[1, 5] == added[5, 1] == -0.5
    np.testing.assert_allclose(np.diag(full(body["damping"]["linear"])), [5, 8, 9, 0.2, 0.3, 0.2])
    np.testing.assert_allclose(np.diag(full(body["damping"]["quadratic"])), [30, 50, 60, 1.5, 2, 2])
    assert full(scene["vehicle"]["forward_damping"]["matrix"])[1, 5] == 3.0
    assert any(note.startswith("X_wq: left out") for note in notes)


def test_an_allocation_matrix_is_the_thrusters(tmp_path: Path) -> None:
    matrix = "[[1, 1, 0], [0, 0, 0], [0, 0, 1], [0, 0, 0.2], [0.1, 0.1, -0.3], [-0.2, 0.2, 0]]"
    scene, _ = yaml_scene(tmp_path, TABLES.format(added="[1, 1, 1, 1, 1, 1]") + f"    tam: {matrix}\n")
    simulator = Simulator(scene)
    np.testing.assert_allclose(simulator.thruster_configuration, np.array(eval(matrix)), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "line 1"),
        ("- 1", "holds no keys"),
        ("kp: 3", "expected either tables"),
        ("mass: 3\nMa: [1, 2]", "Ma: is [1, 2], but must be 6 or 36 or 6 x 6 finite numbers"),
        ("mass: -3\nMa: [1, 1, 1, 1, 1, 1]", "mass: is -3, but must be > 0"),
        ("mass: heavy\nMa: [1, 1, 1, 1, 1, 1]", "mass: is heavy, but must be one finite number"),
        ("Ma: [1, 1, 1, 1, 1, 1]", "mass: is missing"),
        ("mass: 3\nMa: [1, 1, 1, 1, 1, 1]", "Ix: is missing"),
        ("mass: 3\nMa: [1, -1, 1, 1, 1, 1]", "Ma: has diagonal entries of both signs"),
        ("mass: 3\nm: 4\nMa: [1, 1, 1, 1, 1, 1]", "mass and m: are the same quantity"),
        ("mass: 3\nX_udot: -1\nother: {X_udot: -2}", "X_udot: is given twice"),
        ("mass: 3\ninertia: [1, 1, 1]\nX_udot: -1\naxes: enu", 'axes: is "enu", but must be "flu" or "ned"'),
        ("mass: .nan\nX_udot: -1", "mass: is nan"),
        (
            "mass: 3\ninertia: [1, 1, 1]\nX_u: -1\nthrusters: [{position: [0, 0, 0]}]",
            "thrusters[0]: must have position",
        ),
        ("a: &a {b: *a}", "levels"),
        (
            "\n".join(
                ["a0: &a0 [{x: 1}, {y: 1}]"]
                + [f"a{i}: &a{i} [{{x: *a{i - 1}}}, {{y: *a{i - 1}}}]" for i in range(1, 40)]
            ),
            "entries",
        ),
    ],
)
def test_broken_parameters_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    pytest.importorskip("yaml")
    assert message in error_of(written(tmp_path, text, "robot.yaml"))
