import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym.cli import main
from uvms_gym.controllers import NoControl
from uvms_gym.logs.interpolation import hermite
from uvms_gym.studies.paper import arm_motion, momentum

PNG = b"\x89PNG\r\n\x1a\n"


def uvms(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "uvms_gym", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, env=os.environ | environment)


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("reproduce")
    done = uvms("reproduce", "--out", str(out / "a/b"), "--json", str(out / "c/numbers.json"))
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads((out / "c/numbers.json").read_text())
    assert data == json.loads((out / "a/b/reproduce.json").read_text())
    return data | {"text": done.stdout, "folder": out / "a/b"}


def test_table_1_is_the_time_modulo_two_pi_at_both_instants(reproduction: dict[str, Any]) -> None:
    rows = {row["method"]: row for row in reproduction["results"]["table_1"]}
    assert rows["MK4"]["yaw_499_9"] == pytest.approx(3.528360732812665, abs=1e-9)
    assert rows["MK4"]["yaw_500"] == pytest.approx(3.628360732812688, abs=1e-9)
    for instant, time in (("yaw_499_9", 499.9), ("yaw_500", 500.0)):
        assert rows["reference, t mod 2 pi"][instant] == pytest.approx(math.fmod(time, 2 * math.pi), abs=1e-12)
    # What the paper prints for MK4 and the reference is the earlier instant.
    assert f"{rows['MK4']['yaw_499_9']:.3f}" == "3.528"
    assert f"{rows['MK4']['yaw_500']:.3f}" == "3.628"


def test_what_the_paper_prints_for_eq_14_needs_the_limit_of_stability_or_the_euler_update(
    reproduction: dict[str, Any],
) -> None:
    sweep = reproduction["results"]["gamma_sweep"]
    rk4 = {row["gamma"]: row["yaw_499_9"] for row in sweep["quaternion-rk4"]["rows"]}
    assert all(abs(yaw - 3.5285) < 0.0006 for gamma, yaw in rk4.items() if gamma <= 20.0)
    assert sweep["quaternion-rk4"]["gamma_of_printed"] == pytest.approx(27.19, abs=0.02)
    euler = {row["gamma"]: row for row in sweep["quaternion-euler"]["rows"]}
    assert euler[0.24]["yaw_499_9"] == pytest.approx(3.683, abs=5e-4)
    assert euler[0.24]["quaternion_length"] == pytest.approx(1.05, abs=0.01)
    assert all(3.72 < euler[gamma]["yaw_499_9"] < 3.737 for gamma in (1.0, 1.5, 2.0))


def test_on_a_tumble_mk4_and_normalised_rk4_have_the_same_order(reproduction: dict[str, Any]) -> None:
    tumble = reproduction["results"]["tumbling"]
    assert tumble["orders"]["MK4"] == pytest.approx(4.0, abs=0.25)
    assert tumble["orders"]["RK4 + normalise"] == pytest.approx(4.0, abs=0.25)
    # Two integrators agree at the reference's step far better than the errors that are measured against it.
    assert tumble["reference"]["uncertainty"] < 1e-2 * min(map(min, tumble["errors"].values()))


@pytest.mark.parametrize("system", ["without water", "total impulse in still water"])
def test_momentum_is_conserved(system: str, reproduction: dict[str, Any]) -> None:
    study = reproduction["results"]["momentum"][system]
    (at_paper_step,) = [run for run in study["runs"] if run["step"] == 0.01]
    for kind in ("linear", "angular"):
        assert at_paper_step[kind] < 1e-8
        assert study["orders"][kind] > 3.8
    # It is no conservation at rest: momentum to begin with, joints near 0.5 rad/s, and all of 100 s.
    assert np.linalg.norm(at_paper_step["initial_momentum"][:3]) > 10.0
    assert min(at_paper_step["joint_rate_max"]) > 0.4
    assert at_paper_step["time"][-1] == pytest.approx(100.0)


def test_gravity_would_break_the_conservation_that_is_measured() -> None:
    scene = momentum.conservative_scene(False)
    scene["water"]["gravity"] = [0.0, 0.0, -1e-6]
    assert momentum.drift(scene, 0.02, time=10.0)["linear"] > 1e-5


def test_an_uncontrolled_vehicle_moves_much_more_than_a_controlled_one(reproduction: dict[str, Any]) -> None:
    study = reproduction["results"]["arm_motion"]
    free, controlled, held = (study["numbers"][case] for case in arm_motion.CASES)
    assert free["position_max"] > 20.0 * controlled["position_max"] > 0.0
    assert free["end_effector_max"] > 5.0 * controlled["end_effector_max"]
    assert held["position_max"] == held["angle_max"] == 0.0
    columns = {name: np.array(values) for name, values in study["cases"]["uncontrolled"].items()}
    # The loop is at rest before the arm starts, and the arm does what it is told.
    assert np.abs(np.diff(columns["rpy"][:3], axis=0)).max() < 1e-4
    assert np.ptp(columns["q"][:, arm_motion.JOINT]) == pytest.approx(math.radians(45.0), rel=0.03)
    assert np.ptp(np.delete(columns["q"], arm_motion.JOINT, axis=1), axis=0).max() < 0.06


def test_cubic_meets_values_and_rates_at_both_ends() -> None:
    start, end = (np.array([1.0]), np.array([-2.0])), (np.array([0.5]), np.array([3.0]))
    cubic = np.polynomial.Polynomial(hermite(start, end, 0.7)[0])
    rate = cubic.deriv()
    assert [cubic(0.0), rate(0.0), cubic(0.7), rate(0.7)] == pytest.approx([1.0, -2.0, 0.5, 3.0])


def test_reproduce_prints_tables_and_writes_pictures(reproduction: dict[str, Any]) -> None:
    assert "3.52836" in reproduction["text"]
    assert "3.62836" in reproduction["text"]
    names = ("fig2", "gamma", "tumbling", "momentum", "fig5", "fig6", "fig7")
    assert all((reproduction["folder"] / f"{name}.png").read_bytes().startswith(PNG) for name in names)
    assert reproduction["circumstances"]["machine"]["cores"] == os.cpu_count()


@pytest.mark.parametrize(
    ("command", "name"),
    [("compare", "compare.json"), ("compare", "compare.png"), ("reproduce", "fig7.png"), ("accuracy", "accuracy.png")],
)
def test_files_that_cannot_be_written_are_refused_before_computing(
    command: str, name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / name).mkdir()
    assert main([command, "--out", str(tmp_path)]) == 2
    assert f"{name}: it is a folder" in capsys.readouterr().err
    (tmp_path / name).rmdir()
    (tmp_path / name).touch()
    access = os.access
    # Root may write to all files, so the answer is made up.
    monkeypatch.setattr(
        os, "access", lambda path, mode: (mode != os.W_OK or Path(path).name != name) and access(path, mode)
    )
    for arguments in (["--out", str(tmp_path)], ["--out", str(tmp_path / "other"), "--json", str(tmp_path / name)]):
        assert main([command, *arguments]) == 2
        assert f"{name}: permission denied" in capsys.readouterr().err


def test_no_control_is_asked_as_any_policy_is() -> None:
    env = uvms_gym.envs.station_keep.StationKeepVectorEnv(2)
    observations, _ = env.reset(seed=0)
    actions, state = NoControl(env).predict(observations, None, episode_start=np.ones(2), deterministic=True)
    assert (actions.shape, actions.any(), state) == ((2, 6), False, None)


def test_exit_status_reaches_the_shell() -> None:
    done = uvms("compare", "--scene", "no-such-scene")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "no-such-scene" in done.stderr
    done = uvms("--version")
    assert (done.returncode, done.stdout.split()[0]) == (0, "uvms")


@pytest.mark.parametrize(
    ("ending", "status"),
    [("scenes show free-body >&-", 0), ("scenes show none 2>&-", 2), ("scenes show free-body >&- 2>&-", 0)],
)
def test_a_closed_output_is_no_error(ending: str, status: int) -> None:
    command = f"{sys.executable} -P -m uvms_gym {ending}"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (status, "")


def test_an_output_that_is_not_utf_8_shows_what_it_can() -> None:
    done = uvms("scenes", "show", "petasus-pum", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stderr) == (0, "")
    assert "petasus-pum" in done.stdout and done.stdout.isascii()


def test_a_warning_is_one_line_without_code(tmp_path: Path) -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy")
    scene["vehicle"]["meshes"] = [{"file": str(tmp_path / "lost.stl")}]
    (tmp_path / "scene.toml").write_text(uvms_gym.dump_scene(scene))
    play = ("--scene", str(tmp_path / "scene.toml"), "--seconds", "0.1", "--out", str(tmp_path / "end.png"))
    done = uvms("play", "--controller", "none", *play)
    (line,) = done.stderr.splitlines()
    assert line.startswith("uvms: warning: vehicle: drawn without meshes: ")


def test_a_missing_extra_is_one_line_that_says_what_to_install(tmp_path: Path) -> None:
    code = (
        "import importlib.util as u, sys; real = u.find_spec\n"
        "u.find_spec = lambda name, *rest: None if name == 'typer' else real(name, *rest)\n"
        "from uvms_gym.cli import main; sys.exit(main(['reproduce']))"
    )
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "uvms-gym[cli]" in line
    assert "typer" in line


def test_scenes_shows_contact_and_fixtures(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text(uvms_gym.scene_template().replace("#fixtures", "fixtures", 1).replace("#stiffness", "stiffness", 1))
    assert main(["scenes", "show", str(path)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    for row in (
        "skid vehicle 0.2 0 -0.15 0.02",
        "seabed world plane unbounded 0 0 -50",
        "pile world cylinder radius 0.3, length 20 12 5 0",
        "seabed 2000 2 0.0005 0.4 0.003",
        "rim 5000 2 0.0005 0.4 0.003",
        "valve revolute unlimited 0 0 0 0 0",
    ):
        assert row.split() in rows


def test_scenes_lists_shows_and_checks(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["scenes", "list"]) == 0
    assert "petasus-pum" in capsys.readouterr().out
    assert main(["scenes", "show", "petasus-pum", "--json", str(tmp_path / "scene.json")]) == 0
    assert "upper-arm" in capsys.readouterr().out
    assert json.loads((tmp_path / "scene.json").read_text())["name"] == "petasus-pum"
    assert main(["scenes", "check", "rexrov"]) == 0
