"""Commands refuse bad input before they make anything, in one line with place, value and what is allowed."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest
from helpers import SMALL

import uvms_gym
from uvms_gym.cli import main

URDF = Path(__file__).parents[1] / "golden/alpha5.urdf"
OWN = """
import uvms_gym

class Own:
    def __init__(self, env):
        self.pid = uvms_gym.make_controller("pid", env)

    def predict(self, observation, *_, **__):
        return observation, None

class Broken(Own):
    def predict(self, *_, **__):
        return missing
"""
#: Commands, and what their line says.
REFUSED = [
    ("juggle", "juggle"),
    ("reproduce --out own.py", "own.py"),
    ("reproduce --out /proc/uvms", "/proc/uvms"),
    ("reproduce --out . --json /", "folder"),
    ("verify no/such/file.json", "no/such/file.json"),
    ("fit s.toml l --map m.toml --free x --out f.txt", "--out is 'f.txt', but must end in .toml"),
    ("hard-cases --case frobnicate", "no hard case has 'frobnicate' in its name; known: free spin"),
    ("disturbances hurricane", "thruster-loss"),
    # Scenes
    ("scenes show", "Missing argument"),
    ("scenes show none.toml", "none.toml: No such file or directory"),
    ("scenes check no/such/file.toml", "no/such/file.toml"),
    ("scenes check heavy.toml", "heavy.toml: vehicle.body.mass: is -1.0, but must be > 0"),
    ("scenes check rexrov --speed -1", "--speed"),
    ("scenes check rexrov --speed nan", "--speed"),
    ("scenes check rexrov --speed inf", "--speed"),
    ("scenes check rexrov --speed fast", "--speed"),
    ("scenes template --out /", "exists: give another"),
    ("scenes template --out own.py", "--force"),
    ("scenes estimate", "either a file of shapes"),
    ("scenes estimate nowhere.toml", "nowhere.toml"),
    ("scenes estimate --box 1,2", '--box "1,2" needs 3 dimensions'),
    ("scenes estimate --box 1,2,z", "needs 3 dimensions"),
    ("scenes estimate --box 1,2,3 --box -1,2,3", "--box -1,2,3: is -1.0, but must be between"),
    ("scenes estimate --box 1,1,1 --perforation 0.9", "--perforation: is 0.9"),
    ("scenes estimate --box 1,1,1 --speed fast", '--speed "fast"'),
    ("scenes estimate --cylinder 1,two", "--cylinder"),
    ("scenes estimate --cylinder 1,2@3", "3 or 6 numbers after the @"),
    ("scenes import nowhere.urdf", "nowhere.urdf"),
    ("scenes import own.toml", "own.toml: is a TOML file: a scene needs no import; URDF"),
    (f"scenes import {__file__}", "test_command_errors.py: is no XML; URDF"),
    (f"scenes import {URDF} --mount 1,2", "mount must be 6 numbers"),
    (f"scenes import {URDF} --tip hand", 'no link "hand"'),
    ("scenes explain no-such-scene", "no-such-scene"),
    ("scenes explain no/such/file.toml", "no/such/file.toml"),
    ("scenes explain rexrov --episodes 0", "--episodes is 0"),
    ("scenes explain rexrov --seed -1", "--seed is -1"),
    ("scenes explain rexrov --json /", "folder"),
    ("scenes explain rexrov --json /proc/uvms/explain.json", "/proc/uvms"),
    # Episodes
    ("play --seed -1", "--seed is -1, but must be at least 0"),
    ("play --env Foo --plot x.png", "unknown environment 'Foo'; known: UVMS-"),
    ("play --out x.png --env CartPole-v1", "CartPole-v1"),
    ("play --out x.png --scene nowhere", "nowhere"),
    ("play --out x.png --seconds -1", "--seconds is -1.0"),
    ("play --out x.png --window", "--out goes without --window"),
    ("play --out x.png --controller joystick", "unknown controller 'joystick'; known: none, pd"),
    ("play --out x.png --controller mlp:no-such-file", "cannot read no-such-file"),
    ("play --out x.png --controller mlp:", "controller 'mlp:' names no file, but must be mlp:FILE"),
    ("controllers --scene nope", "nope"),
    ("controllers mlp:x", "NAME is 'mlp:x', but must be FAMILY or FAMILY/SETTING"),
    ("play --out /proc/no/x.png --seconds 0.1", "cannot make the folder"),
    ("play --out x.avi", "must end in .mp4, .gif, .png"),
    ("play --plot x.jpg", "must end in .png"),
    ("play --out x.gif --size 640", "--size is '640', but must be WIDTHxHEIGHT, such as 960x720"),
    ("play --out x.gif --size 641x480", "--size is '641x480', but must be even numbers, 160x120 to 3840x2160"),
    ("play --out x.gif --size 64000x480", "160x120 to 3840x2160"),
    ("play --out x.mp4 --fps 0", "--fps is 0.0, but must be 1 to 60"),
    ("play --out x.mp4 --fps nan", "--fps is nan"),
    ("play --out x.png --camera up", "--camera is 'up', but must be AZIMUTH,ELEVATION or"),
    ("play --out x.png --camera 0,90", "elevation of --camera is 90.0, but must be -85 to 85"),
    ("play --out x.png --camera 0,0,-1", "distance of --camera is -1.0"),
    ("play --plot x.png --fps 10", "--size, --fps and --camera go with --out or --window"),
    ("play --web --size 640x480", "--web goes without --out, --window, --size, --fps, --camera, --plot and --mcap"),
    ("play --web --out x.png", "--web goes without"),
    ("play --web --port 0", "--port is 0, but must be 1 to 65535"),
    ("play --web --disturbance typhoon", "typhoon"),
    (f"play --web --seed {2**64}", "seed is 18446744073709551616, but must be 0 to 18446744073709551615"),
    ("play --web --controller joystick", "unknown controller 'joystick'"),
    # Comparisons
    ("compare --wrong", "--wrong"),
    ("compare --scene no-such-scene", "no-such-scene"),
    ("compare --scene free-body", "free-body"),
    ("compare --scene rexrov --scene rexrov", "scene 'rexrov' is given twice"),
    ("compare --controller none --controller magic", "'magic'"),
    ("compare --controller pd --controller pd", "pd"),
    ("compare --controller resolved", "controller 'resolved' is not for UVMS-StationKeep; for it: none, pd"),
    (
        f"compare --scene {SMALL} --controller pd --controller ppo",
        f"no policy ppo is there for UVMS-StationKeep, scene {SMALL}",
    ),
    ("compare --condition moon", "there is no condition 'moon'; known: design, lag"),
    ("compare --disturbance tsunami", "there is no disturbance 'tsunami'; known: calm"),
    ("compare --env UVMS-StationKep-v0", "unknown environment 'UVMS-StationKep-v0'; known: UVMS-"),
    ("compare --env CartPole-v1", "'CartPole-v1' is no environment of uvms_gym"),
    ("compare --episodes 0", "--episodes is 0"),
    ("compare --episodes 1", "--episodes is 1"),
    ("compare --episodes 100001", "--episodes is 100001, but must be 2 to 100000"),
    ("compare --episodes many", "--episodes"),
    ("compare --seed -1", "--seed is -1"),
    ("compare --current -0.1", "--current is -0.1"),
    ("compare --current nan", "--current is nan"),
    ("compare --current 1e300", "--current is 1e+300"),
    ("compare --action sails", "sails"),
    ("compare --out own.py/deeper", "own.py"),
    # Accuracy
    ("accuracy --out /proc/uvms", "/proc/uvms"),
    ("accuracy --scene no-such", "no-such"),
    ("accuracy --scene rexrov --scene rexrov", "scene 'rexrov' is given twice"),
    ("accuracy --integrator magic", "unknown integrator 'magic'; known: mk4,"),
    ("accuracy --step 0", "--step is 0.0, but must be"),
    ("accuracy --step -0.01", "--step is -0.01, but must be"),
    ("accuracy --step nan", "--step is nan, but must be"),
    ("accuracy --step 0.2", "--step is 0.2, but must be"),
    ("accuracy --step 0.03", "--step is 0.03, but must divide the control period of 0.1 s"),
    ("accuracy --tolerance 0", "--tolerance is 0.0, but must be"),
    ("accuracy --tolerance nan", "--tolerance is nan, but must be"),
    ("accuracy --time 0", "--time is 0.0, but must be"),
    ("accuracy --time inf", "--time is inf, but must be"),
    ("accuracy --time 1.05", "--time is 1.05, but must be a multiple of the control period of 0.1 s"),
    ("accuracy --episodes 1", "--episodes is 1, but must be"),
    ("accuracy --seed -1", "--seed is -1, but must be"),
    ("accuracy --dt 0.01", "--dt needs --env"),
    ("accuracy --env UVMS-Nothing-v0", "unknown environment 'UVMS-Nothing-v0'; known: UVMS-StationKeep-v0,"),
    ("accuracy --env CartPole-v1", "unknown environment 'CartPole-v1'"),
    ("accuracy --env UVMS-Dock-v0 --env UVMS-Dock-v0", "env 'UVMS-Dock-v0' is given twice"),
    ("accuracy --env UVMS-Dock-v0 --dt 0.03", "--dt is 0.03, but must divide the control period of 0.05 s"),
    ("accuracy --env UVMS-Dock-v0 --dt 0", "--dt is 0.0, but must be"),
    ("accuracy --env UVMS-Dock-v0 --dt nan", "--dt is nan, but must be"),
    ("accuracy --env UVMS-Dock-v0 --dtype float16", "unknown dtype 'float16'; known: float64, float32"),
    ("accuracy --env UVMS-Dock-v0 --integrator magic", "unknown integrator 'magic'; known: mk4,"),
    ("accuracy --env UVMS-Dock-v0 --episodes 1", "--episodes is 1, but must be"),
    ("accuracy --env UVMS-Dock-v0 --scene /no/such.toml", "/no/such.toml"),
    ("accuracy --env UVMS-EETrack-v0 --scene free-body", "UVMS-EETrack-v0, free-body: "),
    ("accuracy --env UVMS-Dock-v0 --step 0.01", "--step is not for --env, which has --dt"),
    ("accuracy --env UVMS-Dock-v0 --quick", "--quick is not for --env"),
    # Speed
    ("bench --scene no-such", "no-such"),
    ("bench --scene rexrov --scene rexrov", "scene 'rexrov' is given twice"),
    ("bench --n 0", "--n is 0, but must be 1 to"),
    ("bench --n -4", "--n is -4, but must be 1 to"),
    ("bench --n 1 --n many", "'--n': 'many' is not a whole number"),
    ("bench --n 1000000000", "--n is 1000000000, but must be"),
    ("bench --threads 0", "--threads is 0, but must be"),
    ("bench --threads 1.5", "'--threads': '1.5' is not a whole number"),
    ("bench --substeps 0", "--substeps is 0, but must be"),
    ("bench --dtype float16", "--dtype is 'float16', but must be float64 or float32"),
    ("bench --instruction-set sails", 'UVMS_INSTRUCTION_SET="sails"'),
    ("bench --integrator magic", "unknown integrator 'magic'; known: mk4,"),
    ("bench --repeats 0", "--repeats is 0, but must be"),
    ("bench --seed -1", "--seed is -1, but must be"),
    ("bench --scene free-body --env", "free-body: no scene has thrusters"),
    ("bench --scene free-body --sb3", "free-body: no scene has thrusters"),
    ("bench --out own.py", "own.py"),
]
#: Environments and controllers of one's own, of `play` and `compare` alike.
ENV = f"--env UVMS-StationKeep-v0 --env-kwargs scene:{SMALL}"
REFUSED += [
    (f"{command} {arguments}", words)
    for command in ("play --plot x.png --seconds 0.2", "compare --episodes 2 --out out")
    for arguments, words in [
        ("--env-kwargs substeps", "--env-kwargs: 'substeps' is not KEY:VALUE"),
        ("--env-kwargs substeps:5 --env-kwargs substeps:6", "--env-kwargs: substeps is given twice"),
        ("--env-kwargs scene:rexrov --scene rexrov", "scene is given twice: by --env-kwargs scene:rexrov"),
        ("--env-kwargs wind:5", "unexpected keyword argument 'wind'; known: scene, action"),
        ("--env-kwargs substeps:0", "substeps is 0, but must be at least 1"),
        ("--env-kwargs scene:nowhere", "nowhere"),
        ("--env-kwargs scene:{}", "scene is {}, but must be the name of a scene or of a TOML file"),
        (f"{ENV} --controller py:own.py", "controller 'py:own.py' must be py:FILE.py:NAME"),
        (f"{ENV} --controller py:none.py:Own", "cannot read none.py: No such file or directory"),
        (f"{ENV} --controller py:own.py:Own", "shape"),
        (f"{ENV} --controller py:own.py:Other", "AttributeError: module 'uvms_gym.studies.comparison.own.own' has no"),
        (f"{ENV} --controller py:own.py:uvms_gym.PD", "has no attribute 'uvms_gym.PD'"),
        (f"{ENV} --controller py:own.py:str", "has no attribute 'str'"),
        (f"{ENV} --controller py:own.py:Broken", "own.py:13: NameError: name 'missing' is not defined"),
        (f"{ENV} --controller py:text.py:Own", "text.py:1: SyntaxError: "),
    ]
]
TRAINING = [
    ("--env UVMS-Nothing-v0", "UVMS-Nothing"),
    ("--env CartPole-v1", "no hyperparameters for CartPole-v1"),
    ("-n 0", "--n-timesteps is 0"),
    ("--algo ppo --n-envs 0", "n_envs is 0"),
    ("--n-envs 8", "--n-envs is for --algo ppo or distill or asymmetric-ppo or shac"),
    ("-params gamma:0.9", "--hyperparams is for --algo ppo or distill"),
    ("--base pd", "--base is for --algo ppo"),
    ("--num-threads 0", "--num-threads is 0"),
    ("--seed -1", "--seed is -1"),
    ("--residual 0.3", "--residual is for --base"),
    ("--algo ppo --base fuzzy", "unknown controller 'fuzzy'"),
    ("--algo ppo --base pd --residual 2", "--residual is 2"),
    ("--algo ppo -params gamma", "'gamma' is not KEY:VALUE"),
    ("--algo ppo -params gama:0.9", "gama"),
    ("--algo ppo -params 'policy_kwargs:dict(net'", "policy_kwargs"),
    ("--algo ppo -params batch_size:1", "batch_size"),
    ("--env-kwargs wind:1", "wind"),
    ("--env-kwargs scene:nowhere", "nowhere"),
    ("--conf-file /nonexistent.yml", "cannot read /nonexistent.yml"),
    ("--conf-file own.py", "own.py"),
    ("-i /nonexistent", "cannot read /nonexistent"),
    ("-i . --seed 1", "--seed cannot be given with --trained-agent"),
    ("--export policy.zip", ".safetensors"),
    ("--algo ppo --device abacus", "abacus"),
    ("-f /proc/nowhere", "cannot make the folder"),
    ("--teacher pd", "--teacher is for --algo distill"),
    ("--algo sac", "sac"),
    ("--algo distill --base pd", "--base is for --algo ppo"),
    ("--algo distill --start x.safetensors", "--start is for --algo asymmetric-ppo or shac"),
    ("--algo distill --device cpu", "--device is for --algo ppo"),
    ("--algo distill --teacher fuzzy", "unknown controller 'fuzzy'"),
    ("--algo distill --teacher resolved", "controller 'resolved' is not for UVMS-StationKeep"),
    ("--algo distill --teacher ppo", "teacher is 'ppo', but must be mlp:FILE or classical: "),
    ("--algo distill -params gama:1", "unknown hyperparameter 'gama'"),
    ("--algo distill -params n_updates:0", "n_updates is 0"),
    ("--algo distill -params net_arch:big", "net_arch is 'big', but must be a list of layer sizes"),
    ("--algo asymmetric-ppo -params replicas:3", "replicas is 3, but must be even"),
    ("--algo asymmetric-ppo --start /nonexistent.safetensors", "/nonexistent.safetensors: No such file"),
    ("--algo asymmetric-ppo --env-kwargs wind:1", "wind"),
    ("--algo shac --env UVMS-Dock-Storm-v0", "no hyperparameters for UVMS-Dock-Storm-v0; known: UVMS-"),
]
CASES = [pytest.param(*row, id=row[0]) for row in REFUSED]
CASES += [pytest.param(f"train {row[0]}", row[1], id=row[0], marks=pytest.mark.learning) for row in TRAINING]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with files that are not what commands need."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "text.py").write_text("class")
    shipped = Path(uvms_gym.__file__).parent / "scenes/free-body.toml"
    (tmp_path / "heavy.toml").write_text(shipped.read_text().replace("\nmass = 1.0", "\nmass = -1.0"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("command", "words"), CASES)
def test_bad_input_is_one_line_before_anything_is_made(
    command: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "--web" in command and not find_spec("viser"):
        pytest.skip("viser is not installed")
    before = files(folder)
    assert main(shlex.split(command)) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("uvms: ") and words in line
    assert not re.search("os error|<dict>| inf ", line)
    assert captured.out == ""
    assert files(folder) == before


def files(folder: Path) -> dict[Path, bytes]:
    """Contents of all files in a folder but Python's own, and the settings of a comparison that may go on."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc")
    return {path: path.read_bytes() for path in found if path.parent.name != "unfinished"}
