"""Laws of every task: documentation, defaults, options, reward, refusals, copies, divergence."""

import copy
import re
from dataclasses import fields

import gymnasium as gym
import numpy as np
import pytest
from helpers import SMALL, fixed_base, same

import uvms_gym
from uvms_gym._core import task_defaults, tasks
from uvms_gym._task.arguments import RESET_OPTIONS
from uvms_gym._task.options import BATCH_OPTIONS, GROUPS
from uvms_gym.envs import (
    ButtonEnv,
    DockEnv,
    EETrackEnv,
    StationKeepEnv,
    StationKeepOptions,
    TaskOptions,
    ValveEnv,
)

ARM = "bluerov2-heavy-alpha5"
ENVS = {
    "station-keep": StationKeepEnv,
    "ee-track": EETrackEnv,
    "dock": DockEnv,
    "button": ButtonEnv,
    "valve": ValveEnv,
}
CLASSICAL = dict.fromkeys(ENVS, uvms_gym.ResolvedMotion) | {"station-keep": uvms_gym.PD, "dock": uvms_gym.DockPD}
#: Options that the native task does not have.
PYTHON = {"scene", "privileged", *BATCH_OPTIONS}
every_task = pytest.mark.parametrize("task", ENVS)


def vector(task, n, **options):
    """The task's vector environment without Gymnasium's wrappers."""
    return gym.make_vec(f"UVMS-{ENVS[task].__name__.removesuffix('Env')}-v0", num_envs=n, **options).unwrapped


def test_every_task_has_its_dataclass_and_is_tested():
    assert TaskOptions.by_task.keys() == {name for name, _ in tasks()} == ENVS.keys()


@every_task
def test_defaults_match_the_native_module(task):
    native, options = task_defaults(task), TaskOptions.by_task[task]()
    assert {field.name for field in fields(options)} - PYTHON == native.keys() - {"task"}
    for name, value in options.to_dict().items():
        if name in GROUPS:
            assert value is None
            assert GROUPS[name].keys() == native[name].keys(), name
        elif name == "dt":
            # None: half of the scene's step where joints are driven, else the step.
            assert value is None and native[name] == (0.01 if task in ("station-keep", "dock") else 0.005)
        elif name not in PYTHON:
            assert (value, type(value)) == (native[name], type(native[name])), name


def span(values):
    return " to ".join(f"{value:.4g}" for value in sorted({min(values), max(values)}))


@every_task
def test_documented_tables_match_the_native_layout(task):
    env = ENVS[task]()
    rows = [
        f"| {block.offset} | {block.name} | {block.low[0]:.4g} | {block.high[0]:.4g} | {block.unit} |"
        for block in env.action_layout
    ]
    for block in env.layout:
        first, last = block.offset, block.offset + block.length - 1
        what = f"`{block.name}`: {block.description}"
        bound = span([high / scale for high, scale in zip(block.high, block.scale, strict=True)])
        rows.append(f"| {first}-{last} | {what} | {span(block.scale)} | {bound} | {block.unit} |")
    documented = [line.strip() for line in env.__doc__.splitlines() if re.match(r"\s*\| \d", line)]
    assert documented == rows


@every_task
def test_documentation_names_all_arguments_options_and_metrics(task):
    options, env = TaskOptions.by_task[task](), ENVS[task]
    text, options_text = StationKeepEnv.__doc__ + env.__doc__, TaskOptions.__doc__ + options.__doc__
    for name in options.to_dict():
        assert re.search(rf"^    (\w+, )*{name}(, \w+)* : ", options_text, re.MULTILINE), name
        for key in GROUPS.get(name, ()):
            assert f"`{key}`" in options_text, key
    for name in (*RESET_OPTIONS, "render_mode"):
        assert f"`{name}`" in text, name
    for name in env().metric_names:
        assert f"`{name}`" in text or name.startswith(("rms_", "mean_", "end_effector_")), name


@every_task
def test_weights_scale_their_terms(task):
    def terms(**weights):
        env = ENVS[task](scene=SMALL, reward=weights, disturbance=None)
        env.reset(seed=2)
        _, reward, _, _, info = env.step(np.linspace(-1, 1, env.action_space.shape[0], dtype=np.float32))
        parts = [value for name, value in info.items() if name.startswith("reward_")]
        assert len(parts) >= 4 and reward == pytest.approx(sum(parts), rel=1e-14)
        return info

    plain, doubled, wide = terms(), terms(pose=0.2, action_rate=0.0), terms(pose_scale=0.5)
    error = plain["position_error"] ** 2 + (0.5 * plain["attitude_error"]) ** 2
    far = 2.0 if task == "dock" else 0.3
    for scale, info in ((0.02, plain), (0.5, wide)):
        assert info["reward_pose"] == pytest.approx(-0.1 * (np.log1p(error / scale**2) + np.sqrt(error) / far))
    assert doubled["reward_pose"] == pytest.approx(2 * plain["reward_pose"])
    assert doubled["reward_effort"] < 0.0
    assert doubled["reward_action_rate"] == 0.0 > plain["reward_action_rate"]
    for name in plain.keys() - {"reward_pose", "reward_action_rate"}:
        assert plain[name] == doubled[name], name


@every_task
def test_options_are_one_object_or_keywords(task):
    kind, env = TaskOptions.by_task[task], ENVS[task]
    options = kind(scene=SMALL, substeps=4)
    assert env(scene=SMALL, substeps=4).options == env(options).options == options
    assert env(options, substeps=5).options.to_dict() == {**kind().to_dict(), "scene": SMALL, "substeps": 5}
    assert vector(task, 2, options=options).options == options
    with pytest.raises(AttributeError):
        options.dt = 0.1
    for make in (env, lambda **given: vector(task, 2, **given)):
        with pytest.raises(TypeError, match=f"options must be {kind.__name__}, not dict"):
            make(options={"scene": SMALL})
        with pytest.raises(TypeError, match="unexpected keyword argument 'speed'; known: scene, action"):
            make(options=options, speed=1.0)


def test_a_registered_disturbance_stays_beside_options():
    storm = gym.make("UVMS-StationKeep-Storm-v0", options=StationKeepOptions(scene=SMALL, substeps=4)).unwrapped.options
    assert (storm.scene, storm.disturbance, storm.substeps) == (SMALL, "storm", 10)


def limp():
    """A scene with a joint that has no servo."""
    scene = uvms_gym.load_scene(ARM)
    scene["provenance"] = {}
    del scene["arm"]["links"][1]["joint"]["servo"]
    return scene


COMMON = [
    ({"scene": "submarine"}, ValueError, "petasus-pum"),
    ({"scene": "free-body"}, ValueError, "no thrusters"),
    ({"scene": fixed_base()}, ValueError, "fixed"),
    ({"action": "torque"}, ValueError, "`wrench`"),
    ({"dt": 0.0}, ValueError, "dt"),
    ({"dt": "a"}, TypeError, "dt is 'a'"),
    ({"dt": 10**400}, ValueError, "dt is an integer of 1329 bits"),
    ({"substeps": 0}, ValueError, "substeps"),
    ({"substeps": 1.5}, TypeError, "substeps is 1.5"),
    ({"substeps": -1}, ValueError, "substeps is -1"),
    ({"integrator": "euler"}, ValueError, "mk4"),
    ({"dtype": "float16"}, ValueError, "'float64', 'float32'"),
    ({"dtype": np.float32}, TypeError, "dtype is <class 'numpy.float32'>"),
    ({"max_current": -1.0}, ValueError, "max_current"),
    ({"max_current": None}, TypeError, "max_current is None"),
    ({"reward": "a"}, TypeError, "reward is 'a'"),
    ({"reward": [1]}, TypeError, "reward is [1]"),
    ({"reward": {"speed": 1.0}}, ValueError, "pose, pose_scale, effort, action_rate, diverged"),
    ({"reward": {"pose_scale": 0.0}}, ValueError, "reward.pose_scale"),
    ({"reward": {"pose": float("nan")}}, ValueError, "reward.pose"),
    ({"reward": {"pose": "a"}}, TypeError, "reward['pose'] is 'a'"),
    *(({"threads": threads}, ValueError, f"threads is {threads}") for threads in (-1, 0, 2**70)),
    ({"privileged": "yes"}, TypeError, "privileged is 'yes'"),
    ({"tolerance": {"position": -1.0}}, ValueError, "tolerance.position"),
    ({"residual_scale": 2.0}, ValueError, "residual_scale"),
    ({"render_mode": "ansi"}, ValueError, "render_mode"),
]
OWN = [
    ("station-keep", {"start_distance": 10.0}, ValueError, "start_distance"),
    ("station-keep", {"scene": limp()}, ValueError, "upper-arm"),
    ("dock", {"scene": limp()}, ValueError, "upper-arm"),
    ("ee-track", {"reference": "square"}, ValueError, "figure-eight"),
    ("ee-track", {"reference": 3}, TypeError, "reference is 3"),
    ("ee-track", {"reference_rotation": 2.0}, ValueError, "reference_rotation"),
    ("ee-track", {"preview": 3}, TypeError, "preview is 3"),
    ("ee-track", {"preview": {"points": 1.5}}, TypeError, "preview['points'] is 1.5"),
    ("ee-track", {"preview": {"points": 9}}, ValueError, "preview.points"),
    ("ee-track", {"preview": {"horizon": 1.0}}, ValueError, "points, spacing"),
    ("ee-track", {"arm_amplitude": 0.1}, TypeError, "arm_amplitude"),
    ("dock", {"start_clearance": 6.0}, ValueError, "start_clearance"),
    ("dock", {"approach_cone": 2.0}, ValueError, "approach_cone"),
    ("dock", {"dock_sway": 1.1}, ValueError, "dock_sway"),
    ("dock", {"hold_time": -1.0}, ValueError, "hold_time"),
    ("dock", {"arm": "waving"}, ValueError, "waving"),
    ("dock", {"arm": 1}, TypeError, "arm"),
    ("dock", {"preview": {}}, TypeError, "preview"),
]


@pytest.mark.parametrize(("task", "given", "error", "words"), [*((t, *row) for t in ENVS for row in COMMON), *OWN])
def test_impossible_options_are_refused_by_name_and_value(task, given, error, words):
    for make in (ENVS[task], lambda **given: vector(task, 2, **given)):
        with pytest.raises(error, match=re.escape(words)):
            make(**given)


@pytest.mark.parametrize(
    ("name", "value"),
    [*(("max_episode_steps", x) for x in (-1, 2**70, "many")), *(("num_envs", x) for x in (-1, 0, "3"))],
)
def test_impossible_batches_are_refused_by_name_and_value(name, value):
    with pytest.raises(TypeError if isinstance(value, str) else ValueError, match=f"{name} is {value!r}"):
        gym.make_vec("UVMS-StationKeep-v0", **{name: value})


@every_task
@pytest.mark.parametrize("number", ["one", "many"])
def test_bad_reset_options_change_nothing(task, number):
    env = ENVS[task](scene=ARM) if number == "one" else vector(task, 2, scene=ARM)
    env.reset(seed=3)
    before = env.get_state()
    for options in ([1], [], "current", 3):
        with pytest.raises(TypeError, match="options must be a dict"):
            env.reset(options=options)
    with pytest.raises(ValueError, match="unknown reset option 'wind'") as raised:
        env.reset(options={"wind": 1.0})
    assert all(name in str(raised.value) for name in (*RESET_OPTIONS, *["reset_mask"] * (number == "many")))
    # Those of the robot, without fixtures.
    joints = next(block.length for block in env.layout if block.name == "joint_position")
    for options, words in (
        ({"position": [0.0, 0.0]}, "position"),
        ({"position": [0.0, 11.0, 0.0]}, "distance.*1[01].*below 10"),
        ({"current": [np.nan, 0, 0]}, "current"),
        ({"twist": [0.0, 0.0, 0.0, 0.0, 0.0, 30.0]}, "angular speed"),
        ({"attitude": [0.0] * 4}, "attitude"),
        ({"q": [1e300] * joints}, "q"),
        ({"qd": [-1e300] * joints}, "joint rate"),
        ({"q": [0.0]}, "q"),
    ):
        with pytest.raises(ValueError, match=words):
            env.reset(options=options)
    assert same(env.get_state(), before)


@every_task
def test_states_that_lack_a_part_or_are_of_another_environment_change_nothing(task):
    env, other = ENVS[task](scene=SMALL), ENVS[task](scene="petasus-pum")
    env.reset(seed=3)
    other.reset(seed=0)
    before = env.get_state()

    def spoiled(column, value):
        episodes = before["episodes"].copy()
        episodes[0, column] = value
        return {**before, "episodes": episodes}

    for wrong, error, words in (
        (spoiled(0, 0.5), ValueError, "0.5 is not a count"),
        (spoiled(4, -1.0), ValueError, "-1 is not a count"),
        (spoiled(20, np.nan), ValueError, "is NaN"),
        ({}, ValueError, "'physics'"),
        ({"physics": before["physics"]}, ValueError, "'episodes'"),
        ({"episodes": before["episodes"]}, ValueError, "'physics'"),
        (None, TypeError, "state must be a dict"),
        (other.get_state(), ValueError, "numbers"),
        ({**before, "episodes": before["episodes"][:, 1:]}, ValueError, "numbers"),
    ):
        with pytest.raises(error, match=words):
            env.set_state(wrong)
    assert same(env.get_state(), before)


@every_task
def test_corrections_of_zero_leave_the_classical_controller(task):
    plain, corrected = (vector(task, 5, action=action) for action in ("wrench", "residual"))
    controller = CLASSICAL[task](plain)
    (one, _), (other, _) = plain.reset(seed=1), corrected.reset(seed=1)
    correction = np.zeros(plain.action_space.shape, dtype=np.float32)
    where = next(block.slice for block in plain.layout if block.name == "previous_action")
    for _ in range(40):
        one, _, _, _, a = plain.step(controller.predict(one)[0])
        other, _, _, _, b = corrected.step(correction)
        np.testing.assert_array_equal(np.delete(one, where, 1), np.delete(other, where, 1))
        np.testing.assert_array_equal(a["effort"], b["effort"])
    # The maximum correction adds its limit to the action.
    correction[:, 2] = 1.0
    wanted = controller.predict(one)[0]
    wanted[:, 2] = np.clip(wanted[:, 2] + np.float32(0.3), -1, 1)
    ends = [np.delete(envs.step(action)[0], where, 1) for envs, action in ((corrected, correction), (plain, wanted))]
    np.testing.assert_allclose(*ends, rtol=1e-5, atol=1e-6)
    with pytest.raises(ValueError, match="corrections"):
        CLASSICAL[task](corrected)


@pytest.mark.parametrize("task", ["station-keep", "ee-track"])
def test_recovery_time_counts_from_when_the_tolerance_was_left(task):
    env = ENVS[task](scene=SMALL, max_current=0.0, start_distance=0.0, start_angle=0.0)
    observation, info = env.reset(seed=0)
    assert (info["success"], info["recovery_time"], info["diverged"]) == (1.0, 0.0, 0.0)
    controller = CLASSICAL[task](env)
    outside, clock, times = 0, 0.0, []
    push = np.zeros(env.action_space.shape, dtype=np.float32)
    push[0] = 1.0
    for step in range(300):
        action = push if 20 <= step < 40 else controller.predict(observation)[0]
        observation, _, _, _, info = env.step(action)
        assert info["success"] == float(info["position_error"] < 0.05 and info["attitude_error"] < 0.1)
        if info["success"] == 0.0:
            clock = clock + 0.05 if outside else 0.05
        outside = info["success"] == 0.0
        assert info["recovery_time"] == pytest.approx(clock)
        times.append(info["recovery_time"])
    assert times[15] == 0.0 < times[45]
    assert times[-1] == times[-2] > 0.5
    assert 0.0 < info["mean_success"] < 1.0


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
@every_task
def test_an_instance_that_diverges_resets_and_its_neighbours_do_not_notice(task):
    def run(start):
        envs = vector(task, 3, scene=ARM, max_episode_steps=None, autoreset_mode="SameStep")
        envs.reset(seed=1, options=start)
        return [envs.step(np.zeros(envs.action_space.shape, dtype=np.float32)) for _ in range(6)]

    calm = {"twist": np.zeros((3, 6)), "position": np.zeros((3, 3)), "attitude": [1.0, 0.0, 0.0, 0.0]}
    wild = copy.deepcopy(calm)
    wild["twist"][1, 0] = 9.9
    wild["position"][1, 0] = 9.2
    one, other = run(calm), run(wild)
    assert any(step[2][1] for step in other)
    cost = task_defaults(task)["reward"]["diverged"]
    assert cost == {"station-keep": 0.0, "dock": 500.0}.get(task, 100.0)
    for a, b in zip(one, other, strict=True):
        for k in range(4):
            np.testing.assert_array_equal(a[k][[0, 2]], b[k][[0, 2]])
        if b[2][1]:
            assert b[4]["final_info"]["diverged"][1] == 1.0
            assert b[4]["diverged"][1] == 0.0
            assert b[4]["final_info"]["reward_diverged"][1] == -cost
            assert b[1][1] < -cost
        assert np.isfinite(b[0]).all()


@every_task
def test_privileged_information_is_the_truth(task):
    env = ENVS[task](privileged=True)
    env.reset(seed=3)
    idle = np.zeros(env.action_space.shape)
    for _ in range(3):
        _, _, _, _, info = env.step(idle)
    parts = {block.name: info["privileged"][block.slice] for block in env.privileged_layout}
    assert sum(block.length for block in env.privileged_layout) == len(info["privileged"])
    simulator, episode = env.snapshot(), env.episode
    truth = {name: getattr(simulator, name)[0].ravel() for name in ("position", "rotation", "twist", "q")}
    truth |= {name: episode[name][0] for name in ("current", "target_position")}
    truth |= {"parameters": [values[0] for values in simulator.parameters.values()]}
    for name, value in truth.items():
        np.testing.assert_array_equal(parts[name], value)
    assert "privileged" not in ENVS[task]().reset(seed=3)[1]
    info["privileged"][:] = 0.0
    assert np.abs(env.step(idle)[4]["privileged"]).max() > 0.0
