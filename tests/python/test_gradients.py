"""Derivatives of steps: differences of the steps, closed forms, and the laws of products and batches."""

import itertools
from typing import Any

import numpy as np
import pytest
from helpers import is_fixed, random_inputs, random_state
from scipy.spatial.transform import Rotation

from uvms_gym import Simulator, integrators, load_scene, scene_names
from uvms_gym._scene import joints

PRODUCTION = [entry["name"] for entry in integrators() if entry["kind"] == "production"]
PARAMETERS = (
    "mass",
    "added_mass",
    "linear_damping",
    "quadratic_damping",
    "volume",
    "payload",
    "thrust",
    "thruster_lag",
)
#: Increments of differences; of other inputs 0.01 N or N m.
INCREMENTS = {"state": 2e-5, "parameters": 1e-4, "joint_target": 1e-5, "pose_target": 1e-4, "fin": 1e-4}


def with_thruster_dynamics(**terms: Any) -> dict[str, Any]:
    scene = load_scene("petasus-pum")
    for thruster in scene["vehicle"]["thrusters"]:
        thruster.update(terms)
    return scene


def scenes() -> dict[str, dict[str, Any]]:
    """The shipped ones, and one with all terms of thrusters."""
    shipped = {name: load_scene(name) for name in scene_names()}
    # The columns of a saturated servo are below the errors of the differences.
    wrist = next(link for link in shipped["bluerov2-heavy-alpha5-tool"]["arm"]["links"] if link["name"] == "wrist")
    wrist["joint"]["effort"] = 9.0
    # Thrusts are drawn between the limits: with these no servo comes to its limit, a kink, within a difference.
    for scene in shipped.values():
        for thruster in scene["vehicle"].get("thrusters", []):
            if thruster["limits"] == [-40.0, 51.4]:
                thruster["limits"] = [-40.0, 60.0]
    pairs = [[-100.0, -70.0], [-30.0, -18.0], [0.0, 0.0], [20.0, 15.0], [100.0, 80.0]]
    return shipped | {"thrusters": with_thruster_dynamics(lag=0.15, ambient_flow=0.4, map=pairs)}


def set_all(s: Simulator, state: dict[str, np.ndarray], moves: np.ndarray) -> None:
    """States of one instance moved by each row of local coordinates."""
    n, many = s.num_joints, len(moves)
    rotation = state["rotation"]
    parts = {
        "position": state["position"] + moves[:, :3] @ rotation.T,
        "rotation": rotation @ Rotation.from_rotvec(moves[:, 3:6]).as_matrix(),
        "q": state["q"] + moves[:, 6 : 6 + n],
        "qd": state["qd"] + moves[:, 12 + n : 12 + 2 * n],
        "current": np.tile(state["current"], (many, 1)),
        "current_acceleration": np.tile(state["current_acceleration"], (many, 1)),
    }
    if not is_fixed(s):
        parts["twist"] = state["twist"] + moves[:, 6 + n : 12 + n]
    if moves.shape[1] > 12 + 2 * n:
        parts["thrust"] = state["thrust"] + moves[:, 12 + 2 * n :]
    s.set_state(**parts)


def local(s: Simulator, rotation: np.ndarray, position: np.ndarray, size: int) -> np.ndarray:
    """Local coordinates of the states about a pose, to second order."""
    turn = np.einsum("ji,njk->nik", rotation, s.rotation)
    w = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    parts = [(s.position - position) @ rotation, w, s.q, s.twist, s.qd]
    if size > 12 + 2 * s.num_joints:
        parts.append(s.thrust)
    return np.hstack(parts)


def differences(
    scene: dict[str, Any],
    options: dict[str, Any],
    state: dict[str, np.ndarray],
    inputs: dict[str, Any],
    substeps: int,
) -> dict[str, np.ndarray]:
    """The same Jacobians by Richardson's central differences: all in one batch."""
    one = Simulator(scene, 1, **options)
    size = one.step_jacobians()["state"].shape[1]
    widths = {"state": size} | {name: np.size(value) for name, value in inputs.items()}
    if "pose_target" in inputs:
        widths["pose_target"] = 6
    widths["parameters"] = len(PARAMETERS)
    total = sum(widths.values())
    scale = np.concatenate([np.full(width, INCREMENTS.get(name, 1e-2)) for name, width in widths.items()])
    stencil = [1.0, -1.0, 2.0, -2.0]
    moves = np.concatenate([np.diag(scale) * x for x in stencil] + [np.zeros((1, total))])
    # Single steps of any size are to be differentiated, not to be small enough.
    s = Simulator(scene, len(moves), error_estimate=False, **options)
    starts = dict(zip(widths, itertools.accumulate(widths.values(), initial=0), strict=False))
    part = {name: moves[:, first : first + widths[name]] for name, first in starts.items()}
    set_all(s, state, part["state"])
    moved = {}
    for name, value in inputs.items():
        if name == "pose_target":
            rotation, xi = value[:3, :3], part[name]
            poses = np.tile(value, (len(moves), 1, 1))
            poses[:, :3, 3] += xi[:, :3] @ rotation.T
            poses[:, :3, :3] = rotation @ Rotation.from_rotvec(xi[:, 3:]).as_matrix()
            moved[name] = poses
        else:
            moved[name] = value + part[name].reshape(-1, *value.shape)
    factors = np.array([state["factors"][name] for name in PARAMETERS]) + part["parameters"]
    s.scale_parameters(**dict(zip(PARAMETERS, factors.T, strict=True)))
    s.step(**moved, substeps=substeps)
    ends = local(s, s.rotation[-1], s.position[-1], size)[:-1].reshape(4, total, size)
    one_step, two_steps = (ends[0] - ends[1]) / 2, (ends[2] - ends[3]) / 4
    jacobian = ((4 * one_step - two_steps) / 3 / scale[:, None]).T
    return {name: jacobian[:, first : first + widths[name]] for name, first in starts.items()}


#: A simulator of one instance, its state and inputs.
Case = tuple[Simulator, dict[str, Any], dict[str, Any]]


def case(scene: dict[str, Any], options: dict[str, Any], seed: int) -> Case:
    """An instance in motion with factors and inputs of all kinds."""
    s = Simulator(scene, 1, **options)
    random = np.random.default_rng(seed)
    state = random_state(s, seed)
    for i, joint in enumerate(joints(s.scene)):
        # Fingers between their stops.
        if (stop := joint.get("limits")) and stop["upper"] - stop["lower"] < 1.0:
            state["q"][:, i] = np.clip(state["q"][:, i], stop["lower"] + 0.1, stop["upper"] - 0.1)
    s.set_state(**state)
    inputs = {name: value[0] for name, value in random_inputs(s, seed).items()}
    inputs = {name: value for name, value in inputs.items() if value.size}
    if s.num_fins:
        inputs["fin"] = 0.5 * s.fin_limits[:, 1] * random.uniform(-1, 1, s.num_fins)
    if s.num_thrusters:
        low, high = s.thruster_limits.T
        inputs["thrust"] = low + (high - low) * random.uniform(0.2, 0.8, s.num_thrusters)
        if scene["vehicle"]["thrusters"][0].get("lag"):
            s.set_state(thrust=low + (high - low) * random.uniform(0.2, 0.8, s.num_thrusters))
    factors = dict(zip(PARAMETERS, random.uniform(0.7, 1.4, len(PARAMETERS)), strict=True))
    s.scale_parameters(**factors)
    state = {name: getattr(s, name)[0] for name in ("position", "rotation", "twist", "q", "qd", "current", "thrust")}
    state |= {"current_acceleration": s.current_acceleration[0], "factors": factors}
    return s, state, inputs


def assert_differences(scene: dict[str, Any], options: dict[str, Any], case: Case, substeps: int) -> None:
    s, state, inputs = case
    rows = {name: value[None] for name, value in inputs.items()}
    exact = s.step_jacobians(**rows, substeps=substeps, parameters=PARAMETERS)
    expected = differences(scene, options, state, inputs, substeps)
    assert exact.keys() == expected.keys()
    for key, jacobian in expected.items():
        # 1e-8 of the column; and rounding of the differences, over the increment.
        rounding = 1e-13 * max(1.0, np.abs(state["twist"]).max()) / INCREMENTS.get(key, 1e-2)
        bound = 1e-8 * np.abs(jacobian).max(0) + rounding
        error = np.abs(exact[key][0] - jacobian)
        assert np.all(error < bound), (key, (error / bound).max())


@pytest.mark.parametrize("integrator", PRODUCTION)
@pytest.mark.parametrize("name", scenes())
def test_jacobians_are_differences_of_steps(name: str, integrator: str) -> None:
    # A tolerance that leaves steps whole: differences would change the sub-intervals.
    # Short steps for light fingers, which random wrenches would move against their stops, where forces have a kink.
    scene, dt = scenes()[name], 0.002 if "gripper" in name else 0.01
    options = {"integrator": integrator, "dt": dt, "threads": 1, "tolerance": 1e3}
    for seed, substeps in ((1, 1), (2, 3)):
        assert_differences(scene, options, case(scene, options, seed), substeps)


@pytest.mark.parametrize("integrator", ["mk4", "ros2"])
def test_jacobians_are_differences_where_a_turn_divides_the_step(integrator: str) -> None:
    scene, options = load_scene("free-body"), {"integrator": integrator, "dt": 0.01, "threads": 1}
    scene["vehicle"]["body"]["inertia"] = [1.0, 1.4, 2.0]
    s, state, inputs = case(scene, options, 1)
    state["twist"] = np.array([0.3, -0.2, 0.1, 20.0, -60.0, 190.0])
    s.set_state(twist=state["twist"])
    assert_differences(scene, options, (s, state, inputs), 1)


def test_adaptive_sub_intervals_have_the_derivatives_of_the_motion() -> None:
    jacobians = []
    for options, substeps in (({"integrator": "mk54", "dt": 0.1, "tolerance": 1e-10}, 1), ({"dt": 0.1 / 64}, 64)):
        s, _, inputs = case(load_scene("petasus-pum"), options, 1)
        jacobians.append(s.step_jacobians(thrust=inputs["thrust"], substeps=substeps))
    for name, jacobian in jacobians[0].items():
        np.testing.assert_allclose(jacobian, jacobians[1][name], atol=2e-6 * np.abs(jacobian).max())


def test_prescribed_joints_have_the_derivatives_of_their_targets() -> None:
    s = Simulator("petasus-pum", prescribed_joints=True, dt=0.02)
    n, t = s.num_joints, 0.06
    jacobians = s.step_jacobians(joint_target=np.zeros((1, n, 3)), substeps=3)
    q, qd = slice(6, 6 + n), slice(12 + n, 12 + 2 * n)
    by_joints = jacobians["joint_target"][0].reshape(-1, n, 3)
    np.testing.assert_allclose(by_joints[q], np.multiply.outer(np.eye(n), [1, t, t**2]), rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(by_joints[qd], np.multiply.outer(np.eye(n), [0, 1, 2 * t]), rtol=1e-14, atol=1e-16)
    assert not jacobians["state"][0, q, q].any()


def stability_function(integrator: str, z: complex) -> complex:
    """R(z) of a step for v' = lambda v, z = h lambda."""
    taylor = {"mk2": [1, 1, 1 / 2], "mk3": [1, 1, 1 / 2, 1 / 6], "mk4": [1, 1, 1 / 2, 1 / 6, 1 / 24]}
    taylor["mk54"] = [*taylor["mk4"], 1 / 120, 1 / 600]
    if integrator == "ros2":
        return -1 / (1 - z) + 2 / (1 - z / 2) ** 2
    if integrator == "ros3":
        return 0.5 / (1 - z) - 4 / (1 - z / 2) ** 2 + 4.5 / (1 - z / 3) ** 3
    return sum(c * z**k for k, c in enumerate(taylor[integrator]))


def linear_motion(
    integrator: str, h: float, steps: int, m: complex, d: complex, f: complex, v: complex
) -> list[complex]:
    """Way and speed after some steps of `m v' = f - d v`."""
    z, x = -h * d / m, 0.0
    r = stability_function(integrator, z)
    phi = (r - 1) / z
    psi = (phi - 1) / z  # of x' = v under the force, exact for all of these methods but by their own R
    for _ in range(steps):
        x, v = x + h * phi * v + h * h * psi * f / m, r * v + h * phi * f / m
    return [x, v]


def slopes(function: Any, *arguments: float) -> np.ndarray:
    """Derivatives by complex steps, exact to rounding; one column per argument."""
    tiny = 1e-60
    columns = []
    for k in range(len(arguments)):
        moved = [x + tiny * 1j * (i == k) for i, x in enumerate(arguments)]
        columns.append([np.imag(x) / tiny for x in function(*moved)])
    return np.array(columns).T


@pytest.mark.parametrize("integrator", PRODUCTION)
def test_val_linearly_damped_body_and_driven_joint_against_their_closed_form(integrator: str) -> None:
    m, d, f, v, h, steps = 3.0, 5.0, 0.8, 0.4, 0.05, 4
    scene = load_scene("free-body")
    scene["vehicle"]["body"] |= {"mass": m, "damping": {"linear": [d, d, d, 1.0, 1.0, 1.0]}}
    options = {"integrator": integrator, "dt": h, "tolerance": 1e-3}

    def motion(m: complex, d: complex, f: complex, v: complex) -> list[complex]:
        return linear_motion(integrator, h, steps, m, d, f, v)

    of_m, of_d, of_f, of_v = slopes(motion, m, d, f, v).T
    s = Simulator(scene, **options)
    s.set_state(twist=[v, 0, 0, 0, 0, 0])
    wrench = [f, 0, 0, 0, 0, 0]
    jacobians = s.step_jacobians(wrench=wrench, substeps=steps, parameters=["mass", "linear_damping"])
    rows = [0, 6]
    found = [jacobians["parameters"][0, rows, 0] / m, jacobians["parameters"][0, rows, 1] / d]
    found += [jacobians["wrench"][0, rows, 0], jacobians["state"][0, rows, 6]]
    np.testing.assert_allclose(found, [of_m, of_d, of_f, of_v], rtol=1e-12, atol=1e-14)

    joint = {"kind": "revolute", "axis": [0, 0, 1], "friction": {"viscous": d}}
    link = {"name": "link", "joint": joint, "body": {"mass": 1.0, "inertia": [m, m, m]}}
    scene["vehicle"]["fixed"] = True
    scene["arm"] = {"name": "arm", "links": [link]}
    s = Simulator(scene, **options)
    s.set_state(qd=[v])
    jacobians = s.step_jacobians(joint_torque=[f], substeps=steps)
    found = [jacobians["joint_torque"][0, [6, 13], 0], jacobians["state"][0, [6, 13], 13]]
    np.testing.assert_allclose(found, [of_f, of_v], rtol=1e-12, atol=1e-14)


def moving(
    num_envs: int, threads: int = 1, scene: str | dict[str, Any] = "petasus-pum", **options: Any
) -> tuple[Simulator, dict[str, np.ndarray]]:
    s = Simulator(scene, num_envs, threads=threads, **options)
    s.set_state(**random_state(s))
    s.scale_parameters(mass=np.linspace(0.9, 1.1, 40)[:num_envs], payload=np.linspace(0.0, 2.0, 40)[:num_envs])
    return s, random_inputs(s)


@pytest.mark.parametrize(("integrator", "dtype"), [("mk4", "float32"), *((name, "float64") for name in PRODUCTION)])
def test_products_are_those_of_the_jacobians(integrator: str, dtype: str) -> None:
    scene = with_thruster_dynamics(lag=0.15, dead_band=5.0) if dtype == "float64" else "petasus-pum"
    s, inputs = moving(5, scene=scene, integrator=integrator, dtype=dtype)
    inputs["thrust"][:, :2] = 1.5 * s.thruster_limits[:2, 1]  # saturated
    jacobians = s.step_jacobians(**inputs, substeps=2, parameters=PARAMETERS)
    random = np.random.default_rng(4)
    tangents = {name: random.normal(size=(5, jacobian.shape[2])) for name, jacobian in jacobians.items()}
    tangents["wrench"] = random.normal(size=6)
    product = s.step_jvp(tangents, **inputs, substeps=2, parameters=PARAMETERS)
    each = {name: np.broadcast_to(tangent, (5, jacobians[name].shape[2])) for name, tangent in tangents.items()}
    expected = sum(np.einsum("nij,nj->ni", jacobians[name], tangent) for name, tangent in each.items())
    np.testing.assert_allclose(product, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())
    # Products from the left: w (J v) = (w J) v.
    weights = random.normal(size=product.shape)
    left = s.step_vjp(weights, **inputs, substeps=2, parameters=PARAMETERS)
    assert left.keys() == jacobians.keys()
    sums = sum(np.einsum("nj,nj->n", left[name], tangent) for name, tangent in each.items())
    sizes = np.linalg.norm(weights, axis=1) * np.linalg.norm(product, axis=1)
    assert np.all(np.abs(sums - np.einsum("ni,ni->n", weights, product)) < 1e-12 * sizes)
    # Without a servo that keeps a place, translations are not stepped.
    jacobian, state = s.step_jacobians(substeps=2)["state"], tangents["state"]
    expected = np.einsum("nij,nj->ni", jacobian, state)
    np.testing.assert_allclose(s.step_jvp({"state": state}, substeps=2), expected, rtol=1e-13, atol=1e-13)
    left = s.step_vjp(weights, substeps=2)["state"]
    np.testing.assert_allclose(left, np.einsum("ni,nij->nj", weights, jacobian), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_derivatives_depend_on_no_other_instance_nor_on_threads_and_step_nothing(dtype: str) -> None:
    many, inputs = moving(37, threads=2, dtype=dtype)
    before = many.__getstate__()[:, :21]
    jacobians = many.step_jacobians(**inputs, parameters=PARAMETERS)
    weights = np.random.default_rng(8).normal(size=(37, many.state_size))
    products = many.step_vjp(weights, **inputs, parameters=PARAMETERS)
    assert np.array_equal(many.__getstate__()[:, :21], before)
    for count, threads in ((1, 1), (9, 1), (37, 1)):
        s, _ = moving(count, threads, dtype=dtype)
        few = {name: rows[:count] for name, rows in inputs.items()}
        for name, jacobian in s.step_jacobians(**few, parameters=PARAMETERS).items():
            assert jacobian.tobytes() == jacobians[name][:count].tobytes(), (name, count)
        for name, product in s.step_vjp(weights[:count], **few, parameters=PARAMETERS).items():
            assert product.tobytes() == products[name][:count].tobytes(), (name, count)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_instances_with_scenes_of_their_own_have_their_derivatives(dtype: str) -> None:
    masses = np.linspace(100.0, 110.0, 11)
    own = Simulator("petasus-pum", parameters={"vehicle.body.mass": masses}, dtype=dtype)
    state = random_state(own)
    own.set_state(**state)
    all_jacobians = own.step_jacobians(joint_torque=np.ones(5))
    for i in (0, 7, 10):
        alone = Simulator(own.scenes[i], dtype=dtype)
        alone.set_state(**{name: rows[i : i + 1] for name, rows in state.items()})
        for name, jacobian in alone.step_jacobians(joint_torque=np.ones(5)).items():
            assert np.array_equal(jacobian[0], all_jacobians[name][i]), (name, i)


def test_small_steps_are_the_linearization() -> None:
    dt = 1e-6
    s = Simulator("bluerov2-heavy-alpha5", dt=dt)
    s.set_state(**random_state(s))
    a, b = s.linearize(joint_torque=np.zeros(s.num_joints))
    jacobians = s.step_jacobians(wrench=np.zeros(6), joint_torque=np.zeros(s.num_joints))
    rates = (jacobians["state"] - np.eye(len(a[0]))) / dt
    np.testing.assert_allclose(rates, a, atol=1e-4 * np.abs(a).max())
    inputs = np.concatenate([jacobians["wrench"], jacobians["joint_torque"]], axis=2) / dt
    np.testing.assert_allclose(inputs, b, atol=1e-4 * np.abs(b).max())


@pytest.mark.parametrize("terms", [{}, {"lag": 0.2, "ambient_flow": 0.4}])
def test_saturated_thrusts_have_no_derivative_and_a_thrust_of_zero_has_one(terms: dict[str, float]) -> None:
    scene = with_thruster_dynamics(**terms)
    # Without weight nothing moves within the step: inflow would take all of a thrust of 1e-7 N.
    scene["water"]["gravity"] = [0.0, 0.0, 0.0]
    s = Simulator(scene)
    jacobian = s.step_jacobians(thrust=[150.0, 100.0, 0.0, 50.0, -100.0, -200.0])["thrust"][0]
    assert np.array_equal(np.any(jacobian != 0, axis=0), [False, False, True, True, False, False])
    heave = s.step_jacobians(thrust=np.full(6, 1e-7))["thrust"][0]
    np.testing.assert_allclose(s.step_jacobians(thrust=np.zeros(6))["thrust"][0], heave, rtol=1e-6, atol=1e-12)


def test_calls_without_derivatives_say_why() -> None:
    with pytest.raises(ValueError, match="integrator 'quaternion-rk4' has no derivatives of steps: use one of mk4, "):
        Simulator("free-body", integrator="quaternion-rk4").step_jacobians()
    s = Simulator("free-body")
    with pytest.raises(ValueError, match="no parameter 'weight': one of mass, "):
        s.step_jacobians(parameters=["weight"])
    with pytest.raises(ValueError, match="tangents: no argument 'wrench' in this call: state"):
        s.step_jvp({"wrench": np.ones(6)})
    with pytest.raises(ValueError, match=r"cotangents has shape \(3,\), but must have \(12,\) or \(1, 12\)"):
        s.step_vjp(np.ones(3))
    with pytest.raises(ValueError, match=r"tangents\['state'\] has shape \(3,\), but must have \(12,\) or \(1, 12\)"):
        s.step_jvp({"state": np.ones(3)})
