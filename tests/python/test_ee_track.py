"""End-effector tracking as Python sees it: documentation, references, control, parity, state; residual actions, too."""

import copy
import pickle
import re

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers import assert_parity

import uvms_gym
from uvms_gym._core import task_defaults
from uvms_gym._task.arguments import RESET_OPTIONS
from uvms_gym.envs import (
    INFO,
    EETrackEnv,
    EETrackOptions,
    EETrackVectorEnv,
    Preview,
    StationKeepEnv,
    StationKeepVectorEnv,
    TaskOptions,
    Tolerance,
)

ENV = "UVMS-EETrack-v0"
REWARD = task_defaults("ee-track")["reward"].keys() - {"pose_scale"}
ARM = "bluerov2-heavy-alpha5"
SCENES = ["petasus-pum", ARM, "bluerov2-heavy", "rexrov"]
KINDS = ["point", "line", "circle", "figure-eight", "spline"]
ACTIONS = ["wrench", "thrusters", "residual"]


def span(values):
    low, high = min(values), max(values)
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def tables(env):
    rows = [
        f"| {block.offset} | {block.name} | {block.low[0]:.4g} | {block.high[0]:.4g} | {block.unit} |"
        for block in env.action_layout
    ]
    for block in env.layout:
        first, last = block.offset, block.offset + block.length - 1
        what = f"`{block.name}`: {block.description}"
        bound = span([high / scale for high, scale in zip(block.high, block.scale, strict=True)])
        rows.append(f"| {first}-{last} | {what} | {span(block.scale)} | {bound} | {block.unit} |")
    return rows


def test_documented_tables_are_those_of_the_native_layout():
    documented = [line.strip() for line in EETrackEnv.__doc__.splitlines() if re.match(r"\s*\| \d", line)]
    assert documented == tables(EETrackEnv())


def test_documentation_names_all_arguments_options_and_measures():
    text = StationKeepEnv.__doc__ + EETrackEnv.__doc__
    options = TaskOptions.__doc__ + EETrackOptions.__doc__
    for name in EETrackOptions().to_dict():
        assert re.search(rf"^    (\w+, )*{name}(, \w+)* : ", options, re.MULTILINE), name
    for name in (*RESET_OPTIONS, "render_mode"):
        assert f"`{name}`" in text, name
    for name in (*REWARD, *Tolerance.__annotations__, *Preview.__annotations__):
        assert f"`{name}`" in options, name
    for name in KINDS:
        assert f'"{name}"' in options, name
    for name in INFO:
        assert f"`{name}`" in text or name.startswith(("rms_", "mean_", "end_effector_")), name


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.filterwarnings("error", "ignore::uvms_gym.StepWarning")
def test_gymnasium_finds_nothing_wrong(scene, action):
    check_env(gym.make(ENV, scene=scene, action=action, privileged=True).unwrapped, skip_render_check=True)


def entries(env, name):
    block = next(block for block in env.layout if block.name == name)
    return block.slice, np.array(block.scale)


@pytest.mark.parametrize("reference", [*KINDS, "mixed"])
def test_a_reference_starts_at_rest_at_home_and_moves_at_its_rate(reference):
    envs = EETrackVectorEnv(
        24, reference=reference, max_episode_steps=None, start_distance=0.0, start_angle=0.0, max_current=0.0
    )
    controller = uvms_gym.ResolvedMotion(envs)
    observations, infos = envs.reset(seed=4)
    assert infos["position_error"].max() < 1e-12
    assert infos["attitude_error"].max() < 1e-7
    where, scale = entries(envs, "reference_twist")
    assert np.abs(observations[:, where]).max() == 0.0
    home = envs.snapshot().end_effector_pose()
    np.testing.assert_allclose(envs.episode["target_position"], home[:, :3, 3], atol=1e-12)
    np.testing.assert_allclose(envs.episode["target_rotation"], home[:, :3, :3], atol=1e-12)
    positions, rotations, twists = [], [], []
    for _ in range(200):
        observations = envs.step(controller.predict(observations)[0])[0]
        pose = envs.snapshot().end_effector_pose()[:, :3, :3]
        episode = envs.episode
        positions.append(episode["target_position"])
        rotations.append(episode["target_rotation"])
        twist = (observations[:, where] * scale).reshape(-1, 2, 3)
        twists.append(np.einsum("nij,nkj->nki", pose, twist))
    positions, rotations, twists = map(np.array, (positions, rotations, twists))
    period = 0.05
    velocity = (positions[2:] - positions[:-2]) / (2 * period)
    np.testing.assert_allclose(velocity, twists[1:-1, :, 0], atol=1e-3)
    spin = np.einsum("tnij,tnkj->tnik", rotations[2:] - rotations[:-2], rotations[1:-1]) / (2 * period)
    omega = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    np.testing.assert_allclose(omega, twists[1:-1, :, 1], atol=1e-3)
    assert np.linalg.norm(velocity, axis=-1).max() <= 0.2 * 1.001
    assert np.linalg.norm(positions - home[:, :3, 3], axis=-1).max() <= 3 * 0.4
    moves = np.linalg.norm(velocity, axis=-1).max(axis=0)
    if reference == "point":
        assert moves.max() == 0.0
    elif reference != "mixed":
        assert moves.min() > 0.03
    else:
        assert moves.min() == 0.0 < moves.max()


def test_the_preview_is_where_the_reference_will_be():
    env = EETrackEnv(preview={"points": 2, "spacing": 0.1}, start_distance=0.0)
    controller = uvms_gym.ResolvedMotion(env)
    where, scale = entries(env, "preview")
    observation, _ = env.reset(seed=5)
    seen, targets, poses = [], [], []
    for _ in range(120):
        pose = env.snapshot().end_effector_pose()[0]
        poses.append(pose)
        seen.append((observation[where] * scale).reshape(2, 2, 3))
        targets.append(env.episode["target_position"][0])
        observation = env.step(controller.predict(observation)[0])[0]
    for k in range(0, 110):
        for point, later in ((0, 2), (1, 4)):
            apart = poses[k][:3, :3].T @ (poses[k][:3, 3] - targets[k + later])
            np.testing.assert_allclose(seen[k][point, 0], apart, atol=1e-6)


def test_the_number_of_points_seen_ahead_is_the_users():
    sizes = [EETrackEnv(preview={"points": n}).observation_space.shape[0] for n in (0, 1, 8)]
    assert np.diff(sizes).tolist() == [6, 42]
    with pytest.raises(ValueError, match=re.escape("preview.points")):
        EETrackEnv(preview={"points": 9})


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"reference": "square"}, ValueError, "figure-eight"),
        ({"reference": 3}, TypeError, "reference is 3"),
        ({"reference_rotation": 2.0}, ValueError, "reference_rotation"),
        ({"preview": 3}, TypeError, "preview is 3"),
        ({"preview": {"points": 1.5}}, TypeError, "preview['points'] is 1.5"),
        ({"preview": {"horizon": 1.0}}, ValueError, "points, spacing"),
        ({"tolerance": {"position": -1.0}}, ValueError, "tolerance.position"),
        ({"residual_scale": 2.0}, ValueError, "residual_scale"),
        ({"arm_amplitude": 0.1}, TypeError, "arm_amplitude"),
        ({"privileged": "yes"}, TypeError, "privileged is 'yes'"),
    ],
)
def test_impossible_arguments_are_refused(arguments, error, words):
    for make in (EETrackEnv, EETrackVectorEnv):
        with pytest.raises(error, match=re.escape(words)):
            make(**arguments)


# Measured over 16 episodes of 20 s each, after the first 5 s: see the bounds, which are about twice that.
@pytest.mark.parametrize("reference", KINDS)
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("action", ["wrench", "thrusters"])
def test_resolved_motion_tracks_in_calm_water(scene, reference, action):
    envs = EETrackVectorEnv(
        6, scene=scene, reference=reference, action=action, max_current=0.0, max_episode_steps=None, dtype="float64"
    )
    controller = uvms_gym.ResolvedMotion(envs)
    observations, _ = envs.reset(seed=7)
    errors = []
    for step in range(240):
        observations, _, terminated, _, infos = envs.step(controller.predict(observations)[0])
        assert not terminated.any()
        if step >= 100:
            errors.append([infos["position_error"], infos["attitude_error"]])
    position, attitude = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    assert position < POSITION[scene]
    assert attitude < ATTITUDE[scene]
    assert (infos["success"] == 1.0).all()
    assert (infos["recovery_time"] < 5.0).all()


POSITION = {"petasus-pum": 0.004, ARM: 0.004, "bluerov2-heavy": 0.004, "rexrov": 0.012}
ATTITUDE = {"petasus-pum": 0.015, ARM: 0.03, "bluerov2-heavy": 0.02, "rexrov": 0.06}


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
@pytest.mark.parametrize(("scene", "most"), [("petasus-pum", 0), (ARM, 10)])
def test_random_torques_hardly_make_arms_fly_apart(scene, most):
    envs = EETrackVectorEnv(32, scene=scene, autoreset_mode="SameStep")
    envs.reset(seed=0)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(60):
        ends += envs.step(rng.uniform(-1, 1, envs.action_space.shape))[2].sum()
    # Without the drives' damping 80 of ARM's do.
    assert ends <= most


def test_reward_is_the_sum_of_its_weighted_terms():
    action = np.linspace(-1, 1, 11, dtype=np.float32)

    def terms(**weights):
        env = EETrackEnv(reward=weights)
        env.reset(seed=2)
        _, reward, _, _, info = env.step(action)
        assert reward == pytest.approx(sum(info[f"reward_{term}"] for term in REWARD), rel=1e-14)
        return info

    plain, doubled = terms(), terms(pose=0.2, action_rate=0.0)
    assert doubled["reward_pose"] == pytest.approx(2 * plain["reward_pose"])
    assert doubled["reward_effort"] == plain["reward_effort"] < 0.0
    assert doubled["reward_action_rate"] == 0.0 > plain["reward_action_rate"]
    for name in set(INFO) - {"reward_pose", "reward_action_rate"}:
        assert plain[name] == doubled[name], name


@pytest.mark.parametrize("make", [StationKeepEnv, EETrackEnv])
def test_recovery_time_counts_from_when_the_tolerance_was_left(make):
    env = make(scene="bluerov2-heavy", max_current=0.0, start_distance=0.0, start_angle=0.0)
    observation, info = env.reset(seed=0)
    assert (info["success"], info["recovery_time"], info["diverged"]) == (1.0, 0.0, 0.0)
    controller = (uvms_gym.PD if make is StationKeepEnv else uvms_gym.ResolvedMotion)(env)
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
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("task", ["StationKeep", "EETrack"])
@pytest.mark.parametrize("action", ["wrench", "residual"])
def test_the_vector_environment_keeps_its_contract_and_is_its_single_ones(task, mode, action):
    options = {"scene": ARM, "action": action, "privileged": True, "max_episode_steps": 5}
    envs = gym.make_vec(f"UVMS-{task}-v0", num_envs=3, autoreset_mode=mode, **options)
    assert_parity(envs, lambda: gym.make(f"UVMS-{task}-v0", **options), steps=13)


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_a_copied_environment_goes_on_alike():
    for make in (lambda: gym.make(ENV, scene=ARM), lambda: EETrackVectorEnv(3, max_episode_steps=9)):
        env = make()
        env.reset(seed=11)
        env.action_space.seed(0)
        actions = [0.3 * env.action_space.sample() for _ in range(12)]
        for action in actions[:4]:
            env.step(action)
        fresh = make()
        fresh.reset()
        fresh.unwrapped.set_state(env.unwrapped.get_state())
        others = [copy.deepcopy(env), pickle.loads(pickle.dumps(env)), fresh]
        for action in actions[4:]:
            expected = env.step(action)
            for other in others:
                for a, b in zip(other.step(action)[:4], expected[:4], strict=True):
                    np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(others[0].reset()[0], env.reset()[0])


@pytest.mark.parametrize("make", [StationKeepVectorEnv, EETrackVectorEnv])
def test_corrections_of_zero_leave_the_classical_controller(make):
    classical = uvms_gym.PD if make is StationKeepVectorEnv else uvms_gym.ResolvedMotion
    plain, corrected = make(5, action="wrench"), make(5, action="residual")
    controller = classical(plain)
    (one, _), (other, _) = plain.reset(seed=1), corrected.reset(seed=1)
    width = plain.action_space.shape[1]
    where, _ = entries(plain, "previous_action")
    for _ in range(40):
        one, _, _, _, a = plain.step(controller.predict(one)[0])
        other, _, _, _, b = corrected.step(np.zeros((5, width), dtype=np.float32))
        np.testing.assert_array_equal(np.delete(one, where, 1), np.delete(other, where, 1))
        np.testing.assert_array_equal(a["effort"], b["effort"])
    # A correction is worth its limit.
    before = corrected.get_state()
    push = np.zeros((5, width), dtype=np.float32)
    push[:, 2] = 1.0
    corrected.step(push)
    wanted = controller.predict(one)[0]
    wanted[:, 2] = np.clip(wanted[:, 2] + np.float32(0.3), -1, 1)
    result = plain.step(wanted)[0]
    corrected.set_state(before)
    np.testing.assert_allclose(
        np.delete(corrected.step(push)[0], where, 1), np.delete(result, where, 1), rtol=1e-5, atol=1e-6
    )
    with pytest.raises(ValueError, match="corrections"):
        classical(corrected)


def test_controllers_are_for_their_tasks():
    with pytest.raises(ValueError, match="ResolvedMotion"):
        uvms_gym.PD(EETrackEnv())
    with pytest.raises(ValueError, match="PD"):
        uvms_gym.ResolvedMotion(StationKeepEnv())
    with pytest.raises(ValueError, match="gain"):
        uvms_gym.ResolvedMotion(EETrackEnv(), pose_gain=-1.0)
    controller = uvms_gym.ResolvedMotion(scene=ARM, pose_gain=1.0)
    again = pickle.loads(pickle.dumps(controller))
    observation = EETrackEnv(scene=ARM).reset(seed=0)[0]
    np.testing.assert_array_equal(controller.predict(observation)[0], again.predict(observation)[0])
    np.testing.assert_equal(again.gains, controller.gains)
    assert again.gains["pose_gain"] == 1.0


STORM = "UVMS-EETrack-Storm-v0"
#: Gains for a control period of 0.1 s with measurements 0.1 s late, found by random search on other seeds.
SLOW = {
    **{"pose_gain": 2.1, "twist_gain": 4.2, "joint_gain": 7.6},
    **{"posture_gain": 0.2, "levelling_gain": 0.5, "arm_weight": 2.9},
}
OBSERVING = {
    **{"pose_gain": 3.1, "twist_gain": 5.5, "joint_gain": 6.6},
    **{"posture_gain": 0.2, "levelling_gain": 0.5, "arm_weight": 8.0, "lag_compensation": 0.45},
    **{"observer_bandwidth": [4.3, 4.8, 7.3], "delay": 1},
}


def test_options_of_resolved_motion_at_zero_are_none():
    env = gym.make_vec(STORM, num_envs=3)
    plain = uvms_gym.ResolvedMotion(env)
    same = uvms_gym.ResolvedMotion(env, lag_compensation=0.3, integral_gain=0.0, observer_bandwidth=(0, 0, 0), delay=0)
    assert same.native.widths == plain.native.widths
    assert plain.native.widths[1] == 0
    observations, _ = env.reset(seed=1)
    for _ in range(5):
        actions = plain.predict(observations)[0]
        np.testing.assert_array_equal(same.predict(observations)[0], actions)
        observations = env.step(actions)[0]
    for other in ({"integral_gain": 0.5}, {"observer_bandwidth": (2, 0, 0)}, {"delay": 1}):
        controller, state = uvms_gym.ResolvedMotion(env, **other), None
        for _ in range(2):
            actions, state = controller.predict(observations, state)
        assert np.abs(actions - plain.predict(observations)[0]).max() > 1e-4, other


@pytest.mark.parametrize(
    ("gains", "error", "words"),
    [
        ({"integral_gain": -0.1}, ValueError, "integral_gain"),
        ({"observer_bandwidth": (1.0, float("nan"), 1.0)}, ValueError, "observer_bandwidth[1]"),
        ({"observer_bandwidth": (1.0, 1.0)}, ValueError, "3"),
        ({"lag_compensation": float("inf")}, ValueError, "lag_compensation"),
        ({"delay": 11}, ValueError, "delay is 11"),
        ({"delay": -1}, ValueError, "delay[0] = -1"),
        ({"delay": 0.5}, ValueError, "gain delay is 0.5, but must be a whole number"),
        ({"delay": [1]}, ValueError, "gain delay is [1.0], but must be a number"),
        ({"observer": (1.0, 1.0, 1.0)}, TypeError, "unexpected argument 'observer'; gains: pose_gain, twist_gain"),
    ],
)
def test_bad_gains_of_resolved_motion_are_refused(gains, error, words):
    with pytest.raises(error, match=re.escape(words)):
        uvms_gym.ResolvedMotion(**gains)


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy"])
@pytest.mark.parametrize("gains", [{**SLOW, "integral_gain": 0.4}, OBSERVING])
def test_memory_of_resolved_motion_is_each_instances_own(scene, gains):
    make = lambda n: gym.make_vec(STORM, num_envs=n, scene=scene, max_episode_steps=15)  # noqa: E731
    env = make(5)
    controller = uvms_gym.ResolvedMotion(env, **gains)
    again = pickle.loads(pickle.dumps(controller))
    np.testing.assert_equal(again.gains, controller.gains)
    np.testing.assert_equal(controller.gains, {**uvms_gym.ResolvedMotion(env).gains, **gains})
    env.reset(seed=list(range(5)))
    rollout = uvms_gym.Rollout(env, controller)
    rollout.run(15)
    returns = rollout.pop_stats().returns
    few = make(2)
    observations, _ = few.reset(seed=[0, 1])
    total, state = np.zeros(2), None
    for _ in range(15):
        actions, state = again.predict(observations, state)
        observations, rewards, *_ = few.step(actions)
        total += rewards
    np.testing.assert_allclose(returns[:2], total, rtol=1e-12)


def test_observer_and_prediction_track_better_in_a_storm():
    env = gym.make_vec(STORM, num_envs=16, max_episode_steps=100)

    def errors(gains):
        env.reset(seed=list(range(16)))
        rollout = uvms_gym.Rollout(env, uvms_gym.ResolvedMotion(env, **gains))
        rollout.run(100)
        stats = rollout.pop_stats()
        assert not stats.terminated.any()
        return np.sqrt(((stats.squares["position_error"] + stats.squares["attitude_error"] / 4) / stats.steps).mean())

    usual, slow, integrating = errors({}), errors(SLOW), errors({**SLOW, "integral_gain": 0.4})
    observing = errors(OBSERVING)
    assert observing < 0.8 * min(usual, slow, integrating)
    assert integrating < min(usual, slow)


def test_rollouts_and_networks_work_for_tracking():
    rng = np.random.default_rng(3)
    env = EETrackVectorEnv(7, scene=ARM, max_episode_steps=20)
    d, a = env.single_observation_space.shape[0], env.single_action_space.shape[0]
    weights = [rng.normal(size=(8, d), scale=0.02), rng.normal(size=(a, 8), scale=0.02)]
    mlp = uvms_gym.MLP(env, weights=weights, biases=[np.zeros(8), np.zeros(a)])
    assert mlp.spec["task"] == "UVMS-EETrack"
    for controller in (mlp, uvms_gym.ResolvedMotion(env)):
        observations, _ = env.reset(seed=2)
        rollout = uvms_gym.Rollout(env, controller)
        rollout.run(30)
        stats = rollout.pop_stats()
        observations, _ = env.reset(seed=2)
        returns = np.zeros(7)
        for _ in range(20):
            observations, rewards, *_ = env.step(controller.predict(observations)[0])
            returns += rewards
        np.testing.assert_allclose(stats.returns, returns, rtol=1e-12)
        assert (stats.steps == 20).all()
        assert stats.truncated.all()
    with pytest.raises(ValueError, match="UVMS-EETrack"):
        mlp.native.check(StationKeepEnv(scene=ARM)._native, residual=False)


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
@pytest.mark.parametrize("make", [StationKeepVectorEnv, EETrackVectorEnv])
def test_an_instance_that_diverges_resets_and_its_neighbours_do_not_notice(make):
    def run(start):
        envs = make(3, scene=ARM, max_episode_steps=None, autoreset_mode="SameStep")
        envs.reset(seed=1, options=start)
        seen = []
        for _ in range(6):
            seen.append(envs.step(np.zeros(envs.action_space.shape, dtype=np.float32)))
        return seen

    calm = {"twist": np.zeros((3, 6)), "position": np.zeros((3, 3)), "attitude": [1.0, 0.0, 0.0, 0.0]}
    wild = copy.deepcopy(calm)
    wild["twist"][1, 0] = 9.9
    wild["position"][1, 0] = 9.2
    one, other = run(calm), run(wild)
    assert any(step[2][1] for step in other)
    for a, b in zip(one, other, strict=True):
        for k in range(4):
            np.testing.assert_array_equal(a[k][[0, 2]], b[k][[0, 2]])
        ended = b[2][1]
        if ended:
            assert b[4]["final_info"]["diverged"][1] == 1.0
            assert b[4]["diverged"][1] == 0.0
            cost = 100.0 if make is EETrackVectorEnv else 0.0
            assert b[4]["final_info"]["reward_diverged"][1] == -cost
            assert b[1][1] < -cost
        assert np.isfinite(b[0]).all()


def test_privileged_information_is_the_truth():
    env = EETrackEnv(privileged=True)
    _, info = env.reset(seed=3)
    for _ in range(3):
        _, _, _, _, info = env.step(np.zeros(11))
    parts = {block.name: info["privileged"][block.slice] for block in env.privileged_layout}
    assert sum(block.length for block in env.privileged_layout) == len(info["privileged"])
    simulator, episode = env.snapshot(), env.episode
    np.testing.assert_array_equal(parts["position"], simulator.position[0])
    np.testing.assert_array_equal(parts["rotation"].reshape(3, 3), simulator.rotation[0])
    np.testing.assert_array_equal(parts["twist"], simulator.twist[0])
    np.testing.assert_array_equal(parts["q"], simulator.q[0])
    np.testing.assert_array_equal(parts["current"], episode["current"][0])
    np.testing.assert_array_equal(parts["target_position"], episode["target_position"][0])
    np.testing.assert_array_equal(parts["parameters"], [values[0] for values in simulator.parameters.values()])
    assert "privileged" not in EETrackEnv().reset(seed=3)[1]
    info["privileged"][:] = 0.0
    assert np.abs(env.step(np.zeros(11))[4]["privileged"]).max() > 0.0
