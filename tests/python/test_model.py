"""The closed form, kinematics and books as Python sees them."""

from typing import Any

import numpy as np
import pytest
from helpers import fixed_base, is_fixed, moving, random_inputs, state_of
from scipy.spatial.transform import Rotation

from uvms_gym import Simulator, scene_names

SCENES: list[Any] = [*scene_names(), pytest.param(fixed_base(), id="fixed-base")]
WRENCHES = ("thrust", "wrench", "external", "pose_target")
TORQUES = ("joint_torque", "joint_target")


def some(inputs: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: inputs[name] for name in names if name in inputs}


@pytest.mark.parametrize("scene", SCENES)
def test_shapes(scene: Any) -> None:
    s = moving(scene)
    n, m, bodies = s.num_joints, s.num_thrusters, s.num_bodies
    inputs = random_inputs(s)
    shapes: dict[str, Any] = {"mass_matrix": (6 + n, 6 + n), "bias": (6 + n,), "momentum": (6,), "jacobian": (6, 6 + n)}
    shapes |= {"wrench_influence": (6 + n, 6 * bodies), "torque_influence": (6 + n, n)}
    shapes |= {"body_poses": (bodies, 4, 4), "end_effector_pose": (4, 4)}
    for name, shape in shapes.items():
        assert getattr(s, name)().shape == (3, *shape), name
    assert s.allocate(np.ones(6)).shape == (3, m)
    assert {x.shape for x in s.body_wrenches(**some(inputs, WRENCHES)).values()} == {(3, bodies, 6)}
    assert {x.shape for x in s.joint_torques(**some(inputs, TORQUES)).values()} == {(3, n)}
    assert {x.shape for x in s.energy().values()} == {(3,)}
    assert {x.shape for x in s.power(**inputs).values()} == {(3,)}
    shapes = {"wrench": (3, 6), "thrust": (3, m), "joint_torque": (3, n), "residual": (3, 6)}
    assert {k: x.shape for k, x in s.trim().items()} == shapes
    shapes = dict.fromkeys(("rigid", "added", "total"), (3, 6)) | dict.fromkeys(("rigid_scale", "total_scale"), (3, 2))
    assert {k: x.shape for k, x in s.momentum_terms().items()} == shapes


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-12), ("float32", 1e-4)])
@pytest.mark.parametrize("scene", SCENES)
def test_accelerations_balance_forces(scene: Any, dtype: str, tolerance: float) -> None:
    """W F + L tau = M [V'; q''] + C [V; q'], with every input at once; the joints' rows where the vehicle is held."""
    s = moving(scene, 5, dtype=dtype)
    inputs = random_inputs(s)
    a = s.forward_dynamics(**inputs)
    F = s.body_wrenches(**some(inputs, WRENCHES))["sum"].reshape(5, -1)
    tau = s.joint_torques(**some(inputs, TORQUES))["sum"]
    terms = [
        np.einsum("nij,nj->ni", s.mass_matrix(), a),
        s.bias(),
        -np.einsum("nij,nj->ni", s.wrench_influence(), F),
        -np.einsum("nij,nj->ni", s.torque_influence(), tau),
    ]
    first = 6 if is_fixed(s) else 0
    residual = np.linalg.norm(sum(terms)[:, first:], axis=1)
    scale = np.linalg.norm(s.mass_matrix(), axis=(1, 2)) * np.linalg.norm(a, axis=1)
    scale += sum(np.linalg.norm(term, axis=1) for term in terms[1:])
    assert (residual < tolerance * scale).all()


@pytest.mark.parametrize("scene", SCENES)
def test_equations_are_of_the_velocity_through_water_in_both_axes(scene: Any) -> None:
    s = moving(scene, 5)
    flu, nu = s.equations(), np.concatenate([s.twist, s.qd], axis=1)
    nu[:, :3] -= np.einsum("nji,nj->ni", s.rotation, s.current)
    assert np.allclose(flu["nu"], nu, rtol=0.0, atol=1e-14)
    assert np.array_equal(flu.pop("M"), s.mass_matrix())
    signs = np.concatenate([[1, -1, -1, 1, -1, -1], np.ones(s.num_joints)])
    for axes, sign in (("flu", np.ones_like(signs)), ("ned", signs)):
        for terms in (s.equations(axes=axes), s.equations(flu["nu"] * sign, axes=axes)):
            assert np.array_equal(terms.pop("M"), sign[:, None] * s.mass_matrix() * sign)
            for name, value in flu.items():
                assert np.allclose(terms[name], sign * value, rtol=1e-12, atol=1e-12 * np.abs(value).max()), name
    assert not s.equations(np.zeros_like(nu[0]))["D_nu"].any()


def test_equations_refuse_other_axes_and_shapes() -> None:
    s = moving("petasus-pum")
    with pytest.raises(ValueError, match='axes is "enu", but must be "flu" or "ned"'):
        s.equations(axes="enu")
    with pytest.raises(ValueError, match="nu has shape"):
        s.equations(np.zeros(6))


@pytest.mark.parametrize("scene", SCENES)
def test_wrenches_and_torques_are_sums(scene: Any) -> None:
    s = moving(scene)
    inputs = random_inputs(s)
    for terms in (s.body_wrenches(**some(inputs, WRENCHES)), s.joint_torques(**some(inputs, TORQUES)), s.energy()):
        total = terms.pop("total") if "total" in terms else terms.pop("sum")
        assert np.allclose(sum(terms.values()), total, rtol=1e-12, atol=1e-12 * np.abs(total).max(initial=1.0))


def test_thrust_is_saturated_and_configured() -> None:
    s = Simulator("petasus-pum", 2)
    low, high = s.thruster_limits.T
    for thrust, limited in ((1e6 * np.ones(6), high), (-1e6 * np.ones(6), low), (0.1 * high, 0.1 * high)):
        wrenches = s.body_wrenches(thrust=thrust)["thrust"]
        assert np.allclose(wrenches[:, 0], s.thruster_configuration @ limited, rtol=1e-13)
        assert not wrenches[:, 1:].any()
    assert np.array_equal(s.forward_dynamics(thrust=1e6 * np.ones(6)), s.forward_dynamics(thrust=high))


def test_actuators_saturate_with_their_servos() -> None:
    s = Simulator("petasus-pum")
    effort = [link["joint"]["effort"] for link in s.scene["arm"]["links"]]
    assert np.array_equal(s.joint_torques(joint_torque=np.full(5, 1e6))["command"][0], effort)
    torques = s.joint_torques(joint_torque=np.full(5, 1e6), joint_target=np.full(5, -1e9))
    assert np.array_equal(torques["command"][0], -np.array(effort))


def test_a_pose_target_is_a_pair_or_a_pose() -> None:
    s = moving("petasus-pum")
    pose = random_inputs(s)["pose_target"]
    pair = (pose[:, :3, 3], pose[:, :3, :3])
    assert np.array_equal(s.forward_dynamics(pose_target=pose), s.forward_dynamics(pose_target=pair))
    at_home = Simulator("petasus-pum")
    assert not at_home.body_wrenches(pose_target=np.eye(4))["external"].any()
    kp = at_home.scene["vehicle"]["servo"]["kp"]
    push = at_home.body_wrenches(pose_target=(np.array([0.5, 0.0, 0.0]), np.eye(3)))["external"][0, 0]
    assert np.allclose(push, [0.5 * kp[0], 0, 0, 0, 0, 0])


@pytest.mark.parametrize("scene", SCENES)
def test_inverse_dynamics_inverts_forward_dynamics(scene: Any) -> None:
    scene = Simulator(scene).scene
    for link in scene.get("arm", {}).get("links", []):
        link["joint"].pop("effort", None)
    scene["provenance"] = {}
    s = moving(scene)
    inputs = some(random_inputs(s), ("thrust", "external"))
    wanted = np.random.default_rng(0).normal(size=(3, 6 + s.num_joints))
    if is_fixed(s):
        wanted[:, :6] = 0.0
    wrench, torque = s.inverse_dynamics(wanted, **inputs)
    assert wrench.shape == (3, 6)
    got = s.forward_dynamics(wrench=wrench, joint_torque=torque, **inputs)
    assert np.allclose(got, wanted, rtol=0, atol=1e-8)


@pytest.mark.parametrize("bad", [np.zeros(10), np.full(11, np.nan), "up", np.zeros((2, 11))])
def test_inverse_dynamics_refuses_nonsense(bad: Any) -> None:
    with pytest.raises((ValueError, TypeError)):
        moving("petasus-pum").inverse_dynamics(bad)


@pytest.mark.parametrize("name", ["petasus-pum", "bluerov2-heavy"])
def test_trim_holds_the_system(name: str) -> None:
    s = Simulator(name, 2)
    s.set_state(position=[1.0, 2.0, -3.0], current=[0.3, 0.1, 0.0])
    trim = s.trim()
    a = s.forward_dynamics(wrench=trim["wrench"], joint_torque=trim["joint_torque"])
    assert np.abs(a).max() < 1e-9
    allocated = trim["thrust"] @ s.thruster_configuration.T
    assert np.allclose(allocated + trim["residual"], trim["wrench"], rtol=0, atol=1e-9)


def test_allocation_keeps_limits_and_direction() -> None:
    s = Simulator("bluerov2-heavy", 2)
    low, high = s.thruster_limits.T
    wrench = np.array([[10.0, 5.0, -3.0, 0.2, 0.0, 0.5], [1e4, 0.0, 0.0, 0.0, 0.0, 0.0]])
    thrust = s.allocate(wrench)
    assert ((low <= thrust) & (thrust <= high)).all()
    reached = thrust @ s.thruster_configuration.T
    assert np.allclose(reached[0], wrench[0], atol=1e-9)
    assert 0 < reached[1, 0] < 1e4
    assert np.abs(reached[1, 1:]).max() < 1e-9 * reached[1, 0]
    with pytest.raises(ValueError, match="wrench of instance 0, entry 0, is NaN"):
        s.allocate(np.full(6, np.nan))


@pytest.mark.parametrize("scene", SCENES)
def test_the_jacobian_moves_the_end_effector(scene: Any) -> None:
    """Central differences of the pose along [V; q']."""
    s = moving(scene)
    poses = []
    state = {part: getattr(s, part) for part in ("position", "rotation", "q")}
    v, w = s.twist[:, :3], s.twist[:, 3:]
    for step in (-1e-6, 1e-6):
        s.set_state(
            position=state["position"] + step * np.einsum("nij,nj->ni", state["rotation"], v),
            rotation=state["rotation"] @ Rotation.from_rotvec(step * w).as_matrix(),
            q=state["q"] + step * s.qd,
        )
        poses.append(s.end_effector_pose())
    s.set_state(**state)
    back = np.linalg.inv(s.end_effector_pose())
    rate = back @ (poses[1] - poses[0]) / 2e-6
    twist = np.stack([rate[:, 0, 3], rate[:, 1, 3], rate[:, 2, 3], rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    velocity = np.hstack([s.twist, s.qd])
    assert np.allclose(np.einsum("nij,nj->ni", s.jacobian(), velocity), twist, rtol=0, atol=1e-7)


def test_the_first_body_is_the_vehicle() -> None:
    s = moving("petasus-pum")
    pose = s.body_poses()[:, 0]
    assert np.array_equal(pose[:, :3, :3], s.rotation)
    assert np.array_equal(pose[:, :3, 3], s.position)
    assert np.array_equal(pose[:, 3], [[0, 0, 0, 1]] * 3)
    free = moving("free-body")
    assert np.array_equal(free.end_effector_pose(), free.body_poses()[:, 0])


def test_energy_changes_by_power() -> None:
    """Central difference over two steps in still water, with thrusters, wrenches, actuators, drag and friction."""
    s = moving("petasus-pum", dt=1e-4)
    s.set_state(current=[0, 0, 0], current_acceleration=[0, 0, 0])
    inputs = some(random_inputs(s), ("thrust", "wrench", "joint_torque", "external"))
    before = s.energy()["total"]
    s.step(**inputs)
    power = s.power(**inputs)
    s.step(**inputs)
    assert all(np.abs(power[name]).min() > 0 for name in ("damping", "friction", "thrust", "external", "joint_command"))
    total = power.pop("total")
    assert np.allclose(sum(power.values()), total, rtol=1e-12)
    assert np.allclose((s.energy()["total"] - before) / 2e-4, total, rtol=1e-5, atol=1e-5 * np.abs(total).max())


def test_the_mooring_of_a_held_vehicle_needs_no_thrust() -> None:
    trim = Simulator(fixed_base()).trim()
    assert np.abs(trim["wrench"]).max() > 0.0
    assert not trim["thrust"].any()
    assert not trim["residual"].any()


@pytest.mark.parametrize("name", scene_names())
def test_every_scene_stays_at_the_equilibrium_that_trim_finds(name: str) -> None:
    s = Simulator(name)
    trim = s.trim()
    before = state_of(s)
    s.step(wrench=trim["wrench"], joint_torque=trim["joint_torque"], substeps=2000)
    after = state_of(s)
    for part in ("position", "rotation", "q", "twist", "qd"):
        assert np.abs(after[part] - before[part]).max(initial=0.0) < 1e-9
