"""Time of simulator steps by scene, number of instances, threads, precision, instruction set and substeps."""

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.speed.timing import Case, Floats, Tick, Times, calls_per_sample, interleave, summary, timed

#: Standard deviation of initial twists (m/s and rad/s), range of held thrusts (share of the limits), and step, s.
TWIST, THRUST, DT = 0.1, 0.05, 0.01
#: Relative range of the parameters of varied instances.
VARIED = 0.1
#: Greatest payload, kg.
PAYLOAD = 0.5


class Setting(NamedTuple):
    """A case of the study. `instruction_set` None: the instruction set of this process."""

    scene: dict[str, Any]
    n: int = 1024
    threads: int = 1
    dtype: str = "float64"
    substeps: int = 10
    integrator: str = "mk4"
    varied: bool = False
    instruction_set: str | None = None
    seed: int = 0


class Stepping:
    """A moving batch under held thrusts and joint targets; a unit of work is one step of one instance."""

    def __init__(self, setting: Setting) -> None:
        n, rng = setting.n, np.random.default_rng(setting.seed)
        self.name, self.work, self.substeps = setting.scene["name"], n * setting.substeps, setting.substeps
        self.simulator = Simulator(
            setting.scene,
            n,
            dt=DT,
            integrator=setting.integrator,
            dtype=setting.dtype,
            threads=setting.threads,
        )
        if setting.varied:
            vary(self.simulator, rng)
        self.inputs = start(self.simulator, rng)
        self.calls = calls_per_sample(self.step)

    def step(self) -> None:
        """One call."""
        self.simulator.step(**self.inputs, substeps=self.substeps)

    def sample(self) -> Times:
        """Time per step and instance."""
        return timed(self.step, self.calls).per(self.work)

    def check(self) -> None:
        """Raise ValueError if the state is not finite."""
        assert_finite(self.name, self.simulator)

    def facts(self) -> dict[str, Any]:
        """Instruction set of the kernel, and memory per instance."""
        return {"instruction_set": self.simulator.instruction_set, "bytes": self.simulator.bytes_per_env}


def start(simulator: Simulator, rng: np.random.Generator) -> dict[str, Floats]:
    """Set a batch in motion from its home, and return held inputs, one row per instance."""
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


def assert_finite(name: str, simulator: Simulator) -> None:
    """Check that a timed motion is valid.

    Raises
    ------
    ValueError
        The state is not finite.
    """
    state = (simulator.position, simulator.rotation, simulator.twist, simulator.q, simulator.qd)
    if not all(np.isfinite(part).all() for part in state):
        raise ValueError(f"{name}: the timed motion is not finite")


def steps(settings: Sequence[Setting], repeats: int, tick: Tick) -> list[dict[str, Any]]:
    """Time all settings, interleaved; a process for each instruction set other than this process's.

    Returns
    -------
    list of dict
        The setting (its scene by name) with `seconds` per step and instance (a summary), `steps_per_second`, used
        `instruction_set`, `bytes` per instance and `samples` of seconds: `Times`.
    """
    with ExitStack() as stack:
        workers = {
            name: stack.enter_context(worker(name, [s for s in settings if s.instruction_set == name]))
            for name in dict.fromkeys(setting.instruction_set for setting in settings)
            if name is not None
        }
        cases: dict[int, Any] = {}
        counts = dict.fromkeys(workers, 0)
        for k, setting in enumerate(settings):
            if setting.instruction_set is None:
                cases[k] = Stepping(setting)
            else:
                cases[k] = Remote(workers[setting.instruction_set], counts[setting.instruction_set])
                counts[setting.instruction_set] += 1
        samples = interleave(cases, repeats, tick)
        facts = [case.facts() for case in cases.values()]
    rows = []
    for k, (setting, fact) in enumerate(zip(settings, facts, strict=True)):
        row = setting._asdict() | fact | {"scene": setting.scene["name"]}
        row |= {"seconds": summary(samples[k].fair(setting.threads)), "samples": samples[k]}
        row["steps_per_second"] = 1.0 / row["seconds"]["median"]
        rows.append(row)
    return rows


class Remote:
    """A case in a worker process."""

    def __init__(self, connection: Connection, index: int) -> None:
        self.connection, self.index = connection, index

    def ask(self, what: str) -> Any:
        """Result of a method of the worker's case."""
        self.connection.send((self.index, what))
        return _answer(self.connection)

    def sample(self) -> Times:
        """Time per step and instance, measured by the worker."""
        return Times(*self.ask("sample"))

    def check(self) -> None:
        """Do nothing: the worker has checked."""

    def facts(self) -> dict[str, Any]:
        """Facts of the worker's case."""
        return dict(self.ask("facts"))


@contextmanager
def worker(instruction_set: str, settings: Sequence[Setting]) -> Iterator[Connection]:
    """Start a process with an instruction set, which a process selects once.

    Raises
    ------
    ValueError
        This machine lacks it.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, list(settings)), daemon=True)
    before = os.environ.get("UVMS_INSTRUCTION_SET")
    os.environ["UVMS_INSTRUCTION_SET"] = instruction_set
    try:
        process.start()
    finally:
        if before is None:
            del os.environ["UVMS_INSTRUCTION_SET"]
        else:
            os.environ["UVMS_INSTRUCTION_SET"] = before
    there.close()
    try:
        _answer(here)
        yield here
    finally:
        here.close()
        process.join()


def _serve(connection: Connection, settings: Sequence[Setting]) -> None:
    """Answer requests until the connection closes."""
    cases: list[Stepping] = []
    try:
        cases = [Stepping(setting) for setting in settings]
        connection.send(("done", None))
        while True:
            index, what = connection.recv()
            case: Case = cases[index]
            result = getattr(case, what)()
            case.check()
            connection.send(("done", result))
    except (EOFError, BrokenPipeError, KeyboardInterrupt):
        return
    except Exception as error:
        connection.send(("failed", str(error)))


def _answer(connection: Connection) -> Any:
    try:
        outcome, result = connection.recv()
    except EOFError:
        outcome, result = "failed", "a measuring process exited"
    if outcome == "failed":
        raise ValueError(str(result))
    return result


def parameter_costs(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Cost of parameters per instance, in percent, by pairs of rows with and without them."""

    def key(row: Mapping[str, Any]) -> tuple[Any, ...]:
        return tuple(row[name] for name in Setting._fields if name != "varied")

    shared = {key(row): row for row in rows if not row["varied"]}
    result = []
    for row in rows:
        if row["varied"] and (other := shared.get(key(row))):
            own, same = (each["samples"].fair(row["threads"]) for each in (row, other))
            percent = summary(100.0 * (own / same - 1.0))
            kept = {name: row[name] for name in ("scene", "dtype", "instruction_set", "bytes")}
            result.append(kept | {"percent": percent})
    return result


def thread_speedups(
    rows: Sequence[Mapping[str, Any]], vector: Sequence[Mapping[str, Any]], many: int
) -> list[dict[str, Any]]:
    """Wall-clock speed of several threads over that of one, round by round, with the most substeps.

    Parameters
    ----------
    rows : sequence of dict
        Those of `steps`.
    vector : sequence of dict
        Those of `environment.vector_study`.
    many : int
        Number of instances.
    """
    most = max(row["substeps"] for row in rows)
    named = [("physics", row) for row in rows if (row["n"], row["substeps"], row["varied"]) == (many, most, False)]
    named += [("make_vec", row) for row in vector]

    def key(what: str, row: Mapping[str, Any]) -> tuple[Any, ...]:
        return (what, *(row.get(name) for name in ("scene", "n", "dtype", "substeps", "instruction_set")))

    alone = {key(what, row): row for what, row in named if row["threads"] == 1}
    result = []
    for what, row in named:
        one = alone.get(key(what, row))
        if row["threads"] > 1 and one is not None:
            ratio = summary(one["samples"].wall / row["samples"].wall)
            kept = {name: row[name] for name in ("scene", "n", "threads", "dtype", "substeps")}
            result.append({"what": what, "instruction_set": row.get("instruction_set"), **kept, "ratio": ratio})
    return result
