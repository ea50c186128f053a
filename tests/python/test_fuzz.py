"""Mutated scenes and random calls: what is wrong is refused by a clear error; nothing panics, hangs or is harmed.

`UVMS_FUZZ=100000 pytest tests/python/test_fuzz.py -s` takes so many cases of each kind, new ones every time, and prints
how many were accepted and refused.
"""

import contextlib
import copy
import faulthandler
import inspect
import itertools
import os
import pickle
import random
import string
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import task_ids
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_scenes import ALL, JUNK, paths, set_at

import uvms_gym
from uvms_gym import SceneError, Simulator, controllers
from uvms_gym._task.arguments import RESET_OPTIONS

CASES = int(os.environ.get("UVMS_FUZZ", "0"))
SOAK = CASES > 0
#: A case that takes longer is a hang, s.
LONGEST = 120.0

FUZZ = settings(
    max_examples=CASES or 30,
    derandomize=not SOAK,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
SCENES = Path(uvms_gym.__file__).parent / "scenes"
TEXTS = [path.read_text() for path in sorted(SCENES.glob("*.toml"))]
URDF = (Path(__file__).parents[1] / "golden/alpha5.urdf").read_text()

stats: Counter[str] = Counter()


@pytest.fixture(autouse=True)
def counted(request: pytest.FixtureRequest) -> Iterator[None]:
    """Print what came of the cases."""
    stats.clear()
    yield
    faulthandler.cancel_dump_traceback_later()
    if SOAK:
        total = sum(stats.values())
        print(f"\n{request.node.name}: {total} cases: " + ", ".join(f"{n} {what}" for what, n in stats.most_common()))


@contextlib.contextmanager
def attempt(refusals: tuple[type[Exception], ...]) -> Iterator[None]:
    """One case: it passes, or is refused in clear words. All else, a panic above all, fails the test."""
    faulthandler.dump_traceback_later(LONGEST, exit=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except refusals as error:
        text = str(error)
        assert 0 < len(text) < 20000, text
        for leak in ("panicked", "unwrap()", ".rs:", "RUST_BACKTRACE"):
            assert leak not in text, text
        stats[f"refused by {type(error).__name__}"] += 1
    else:
        stats["accepted"] += 1


def simulated(scene: Any) -> None:
    simulator = Simulator(scene)
    simulator.step(substeps=2)
    simulator.energy()
    simulator.trim()
    uvms_gym.lint_scene(scene)
    assert uvms_gym.load_scene(uvms_gym.load_scene(scene)) == simulator.scene


@FUZZ
@given(data=st.data())
def test_a_mutated_dict_is_simulated_or_refused(data: st.DataObject) -> None:
    scene = copy.deepcopy(ALL[data.draw(st.sampled_from(sorted(ALL)))])
    numbers = st.sampled_from([0.0, -1.0, 1e-9, 1e9, -1e300, float("nan"), float("inf")])
    for _ in range(data.draw(st.integers(1, 4))):
        there = paths(scene)
        if not there:
            break
        path = data.draw(st.sampled_from(there))
        node = scene
        for key in path[:-1]:
            node = node[key]
        match data.draw(st.integers(0, 4)):
            case 0:
                set_at(scene, path, data.draw(JUNK))
            case 1:
                del node[path[-1]]
            case 2 if isinstance(node, list):
                node.append(copy.deepcopy(node[path[-1]]))
            case 3 if isinstance(node[path[-1]], float):
                node[path[-1]] *= data.draw(st.sampled_from([-1.0, 1e-3, 1e3, 1.1]))
            case _:
                set_at(scene, path, data.draw(numbers))
    with attempt((ValueError,)):
        simulated(scene)


def mutated(text: str, rng: random.Random) -> str:
    """Text with lines, words or characters lost, doubled, swapped or replaced."""
    for _ in range(rng.randint(1, 3)):
        lines = text.split("\n")
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        words = lines[i].split(" ")
        k = rng.randrange(len(words))
        at = rng.randrange(len(text) + 1)
        match rng.randrange(8):
            case 0:
                del lines[i]
            case 1:
                lines.insert(j, lines[i])
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
            case 3:
                words[k] = rng.choice(
                    ["-1", "0", "nan", "inf", "1e400", '"x"', "true", "[]", "{}", "[[1, 2]]", "1979-05-27"]
                )
                lines[i] = " ".join(words)
            case 4:
                del words[k]
                lines[i] = " ".join(words)
            case 5:
                lines = (text[:at] + rng.choice(string.printable + "é\u2028\0") + text[at:]).split("\n")
            case 6:
                lines = (text[:at] + text[at + rng.randint(1, 30) :]).split("\n")
            case 7:
                lines = text[:at].split("\n")
        text = "\n".join(lines)
    return text


def imported(path: Path) -> None:
    scene = uvms_gym.import_robot(path)
    assert uvms_gym.load_scene(scene) == scene


@pytest.mark.parametrize(
    ("texts", "use", "refusal"), [(TEXTS, simulated, ValueError), ([URDF], imported, SceneError)], ids=["toml", "urdf"]
)
@FUZZ
@given(seed=st.integers(0, 2**64))
def test_a_mutated_file_is_used_or_refused_by_its_name(
    texts: list[str], use: Callable[[Path], None], refusal: type[Exception], seed: int
) -> None:
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("mine.urdf" if use is imported else "mine.toml")
        path.write_text(mutated(rng.choice(texts), rng), encoding="utf-8", newline="")
        with attempt((refusal,)):
            try:
                use(path)
            except SceneError as error:
                assert str(path) in str(error), error
                raise


OUTLINE: dict[str, Any] = {
    "density": 1025.0,
    "speed": [0.1, 0.3],
    "shapes": [
        {"box": [0.4, 0.3, 0.2], "perforation": 0.2, "solidity": [0.9, 0.9, 0.8], "mass": 11.0},
        {"name": "pod", "capsule": {"radius": 0.05, "length": 0.3, "axis": "y"}, "position": [0.1, 0.0, 0.2]},
        {"cylinder": {"radius": 0.05, "length": 0.3}, "rpy": [0.1, 0.2, 0.3], "ends": "joined", "displaced": 0.5},
        {"ellipsoid": [0.3, 0.2, 0.1], "relative_density": 1.1},
    ],
}


@FUZZ
@given(data=st.data())
def test_a_mutated_outline_is_estimated_or_refused(data: st.DataObject) -> None:
    outline = copy.deepcopy(OUTLINE)
    scale = st.sampled_from([0.0, -1.0, 1e-7, 1e-5, 0.3, 1e5, 1e7, 1e300, float("nan")])
    for _ in range(data.draw(st.integers(1, 3))):
        set_at(outline, data.draw(st.sampled_from(paths(outline))), data.draw(scale | JUNK))
    with attempt((SceneError,)):
        body = uvms_gym.estimate(outline)["body"]
        numbers = [x for key in ("added_mass", "inertia") for x in np.ravel(body[key])]
        assert np.all(np.isfinite([*numbers, *np.ravel(body["damping"]["quadratic"])]))


def junk(rng: random.Random, sizes: tuple[int, ...]) -> Any:
    """An argument that is hardly ever right: wrong types and shapes, numbers that are none, huge and negative ones."""
    number = rng.choice([0.0, -0.0, 1.0, -1.0, 0.1, 1e-300, 1e12, -1e200, 1e308, float("nan"), float("inf")])
    match rng.randrange(14):
        case 0:
            return None
        case 1:
            return rng.choice([True, False])
        case 2:
            return rng.choice([0, 1, -1, 2, -(2**63), 2**63, 2**64, 2**200])
        case 3:
            return number
        case 4:
            return rng.choice(["", "mk4", "float32", "wrench", "\ud800", "a\0b", b"", b"mk4"])
        case 5:
            return [[1.0], [2.0, 3.0]]
        case 6:
            return rng.choice([{}, {"q": number}, {1: 2}, {"position": [number] * 3}, set(), object(), 1j, print])
        case 7:
            return rng.choice(
                [np.array([None, "x"], dtype=object), np.array(["a"]), np.zeros(3, "datetime64[s]"), np.full(6, 1j)]
            )
        case 8:
            return np.zeros(tuple(rng.randrange(4) for _ in range(rng.randrange(5))))
        case 9:
            return np.full(rng.choice(sizes), rng.choice([1, -1])).astype(rng.choice([np.int8, np.uint64, np.bool_]))
        case 10:
            with np.errstate(all="ignore"):
                return np.full((rng.choice(sizes), 3), number).astype(np.float32).T[::-1]
        case _:
            shape = (rng.choice(sizes),) if rng.random() < 0.5 else (2, rng.choice(sizes))
            values = np.random.default_rng(rng.randrange(2**32)).normal(size=shape)
            if values.size and rng.random() < 0.5:
                values.flat[rng.randrange(values.size)] = number
            with np.errstate(all="ignore"):
                return values.astype(rng.choice([np.float64, np.float32, ">f8", np.float16]))


#: Known keywords of methods by the name of the parameter that collects them.
KEYWORDS = {"inputs": tuple(uvms_gym.StepInputs.__annotations__), "factors": tuple(Simulator("free-body").parameters)}


def arguments(
    function: Callable[..., Any], rng: random.Random, sizes: tuple[int, ...]
) -> tuple[list[Any], dict[str, Any]]:
    """Random arguments; of those that a function has, save a few too many or too few."""
    positional, keywords, owner = [], {}, getattr(function, "__self__", None)
    parameters = dict(inspect.signature(function).parameters)
    last = next(reversed(parameters.values()), None)
    if last and last.kind is last.VAR_KEYWORD and last.name in KEYWORDS:
        parameters |= {name: inspect.Parameter(name, last.KEYWORD_ONLY) for name in KEYWORDS[last.name]}
    for name, parameter in parameters.items():
        if name == "self" or (name in KEYWORDS and rng.random() < 0.5):
            continue
        value = junk(rng, sizes)
        if name in ("substeps", "threads", "num_envs") and isinstance(value, int):
            # So many are not wrong, only long in coming.
            value = rng.choice([-1, 0, 1, 3, 2**70])
        if name == "options" and rng.random() < 0.7:
            value = {rng.choice([*RESET_OPTIONS, "reset_mask", "x"]): value}
        if name == "state" and hasattr(owner, "get_state") and rng.random() < 0.7:
            value = {**owner.get_state(), rng.choice(["physics", "episodes"]): value}
        if parameter.kind is parameter.VAR_KEYWORD:
            keywords["nonsense"] = value
        elif parameter.kind is parameter.KEYWORD_ONLY:
            if rng.random() < 0.4:
                keywords[name] = value
        elif parameter.default is parameter.empty or rng.random() < 0.4:
            positional.append(value)
        else:
            break
    if rng.random() < 0.05:
        positional.append(junk(rng, sizes))
    return positional, keywords


def members(thing: Any) -> tuple[list[str], list[str]]:
    """Names of methods and of the other attributes, without those that Python reserves."""
    names = [name for name in dir(type(thing)) if not name.startswith("_")]
    methods = [name for name in names if callable(getattr(type(thing), name))]
    return methods, [name for name in names if name not in methods]


#: Errors that a wrong argument may raise.
WRONG = (ValueError, TypeError, OverflowError, MemoryError, gymnasium.error.Error)


def random_calls(thing: Any, snapshot: Callable[[], bytes], rng: random.Random, names: list[str], count: int) -> None:
    """Call methods, and set attributes of a simulator, at random; a refusal leaves the state as it was, bit for bit."""
    simulator: Simulator = thing if isinstance(thing, Simulator) else thing.unwrapped.snapshot()
    sizes = (0, 1, 3, 4, 6, simulator.num_joints, simulator.num_thrusters, 6 + simulator.num_joints)
    attributes = members(thing)[1] if thing is simulator else []
    for _ in range(count):
        before = snapshot()
        refused = stats.total() - stats["accepted"]
        if attributes and rng.random() < 0.1:
            with attempt((*WRONG, AttributeError)):
                setattr(thing, rng.choice(attributes), junk(rng, sizes))
        else:
            function = getattr(thing, rng.choice(names))
            positional, keywords = arguments(function, rng, sizes)
            with attempt(WRONG):
                function(*positional, **keywords)
        if stats.total() - stats["accepted"] > refused:
            assert snapshot() == before


@pytest.mark.parametrize("name", uvms_gym.scene_names())
def test_random_calls_do_a_simulator_no_harm(name: str) -> None:
    rng = random.Random() if SOAK else random.Random(name)
    each = 40
    for _ in range(max(1, CASES // (each * len(uvms_gym.scene_names()))) if SOAK else 4):
        simulator = Simulator(name, 2, dt=0.005, dtype=rng.choice(["float64", "float32"]))
        methods, _ = members(simulator)
        random_calls(simulator, lambda s=simulator: pickle.dumps(s), rng, methods, each)
        # Whatever became of it, it can be set back and stepped.
        simulator.reset()
        simulator.scale_parameters(**{name: 0.0 if name == "payload" else 1.0 for name in simulator.parameters})
        simulator.step(substeps=1)
        assert np.all(np.isfinite(simulator.position))


IDS = task_ids()


@pytest.mark.parametrize("vector", [False, True])
@pytest.mark.parametrize("name", IDS)
def test_random_calls_do_an_environment_no_harm(name: str, vector: bool) -> None:
    rng = random.Random() if SOAK else random.Random(7)
    each = 40
    for _ in range(max(1, CASES // (2 * len(IDS) * each)) if SOAK else 2):
        options = {
            "scene": rng.choice(["petasus-pum", "bluerov2-heavy-alpha5"]),
            "action": rng.choice(["wrench", "thrusters"]),
        }
        if vector:
            env: Any = gymnasium.make_vec(name, num_envs=2, **options)
        else:
            env = gymnasium.make(name, **options).unwrapped
        fresh, _ = copy.deepcopy(env).reset(seed=2)
        if rng.random() < 0.9:
            env.reset(seed=1)
        calls = ["reset", "step", "set_state"]
        random_calls(env, lambda e=env: pickle.dumps(e.unwrapped.snapshot()), rng, calls, each)
        observations, _ = env.reset(seed=2)
        np.testing.assert_array_equal(observations, fresh)
        assert np.all(np.isfinite(env.step(env.action_space.sample() * 0)[0]))
        env.close()


@pytest.mark.parametrize("name", IDS)
def test_random_options_make_no_environment_or_one_that_keeps_its_space(name: str) -> None:
    rng = random.Random() if SOAK else random.Random(5)
    creator = gymnasium.envs.registration.load_env_creator(gymnasium.spec(name).entry_point)
    options = [option for option in inspect.signature(creator).parameters if option != "scene"]
    for _ in range(CASES // len(IDS) if SOAK else 60):
        given = {option: junk(rng, (1, 3, 6)) for option in rng.sample(options, rng.randint(1, 2))}
        for many in ("substeps", "threads"):
            if isinstance(given.get(many), int):
                given[many] = rng.choice([-1, 0, 1, 3, 2**70])
        with attempt(WRONG):
            env = creator(scene=rng.choice(["petasus-pum", "bluerov2-heavy"]), **given)
            observation, _ = env.reset(seed=0)
            assert env.observation_space.contains(observation), (given, observation)
            observation, reward, *_ = env.step(np.zeros(env.action_space.shape, np.float32))
            assert env.observation_space.contains(observation), (given, observation)
            assert np.isfinite(reward), given


def test_random_arguments_make_no_simulator() -> None:
    rng = random.Random() if SOAK else random.Random(11)
    for _ in range(CASES or 200):
        positional, keywords = arguments(Simulator, rng, (1, 3, 6))
        with attempt(WRONG):
            Simulator(rng.choice(["free-body", "rexrov", *positional[:1]]), *positional[1:], **keywords)


#: Controllers of each task.
CONTROLLERS = {
    "UVMS-StationKeep-v0": "NoControl PD PID PDRestoring DOB AdaptiveDOB ComputedTorque MPC NMPC".split(),
    "UVMS-EETrack-v0": "NoControl ResolvedMotion AdaptiveResolvedMotion NMPC".split(),
    "UVMS-Dock-v0": "NoControl DockPD".split(),
}


def extreme(rng: random.Random, shape: tuple[int, ...], largest: float) -> np.ndarray:
    """Finite numbers of usual size, with some that are extreme."""
    chance = np.random.default_rng(rng.randrange(2**32))
    values = chance.normal(size=shape)
    sizes = chance.choice([0.0, 1e-300, 1e-20, 1e3, 1e10, 1e15, 1e19, 1e25, 1e38, 1e100, 1e200, 1e300], size=shape)
    share = rng.choice([0.02, 0.3, 1.0])
    values = np.where(chance.random(shape) < share, np.copysign(sizes, values), values)
    return np.clip(values, -largest, largest)


def layers(rng: random.Random, inputs: int, outputs: int) -> dict[str, Any]:
    """Weights of a network."""
    sizes = [inputs, 4, outputs]
    return {
        "weights": [extreme(rng, (b, a), 3e38) for a, b in itertools.pairwise(sizes)],
        "biases": [extreme(rng, (b,), 3e38) for b in sizes[1:]],
        "activation": rng.choice(["tanh", "relu", "elu"]),
        "output": rng.choice(["clip", "tanh"]),
    }


@pytest.mark.parametrize("name", CONTROLLERS)
def test_finite_observations_give_actions_within_their_range(name: str) -> None:
    rng = random.Random() if SOAK else random.Random(name)
    envs = {
        scene: gymnasium.make_vec(name, num_envs=2, scene=scene, action=rng.choice(["wrench", "thrusters"]))
        for scene in ("petasus-pum", "bluerov2-heavy-alpha5")
    }
    for _ in range(CASES // len(CONTROLLERS) if SOAK else 40):
        env = rng.choice(list(envs.values()))
        usual, _ = env.reset(seed=0)
        kind = rng.choice([*CONTROLLERS[name], "MLP"])
        with attempt((ValueError,)):
            if kind == "MLP":
                controller: Any = controllers.MLP(env, **layers(rng, usual.shape[1], env.action_space.shape[1]))
            else:
                controller = getattr(controllers, kind)(env)
                for gain in rng.sample(sorted(controller.gains), min(len(controller.gains), rng.randrange(3))):
                    value = controller.gains[gain]
                    extremes = np.abs(extreme(rng, np.shape(value), 1e300))
                    given = int(min(extremes, 2e9)) if isinstance(value, int) else extremes.tolist()
                    controller = type(controller)(env, **controller.gains | {gain: given})
            state = None
            for _ in range(4):
                observations = np.where(rng.random() < 0.5, usual, extreme(rng, usual.shape, 3e38)).astype(np.float32)
                actions, state = controller.predict(observations, state, np.zeros(2, dtype=bool))
                assert np.all(np.abs(actions) <= 1.0), (kind, controller)


PLAN_INPUTS = ("thrust", "wrench", "joint_torque", "fin", "joint_target")


def test_extreme_problems_are_planned_or_refused() -> None:
    rng = random.Random() if SOAK else random.Random(13)
    for _ in range(CASES if SOAK else 60):
        simulator = Simulator(rng.choice(["petasus-pum", "bluerov2-heavy-alpha5", "remus-100"]), 2, dt=0.02)
        simulator.set_state(twist=extreme(rng, (6,), rng.choice([1.0, 1e300])))
        joints, widths = simulator.num_joints, (simulator.num_thrusters, 6, simulator.num_joints, simulator.num_fins)
        chosen = dict(zip(PLAN_INPUTS, (*widths, joints), strict=True))
        chosen = {name: width for name, width in chosen.items() if width and rng.random() < 0.5}
        rows = {"position": 3, "attitude": 3, "q": joints, "twist": 6, "qd": joints, "end_effector": 3}
        largest = rng.choice([10.0, 1e300])
        with attempt((ValueError,)), np.errstate(all="ignore"):
            found = uvms_gym.optimize_trajectory(
                simulator,
                horizon=rng.randint(1, 5),
                substeps=rng.randint(1, 3),
                weights={name: np.abs(extreme(rng, (width,), largest)) for name, width in rows.items()},
                input_weights={name: np.abs(extreme(rng, (width,), largest)) + 1e-9 for name, width in chosen.items()},
                references={"position": extreme(rng, (3,), largest)},
                bounds={name: (-(x := np.abs(extreme(rng, (w,), largest)) + 1e-9), x) for name, w in chosen.items()},
                initial={name: extreme(rng, (width,), largest) for name, width in chosen.items()},
                max_iterations=rng.randint(0, 5),
                tolerance=rng.choice([0.0, 1e-9, 1e300]),
            )
            assert np.all(np.isfinite(found.cost)) and np.all(np.isfinite(found.gains))


def test_extreme_states_and_inputs_have_derivatives_or_are_refused() -> None:
    rng = random.Random() if SOAK else random.Random(17)
    integrators = [entry["name"] for entry in uvms_gym.integrators()]
    for _ in range(CASES if SOAK else 60):
        with attempt((ValueError, MemoryError)), np.errstate(all="ignore"):
            simulator = Simulator(
                rng.choice(uvms_gym.scene_names()),
                rng.randint(1, 3),
                dt=10.0 ** rng.uniform(-6, 3),
                integrator=rng.choice(integrators),
                dtype=rng.choice(["float64", "float32"]),
            )
            m, n, k = simulator.num_thrusters, simulator.num_joints, simulator.num_fins
            largest = 1e300 if simulator.dtype == "float64" else 3e38
            parts = {"position": 3, "twist": 6, "q": n, "qd": n, "current": 3}
            if not simulator.scene["vehicle"].get("fixed", False):
                for name in rng.sample(sorted(parts), 2):
                    simulator.set_state(**{name: extreme(rng, (parts[name],), largest)})
            inputs = {"thrust": m, "wrench": 6, "joint_torque": n, "fin": k}
            given = {name: extreme(rng, (inputs[name],), largest) for name in rng.sample(sorted(inputs), 2)}
            given |= {"substeps": rng.randint(1, 3), "parameters": rng.sample(sorted(simulator.parameters), 2)}
            size = simulator.state_size
            simulator.step_jacobians(**given)
            simulator.step_jvp({"state": extreme(rng, (size,), largest)}, **given)
            simulator.step_vjp(extreme(rng, (size,), largest), **given)
            simulator.linearize(**{name: given[name] for name in given if name in inputs})
