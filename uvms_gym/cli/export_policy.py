"""`uvms export`: neural policies as files for vehicles."""

import json
from pathlib import Path
from typing import Annotated, Any

import gymnasium
from typer import Argument, Option

from uvms_gym.cli.common import fail, line, prepare, user_errors
from uvms_gym.cli.environments import EnvKwargs, Scene, check_environment, environment_arguments
from uvms_gym.cli.options import Force, Policies, ranged
from uvms_gym.controllers import MLP
from uvms_gym.controllers.families import MLP_PREFIX
from uvms_gym.export import contract_file, export_policy
from uvms_gym.export.policy import MOST_DELAY
from uvms_gym.studies.comparison.own import make_controller


def export(
    policy: Annotated[
        str, Argument(metavar="POLICY", help="mlp:FILE, or a shipped policy such as ppo (`uvms controllers`).")
    ],
    env: Annotated[
        str | None, Option(help="Environment, by Gymnasium's id. [default: of the training, by the notes of mlp:FILE]")
    ] = None,
    scene: Scene = None,
    env_kwargs: EnvKwargs = None,
    onnx: Annotated[Path | None, Option(metavar="FILE", help="ONNX file. [default: none]")] = None,
    c: Annotated[Path | None, Option("--c", metavar="FILE", help="C file, C99. [default: none]")] = None,
    delay: Annotated[
        int, ranged("Further delay of the measurements, control periods, for faster sensors.", 0, MOST_DELAY)
    ] = 0,
    policies: Policies = None,
    force: Force = False,
) -> None:
    """Write a neural policy as ONNX or C, with a contract as JSON beside it.

    At least one of --onnx and --c is needed. Scaling, history and memory are in the file; the contract states names,
    units, frames and computation of all inputs and actions, and the conditions of the training.
    """
    files = [(option, suffix, file) for option, suffix, file in (("--onnx", ".onnx", onnx), ("--c", ".c", c)) if file]
    if not files:
        raise fail("at least one of --onnx and --c is needed")
    for option, suffix, file in files:
        if file.suffix != suffix:
            raise fail(f"{option} is {str(file)!r}, but must end in {suffix}")
        for one in (file, contract_file(file)):
            if one.exists() and not force:
                raise fail(f"{one} exists: give another {option}, or --force to overwrite it")
            prepare(None, one)
    arguments = environment_arguments(env_kwargs, scene=scene)
    if env is None:
        env, known = _trained_in(policy)
        arguments = {**known, **arguments}
    check_environment(env)
    with user_errors(f"{env}: "):
        made = gymnasium.make(env, **arguments, disable_env_checker=True)
    with user_errors():
        controller = make_controller(policy, made)
    for _, _, file in files:
        with user_errors(f"{policy}: ", verb="write"):
            contract = export_policy(controller, file, made, delay=delay)
        line(f"wrote {file} and {contract}")


def _trained_in(policy: str) -> tuple[str, dict[str, Any]]:
    """Environment of the training of `mlp:FILE`, by the notes in its file, and its arguments."""
    if not policy.startswith(MLP_PREFIX):
        raise fail(f"POLICY is {policy!r}: give its environment by --env")
    file = policy.removeprefix(MLP_PREFIX)
    with user_errors():
        notes = MLP.load(file, residual=True).notes
    if "environment" not in notes:
        raise fail(f"{file}: its notes name no environment: give --env")
    with user_errors(f"{file}: "):
        return notes["environment"], dict(json.loads(notes.get("env_kwargs", "{}")))
