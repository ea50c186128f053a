"""The vector environment as Stable-Baselines3 has it."""

import copy
import pickle

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest
from helpers import LEAVING, SMALL, fake_moviepy, policies, same

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecVideoRecorder,
)

from uvms_gym.sb3 import NativeVecEnv, make_vec_env

pytestmark = pytest.mark.learning

ENV = "UVMS-StationKeep-v0"


def native(n=3, steps=4, seed=None, **options):
    return make_vec_env(ENV, n, seed, max_episode_steps=steps, **{"scene": SMALL, **options})


def dummy(n=3, steps=4, seed=None, monitor=True, **options):
    def make():
        env = gym.make(ENV, max_episode_steps=steps, **{"scene": SMALL, **options})
        return Monitor(env) if monitor else env

    venv = DummyVecEnv([make] * n)
    venv.seed(seed)
    return venv


def reset_alike(one, other, seed=None, options=None):
    for venv in (one, other):
        if seed is not None:
            venv.seed(seed)
        if options is not None:
            venv.set_options(options)
    assert same(one.reset(), other.reset())
    assert same(one.reset_infos, other.reset_infos)


def timeless(infos):
    """Infos without what a clock says."""
    infos = copy.deepcopy(infos)
    for info in infos:
        assert info["episode"].pop("t") >= 0.0
    return infos


def assert_same_run(one, other, steps, seed=0):
    """Step both alike; the dones."""
    rng = np.random.default_rng(seed)
    ends = []
    for _ in range(steps):
        actions = rng.uniform(-1.0, 1.0, (one.num_envs, *one.action_space.shape)).astype(np.float32)
        (observations, rewards, dones, infos), expected = one.step(actions), other.step(actions)
        assert same((observations, rewards, dones), expected[:3])
        over = np.flatnonzero(dones)
        assert same(timeless([infos[i] for i in over]), timeless([expected[3][i] for i in over]))
        assert same(one.reset_infos, other.reset_infos)
        ends.append(dones)
    return np.array(ends)


@pytest.mark.parametrize("scene", [SMALL, "petasus-pum"])
@pytest.mark.parametrize("n", [1, 3])
def test_it_is_a_dummy_vec_env_of_singles(scene, n):
    options = {"scene": scene, "substeps": 2, "seed": 7}
    one, other = native(n, 5, **options), dummy(n, 5, **options)
    assert one.observation_space == other.observation_space
    assert one.action_space == other.action_space
    assert one.metadata == other.metadata
    assert one.render_mode is other.render_mode is None
    reset_alike(one, other)
    assert_same_run(one, other, 12)
    # Without a new seed the streams go on.
    reset_alike(one, other)
    assert one.seed(3) == other.seed(3) == [3 + i for i in range(n)]
    reset_alike(one, other)
    assert_same_run(one, other, 6)


def test_divergence_is_no_time_out():
    one, other = native(steps=50), dummy(steps=50)
    reset_alike(one, other, 1, [LEAVING, {}, {**LEAVING, "twist": np.zeros(6)}])
    ends = assert_same_run(one, other, 55)
    assert ends[:, 0].sum() > ends[:, 1].sum() == 1
    one.set_options(LEAVING)
    one.reset()
    dones = [False]
    while not dones[0]:
        _, _, dones, infos = one.step(np.zeros((3, 6)))
    assert infos[0]["TimeLimit.truncated"] is False


@pytest.mark.parametrize(
    "options",
    [
        {"position": [0.0, 0.0, 0.5]},
        [{"position": [0.0, 0.0, 0.1 * i]} for i in range(3)],
        [{}, {"position": [0.0, 0.0, 0.5], "current": None}, {"current": [0.1, 0.0, 0.0]}],
    ],
)
def test_options_are_for_one_reset_and_may_differ(options):
    one, other = native(), dummy()
    reset_alike(one, other, 5, options)
    reset_alike(one, other)


def test_a_refused_reset_keeps_seeds_and_options():
    venv = native(seed=5)
    venv.set_options({"wind": 1.0})
    for _ in range(2):
        with pytest.raises(ValueError, match="unknown reset option 'wind'"):
            venv.reset()
    venv.set_options([{}, {}])
    with pytest.raises(ValueError, match="options of 2 instances"):
        venv.reset()
    venv.set_options()
    assert same(venv.reset(), dummy(seed=5).reset())


def test_infos_are_dicts_of_their_own_and_full_only_where_an_episode_ended():
    venv = native(steps=3, seed=0)
    venv.reset()
    seen = []
    for step in range(7):
        _, _, dones, infos = venv.step(np.zeros((3, 6)))
        seen += infos
        for done, info in zip(dones, infos, strict=True):
            assert bool(info) is bool(done)
            info["mine"] = step
        assert venv.infos["position_error"].shape == (3,)
    assert len({id(info) for info in seen}) == len(seen)
    finals = [info["terminal_observation"] for info in seen if "episode" in info]
    assert len(finals) == 6
    assert not any(np.shares_memory(a, b) for a in finals for b in finals if a is not b)
    assert [info["episode"]["l"] for info in seen if "episode" in info] == [3] * 6


def test_refused_actions_change_nothing():
    one, other = native(seed=2), native(seed=2)
    reset_alike(one, other)
    for wrong in (np.full((3, 6), np.nan), np.zeros((2, 6)), None):
        with pytest.raises(ValueError, match="action"):
            one.step(wrong)
    assert_same_run(one, other, 6)


def test_other_vector_environments_and_steps_before_a_reset_are_refused():
    with pytest.raises(gym.error.ResetNeeded):
        native().step(np.zeros((3, 6)))
    with pytest.raises(ValueError, match="SameStep"):
        NativeVecEnv(gym.make_vec(ENV, 2, scene=SMALL))
    with pytest.raises(TypeError, match="not TimeLimit"):
        NativeVecEnv(gym.make(ENV, scene=SMALL))


def test_an_environment_that_does_not_reset_itself_is_reset():
    envs = gym.make_vec(ENV, 3, scene=SMALL, autoreset_mode="Disabled", max_episode_steps=5)
    one, other = NativeVecEnv(envs), dummy(steps=5)
    reset_alike(one, other, 1, [LEAVING, {}, {}])
    ends = assert_same_run(one, other, 12)
    assert (ends[:, 0] != ends[:, 1]).any()


def test_a_wrapped_vector_environment_is_taken():
    envs = gym.make_vec(ENV, 2, scene=SMALL, autoreset_mode="SameStep", max_episode_steps=3)
    venv = NativeVecEnv(gym.wrappers.vector.TransformReward(envs, lambda rewards: 2.0 * rewards))
    plain = native(2, 3)
    for env in (venv, plain):
        env.seed(0)
        env.reset()
    for _ in range(4):
        got, expected = venv.step(np.zeros((2, 6))), plain.step(np.zeros((2, 6)))
        assert same(got[0], expected[0])
        np.testing.assert_allclose(got[1], 2.0 * expected[1], rtol=1e-6)
    assert venv.env_is_wrapped(gym.wrappers.vector.TransformReward) == [True, True]
    assert venv.get_attr("layout")[0] == plain.get_attr("layout")[0]


def test_attributes_of_single_instances():
    venv, singles = native(seed=3), dummy(seed=3)
    reset_alike(venv, singles)
    for env in (venv, singles):
        assert env.get_attr("render_mode") == [None] * 3
        assert env.get_attr("observation_space", 0) == [env.observation_space]
        assert env.get_attr("action_space", [0, -1]) == [env.action_space] * 2
        assert env.has_attr("action_layout")
        assert not env.has_attr("action_masks")
        with pytest.raises(AttributeError, match="action_masks"):
            env.get_attr("action_masks")
        env.set_attr("level", 3, indices=[0, 2])
        env.set_attr("level", 4, indices=2)
        assert env.get_attr("level", [2, 0]) == [4, 3]
        assert not env.has_attr("level")
        env.set_attr("options", None)
        assert env.get_attr("options") == [None] * 3
    for name in ("metadata", "layout", "action_layout"):
        assert venv.get_attr(name) == singles.get_attr(name)
    for got, expected in zip(venv.get_attr("episode"), singles.get_attr("episode"), strict=True):
        assert same(got, expected)
    snapshots = (env.env_method("snapshot", indices=[2, 1]) for env in (venv, singles))
    for got, expected in zip(*snapshots, strict=True):
        assert got.num_envs == expected.num_envs == 1
        for part in ("position", "rotation", "twist", "q", "qd", "current"):
            assert same(getattr(got, part), getattr(expected, part))
    assert venv.spec.id == ENV


def test_methods_of_single_instances():
    # A TimeLimit of Gymnasium's would not go back with the state.
    venv, singles = native(steps=50, seed=3), dummy(steps=50, seed=3)
    reset_alike(venv, singles)
    for env in (venv, singles):
        states = env.env_method("get_state", indices=[1, 2])
        env.step(np.zeros((3, 6)))
        env.env_method("set_state", states[0], indices=1)
        assert same(env.env_method("get_state", indices=1)[0], states[0])
    assert same(venv.env_method("get_state"), singles.env_method("get_state"))
    arguments = {"seed": 11, "options": {"position": [0.0, 0.0, 0.5]}}
    got, expected = (env.env_method("reset", indices=[2, 0], **arguments) for env in (venv, singles))
    assert same(got, expected)
    assert_same_run(venv, singles, 9)
    with pytest.warns(UserWarning, match="render mode"):
        assert venv.env_method("render", indices=0) == [None]
    with pytest.raises(AttributeError, match="'compute' cannot be called"):
        venv.env_method("compute", 3)


def test_wrapper_queries():
    venv = native()
    assert venv.env_is_wrapped(Monitor) == [True] * 3
    assert venv.env_is_wrapped(gym.wrappers.TimeLimit, indices=[0]) == [False]
    bare = native(monitor=False, steps=1)
    assert bare.env_is_wrapped(Monitor, 0) == [False]
    bare.reset()
    assert all("episode" not in info for info in bare.step(np.zeros((3, 6)))[3])


def test_copies_go_on_alike():
    venv = native(steps=5, seed=4)
    venv.reset()
    venv.set_attr("level", 1)
    venv.step(np.ones((3, 6)))
    for other in (copy.deepcopy(venv), pickle.loads(pickle.dumps(venv)), cloudpickle.loads(cloudpickle.dumps(venv))):
        assert_same_run(other, copy.deepcopy(venv), 9)
        assert other.get_attr("level") == [1] * 3


def test_without_a_seed_numpy_decides():
    starts = []
    for make in (native, native, dummy):
        np.random.seed(3)  # noqa: NPY002 (Stable-Baselines3 draws from it)
        starts.append(make().reset())
    assert same(starts[0], starts[1])
    assert same(starts[0], starts[2])


def learn(venv, steps=128, **options):
    model = PPO("MlpPolicy", venv, n_steps=16, batch_size=32, n_epochs=2, seed=0, device="cpu")
    return model.learn(steps, **options)


def test_ppo_learns_alike_in_both(tmp_path):
    models = [learn(venv) for venv in (native(4, 9), dummy(4, 9))]
    first, second = (model.policy.state_dict() for model in models)
    assert all(bool((first[name] == second[name]).all()) for name in first)
    assert len(models[0].ep_info_buffer) == len(models[1].ep_info_buffer) > 0
    models[0].save(tmp_path / "model")
    again = PPO.load(tmp_path / "model", env=native(4, 9), device="cpu")
    again.learn(64)


def test_off_policy_learning_works():
    model = SAC("MlpPolicy", native(2, 6), learning_starts=16, batch_size=8, buffer_size=100, device="cpu", seed=0)
    model.learn(40)
    assert len(model.ep_info_buffer) > 0


def test_evaluation_works_as_on_single_environments(tmp_path):
    folders = {"log_path": str(tmp_path), "best_model_save_path": str(tmp_path)}
    callback = EvalCallback(native(2, 5), n_eval_episodes=3, eval_freq=16, verbose=0, **folders)
    model = learn(native(4, 9), callback=callback)
    assert (tmp_path / "best_model.zip").is_file()
    lengths = np.load(tmp_path / "evaluations.npz")["ep_lengths"]
    assert lengths.tolist() == [[5, 5, 5]] * len(callback.evaluations_results)
    got, expected = (
        evaluate_policy(model, venv, 5, return_episode_rewards=True) for venv in (native(2, 5, 8), dummy(2, 5, 8))
    )
    assert got == expected


@pytest.mark.parametrize("controller", policies(), ids=lambda controller: type(controller).__name__)
def test_controllers_are_evaluated_as_policies_are(controller):
    got, expected = (
        evaluate_policy(controller, venv, 4, return_episode_rewards=True)
        for venv in (native(2, 20, 0), dummy(2, 20, 0))
    )
    assert got == expected


@pytest.mark.parametrize("wrap", [VecNormalize, VecCheckNan, lambda venv: VecFrameStack(venv, 3), VecMonitor])
def test_wrappers_work_as_on_a_dummy(wrap, tmp_path):
    one, other = (wrap(make(seed=6, monitor=wrap is not VecMonitor)) for make in (native, dummy))
    assert same(one.reset(), other.reset())
    assert_same_run(one, other, 10)
    if wrap is VecNormalize:
        one.save(tmp_path / "statistics.pkl")
        again = VecNormalize.load(tmp_path / "statistics.pkl", native(seed=6))
        assert again.obs_rms.count == one.obs_rms.count


def test_a_second_monitor_is_warned_of_as_ever():
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        VecMonitor(native())


def test_a_monitor_writes_its_file(tmp_path):
    venv = VecMonitor(native(4, monitor=False), str(tmp_path / "own"), info_keywords=("rms_position_error",))
    learn(venv, 64)
    venv.close()
    text = (tmp_path / "own.monitor.csv").read_text()
    assert ENV in text
    assert "rms_position_error" in text


def test_pictures_of_all_are_tiled():
    venv = native(4, 5, seed=0, render_mode="rgb_array")
    venv.reset()
    images = venv.get_images()
    height, width, _ = images[0].shape
    assert len(images) == 4
    assert venv.render().shape == (2 * height, 2 * width, 3)
    assert same(venv.env_method("render", indices=[2])[0], images[2])
    with pytest.warns(UserWarning, match="rgb_array"):
        assert native().get_images() == [None] * 3


def test_videos_are_recorded(tmp_path, monkeypatch):
    clips = fake_moviepy(monkeypatch)
    venv = VecVideoRecorder(
        native(4, 5, seed=0, render_mode="rgb_array"), str(tmp_path), lambda step: step == 0, video_length=3
    )
    venv.reset()
    for _ in range(5):
        venv.step(np.zeros((4, 6)))
    venv.close()
    assert clips == [(4, (960, 1280, 3), 20.0)]
