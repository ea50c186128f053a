"""The command: options, the order of measurements, and files."""

import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

import uvms_gym
from uvms_gym.cli.bench import environment, equal_error, learning, peers, physics, report, timing
from uvms_gym.cli.bench.picture import picture
from uvms_gym.cli.common import Json, Out, check_range, circumstances, console, fail, prepare, progress, write_json
from uvms_gym.cli.scenes import read_scene

FILES = ("bench.json", "bench.png")
SCENES, PEER_SCENES = (
    ("petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"),
    ("petasus-pum", "bluerov2-heavy-alpha5"),
)
INSTANCES, QUICK_INSTANCES = (1, 64, 1024, 16384), (1, 1024)
#: The number of instances that sections with one alone use, if it is among those asked for; else the greatest.
MANY = 1024
SUBSTEPS, QUICK_SUBSTEPS = (1, 10), (10,)
DTYPES = ("float64", "float32")
REPEATS, QUICK_REPEATS = 15, 5
MOST_INSTANCES, MOST_THREADS, MOST_SUBSTEPS, LEAST_REPEATS, MOST_REPEATS = 200_000, 1024, 1000, 1, 1000

Tick = Callable[[], None]


def bench(
    scene: Annotated[
        list[str] | None,
        typer.Option(help=f"Scene: name or TOML file; may be repeated. Without it: {', '.join(SCENES)}."),
    ] = None,
    n: Annotated[
        str | None, typer.Option("--n", help=f"Numbers of instances. Without it: {','.join(map(str, INSTANCES))}.")
    ] = None,
    threads: Annotated[str | None, typer.Option(help="Numbers of threads. Without it: 1 and all cores.")] = None,
    dtype: Annotated[str | None, typer.Option(help=f"Precisions. Without it: {','.join(DTYPES)}.")] = None,
    lanes: Annotated[
        str | None,
        typer.Option(
            help="Instruction sets of the first table, named as in UVMS_INSTRUCTION_SET; by default the widest."
        ),
    ] = None,
    substeps: Annotated[
        str | None, typer.Option(help=f"Steps per call. Without it: {','.join(map(str, SUBSTEPS))}.")
    ] = None,
    integrator: Annotated[str, typer.Option(help="Integrator.")] = "mk4",
    repeats: Annotated[
        int | None,
        typer.Option(help=f"Rounds after the one that warms up, 1 to {MOST_REPEATS}. Without it: {REPEATS}."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of starts, thrusts and actions.")] = 0,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer cases and rounds.")] = False,
    env: Annotated[bool, typer.Option("--env", help="Measure the environments, too, vector and single.")] = False,
    with_peers: Annotated[
        bool, typer.Option("--peers", help="Measure MuJoCo and Pinocchio, too (extra `peers`), interleaved with ours.")
    ] = False,
    sb3: Annotated[bool, typer.Option("--sb3", help="Measure PPO of Stable-Baselines3, too.")] = False,
    out: Out = Path("out/bench"),
    json_file: Json = None,
) -> None:
    """Measure how fast steps are, by scene, instances, threads, precision, instruction set and substeps.

    Lists are separated by commas. All cases of a table are timed in turn, round by round: medians with quartiles.
    Prints tables and writes a picture and bench.json to --out.
    """
    arguments = _arguments(scene, n, threads, dtype, lanes, substeps, integrator, repeats, seed, quick)
    arguments |= {"env": env, "peers": with_peers, "sb3": sb3}
    loaded = [read_scene(name) for name in arguments["scene"]]
    acting, compared = _sections(loaded, scene is not None, env, with_peers, sb3)
    if with_peers:
        peers.require()
    if sb3:
        learning.require()
    prepare(out, json_file, FILES)
    begun, load = time.perf_counter(), os.getloadavg()
    results: dict[str, Any] = {}
    with progress() as bar:
        results["physics"] = _physics(loaded, arguments, bar)
        if env:
            results["environment"] = _environment(acting, arguments, bar)
        if with_peers:
            results["peers"] = _peers(compared, arguments, bar)
        if sb3:
            results["learning"] = _learning(acting[0], arguments, bar)
        bar.add_task("picture", total=None)
        results["parameters"] = physics.parameter_costs(results["physics"])
        results["threads"] = report.speedups(
            results["physics"], results.get("environment", {}).get("vector", []), _many(arguments)
        )
        picture(out / FILES[1], results, _many(arguments))
    told = circumstances("bench", arguments)
    told |= {"seconds": time.perf_counter() - begun, "load": {"before": load, "after": os.getloadavg()}}
    report.print_all(results, told)
    for path in {out / FILES[0], json_file or out / FILES[0]}:
        write_json(path, {"circumstances": told, "results": results})
    console.print(f"{out}: {', '.join(FILES)} ({told['seconds']:.0f} s)", markup=False, soft_wrap=True)


def _arguments(
    scene: Sequence[str] | None,
    n: str | None,
    threads: str | None,
    dtype: str | None,
    lanes: str | None,
    substeps: str | None,
    integrator: str,
    repeats: int | None,
    seed: int,
    quick: bool,
) -> dict[str, Any]:
    """Check options, and fill in defaults."""
    known = [entry["name"] for entry in uvms_gym.integrators()]
    if integrator not in known:
        raise fail(f"unknown integrator {integrator!r}; known: {', '.join(known)}")
    precisions = list(DTYPES) if dtype is None else _words("--dtype", dtype)
    for name in precisions:
        if name not in DTYPES:
            raise fail(f"--dtype has {name!r}, but knows only {', '.join(DTYPES)}")
    scenes = list(scene or SCENES)
    for name in scenes:
        if scenes.count(name) > 1:
            raise fail(f"scene {name!r} is given twice")
    repeats = (QUICK_REPEATS if quick else REPEATS) if repeats is None else repeats
    check_range("--repeats", repeats, LEAST_REPEATS, MOST_REPEATS)
    check_range("--seed", seed, 0, math.inf)
    cores = len(os.sched_getaffinity(0))
    return {
        "scene": scenes,
        "n": list(QUICK_INSTANCES if quick else INSTANCES) if n is None else _counts("--n", n, MOST_INSTANCES),
        "threads": sorted({1, cores}) if threads is None else _counts("--threads", threads, MOST_THREADS),
        "dtype": precisions,
        "lanes": None if lanes is None else _words("--lanes", lanes),
        "substeps": list(QUICK_SUBSTEPS if quick else SUBSTEPS)
        if substeps is None
        else _counts("--substeps", substeps, MOST_SUBSTEPS),
        "integrator": integrator,
        "repeats": repeats,
        "seed": seed,
        "quick": quick,
    }


def _words(option: str, given: str) -> list[str]:
    words = [word.strip() for word in given.split(",") if word.strip()]
    if not words:
        raise fail(f"{option} is empty")
    return list(dict.fromkeys(words))


def _counts(option: str, given: str, most: int) -> list[int]:
    counts = []
    for word in _words(option, given):
        if not word.removeprefix("-").isdecimal():
            raise fail(f"{option} has {word!r}, but must have whole numbers, separated by commas")
        check_range(option, int(word), 1, most)
        counts.append(int(word))
    return sorted(set(counts))


def _sections(
    loaded: Sequence[dict[str, Any]], given: bool, env: bool, with_peers: bool, sb3: bool
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Pick the scenes for environments, and those for peers."""
    acting = [scene for scene in loaded if scene["vehicle"].get("thrusters")]
    if (env or sb3) and not acting:
        raise fail(f"{loaded[0]['name']}: no scene has thrusters, so no environment acts in it")
    compared = [scene for scene in loaded if given or scene["name"] in PEER_SCENES]
    if with_peers:
        for scene in compared:
            peers.check_scene(scene)
    return acting if given else acting[:1], compared


def _many(arguments: dict[str, Any]) -> int:
    return MANY if MANY in arguments["n"] else max(arguments["n"])


@contextmanager
def _task(bar: Any, title: str, total: int) -> Iterator[Tick]:
    task = bar.add_task(title, total=total)
    yield lambda: bar.advance(task)
    bar.remove_task(task)


def _physics(loaded: Sequence[dict[str, Any]], arguments: dict[str, Any], bar: Any) -> list[dict[str, Any]]:
    """Time all cases of a scene together: memory need not hold those of all scenes."""
    repeats, rows = arguments["repeats"], []
    for scene in loaded:
        settings = [
            physics.Setting(
                scene, n, threads, dtype, substeps, arguments["integrator"], varied, lanes, arguments["seed"]
            )
            for lanes in arguments["lanes"] or [None]
            for dtype in arguments["dtype"]
            for threads in arguments["threads"]
            for n in arguments["n"]
            for substeps in arguments["substeps"]
            for varied in (False, True)
            if not varied or (n, threads, substeps) == _reference(arguments)
        ]
        with _task(bar, scene["name"], timing.rounds(len(settings), repeats)) as tick:
            rows += physics.steps(settings, repeats, tick)
    return rows


def _reference(arguments: dict[str, Any]) -> tuple[int, int, int]:
    """Instances, threads and substeps of what is measured in one place alone."""
    return _many(arguments), min(arguments["threads"]), max(arguments["substeps"])


def _environment(acting: Sequence[dict[str, Any]], arguments: dict[str, Any], bar: Any) -> dict[str, Any]:
    n, repeats, seed = _many(arguments), arguments["repeats"], arguments["seed"]
    threads, dtypes = arguments["threads"], arguments["dtype"]
    result: dict[str, Any] = {"vector": [], "single": [], "gymnasium": []}
    for scene in acting:
        total = timing.rounds(3 * len(threads) * len(dtypes), repeats)
        with _task(bar, f"{scene['name']}, make_vec", total) as tick:
            result["vector"] += environment.vector_study(scene, n, threads, dtypes, repeats, seed, tick)
        with _task(bar, f"{scene['name']}, make", repeats + 1) as tick:
            result["single"].append(environment.single_study(scene, dtypes[0], repeats, seed, tick))
        seconds = environment.QUICK_VECTOR_SECONDS if arguments["quick"] else environment.VECTOR_SECONDS
        for count in threads:
            with _task(bar, f"{scene['name']}, benchmark_vector_step", 1):
                rate = environment.gymnasium_study(scene, n, count, seconds, seed)
            row = {"scene": scene["name"], "n": n, "threads": count, "steps_per_second": rate}
            result["gymnasium"].append(row)
    return result


def _peers(compared: Sequence[dict[str, Any]], arguments: dict[str, Any], bar: Any) -> dict[str, Any]:
    n, repeats, seed, quick = _many(arguments), arguments["repeats"], arguments["seed"], arguments["quick"]
    result: dict[str, Any] = {"versions": peers.versions(), "words": peers.WORDS, "scenes": {}, "vector": []}
    for scene in compared:
        found: dict[str, Any] = {"dry_difference": peers.dry_difference(scene, seed)}
        with _task(bar, f"{scene['name']}, peers", peers.step_rounds(repeats)) as tick:
            found["step"] = peers.step_study(scene, n, max(arguments["substeps"]), repeats, seed, tick)
        with _task(bar, f"{scene['name']}, equal error", equal_error.ticks(quick)) as tick:
            found["equal_error"] = equal_error.study(scene, seed, quick, tick)
        result["scenes"][scene["name"]] = found
        if scene["vehicle"].get("thrusters"):
            total = peers.vector_rounds(len(arguments["threads"]), repeats)
            with _task(bar, f"{scene['name']}, make_vec and peers", total) as tick:
                result["vector"] += peers.vector_study(scene, n, arguments["threads"], repeats, seed, tick)
    return result


def _learning(scene: dict[str, Any], arguments: dict[str, Any], bar: Any) -> dict[str, Any]:
    iterations = learning.QUICK_ITERATIONS if arguments["quick"] else learning.ITERATIONS
    with _task(bar, f"{scene['name']}, PPO", iterations + 1) as tick:
        return learning.ppo_study(
            scene, _many(arguments), max(arguments["threads"]), iterations, arguments["seed"], tick
        )
