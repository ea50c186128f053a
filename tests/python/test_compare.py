"""`uvms compare`: conditions, episodes, statistics, and files."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import SMALL, policy, ship

import uvms_gym
from uvms_gym._files import lock
from uvms_gym.cli import compare_report, main
from uvms_gym.controllers import registry
from uvms_gym.controllers.families import names
from uvms_gym.studies.comparison import conditions, contenders, plots, study, summary
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import Estimate, interquartile_mean
from uvms_gym.training.evaluation import run_episodes

PNG = b"\x89PNG\r\n\x1a\n"
STORM, TRACK = "UVMS-StationKeep-Storm-v0", "UVMS-EETrack-Storm-v0"


def condition_of(
    env: str = STORM, scene: str = SMALL, level: str | None = None, departure: str = "design", **given: Any
) -> Any:
    """One condition."""
    levels = [] if level is None else [level]
    (found,) = conditions.make_conditions([env], {scene: scene}, levels, [departure], **given)
    return found


def run(of: Any, name: str, episodes: int, seed: int = 5) -> dict[str, np.ndarray]:
    """Scores of a controller under a condition."""
    return contenders.run(contenders.make_envs(of, episodes), of, contenders.make_contender(of, name), seed).scores


def repeated(option: str, *values: str) -> list[str]:
    """A list as a repeated option."""
    return [word for value in values for word in (option, value)]


THREE = repeated("--controller", "none", "pd", "pid")


def compared(out: Path, *arguments: str) -> dict[str, Any]:
    assert main(["compare", *arguments, "--out", str(out)]) == 0
    return json.loads((out / "compare.json").read_text())


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two policies for the small scene at 0.1 s."""
    monkeypatch.setattr(registry, "FOLDERS", [tmp_path / "policies"])
    return ship(tmp_path / "policies")


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("compare")
    data = compared(out, "--scene", SMALL, *THREE, "--episodes", "48", "--seed", "3")
    for picture in ("compare.png", "profiles.png"):
        assert (out / picture).read_bytes().startswith(PNG)
    assert not (out / "off-design.png").exists()
    return data | {"scores": dict(np.load(out / "scores.npz"))}


def test_pd_beats_no_control_with_intervals_apart(comparison: dict[str, Any]) -> None:
    (result,) = comparison["results"]
    none, pd = (result["controllers"][name]["metrics"] for name in ("none", "pd"))
    assert result["baseline"] == "pd"
    for metric in ("pose", "position", "attitude", "end_effector"):
        for part in ("whole", "settled"):
            assert pd[metric][part]["iqm"]["high"] < none[metric][part]["iqm"]["low"]
            assert pd[metric][part]["iqm"]["value"] < pd[metric][part]["p95"]["value"]
            against = result["against"]["pd"]["none"][metric][part]
            assert against["difference"]["low"] > 0.0
            assert against["probability_of_improvement"]["high"] < 0.2
            assert against["ratio"]["low"] > 1.0
    assert none["power"]["whole"]["iqm"]["value"] == none["variation"]["whole"]["iqm"]["value"] == 0.0
    assert pd["power"]["whole"]["iqm"]["low"] > 0.0 and pd["variation"]["whole"]["iqm"]["low"] > 0.0
    assert result["winner"] in ("pd", "pid") and result["margin"]["value"] <= 1.0
    assert "none" not in result["profiles"]


def test_statistics_are_those_of_the_stored_scores(comparison: dict[str, Any]) -> None:
    (result,) = comparison["results"]
    scores = comparison["scores"]
    name = f"{STORM}, {SMALL}, design"
    for controller, entry in result["controllers"].items():
        for metric, parts in entry["metrics"].items():
            for part, estimates in parts.items():
                stored = scores[f"{name}/{controller}/{metric}/{part}"]
                assert stored.shape == (1, 48)
                if "iqm" in estimates:
                    assert estimates["iqm"]["value"] == pytest.approx(interquartile_mean(stored))
                    assert estimates["p95"]["value"] == pytest.approx(np.quantile(stored, 0.95))
                    if "worst" in estimates:
                        assert estimates["worst"] == pytest.approx(stored.max())
                        assert estimates["p999"] == pytest.approx(np.quantile(stored, 0.999))
                else:
                    assert estimates["mean"]["value"] == pytest.approx(stored.mean())
    pd, pid = (scores[f"{name}/{controller}/pose/whole"][0] for controller in ("pd", "pid"))
    against = result["against"]["pd"]["pid"]["pose"]["whole"]
    assert against["ratio"]["value"] == pytest.approx(interquartile_mean(pid) / interquartile_mean(pd))
    assert against["difference"]["value"] == pytest.approx(interquartile_mean(pid - pd))
    better = np.mean(pid[:, None] < pd) + 0.5 * np.mean(pid[:, None] == pd)
    assert against["probability_of_improvement"]["value"] == pytest.approx(better)
    profile, tau = result["profiles"]["pd"], np.array(result["profiles"]["thresholds"])
    np.testing.assert_allclose(profile["value"], [(pd <= t).mean() for t in tau], rtol=1e-6)
    np.testing.assert_allclose(result["controllers"]["pd"]["kept"]["pose"][0], pd[: summary.KEPT], rtol=1e-6)


def test_circumstances_tell_what_a_result_depends_on(comparison: dict[str, Any]) -> None:
    recorded = comparison["circumstances"]
    assert recorded["arguments"]["controllers"] == ["none", "pd", "pid"]
    assert recorded["arguments"]["seed"] == 3 and recorded["arguments"]["episodes"] == 48
    assert {"commit", "machine", "numpy", "gymnasium", "uvms_gym"} <= recorded.keys()
    assert comparison["results"][0]["options"]["disturbance"] == "storm"
    controllers = comparison["results"][0]["controllers"]
    assert controllers["none"]["origin"] == {"tuned": None}
    assert controllers["pd"]["origin"]["tuned"]["gains"].keys() == {"kp", "kd"}


def test_comparison_is_deterministic_by_seed(comparison: dict[str, Any], tmp_path: Path) -> None:
    def again(seed: int) -> Any:
        given = ["--scene", SMALL, *THREE, "--episodes", "48", "--seed", str(seed)]
        return timeless(compared(tmp_path, *given)["results"])

    def timeless(results: Any) -> Any:
        for result in results:
            for entry in result["controllers"].values():
                entry.pop("seconds", None)
        return results

    first = timeless(comparison["results"])
    assert again(3) == first
    assert again(4) != first


def test_episodes_are_paired_and_do_not_depend_on_their_number() -> None:
    few, many = (run(condition_of(), "pd", n) for n in (3, 9))
    for key in ("pose/whole", "pose/settled"):
        assert np.array_equal(few[key], many[key][:, :3])
    shifted = run(condition_of(), "pd", 2, 6)["pose/whole"]
    assert np.array_equal(shifted, few["pose/whole"][:, 1:])


@pytest.mark.parametrize("env", [STORM, TRACK])
def test_a_comparison_measures_what_the_environment_reports(env: str) -> None:
    scene = SMALL if env == STORM else "petasus-pum"
    name = "pid" if env == STORM else "resolved"
    scores = run(condition_of(env, scene), name, 2)
    single = gymnasium.make(env, scene=scene)
    controller = registry.make_controller(name, single)
    observation, _ = single.reset(seed=6)
    over, state, before, pose, changes = False, None, 0.0, [], []
    while not over:
        action, state = controller.predict(observation, state)
        observation, _, terminated, truncated, info = single.step(action)
        pose.append(info["position_error"] ** 2 + 0.25 * info["attitude_error"] ** 2)
        # What the observation calls the previous action is the one as clipped.
        changes.append(np.mean((np.clip(action, -1.0, 1.0) - before) ** 2))
        before = np.clip(action, -1.0, 1.0)
        over = terminated or truncated
    reported = {
        "position": info["rms_position_error"],
        "attitude": info["rms_attitude_error"],
        "pose": np.sqrt(np.mean(pose)),
        "power": info["mean_power"],
        "saturation": info["mean_saturation"],
        "variation": np.mean(changes),
        "within": info["mean_success"],
        "recovery": info["recovery_time"],
        "success": info["success"],
        "diverged": 0.0,
    }
    for metric, value in reported.items():
        assert scores[f"{metric}/whole"][0, 1] == pytest.approx(value, rel=1e-6), metric
    settled = np.sqrt(np.mean(pose[30:]))
    assert scores["pose/settled"][0, 1] == pytest.approx(settled, rel=1e-6)


def test_who_diverges_never_recovers() -> None:
    away = condition_of(scene=SMALL, level="storm-hard")
    wild = contenders.Contender("wild", (), [policy(weights=[np.zeros((6, 24))], biases=[np.ones(6)])], {})
    scores = contenders.run(contenders.make_envs(away, 3), away, wild, 0).scores
    assert scores["diverged/whole"].all()
    assert (scores["recovery/whole"] == 20.0).all()
    assert (scores["pose/whole"] > 1.0).all() and np.isfinite(scores["pose/settled"]).all()


# Conditions


def made(condition: str, env: str = STORM) -> dict[str, Any]:
    return condition_of(env, departure=condition).options


def test_every_condition_makes_an_environment_and_changes_episodes() -> None:
    poses = {}
    for condition in conditions.DEPARTURES:
        of = condition_of(departure=condition)
        poses[condition] = run(of, "pd", 2)["pose/whole"][0, 1]
        contenders.make_envs(condition_of(TRACK, "bluerov2-heavy-alpha5", departure=condition), 2)
    assert len(set(poses.values())) == len(poses)
    assert poses["x1.3"] > poses["design"] > poses["arm-only"]
    assert poses["delay"] > poses["design"] > poses["calm"]


def test_conditions_are_what_they_say() -> None:
    storm = uvms_gym.disturbance_levels()["storm"].components
    assert made("lag")["thruster_lag"] == 0.2
    assert made("delay")["disturbance"] == {**storm, "delay": {"time": 0.2}}
    assert made("storm-hard")["disturbance"] == "storm-hard"
    harder = made("x1.3")["disturbance"]
    assert harder["current"]["speed"] == pytest.approx([0.13, 0.39])
    assert harder["impulse"]["share"] == pytest.approx([0.39, 1.3])
    assert harder["thrusters"]["gain"] == pytest.approx([0.5 / 1.3, 0.8 / 1.3])
    assert harder["noise"] == storm["noise"] and harder["delay"] == storm["delay"]
    assert set(made("arm-only")["disturbance"]) == {"arm", "noise", "delay"}
    assert set(made("impulses-only")["disturbance"]) == {"impulse", "noise", "delay"}
    assert made("impulses-only")["arm_amplitude"] == 0.0
    assert "arm_amplitude" not in made("impulses-only", TRACK)
    fast = condition_of(departure="period-0.05")
    assert (fast.options["substeps"], fast.steps) == (5, 400)
    # Controllers know the control period, but not the lag.
    assert condition_of(departure="lag").designed["thruster_lag"] == 0.1
    assert fast.designed["substeps"] == 5
    assert condition_of("UVMS-StationKeep-v0", departure="delay").options["disturbance"]["current"] == {
        "speed": [0.0, 0.3]
    }


def test_informed_controllers_bound_the_others_in_the_same_episodes(
    shipped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--scene", SMALL, "--episodes", "8", *repeated("--controller", "pd", "dob", "dob/informed")]
    data = compared(tmp_path, *given, "--frontier")
    (result,) = data["results"]
    errors = {name: entry["metrics"]["pose"]["whole"]["iqm"] for name, entry in result["controllers"].items()}
    assert errors["dob/informed"]["value"] < errors["dob"]["value"]
    assert result["winner"] == "dob" and "dob/informed" not in result["against"]
    assert (tmp_path / "frontier.png").stat().st_size > 10_000
    out = capsys.readouterr().out
    assert "of the gap" in out and "100 %" in out
    # Alone in the twin condition it has the same episodes.
    envs = gymnasium.make_vec(
        STORM, num_envs=8, scene=SMALL, disturbance={"base": "storm", "noise": None, "delay": None}
    )
    controller = registry.make_controller("dob/informed", envs)
    stats = run_episodes(envs, controller, 0, 200)
    assert result["controllers"]["dob/informed"]["kept"]["pose"][0] == pytest.approx(pose_rms(stats).tolist())


@pytest.mark.parametrize(("state", "late"), [("late", True), ("present", False)])
def test_a_bound_sees_the_true_state_of_the_same_episode(state: str, late: bool) -> None:
    measured = condition_of("UVMS-StationKeep-Storm-v0")
    seen, true = [], []
    for condition in (measured, conditions.informed(measured, state)):
        envs: Any = contenders.make_envs(condition, 4)
        envs.reset(seed=1)
        for _ in range(6):
            true.append(envs.unwrapped.perfect_observations()[:, :3])
            seen.append(envs.step(np.zeros((4, 6), np.float32))[0][:, :3])
        envs.close()
    # Same episodes; the pose that a bound sees is the true one, of one period before if it is late.
    np.testing.assert_array_equal(true[:6], true[6:])
    assert not np.array_equal(seen[:6], seen[6:])
    np.testing.assert_array_equal(seen[7:11], true[7:11] if late else true[8:12])


def test_conditions_are_compared_side_by_side(
    shipped: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--scene", SMALL, "--episodes", "4", *repeated("--condition", "design", "period-0.05", "calm")]
    data = compared(tmp_path, *given)
    design, fast, calm = data["results"]
    assert design["controllers"]["ppo"]["training_seeds"] == [0, 1]
    files = design["controllers"]["ppo"]["origin"]["files"]
    assert [file["name"] for file in files] == ["ppo-0.safetensors", "ppo-1.safetensors"]
    assert files[0]["notes"] == {"steps": "7"} and len(files[0]["sha256"]) == 64
    assert fast["missing"]["ppo"] == design["missing"]["residual"] == "no policy"
    assert "ppo" not in fast["controllers"] and "ppo" in calm["controllers"]
    assert np.load(tmp_path / "scores.npz")[f"{STORM}, {SMALL}, calm/ppo/pose/whole"].shape == (2, 4)
    printed = capsys.readouterr().out
    assert "of the gap" not in printed
    assert "no policy" in printed and "Winners" in printed and "against pid" in printed
    for picture in ("compare.png", "profiles.png", "off-design.png"):
        assert (tmp_path / picture).read_bytes().startswith(PNG)


def test_tasks_scenes_and_disturbances_are_crossed() -> None:
    envs, scenes, levels = [STORM, TRACK], ["bluerov2-heavy-alpha5", "petasus-pum"], ["calm", "waves"]
    found = conditions.make_conditions(envs, {name: name for name in scenes}, levels, ["design", "lag"])
    assert [(one.env, one.scene, one.level, one.departure) for one in found] == [
        (env, scene, level, condition)
        for env in envs
        for scene in scenes
        for level in levels
        for condition in ("design", "lag")
    ]
    assert all(one.options["disturbance"] == one.level for one in found)
    assert [one.label for one in found[:4]] == ["calm", "calm lag", "waves", "waves lag"]
    # Each task has the controllers that suit it.
    for comparison in study.make_comparisons(found, ["none", "pd", "resolved"]):
        assert list(comparison.contenders) == ["none", "pd" if comparison.condition.env == STORM else "resolved"]


def test_a_comparison_takes_any_file(tmp_path: Path) -> None:
    file = tmp_path / "policies/own.safetensors"
    file.parent.mkdir()
    policy().save(file)
    names = ["none", "pid", f"mlp:{file}"]
    given = ["--env", "UVMS-StationKeep-v0", "--scene", SMALL, "--episodes", "4", *repeated("--controller", *names)]
    (result,) = compared(tmp_path, *given)["results"]
    assert list(result["controllers"]) == names
    errors = [entry["metrics"]["pose"]["settled"]["iqm"]["value"] for entry in result["controllers"].values()]
    assert errors[1] < min(errors[0], errors[2])


# Bad input


def test_a_policy_that_does_not_fit_is_refused_before_computing(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file, out = tmp_path / "own.safetensors", tmp_path / "out"

    def message(*scenes: str) -> str:
        given = ["--env", "UVMS-StationKeep-v0", *(word for scene in scenes for word in ("--scene", scene))]
        assert main(["compare", *given, *repeated("--controller", "none", f"mlp:{file}"), "--out", str(out)]) == 2
        assert not out.exists()
        (line,) = capsys.readouterr().err.splitlines()
        return line

    assert f"cannot read {file}: No such file" in message(SMALL)
    policy().save(file)
    assert "its scene is bluerov2-heavy, the environment's rexrov" in message(SMALL, "rexrov")
    file.write_bytes(file.read_bytes()[:-5])
    assert "own.safetensors: not a policy of uvms_gym" in message(SMALL)


# What is printed and drawn


def test_numbers_are_written_to_the_digits_that_their_intervals_leave() -> None:
    assert compare_report.text(Estimate(0.0304, 0.0298, 0.0311), 1e3) == "30.4 [29.8, 31.1]"
    assert compare_report.text(Estimate(123.4, 110.0, 140.0)) == "123 [110, 140]"
    assert compare_report.text(Estimate(0.0, 0.0, 0.0)) == "0"
    assert compare_report.text(Estimate(3.0, float("nan"), float("nan"))) == "3"
    assert compare_report.percent(Estimate(0.36, 0.34, 0.38)) == "-64 % [-66, -62]"
    assert compare_report.percent(Estimate(1.002, 0.999, 1.004)) == "+0.2 % [-0.1, +0.4]"
    assert compare_report.percent(Estimate(float("nan"), float("nan"), float("nan"))) == "-"


def test_controllers_have_distinct_colours() -> None:
    colours = plots.colours([*names("station-keep")])
    assert len(set(colours.values())) == len(colours)


def test_a_stopped_comparison_goes_on_with_the_controllers_that_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run_one, ran = study.run, []

    def stopped(envs: Any, condition: Any, contender: Any, *rest: Any) -> Any:
        if contender.name == "pid" and "pid" not in ran:
            ran.append("pid")
            # Clusters send it.
            signal.raise_signal(signal.SIGTERM)
        ran.append(contender.name)
        return run_one(envs, condition, contender, *rest)

    given = ["compare", "--scene", SMALL, *THREE, "--episodes", "4"]
    for name in ("plot_bars", "plot_profiles"):
        monkeypatch.setattr(plots, name, lambda *arguments: None)
    whole = compared(tmp_path / "whole", *given[1:])
    monkeypatch.setattr(study, "run", stopped)
    out = ["--out", str(tmp_path / "out")]
    assert main([*given, *out]) == 130
    assert ran == ["none", "pd", "pid"]
    assert "the same command goes on" in capsys.readouterr().err
    assert main([*given, *out, "--seed", "6"]) == 2
    refused = capsys.readouterr().err
    assert refused.count("\n") == 1 and "seed is 0 there, 6 here" in refused
    ran[:] = ["pid"]
    assert main([*given, *out]) == 0
    assert ran == ["pid", "pid"]
    again = json.loads((tmp_path / "out/compare.json").read_text())
    for found in (whole, again):
        for entry in found["results"][0]["controllers"].values():
            entry.pop("seconds")
    assert again["results"] == whole["results"]
    # Nothing is kept of a run that has ended, and other settings are welcome.
    assert not (tmp_path / "out/unfinished").exists()
    assert main([*given, *out, "--seed", "6"]) == 0


def test_two_runs_do_not_share_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with lock(tmp_path):
        assert main(["compare", "--scene", SMALL, *THREE, "--episodes", "2", "--out", str(tmp_path)]) == 2
    message = capsys.readouterr().err
    assert f"{tmp_path} is in use by another run of uvms" in message and message.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("output", ["pipe", "full"])
def test_files_are_whole_where_the_output_is_not_read(output: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "uvms_gym", "compare", "--scene", SMALL, *THREE, "--episodes", "2"]
    reading, writing = os.pipe()
    os.close(reading)
    with open("/dev/full", "wb") as full:
        stdout = writing if output == "pipe" else full
        ended = subprocess.run([*command, "--out", str(tmp_path)], stdout=stdout, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    message = "" if output == "pipe" else "uvms: output: No space left on device\n"
    assert (ended.returncode, ended.stderr) == (0 if output == "pipe" else 2, message)
    assert {file.name for file in tmp_path.iterdir()} == {"compare.json", "scores.npz", "compare.png", "profiles.png"}
    assert json.loads((tmp_path / "compare.json").read_text())["results"]
