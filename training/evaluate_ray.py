"""Evaluation spread by Ray, on one machine or many: `python training/evaluate_ray.py --help`.

Controllers, scenes and levels of disturbances are crossed, and the episodes of each combination are cut into blocks.
Every block is a task of Ray that runs natively on one core. An episode depends on its seed alone, so the numbers are
the same, bit for bit, whatever the blocks, the workers and the machines; `--local` runs the same tasks without Ray.
"""

import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, NamedTuple

# Before Ray itself: it says what is missing, and keeps Ray quiet.
from ray_common import Address, connect, make_single, run  # isort: split

import gymnasium
import numpy as np
import ray
import typer

from uvms_gym.cli.common import Json, Out, check_range, circumstances, fail, prepare, progress, table, write_json
from uvms_gym.cli.scenes import read_scene
from uvms_gym.cli.statistics import Draws, Scores
from uvms_gym.controllers import Controller, registry

NAME = "evaluate_ray"
KNOWN = f"{', '.join(registry.NAMES)}, {registry.MLP_PREFIX}FILE"
MOST_EPISODES = 100_000
#: Lever that turns angles into distances in the pose error, m.
LEVER = 0.5

#: Measures of an episode, as the table has them: what is averaged, the unit, the factor to it.
MEASURES = {
    "pose_error": ("pose, m", 1.0),
    "position_error": ("position, m", 1.0),
    "attitude_error": ("attitude, rad", 1.0),
    "end_effector_position_error": ("end effector, m", 1.0),
    "effort": ("effort, %", 100.0),
}


class Combination(NamedTuple):
    """What the episodes have in common."""

    scene: str
    disturbance: str
    controller: str


class Cell(NamedTuple):
    """A block of episodes."""

    where: Combination
    first: int
    episodes: int


def episodes_of(
    env: str, options: dict[str, Any], controller: Any, steps: int, seed: int, episodes: int
) -> dict[str, np.ndarray]:
    """Run episodes of the seeds from `seed` on, natively and on one core.

    Returns
    -------
    dict of numpy.ndarray (episodes,)
        `steps`, `returns`, `diverged`; root mean squares over the steps of `pose_error` and all other errors; means of
        `effort`, `saturation` and `success`.
    """
    # Here too, for the workers: it registers the environments.
    import uvms_gym

    envs = gymnasium.make_vec(env, num_envs=episodes, **options, threads=1)
    envs.reset(seed=seed)
    rollout = uvms_gym.Rollout(envs, controller)
    rollout.run(steps)
    tally = rollout.take()
    part = "end_effector_" if envs.unwrapped.task == "ee-track" else ""
    squares = {name: total / tally.steps for name, total in tally.squares.items()}
    pose = squares[f"{part}position_error"] + LEVER**2 * squares[f"{part}attitude_error"]
    errors = ("position_error", "attitude_error", "end_effector_position_error", "end_effector_attitude_error")
    return {
        "steps": tally.steps,
        "returns": tally.returns,
        "diverged": tally.terminated,
        "pose_error": np.sqrt(pose),
        **{name: np.sqrt(squares[name]) for name in errors},
        **{name: tally.sums[name] / tally.steps for name in ("effort", "saturation", "success")},
    }


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(help=__doc__)
def evaluate(
    env: Annotated[str, typer.Option(help="Environment, by Gymnasium's id.")] = "UVMS-StationKeep-Storm-v0",
    controllers: Annotated[str, typer.Option(help=f"Any of {KNOWN}, with commas between.")] = "none,pd,pid",
    scene: Annotated[
        list[str] | None, typer.Option(help="Scene: name or TOML file; may be repeated. [default: petasus-pum]")
    ] = None,
    disturbance: Annotated[
        list[str] | None, typer.Option(help="Level of disturbances; may be repeated. [default: the environment's]")
    ] = None,
    episodes: Annotated[int, typer.Option(help=f"Episodes of each combination, 2 to {MOST_EPISODES}.")] = 1024,
    seed: Annotated[int, typer.Option(help="Episode i has the seed SEED + i.")] = 0,
    block: Annotated[int, typer.Option(help="Episodes of one task of Ray.")] = 256,
    workers: Annotated[
        int | None, typer.Option(help="Most tasks at once on this machine. [default: its cores]")
    ] = None,
    address: Address = None,
    local: Annotated[bool, typer.Option("--local", help="Without Ray, one task after another.")] = False,
    out: Out = Path("out/evaluate"),
    json_file: Json = None,
) -> None:
    """Evaluate."""
    check_range("--episodes", episodes, 2, MOST_EPISODES)
    check_range("--seed", seed, 0, 2**63)
    check_range("--block", block, 1, MOST_EPISODES)
    if workers is not None:
        check_range("--workers", workers, 1, 1024)
        if address:
            raise fail("--workers is for this machine: a cluster has its own")
    scenes, levels = _unlike("--scene", scene or ["petasus-pum"]), _unlike("--disturbance", disturbance or [""])
    names = _unlike("--controllers", [name.strip() for name in controllers.split(",") if name.strip()])
    if not names:
        raise fail(f"no controllers given; known: {KNOWN}")
    given: dict[Combination, tuple[dict[str, Any], Controller]] = {}
    for name in scenes:
        loaded = read_scene(name)
        for level in levels:
            options = {"scene": loaded, **({"disturbance": level} if level else {})}
            single = make_single(env, options)
            for controller in names:
                steps = single.spec.max_episode_steps
                where = Combination(name, level or str(single.unwrapped.options.get("disturbance")), controller)
                given[where] = options, _controller(controller, single)
    prepare(out, json_file, ("evaluate.json",))

    cells = [Cell(where, first, min(block, episodes - first)) for where in given for first in range(0, episodes, block)]
    started = time.perf_counter()
    found: dict[Cell, dict[str, np.ndarray]] = {}
    if not local:
        connect(address, num_cpus=workers)
    with progress() as bar:
        task = bar.add_task("episodes", total=episodes * len(given))
        arguments = {cell: (env, *given[cell.where], steps, seed + cell.first, cell.episodes) for cell in cells}
        for cell, result in _here(arguments) if local else _spread(arguments):
            found[cell] = result
            bar.advance(task, cell.episodes)
    results, draws = [], Draws(episodes, seed)
    for where in given:
        blocks = [found[cell] for cell in cells if cell.where == where]
        runs = {name: np.concatenate([part[name] for part in blocks]) for name in blocks[0]}
        estimates = {name: Scores(runs[name], draws).statistics()[0].estimate() for name in MEASURES}
        results.append({**where._asdict(), "estimates": estimates, "runs": runs})
    data = {
        "circumstances": circumstances(NAME, {"env": env, "episodes": episodes, "seed": seed}),
        "seconds": time.perf_counter() - started,
        "results": results,
    }
    for path in {out / "evaluate.json", json_file or out / "evaluate.json"}:
        write_json(path, data)
    rows = [
        (
            *(result[name] for name in Combination._fields),
            *(f"{factor * result['estimates'][name].value:.4g}" for name, (_, factor) in MEASURES.items()),
            str(int(result["runs"]["diverged"].sum())),
        )
        for result in results
    ]
    header = (*Combination._fields, *(label for label, _ in MEASURES.values()), "diverged")
    table(f"{env}: {episodes} episodes, interquartile means", header, rows, text_columns=3)
    typer.echo(f"{out}: evaluate.json, in {data['seconds']:.1f} s")


Arguments = dict[Cell, tuple[Any, ...]]


def _here(arguments: Arguments) -> Iterator[tuple[Cell, dict[str, np.ndarray]]]:
    for cell, given in arguments.items():
        yield cell, episodes_of(*given)


def _spread(arguments: Arguments) -> Iterator[tuple[Cell, dict[str, np.ndarray]]]:
    """Run the cells wherever there are cores, in no order."""
    remote = ray.remote(num_cpus=1)(episodes_of)
    running = {remote.remote(*given): cell for cell, given in arguments.items()}
    while running:
        (done, *_), _ = ray.wait(list(running))
        try:
            yield running.pop(done), ray.get(done)
        except ray.exceptions.RayError as error:
            raise fail(f"a task failed: {str(error).strip().splitlines()[-1]}") from None


def _unlike(option: str, given: Iterable[str]) -> list[str]:
    names = list(given)
    for name in names:
        if names.count(name) > 1:
            raise fail(f"{option}: {name!r} is given twice")
    return names


def _controller(name: str, env: gymnasium.Env) -> Controller:
    """Make a controller by its name; it travels to the workers, files and all."""
    try:
        return registry.make_controller(name, env)
    except OSError as error:
        raise fail(f"cannot read {error.filename}: {error.strerror}") from None
    except (ValueError, TypeError) as error:
        raise fail(str(error)) from None


if __name__ == "__main__":
    raise SystemExit(run(app, NAME))
