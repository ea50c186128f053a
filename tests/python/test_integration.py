"""Integrator and step of a scene: followed by simulators and environments, recommended, and written into its file."""

import copy
import json
import runpy
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import typer

import uvms_gym
from uvms_gym import SceneError, Simulator, StepWarning
from uvms_gym._task import base
from uvms_gym.cli import main
from uvms_gym.cli.app import app
from uvms_gym.envs import TaskOptions

IDS = [f"UVMS-{task}{variant}-v0" for task in ("StationKeep", "EETrack", "Dock") for variant in ("", "-Storm")]
#: Friction of 1 N m on a wrist of 3e-4 kg m2, as in many URDF files.
WRIST = """<robot name="r">
  <link name="base"><inertial><mass value="1.0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
  <link name="upper"><inertial><mass value="1.0"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.03" length="0.3"/></geometry></collision></link>
  <link name="wrist"><inertial><mass value="0.3"/>
    <inertia ixx="0.0003" iyy="0.0003" izz="0.0003" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><cylinder radius="0.02" length="0.05"/></geometry></collision></link>
  <joint name="shoulder" type="revolute"><origin xyz="0 0 0.3"/><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="30" velocity="1"/></joint>
  <joint name="wrist_joint" type="revolute"><origin xyz="0 0 0.3"/><parent link="upper"/><child link="wrist"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="30" velocity="3"/>
    <dynamics damping="1" friction="1"/></joint>
</robot>"""


def stating(name: str, **integration: Any) -> dict[str, Any]:
    """A scene that states integrator or step."""
    return {**uvms_gym.load_scene(name), "integration": integration}


@pytest.fixture
def stiff(tmp_path: Path) -> dict[str, Any]:
    """A vehicle with an arm whose wrist has friction."""
    path = tmp_path / "wrist.urdf"
    path.write_text(WRIST)
    return uvms_gym.import_robot(path)


def test_a_simulator_follows_its_scene_and_its_options_override_it() -> None:
    assert [(s.integrator, s.dt) for s in [Simulator("petasus-pum")]] == [("mk4", 0.01)]
    scene = stating("petasus-pum", integrator="ros2", step=0.02)
    for given, expected in (
        ({}, ("ros2", 0.02)),
        ({"dt": 0.005}, ("ros2", 0.005)),
        ({"integrator": "mk3"}, ("mk3", 0.02)),
    ):
        s = Simulator(scene, **given)
        assert (s.integrator, s.dt) == expected
    s = Simulator(stating("petasus-pum", step=0.004))
    assert (s.integrator, s.dt) == ("mk4", 0.004)
    assert uvms_gym.load_scene(scene)["integration"] == {"integrator": "ros2", "step": 0.02}


@pytest.mark.parametrize("env", IDS)
@pytest.mark.parametrize("single", [True, False])
def test_an_environment_follows_its_scene_in_the_same_control_period(env: str, single: bool) -> None:
    def make(**options: Any) -> tuple[Simulator, float]:
        made: Any = gymnasium.make(env, **options) if single else gymnasium.make_vec(env, num_envs=2, **options)
        inner = made.unwrapped
        return inner.snapshot(), inner.control_period

    usual, period = make(scene="petasus-pum")
    share = usual.dt / 0.01
    assert usual.integrator == "mk4" and share == (0.5 if "EETrack" in env else 1.0)
    for step in (0.01, 0.002, 0.02):
        simulator, found = make(scene=stating("petasus-pum", integrator="ros3", step=step))
        assert simulator.integrator == "ros3"
        assert found == pytest.approx(period, rel=1e-12)
        # The longest step up to the scene's that divides the period.
        count = np.ceil(period / (share * step) - 1e-9)
        assert simulator.dt == pytest.approx(period / count, rel=1e-12)
    simulator, _ = make(scene=stating("petasus-pum", integrator="ros3", step=0.002), integrator="mk4", dt=0.01)
    assert (simulator.integrator, simulator.dt) == ("mk4", 0.01)


def test_a_stated_default_changes_no_bit_and_another_integration_is_that_of_the_options() -> None:
    def run(scene: Any, **options: Any) -> Any:
        envs: Any = gymnasium.make_vec("UVMS-StationKeep-Storm-v0", num_envs=3, scene=scene, **options)
        envs.reset(seed=4)
        action = np.full(envs.action_space.shape, 0.3, np.float32)
        return np.stack([envs.step(action)[0] for _ in range(20)])

    usual = run("petasus-pum")
    assert np.array_equal(run(stating("petasus-pum", integrator="mk4", step=0.01)), usual)
    other = run(stating("petasus-pum", integrator="ros2", step=0.005))
    assert np.array_equal(run("petasus-pum", integrator="ros2", dt=0.005, substeps=20), other)
    assert not np.array_equal(other, usual)


@pytest.mark.parametrize(
    ("integration", "message"),
    [
        ({"step": 0.0}, r"<dict>: integration\.step: is 0\.0, but must be in \(0, 1\] s"),
        ({"step": 2.0}, r"<dict>: integration\.step: is 2\.0, but must be in \(0, 1\] s"),
        ({"integrator": 4}, r"<dict>: integration\.integrator: invalid type"),
        ({"method": "mk4"}, r"integration\.method: unknown key .*expected integrator or step"),
    ],
)
def test_invalid_integrations_are_refused(integration: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        uvms_gym.load_scene({**uvms_gym.load_scene("free-body"), "integration": integration})


def test_an_unknown_integrator_of_a_scene_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="no integrator named 'rk4': one of mk4, mk54"):
        Simulator(stating("free-body", integrator="rk4"))


@pytest.mark.parametrize("name", uvms_gym.scene_names())
def test_shipped_scenes_need_nothing_but_the_default(name: str) -> None:
    found = uvms_gym.recommend_integration(name)
    assert (found["integrator"], found["step"], found["accurate"]) == ("mk4", 0.01, True)
    if "gripper" in name:
        # Light fingers leave their stops after 0.05 s: the rest of the motion is judged without.
        scene = uvms_gym.load_scene(name)
        for finger in scene["arm"]["links"][-2:]:
            assert finger["name"].startswith("jaws-") and finger["joint"]["limits"]["upper"] == 0.5
            finger["joint"]["limits"] |= {"lower": -5.0, "upper": 5.0}
        found = uvms_gym.recommend_integration(scene)
    assert found["error"] < 1e-3


def test_fingers_that_are_thrown_against_their_stops_are_followed_at_the_default_step() -> None:
    def run(dt: float | None) -> Any:
        s = Simulator("bluerov2-heavy-alpha5-gripper", 8, dt=dt, error_estimate=False)
        q, qd = np.tile(s.q[:1], (8, 1)), np.zeros((8, s.num_joints))
        q[:, 4:], qd[:, 4], qd[:, 5] = [0.47, 0.03], np.linspace(0.2, 0.5, 8), -np.linspace(0.5, 0.2, 8)
        s.set_state(q=q, qd=qd)
        motion = []
        for _ in range(10):
            s.step(substeps=round(0.1 / s.dt))
            motion.append(s.q.copy())
        return np.array(motion)

    exact = run(1e-4)
    assert np.all(exact[0, :, 4] > 0.47) and np.any(exact[0, :, 5] < 0.0)
    usual, long = (np.abs(run(dt) - exact) for dt in (None, 0.02))
    assert usual.max() < 1e-4 < long.max()
    assert usual[:, :, :4].max() < 1e-6


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_friction_on_a_light_wrist_diverges_by_default_and_runs_as_recommended(stiff: dict[str, Any]) -> None:
    found = uvms_gym.recommend_integration(stiff)
    assert found["integrator"] in ("ros2", "ros3") and found["step"] == 0.01 and found["accurate"]
    assert "wrist" in found["reason"]
    # The import has recorded it.
    assert stiff["integration"] == {key: found[key] for key in ("integrator", "step")}

    def run(scene: dict[str, Any]) -> Any:
        env: Any = gymnasium.make("UVMS-StationKeep-v0", scene=scene)
        controller = uvms_gym.make_controller("pid", env)
        observation, _ = env.reset(seed=0)
        memory = None
        for _ in range(200):
            action, memory = controller.predict(observation[None], memory)
            observation, _, terminated, _, info = env.step(action[0])
            if terminated:
                return None
        return info["position_error"]

    scene = {**stiff, "integration": {key: found[key] for key in ("integrator", "step")}}
    error = run(scene)
    assert error is not None and error < 0.05
    usual = {key: value for key, value in stiff.items() if key != "integration"}
    assert run(usual) is None


def test_a_recommendation_holds_at_the_speed_that_thrusters_reach() -> None:
    """At rest nothing is fast; at 2 m/s, where thrust balances drag, the rate is `2 c v / m` = 400 1/s."""
    scene = copy.deepcopy(uvms_gym.load_scene("bluerov2-heavy"))
    scene["water"]["gravity"], scene["provenance"] = [0.0, 0.0, 0.0], {}
    body = scene["vehicle"]["body"]
    for key in ("weight", "buoyancy"):
        body.pop(key, None)
    total = 1.0
    body |= {"mass": total, "inertia": [1.0, 1.0, 1.0], "volume": 0.0, "center_of_mass": [0.0, 0.0, 0.0]}
    body |= {"added_mass": [0.0] * 6, "damping": {"linear": [1.0] * 6, "quadratic": [100.0, 0.0, 0.0, 0.0, 0.0, 0.0]}}
    scene["vehicle"] = {"name": "v", "body": body, "thrusters": [
        {"name": "t", "position": [0.0, 0.0, 0.0], "axis": [1.0, 0.0, 0.0], "limits": [-402.0, 402.0]}
    ]}  # fmt: skip
    slow, fast = (uvms_gym.recommend_integration(scene, speed) for speed in (0.1, None))
    assert (slow["integrator"], slow["step"]) == ("mk4", 0.01)
    assert (fast["integrator"], fast["step"]) != ("mk4", 0.01) and fast["accurate"]
    assert "rate 4" in fast["reason"] and "surge" in fast["reason"]


def test_a_recommendation_is_for_the_stated_speed_and_by_the_error() -> None:
    scene = uvms_gym.load_scene("bluerov2-heavy")
    at = {speed: uvms_gym.recommend_integration(scene, speed) for speed in (0.0, None, 10.0, 50.0, 1e4, 1e6)}
    choice = {speed: (found["integrator"], found["step"]) for speed, found in at.items()}
    assert choice[0.0] == choice[None] == choice[10.0] == ("mk4", 0.01)
    assert at[0.0]["error"] < 1e-9 < at[None]["error"] < 0.02 * at[10.0]["error"] < 1e-4
    # mk4 is unstable, and ros2, which is tried next, not accurate.
    assert choice[50.0] == ("ros3", 0.01) and "ros2 at 0.01 s (6.31 %)" in at[50.0]["reason"] and at[50.0]["accurate"]
    # Nothing known is accurate: the least error. Where all diverge, no one is better than the first.
    assert choice[1e4] == ("ros3", 0.0005) and 0.02 < at[1e4]["error"] < 0.1 and not at[1e4]["accurate"]
    assert choice[1e6] == ("ros2", 0.01) and at[1e6]["error"] == np.inf and not at[1e6]["accurate"]


def test_a_recommendation_follows_servos_too() -> None:
    """Servos of 100 1/s with a damping ratio of 0.05 are stable at 0.01 s, and off by 3 %; the arm alone is slow."""
    scene = copy.deepcopy(uvms_gym.load_scene("bluerov2-heavy-alpha5"))
    slow = uvms_gym.recommend_integration(scene)
    for joint in (link["joint"] for link in scene["arm"]["links"]):
        inertia = joint["rotor_inertia"] + 0.01
        joint["servo"] = {"kp": inertia * 100.0**2, "kd": 2.0 * 0.05 * inertia * 100.0}
        del joint["effort"]
    fast = uvms_gym.recommend_integration(scene)
    assert (slow["integrator"], slow["step"]) == ("mk4", 0.01)
    assert (fast["integrator"], fast["step"], fast["accurate"]) == ("mk4", 0.005, True)
    assert "mk4 at 0.01 s (2.79 %)" in fast["reason"]


@pytest.mark.parametrize("integrator", ["mk4", "mk3", "mk2", "ros2", "ros3", "mk54", "semi-implicit-euler"])
def test_no_warning_recommends_the_integrator_that_has_failed(integrator: str, stiff: dict[str, Any]) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for scene in ("petasus-pum", "bluerov2-heavy-alpha5", "rexrov", stiff):
            s = Simulator(scene, dt=0.1, integrator=integrator)
            n = s.num_joints
            s.set_state(qd=[4.0, -4.0, 4.0, -4.0, 4.0][:n], twist=[2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
            for _ in range(30):
                s.step(joint_torque=[5.0] * n if n else None)
    texts = [str(warning.message) for warning in caught if issubclass(warning.category, StepWarning)]
    assert texts or integrator == "mk54"
    for text in texts:
        _, _, advice = text.rpartition("; ")
        assert "do" in advice.split() and f"'{integrator}'" not in advice, text


def test_check_writes_the_integration_and_leaves_all_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], stiff: dict[str, Any]
) -> None:
    path, numbers = tmp_path / "my.toml", tmp_path / "my.json"
    text = "# A comment.\n" + uvms_gym.dump_scene({k: v for k, v in stiff.items() if k != "integration"})
    path.write_text(text)
    assert main(["scenes", "check", str(path), "--strict"]) == 1
    out = capsys.readouterr().out
    assert "warning: integration: mk4 at 0.01 s is unstable" in out and "arm.links[1].joint.friction (wrist)" in out
    assert main(["scenes", "check", str(path), "--write", "--json", str(numbers)]) == 0
    advice = json.loads(numbers.read_text())["recommended"]
    written = path.read_text()
    assert written.startswith(text.rstrip("\n")) and written.count("[integration]") == 1
    assert uvms_gym.load_scene(path)["integration"] == {key: advice[key] for key in ("integrator", "step")}
    simulator = Simulator(path)
    assert (simulator.integrator, simulator.dt) == (advice["integrator"], advice["step"])
    # Again: nothing to add, and nothing to warn of.
    capsys.readouterr()
    assert main(["scenes", "check", str(path), "--write"]) == 0
    assert path.read_text() == written
    assert "warning: integration" not in capsys.readouterr().out
    # A table with comments of its own.
    path.write_text(text + '\n[integration] # mine\nstep = 0.05 # slow\n\n[provenance."x"]\n'.split("\n[provenance")[0])
    assert main(["scenes", "check", str(path), "--write"]) == 0
    assert "[integration] # mine\n" in path.read_text() and "step = 0.01 # slow" in path.read_text()


def test_check_writes_no_shipped_scene_and_no_inline_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "check", "rexrov", "--write"]) == 2
    assert "--write needs a file of your own, but rexrov is a shipped scene" in capsys.readouterr().err
    path = tmp_path / "my.toml"
    text = "integration = { step = 0.02 }\n" + uvms_gym.dump_scene("free-body")
    path.write_text(text)
    assert main(["scenes", "check", str(path), "--write"]) == 2
    assert "integration is not stated as a table of its own" in capsys.readouterr().err
    assert path.read_text() == text


#: Commands without --integrator and --dt, and why.
WITHOUT = {
    "reproduce": "the paper's steps",
    "verify": "the stored comparison's",
    "controllers": "lists only",
    "disturbances": "no motion is integrated",
    "hard-cases": "every integrator at steps of its own",
    "accuracy": "lists of both, as it compares them",
    "ardupilot": "the autopilot's frame, in steps of at most 10 ms",
    "ros2": "by --env-kwargs, as part of the environment that both nodes compare",
    **dict.fromkeys(("list", "show", "template", "estimate", "compose", "import", "export"), "no motion is integrated"),
}


def commands() -> dict[str, Any]:
    """All commands by name, those of `scenes` and the script tune.py among them."""
    path = Path(__file__).parents[2] / "training/tune.py"
    sys.path.insert(0, str(path.parent))
    try:
        tune = runpy.run_path(str(path))["app"]
    finally:
        sys.path.remove(str(path.parent))
    found: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    return {**found, **found["scenes"].commands, "tune": typer.main.get_command(tune)}


def test_every_command_that_simulates_has_options_in_place_of_the_scenes_integration() -> None:
    pytest.importorskip("cma")
    pytest.importorskip("torch")
    found = commands()
    del found["scenes"]
    assert WITHOUT.keys() < found.keys() and len(found) == 24
    for name, command in found.items():
        options = {option: parameter for parameter in command.params for option in parameter.opts}
        given = {option: options.get(option) for option in ("--integrator", "--dt")}
        if name in WITHOUT:
            assert name == "accuracy" or not any(given.values()), name
            continue
        assert all(option is not None and option.default is None for option in given.values()), name
        assert given["--integrator"].help == "Integrator. [default: the scene's, or mk4]"
        assert "the scene's" in given["--dt"].help, name


def written(scene: str, path: Path, **integration: Any) -> str:
    """File of a scene that states integrator and step."""
    path.write_text(uvms_gym.dump_scene({**uvms_gym.load_scene(scene), "integration": integration}))
    return str(path)


class Made(Exception):
    """A simulator or an environment was made."""


@pytest.mark.parametrize(
    ("command", "period"),
    [
        ("play --plot x.png --seconds 0.1 --scene SCENE", 0.05),
        ("play --plot x.png --seconds 0.1 --env UVMS-EETrack-Storm-v0 --scene SCENE", 0.1),
        ("compare --controller pd --episodes 2 --out out --scene SCENE", 0.1),
        ("train --env UVMS-StationKeep-v0 --env-kwargs scene:SCENE --algo ppo -n 100", 0.05),
        ("train --env UVMS-EETrack-Storm-v0 --env-kwargs scene:SCENE --algo shac -n 100", 0.1),
    ],
)
def test_environments_of_commands_follow_the_scene_and_options_override_it(
    command: str, period: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if command.startswith("train"):
        pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    written("bluerov2-heavy-alpha5", tmp_path / "mine.toml", integrator="ros2", step=0.005)
    seen: list[tuple[Any, float]] = []

    def native(options: Any, **given: Any) -> Any:
        made = make(options, **given)
        # (The control period is asked of the environment in its own scene.)
        if options.scene == TaskOptions.scene:
            return made
        seen.append((made.snapshot(), made.control_period))
        raise Made

    make = base.native
    monkeypatch.setattr(base, "native", native)
    for extra, (integrator, dt) in (
        ("", ("ros2", 0.005)),
        ("--integrator mk3", ("mk3", 0.005)),
        ("--dt 0.025", ("ros2", 0.025)),
        ("--integrator ros3 --dt 0.001", ("ros3", 0.001)),
    ):
        # Tracking has half the scene's step.
        dt = 0.5 * dt if "EETrack" in command and "--dt" not in extra else dt
        with pytest.raises(Made):
            main([*command.replace("SCENE", "mine.toml").split(), *extra.split()])
        simulator, found = seen.pop()
        assert (simulator.integrator, simulator.dt, found) == (integrator, pytest.approx(dt), pytest.approx(period))
        assert not seen


@pytest.mark.parametrize(
    ("extra", "expected"),
    [
        ("", ("ros2", 0.004)),
        ("--integrator mk3", ("mk3", 0.004)),
        ("--dt 0.02", ("ros2", 0.02)),
        ("--integrator ros3 --dt 0.001", ("ros3", 0.001)),
    ],
)
def test_simulators_of_commands_follow_the_scene_and_options_override_it(
    extra: str, expected: tuple[str, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    pool = Path(__file__).parents[1] / "data/pool"
    written(str(pool / "start.toml"), tmp_path / "mine.toml", integrator="ros2", step=0.004)
    logs = f"mine.toml {pool} --map {pool}/map.toml"
    made: list[tuple[str, float]] = []

    def simulator(*arguments: Any, **options: Any) -> Any:
        found = Simulator(*arguments, **options)
        if "replay" in patched and "prescribed_joints" not in options:
            return found  # It has names and balance, and no steps.
        made.append((found.integrator, found.dt))
        raise Made

    def errors(motion: Any, terms: Any, step: float) -> Any:
        made.append((Simulator(motion.scene).integrator, step))
        raise Made

    for patched, replacement, command in (
        ("uvms_gym.Simulator", simulator, "scenes check mine.toml"),
        ("uvms_gym.studies.speed.physics.Simulator", simulator, "bench --quick --scene mine.toml"),
        ("uvms_gym.identification.replay.Simulator", simulator, f"validate {logs}"),
        ("uvms_gym.identification.replay.Simulator", simulator, f"fit {logs} --free vehicle.body.mass --out f.toml"),
        ("uvms_gym.studies.terms.ablation.trajectory_errors", errors, "scenes explain mine.toml --episodes 2"),
    ):
        made.clear()
        with monkeypatch.context() as patch, pytest.raises(Made):
            patch.setattr(patched, replacement)
            main([*command.split(), *extra.split()])
        assert made == [(expected[0], pytest.approx(expected[1]))], command
