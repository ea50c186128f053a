"""PID and neural policies as Python has them. (PD: test_station_keep.py.)"""

import pickle
import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from helpers import SIZES, SMALL, layers, observations, policies, policy

import uvms_gym
from uvms_gym import make_controller
from uvms_gym.controllers import MLP, PD, PID
from uvms_gym.controllers.families import FAMILIES, TASKS
from uvms_gym.envs.station_keep import StationKeepEnv, StationKeepVectorEnv

ACTIVATIONS = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0.0),
    "elu": lambda x: np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0))),
}


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_val_a_network_is_what_numpy_makes_of_its_arrays(activation: Any, output: Any) -> None:
    given, rows = layers(), observations(100)
    mean, variance = 0.2 * observations(1)[0], np.abs(observations(1, seed=2)[0]) + 0.1
    x = np.clip((rows.astype(np.float64) - mean) / np.sqrt(variance + 1e-8), -2.0, 2.0)
    for k, (weights, biases) in enumerate(zip(given["weights"], given["biases"], strict=True)):
        x = x @ weights.T + biases
        if k < 2:
            x = ACTIVATIONS[activation](x)
    expected = np.clip(x, -1.0, 1.0) if output == "clip" else np.tanh(x)
    made = policy(activation=activation, output=output, mean=mean, variance=variance, clip=2.0)
    np.testing.assert_allclose(made.predict(rows)[0], expected, atol=1e-6)
    assert 0.05 < (np.abs(x) > 1.0).mean() < 0.9


@pytest.mark.learning
@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_val_a_policy_of_stable_baselines3_is_the_same_without_torch(algorithm: str) -> None:
    sb3 = pytest.importorskip("stable_baselines3")
    env = gym.make("UVMS-StationKeep-v0", scene=SMALL)
    model = getattr(sb3, algorithm)("MlpPolicy", env, seed=3, device="cpu")
    arrays = {name: tensor.numpy().copy() for name, tensor in model.policy.state_dict().items()}
    if algorithm == "PPO":
        # An untrained policy hardly acts.
        model.policy.action_net.weight.data *= 100.0
        arrays = model.policy.state_dict()
    kind = {"PPO": {"activation": "tanh"}, "SAC": {"activation": "relu", "output": "tanh"}}[algorithm]
    made = MLP.from_state_dict(arrays, env, **kind)
    rows = 3.0 * observations(200)
    expected, _ = model.predict(rows, deterministic=True)
    np.testing.assert_allclose(made.predict(rows)[0], expected, atol=1e-6)
    assert np.abs(expected).max() > 0.1


@pytest.mark.learning
def test_val_history_is_what_stable_baselines3_stacks() -> None:
    stacking = pytest.importorskip("stable_baselines3.common.vec_env")
    from uvms_gym.sb3 import make_vec_env

    venv = stacking.VecFrameStack(make_vec_env("UVMS-StationKeep-v0", 3, seed=0, scene=SMALL, max_episode_steps=4), 3)
    made = MLP(StationKeepEnv(scene=SMALL), **layers((72, 5, 6)), history=3)
    at_once, state, starts = MLP(**layers((72, 5, 6))), None, np.zeros(3, dtype=np.bool_)
    stacked = venv.reset()
    for _ in range(10):
        actions, state = made.predict(stacked[:, -24:], state, starts)
        np.testing.assert_array_equal(actions, at_once.predict(stacked)[0])
        stacked, _, starts, _ = venv.step(actions)


def test_a_sequential_of_torch_is_taken_in_the_order_of_its_numbers() -> None:
    given = layers((24, *[7] * 10, 6))
    named = {}
    for k in reversed(range(11)):
        named |= {f"{2 * k}.weight": given["weights"][k], f"{2 * k}.bias": given["biases"][k]}
    rows = observations(5)
    expected = MLP(**given).predict(rows)[0]
    np.testing.assert_array_equal(MLP.from_state_dict(named).predict(rows)[0], expected)
    with pytest.raises(ValueError, match="no layers found among the names critic"):
        MLP.from_state_dict({"critic.weight": np.ones((1, 1))})


def test_files_give_the_same_policy_and_say_what_it_is_for(tmp_path: Path) -> None:
    made = policy(mean=np.zeros(24), variance=np.ones(24), notes={"seed": "5"})
    made.save(tmp_path / "a.safetensors")
    again = MLP.load(tmp_path / "a.safetensors", StationKeepEnv(scene=SMALL))
    rows = observations(40)
    np.testing.assert_array_equal(again.predict(rows)[0], made.predict(rows)[0])
    assert (again.notes, again.sizes) == ({"seed": "5"}, list(SIZES))
    spec = again.spec
    assert spec is not None
    assert [spec[key] for key in ("task", "scene", "action", "actions", "control_period")] == [
        "UVMS-StationKeep",
        SMALL,
        "wrench",
        6,
        0.05,
    ]
    assert spec["observation"] == [(b.name, b.length) for b in StationKeepEnv(scene=SMALL).layout]
    again.save(tmp_path / "b.safetensors")
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()


def test_files_are_those_of_the_safetensors_format(tmp_path: Path) -> None:
    policy().save(tmp_path / "a.safetensors")
    data = (tmp_path / "a.safetensors").read_bytes()
    import json

    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    described = header["layers.1.weight"]
    assert (described["dtype"], described["shape"]) == ("F32", [8, 16])
    begin, end = described["data_offsets"]
    array = np.frombuffer(data[8 + length :][begin:end], dtype="<f4").reshape(8, 16)
    np.testing.assert_array_equal(array, layers()["weights"][1].astype(np.float32))
    assert json.loads(header["__metadata__"]["uvms_gym"])["sizes"] == list(SIZES)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scene": "rexrov"}, "its scene is bluerov2-heavy, the environment's rexrov"),
        ({"scene": SMALL, "action": "thrusters"}, "its action is wrench, the environment's thrusters"),
        ({"scene": SMALL, "substeps": 10}, "its control period is 0.050000000 s, the environment's 0.100000000 s"),
    ],
)
def test_a_policy_for_something_else_is_refused_by_the_difference(options: Any, words: str, tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    policy().save(file)
    with pytest.raises(ValueError, match=re.escape(words)) as refused:
        MLP.load(file, **options)
    assert str(file) in str(refused.value)
    # Whoever does not say where it is to be used gets it.
    assert MLP.load(file).sizes == list(SIZES)


def test_what_is_no_policy_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    with pytest.raises(FileNotFoundError):
        MLP.load(file)
    policy().save(file)
    data = file.read_bytes()
    for content in (b"", b"PK\x03\x04 a zip file", data[:100], data[:-1], data + b"\0"):
        file.write_bytes(content)
        with pytest.raises(ValueError, match=r"policy\.safetensors: not a policy of uvms_gym: "):
            MLP.load(file)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"biases": layers()["biases"][:2]}, "weights of 3 layers, but biases of 2"),
        ({"weights": [], "biases": []}, "at least one layer"),
        ({"weights": [np.ones((4, 24))], "biases": [np.ones(3)]}, "layer 0 has weights [4, 24], but 3 biases"),
        ({"weights": [np.ones(24)], "biases": [np.ones(1)]}, "weights[0] has shape (24,)"),
        ({"biases": [np.ones(16), np.array([*[1.0] * 7, np.nan]), np.ones(6)]}, "layers.1.bias: number 7 is NaN"),
        *(({"history": history}, f"24 inputs, but must have a multiple of {history}") for history in (0, 5)),
        ({"weights": [np.full((6, 24), np.nan)], "biases": [np.ones(6)]}, "layers.0.weight: number 0 is NaN"),
        (layers((24, 8)), "number of actions is 8, the environment's 6"),
        (layers((23, 6)), "number of observation entries is 23, the environment's 24"),
        ({"activation": "gelu"}, "activation is 'gelu'"),
        ({"mean": np.zeros(24)}, "both mean and variance"),
        ({"mean": np.zeros(3), "variance": np.ones(3)}, "observation.mean has 3 numbers, but must have 24"),
        ({"mean": np.zeros(24), "variance": -np.ones(24)}, "variance + epsilon is -1"),
    ],
)
def test_a_network_that_is_none_is_refused(arguments: Any, words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        policy(**arguments)


CLASSICAL = [(name, task, {}) for name, family in FAMILIES.items() if family.kind for task in family.tasks]
WAVES = {"wave_acceleration": [0.3, 0.3], "acceleration_noise": [0.05, 0.3], "observer_bandwidth": [8.0, 8.0]}
OBSERVERS = ("dob", "dob-adaptive", "computed-torque", "mpc")


@pytest.mark.parametrize(
    ("name", "task", "gains"), [*CLASSICAL, *((name, "station-keep", {"delay": 1, **WAVES}) for name in OBSERVERS)]
)
def test_rows_do_not_depend_on_each_other_nor_on_their_number(name: str, task: str, gains: Any) -> None:
    env = gym.make_vec(f"{TASKS[task]}-v0", num_envs=9, disturbance="storm-wide")
    kind: Any = FAMILIES[name].kind
    controller = kind(env, **gains) if gains else make_controller(name, env)
    again = pickle.loads(pickle.dumps(controller))
    np.testing.assert_equal(again.gains, controller.gains)
    np.testing.assert_equal({gain: getattr(again, gain) for gain in again.gains}, controller.gains)
    (rows, _), state = env.reset(seed=1), None
    for step in range(12):
        actions, after = controller.predict(rows, state)
        assert (np.abs(actions) <= 1.0).all()
        for k in range(9):
            action, memory = again.predict(rows[k], None if state is None else state[k], step == 0)
            assert action.tobytes() == actions[k].tobytes()
            assert memory is after is None or memory.tobytes() == after[k].tobytes()
        assert state is None or not np.array_equal(state[0], after[0])
        rows, *_ = env.step(actions)
        state = after


def test_every_controller_survives_pickling_and_treats_rows_alike() -> None:
    rows = observations(37)
    for controller in policies():
        expected, state = controller.predict(rows)
        again, _ = pickle.loads(pickle.dumps(controller)).predict(rows)
        np.testing.assert_array_equal(again, expected)
        for i in (0, 5, 36):
            alone, memory = controller.predict(rows[i], None, True)
            np.testing.assert_array_equal(alone, expected[i])
            if state is not None:
                np.testing.assert_array_equal(memory, state[i])
        with pytest.raises(ValueError, match="must be finite"):
            controller.predict(np.full((2, 24), np.nan))
        with pytest.raises(ValueError, match="entries"):
            controller.predict(np.zeros((2, 23)), None, True)


def test_the_integral_is_the_state_and_episodes_begin_without() -> None:
    pid, rows = PID(scene=SMALL), 0.02 * observations(3)
    first, state = pid.predict(rows)
    np.testing.assert_array_equal(first, PD(scene=SMALL).predict(rows)[0])
    second, state = pid.predict(rows, state)
    assert (second != first).all()
    np.testing.assert_allclose(state, 2 * 0.05 * 0.1 * rows[:, :6], rtol=1e-6)
    # As SB3's evaluate_policy does: rows whose episode begins forget.
    third, forgotten = pid.predict(rows, state, episode_start=np.array([True, False, False]))
    np.testing.assert_array_equal(third[0], first[0])
    np.testing.assert_allclose(forgotten[:, 0], np.array([1, 3, 3]) * 0.05 * 0.1 * rows[:, 0], rtol=1e-6)
    for wrong in (np.zeros(6), np.zeros((3, 5)), np.full((3, 6), np.inf)):
        with pytest.raises(ValueError, match="state"):
            pid.predict(rows, wrong)


def test_pid_gains_are_given_or_follow_from_the_others() -> None:
    pid = PID(scene=SMALL)
    np.testing.assert_allclose(pid.ki, pid.kp**2 / (2.0 * pid.kd))
    np.testing.assert_array_equal(PID(scene=SMALL, ki=np.arange(6)).ki, np.arange(6))
    np.testing.assert_array_equal(PID(StationKeepEnv(scene=SMALL)).kp, PD(scene=SMALL).kp)
    with pytest.raises(ValueError, match=r"gain ki\[0\] = -1"):
        PID(scene=SMALL, ki=-np.ones(6))


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy-alpha5", "rexrov"])
def test_an_integral_takes_out_what_a_current_leaves(scene: str) -> None:
    def settled(controller: Any) -> np.ndarray:
        env = StationKeepVectorEnv(24, scene=scene)
        env.reset(seed=0)
        rollout = uvms_gym.Rollout(env, controller)
        rollout.run(60)
        rollout.pop_stats()
        rollout.run(340)
        stats = rollout.pop_stats()
        assert not stats.terminated.any()
        return stats.rms("position_error")

    assert np.median(settled(PID(scene=scene))) < 0.5 * np.median(settled(PD(scene=scene)))


@pytest.mark.parametrize("activation", ACTIVATIONS)
@pytest.mark.parametrize("output", ["clip", "tanh"])
def test_actions_stay_in_their_range_where_numbers_overflow(activation: Any, output: Any) -> None:
    large = [np.array([[3e38, -3e38, 1.0], [3e38, 3e38, -1.0]]), np.array([[1.0, -1.0]])]
    network = MLP(weights=large, biases=[np.zeros(2), np.zeros(1)], activation=activation, output=output)
    for row in ([3e38, 3e38, 0.0], [-3e38, 3e38, 3e38], [1.0, 1.0, 3e38]):
        assert abs(network.predict(np.float32(row))[0][0]) <= 1.0


@pytest.mark.parametrize("kind", [PD, PID])
def test_laws_that_overflow_ask_for_nothing(kind: Any) -> None:
    integral = {"ki": [1e300] * 6} if kind is PID else {}
    controller = kind(kp=[1e300] * 6, kd=[1e300] * 6, **integral)
    signs = np.random.default_rng(0).choice([1.0, -1.0], size=(50, controller.native.widths[0]))
    actions, _ = controller.predict(3e38 * signs)
    assert np.all(np.abs(actions) <= 1.0) and np.any(actions == 0.0) and np.any(np.abs(actions) == 1.0)
