"""What the environment layer adds to the physics of the same substeps, and what a learner makes of it."""

import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import performance
from numpy.typing import NDArray

from uvms_gym import Simulator
from uvms_gym.cli.bench.physics import THRUST, assert_finite
from uvms_gym.cli.bench.timing import Floats, Tick, Times, calls_per_sample, interleave, summary, timed
from uvms_gym.cli.common import fail

ENV = "UVMS-StationKeep-v0"
#: Physics steps per control step, the environments' default.
SUBSTEPS = 5
#: Batches of random actions that are drawn beforehand and taken in turn, half of them the negatives of the others.
DRAWN = 8
#: Control steps and physics steps of the single environment in one sample.
SINGLE_CALLS = 200
#: Time given to `benchmark_vector_step`, s.
VECTOR_SECONDS, QUICK_VECTOR_SECONDS = 2.0, 0.2


class VectorEnv:
    """A vector environment under random actions, its episodes out of step; a unit is one control step of an instance.

    Among N instances some end an episode and start the next at every step, as in a long run.
    """

    def __init__(self, scene: dict[str, Any], n: int, threads: int, dtype: str, seed: int) -> None:
        self.name, self.n = scene["name"], n
        options: dict[str, Any] = {"scene": scene, "substeps": SUBSTEPS, "threads": threads, "dtype": dtype}
        self.env: Any = gymnasium.make_vec(ENV, num_envs=n, **options)
        rng = np.random.default_rng(seed)
        self.actions = _actions(rng, self.env.action_space.shape or ())
        self.next = 0
        self.last: tuple[NDArray[Any], ...] = ()
        self.env.reset(seed=seed)
        _stagger(self.env, rng, self.step)
        self.calls = calls_per_sample(self.step)

    def step(self) -> None:
        """One control step of all instances."""
        self.last = self.env.step(self.actions[self.next % DRAWN])[:2]
        self.next += 1

    def sample(self) -> Times:
        """Time per control step and instance."""
        return timed(self.step, self.calls).per(self.n)

    def check(self) -> None:
        """Refuse what is not finite."""
        if not all(np.isfinite(part).all() for part in self.last):
            raise fail(f"{self.name}: an observation or reward is not finite, so its time means nothing")


class Physics:
    """The same substeps by the simulator alone, under inputs such as the environment gives it.

    A unit is `SUBSTEPS` steps of an instance; `substeps` are done per call.
    """

    def __init__(self, simulator: Simulator, substeps: int, seed: int) -> None:
        n = simulator.num_envs
        rng = np.random.default_rng(seed)
        self.simulator, self.substeps = simulator, substeps
        low, high = simulator.thruster_limits.T
        self.inputs: dict[str, Floats] = {"thrust": THRUST * rng.uniform(low, high, (n, simulator.num_thrusters))}
        if simulator.num_joints:
            # Cubics, of which all but the constant are next to nothing: they start anew with every call.
            cubic = np.zeros((n, simulator.num_joints, 4))
            cubic[..., 0], cubic[..., 1:] = simulator.q, 1e-6
            self.inputs["joint_target"] = cubic
        self.calls = calls_per_sample(self.step)

    def step(self) -> None:
        """One call."""
        self.simulator.step(**self.inputs, substeps=self.substeps)

    def sample(self) -> Times:
        """Time per `SUBSTEPS` steps and instance."""
        return timed(self.step, self.calls).per(self.simulator.num_envs * self.substeps / SUBSTEPS)

    def check(self) -> None:
        """Refuse a state that is not finite."""
        assert_finite(self.simulator.scene_name, self.simulator)


def vector_study(
    scene: dict[str, Any], n: int, threads: list[int], dtypes: list[str], repeats: int, seed: int, tick: Tick
) -> list[dict[str, Any]]:
    """Set the vector environment against the physics of the same substeps, interleaved.

    `physics` is `Simulator.step` as it is called, inputs handed over; `physics_alone` is what more substeps of it cost.
    """
    cases: dict[Any, Any] = {}
    for dtype in dtypes:
        for count in threads:
            case = VectorEnv(scene, n, count, dtype, seed)
            cases[dtype, count, "env"] = case
            for name, substeps in (("once", SUBSTEPS), ("twice", 2 * SUBSTEPS)):
                cases[dtype, count, name] = Physics(case.env.unwrapped.simulator, substeps, seed)
    samples = interleave(cases, repeats, tick)
    rows = []
    for dtype in dtypes:
        for count in threads:
            times = samples[dtype, count, "env"]
            spent, once, twice = (samples[dtype, count, name].fair(count) for name in ("env", "once", "twice"))
            # A call of twice the substeps hands over its inputs once.
            alone = 2.0 * twice - once
            rows.append(
                {
                    "scene": scene["name"],
                    "n": n,
                    "threads": count,
                    "dtype": dtype,
                    "substeps": SUBSTEPS,
                    "env": summary(spent),
                    "physics": summary(once),
                    "physics_alone": summary(alone),
                    "percent": summary(100.0 * (spent / once - 1.0)),
                    "percent_of_alone": summary(100.0 * (spent / alone - 1.0)),
                    "samples": times,
                }
            )
    return rows


def single_study(scene: dict[str, Any], dtype: str, repeats: int, seed: int, tick: Tick) -> dict[str, Any]:
    """Time single calls of `gymnasium.make(...).step`, wrappers and all, and of the physics of the same substeps."""
    env = gymnasium.make(ENV, scene=scene, substeps=SUBSTEPS, dtype=dtype)
    rng = np.random.default_rng(seed)
    actions = _actions(rng, env.action_space.shape or ())
    env.reset(seed=seed)
    physics = [Physics(env.unwrapped.simulator, substeps, seed) for substeps in (SUBSTEPS, 2 * SUBSTEPS)]  # type: ignore[attr-defined]

    def steps() -> list[float]:
        spent = []
        for k in range(SINGLE_CALLS):
            begun = time.perf_counter()
            _, _, terminated, truncated, _ = env.step(actions[k % DRAWN])
            spent.append(time.perf_counter() - begun)
            if terminated or truncated:
                env.reset()
        return spent

    def calls(case: Physics) -> list[float]:
        return [timed(case.step, 1).wall for _ in range(SINGLE_CALLS)]

    medians = []
    for _ in range(repeats + 1):
        medians.append([float(np.median(x)) for x in (steps(), *(calls(case) for case in physics))])
        for case in physics:
            case.check()
        tick()
    of_env, once, twice = np.array(medians[1:]).T
    return {
        "scene": scene["name"],
        "dtype": dtype,
        "substeps": SUBSTEPS,
        "env": summary(of_env),
        "physics": summary(once),
        "physics_alone": summary(twice - once),
        "above": summary(of_env - once),
        "above_alone": summary(of_env - (twice - once)),
    }


def gymnasium_study(scene: dict[str, Any], n: int, threads: int, seconds: float, seed: int) -> float | None:
    """Control steps per second by Gymnasium's own benchmark, which draws its actions as it goes; None before 1.4."""
    if not hasattr(performance, "benchmark_vector_step"):
        return None
    env = gymnasium.make_vec(ENV, num_envs=n, scene=scene, substeps=SUBSTEPS, threads=threads)
    try:
        return float(performance.benchmark_vector_step(env, target_duration=seconds, seed=seed))  # type: ignore[arg-type]
    finally:
        env.close()


def _actions(rng: np.random.Generator, shape: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """Actions whose mean is zero, so that no vehicle is driven away and every episode has its length."""
    half = [rng.uniform(-1.0, 1.0, shape).astype(np.float32) for _ in range(DRAWN // 2)]
    return [action for drawn in half for action in (drawn, -drawn)]


def _stagger(env: Any, rng: np.random.Generator, step: Any) -> None:
    """Run an episode's length, and start each instance anew at a step of its own on the way."""
    length = gymnasium.spec(ENV).max_episode_steps or 1
    at = rng.integers(length, size=env.num_envs)
    for k in range(length):
        step()
        if (mask := at == k).any():
            env.reset(options={"reset_mask": mask})
