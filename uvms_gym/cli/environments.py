"""Environments of commands: options that they share, and checks.

Integrator and step travel with the scene; the options `--integrator` and `--dt` of every command that simulates
override them.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any

import gymnasium
from typer import Option

from uvms_gym._core import task_defaults
from uvms_gym.cli.common import fail, user_errors
from uvms_gym.cli.options import ranged
from uvms_gym.studies.accuracy.episodes import divides
from uvms_gym.training.hyperparameters import parse_pairs

Scene = Annotated[
    str | None, Option(metavar="SCENE", help="Scene: name or TOML file. [default: the environment's, petasus-pum]")
]
EnvKwargs = Annotated[
    list[str] | None,
    Option(
        metavar="KEY:VALUE",
        help="Argument of the environment, such as substeps:5, scene:FILE.toml or disturbance:storm; may be repeated.",
    ),
]

Integrator = Annotated[str | None, Option(metavar="NAME", help="Integrator. [default: the scene's, or mk4]")]
Step = Annotated[float | None, ranged("Step, s. [default: the scene's, or 0.01]", 1e-6, 1.0, "--dt", metavar="STEP")]
#: Step of an environment, in whose control period `environment_arguments` places it.
PeriodStep = Annotated[
    float | None,
    ranged("Step, s; it divides the control period. [default: the scene's]", 1e-6, 1.0, "--dt", metavar="STEP"),
]


def stating_integration(scene: dict[str, Any], integrator: str | None, step: float | None) -> dict[str, Any]:
    """Scene that states this integrator and step, where they are given."""
    given = {key: value for key, value in (("integrator", integrator), ("step", step)) if value is not None}
    return {**scene, "integration": {**scene.get("integration", {}), **given}} if given else scene


def environment_arguments(pairs: Sequence[str] | None, **options: Any) -> dict[str, Any]:
    """Arguments of an environment, from --env-kwargs and from the options that have a name of their own.

    `pairs` are `KEY:VALUE`, where values other than Python literals are strings; `options` are values of options by the
    argument that each sets, None or empty where an option is not given.
    """
    with user_errors("--env-kwargs: "):
        arguments = parse_pairs(pairs or ())
    for name, value in options.items():
        if value is None or value == []:
            continue
        if name in arguments:
            raise fail(f"{name} is given twice: by --env-kwargs {name}:{arguments[name]} and by an option of its own")
        arguments[name] = value
    if not isinstance(given := arguments.get("scene", []), str | list):
        raise fail(f"scene is {given!r}, but must be the name of a scene or of a TOML file")
    return arguments


def with_step(
    arguments: dict[str, Any], dt: float | None, envs: Sequence[str], own: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """Arguments with the step of --dt, s, and as many of them as the environments' control period has.

    Their `own` arguments may change that period. Arguments that have a number of steps keep it.
    """
    if dt is None:
        return arguments
    if "dt" in arguments:
        raise fail(f"dt is given twice: by --env-kwargs dt:{arguments['dt']} and by an option of its own")
    if "substeps" in arguments:
        return {**arguments, "dt": dt}
    counts = {env: _substeps(env, dt, own) for env in envs}
    if len(set(counts.values())) > 1:
        raise fail(f"--dt is for environments of one control period, but {' and '.join(counts)} have different ones")
    return {**arguments, "dt": dt, "substeps": counts[envs[0]]}


def _substeps(env: str, dt: float, own: Mapping[str, Any]) -> int:
    """Number of steps in the control period of an environment."""
    period: float = _task(env, **{key: own[key] for key in ("dt", "substeps") if key in own}).control_period
    if not divides(dt, period):
        raise fail(f"--dt is {dt:g}, but must divide the control period of {env}, {period:g} s")
    return round(period / dt)


def default_step(env: str) -> float:
    """Step of an environment in a scene that states none, s."""
    step: float = task_defaults(_task(env).task)["dt"]
    return step


def _task(env: str, **arguments: Any) -> Any:
    """Environment of uvms_gym in its own scene, without wrappers."""
    check_environment(env)
    with user_errors(f"{env}: "):
        made = gymnasium.make(env, disable_env_checker=True, **arguments).unwrapped
    if not hasattr(made, "control_period"):
        raise fail(f"--env is {env!r}, but only environments of uvms_gym work, such as UVMS-StationKeep-v0")
    return made


def check_environment(env: str) -> None:
    """Refuse an id that Gymnasium does not know."""
    known = ", ".join(name for name in gymnasium.registry if name.startswith("UVMS-"))
    try:
        gymnasium.spec(env)
    except (gymnasium.error.Error, ImportError) as error:
        raise fail(f"unknown environment {env!r}; known: {known} ({' '.join(str(error).split())})") from None
