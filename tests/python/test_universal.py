"""The policy for any vehicle: its physics, its network for one vehicle, errors and warnings where it does not fit."""

import copy
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import scenes_with_thrusters

import uvms_gym
from uvms_gym import MPC, PD, PID, ControllerWarning, Rollout, load_scene, make_controller
from uvms_gym._task.options import native
from uvms_gym.controllers.plant import FEATURES, NOISE, SEEN, Plant, plant
from uvms_gym.controllers.registry import PRETRAINED, Unavailable, policies
from uvms_gym.controllers.universal import UniversalPolicy, fold, weights
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import interquartile_mean
from uvms_gym.training.evaluation import run_episodes

STORM = "UVMS-StationKeep-Storm-v0"
FILE = PRETRAINED / "UVMS-StationKeep" / "universal-0.safetensors"
ROBOTS = Path(__file__).parents[1] / "data" / "robots"


def plant_of(scene: str | dict[str, Any], lag: float | None = 0.1) -> Plant:
    made = native({"task": "station-keep", "scene": scene, "substeps": 10, "disturbance": "storm"})
    return plant(made, lag, NOISE)


@pytest.fixture(scope="module")
def policy() -> UniversalPolicy:
    return UniversalPolicy.load(FILE)


@pytest.mark.parametrize("scene", ["bluerov2-heavy", "petasus-pum"])
def test_the_network_of_a_vehicle_is_the_policy_on_seen_quantities(policy: UniversalPolicy, scene: str) -> None:
    env = gymnasium.make(STORM, scene=scene)
    at, spans = plant_of(scene), policy.spans
    size = env.observation_space.shape[0]  # type: ignore[index]
    rows = np.random.default_rng(0).normal(size=(50, sum(spans), size), scale=0.3).astype(np.float32)
    network = policy.network(env)
    own = weights(np, policy.parameters, at.features.clip(*policy.limits))
    ends = np.cumsum(spans)
    for row in rows:
        averages = [row[end - span : end].mean(axis=0) for span, end in zip(spans, ends, strict=True)]
        seen = np.array([[[at.seen[f, i] @ x for i in range(6)] for f in range(len(SEEN))] for x in averages])
        shared = np.tanh(np.tensordot(own.shared_in, seen, 3) + own.shared_bias)
        wanted = np.empty(6)
        for i in range(6):
            units = np.tanh(np.tensordot(own.axis_in[i], seen[:, :, i], 2))
            wanted[i] = own.out[i] @ np.tanh(own.axis_hidden[i] @ units + own.shared_hidden[i] @ shared)
        expected = np.clip(at.acted @ wanted, -1.0, 1.0)
        action, _ = network.predict(row[-1], row[:-1].reshape(-1))
        np.testing.assert_allclose(action, expected, atol=2e-5)


def test_val_accelerations_are_those_of_the_simulator() -> None:
    scene = load_scene("rexrov")
    at = plant_of("rexrov")
    wanted = np.array([0.3, -0.2, 0.1, 0.2, -0.1, 0.3])
    made = native({"task": "station-keep", "scene": "rexrov", "substeps": 10})
    limits = np.array([entry["scale"][0] for entry in made.action_layout])
    simulator = uvms_gym.Simulator(scene, 1)
    rest = simulator.forward_dynamics()[0]
    moved = simulator.forward_dynamics(wrench=[(at.acted @ wanted) * limits])[0] - rest
    inertia = simulator.mass_matrix()[0].diagonal()
    np.testing.assert_allclose(moved, wanted * limits / inertia, rtol=1e-9)


def scaled(scene: dict[str, Any], by: float) -> dict[str, Any]:
    """A vehicle with all masses, forces and moments multiplied."""
    scene = copy.deepcopy(scene)
    body = scene["vehicle"]["body"]
    for key in ("mass", "volume", "inertia", "added_mass"):
        body[key] = (by * np.array(body[key])).tolist()
    body["damping"] = {key: (by * np.array(value)).tolist() for key, value in body["damping"].items()}
    for thruster in scene["vehicle"]["thrusters"]:
        thruster["limits"] = [by * limit for limit in thruster["limits"]]
    return scene


def test_vehicles_that_move_alike_have_the_same_network(policy: UniversalPolicy) -> None:
    scene = load_scene("bluerov2-heavy")
    networks = [fold(policy.parameters, policy.spans, plant_of(one))[0] for one in (scene, scaled(scene, 3.7))]
    for one, other in zip(*networks, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    weaker = copy.deepcopy(scene)
    for thruster in weaker["vehicle"]["thrusters"]:
        thruster["limits"] = [0.5 * limit for limit in thruster["limits"]]
    other = fold(policy.parameters, policy.spans, plant_of(weaker))[0]
    assert np.abs(other[-1] - networks[0][-1]).max() > 0.05 * np.abs(other[-1]).max()


def test_features_say_delay_lag_noise_and_load() -> None:
    scene = load_scene("bluerov2-heavy")
    made = native({"scene": scene, "substeps": 10, "disturbance": {"base": "storm", "delay": {"periods": 2}}})
    at = plant(made, 0.2, {**NOISE, "attitude": 0.01})
    found = dict(zip(FEATURES, at.features.T, strict=True))
    assert set(found["delay"]) == {1.0}
    np.testing.assert_allclose(found["lag"], np.log(2.0))
    np.testing.assert_allclose(found["pose_noise"], np.repeat([0.0, np.log(2.0)], 3), atol=1e-12)
    # It floats with 2 N.
    body, limit = scene["vehicle"]["body"], made.action_layout[2]["scale"][0]
    lift = 9.81 * (1000.0 * body["volume"] - body["mass"])
    np.testing.assert_allclose(found["load"][2], 5.0 * lift / limit, rtol=1e-6)
    # m g (z_b - z_g) over the moment of inertia about the origin.
    inertia = uvms_gym.Simulator(scene, 1).mass_matrix()[0, 3, 3]
    np.testing.assert_allclose(found["righting"][3], np.log1p(13.5 * 9.81 * 0.02 / inertia), rtol=5e-3)
    lags = copy.deepcopy(scene)
    for k, thruster in enumerate(lags["vehicle"]["thrusters"]):
        thruster["lag"] = 0.1 if k % 2 else 0.3
    np.testing.assert_allclose(plant_of(lags, None).features[:, FEATURES.index("lag")], np.log(2.0))


def test_a_closed_loop_has_the_bits_of_python() -> None:
    envs = gymnasium.make_vec(STORM, num_envs=3, scene="bluerov2-heavy-alpha5")
    controller = make_controller("universal", envs)
    given, _ = envs.reset(seed=5)
    returns, state = np.zeros(3), None
    for k in range(30):
        actions, state = controller.predict(given, state, np.full(3, k == 0))
        given, rewards, *_ = envs.step(actions)
        returns += rewards
    envs.reset(seed=5)
    rollout = Rollout(envs, controller)
    rollout.run(30)
    np.testing.assert_array_equal(rollout.pop_stats().returns, returns)


@pytest.mark.parametrize("scene", scenes_with_thrusters())
def test_any_vehicle_with_six_axes_keeps_station(scene: str) -> None:
    envs = gymnasium.make_vec(STORM, num_envs=16, scene=scene)
    stats = run_episodes(envs, make_controller("universal", envs), 0, 200)
    rest = run_episodes(envs, make_controller("none", envs), 0, 200)
    assert not stats.terminated.any()
    assert np.median(pose_rms(stats, "station-keep")) < 0.3 * np.median(pose_rms(rest, "station-keep"))


@pytest.mark.parametrize("scene", ["bluerov2-heavy", "petasus-pum", "rexrov"])
def test_untuned_controllers_err_more(scene: str) -> None:
    envs = gymnasium.make_vec(STORM, num_envs=48, scene=scene)

    def error(controller: Any) -> float:
        return interquartile_mean(pose_rms(run_episodes(envs, controller, 0, 200), "station-keep"))

    assert error(make_controller("universal", envs)) < min(error(kind(envs)) for kind in (PD, PID, MPC))


def refused(**changes: Any) -> str:
    env = gymnasium.make(STORM, **{"scene": "bluerov2-heavy", **changes})
    with pytest.raises(Unavailable) as caught:
        make_controller("universal", env)
    (line,) = str(caught.value).splitlines()
    return line


def test_a_vehicle_without_six_axes_is_one_error() -> None:
    scene = load_scene("bluerov2-heavy")
    scene["vehicle"]["thrusters"] = [one for one in scene["vehicle"]["thrusters"] if "vertical" not in one["name"]]
    scene["name"] = "flat"
    line = refused(scene=scene)
    assert line.endswith("but the thrusters of scene flat do not push along heave, roll, pitch alone")
    assert "universal" not in policies(scene=scene, substeps=10)
    assert list(policies(scene="bluerov2-heavy", substeps=10)["universal"]) == [0]


def test_other_periods_actions_and_seeds_are_one_error() -> None:
    for_it = "universal is for UVMS-StationKeep, actions wrench, control period 0.1 s, not for UVMS-StationKeep"
    assert refused(substeps=5) == f"{for_it}, actions wrench, control period 0.05 s"
    assert refused(action="thrusters") == f"{for_it}, actions thrusters, control period 0.1 s"
    env = gymnasium.make(STORM)
    with pytest.raises(Unavailable, match=r"no policy universal of training seed 7 .* its seeds: 0"):
        make_controller("universal", env, seed=7)
    with pytest.raises(ValueError, match="controller 'universal' is not for UVMS-EETrack"):
        make_controller("universal", task="ee-track")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, None),
        ({"thruster_lag": 0.2}, None),
        ({"disturbance": {"base": "storm", "delay": {"periods": 2}}}, None),
        ({"disturbance": {"base": "storm", "noise": None, "waves": None}}, None),
        ({"thruster_lag": 0.5}, "thruster_lag is 0.5 s instead of 0.1 s"),
        ({"thruster_lag": None}, "thruster_lag is as in the scene instead of 0.1 s"),
        ({"disturbance": {"base": "storm", "delay": {"periods": 3}}}, "delay is 3 instead of 0 to 2 control periods"),
        ({"disturbance": {"base": "storm", "noise": {"position": 0.05}}}, "noise.position is 0.05 instead of"),
        ({"disturbance": "storm-hard"}, "disturbance (storm-hard instead of storm) "),
    ],
)
def test_warnings_name_what_is_beyond_the_training(changes: dict[str, Any], words: str | None) -> None:
    env = gymnasium.make(STORM, scene="bluerov2-heavy", **changes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make_controller("universal", env)
    texts = [str(one.message) for one in caught if one.category is ControllerWarning]
    assert texts == [] if words is None else len(texts) == 1 and words in texts[0]


@pytest.mark.filterwarnings("ignore::uvms_gym.ControllerWarning")
def test_features_beyond_the_training_count_as_its_limits() -> None:
    def actions(periods: int) -> Any:
        env = gymnasium.make(STORM, scene="rexrov", disturbance={"base": "storm", "delay": {"periods": periods}})
        rows = np.random.default_rng(0).normal(size=(20, 24), scale=0.3).astype(np.float32)
        return make_controller("universal", env).predict(rows, episode_start=np.ones(20, dtype=bool))[0]

    np.testing.assert_array_equal(actions(3), actions(2))
    assert np.abs(actions(2) - actions(1)).max() > 0.01


def test_files_read_back_alike_and_others_are_refused(policy: UniversalPolicy, tmp_path: Path) -> None:
    assert FILE.stat().st_size < 400_000
    policy.save(tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == FILE.read_bytes()
    other = next(PRETRAINED.glob("*/*/*/*.safetensors"))
    with pytest.raises(ValueError, match=f"{other.name}: no policy for any vehicle of this version"):
        UniversalPolicy.load(other)
    data = FILE.read_bytes()
    for part in (data[:100], data[:-1000], b"", b"x" * 100):
        (tmp_path / "broken.safetensors").write_bytes(part)
        with pytest.raises(ValueError, match=r"broken\.safetensors: no policy for any vehicle"):
            UniversalPolicy.load(tmp_path / "broken.safetensors")


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_imported_robot_is_a_vehicle_like_any_other() -> None:
    scene = uvms_gym.import_robot(ROBOTS / "trait-uuv-simulator.urdf")
    envs = gymnasium.make_vec(STORM, num_envs=32, scene=scene)
    errors = [
        np.median(pose_rms(run_episodes(envs, controller, 0, 200), "station-keep"))
        for controller in (make_controller("universal", envs), PD(envs), MPC(envs))
    ]
    assert errors[0] < min(errors[1:])
