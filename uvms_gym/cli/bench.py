"""`uvms bench`: time per step of the simulator, the environments, other programs and a learner."""

import itertools
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

import uvms_gym
from uvms_gym.cli import bench_report
from uvms_gym.cli.common import check_known, check_list, fail, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import Integrator, Step, stating_integration
from uvms_gym.cli.options import Json, Out, ranged, several, within
from uvms_gym.cli.output import name_files, write_results
from uvms_gym.studies.progress import tracked
from uvms_gym.studies.records import circumstances
from uvms_gym.studies.speed import derivatives, environment, equal_error, learning, peers, physics, timing
from uvms_gym.studies.speed.plots import plot_speed

FILES = ("bench.json", "bench.png")
SCENES, PEER_SCENES = (
    ("petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy"),
    ("petasus-pum", "bluerov2-heavy-alpha5"),
)
INSTANCES, QUICK_INSTANCES = (1, 64, 1024, 16384), (1, 1024)
#: Instances of sections with a single number of them, if the run has it; else the maximum.
MANY = 1024
SUBSTEPS, QUICK_SUBSTEPS = (1, 10), (10,)
DTYPES = ("float64", "float32")
REPEATS, QUICK_REPEATS = 15, 5
MOST_REPEATS = 1000


def _whole(text: str) -> int:
    if not text.removeprefix("-").isdecimal():
        raise typer.BadParameter(f"{text!r} is not a whole number")
    return int(text)


def _counts(text: str, default: str, most: int) -> Any:
    return several(text, default, "COUNT", parser=_whole, callback=within(1, most))


def bench(
    scene: Annotated[list[str] | None, several("Scene: name or TOML file", ", ".join(SCENES))] = None,
    n: Annotated[list[int] | None, _counts("Number of instances", ", ".join(map(str, INSTANCES)), 200_000)] = None,
    threads: Annotated[list[int] | None, _counts("Number of threads", "1, all cores", 1024)] = None,
    dtype: Annotated[list[str] | None, several("Precision", ", ".join(DTYPES))] = None,
    instruction_set: Annotated[
        list[str] | None, several("Instruction set, as UVMS_INSTRUCTION_SET names it", "the widest")
    ] = None,
    substeps: Annotated[list[int] | None, _counts("Steps per call", ", ".join(map(str, SUBSTEPS)), 1000)] = None,
    integrator: Integrator = None,
    dt: Step = None,
    repeats: Annotated[
        int | None, ranged(f"Rounds after a discarded one, 1 to {MOST_REPEATS}. [default: {REPEATS}]", 1, MOST_REPEATS)
    ] = None,
    seed: Annotated[int, ranged("Seed of starts, thrusts and actions.", 0)] = 0,
    quick: Annotated[bool, Option("--quick", help="Fewer cases and rounds.")] = False,
    env: Annotated[bool, Option("--env", help="Time the environments, too, vector and single.")] = False,
    with_peers: Annotated[
        bool, Option("--peers", help="Time MuJoCo and Pinocchio, too (extra `peers`), interleaved with ours.")
    ] = False,
    sb3: Annotated[bool, Option("--sb3", help="Time PPO of Stable-Baselines3, too.")] = False,
    out: Out = Path("out/bench"),
    json_file: Json = None,
) -> None:
    """Measure the time of steps by scene, instances, threads, precision, instruction set and substeps.

    All cases of a table are timed in turn, round by round: medians with quartiles. Prints tables and writes a picture
    and bench.json to --out.
    """
    check_known("integrator", [integrator] if integrator else (), [entry["name"] for entry in uvms_gym.integrators()])
    for name in dtype or ():
        if name not in DTYPES:
            raise fail(f"--dtype is {name!r}, but must be {' or '.join(DTYPES)}")
    arguments: dict[str, Any] = {
        "scene": check_list("scene", scene, SCENES),
        "n": sorted(set(n or (QUICK_INSTANCES if quick else INSTANCES))),
        "threads": sorted(set(threads or (1, len(os.sched_getaffinity(0))))),
        "dtype": list(dict.fromkeys(dtype or DTYPES)),
        "instruction_set": list(dict.fromkeys(instruction_set)) if instruction_set else None,
        "substeps": sorted(set(substeps or (QUICK_SUBSTEPS if quick else SUBSTEPS))),
        "integrator": integrator,
        "dt": dt,
        "repeats": repeats or (QUICK_REPEATS if quick else REPEATS),
        "seed": seed,
        "quick": quick,
        "env": env,
        "peers": with_peers,
        "sb3": sb3,
    }
    loaded = [stating_integration(read_scene(name), integrator, dt) for name in arguments["scene"]]
    acting, compared = _sections(loaded, scene is not None, env, with_peers, sb3)
    with user_errors():
        for module, package in peers.PACKAGES.items() if with_peers else ():
            timing.require(module, package, "peers")
        if sb3:
            timing.require("stable_baselines3", "stable-baselines3", "train")
    prepare(out, json_file, FILES)
    begun, load = time.perf_counter(), os.getloadavg()
    results: dict[str, Any] = {}
    with progress():
        with user_errors():
            results["physics"] = _physics(loaded, arguments)
            if env:
                results["environment"] = _environment(acting, arguments)
            if with_peers:
                results["peers"] = _peers(compared, arguments)
            if sb3:
                iterations = learning.QUICK_ITERATIONS if quick else learning.ITERATIONS
                count, most = _many(arguments), max(arguments["threads"])
                results["learning"] = learning.ppo_study(acting[0], count, most, iterations, seed)
        results["parameters"] = physics.parameter_costs(results["physics"])
        vector = results.get("environment", {}).get("vector", [])
        results["threads"] = physics.thread_speedups(results["physics"], vector, _many(arguments))
        run = circumstances("bench", arguments)
        run |= {"seconds": time.perf_counter() - begun, "load": {"before": load, "after": os.getloadavg()}}
        write_results(out, FILES, json_file, {"circumstances": run, "results": results})
        with user_errors(verb="write"):
            plot_speed(out / FILES[1], results, _many(arguments))
    bench_report.print_all(results, run)
    name_files(out, FILES, f" ({run['seconds']:.0f} s)")


def _sections(
    loaded: Sequence[dict[str, Any]], given: bool, env: bool, with_peers: bool, sb3: bool
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    acting = [scene for scene in loaded if scene["vehicle"].get("thrusters")]
    if (env or sb3) and not acting:
        raise fail(f"{loaded[0]['name']}: no scene has thrusters, which environments need")
    compared = [scene for scene in loaded if given or scene["name"] in PEER_SCENES]
    if with_peers:
        with user_errors("--peers: "):
            for scene in compared:
                peers.check_scene(scene)
    return acting if given else acting[:1], compared


def _many(arguments: dict[str, Any]) -> int:
    return MANY if MANY in arguments["n"] else max(arguments["n"])


def _physics(loaded: Sequence[dict[str, Any]], arguments: dict[str, Any]) -> list[dict[str, Any]]:
    """Time all cases of a scene together, scene by scene: the cases of all scenes may not fit into memory."""
    rows = []
    # Instances, threads and substeps of the cases with varied parameters.
    varied_case = (_many(arguments), min(arguments["threads"]), max(arguments["substeps"]))
    for scene in tracked(loaded, "physics"):
        choices = (arguments[key] for key in ("dtype", "threads", "n", "substeps"))
        settings = [
            physics.Setting(scene, n, threads, dtype, substeps, varied, instruction_set, arguments["seed"])
            for instruction_set, dtype, threads, n, substeps, varied in itertools.product(
                arguments["instruction_set"] or [None], *choices, (False, True)
            )
            if not varied or (n, threads, substeps) == varied_case
        ]
        rows += physics.steps(settings, arguments["repeats"])
    return rows


def _environment(acting: Sequence[dict[str, Any]], arguments: dict[str, Any]) -> dict[str, Any]:
    n, repeats, seed = _many(arguments), arguments["repeats"], arguments["seed"]
    threads, dtypes = arguments["threads"], arguments["dtype"]
    result: dict[str, Any] = {"vector": [], "single": [], "gymnasium": []}
    for scene in tracked(acting, "environments"):
        result["vector"] += environment.vector_study(scene, n, threads, dtypes, repeats, seed)
        result["single"].append(environment.single_study(scene, dtypes[0], repeats, seed))
        seconds = environment.QUICK_VECTOR_SECONDS if arguments["quick"] else environment.VECTOR_SECONDS
        for count in threads:
            rate = environment.gymnasium_study(scene, n, count, seconds, seed)
            row = {"scene": scene["name"], "n": n, "threads": count, "steps_per_second": rate}
            result["gymnasium"].append(row)
    return result


def _peers(compared: Sequence[dict[str, Any]], arguments: dict[str, Any]) -> dict[str, Any]:
    n, repeats, seed, quick = _many(arguments), arguments["repeats"], arguments["seed"], arguments["quick"]
    result: dict[str, Any] = {"versions": peers.versions(), "scope": peers.SCOPE, "scenes": {}, "vector": []}
    for scene in tracked(compared, "peers"):
        result["scenes"][scene["name"]] = {
            "dry_difference": peers.dry_difference(scene, seed),
            "step": peers.step_study(scene, n, max(arguments["substeps"]), repeats, seed),
            "equal_error": equal_error.study(scene, seed, quick),
            "derivatives": derivatives.study(scene, repeats, seed),
        }
        if scene["vehicle"].get("thrusters"):
            result["vector"] += peers.vector_study(scene, n, arguments["threads"], repeats, seed)
    return result
