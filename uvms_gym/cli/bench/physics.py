"""Steps of the simulator alone: by scene, number of instances, threads, precision, lane width and substeps."""

import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np

from uvms_gym import Simulator
from uvms_gym.cli.bench.timing import Case, Floats, Tick, Times, calls_per_sample, interleave, summary, timed
from uvms_gym.cli.common import fail

#: Spread of the starts' twists (m/s and rad/s) and of held thrusts (share of the limits); step, s.
TWIST, THRUST, DT = 0.1, 0.05, 0.01
#: Parameters of randomised instances lie within so much of the scene's.
VARIED = 0.1
# Greatest payload, kg.
PAYLOAD = 0.5


class Setting(NamedTuple):
    """What is stepped. `lanes` None: as this process has them."""

    scene: dict[str, Any]
    n: int = 1024
    threads: int = 1
    dtype: str = "float64"
    substeps: int = 10
    integrator: str = "mk4"
    varied: bool = False
    lanes: str | None = None
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
        """Refuse a state that is not finite."""
        assert_finite(self.name, self.simulator)

    def facts(self) -> dict[str, Any]:
        """What ran."""
        return {"ran": self.simulator.instruction_set, "bytes": self.simulator.bytes_per_env}


def start(simulator: Simulator, rng: np.random.Generator) -> dict[str, Floats]:
    """Set batch in motion from its home; returns the inputs that keep it moving, one row per instance."""
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
    """Refuse to time what has left the finite numbers.

    Raises
    ------
    TyperException
        It has.
    """
    state = (simulator.position, simulator.rotation, simulator.twist, simulator.q, simulator.qd)
    if not all(np.isfinite(part).all() for part in state):
        raise fail(f"{name}: the motion left the finite numbers, so its time means nothing")


def steps(settings: Sequence[Setting], repeats: int, tick: Tick) -> list[dict[str, Any]]:
    """Time all settings, interleaved, those with lanes of their own in processes of their own.

    Returns
    -------
    list of dict
        The setting (its scene by name) with `seconds` per step and instance (a summary), `steps_per_second`, `lanes`
        that ran, `bytes` per instance and `samples` of seconds: `Times`.
    """
    with ExitStack() as stack:
        workers = {
            lanes: stack.enter_context(worker(lanes, [setting for setting in settings if setting.lanes == lanes]))
            for lanes in dict.fromkeys(setting.lanes for setting in settings)
            if lanes is not None
        }
        cases: dict[int, Any] = {}
        counts = dict.fromkeys(workers, 0)
        for k, setting in enumerate(settings):
            if setting.lanes is None:
                cases[k] = Stepping(setting)
            else:
                cases[k] = Remote(workers[setting.lanes], counts[setting.lanes])
                counts[setting.lanes] += 1
        samples = interleave(cases, repeats, tick)
        facts = [case.facts() for case in cases.values()]
    rows = []
    for k, (setting, fact) in enumerate(zip(settings, facts, strict=True)):
        row = setting._asdict() | {"scene": setting.scene["name"], "lanes": fact["ran"], "bytes": fact["bytes"]}
        row |= {"seconds": summary(samples[k].fair(setting.threads)), "samples": samples[k]}
        row["steps_per_second"] = 1.0 / row["seconds"]["median"]
        rows.append(row)
    return rows


class Remote:
    """A case in a worker."""

    def __init__(self, connection: Connection, index: int) -> None:
        self.connection, self.index = connection, index

    def ask(self, what: str) -> Any:
        """Have the worker do it."""
        self.connection.send((self.index, what))
        return _answer(self.connection)

    def sample(self) -> Times:
        """Time per step and instance, as the worker measures it."""
        return Times(*self.ask("sample"))

    def check(self) -> None:
        """Nothing is left to do: the worker has checked."""

    def facts(self) -> dict[str, Any]:
        """What ran."""
        return dict(self.ask("facts"))


@contextmanager
def worker(lanes: str, settings: Sequence[Setting]) -> Iterator[Connection]:
    """Start a process whose kernel uses `lanes`: a process chooses them once.

    Raises
    ------
    TyperException
        This machine does not offer them.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there, list(settings)), daemon=True)
    before = os.environ.get("UVMS_INSTRUCTION_SET")
    os.environ["UVMS_INSTRUCTION_SET"] = lanes
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
    """Time on demand until nobody asks any more."""
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
        outcome, result = "failed", "a measuring process ended of itself"
    if outcome == "failed":
        raise fail(str(result))
    return result


def parameter_costs(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What parameters per instance cost, in percent, of pairs of rows that differ in nothing else."""

    def key(row: Mapping[str, Any]) -> tuple[Any, ...]:
        return tuple(row[name] for name in Setting._fields if name != "varied")

    shared = {key(row): row for row in rows if not row["varied"]}
    result = []
    for row in rows:
        if row["varied"] and (other := shared.get(key(row))):
            own, same = (each["samples"].fair(row["threads"]) for each in (row, other))
            percent = summary(100.0 * (own / same - 1.0))
            result.append({name: row[name] for name in ("scene", "dtype", "lanes", "bytes")} | {"percent": percent})
    return result
