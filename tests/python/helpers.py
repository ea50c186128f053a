"""Shared by the tests."""

import copy
import importlib.util
import itertools
import socket
import sys
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import uvms_gym
from uvms_gym import MLP, PD, PID, Simulator, _scene, load_scene
from uvms_gym.controllers import NoControl

PARTS = ("position", "rotation", "quaternion", "twist", "q", "qd", "time", "current", "current_acceleration", "thrust")


def state_of(simulator: Simulator) -> dict[str, np.ndarray]:
    """All parts of the state."""
    return {part: getattr(simulator, part) for part in PARTS}


def assert_same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
    """Bit for bit the same arrays."""
    assert a.keys() == b.keys()
    for name in a:
        assert a[name].tobytes() == b[name].tobytes(), name


@contextmanager
def unchanged(simulator: Simulator) -> Iterator[None]:
    """Check that a simulator leaves the block in the state in which it entered."""
    before = state_of(simulator)
    yield
    assert_same(state_of(simulator), before)


def is_fixed(simulator: Simulator) -> bool:
    """True if the scene holds the vehicle."""
    return bool(simulator.scene["vehicle"]["fixed"])


def random_state(simulator: Simulator, seed: int = 0) -> dict[str, np.ndarray]:
    """A state in which everything moves, one row per instance; row i is the same whatever the number of instances."""
    rows = []
    held, n, home = is_fixed(simulator), simulator.num_joints, simulator.q
    for i in range(simulator.num_envs):
        rng = np.random.default_rng((seed, i))
        rows.append(
            {
                "position": rng.normal(size=3),
                "quaternion": rng.normal(size=4),
                "twist": np.zeros(6) if held else 0.5 * rng.normal(size=6),
                "q": home[i] + 0.3 * rng.normal(size=n),
                "qd": 0.5 * rng.normal(size=n),
                "current": 0.3 * rng.normal(size=3),
                "current_acceleration": 0.1 * rng.normal(size=3) * bool(np.any(simulator.scene["water"]["gravity"])),
            }
        )
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def random_inputs(simulator: Simulator, seed: int = 0) -> dict[str, Any]:
    """Every input that the scene takes, one row per instance."""
    rows = []
    has_servo = simulator.scene["vehicle"].get("servo") is not None
    n, now = simulator.num_joints, simulator.q
    for i in range(simulator.num_envs):
        rng = np.random.default_rng((seed, i, 1))
        row = {
            "thrust": 20.0 * rng.normal(size=simulator.num_thrusters),
            "wrench": 5.0 * rng.normal(size=6),
            "joint_torque": 0.1 * rng.normal(size=n),
            "external": 0.01 * rng.normal(size=(n + 1, 6)),
        }
        if n:
            row["joint_target"] = now[i][:, None] * [1.0, 0.0, 0.0] + 0.1 * rng.normal(size=(n, 3))
        if has_servo:
            pose = np.eye(4)
            pose[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            pose[:3, 0] *= np.linalg.det(pose[:3, :3])
            pose[:3, 3] = rng.normal(size=3)
            row["pose_target"] = pose
        rows.append(row)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def moving(scene: str | dict[str, Any], num_envs: int = 3, seed: int = 0, **options: Any) -> Simulator:
    """A simulator in a random state."""
    simulator = Simulator(scene, num_envs, **options)
    simulator.set_state(**random_state(simulator, seed))
    return simulator


def bodies(scene: dict[str, Any]) -> list[dict[str, Any]]:
    """Every body of a scene."""
    return [body for _, body in _scene.bodies(scene)]


def fixed_base() -> dict[str, Any]:
    """The arm of petasus-pum on a vehicle that is held."""
    scene = copy.deepcopy(load_scene("petasus-pum"))
    scene["vehicle"]["fixed"] = True
    return scene


def lagging(lag: float = 0.1, **keys: Any) -> dict[str, Any]:
    """A vehicle whose thrusters follow their commands with a lag (s), and have these keys."""
    scene = copy.deepcopy(load_scene("bluerov2-heavy"))
    scene["vehicle"]["thruster_lag"] = lag
    for thruster in scene["vehicle"]["thrusters"]:
        thruster.update(keys)
    return scene


#: At the edge of the bounds and on the way out: the episode ends by divergence soon.
LEAVING = {"position": [9.9, 0.0, 0.0], "attitude": [1.0, 0.0, 0.0, 0.0], "twist": [4.0, 0.0, 0.0, 0.0, 0.0, 0.0]}


def same(a: Any, b: Any) -> bool:
    """Equal bit for bit, types and all."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        if a.dtype == object:
            return b.dtype == object and a.shape == b.shape and all(map(same, a.tolist(), b.tolist()))
        return (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    return type(a) is type(b) and a == b


def assert_apart(arrays: list[np.ndarray]) -> None:
    """No two of these contiguous arrays share memory."""
    assert all(array.flags.forc for array in arrays)
    spans = sorted((array.ctypes.data, array.ctypes.data + array.nbytes) for array in arrays)
    assert all(end <= start for (_, end), (start, _) in itertools.pairwise(spans))


def arrays_of(result: tuple[Any, ...]) -> list[np.ndarray]:
    """Arrays of a result of `reset` or `step`, with the ones in its infos."""
    return [value for value in [*result[:-1], *result[-1].values()] if isinstance(value, np.ndarray)]


def assert_parity(
    envs: Any,
    single: Callable[[], Any],
    steps: int,
    reset: Callable[[int, Any, Any], None] = lambda step, envs, sync: None,
    maximum: float = 1.0,
) -> None:
    """Check that `envs` gives the numbers of a SyncVectorEnv of what `single` makes, bit for bit, in arrays of its own.

    Actions are random up to `maximum`, `reset` may reset both before a step, and episodes have to end within `steps`.
    """
    mode = envs.metadata["autoreset_mode"]
    sync = SyncVectorEnv([single] * envs.num_envs, autoreset_mode=mode)
    assert envs.observation_space == sync.observation_space
    assert envs.action_space == sync.action_space
    got, expected = envs.reset(seed=3), sync.reset(seed=3)
    assert same(got, expected)
    results, ends = [got], 0
    for step in range(steps):
        reset(step, envs, sync)
        actions = other_than(step, envs, maximum)
        got, expected = envs.step(actions), sync.step(actions)
        assert same(got, expected), step
        assert envs.observation_space.contains(got[0])
        results.append(got)
        over = got[2] | got[3]
        ends += over.any()
        if mode is AutoresetMode.DISABLED and over.any():
            options = {"reset_mask": over}
            assert same(envs.reset(options=options), sync.reset(options={"reset_mask": over.copy()}))
            assert options["reset_mask"] is over
    assert ends > 1
    assert_apart([array for result in results for array in arrays_of(result)])
    for _ in range(2):
        envs.close()
    sync.close()


#: A scene without arm, and the layers of a network for it.
SMALL = "bluerov2-heavy"
SIZES = (24, 16, 8, 6)


def layers(sizes: tuple[int, ...] = SIZES, seed: int = 0) -> dict[str, Any]:
    """Weights and biases that look random."""
    rng = np.random.default_rng(seed)
    pairs = list(itertools.pairwise(sizes))
    return {
        "weights": [rng.normal(size=(b, a)) / np.sqrt(a) for a, b in pairs],
        "biases": [0.3 * rng.normal(size=b) for _, b in pairs],
    }


def observations(n: int, seed: int = 1, width: int = SIZES[0]) -> np.ndarray:
    """Rows that look random."""
    return np.random.default_rng(seed).normal(size=(n, width)).astype(np.float32)


def policy(**arguments: Any) -> MLP:
    """A network for the small scene."""
    return MLP(scene=SMALL, **(layers() | arguments))


def ship(folder: Path) -> Path:
    """Two policies for the small scene at 0.1 s, where the package would have them under `folder`."""
    place = folder / "UVMS-StationKeep" / SMALL / "0.1s"
    place.mkdir(parents=True)
    for seed in (0, 1):
        made = MLP(scene=SMALL, substeps=10, notes={"steps": "7"}, **layers((24, 6), seed))
        made.save(place / f"ppo-{seed}.safetensors")
    return place


def policies() -> list[Any]:
    """One controller of each kind, for the small scene."""
    return [NoControl(scene=SMALL), PD(scene=SMALL), PID(scene=SMALL), policy(mean=np.ones(24), variance=np.ones(24))]


def task_ids() -> list[str]:
    """Ids of all environments that the package registers."""
    return sorted(name for name in gymnasium.registry if name.startswith("UVMS-"))


def control_rate(task: str) -> float:
    """Control periods per second."""
    return 20.0 if gymnasium.spec(task).kwargs == {} else 10.0


def small(task: str) -> str:
    """A cheap scene; one with joints where they are acted on."""
    return "bluerov2-heavy-alpha5" if "EETrack" in task else SMALL


def make(task: str, n: int | None = None, **kwargs: Any) -> Any:
    """Environment with Gymnasium's wrappers, or a vector of `n`, of a cheap scene."""
    kwargs = {"scene": small(task), **kwargs}
    return gymnasium.make(task, **kwargs) if n is None else gymnasium.make_vec(task, n, **kwargs)


def idle(env: Any) -> np.ndarray:
    """Actions of 0."""
    return np.zeros(env.action_space.shape, dtype=np.float32)


def other_than(seed: int, env: Any, maximum: float = 0.1) -> np.ndarray:
    """Actions that look random, and hurl no arm about."""
    return np.random.default_rng(seed).uniform(-maximum, maximum, env.action_space.shape).astype(np.float32)


def scenes_with_thrusters() -> list[str]:
    """Shipped scenes that tasks take: those with thrusters for all six axes."""
    return [name for name in uvms_gym.scene_names() if Simulator(name).num_thrusters >= 6]


def run(env: Any, controller: Any, steps: int, seed: int | list[int] = 0) -> uvms_gym.rollouts.RolloutStats:
    """Statistics of a rollout from a fresh start."""
    env.reset(seed=seed)
    rollout = uvms_gym.Rollout(env, controller)
    rollout.run(steps)
    return rollout.pop_stats()


def choices(task: str, option: str) -> list[str]:
    """Names that an option of a task may have, by its annotation; [] if there is no such option."""
    annotation = get_type_hints(type(gymnasium.make(task).unwrapped.options)).get(option)  # type: ignore[attr-defined]
    parts = [annotation, *get_args(annotation)]
    return [name for part in parts if get_origin(part) is Literal for name in get_args(part)]


def module_of(file: Path) -> types.ModuleType:
    """Module of a file; specs of environments name it by module."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = sys.modules[file.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def free_port() -> int:
    """Port of this machine that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def fake_moviepy(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, tuple[int, ...], float]]:
    """Replace the package that Gymnasium writes videos with; number and shape of pictures, and rate, of each video."""
    clips = []

    class Clip:
        def __init__(self, frames: list[np.ndarray], fps: float) -> None:
            clips.append((len(frames), frames[0].shape, fps))

        def write_videofile(self, *_: Any, **__: Any) -> None:
            pass

        def close(self) -> None:
            pass

    names = ["moviepy", "moviepy.video", "moviepy.video.io", "moviepy.video.io.ImageSequenceClip"]
    for name in names:
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    sys.modules[names[-1]].ImageSequenceClip = Clip  # type: ignore[attr-defined]
    return clips
