"""Overhead of the environments over the physics of the same substeps."""

import time
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import performance
from numpy.typing import NDArray

from uvms_gym import Simulator
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.speed.physics import THRUST, Stepping
from uvms_gym.studies.speed.timing import Case, interleave, summary, timed

ENV = "UVMS-StationKeep-v0"
#: Physics steps of 0.01 s per control step.
SUBSTEPS = 5
#: Batches of random actions, drawn beforehand and taken in turn; half of them are the negatives of the others.
DRAWN = 8
#: Control steps and physics steps of the single environment in one sample.
SINGLE_CALLS = 200
#: Duration of `benchmark_vector_step`, s.
VECTOR_SECONDS, QUICK_VECTOR_SECONDS = 2.0, 0.2


class VectorEnv(Case):
    """A vector environment under random actions; a unit of work is one control step of an instance.

    Episodes are out of phase: at every step some of the N instances start the next one, as in a long run.
    """

    timed = "a timed observation or reward"

    def __init__(self, scene: dict[str, Any], n: int, threads: int, dtype: str, seed: int) -> None:
        self.name, self.work = scene["name"], n
        options: dict[str, Any] = {"scene": scene, "substeps": SUBSTEPS, "threads": threads, "dtype": dtype}
        self.env: Any = gymnasium.make_vec(ENV, num_envs=n, **options)
        rng = np.random.default_rng(seed)
        self.actions = _actions(rng, self.env.action_space.shape or ())
        self.next = 0
        self.last: tuple[NDArray[Any], ...] = ()
        self.env.reset(seed=seed)
        # An episode's length, in which each instance is reset at a random step.
        length = gymnasium.spec(ENV).max_episode_steps or 1
        at = rng.integers(length, size=n)
        for k in range(length):
            self.step()
            if (mask := at == k).any():
                self.env.reset(options={"reset_mask": mask})

    def step(self) -> None:
        """One control step of all instances."""
        self.last = self.env.step(self.actions[self.next % DRAWN])[:2]
        self.next += 1

    def results(self) -> tuple[NDArray[Any], ...]:
        """Observations and rewards."""
        return self.last


def physics(simulator: Simulator, substeps: int, seed: int) -> Stepping:
    """Substeps by the simulator only, under inputs like the environment's; a unit of work is `SUBSTEPS` steps."""
    n = simulator.num_envs
    low, high = simulator.thruster_limits.T
    thrust = THRUST * np.random.default_rng(seed).uniform(low, high, (n, simulator.num_thrusters))
    inputs: dict[str, Floats] = {"thrust": thrust}
    if simulator.num_joints:
        # Cubics with small higher coefficients: they start anew with every call.
        inputs["joint_target"] = cubic = np.full((n, simulator.num_joints, 4), 1e-6)
        cubic[..., 0] = simulator.q
    return Stepping(simulator, inputs, substeps, SUBSTEPS)


def vector_study(
    scene: dict[str, Any], n: int, threads: list[int], dtypes: list[str], repeats: int, seed: int
) -> list[dict[str, Any]]:
    """Time of the vector environment and of the physics of the same substeps, interleaved.

    `physics` is a call of `Simulator.step` with its inputs; `physics_alone` is the cost of as many additional substeps.
    """
    cases: dict[Any, Any] = {}
    for dtype, count in product(dtypes, threads):
        case = VectorEnv(scene, n, count, dtype, seed)
        cases[dtype, count, "env"] = case
        for name, substeps in (("once", SUBSTEPS), ("twice", 2 * SUBSTEPS)):
            cases[dtype, count, name] = physics(case.env.unwrapped.snapshot(), substeps, seed)
    samples = interleave(cases, repeats)
    rows = []
    for dtype, count in product(dtypes, threads):
        spent, once, twice = (samples[dtype, count, name].fair(count) for name in ("env", "once", "twice"))
        # A call with twice the substeps passes its inputs once.
        alone = 2.0 * twice - once
        percents = {"percent": spent / once, "percent_of_alone": spent / alone}
        rows.append(
            {"scene": scene["name"], "n": n, "threads": count, "dtype": dtype, "substeps": SUBSTEPS}
            | {"env": summary(spent), "physics": summary(once), "physics_alone": summary(alone)}
            | {name: summary(100.0 * (ratio - 1.0)) for name, ratio in percents.items()}
            | {"samples": samples[dtype, count, "env"]}
        )
    return rows


def single_study(scene: dict[str, Any], dtype: str, repeats: int, seed: int) -> dict[str, Any]:
    """Time single calls of `gymnasium.make(...).step`, wrappers and all, and of the physics of the same substeps."""
    env = gymnasium.make(ENV, scene=scene, substeps=SUBSTEPS, dtype=dtype)
    rng = np.random.default_rng(seed)
    actions = _actions(rng, env.action_space.shape or ())
    env.reset(seed=seed)
    inner: Any = env.unwrapped
    cases = [physics(inner.snapshot(), substeps, seed) for substeps in (SUBSTEPS, 2 * SUBSTEPS)]

    def steps() -> list[float]:
        spent = []
        for k in range(SINGLE_CALLS):
            begun = time.perf_counter()
            _, _, terminated, truncated, _ = env.step(actions[k % DRAWN])
            spent.append(time.perf_counter() - begun)
            if terminated or truncated:
                env.reset()
        return spent

    def calls(case: Stepping) -> list[float]:
        return [timed(case.step, 1).wall for _ in range(SINGLE_CALLS)]

    medians = []
    for _ in tracked(range(repeats + 1), "make"):
        medians.append([float(np.median(x)) for x in (steps(), *(calls(case) for case in cases))])
        for case in cases:
            case.check()
    of_env, once, twice = np.array(medians[1:]).T
    alone = twice - once
    parts = {"env": of_env, "physics": once, "physics_alone": alone, "above": of_env - once}
    times = {name: summary(part) for name, part in (parts | {"above_alone": of_env - alone}).items()}
    return {"scene": scene["name"], "dtype": dtype, "substeps": SUBSTEPS} | times


def gymnasium_study(scene: dict[str, Any], n: int, threads: int, seconds: float, seed: int) -> float | None:
    """Control steps per second by Gymnasium's own benchmark, which draws actions while timing; None before 1.4."""
    if not hasattr(performance, "benchmark_vector_step"):
        return None
    env = gymnasium.make_vec(ENV, num_envs=n, scene=scene, dt=0.01, substeps=SUBSTEPS, threads=threads)
    try:
        return float(performance.benchmark_vector_step(env, target_duration=seconds, seed=seed))  # type: ignore[arg-type]
    finally:
        env.close()


def _actions(rng: np.random.Generator, shape: tuple[int, ...]) -> list[NDArray[np.float32]]:
    """Actions with zero mean: no vehicle is driven away, and every episode has its full length."""
    half = [rng.uniform(-1.0, 1.0, shape).astype(np.float32) for _ in range(DRAWN // 2)]
    return [action for drawn in half for action in (drawn, -drawn)]
