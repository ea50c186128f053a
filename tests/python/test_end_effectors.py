"""Named end effectors of a vehicle with two arms: poses, tasks, controllers, planning and payloads."""

import copy
import pickle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import uvms_gym
from uvms_gym import MLP, NMPC, ResolvedMotion, SceneError, Simulator, load_scene

#: Links of each arm.
LINKS = 4


@pytest.fixture(scope="module", name="scene")
def two_arms() -> dict[str, Any]:
    """A BlueROV2 Heavy with two Alpha 5 arms, 0.4 m apart."""
    scene = load_scene("bluerov2-heavy-alpha5")
    arm = scene["arm"]
    links = []
    for side, shift in (("left", -0.2), ("right", 0.2)):
        for k, link in enumerate(copy.deepcopy(arm["links"])):
            link["name"] = f"{side}-{link['name']}"
            link["parent"] = links[-1]["name"] if k else "base"
            if not k:
                link["joint"]["frame"]["position"][1] += shift
            links.append(link)
    own = arm["end_effector"]
    arm["end_effectors"] = {side: own | {"on": links[k]["name"]} for side, k in (("left", LINKS - 1), ("right", -1))}
    arm |= {"links": links, "end_effector": arm["end_effectors"]["left"]}
    return load_scene(scene | {"name": "two-arms", "provenance": {}})


def displacement(env: Any, controller: Any, name: str, steps: int = 200) -> tuple[float, float]:
    """Maximum displacement of an end effector during an episode, and the last error of the one that tracks, m."""
    (rows, info), state = env.reset(seed=3), None
    start, worst = env.unwrapped.snapshot().end_effector_pose(name)[0, :3, 3], 0.0
    for _ in range(steps):
        action, state = controller.predict(rows, state)
        rows, _, _, _, info = env.step(action)
        now = env.unwrapped.snapshot().end_effector_pose(name)[0, :3, 3]
        worst = max(worst, float(np.linalg.norm(now - start)))
    return worst, float(info["position_error"])


def test_every_end_effector_has_its_pose_and_jacobian(scene: dict[str, Any]) -> None:
    simulator = Simulator(scene)
    assert simulator.end_effector_names == ["left", "right"]
    poses = {name: simulator.end_effector_pose(name) for name in simulator.end_effector_names}
    assert np.linalg.norm((poses["left"] - poses["right"])[0, :3, 3]) == pytest.approx(0.4, abs=1e-12)
    np.testing.assert_array_equal(simulator.end_effector_pose(), poses["left"])
    for name, pose in poses.items():
        chosen = Simulator(scene, end_effector=name)
        np.testing.assert_allclose(chosen.end_effector_pose(), pose, atol=1e-15)
        np.testing.assert_array_equal(chosen.jacobian(), simulator.jacobian(name))
        assert np.any(simulator.jacobian(name)[0, :, 6:], axis=0).tolist() == (
            [name == "left"] * LINKS + [name == "right"] * LINKS
        )
        again = pickle.loads(pickle.dumps(chosen))
        np.testing.assert_array_equal(again.end_effector_pose(), chosen.end_effector_pose())
    one = load_scene(scene, end_effector="right")
    assert one["arm"]["end_effector"] == scene["arm"]["end_effectors"]["right"]
    many = Simulator(
        [scene] * 2, end_effector="right", parameters={"arm.end_effector.position": [[0, 0, 1], [0, 0, 3]]}
    )
    assert np.linalg.norm(np.diff(many.end_effector_pose()[:, :3, 3], axis=0)) == pytest.approx(2.0)


def test_unknown_names_are_refused_in_one_line(scene: dict[str, Any]) -> None:
    known = 'must be one of the end effectors: "left", "right"$'
    for make in (
        lambda: load_scene(scene, end_effector="middle"),
        lambda: Simulator(scene, end_effector="middle"),
        lambda: gym.make("UVMS-EETrack-v0", scene=scene, end_effector="middle"),
        lambda: gym.make_vec("UVMS-StationKeep-v0", num_envs=2, scene=scene, end_effector="middle"),
    ):
        with pytest.raises(ValueError, match=f'end_effector: is "middle", but {known}') as raised:
            make()
        assert "\n" not in str(raised.value)
    with pytest.raises(ValueError, match=r'^no end effector "middle"; the scene has "left", "right"$'):
        Simulator(scene).jacobian("middle")
    with pytest.raises(TypeError, match="end_effector is 3, but must be a string or None"):
        gym.make("UVMS-EETrack-v0", scene=scene, end_effector=3)
    for hold in (["middle"], ["left"], ["right", "right"]):
        with pytest.raises(ValueError, match=r'^gain hold is \[.*\], but must be different ones of \["right"\]'):
            ResolvedMotion(scene=scene, hold=hold)
    with pytest.raises(ValueError, match="the scene has no other end effector"):
        ResolvedMotion(scene="petasus-pum", hold=["left"])
    with pytest.raises(ValueError, match=r"hold .*a list of names"):
        ResolvedMotion(scene=scene, hold=[1.0])
    wrong = copy.deepcopy(scene)
    wrong["arm"]["end_effectors"]["right"]["on"] = "hand"
    with pytest.raises(SceneError, match=r'arm\.end_effectors\.right\.on: is "hand", but must be one of the bodies'):
        load_scene(wrong)


@pytest.mark.parametrize("kind", [ResolvedMotion, NMPC])
@pytest.mark.parametrize("name", ["left", "right"])
def test_the_chosen_end_effector_tracks(scene: dict[str, Any], name: str, kind: Any) -> None:
    env = gym.make("UVMS-EETrack-v0", scene=scene, end_effector=name, max_current=0.0)
    _, error = displacement(env, kind(env), name, 100)
    assert error < 0.02
    pose = env.unwrapped.snapshot().end_effector_pose(name)[0, :3, 3]
    target = env.unwrapped.episode["target_position"][0]
    assert np.linalg.norm(pose - target) == pytest.approx(error, abs=1e-9)


@pytest.mark.parametrize("kind", [ResolvedMotion, uvms_gym.AdaptiveResolvedMotion])
def test_the_other_hand_holds_still(scene: dict[str, Any], kind: Any) -> None:
    # Arms of 0.35 m: both hands reach their targets only where the reference stays near.
    near: dict[str, Any] = {"reference_size": 0.1, "reference_rotation": 0.2, "max_current": 0.0}
    env = gym.make("UVMS-EETrack-v0", scene=scene, end_effector="left", **near)
    moved, _ = displacement(env, kind(env), "right")
    held, error = displacement(env, kind(env, hold=["right"]), "right")
    assert moved > 0.14 and held < 0.014
    assert error < 0.01


def test_rows_that_hold_do_not_depend_on_each_other(scene: dict[str, Any]) -> None:
    env = gym.make_vec("UVMS-EETrack-v0", num_envs=5, scene=scene, end_effector="right", disturbance="storm")
    controller = ResolvedMotion(env, hold=("left",), delay=2, observer_bandwidth=[4.0, 4.0, 8.0], integral_gain=0.1)
    again = pickle.loads(pickle.dumps(controller))
    assert again.hold == ("left",) and list(controller.memory_layout)[:3] == ["integral", "reference", "targets"]
    (rows, _), state = env.reset(seed=1), np.zeros((5, controller.native.widths[1]))
    alone = list(state)
    for _ in range(20):
        actions, state = controller.predict(rows, state)
        for k in range(5):
            action, alone[k] = again.predict(rows[k], alone[k])
            np.testing.assert_array_equal(action, actions[k])
        rows = env.step(actions)[0]


def test_a_payload_stays_where_it_is_and_its_disturbance_is_at_the_chosen_end_effector(scene: dict[str, Any]) -> None:
    body = {"mass": 0.5, "inertia": [0.001, 0.001, 0.001]}
    laden = load_scene(scene | {"payload": {"on": "right", "body": body}})
    masses = [Simulator(laden, end_effector=name).mass_matrix() for name in (None, "left", "right")]
    for mass in masses[1:]:
        np.testing.assert_allclose(mass, masses[0], rtol=1e-12, atol=1e-14)
    # A point mass on top of it, at the end effector in use, moves with the joints of that arm.
    for name, joints in (("left", slice(6, 6 + LINKS)), ("right", slice(6 + LINKS, None))):
        simulator = Simulator(laden, end_effector=name)
        before = simulator.mass_matrix()[0]
        simulator.scale_parameters(payload=1.0)
        added = simulator.mass_matrix()[0] - before
        expected = simulator.jacobian()[0, :3].T @ simulator.jacobian()[0, :3]
        np.testing.assert_allclose(added, expected, atol=1e-12)
        assert np.abs(added[joints, joints]).max() > 1e-3


def test_planning_moves_the_chosen_end_effector(scene: dict[str, Any]) -> None:
    simulator = Simulator(scene, end_effector="right", dt=0.02)
    target = simulator.end_effector_pose()[0, :3, 3] + [0.05, 0.0, 0.05]
    plan = uvms_gym.optimize_trajectory(
        simulator,
        horizon=25,
        substeps=4,
        weights={"twist": 1.0, "qd": 0.1},
        input_weights={"wrench": 1e-4, "joint_torque": 1e-2},
        terminal_weights={"end_effector": 1e4},
        references={"end_effector": target},
    )
    assert np.linalg.norm(plan.end_effector[0, -1] - target) < 1e-2


def test_a_policy_is_for_the_end_effector_of_its_training(scene: dict[str, Any], tmp_path: Path) -> None:
    def policy(env: Any) -> MLP:
        inputs, outputs = env.observation_space.shape[0], env.action_space.shape[0]
        return MLP(env, weights=[np.zeros((outputs, inputs), np.float32)], biases=[np.zeros(outputs, np.float32)])

    left, right = (gym.make("UVMS-EETrack-v0", scene=scene, end_effector=name) for name in ("left", "right"))
    made, file = policy(left), tmp_path / "left.safetensors"
    made.save(file)
    assert made.spec is not None and made.spec["end_effector"] == "left"
    assert MLP.load(file, left).spec == made.spec
    with pytest.raises(ValueError, match="end effector is left, the environment's right"):
        MLP.load(file, right)
    # Files leave out the scene's own, and files without one are for it.
    usual = policy(gym.make("UVMS-StationKeep-v0"))
    usual.save(file)
    assert usual.spec is not None and usual.spec["end_effector"] == "default"
    assert b"end_effector" not in file.read_bytes() and MLP.load(file).spec == usual.spec
