"""Tune the gains of classical controllers, by default each with the same number of simulated episodes.

```sh
pip install -e '.[cli,train]'
python training/tune.py --controller pd --controller pid
python training/tune.py --controller pd --controller pid --period 0.05
```

The objective is the pose error of the comparison. CMA-ES (`pycma`) searches in the logarithm of the gains. All
candidates of a generation run the same episodes; every generation has new ones, none of them of the comparison. The
finalists run on fresh episodes, and the best is written to the package's `gains.json` with a record of the search. The
base (PD in station keeping) is tuned for its errors only; the others start from its gains, where they have the same,
or from those in `STARTS`, with a penalty for effort and variation beyond the setting's limits, which are
multiples of the base's in the same episodes.

In the storm the score of 64 episodes has a standard deviation of 4 %, but the difference between neighbours on the same
episodes has 1.2 %, and 0.3 % with the 1024 episodes of finalists.

Where a task counts success, the objective is the share of an episode before success plus the end effector's pose error
in m, without limits; a valve is turned under all of `CONDITIONS`, so that one set of gains serves. In
the storm, where only light valves can be turned, it is pushed at 0.1 N m.

The same command resumes an interrupted run.
"""

import datetime
import json
import math
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import cma
import gymnasium
import numpy as np
import typer
from numpy.typing import NDArray
from parameters import ALIKE, EACH, PRESCRIBED, Parameter, parameters, space_of
from search import Space, rounded, search, store, write

import uvms_gym
from uvms_gym import StepWarning
from uvms_gym.cli.app import run
from uvms_gym.cli.common import fail, line, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import Integrator
from uvms_gym.cli.options import ranged
from uvms_gym.controllers import Controller
from uvms_gym.controllers.families import BASELINE, CONTROLLERS, Limits, canonical, is_bound
from uvms_gym.controllers.registry import PRETRAINED, place
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import interquartile_mean
from uvms_gym.studies.records import circumstances
from uvms_gym.training.evaluation import run_episodes

Floats = NDArray[np.float64]

#: Seeds of the episodes: the comparison has lower ones, evaluations in training have higher ones.
SEEDS = range(1_000_000, 2_000_000)
#: Physics step of the searches, s: certified (docs/certificates.md), tracking under resolved motion.
STEPS = {"station-keep": 0.025, "ee-track": 0.01, "button": 0.005, "valve": 0.005}

#: Tuned controllers whose gains are the start of others' searches, beside the others' own defaults, by the others' task
#: and name.
STARTS = {
    ("station-keep", "mpc/free"): "mpc",
    ("station-keep", "nmpc"): "mpc",
    ("ee-track", "nmpc"): "resolved",
    ("ee-track", "resolved-adaptive"): "resolved-dob/wide",
}


#: Tasks that count success; options under which a controller is tuned, by task or environment.
SUCCESS = ("button", "valve")
CONDITIONS: dict[str, list[dict[str, Any]]] = {
    "valve": [
        {"contract": contract, "torque": torque, "disturbance": disturbance}
        for contract in ("push", "grasp")
        for torque, disturbance in ((0.012, "calm"), (1.0 if contract == "push" else 0.6, "calm"), (0.3, "current"))
    ],
    "UVMS-Valve-Storm-v0": [{"contract": "push", "torque": 0.1}],
}


class Score(NamedTuple):
    """Score of a controller.

    Pose error, m, with success plus the share of time before it; means of effort and command variation; share of
    diverged episodes.
    """

    pose: float
    effort: float
    variation: float
    diverged: float

    def within(self, limits: Limits) -> bool:
        """True within the limits."""
        return self._over(limits) == 1.0

    def objective(self, limits: Limits) -> float:
        """Pose error, times (value / limit)^2 beyond a limit, times 1 + 10 times the share of diverged episodes."""
        return self.pose * self._over(limits) ** 2 * (1.0 + 10.0 * self.diverged)

    def _over(self, limits: Limits) -> float:
        pairs = ((self.effort, limits.effort), (self.variation, limits.variation))
        return math.prod(max(1.0, value / limit) for value, limit in pairs if limit is not None)


class Arena:
    """Episodes of an environment, for scores of controllers."""

    def __init__(self, env: str, options: dict[str, Any], steps: int, task: str) -> None:
        self.options, self.steps, self.task = options, steps, task
        self._conditions = CONDITIONS.get(env, CONDITIONS.get(task, [{}]))
        #: Vector environment of a number of episodes under one of the conditions, made once.
        self.batch = cache(
            lambda episodes, k=0: gymnasium.make_vec(env, num_envs=episodes, **options, **self._conditions[k])
        )

    def score(self, make: Callable[[Any], Controller], seed: int, episodes: int) -> Score:
        """Score a controller, made for an environment, in the episodes with seeds from `seed` on."""
        count, found = -(-episodes // len(self._conditions)), []
        for k in range(len(self._conditions)):
            batch = self.batch(count, k)
            stats = run_episodes(batch, make(batch), seed, self.steps)
            totals = (stats.sums["power"].sum(), stats.sums["action_rate"].sum())
            effort, changes = (float(total / stats.steps.sum()) for total in totals)
            error = interquartile_mean(pose_rms(stats))
            if self.task in SUCCESS:
                error += 1.0 - float(stats.mean("success").mean())
            found.append(Score(error, effort, changes, float(stats.terminated.mean())))
        return Score(*np.mean(found, axis=0).tolist())


class Tuner:
    """Scores of a controller's gains."""

    #: Maker of the tuned base, whose effort is the limit.
    limiting: Callable[[Any], Controller] | None = None

    def __init__(self, arena: Arena, name: str, sought: Sequence[Parameter]) -> None:
        self._arena, self._entry, self._sought = arena, CONTROLLERS[name], sought
        #: What the objective has beside the pose error.
        self.addition = ", plus the mean share of time before success" if arena.task in SUCCESS else ""
        own = self.controller({})
        self._own = {p.name: np.asarray(own.gains[p.name], dtype=np.float64) for p in sought}

    def controller(self, gains: dict[str, Any]) -> Controller:
        """Make the controller with given gains."""
        return self._entry.make(gains, self._arena.batch(1))

    def gains(self, values: Floats) -> dict[str, Any]:
        """Keyword arguments of the controller, to four digits."""
        gains: dict[str, Any] = dict(PRESCRIBED.get(self._arena.task, {}))
        left = iter(values)
        for parameter in self._sought:
            own = self._own[parameter.name]
            scaled = own.copy()
            for group in map(list, parameter.groups) if parameter.groups else [...]:
                factor = next(left)
                scaled[group] = factor if parameter.absolute else factor * own[group]
            gains[parameter.name] = np.vectorize(rounded)(scaled).tolist()
        return gains

    def factors(self, gains: dict[str, Any] | None = None) -> dict[str, Floats]:
        """Gains as they are tuned: values, or factors on the controller's defaults; None: of the defaults."""
        numbers = self._own if gains is None else gains
        return {p.name: np.asarray(numbers[p.name]) / (1.0 if p.absolute else self._own[p.name]) for p in self._sought}

    def start(self, factors: dict[str, Floats]) -> Floats:
        """Start of the search: known factors, NaN elsewhere."""
        numbers: list[Any] = []
        for parameter in self._sought:
            known = factors.get(parameter.name, np.full_like(self._own[parameter.name], np.nan))
            known = np.maximum(known, parameter.low)
            numbers += [known[list(group)].mean() for group in parameter.groups] or [known]
        return np.array(numbers, dtype=np.float64)

    def score(self, gains: dict[str, Any], seed: int, episodes: int) -> Score:
        """Score gains."""
        return self._arena.score(partial(self._entry.make, gains), seed, episodes)

    def limits(self, seed: int, episodes: int) -> Limits:
        """Limits in these episodes; none for the base itself."""
        if self.limiting is None or self._arena.task in SUCCESS:
            return Limits(None)
        base, over = self._arena.score(self.limiting, seed, episodes), self._entry.setting.limits
        return Limits(over.effort and over.effort * base.effort, over.variation and over.variation * base.variation)


class Budget(NamedTuple):
    """Budget of a search, the same for all controllers."""

    generations: int
    population: int
    episodes: int
    finals: int


def tune(
    tuner: Tuner,
    space: Space,
    budget: Budget,
    *,
    start: Floats | None = None,
    seed: int,
    checkpoint: Path,
    settings: dict[str, Any],
    tick: Callable[[], object] = lambda: None,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Tune a controller; returns its gains and the record of the search.

    `checkpoint` holds the scores of the generations so far; the search resumes from it if `settings` are the same.
    """
    done: dict[str, Any] = {"settings": settings, "seconds": 0.0, "scores": []}
    try:
        stored = json.loads(checkpoint.read_text())
        if stored["settings"] == json.loads(json.dumps(settings)):
            done = stored
    except (OSError, ValueError, LookupError):
        pass

    def evaluate(generation: int, candidates: Floats) -> list[float]:
        if generation == len(done["scores"]):
            began = time.monotonic()
            first = SEEDS.start + generation * budget.episodes
            limits = tuner.limits(first, budget.episodes)
            with warnings.catch_warnings():
                # Steps may be inaccurate with extreme candidates.
                warnings.simplefilter("ignore", StepWarning)
                scores = [tuner.score(tuner.gains(x), first, budget.episodes) for x in candidates]
            done["scores"].append([score.objective(limits) for score in scores])
            done["seconds"] += time.monotonic() - began
            write(checkpoint, done)
        scores = done["scores"][generation]
        tick()
        return scores

    found = search(
        space, evaluate, start=start, generations=budget.generations, population=budget.population, seed=seed
    )
    began = time.monotonic()
    first = SEEDS.start + budget.generations * budget.episodes
    limits = tuner.limits(first, budget.finals)
    finals = []
    for values in found:
        gains = tuner.gains(values)
        score = tuner.score(gains, first, budget.finals)
        edges = [space.labels[i] for i, _ in space.edges(space.places(values))]
        # In this order: fewest edges, within the limits, objective.
        finals.append(((len(edges), not score.within(limits), score.objective(limits)), gains, edges, score))
    _, gains, edges, score = min(finals, key=lambda final: final[0])
    record = {
        "objective": "interquartile mean of the episodes' RMS of sqrt(position^2 + (0.5 m * attitude)^2), m"
        + tuner.addition,
        "score": score.pose,
        "effort": score.effort,
        "effort_limit": limits.effort,
        "variation": score.variation,
        "variation_limit": limits.variation,
        "diverged": score.diverged,
        "budget": {
            "episodes": budget.generations * budget.population * budget.episodes + len(found) * budget.finals,
            "generations": budget.generations,
            "population": budget.population,
            "episodes_per_candidate": budget.episodes,
            "finalists": len(found),
            "episodes_per_finalist": budget.finals,
        },
        "seeds": {"search": [SEEDS.start, first - 1], "final": [first, first + budget.finals - 1], "optimizer": seed},
        "start": None if start is None else [None if np.isnan(x) else rounded(x) for x in start],
        "ranges": space.ranges,
        "widened": space.widened,
        "at_edge": edges,
        "seconds": round(done["seconds"] + time.monotonic() - began, 1),
    }
    return gains, record


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command()
def main(
    controller: Annotated[
        list[str], typer.Option(help="Controller; may be repeated: the base first, as the others need its gains.")
    ],
    env: Annotated[str, typer.Option(help="Environment, by Gymnasium's id.")] = "UVMS-StationKeep-Storm-v0",
    scene: Annotated[str, typer.Option(help="Scene: name or TOML file.")] = "petasus-pum",
    period: Annotated[float | None, typer.Option(help="Control period, s. [default: the environment's]")] = None,
    integrator: Integrator = None,
    dt: Annotated[
        float | None,
        ranged(
            f"Step, s. [default: the scene's, or {STEPS['station-keep']:g}, tracking {STEPS['ee-track']:g}]",
            1e-6,
            1.0,
            metavar="STEP",
        ),
    ] = None,
    axes: Annotated[
        Literal["alike", "each"], typer.Option(help="Factors of gains: shared by x and y, roll and pitch, or by axis.")
    ] = "alike",
    generations: Annotated[int, ranged("Generations of the search, 1 to 1000.", 1, 1000)] = 40,
    population: Annotated[int, ranged("Candidates of a generation, 4 to 1000.", 4, 1000)] = 32,
    episodes: Annotated[int, ranged("Episodes of a candidate, 4 to 10000.", 4, 10000)] = 64,
    finals: Annotated[int, ranged("Episodes of a finalist, 4 to 10000.", 4, 10000)] = 1024,
    seed: Annotated[int, typer.Option(help="Seed of the search.")] = 0,
    threads: Annotated[int | None, typer.Option(help="Maximum number of threads. [default: one per core]")] = None,
    policies: Annotated[Path, typer.Option(help="Folder for the gains.")] = PRETRAINED,
    work: Annotated[Path, typer.Option(help="Folder for the state of interrupted searches.")] = Path("out/tune"),
) -> None:
    """Tune gains of classical controllers, and write them into the package."""
    budget = Budget(generations, population, episodes, finals)
    if generations * episodes + finals > len(SEEDS):
        raise fail(f"--generations times --episodes is {generations * episodes}, but must be below {len(SEEDS)}")
    with user_errors():
        controller = [canonical(name) for name in controller]
    bounds = {is_bound(name) for name in controller}
    if len(bounds) > 1:
        raise fail("bounds are tuned in a run of their own")
    arena = _arena(env, scene, period, integrator, dt, threads, informed=True in bounds)
    batch = arena.batch(1)
    task, where = batch.unwrapped.task, place(batch)
    known = parameters(EACH if axes == "each" else ALIKE, task)
    for name in controller:
        with user_errors():
            canonical(name, task=task)
        if name not in known:
            raise fail(f"{name} has no gains to tune")
    prepare(policies / where, work / where / "any.json")
    file, base = policies / where / "gains.json", BASELINE[task]
    if file.exists():
        # Before the search, which would end without a place for its gains.
        with user_errors(f"{file}: "):
            json.loads(file.read_text())
    made = circumstances("tune", {})
    for name in controller:
        ours = Tuner(arena, name, known[name])
        gains, start = None, None
        if name != base:
            gains = _stored(file, base, "whose effort is the limit")
            theirs = Tuner(arena, base, known[base])
            ours.limiting = partial(CONTROLLERS[base].make, gains)
            start = ours.start(theirs.factors(gains))
        if origin := STARTS.get((task, name)):
            theirs = Tuner(arena, origin, known[origin])
            start = ours.start(ours.factors() | theirs.factors(_stored(file, origin, "where the search starts")))
        settings = {
            "env": env,
            "scene": arena.options["scene"],
            "period": where.name,
            "integrator": arena.options["integrator"],
            "dt": arena.options["dt"],
            "controller": [name, CONTROLLERS[name].setting.gains, known[name]],
            "budget": budget,
            "seed": seed,
            "base": gains,
            "versions": {"uvms_gym": uvms_gym.__version__, "cma": cma.__version__},
        }
        with progress() as bar:
            gains, record = tune(
                ours,
                space_of(known[name]),
                budget,
                start=start,
                seed=seed,
                checkpoint=work / where / f"{name.replace('/', '-')}.json",
                settings=settings,
                tick=partial(bar.update, bar.add_task(name, total=generations), advance=1),
            )
        record |= {
            "env": env,
            "axes": axes,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "optimizer": f"CMA-ES (cma {cma.__version__})",
            **{key: made[key] for key in ("uvms_gym", "commit", "python", "numpy", "gymnasium", "machine")},
        }
        store(file, name, gains, record)
        _print(name, gains, record)
    line(str(file))


def _stored(file: Path, name: str, role: str) -> dict[str, Any]:
    try:
        gains: dict[str, Any] = json.loads(file.read_text())[name]["gains"]
    except (OSError, ValueError, LookupError):
        raise fail(f"{file} has no gains of {name}, {role}: tune {name} first") from None
    return gains


def _arena(
    env: str,
    scene: str,
    period: float | None,
    integrator: str | None,
    dt: float | None,
    threads: int | None,
    informed: bool,
) -> Arena:
    """Make the episodes; their duration does not depend on the control period."""
    loaded = read_scene(scene)
    with user_errors(f"{env}: "):
        usual = gymnasium.make_vec(env, num_envs=1, scene=loaded)
    inner = usual.unwrapped
    given = inner.control_period
    if dt is None:
        stated = loaded.get("integration", {}).get("step")
        dt = inner.snapshot().dt if stated else STEPS.get(inner.task, inner.snapshot().dt)
    period = given if period is None else period
    substeps = round(period / dt)
    if substeps < 1 or not math.isclose(substeps * dt, period):
        raise fail(f"--period is {period}, but must be a multiple of the step, {dt} s")
    steps = round((gymnasium.spec(env).max_episode_steps or 0) * given / period)
    options = {"scene": inner.options.scene, "dt": dt, "substeps": substeps, "threads": threads}
    options |= {"max_episode_steps": steps, "integrator": integrator}
    if informed:
        options["disturbance"] = {"base": inner.options.disturbance, "noise": None, "delay": None}
    return Arena(env, options, steps, inner.task)


def _print(name: str, gains: dict[str, Any], record: dict[str, Any]) -> None:
    limit = record["effort_limit"]
    effort = f"effort {record['effort']:.4f}" + ("" if limit is None else f" (limit {limit:.4f})")
    line(f"{name}: {record['score']:.4f} m, {effort}, {record['seconds']:.0f} s")
    for parameter, value in gains.items():
        line(f"  {parameter} = {value}")
    if record["widened"]:
        line(f"  ranges widened: {', '.join(record['widened'])}")
    if record["at_edge"]:
        line(f"  at the edge of its range: {', '.join(record['at_edge'])}")


if __name__ == "__main__":
    sys.exit(run(app=app, name="tune.py"))
