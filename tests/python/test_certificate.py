"""Certificates of integration accuracy."""

import json
import logging
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import uvms_gym
from uvms_gym._task.base import TaskBase
from uvms_gym.cli import main
from uvms_gym.controllers import registry
from uvms_gym.studies.accuracy import certificate, episodes
from uvms_gym.studies.accuracy.certificate import CHECK, LIMITS, REFERENCE
from uvms_gym.studies.accuracy.episodes import Case, Configuration, Recording

STATION, TRACK, DOCK = (Case(f"UVMS-{task}-v0", {}, 3, 7) for task in ("StationKeep", "EETrack", "Dock"))
STORM = STATION._replace(env="UVMS-StationKeep-Storm-v0")
ENVIRONMENTS = [name for name in gymnasium.registry if name.startswith("UVMS-")]


def mk(step: float, order: int = 4) -> Configuration:
    return Configuration(f"mk{order}", "float64", step)


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Episodes of 2 s, with the package's policies, wherever the tests run."""
    monkeypatch.setattr(registry, "FOLDERS", [registry.PRETRAINED])
    whole = episodes.frame
    shortened = lambda case: (about := whole(case))._replace(steps=round(2.0 / about.period))  # noqa: E731
    monkeypatch.setattr(certificate, "frame", shortened)


def test_errors_fall_with_the_order_of_the_method() -> None:
    steps = (0.0025, 0.005, 0.01)
    chosen = [mk(step, order) for order in (2, 3, 4) for step in steps]
    rows = certificate.certify(STATION, chosen)["rows"]
    for k, order in enumerate((2, 3, 4)):
        mine = [row["errors"]["pd"]["position"]["median"] for row in rows[3 * k : 3 * k + 3]]
        slope = np.polyfit(np.log(steps), np.log(mine), 1)[0]
        assert slope == pytest.approx(order, abs=0.2), order


def test_thrusters_with_lag_leave_methods_their_order() -> None:
    # Under quadratic drag, whose kink costs part of the fourth order.
    rows = certificate.certify(STORM, [mk(0.005), mk(0.01)])["rows"]
    for drive in rows[0]["errors"]:
        fine, coarse = (row["errors"][drive]["position"]["median"] for row in rows)
        assert coarse > 8.0 * fine, drive


def test_a_run_of_the_reference_itself_has_no_error() -> None:
    (row,) = certificate.certify(STORM, [REFERENCE])["rows"]
    assert set(row["errors"]) == {"random", "pd", "ppo"}
    assert row["judged"] == dict.fromkeys(LIMITS, 0.0)
    assert row["exceeded"] == []


def test_a_wrong_step_is_refused_and_a_right_one_certified() -> None:
    result = certificate.certify(TRACK, [mk(0.005), mk(0.05)])
    right, wrong = result["rows"]
    assert right["exceeded"] == []
    # Unstable by the modes of its arm.
    assert {"joints", "observation", "stability", "warning"} <= set(wrong["exceeded"])
    assert {"integrator": "mk4", "dtype": "float64", "step": 0.005} in result["recommended"]


def test_single_precision_is_resolved() -> None:
    (row,) = certificate.certify(DOCK, [Configuration("mk4", "float32", 0.005)])["rows"]
    assert 1e-8 < row["judged"]["position"] < 1e-4


@pytest.mark.parametrize("env", ENVIRONMENTS)
@pytest.mark.filterwarnings("ignore::uvms_gym.ControllerWarning")
def test_every_shipped_environment_has_candidates_and_drives(env: str) -> None:
    about = episodes.frame(Case(env, {}, 1, 0))
    chosen = certificate.candidates(about)
    assert about.default in chosen
    assert {"mk4", "ros2"} == {one.integrator for one in chosen}
    assert all(episodes.divides(one.step, about.period) for one in chosen)
    # Policies are shipped for two tasks, for the control period of the storm.
    shipped = about.period == 0.1 and ("StationKeep" in env or "EETrack" in env)
    assert len(about.drives) == (3 if shipped else 2)
    # The reference is not one of them.
    assert min(one.step for one in chosen) >= 4.0 * REFERENCE.step


@pytest.mark.parametrize("env", ["UVMS-StationKeep-Storm-v0", "UVMS-Dock-Storm-v0", "UVMS-EETrack-v0"])
def test_draws_do_not_depend_on_the_step(env: str) -> None:
    about = episodes.frame(Case(env, {}, 1, 0))
    seen = []
    for step in (about.default.step, REFERENCE.step):
        envs: Any = gymnasium.make_vec(env, num_envs=2, dt=step, substeps=round(about.period / step))
        first, _ = envs.reset(seed=5)
        seen.append((first, envs.unwrapped.disturbance(1, about.steps)))
    (coarse, forecast), (fine, other) = seen
    assert coarse.tobytes() == fine.tobytes()
    for name in forecast:
        np.testing.assert_allclose(forecast[name], other[name], rtol=1e-12, atol=1e-12, err_msg=name)


def test_noise_is_measured_with_its_deviations() -> None:
    case = STORM._replace(episodes=16)
    about = episodes.frame(case)
    actions = np.zeros((about.steps, case.episodes, 6), dtype=np.float32)
    deviation = episodes.noise_deviation(case, about, actions)
    own = uvms_gym.disturbance_levels()["storm"].components["noise"]
    for block in about.layout:
        name = block.name.replace("_error", "")
        if name in own:
            np.testing.assert_allclose(deviation[block.slice] * block.scale, own[name], rtol=0.1)
        elif name != certificate.INTEGRAL:
            assert not deviation[block.slice].any(), name
    # An environment without noise of its own has the default noise of the component.
    other = episodes.noise_deviation(
        STATION._replace(episodes=16), episodes.frame(STATION), np.zeros((400, 16, 6), "f4")
    )
    np.testing.assert_allclose(other[:12], deviation[:12], rtol=0.1)


def recording(rewards: list[list[float]], ends: list[int]) -> Recording:
    """Recording at rest with these rewards (T, N), whose episodes end after `ends` control periods."""
    given = np.array(rewards)
    t, n = given.shape
    running = np.arange(t)[:, None] < np.array(ends)
    zeros, rotation = np.zeros((t, n, 3)), np.tile(np.eye(3), (t, n, 1, 1))
    return Recording(np.zeros((t, n, 6), "f4"), np.zeros((t, n, 2)), given, running, zeros, rotation, zeros, zeros, [])


def test_episodes_are_compared_up_to_the_first_end() -> None:
    truth = recording([[0.0, 1.0], [0.0, 1.0], [9.0, 1.0]], [2, 3])
    run = recording([[0.5, 1.0], [0.0, 1.0], [-9.0, 3.0]], [3, 3])
    away = run.position.copy()
    away[2, 0], away[1, 1] = 7.0, [3.0, 4.0, 0.0]
    run = run._replace(position=away, observations=run.observations + np.array([0.02, 5.0]))
    found = certificate.compare(run, truth, np.array([0.1, 0.0]))
    assert found["position"]["worst"] == 5.0
    assert found["return"]["worst"] == 2.0
    # The sums are 0 and 3.
    assert found["reward"]["worst"] == pytest.approx(2.0 / 1.5)
    assert found["observation"]["worst"] == pytest.approx(0.2)
    assert found["ends_differ"] == 1
    away[0, 0] = np.nan
    assert certificate.compare(run, truth, np.array([0.1, 0.0]))["position"]["worst"] == np.inf


def test_recommended_is_the_max_certified_step() -> None:
    rows = [{"integrator": "mk4", "dtype": "float64", "step": h, "exceeded": e} for h, e in ((0.1, ["x"]), (0.05, []))]
    rows += [rows[1] | {"step": 0.01}, rows[0] | {"dtype": "float32"}]
    assert [entry["step"] for entry in certificate.recommend(rows)] == [0.05, None]


def test_a_reference_that_is_not_converged_is_refused() -> None:
    with pytest.raises(ValueError, match="reference not converged under random actions: position uncertain by"):
        certificate.certify(TRACK, [], reference=mk(0.025), check=CHECK)


def test_the_command_prints_and_stores_a_certificate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "mine.toml"
    scene.write_text(uvms_gym.dump_scene("bluerov2-heavy-alpha5"))
    arguments = ["--env", "UVMS-Dock-v0", "--scene", str(scene), "--dt", "0.01", "--dt", "0.05", "--episodes", "2"]
    assert main(["accuracy", *arguments, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "mine.toml: mk4 float64 at 0.01 s: certified" in printed
    data = json.loads((tmp_path / "out/certificate.json").read_text())
    (result,) = data["results"].values()
    assert [row["step"] for row in result["rows"]] == [0.01, 0.05]
    assert data["circumstances"]["arguments"]["seed"] == 0
    assert (tmp_path / "out/certificate.png").read_bytes().startswith(b"\x89PNG")


def test_a_scene_of_the_users_own_mentions_the_certificate_once(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(TaskBase, "_certificate_mentioned", False)
    caplog.set_level(logging.INFO, logger="uvms_gym")
    gymnasium.make("UVMS-Dock-v0")
    assert not caplog.records
    scene = tmp_path / "mine.toml"
    scene.write_text(uvms_gym.dump_scene("bluerov2-heavy"))
    gymnasium.make_vec("UVMS-Dock-v0", num_envs=2, scene=str(scene))
    gymnasium.make("UVMS-StationKeep-v0", scene=uvms_gym.load_scene("bluerov2-heavy"))
    (record,) = caplog.records
    assert record.getMessage().endswith(f"uvms accuracy --env UVMS-Dock-v0 --scene {scene}")
