"""Navigation filter: consistency, late fixes, outliers, failures, lever arms, invariance; observations of it."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from uvms_gym import NavigationFilter, Rollout, Sensors, Simulator, _rotations, make_controller
from uvms_gym.envs import DockVectorEnv, NavigationObservation, StationKeepVectorEnv
from uvms_gym.studies.navigation import IDEAL, Run, control, run

RUNS = 256


@pytest.fixture(scope="module")
def consistent() -> Run:
    return run(seed=0)


@pytest.mark.parametrize("name", ["dvl", "depth", "heading", "acoustic"])
def test_innovations_are_as_large_as_the_filter_says(consistent: Run, name: str) -> None:
    mean, band = consistent.mean_nis(name)
    assert abs(mean - 1.0) < band, (mean, band)


@pytest.mark.parametrize("width", [9, 12])
def test_errors_are_as_large_as_the_filter_says(consistent: Run, width: int) -> None:
    # At the start the angular velocity is the true one.
    nees = consistent.nees(width)[1:]
    band = 1.96 * math.sqrt(2.0 / (width * RUNS))
    assert np.mean(np.abs(nees - 1.0) < band) >= 0.9, nees
    assert abs(nees.mean() - 1.0) < band, nees


def test_covariances_are_symmetric_and_positive(consistent: Run) -> None:
    covariances = consistent.covariances
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 2, 3), rtol=0, atol=1e-15)
    assert np.linalg.eigvalsh(covariances).min() > 0.0


def test_consistency_does_not_depend_on_mounts_and_late_fixes() -> None:
    suite = {
        "imu": {"position": [0.1, -0.2, 0.05], "rpy": [0.3, -0.2, 2.0]},
        "dvl": {"position": [-0.2, 0.1, -0.15], "rpy": [0.1, 0.05, -0.8]},
        "depth": {"position": [0.2, 0.1, 0.1]},
        "heading": True,
        "acoustic": {"position": [-0.3, 0.0, 0.3], "outliers": 0.0, "rate": 2.0, "delay": 0.5, "noise": 0.1},
    }
    found = run(10.0, suite, seed=9000)
    for name in found.nis:
        mean, band = found.mean_nis(name)
        assert abs(mean - 1.0) < 1.3 * band, (name, mean, band)  # 99 %
    assert np.mean(np.abs(found.nees() - 1.0)) < 1.96 * math.sqrt(2.0 / (9 * RUNS))


def test_wrong_noise_is_seen() -> None:
    sim = Simulator("bluerov2-heavy", 64)
    sim.set_state(position=[0.0, 0.0, -5.0])
    sensors = Sensors(sim, {"imu": True, "depth": {"noise": 0.02, "offset": 0.0}}, seed=1)
    filter = NavigationFilter({"imu": True, "depth": {"noise": 0.01, "offset": 0.0}}, 64)
    filter.reset(sim, deviations=(0.0, 0.0, 0.0))
    found = []
    for k in range(101):
        sim.set_state(time=0.05 * k)
        filter.update(sensors.measure(sim))
        found.append(filter.innovations()["depth"]["nis"])
    assert 3.0 < np.nanmean(found) < 5.0


def test_outliers_are_refused() -> None:
    suite = {**IDEAL, "acoustic": {"outliers": 0.3, "outlier_noise": 20.0}}
    found = run(suite=suite, n=64)
    nis, _ = found.nis["acoustic"]
    assert 0.2 < (nis[np.isfinite(nis)] > 16.266).mean() < 0.35
    assert np.median(np.linalg.norm(found.errors[-1][:, :3], axis=1)) < 0.3


def test_failures_enlarge_the_covariance_until_they_end() -> None:
    suite = {name: value for name, value in IDEAL.items() if name != "acoustic"}
    found = run(15.0, suite, n=64, failures={"dvl": (5.0, 10.0)}, deviations=(0.01, 0.03, 0.05))
    velocity = np.trace(found.covariances[:, :, 6:9, 6:9], axis1=2, axis2=3).mean(axis=1)
    position = np.trace(found.covariances[:, :, :2, :2], axis1=2, axis2=3).mean(axis=1)
    assert velocity[10] > 1.5 * velocity[5]
    assert velocity[15] < 1.1 * velocity[5]
    assert position[10] > 1.2 * position[5]
    assert np.abs(found.nees() - 1.0).mean() < 1.96 * math.sqrt(2.0 / (9 * 64))


def test_a_gap_of_the_imu_is_bridged_with_less_certainty() -> None:
    found = run(6.0, failures={"imu": (1.94, 2.06)})
    velocity = np.median(np.trace(found.covariances[:, :, 6:9, 6:9], axis1=2, axis2=3), axis=1)
    assert velocity[2] > 1.5 * velocity[1]
    assert velocity[6] < velocity[1]
    sizes = np.linalg.norm(found.errors[:, :, 6:9], axis=2)
    assert np.median(sizes[6]) < 0.02
    assert sizes[6].max() < 0.1
    assert abs(found.nees()[6] - 1.0) < 1.96 * math.sqrt(2.0 / (9 * RUNS))


def test_a_start_that_is_worse_than_stated_is_recovered() -> None:
    found = run(10.0, n=64, deviations=(0.3, 0.1, 0.3), stated=(0.3, 0.01, 0.01))
    sizes = np.linalg.norm(found.errors[-1].reshape(64, 4, 3), axis=2)
    assert np.median(sizes[:, 2]) < 0.02
    assert sizes[:, 2].max() < 0.2


def test_heading_and_place_of_the_world_make_no_difference() -> None:
    # Without fixes, whose noise is drawn along the world's axes.
    suite = {"imu": True, "dvl": True, "heading": True}
    a, b = (
        run(4.0, suite, n=8, yaw=yaw, offset=offset) for yaw, offset in ((0.0, (0, 0, 0)), (1.0, (50.0, -20.0, 0.0)))
    )
    np.testing.assert_allclose(a.covariances, b.covariances, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(a.nis["dvl"][0], b.nis["dvl"][0], rtol=1e-3, atol=1e-5)


def test_bad_use_is_named() -> None:
    sim = Simulator("bluerov2-heavy")
    with pytest.raises(ValueError, match="imu: the navigation filter needs an IMU"):
        NavigationFilter(["depth"])
    with pytest.raises(ValueError, match=r"depth.delay: 0.1 s, but the navigation filter bridges at most 0 s"):
        NavigationFilter({"imu": True, "depth": {"delay": 0.1}})
    filter = NavigationFilter(["imu"])
    with pytest.raises(ValueError, match=r"instance 0 of the filter has no start"):
        filter.update({"time": [0.0]})
    with pytest.raises(ValueError, match=r"deviation of the attitude is -1, but must be within \[0, 1e6\]"):
        filter.reset(sim, deviations=(0.1, -1.0, 0.1))
    filter.reset(sim)
    with pytest.raises(ValueError, match="readings have no 'time'"):
        filter.update({})


#: The storm with neither noise nor delay of the measured pose.
STORM = {"base": "storm", "noise": None, "delay": None}


def station(n: int = 4, **options: Any) -> StationKeepVectorEnv:
    return StationKeepVectorEnv(n, scene="bluerov2-heavy", disturbance=STORM, **options)


def actions(env: Any, k: int) -> np.ndarray:
    return 0.3 * np.sin(np.arange(6 * env.num_envs) + 0.1 * k).reshape(env.num_envs, 6).astype(np.float32)


def test_observations_of_an_exact_filter_are_those_of_the_environment() -> None:
    quiet = {
        "imu": {
            f"{part}_{kind}": 0.0 for part in ("gyro", "accelerometer") for kind in ("noise", "bias", "walk")
        }
    }  # fmt: skip
    plain, env = station(), NavigationObservation(station(), quiet, deviations=(0.0, 0.0, 0.0))
    a, b = plain.reset(seed=5)[0], env.reset(seed=5)[0]
    np.testing.assert_array_equal(a, b)
    for k in range(40):
        given = 0.3 * actions(plain, k)
        (a, *rest_a, _), (b, *rest_b, info) = plain.step(given), env.step(given)
        np.testing.assert_allclose(a, b, atol=2e-2)
        for x, y in zip(rest_a, rest_b, strict=True):
            np.testing.assert_array_equal(x, y)
    assert info["sensors"]["imu"]["valid"].all()


def test_observations_depend_on_seed_and_episode_and_not_on_the_batch() -> None:
    many, one = (
        NavigationObservation(station(4, max_episode_steps=7)),
        NavigationObservation(station(1, max_episode_steps=7)),
    )
    a, b = many.reset(seed=5)[0], one.reset(seed=7)[0]
    np.testing.assert_array_equal(a[2:3], b)
    for k in range(20):
        given = actions(many, k)
        a, b = many.step(given)[0], one.step(given[2:3])[0]
        np.testing.assert_array_equal(a[2:3], b)
    again = NavigationObservation(station(4, max_episode_steps=7))
    assert not np.array_equal(again.reset(seed=6)[0][2:3], many.reset(seed=5)[0][2:3])


def test_a_mask_resets_only_its_instances() -> None:
    env = NavigationObservation(station(2, autoreset_mode=AutoresetMode.DISABLED))
    before = env.reset(seed=1)[0]
    for k in range(5):
        before = env.step(actions(env, k))[0]
    after, _ = env.reset(options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(after[1], before[1])
    assert not np.array_equal(after[0], before[0])
    env.step(actions(env, 0))


def test_a_controller_keeps_station_on_the_filter() -> None:
    env = NavigationObservation(station(16))
    controller, state, info = make_controller("dob", env), None, {}
    observation, _ = env.reset(seed=2)
    for _ in range(200):
        action, state = controller.predict(observation, state)
        observation, *_, info = env.step(action)
    assert np.median(info["rms_position_error"]) < 0.25


def test_controllers_err_less_on_the_filter_than_on_the_measured_pose() -> None:
    for name, rows in control(("pd", "dob"), n=32).items():
        measured, filtered, true = (
            rows[label] for label in ("pose as measured", "filter, short-range fixes", "true state")
        )
        for key in ("position_mm", "attitude_deg", "power_percent"):
            assert np.mean(filtered[key]) < np.mean(measured[key]), (name, key)
            assert abs(np.mean(filtered[key]) / np.mean(true[key]) - 1.0) < 0.05, (name, key)


def test_other_environments_are_refused() -> None:
    with pytest.raises(TypeError, match="env must be a UVMS vector environment, not SyncVectorEnv"):
        NavigationObservation(gymnasium.make_vec("UVMS-StationKeep-v0", 1, vectorization_mode="sync"))
    with pytest.raises(ValueError, match="the task of env is dock, but must be station-keep"):
        NavigationObservation(DockVectorEnv(1))
    with pytest.raises(ValueError, match="autoreset_mode of env is SAME_STEP, but must be NEXT_STEP or DISABLED"):
        NavigationObservation(station(1, autoreset_mode=AutoresetMode.SAME_STEP))
    env = NavigationObservation(station(1))
    env.reset(seed=0)
    with pytest.raises(TypeError, match="a rollout runs without wrappers, but env has NavigationObservation"):
        Rollout(env, make_controller("pd", env))


def test_rotation_vectors_are_inverse_to_rotations() -> None:
    directions = np.random.default_rng(0).normal(size=(1500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = np.concatenate([np.linspace(0.0, 3.1, 500), np.logspace(-12, 0, 500), np.pi - np.logspace(-9, 0, 500)])
    vectors = directions * sizes[:, None]
    np.testing.assert_allclose(_rotations.logarithm(_rotations.exponential(vectors)), vectors, atol=1e-14)
