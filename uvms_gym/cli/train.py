"""`uvms train`: policies from teachers, by proximal policy optimisation and by gradients of the simulator."""

import contextlib
import itertools
import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from uvms_gym._files import write
from uvms_gym.cli.common import fail, hold, line, need, prepare, progress, read_scene, user_errors
from uvms_gym.cli.environments import (
    EnvKwargs,
    Integrator,
    PeriodStep,
    check_environment,
    default_step,
    environment_arguments,
    with_step,
)
from uvms_gym.cli.options import ranged
from uvms_gym.studies.records import circumstances

if TYPE_CHECKING:
    from uvms_gym.training.run import Settings

#: Packages of the extra `train`, by module.
NEEDS = {"stable_baselines3": "stable-baselines3", "yaml": "pyyaml", "tensorboard": "tensorboard"}
#: Algorithms that run alone.
SINGLE = ("ppo", "distill", "asymmetric-ppo", "shac")
#: Default number of evaluations and of checkpoints in a run.
PARTS = 10


def train(
    algo: Annotated[
        Literal["recommended", "ppo", "distill", "asymmetric-ppo", "shac"],
        Option(
            help="recommended: the recipe for environment and scene, of the algorithms below in turn. "
            "ppo: PPO of Stable-Baselines3. distill: imitation of a classical controller with perfect sensors. "
            "asymmetric-ppo: PPO whose critic has perfect sensors, on paired episodes, from scratch or from --start. "
            "shac: gradients through the simulator, for all tasks but docking, from scratch or from --start."
        ),
    ] = "recommended",
    env: Annotated[str, Option(help="Environment, by Gymnasium's id.")] = "UVMS-StationKeep-Storm-v0",
    n_timesteps: Annotated[
        int | None,
        ranged("Steps of all instances together. [default: from the YAML file]", 1, 1e15, "-n", "--n-timesteps"),
    ] = None,
    n_envs: Annotated[int | None, Option(help="Instances. [default: from the YAML file]")] = None,
    seed: Annotated[int | None, ranged("Training seed. [default: 0]", 0, 2**31 - 1)] = None,
    base: Annotated[
        str | None, Option(metavar="CONTROLLER", help="Learn corrections to this controller, such as pd.")
    ] = None,
    residual: Annotated[
        float | None, ranged("Maximum correction with --base, 0 to 1. [default: 0.3]", 0.0, 1.0, metavar="LIMIT")
    ] = None,
    teacher: Annotated[
        str | None,
        Option(metavar="CONTROLLER", help="Controller to distill: classical, or mlp:FILE. [default: the strongest]"),
    ] = None,
    start: Annotated[
        Path | None, Option(metavar="FILE", help="Policy (.safetensors) that asymmetric-ppo or shac begins with.")
    ] = None,
    env_kwargs: EnvKwargs = None,
    integrator: Integrator = None,
    dt: PeriodStep = None,
    hyperparams: Annotated[
        list[str] | None,
        Option(
            "-params", "--hyperparams", metavar="KEY:VALUE", help="Hyperparameter, such as gamma:0.95; may be repeated."
        ),
    ] = None,
    conf_file: Annotated[
        Path | None,
        Option(
            "-conf", "--conf-file", metavar="FILE", help="Hyperparameters, rl_zoo3's YAML. [default: the package's]"
        ),
    ] = None,
    eval_freq: Annotated[
        int | None,
        Option(
            help="Steps between evaluations; negative: only at the end, of a recipe at that of each stage. "
            "[default: a tenth of all; of a recipe -1]"
        ),
    ] = None,
    eval_episodes: Annotated[
        int | None, ranged("Held-out episodes of an evaluation. [default: 512]", 2, 100_000)
    ] = None,
    save_freq: Annotated[
        int | None, Option(help="Steps between checkpoints; negative: only at the end. [default: a tenth of all]")
    ] = None,
    log_folder: Annotated[
        Path, Option("-f", "--log-folder", metavar="DIR", help="Parent of the run's folder, ALGO/ENV_1 and so on.")
    ] = Path("out/train"),
    tensorboard_log: Annotated[
        Path | None, Option("-tb", "--tensorboard-log", metavar="DIR", help="Folder for TensorBoard.")
    ] = None,
    trained_agent: Annotated[
        Path | None,
        Option(
            "-i",
            "--trained-agent",
            metavar="PATH",
            help="Run's folder, or a checkpoint there, to resume with its settings: to the end, or to -n steps. "
            "Of a folder the checkpoint with the most steps; without one the run starts anew.",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        Option(
            metavar="FILE", help="Also write the policy here (.safetensors) at the end of the run, and a model card."
        ),
    ] = None,
    num_threads: Annotated[
        int | None, ranged("Threads of the environment, and of torch in ppo; -1: all. [default: 1]", -1, 1024)
    ] = None,
    device: Annotated[str | None, Option(help="Device of torch. [default: cpu]")] = None,
    show_progress: Annotated[bool, Option("--progress/--no-progress", "-P/", help="Show a bar, on a terminal.")] = True,
    verbose: Annotated[
        int, ranged("0: only the result; 1: evaluations; 2: the log of Stable-Baselines3, too.", 0, 2)
    ] = 1,
) -> int:
    """Train a policy, evaluate it on held-out episodes, and export it.

    Ctrl-C, or SIGTERM, stops it after the current iteration with everything saved, and exit status 130; a second one
    ends it at once. -i resumes the run, also after a kill, with bit-identical weights at the end.
    """
    need(NEEDS, "train")
    if export is not None and export.suffix != ".safetensors":
        raise fail(f"--export is {str(export)!r}, but must end in .safetensors")
    if num_threads == 0:
        raise fail("--num-threads is 0, but must be at least 1, or -1 for all")
    if trained_agent is not None:
        fixed = {
            "--n-envs": n_envs,
            "--seed": seed,
            "--base": base,
            "--residual": residual,
            "--teacher": teacher,
            "--start": start,
            "--env-kwargs": env_kwargs,
            "--integrator": integrator,
            "--dt": dt,
            "--hyperparams": hyperparams,
            "--conf-file": conf_file,
        }
        if wrong := next((option for option, value in fixed.items() if value is not None), None):
            raise fail(f"{wrong} cannot be given with --trained-agent, which has its own settings")
        settings, folder, agent = _resumed(trained_agent)
    else:
        if residual is not None and base is None:
            raise fail("--residual is for --base")
        for option, value, owners in (
            ("--base", base, ("ppo",)),
            ("--device", device, ("ppo",)),
            ("--teacher", teacher, ("distill",)),
            ("--start", start, ("asymmetric-ppo", "shac")),
            ("--hyperparams", hyperparams, SINGLE),
            ("--n-envs", n_envs, SINGLE),
        ):
            if value is not None and algo not in owners:
                raise fail(f"{option} is for --algo {' or '.join(owners)}")
        from uvms_gym.envs import TaskOptions
        from uvms_gym.training.hyperparameters import give_way, parse_pairs, read_hyperparameters
        from uvms_gym.training.run import Settings

        check_environment(env)
        with user_errors():
            pairs = parse_pairs(hyperparams or ())
            variant = "residual" if base is not None else "start" if start is not None else None
            found = read_hyperparameters(env, conf_file, variant=variant, algo=algo)
        arguments = environment_arguments(env_kwargs, integrator=integrator)
        arguments = with_step(arguments, dt, [env], found.get("env_kwargs", {}))
        scene = read_scene(arguments.get("scene", TaskOptions.scene))
        usual = default_step(env) if "step" in scene.get("integration", {}) else None
        if algo == "recommended":
            from uvms_gym.training.recommended import read_recipe, rescaled

            with user_errors():
                found = read_recipe(env, scene["name"], conf_file, arguments=arguments, step=usual)
                if n_timesteps is not None:
                    found, n_timesteps = rescaled(found, n_timesteps), None
        else:
            found = give_way(found, arguments, usual) | pairs
        if n_envs is not None:
            found["n_envs"] = n_envs
        settings = Settings(env, found, arguments, seed or 0, base, algo=algo, teacher=teacher)
        folder, agent = log_folder, None
    if n_timesteps is not None:
        if settings.algo == "recommended":
            raise fail("-n cannot be given with the folder of a recommended run: its stages have their own steps")
        settings = replace(settings, hyperparameters=settings.hyperparameters | {"n_timesteps": n_timesteps})
    with user_errors():
        # Evaluations and checkpoints in every tenth of a new run.
        tenth = max(1, math.ceil(settings.steps / PARTS))
    often = -1 if settings.algo == "recommended" else tenth
    given: dict[str, Any] = {
        "start": start and str(start.resolve()),
        "limit": residual,
        "eval_freq": often if eval_freq is None and settings.eval_freq == 0 else eval_freq,
        "save_freq": tenth if save_freq is None and settings.save_freq == 0 else save_freq,
        "eval_episodes": eval_episodes,
        "num_threads": num_threads,
        "device": device,
    }
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    prepare(None, export)
    for logs in (log_folder if trained_agent is None else None, tensorboard_log):
        prepare(logs, None)
    if trained_agent is not None:
        hold(folder)
        from uvms_gym.training.finished import is_finished
        from uvms_gym.training.run import POLICY

        if export is not None and n_timesteps is None and is_finished(folder / POLICY):
            _export(folder / POLICY, export)
            return 0
    return _run(settings, folder, trained_agent is None, agent, export, tensorboard_log, show_progress, verbose)


def _run(
    settings: "Settings",
    folder: Path,
    new: bool,
    agent: Path | None,
    export: Path | None,
    tensorboard_log: Path | None,
    show_progress: bool,
    verbose: int,
) -> int:
    if settings.algo == "ppo":
        from uvms_gym.training.ppo import check, train
    elif settings.algo == "recommended":
        from uvms_gym.training.recommended import check, summary, train

        line(f"recommended: {summary(settings.hyperparameters)}. {settings.hyperparameters['why']}")
    else:
        from uvms_gym.training.native import check, train

    from uvms_gym.training.export import weights_hash

    here = circumstances("train", {})
    origin = {"commit": here["commit"] or f"release {here['uvms_gym']}", "processor": here["machine"]["processor"]}
    with progress() as bar:
        bar.disable = bar.disable or not show_progress
        task = bar.add_task("training", total=settings.steps)

        def report(found: dict[str, Any]) -> None:
            bar.update(task, completed=found["steps"])
            if verbose:
                text = f"{found['steps']:>9d} steps {found['seconds']:6.1f} s  {_scores(found)}"
                bar.console.print(text, markup=False, soft_wrap=True, highlight=False)

        with user_errors(f"{settings.env}: ", "read or write", AssertionError, RuntimeError):
            if not new and verbose and settings.algo != "recommended":
                line(f"resuming {agent}" if agent else f"{folder} has no checkpoint: starting anew")
            if new:
                # Errors show before the folder is made.
                check(settings)
                folder = _new_folder(folder, settings)
                hold(folder)
            outcome = train(
                settings,
                folder,
                agent=agent,
                tensorboard_log=tensorboard_log,
                verbose=int(verbose > 1),
                origin=origin,
                tick=partial(bar.advance, task),
                report=report,
            )
    rate = outcome.steps / outcome.seconds
    # Algorithms end with a whole iteration.
    more = f", {settings.steps} asked and the last iteration completed" if outcome.steps > settings.steps else ""
    line(f"{outcome.steps} steps{more}, in {outcome.seconds:.0f} s ({rate:.0f} per second)")
    line(f"held-out episodes: {_scores(outcome.evaluation)}")
    files = [outcome.policy, outcome.checkpoint, outcome.policy.with_name("README.md")]
    line(f"{folder}: {', '.join(str(file.relative_to(folder)) for file in files)}")
    line(f"weights: sha256 {weights_hash(outcome.policy)}")
    if not outcome.finished:
        line(f"stopped; to resume: uvms train -i {folder}" + (f" --export {export}" if export is not None else ""))
        return 130
    if export is not None:
        _export(outcome.policy, export)
    return 0


def _export(policy: Path, export: Path) -> None:
    from uvms_gym.training.export import write_card

    with user_errors(verb="read or write"):
        write(export, policy.read_bytes())
        write_card(export.parent)
    line(str(export))


def _resumed(agent: Path) -> tuple["Settings", Path, Path | None]:
    """Settings, folder and checkpoint of a run; None: it was stopped before its first checkpoint."""
    from uvms_gym.training.run import POLICY, Settings, latest_checkpoint

    with user_errors():
        # The error names the missing file.
        agent.stat()
        folder = agent if agent.is_dir() else agent.parent
        settings = Settings.load(folder)
    if not agent.is_dir():
        return settings, folder, agent
    if settings.algo == "recommended":
        return settings, folder, None
    try:
        return settings, folder, latest_checkpoint(folder)
    except ValueError as error:
        if (folder / POLICY).exists():
            raise fail(str(error)) from None
        return settings, folder, None


def _new_folder(logs: Path, settings: "Settings") -> Path:
    """Make the folder of a run, with the first free number."""
    name = settings.algo if settings.base is None else f"{settings.algo}-{settings.base.replace('/', '-')}"
    for number in itertools.count(1):
        with contextlib.suppress(FileExistsError):
            (folder := logs / name / f"{settings.env}_{number}").mkdir(parents=True)
            break
    return folder


def _scores(found: dict[str, Any]) -> str:
    success = f"success {100 * found['success']:.1f} %  " if "success" in found else ""
    return (
        f"{success}pose {found['pose']:.4f} m (95 %: {found['pose_95']:.4f} m)  effort {found['effort']:.4f}  "
        f"variation {found['variation']:.4f}"
    )
