"""The task as Python sees it: documentation, control, refusals, state."""

import copy
import pickle
import re
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import uvms_gym
from uvms_gym._core import task_defaults
from uvms_gym._task.arguments import RESET_OPTIONS
from uvms_gym.envs import INFO, StationKeepEnv, StationKeepOptions, StationKeepVectorEnv, TaskOptions

ENV = "UVMS-StationKeep-v0"
DEFAULTS = StationKeepOptions().to_dict()
REWARD = task_defaults("station-keep")["reward"].keys() - {"pose_scale"}
SMALL = "bluerov2-heavy"
SCENES = ["petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov"]


def span(values):
    low, high = min(values), max(values)
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def test_documented_tables_are_those_of_the_native_layout():
    env = StationKeepEnv()
    rows = [
        f"| {block.offset} | {block.name} | {block.low[0]:.4g} | {block.high[0]:.4g} | {block.unit} |"
        for block in env.action_layout
    ]
    for block in env.layout:
        first, last = block.offset, block.offset + block.length - 1
        what = f"`{block.name}`: {block.description}"
        bound = span([high / scale for high, scale in zip(block.high, block.scale, strict=True)])
        rows.append(f"| {first}-{last} | {what} | {span(block.scale)} | {bound} | {block.unit} |")
    documented = [line.strip() for line in StationKeepEnv.__doc__.splitlines() if re.match(r"\s*\| \d", line)]
    assert documented == rows


def test_documentation_names_all_arguments_options_and_measures():
    text = StationKeepEnv.__doc__
    options = TaskOptions.__doc__ + StationKeepOptions.__doc__
    for name in DEFAULTS:
        assert re.search(rf"^    (\w+, )*{name}(, \w+)* : ", options, re.MULTILINE), name
    for name in (*RESET_OPTIONS, "render_mode"):
        assert f"`{name}`" in text, name
    for name in REWARD:
        assert f"`{name}`" in options, name
    for name in INFO:
        assert f"`{name}`" in text or name.startswith(("rms_", "mean_", "end_effector_")), name


def test_options_are_one_object_or_keywords():
    options = StationKeepOptions(scene=SMALL, substeps=4)
    assert StationKeepEnv(scene=SMALL, substeps=4).options == StationKeepEnv(options).options == options
    assert StationKeepEnv(options, substeps=5).options.to_dict() == {**DEFAULTS, "scene": SMALL}
    assert StationKeepVectorEnv(2, options).options == options
    storm = gym.make("UVMS-StationKeep-Storm-v0", options=options).unwrapped.options
    assert (storm.scene, storm.disturbance, storm.substeps) == (SMALL, "storm", 10)
    with pytest.raises(AttributeError):
        options.dt = 0.1
    for make in (StationKeepEnv, lambda **given: StationKeepVectorEnv(2, **given)):
        with pytest.raises(TypeError, match="options must be StationKeepOptions, not dict"):
            make(options={"scene": SMALL})
        with pytest.raises(TypeError, match="unexpected keyword argument 'speed'; known: scene, action"):
            make(options=options, speed=1.0)


def test_weights_scale_their_terms():
    action = np.linspace(-1, 1, 6, dtype=np.float32)

    def terms(**weights):
        env = StationKeepEnv(scene=SMALL, reward=weights)
        env.reset(seed=2)
        _, reward, _, _, info = env.step(action)
        assert reward == pytest.approx(sum(info[f"reward_{term}"] for term in REWARD), rel=1e-14)
        return info

    plain, doubled, wide = terms(), terms(pose=0.2, action_rate=0.0), terms(pose_scale=0.5)
    error = plain["position_error"] ** 2 + (0.5 * plain["attitude_error"]) ** 2
    for scale, info in ((0.02, plain), (0.5, wide)):
        assert info["reward_pose"] == pytest.approx(-0.1 * (np.log1p(error / scale**2) + np.sqrt(error) / 0.3))
    assert doubled["reward_pose"] == pytest.approx(2 * plain["reward_pose"])
    assert doubled["reward_effort"] == plain["reward_effort"] < 0.0
    assert doubled["reward_action_rate"] == 0.0 > plain["reward_action_rate"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"scene": "submarine"}, "petasus-pum"),
        ({"scene": "free-body"}, "no thrusters"),
        ({"action": "torque"}, "`wrench`"),
        ({"dt": 0.0}, "dt"),
        ({"substeps": 0}, "substeps"),
        ({"integrator": "euler"}, "mk4"),
        ({"dtype": "float16"}, "'float64', 'float32'"),
        ({"max_current": -1.0}, "max_current"),
        ({"reward": {"speed": 1.0}}, "pose, pose_scale, effort, action_rate, diverged"),
        ({"reward": {"pose_scale": 0.0}}, "reward.pose_scale"),
        ({"reward": {"pose": float("nan")}}, "reward.pose"),
        ({"threads": 0}, "threads"),
        ({"render_mode": "ansi"}, "render_mode"),
    ],
)
def test_impossible_arguments_are_refused(arguments, words):
    for make in (StationKeepEnv, StationKeepVectorEnv):
        with pytest.raises(ValueError, match=re.escape(words)):
            make(**arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"max_episode_steps": -1}, ValueError, "max_episode_steps is -1"),
        ({"max_episode_steps": 2**70}, ValueError, f"max_episode_steps is {2**70}"),
        ({"max_episode_steps": "many"}, TypeError, "max_episode_steps is 'many'"),
        ({"num_envs": "3"}, TypeError, "num_envs is '3'"),
        ({"num_envs": 0}, ValueError, "num_envs is 0"),
        ({"num_envs": -1}, ValueError, "num_envs is -1"),
        ({"threads": -1}, ValueError, "threads is -1"),
        ({"threads": 0}, ValueError, "threads is 0"),
        ({"threads": 2**70}, ValueError, f"threads is {2**70}"),
        ({"substeps": 1.5}, TypeError, "substeps is 1.5"),
        ({"substeps": -1}, ValueError, "substeps is -1"),
        ({"dt": "a"}, TypeError, "dt is 'a'"),
        ({"dt": 10**400}, ValueError, "dt is an integer of 1329 bits"),
        ({"max_current": None}, TypeError, "max_current is None"),
        ({"dtype": np.float32}, TypeError, "dtype is <class 'numpy.float32'>"),
        ({"reward": "a"}, TypeError, "reward is 'a'"),
        ({"reward": [1]}, TypeError, "reward is [1]"),
        ({"reward": {"pose": "a"}}, TypeError, "reward['pose'] is 'a'"),
    ],
)
def test_arguments_of_wrong_type_or_size_are_named_with_their_value(arguments, error, words):
    with pytest.raises(error, match=re.escape(words)):
        gym.make_vec(ENV, **arguments)
    if arguments.keys() <= DEFAULTS.keys():
        with pytest.raises(error, match=re.escape(words)):
            StationKeepEnv(**arguments)


def test_unknown_arguments_are_refused():
    for make in (StationKeepEnv, StationKeepVectorEnv):
        with pytest.raises(TypeError, match="depth"):
            make(depth=3)


def test_unknown_reset_options_name_the_known_ones():
    env, envs = StationKeepEnv(scene=SMALL), StationKeepVectorEnv(2, scene=SMALL)
    env.reset(seed=3)
    before = env.get_state()
    for one, known in ((env, RESET_OPTIONS), (envs, (*RESET_OPTIONS, "reset_mask"))):
        with pytest.raises(ValueError, match="unknown reset option 'wind'") as raised:
            one.reset(options={"wind": 1.0})
        assert all(name in str(raised.value) for name in known)
    for options in ({"position": [0.0, 0.0]}, {"position": [0.0, 99.0, 0.0]}, {"current": [np.nan, 0, 0]}):
        with pytest.raises(ValueError, match=next(iter(options)) + "|distance"):
            env.reset(options=options)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


@pytest.mark.parametrize("make", [StationKeepEnv, StationKeepVectorEnv])
@pytest.mark.parametrize("options", [[1], [], "current", 3])
def test_reset_options_that_are_no_dict_are_refused(make, options):
    env = make(scene=SMALL)
    with pytest.raises(TypeError, match="options must be a dict"):
        env.reset(options=options)


@pytest.mark.parametrize(
    ("keep", "error", "words"),
    [
        ((), ValueError, "'physics'"),
        (("physics",), ValueError, "'episodes'"),
        (("episodes",), ValueError, "'physics'"),
        (None, TypeError, "state must be a dict"),
    ],
)
def test_a_state_that_lacks_a_part_is_refused(keep, error, words):
    env = StationKeepEnv(scene=SMALL)
    env.reset(seed=3)
    before = env.get_state()
    with pytest.raises(error, match=words):
        env.set_state(None if keep is None else {part: before[part] for part in keep})
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


@pytest.mark.parametrize("action", [[0.0, [1.0]], None, "abc", [1j] * 6, [[0.0] * 6]])
def test_actions_that_are_none_are_refused_with_what_they_must_be(action):
    env = StationKeepEnv(scene=SMALL)
    env.reset(seed=3)
    with pytest.raises(ValueError, match=r"^action .*\(6,\)"):
        env.step(action)


@pytest.mark.parametrize("dtype", [np.float64, np.float16, np.int64, np.uint8])
def test_actions_of_any_real_type_are_clipped_alike(dtype):
    one, other = StationKeepEnv(scene=SMALL), StationKeepEnv(scene=SMALL)
    one.reset(seed=3)
    other.reset(seed=3)
    given = np.array([0, 1, 2, 0, 100, 1], dtype=dtype)
    np.testing.assert_array_equal(one.step(given)[0], other.step(np.float32([0, 1, 1, 0, 1, 1]))[0])


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


def test_reset_options_give_the_start():
    turn = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    env = StationKeepEnv(scene="bluerov2-heavy-alpha5")
    n = env.snapshot().num_joints
    options = {
        "position": [1.0, 2.0, -3.0],
        "attitude": turn,
        "twist": [0.1, 0.0, 0.0, 0.0, 0.0, 0.2],
        "q": np.full(n, 0.1),
        "qd": np.full(n, -0.1),
        "target_position": [1.0, 2.0, -2.5],
        "target_attitude": turn,
        "current": [0.0, 0.2, 0.0],
    }
    _, info = env.reset(seed=0, options=options)
    simulator, episode = env.snapshot(), env.episode
    np.testing.assert_array_equal(simulator.position, [options["position"]])
    np.testing.assert_allclose(simulator.quaternion, [turn], atol=1e-15)
    np.testing.assert_array_equal(simulator.twist, [options["twist"]])
    np.testing.assert_array_equal(simulator.q, [options["q"]])
    np.testing.assert_array_equal(simulator.qd, [options["qd"]])
    np.testing.assert_array_equal(episode["target_position"], [options["target_position"]])
    np.testing.assert_array_equal(episode["current"], [options["current"]])
    assert info["position_error"] == pytest.approx(0.5)
    assert info["attitude_error"] == pytest.approx(0.0, abs=1e-7)
    assert (info["current_x"], info["current_y"], info["current_z"]) == (0.0, 0.2, 0.0)
    # One row per instance in the vector environment.
    envs = StationKeepVectorEnv(3, scene=SMALL)
    currents = np.array([[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    _, infos = envs.reset(seed=0, options={"current": currents, "position": [0.0, 0.0, 0.5]})
    np.testing.assert_array_equal(infos["current_y"], currents[:, 1])
    np.testing.assert_allclose(infos["position_error"], 0.5)


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

    def run(controller):
        observations, infos = envs.reset(seed=5)
        for _ in range(200):
            actions = controller.predict(observations)[0] if controller else np.zeros(envs.action_space.shape)
            observations, _, terminated, _, infos = envs.step(actions)
            assert not terminated.any()
        return infos

    held, adrift = run(uvms_gym.PD(envs)), run(None)
    # Measured over 1024 episodes: 0.16 m and 0.15 rad at worst, 5 cm in the mean.
    assert held["position_error"].max() < 0.2
    assert held["attitude_error"].max() < 0.2
    assert held["rms_position_error"].mean() < 0.07
    # A current of next to nothing moves nobody.
    pushed = np.linalg.norm([held[f"current_{axis}"] for axis in "xyz"], axis=0) > 0.1
    assert pushed.sum() >= 4
    assert (held["position_error"] < 0.5 * adrift["position_error"])[pushed].all()


def test_pd_takes_an_error_away():
    env = StationKeepEnv(scene="bluerov2-heavy-alpha5", max_current=0.0)
    observation, first = env.reset(seed=0, options={"position": [0.4, -0.3, 0.2]})
    controller = uvms_gym.PD(env)
    errors = [first["position_error"]]
    for _ in range(300):
        action, _ = controller.predict(observation)
        observation, _, _, _, info = env.step(action)
        errors.append(info["position_error"])
    assert errors[0] > 0.5
    assert errors[60] < 0.5 * errors[0]
    assert max(errors[200:]) < 0.1


def test_pd_is_made_from_any_environment_or_none():
    single = gym.make(ENV, scene=SMALL, action="thrusters")
    one = uvms_gym.PD(scene=SMALL, action="thrusters")
    single.observation_space.seed(0)
    observations = single.observation_space.sample()[None].repeat(3, axis=0)
    expected, state = one.predict(observations, state="kept", episode_start=np.ones(3), deterministic=False)
    assert (expected.shape, expected.dtype, state) == ((3, 8), np.float32, "kept")
    native = gym.make_vec(ENV, num_envs=2, scene=SMALL, action="thrusters")
    sync = gym.make_vec(ENV, num_envs=2, vectorization_mode="sync", scene=SMALL, action="thrusters")
    for env in (single, native, sync):
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


def test_a_copied_environment_goes_on_alike():
    for make in (lambda: gym.make(ENV), lambda: StationKeepVectorEnv(3, max_episode_steps=9)):
        env = make()
        env.reset(seed=11)
        env.action_space.seed(0)
        actions = [env.action_space.sample() for _ in range(12)]
        for action in actions[:4]:
            env.step(action)
        others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
        fresh = make()
        fresh.reset()
        fresh.unwrapped.set_state(env.unwrapped.get_state())
        others.append(fresh)
        for action in actions[4:]:
            expected = env.step(action)
            for other in others:
                got = other.step(action)
                assert all(np.array_equal(a, b) for a, b in zip(got[:4], expected[:4], strict=True))
        # The stream of episodes goes on alike too.
        np.testing.assert_array_equal(others[0].reset()[0], env.reset()[0])


def test_saved_states_of_others_are_refused():
    env = StationKeepEnv(scene=SMALL)
    env.reset(seed=0)
    before = env.get_state()
    other = StationKeepEnv(scene="petasus-pum")
    other.reset(seed=0)
    for wrong in (other.get_state(), {**before, "episodes": before["episodes"][:, 1:]}):
        with pytest.raises(ValueError, match="numbers"):
            env.set_state(wrong)
    assert all(np.array_equal(value, before[key]) for key, value in env.get_state().items())


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


def test_import_is_light_and_idempotent():
    code = """
import sys, importlib, warnings
warnings.simplefilter("error")
import gymnasium
import uvms_gym
from uvms_gym._core import task_defaults
heavy = {"torch", "stable_baselines3", "pygame", "matplotlib"} & set(sys.modules)
assert not heavy, heavy
uvms_gym.register_envs()
importlib.reload(uvms_gym)
ids = [name for name in gymnasium.registry if name.startswith("UVMS-StationKeep")]
assert ids == [f"UVMS-StationKeep{variant}-v0" for variant in ("", "-Storm", "-Wide")], ids
"""
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy-alpha5"])
def test_geared_joints_hold_their_references_in_a_storm(scene):
    """Within a few mrad, by RMS over the episodes: what the water and the vehicle's motion do to servos."""
    envs = gym.make_vec("UVMS-StationKeep-Storm-v0", num_envs=32, scene=scene)
    observations, _ = envs.reset(seed=0)
    pd, state, squares = uvms_gym.PD(envs), None, []
    home = np.array([link["joint"]["home"] for link in uvms_gym.load_scene(scene)["arm"]["links"]])
    for _ in range(100):
        reference = home + _block(envs, observations, "joint_reference")  # at the end of the period
        actions, state = pd.predict(observations, state)
        observations, *_ = envs.step(actions)
        squares.append((envs.unwrapped.snapshot().q - reference) ** 2)
    assert np.sqrt(np.mean(squares, axis=(0, 1))).max() < 0.01


def _block(envs, observations, name):
    """Physical values of a block of observations."""
    (block,) = (block for block in envs.unwrapped.layout if block.name == name)
    return observations[:, block.offset : block.offset + block.length] * np.array(block.scale)
