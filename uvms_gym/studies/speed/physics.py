"""Time of simulator steps by scene, number of instances, threads, precision, instruction set and substeps."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from typing import Any, NamedTuple, Self

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.numerics import Floats
from uvms_gym.studies.speed.timing import Case, Times, interleave, summary

#: Standard deviation of initial twists (m/s and rad/s), range of constant thrusts (share of the limits).
TWIST, THRUST = 0.1, 0.05
#: Step beside peers, s.
DT = 0.01
#: Relative range of the parameters of varied instances.
VARIED = 0.1
#: Maximum payload, kg.
PAYLOAD = 0.5


class Setting(NamedTuple):
    """A case of the study, with the scene's integrator and step. None: the instruction set of this process."""

    scene: dict[str, Any]
    n: int = 1024
    threads: int = 1
    dtype: str = "float64"
    substeps: int = 10
    varied: bool = False
    instruction_set: str | None = None
    seed: int = 0


class Stepping(Case):
    """A batch under constant inputs; a unit of work is `each` steps of one instance, with `substeps` per call."""

    def __init__(self, simulator: Simulator, inputs: dict[str, Floats], substeps: int, each: int = 1) -> None:
        self.simulator, self.inputs, self.substeps = simulator, inputs, substeps
        self.name, self.work = simulator.scene_name, simulator.num_envs * substeps / each

    @classmethod
    def of(cls, setting: Setting) -> Self:
        """Make a moving batch under thrusts and joint targets, not watched for errors, as peers are not."""
        options = {name: getattr(setting, name) for name in ("dtype", "threads")}
        simulator = Simulator(setting.scene, setting.n, error_estimate=False, **options)
        rng = np.random.default_rng(setting.seed)
        if setting.varied:
            vary(simulator, rng)
        return cls(simulator, start(simulator, rng), setting.substeps)

    def step(self) -> None:
        """One call."""
        self.simulator.step(**self.inputs, substeps=self.substeps)

    def results(self) -> tuple[Floats, ...]:
        """State."""
        s = self.simulator
        return s.position, s.rotation, s.twist, s.q, s.qd

    def facts(self) -> dict[str, Any]:
        """Integrator, instruction set of the kernel, and memory per instance."""
        s = self.simulator
        return {"integrator": s.integrator, "instruction_set": s.instruction_set, "bytes": s.bytes_per_env}


def start(simulator: Simulator, rng: np.random.Generator) -> dict[str, Floats]:
    """Set a batch in motion from its home, and return constant inputs, one row per instance."""
    n = simulator.num_envs
    if not simulator.scene["vehicle"]["fixed"]:
        simulator.set_state(twist=TWIST * rng.normal(size=(n, 6)))
    inputs = {}
    if simulator.num_thrusters:
        low, high = simulator.thruster_limits.T
        inputs["thrust"] = THRUST * rng.uniform(low, high, (n, simulator.num_thrusters))
    if simulator.num_joints:
        inputs["joint_target"] = simulator.q
    return inputs


def vary(simulator: Simulator, rng: np.random.Generator) -> None:
    """Give every instance parameters of its own."""
    n = simulator.num_envs
    own = {name: given * rng.uniform(1.0 - VARIED, 1.0 + VARIED, n) for name, given in simulator.parameters.items()}
    own["payload"] = rng.uniform(0.0, PAYLOAD, n)
    simulator.scale_parameters(**own)


def steps(settings: Sequence[Setting], repeats: int) -> list[dict[str, Any]]:
    """Time all settings, interleaved; a process for each instruction set other than this process's.

    Returns
    -------
    list of dict
        The setting (its scene by name) with `seconds` per step and instance (a summary), `steps_per_second`, used
        `instruction_set`, `bytes` per instance and `samples` of seconds: `Times`.
    """
    with ExitStack() as stack:
        cases: dict[int, Any] = {k: Stepping.of(s) for k, s in enumerate(settings) if s.instruction_set is None}
        for name in dict.fromkeys(s.instruction_set for s in settings if s.instruction_set is not None):
            chosen = {k: setting for k, setting in enumerate(settings) if setting.instruction_set == name}
            pool = stack.enter_context(ProcessPoolExecutor(1, multiprocessing.get_context("spawn")))
            facts = _result(pool, _prepare, list(chosen.values()))
            cases |= {k: Remote(pool, index, facts[index]) for index, k in enumerate(chosen)}
        cases = dict(sorted(cases.items()))
        samples = interleave(cases, repeats)
        facts = [case.facts() for case in cases.values()]
    rows = []
    for k, (setting, fact) in enumerate(zip(settings, facts, strict=True)):
        row = setting._asdict() | fact | {"scene": setting.scene["name"]}
        row |= {"seconds": summary(samples[k].fair(setting.threads)), "samples": samples[k]}
        row["steps_per_second"] = 1.0 / row["seconds"]["median"]
        rows.append(row)
    return rows


class Remote(Case):
    """A case in a worker process."""

    def __init__(self, pool: ProcessPoolExecutor, index: int, facts: dict[str, Any]) -> None:
        self._pool, self._index, self._facts = pool, index, facts

    def sample(self) -> Times:
        """Time per step and instance, measured and checked by the worker."""
        times: Times = _result(self._pool, _sample, self._index)
        return times

    def facts(self) -> dict[str, Any]:
        """Facts of the worker's case."""
        return self._facts


#: Cases of a worker process.
_cases: list[Stepping] = []


def _prepare(settings: Sequence[Setting]) -> list[dict[str, Any]]:
    """Make the cases of this worker, and return their facts; ValueError where the instruction set is missing.

    A process selects its instruction set once, with the first simulator.
    """
    os.environ["UVMS_INSTRUCTION_SET"] = str(settings[0].instruction_set)
    _cases[:] = [Stepping.of(setting) for setting in settings]
    return [case.facts() for case in _cases]


def _sample(index: int) -> Times:
    times = _cases[index].sample()
    _cases[index].check()
    return times


def _result(pool: ProcessPoolExecutor, function: Callable[..., Any], argument: Any) -> Any:
    try:
        return pool.submit(function, argument).result()
    except BrokenProcessPool:
        raise ValueError("a measuring process exited") from None


def parameter_costs(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Cost of parameters per instance, in percent, by pairs of rows with and without them."""

    result = []
    for row, other in _pairs(rows, [name for name in Setting._fields if name != "varied"], "varied", False):
        own, same = (each["samples"].fair(row["threads"]) for each in (row, other))
        kept = {name: row[name] for name in ("scene", "dtype", "instruction_set", "bytes")}
        result.append(kept | {"percent": summary(100.0 * (own / same - 1.0))})
    return result


def _pairs(
    rows: Sequence[Mapping[str, Any]], alike: Sequence[str], key: str, base: Any
) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Rows whose `key` is not `base`, each with the row of the base whose entries `alike` are the same, if any."""
    bases = {tuple(row.get(name) for name in alike): row for row in rows if row[key] == base}
    for row in rows:
        if row[key] != base and (other := bases.get(tuple(row.get(name) for name in alike))):
            yield row, other


def thread_speedups(
    rows: Sequence[Mapping[str, Any]], vector: Sequence[Mapping[str, Any]], many: int
) -> list[dict[str, Any]]:
    """Wall-clock speed of several threads over one thread, round by round, with the most substeps.

    `rows` come from `steps`, `vector` from `environment.vector_study`.
    """
    most = max(row["substeps"] for row in rows)
    chosen = [row for row in rows if (row["n"], row["substeps"], row["varied"]) == (many, most, False)]
    result = []
    for what, measured in (("physics", chosen), ("make_vec", vector)):
        for row, one in _pairs(measured, ("scene", "n", "dtype", "substeps", "instruction_set"), "threads", 1):
            ratio = summary(one["samples"].wall / row["samples"].wall)
            kept = {name: row[name] for name in ("scene", "n", "threads", "dtype", "substeps")}
            result.append({"what": what, "instruction_set": row.get("instruction_set"), **kept, "ratio": ratio})
    return result
