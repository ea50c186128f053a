"""Station keeping as Python sees it: the PD, scenes, copies."""

import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import uvms_gym
from uvms_gym.controllers import NoControl
from uvms_gym.envs import StationKeepEnv, StationKeepVectorEnv
from uvms_gym.training.evaluation import run_episodes

ENV = "UVMS-StationKeep-v0"
SMALL = "bluerov2-heavy"
SCENES = ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"]


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: uvms_gym.Simulator(SMALL), "Simulator"),
        (lambda: gym.make("CartPole-v1"), "CartPoleEnv"),
        (lambda: gym.make_vec("CartPole-v1", 2), "CartPoleVectorEnv"),
        (lambda: gym.make_vec("CartPole-v1", 2, vectorization_mode="sync"), "CartPoleEnv"),
        (lambda: ENV, "str"),
    ],
)
def test_a_pd_for_something_else_is_refused(make, name):
    with pytest.raises(TypeError, match=f"PD takes a UVMS environment.* {name}$"):
        uvms_gym.PD(make())


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_pd_refuses_observations_that_are_not_finite(value):
    env = StationKeepVectorEnv(3, scene=SMALL)
    pd = uvms_gym.PD(env)
    observations, _ = env.reset(seed=3)
    observations[1, 4] = value
    with pytest.raises(ValueError, match=f"row 1, entry 4 is {value}"):
        pd.predict(observations)
    with pytest.raises(ValueError, match=f"row 0, entry 4 is {value}"):
        pd.predict(observations[1])
    pd.predict(observations[::2])


def test_a_copy_of_the_simulator_does_not_move_the_environment():
    env = StationKeepEnv(scene=SMALL)
    env.reset(seed=1)
    simulator = env.snapshot()
    simulator.step(wrench=np.full((1, 6), 50.0), substeps=10)
    assert not np.array_equal(simulator.position, env.snapshot().position)
    env.step(np.zeros(6))
    assert env.snapshot().time == pytest.approx(0.05)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", ["wrench", "thrusters"])
def test_pd_holds_station_where_idleness_drifts(scene, action):
    envs = StationKeepVectorEnv(8, scene=scene, action=action, max_episode_steps=None)

    pd, idle = (run_episodes(envs, kind(envs), 5, 200) for kind in (uvms_gym.PD, NoControl))
    assert not (pd.terminated | idle.terminated).any()
    # Measured over 1024 episodes: 0.16 m and 0.15 rad at worst, 5 cm in the mean.
    assert pd.last["position_error"].max() < 0.2
    assert pd.last["attitude_error"].max() < 0.2
    assert pd.rms("position_error").mean() < 0.07
    # A current of next to nothing moves no vehicle.
    pushed = np.linalg.norm([pd.last[f"current_{axis}"] for axis in "xyz"], axis=0) > 0.1
    assert pushed.sum() >= 4
    assert (pd.last["position_error"] < 0.5 * idle.last["position_error"])[pushed].all()


def test_pd_is_made_from_any_environment_or_none():
    options = {"scene": SMALL, "action": "thrusters"}
    single, one = gym.make(ENV, **options), uvms_gym.PD(**options)
    single.observation_space.seed(0)
    observations = single.observation_space.sample()[None].repeat(3, axis=0)
    expected, state = one.predict(observations, state="kept", episode_start=np.ones(3), deterministic=False)
    assert (expected.shape, expected.dtype, state) == ((3, 8), np.float32, "kept")
    vectors = (gym.make_vec(ENV, num_envs=2, vectorization_mode=mode, **options) for mode in (None, "sync"))
    for env in (single, *vectors):
        controller = uvms_gym.PD(env)
        np.testing.assert_array_equal(controller.predict(observations)[0], expected)
        np.testing.assert_array_equal(controller.predict(observations[0])[0], expected[0])
        again = pickle.loads(pickle.dumps(controller))
        np.testing.assert_array_equal(again.predict(observations)[0], expected)


def test_pd_gains_are_the_scenes_or_the_users():
    scene = uvms_gym.load_scene(SMALL)
    np.testing.assert_array_equal(uvms_gym.PD(scene=SMALL).kp, scene["vehicle"]["servo"]["kp"])
    other = uvms_gym.PD(scene=SMALL, kp=np.arange(6))
    np.testing.assert_array_equal(other.kp, np.arange(6))
    np.testing.assert_array_equal(other.kd, scene["vehicle"]["servo"]["kd"])
    del scene["vehicle"]["servo"], scene["provenance"]
    with pytest.raises(ValueError, match="gains"):
        uvms_gym.PD(scene=scene)
    for kp in (np.ones(5), [-1.0] * 6, [np.nan] * 6):
        with pytest.raises(ValueError, match="gain"):
            uvms_gym.PD(scene=SMALL, kp=kp)
    with pytest.raises(ValueError, match="entries"):
        other.predict(np.zeros(7, dtype=np.float32))
    with pytest.raises(TypeError, match="pass either env or options, not both: scene"):
        uvms_gym.PD(StationKeepEnv(scene=SMALL), scene=SMALL)


def test_a_scene_may_be_a_dict_or_a_file(tmp_path):
    scene = uvms_gym.load_scene(SMALL)
    env = StationKeepEnv(scene=scene)
    observation, _ = env.reset(seed=4)
    np.testing.assert_array_equal(observation, StationKeepEnv(scene=SMALL).reset(seed=4)[0])
    assert pickle.loads(pickle.dumps(env)).reset(seed=4)[0].tolist() == observation.tolist()
    file = tmp_path / "mine.toml"
    file.write_text((Path(uvms_gym.__file__).parent / "scenes" / f"{SMALL}.toml").read_text())
    for path in (file, str(file)):
        np.testing.assert_array_equal(StationKeepEnv(scene=path).reset(seed=4)[0], observation)


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy-alpha5"])
def test_geared_joints_hold_their_references_in_a_storm(scene):
    """Within a few mrad, by RMS over the episodes: what the water and the vehicle's motion do to servos."""
    envs = gym.make_vec("UVMS-StationKeep-Storm-v0", num_envs=32, scene=scene)
    observations, _ = envs.reset(seed=0)
    pd, state, squares = uvms_gym.PD(envs), None, []
    home = np.array([link["joint"]["home"] for link in uvms_gym.load_scene(scene)["arm"]["links"]])
    (block,) = (block for block in envs.unwrapped.layout if block.name == "joint_reference")
    for _ in range(100):
        reference = home + observations[:, block.slice] * np.array(block.scale)  # at the end of the period
        actions, state = pd.predict(observations, state)
        observations, *_ = envs.step(actions)
        squares.append((envs.unwrapped.snapshot().q - reference) ** 2)
    assert np.sqrt(np.mean(squares, axis=(0, 1))).max() < 0.01
