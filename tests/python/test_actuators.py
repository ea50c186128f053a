"""Actuators: prescribed joints, driven exactly along their targets; thrusters with dynamics; fins."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from helpers import assert_same, lagging, state_of

from uvms_gym import SceneError, Simulator, load_scene


def cubic(simulator: Simulator, end: np.ndarray, period: float) -> np.ndarray:
    """(N, n, 4) from the present coordinates and rates to `end` at rest after `period`."""
    q, v = simulator.q, simulator.qd
    c = (3 * (end - q) / period - 2 * v) / period
    d = (v - 2 * (end - q) / period) / period**2
    return np.stack([q, v, c, d], axis=-1)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("integrator", ["mk4", "ros2"])
def test_joints_end_where_their_targets_do(integrator: str, dtype: str) -> None:
    s = Simulator("petasus-pum", 3, dtype=dtype, integrator=integrator, prescribed_joints=True)
    end = s.q + np.array([[0.1], [0.2], [-0.3]])
    s.step(joint_target=cubic(s, end, 0.5), substeps=50)
    np.testing.assert_allclose(s.q, end, atol=1e-12 if dtype == "float64" else 1e-6)
    np.testing.assert_allclose(s.qd, 0, atol=1e-12 if dtype == "float64" else 1e-6)
    assert np.abs(s.twist).max() > 1e-3, "the vehicle reacts"


def test_without_targets_joints_keep_their_rates() -> None:
    s = Simulator("petasus-pum", prescribed_joints=True)
    start = s.q
    s.set_state(qd=[0.1, 0, 0, 0, -0.2])
    s.step(substeps=100)
    np.testing.assert_allclose(s.q - start, [[0.1, 0, 0, 0, -0.2]], atol=1e-12)
    assert np.abs(s.joint_torques()["command"]).min() > 0


def test_names_indices_and_the_scene_mean_the_same() -> None:
    scene = load_scene("petasus-pum")
    for i in (1, 2):
        scene["arm"]["links"][i]["joint"]["prescribed"] = True
    given = [Simulator("petasus-pum", prescribed_joints=p) for p in (["upper-arm", "forearm"], [1, 2], (1, "forearm"))]
    given.append(Simulator(scene))
    for s in given:
        s.step(joint_target=s.q + 0.1, substeps=20)
        assert s.scene["arm"]["links"][1]["joint"]["prescribed"]
        assert_same(state_of(s), state_of(given[0]))
    for other in (copy.deepcopy(given[0]), pickle.loads(pickle.dumps(given[0]))):
        assert other.scene == given[0].scene


@pytest.mark.parametrize("given", [["shoulder"], [5], [-1], [0.5], [None]])
def test_unknown_joints_are_named(given: list[object]) -> None:
    with pytest.raises(ValueError, match=r"prescribed_joints: no joint .*; joints: yaw, upper-arm"):
        Simulator("petasus-pum", prescribed_joints=given)  # type: ignore[arg-type]


def test_drive_torques_do_the_work_that_servos_would() -> None:
    """Inverse dynamics at the hybrid accelerations gives the drives' torques, and no wrench on the vehicle."""
    s = Simulator("bluerov2-heavy-alpha5", 4, prescribed_joints=[0, 2])
    rng = np.random.default_rng(0)
    s.set_state(qd=0.3 * rng.normal(size=(4, 4)), twist=0.2 * rng.normal(size=(4, 6)))
    target = cubic(s, s.q + 0.2, 1.0)
    acceleration = s.forward_dynamics(joint_target=target)
    np.testing.assert_allclose(acceleration[:, [6, 8]], 2 * target[:, [0, 2], 2], atol=1e-12)
    torque = s.joint_torques(joint_target=target)["command"]
    wrench, needed = s.inverse_dynamics(acceleration)
    np.testing.assert_allclose(torque, needed, atol=1e-10)
    np.testing.assert_allclose(wrench, 0, atol=1e-10)


def test_arms_of_station_keeping_may_be_prescribed() -> None:
    scene = load_scene("petasus-pum")
    for link in scene["arm"]["links"]:
        link["joint"]["prescribed"] = True
        del link["joint"]["servo"]
    scene["provenance"] = {}
    env = gymnasium.make("UVMS-StationKeep-v0", scene=scene, disturbance="storm")
    env.reset(seed=1)
    for _ in range(50):
        observation, *_ = env.step(np.zeros(env.action_space.shape, np.float32))
    assert np.isfinite(observation).all()
    with pytest.raises(ValueError, match='joint "yaw" is prescribed'):
        gymnasium.make("UVMS-EETrack-v0", scene=scene)


def test_thrust_is_a_state_that_follows_its_command() -> None:
    s = Simulator(lagging(), 2, dt=0.01)
    command = np.array([10.0, -5.0, 0.0, 20.0, 1.0, 2.0, 3.0, -30.0])
    s.step(thrust=command, substeps=7)
    np.testing.assert_allclose(s.thrust, np.tile(command * (1.0 - np.exp(-0.7)), (2, 1)), rtol=1e-12)
    s.set_state(thrust=command)
    np.testing.assert_array_equal(s.thrust[1], command)
    s.step(thrust=command)
    np.testing.assert_array_equal(s.thrust[1], command)
    s.set_state(position=[1.0, 2.0, 3.0])
    np.testing.assert_array_equal(s.thrust[0], command)
    s.reset()
    assert not s.thrust.any()


def test_a_factor_stretches_the_lag() -> None:
    s = Simulator(lagging(), 3)
    s.scale_parameters(thruster_lag=[1.0, 2.0, 0.0])
    np.testing.assert_array_equal(s.parameters["thruster_lag"], [1.0, 2.0, 0.0])
    s.step(thrust=np.full(8, 30.0), substeps=10)
    np.testing.assert_allclose(s.thrust[:, 0], 30.0 * (1.0 - np.exp([-1.0, -0.5, -np.inf])), rtol=1e-12)


def test_books_have_what_acts_now() -> None:
    s = Simulator(lagging())
    ask = np.full(8, 10.0)
    assert not s.body_wrenches(thrust=ask)["thrust"].any()
    s.set_state(thrust=ask)
    expected = s.thruster_configuration @ ask
    np.testing.assert_allclose(s.body_wrenches()["thrust"][0, 0], expected, atol=1e-12)


def test_thrust_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="have no dynamics"):
        Simulator("bluerov2-heavy").set_state(thrust=np.zeros(8))
    with pytest.raises(ValueError, match=r"thrust 0 of instance 0 is 61 N, but must be within \[-40, 51.4\]"):
        Simulator(lagging()).set_state(thrust=np.full(8, 61.0))
    with pytest.raises(SceneError, match=r"thruster_lag: is -1\.0, but must be >= 0"):
        Simulator(lagging(-1.0))
    assert not Simulator("bluerov2-heavy").thrust.any()


def test_fins_are_commanded_within_their_limits() -> None:
    s = Simulator("remus-100", 2)
    assert s.num_fins == 6
    assert s.fin_names[0] == "rudder-top"
    np.testing.assert_array_equal(s.fin_limits[[0, -1]], [[-0.237, 0.237], [0.0, 0.0]])
    s.set_state(twist=[1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    lift = s.body_wrenches(fin=np.full((2, 6), 9.0))["fins"]
    np.testing.assert_array_equal(lift, s.body_wrenches(fin=np.full(6, 0.237))["fins"])
    assert np.abs(lift[:, 0, 1]).min() > 1.0
    assert not s.body_wrenches()["fins"].any()
    s.step(fin=np.full(6, 0.1), thrust=[3.0])
    assert (s.twist[:, 5] < 0.0).all()
