"""Disturbances of episodes: named, seeded, scriptable, and the same however they are run."""

import json
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from helpers import assert_parity, run
from hypothesis import given, settings
from hypothesis import strategies as st

import uvms_gym
from uvms_gym.envs.station_keep import StationKeepEnv, StationKeepVectorEnv

ENV = "UVMS-StationKeep-v0"
ARM = "bluerov2-heavy-alpha5"
SMALL = "bluerov2-heavy"
LEVELS = list(uvms_gym.disturbance_levels())
FAULTS = {"dropout": {"probability": 0.3, "gap": 0.3}, "outliers": {"probability": 0.1}}
ALL = {"base": "storm-hard", **FAULTS, "script": {"current": np.full((30, 3), 0.1), "wrench": np.ones((25, 6))}}


def same(a, b):
    return np.asarray(a).tobytes() == np.asarray(b).tobytes()


def play(envs, steps=60, seed=3):
    """Observations, rewards and infos of seeded actions."""
    draw = np.random.default_rng(seed)
    seen = []
    for _ in range(steps):
        actions = draw.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        observations, rewards, *_, infos = envs.step(actions)
        seen.append(np.concatenate([np.ravel(observations), np.ravel(rewards), *map(np.ravel, infos.values())]))
    return np.array(seen)


@pytest.mark.parametrize("disturbance", [*LEVELS, ALL], ids=[*LEVELS, "all"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_instances_of_a_vector_are_single_environments(disturbance, dtype):
    given = {"scene": ARM, "disturbance": disturbance, "dtype": dtype}
    envs = StationKeepVectorEnv(19, max_episode_steps=80, **given)
    assert_parity(envs, lambda: gym.wrappers.TimeLimit(StationKeepEnv(**given), 80), 200)


@pytest.mark.parametrize("disturbance", ["storm", ALL], ids=["storm", "all"])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_episodes_go_on_where_they_were_saved(disturbance, dtype):
    make = {"scene": ARM, "disturbance": disturbance, "dtype": dtype}
    envs = StationKeepVectorEnv(3, **make)
    envs.reset(seed=1)
    play(envs, 70)
    states, copies = envs.get_state(), pickle.loads(pickle.dumps(envs))
    expected = play(envs, 100, seed=5)
    assert same(play(copies, 100, seed=5), expected)
    other = StationKeepVectorEnv(3, **make)
    other.reset(seed=8)
    other.set_state(states)
    assert same(play(other, 100, seed=5), expected)


def test_calm_is_no_disturbance():
    calm, none = (
        StationKeepVectorEnv(2, scene=ARM, **given) for given in ({"disturbance": "calm"}, {"max_current": 0.0})
    )
    assert same(calm.reset(seed=2)[0], none.reset(seed=2)[0])
    assert same(play(calm), play(none))
    steady = StationKeepVectorEnv(2, scene=ARM, disturbance={"current": {"speed": [0.0, 0.3], "elevation": 0.25}})
    default = StationKeepVectorEnv(2, scene=ARM)
    assert same(steady.reset(seed=2)[0], default.reset(seed=2)[0])
    assert same(play(steady), play(default))


def test_true_profile_is_in_the_info_and_not_in_the_observation():
    disturbance = {"gust": {"speed": 0.3, "pause": [0, 1]}, "thrusters": {"gain": 0.4, "time": 1.0}}
    disturbance |= {"impulse": {"force": 20.0, "duration": 1.0, "pause": [0.2, 0.5]}, "payload": {"mass": 1.0}}
    env = StationKeepEnv(scene=ARM, disturbance=disturbance)
    first, _ = env.reset(seed=4)
    assert first.shape == StationKeepEnv(scene=ARM).observation_space.shape
    profile = env.disturbance(0, 200)
    assert profile["current"].shape == (200, 3) and profile["gains"].shape == (200, 8)
    assert same(profile["time"], np.arange(200) * 0.05)
    for k in range(200):
        *_, info = env.step(np.zeros(6))
        assert same([info[f"current_{axis}"] for axis in "xyz"], profile["current"][k])
        assert info["payload"] == profile["payload"][k]
        assert info["thruster_gain"] == profile["gains"][k].min()
        assert info["disturbance_force"] == pytest.approx(np.linalg.norm(profile["wrench"][k, :3]))
    assert set(profile["payload"]) == {0.0, 1.0}
    assert profile["gains"].min() == 0.4
    # What is told of the rest of an episode is what was told at its start.
    env.reset(seed=4)
    play(env, 50)
    assert same(env.disturbance(0, 150)["current"], profile["current"][50:])


def test_seized_masses_slow_the_arm_and_dropped_ones_do_not():
    payload = {"mass": 2.0, "pick": 0.05, "hold": 0.05}
    env = StationKeepEnv(scene=ARM, disturbance={"payload": payload}, dt=0.001, substeps=1)
    env.reset(seed=1, options={"twist": [0.3, 0, 0, 0, 0, 0]})
    velocities = []
    for _ in range(130):
        env.step(np.zeros(6))
        velocities.append([*env.snapshot().twist[0], *env.snapshot().qd[0]])
    change = np.linalg.norm(np.diff(velocities, axis=0), axis=1)
    # The step after the 50th is the first with the payload: velocities jump.
    assert change[49] > 10 * max(*change[40:49], *change[51:60])
    assert change[99] < 3 * max(*change[90:99], *change[100:110])
    assert env.snapshot().parameters["payload"][0] == 0.0
    with_it = StationKeepEnv(scene=ARM, disturbance={"payload": {**payload, "hold": 100}})
    with_it.reset(seed=1)
    play(with_it, 30)
    assert with_it.snapshot().parameters["payload"][0] == 2.0
    with_it.reset(seed=1)
    assert with_it.snapshot().parameters["payload"][0] == 0.0


def test_delay_shifts_what_is_measured_and_nothing_else():
    delayed, plain = (StationKeepEnv(scene=ARM, disturbance=d) for d in ({"delay": {"periods": 3}}, "calm"))
    late = [delayed.reset(seed=1)[0]]
    now = [plain.reset(seed=1)[0]]
    draw = np.random.default_rng(1)
    for _ in range(30):
        action = draw.uniform(-1, 1, 6)
        late.append(delayed.step(action)[0])
        now.append(plain.step(action)[0])
    offsets = {block.name: block.slice for block in plain.layout}
    for name, where in offsets.items():
        for k in range(31):
            if name in ("joint_reference", "joint_reference_rate", "previous_action"):
                assert same(late[k][where], now[k][where])
            elif name != "error_integral":
                assert same(late[k][where], now[max(0, k - 3)][where]), (name, k)


@pytest.mark.parametrize("delay", [0.0, 0.1, [0.0, 0.2]], ids=["now", "late", "drawn"])
def test_the_last_measurement_is_held_in_a_gap_and_its_age_is_known(delay):
    n, period = 64, 0.05
    held, plain = (
        StationKeepVectorEnv(n, scene=ARM, disturbance=d)
        for d in ({"dropout": {"probability": 0.4, "gap": 0.15}, "delay": delay}, "calm")
    )
    seen, truth, ages = [held.reset(seed=1)[0]], [plain.reset(seed=1)[0]], []
    draw = np.random.default_rng(1)
    names = ("position_error", "linear_velocity", "joint_rate")
    entries = np.concatenate([np.arange(42)[block.slice] for block in plain.layout if block.name in names])
    for k in range(1, 80):
        actions = draw.uniform(-1, 1, (n, 6))
        observations, *_, infos = held.step(actions)
        seen.append(observations)
        truth.append(plain.step(actions)[0])
        ages.append(np.round(infos["measurement_age"] / period).astype(int))
        for i in np.flatnonzero(ages[-1] <= k):
            assert same(seen[k][i, entries], truth[k - ages[-1][i]][i, entries]), (k, i)
    # A measurement never grows younger than the delay, and ages by a period in a gap.
    steps = np.diff(ages, axis=0)
    assert (steps <= 1).all() and (steps == 1).any() and (steps < 0).any()
    assert np.min(ages[20:]) == np.round(np.min(delay) / period)


def test_faults_without_probability_change_no_bit():
    none = {"dropout": {"probability": 0}, "outliers": {"probability": 0}}
    envs = [StationKeepVectorEnv(5, scene=ARM, disturbance=d) for d in ("storm", {"base": "storm", **none})]
    plain, with_none = ([env.reset(seed=4)[0], play(env)] for env in envs)
    assert all(map(same, plain, with_none))


def test_the_info_says_when_a_thruster_dies():
    losses = ({"gain": 0.0, "time": [0.5, 2.0]}, None)
    envs, storm = (
        StationKeepVectorEnv(8, scene=ARM, disturbance={"base": "storm", "thrusters": loss}) for loss in losses
    )
    assert same(envs.reset(seed=2)[0], storm.reset(seed=2)[0])
    gains = np.array([envs.disturbance(i, 60)["gains"] for i in range(8)])
    for k in range(60):
        actions = np.full((8, 6), 0.1)
        (observations, *_, infos), (others, *_) = envs.step(actions), storm.step(actions)
        dead = infos["thruster_gain"] == 0.0
        assert (dead == (gains[:, k].min(axis=1) == 0.0)).all()
        # All else is the same until then.
        assert same(observations[~dead], others[~dead])
    assert (gains[:, -1] == 0.0).sum(axis=1).tolist() == [1] * 8


def test_a_drawn_delay_is_one_age_per_episode():
    """Ages of 0 to 3 periods, each as often: 0.5 of a period at either end rounds to the ends."""
    n, period = 600, 0.05
    late, plain = (StationKeepVectorEnv(n, scene=SMALL, disturbance=d) for d in ({"delay": [0, 3 * period]}, "calm"))
    seen, truth = [late.reset(seed=3)[0]], [plain.reset(seed=3)[0]]
    draw = np.random.default_rng(1)
    for _ in range(8):
        actions = draw.uniform(-1, 1, (n, 6))
        seen.append(late.step(actions)[0])
        truth.append(plain.step(actions)[0])
    where = next(block.slice for block in plain.layout if block.name == "position_error")
    ages = np.full(n, -1)
    for age in range(4):
        fits = [(seen[k][:, where] == truth[k - age][:, where]).all(axis=1) for k in range(3, 9)]
        ages[np.all(fits, axis=0)] = age
    assert np.bincount(ages, minlength=4) / n == pytest.approx([1 / 6, 1 / 3, 1 / 3, 1 / 6], abs=0.06)
    with pytest.raises(ValueError, match="delay: 1 control periods, but the environment was made with 0 to 3"):
        late.reset(options={"disturbance": {"delay": period}})


def test_noise_is_in_observations_alone():
    noisy, plain = (StationKeepEnv(scene=ARM, disturbance=d) for d in ({"noise": {"position": 0.01}}, "calm"))
    noisy.reset(seed=1)
    plain.reset(seed=1)
    errors = []
    for _ in range(400):
        seen, reward, *_, info = noisy.step(np.zeros(6))
        true, expected, *_, truth = plain.step(np.zeros(6))
        assert reward == expected and info == truth
        errors.append((seen - true)[:3] * 0.1)
    assert np.std(errors) == pytest.approx(0.01, rel=0.1)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.003


def test_gains_weaken_thrusters():
    env = StationKeepEnv(scene=SMALL, disturbance={"thrusters": {"gains": [0.5] * 8, "time": 0}})
    weak = StationKeepEnv(scene=SMALL, disturbance="calm", randomize={"thrust": [0.5, 0.5]})
    env.reset(seed=1)
    weak.reset(seed=1)
    a, b = play(env, 40), play(weak, 40)
    # The column before the last is the gain.
    np.testing.assert_allclose(*(np.delete(x, -2, axis=1) for x in (a, b)), rtol=1e-5, atol=1e-6)


def test_parameters_are_drawn_per_episode():
    envs = StationKeepVectorEnv(64, scene=ARM, disturbance="calm", randomize=True, autoreset_mode="Disabled")
    envs.reset(seed=0)
    first = envs.snapshot().parameters
    for name in ("mass", "added_mass", "linear_damping", "quadratic_damping", "thrust"):
        assert 0.7 <= first[name].min() < 0.75 and 1.25 < first[name].max() <= 1.3
    assert same(first["volume"], first["mass"])
    envs.reset()
    assert not same(envs.snapshot().parameters["mass"], first["mass"])
    envs.reset(seed=0)
    assert same(envs.snapshot().parameters["mass"], first["mass"])
    off = StationKeepEnv(scene=ARM, disturbance="storm", randomize=False)
    off.reset(seed=0)
    assert off.snapshot().parameters["mass"][0] == 1.0


def test_a_reset_may_bring_its_own():
    envs = StationKeepVectorEnv(2, scene=SMALL, disturbance="gusts", max_episode_steps=20)
    quiet = {"current": {"speed": 0.0}}
    steady = {"current": {"speed": 0.2, "elevation": 0.0}}
    _, infos = envs.reset(seed=0, options={"disturbance": [quiet, steady]})
    speed = np.hypot(infos["current_x"], infos["current_y"])
    np.testing.assert_allclose(speed, [0.0, 0.2], atol=1e-12)
    envs.reset(seed=0, options={"disturbance": {**quiet, "gust": {"speed": 0.3, "pause": 0.0, "rise": 0.1}}})
    for _ in range(5):
        *_, infos = envs.step(np.zeros((2, 6)))
    assert np.abs(infos["current_x"]).max() > 0.0
    before = envs.get_state()
    for wrong, message in (
        ("waves", "waves"),
        ({"wind": {}}, "wind"),
        ([quiet], "1 entries"),
        (3, "3"),
    ):
        with pytest.raises((ValueError, TypeError), match=message):
            envs.reset(options={"disturbance": wrong})
    assert all(same(before[key], value) for key, value in envs.get_state().items())


def test_scripts_are_played():
    current = np.zeros((40, 3))
    current[10:20, 0] = 0.4
    wrench = np.zeros((40, 6))
    wrench[30, 2] = 25.0
    for repeat in (False, True):
        script = {"current": current, "wrench": wrench, "repeat": repeat}
        env = gym.make(ENV, scene=SMALL, disturbance={"script": script})
        env.reset(seed=0)
        seen = [env.step(np.zeros(6))[4] for _ in range(80)]
        assert [info["current_x"] for info in seen] == [*current[:, 0], *(repeat * current[:, 0])]
        assert [info["disturbance_force"] for info in seen] == [*wrench[:, 2], *(repeat * wrench[:, 2])]


def test_specs_carry_disturbances():
    disturbance = {"base": "storm", "waves": None, "gust": {"speed": [0.1, 0.2]}}
    env = gym.make(ENV, scene=SMALL, disturbance=disturbance, randomize={"mass": 0.1})
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert same(env.reset(seed=1)[0], again.reset(seed=1)[0])
    level = uvms_gym.disturbance_levels()["storm"]
    assert json.loads(json.dumps(level.components)) == level.components
    named, spelt = (StationKeepEnv(scene=SMALL, disturbance=d) for d in ("storm", level.components))
    assert same(named.reset(seed=1)[0], spelt.reset(seed=1)[0])
    assert same(play(named, 20), play(spelt, 20))


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"disturbance": "hurricane"}, "hurricane.*storm"),
        ({"disturbance": {"wind": {}}}, "wind.*gust"),
        ({"disturbance": {"base": "hurricane"}}, "hurricane.*storm-hard"),
        ({"disturbance": {"wind": None}}, "wind.*gust"),
        ({"disturbance": {"gust": {"sped": 1}}}, "gust.*sped.*speed"),
        ({"disturbance": {"gust": {"speed": "fast"}}}, "gust.speed.*number"),
        ({"disturbance": {"gust": {"speed": [1, 2, 3]}}}, "gust.speed.*two"),
        ({"disturbance": {"gust": {"speed": [0.3, 0.1]}}}, "gust.speed.*0.3"),
        ({"disturbance": {"gust": {"speed": 50}}}, "gust.speed.*5"),
        ({"disturbance": {"waves": {"trains": 4}}}, "waves.trains.*3"),
        ({"disturbance": {"waves": {"height": 5, "period": 2}}}, "waves.height.*0.88"),
        ({"disturbance": {"delay": 1000}}, "delay.*100"),
        ({"disturbance": {"delay": [0.2, 0.1]}}, r"delay.time: \[0.2, 0.1\] is no range"),
        ({"disturbance": {"parameters": {"mass": [0, 1]}}}, "parameters.mass.*0.1"),
        ({"disturbance": {"parameters": "much"}}, "parameters.*ranges"),
        ({"disturbance": {"gust": {"speed": float("nan")}}}, "disturbance"),
        ({"disturbance": {"base": 3}}, "base"),
        ({"disturbance": 3}, "3"),
        ({"disturbance": {"gust": object()}}, "object"),
        ({"randomize": {"mas": 0.1}}, "mas.*added_mass"),
        ({"randomize": "much"}, "randomize"),
        ({"randomize": {"mass": [0.0, 1.0]}}, "parameters.mass"),
    ],
)
def test_what_is_not_known_is_refused_by_name(arguments, named):
    with pytest.raises((ValueError, TypeError), match=named):
        StationKeepEnv(scene=SMALL, **arguments)


words = st.sampled_from(
    [
        *uvms_gym.disturbance_levels()["storm"].components,
        *"base speed share height period gain gains time mass current parameters storm x".split(),
    ]
)
values = st.recursive(
    st.none() | st.booleans() | st.floats(-2, 2) | st.floats() | st.integers() | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=100, deadline=None)
@given(values, values)
def test_any_argument_makes_an_environment_or_a_clear_error(disturbance, randomize):
    try:
        env = StationKeepEnv(scene=SMALL, disturbance=disturbance, randomize=randomize)
    except (ValueError, TypeError) as error:
        assert str(error)
        return
    env.reset(seed=0)
    observation, reward, *_ = env.step(np.zeros(6))
    assert np.isfinite(reward) and observation in env.observation_space


@pytest.mark.parametrize("scene", ["petasus-pum", ARM, SMALL, "rexrov"])
def test_pd_holds_station_in_calm_water_and_visibly_less_in_a_storm(scene):
    errors = {}
    for level in ("calm", "storm"):
        envs = StationKeepVectorEnv(8, scene=scene, disturbance=level, autoreset_mode="Disabled")
        stats = run(envs, uvms_gym.PD(scene=scene), 400)
        assert not stats.terminated.any(), level
        errors[level] = float(np.median(stats.rms("position_error")))
    assert errors["storm"] > 1.5 * errors["calm"]


def test_command_draws_what_it_lists(tmp_path, capsys):
    from uvms_gym.cli.app import run

    assert run(["disturbances", "storm", "--out", str(tmp_path), "--seconds", "5", "--scene", SMALL]) == 0
    assert (tmp_path / "storm.png").stat().st_size > 10_000
    assert "payload" in capsys.readouterr().out


@pytest.mark.parametrize("dynamics", [{"map": "t200"}, {"dead_band": 4.0}, {"lag": 0.01}, {"ambient_flow": 0.1}])
def test_what_is_lost_is_thrust_not_command(dynamics: dict[str, Any]) -> None:
    """Whatever a thruster makes of a command, gains weaken what comes out of it."""
    scene = uvms_gym.load_scene("bluerov2-heavy")
    for thruster in scene["vehicle"]["thrusters"]:
        thruster.update(dynamics)

    def thrust(gain: float) -> Any:
        loss = {"gains": [gain] * 8, "time": 0.0}
        env = gym.make("UVMS-StationKeep-v0", scene=scene, action="thrusters", disturbance={"thrusters": loss})
        env.reset(seed=0)
        for _ in range(3):
            env.step(np.full(8, 0.4, dtype=np.float32))
        return env.unwrapped.snapshot().thrust  # type: ignore[attr-defined]

    whole = thrust(1.0)
    assert np.abs(whole).min() > 1.0
    for gain in (0.1, 0.5):
        np.testing.assert_allclose(thrust(gain), gain * whole, rtol=1e-9)


def test_parameters_asked_for_apart_stay_at_reset() -> None:
    def factors(randomize: Any, **options: Any) -> Any:
        env = gym.make("UVMS-StationKeep-v0", scene=SMALL, disturbance="storm", randomize=randomize)
        env.reset(seed=3, options=options)
        return {name: row.tolist() for name, row in env.unwrapped.snapshot().parameters.items()}  # type: ignore[attr-defined]

    for randomize in (False, 0.3):
        assert factors(randomize) == factors(randomize, disturbance="storm")
    assert factors(False)["mass"] == [1.0]
    assert factors(0.3)["mass"] != [1.0]
