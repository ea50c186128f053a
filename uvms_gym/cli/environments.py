"""Environments of commands: options that `train`, `play`, `compare` and `accuracy` share, and checks."""

from collections.abc import Sequence
from typing import Annotated, Any

import gymnasium
from typer import Option

from uvms_gym.cli.common import fail, read_scene, user_errors
from uvms_gym.cli.options import ranged
from uvms_gym.envs import TaskOptions
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
Step = Annotated[
    float | None,
    ranged("Step, s, in the same control period. [default: the scene's, or 0.01]", 1e-6, 1.0, "--dt", metavar="STEP"),
]


def stating_integration(arguments: dict[str, Any], integrator: str | None, step: float | None) -> dict[str, Any]:
    """Arguments of an environment whose scene states this integrator and step, where they are given."""
    given = {key: value for key, value in (("integrator", integrator), ("step", step)) if value is not None}
    if not given:
        return arguments
    scene = read_scene(arguments.get("scene", TaskOptions.scene))
    return {**arguments, "scene": {**scene, "integration": {**scene.get("integration", {}), **given}}}


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


def check_environment(env: str) -> None:
    """Refuse an id that Gymnasium does not know."""
    known = ", ".join(name for name in gymnasium.registry if name.startswith("UVMS-"))
    try:
        gymnasium.spec(env)
    except (gymnasium.error.Error, ImportError) as error:
        raise fail(f"unknown environment {env!r}; known: {known} ({' '.join(str(error).split())})") from None
