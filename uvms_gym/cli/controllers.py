"""`uvms controllers`: families of controllers, their settings, gains and stored results."""

from typing import Annotated

import gymnasium
from typer import Argument, Option

import uvms_gym
from uvms_gym.cli.common import fail, line, user_errors
from uvms_gym.cli.environments import check_environment
from uvms_gym.cli.options import Policies
from uvms_gym.cli.output import say, table
from uvms_gym.controllers.families import CONTROLLERS, FAMILIES, TASKS, canonical, is_file, names, split
from uvms_gym.studies.comparison.catalogue import SETTINGS, TEXTS, gain_texts, places, settings_table, stored


def controllers(
    name: Annotated[
        str | None, Argument(metavar="NAME", help="FAMILY or FAMILY/SETTING, with gains. [default: all families]")
    ] = None,
    env: Annotated[str | None, Option(help="Only the task of this environment, by Gymnasium's id.")] = None,
    scene: Annotated[str, Option(metavar="SCENE", help="Scene of gains, policies and results.")] = "petasus-pum",
    policies: Policies = None,
) -> None:
    """List controllers by family: their settings, what these were tuned or trained for, and stored results."""
    task = _task(env)
    if name is not None and is_file(name):
        raise fail(f"NAME is {name!r}, but must be FAMILY or FAMILY/SETTING")
    with user_errors():
        chosen = None if name is None else canonical(name, task=task)
        shown = places(task, scene)
        if not shown:
            uvms_gym.load_scene(scene)
        if name is None or chosen is None:
            _print_families(task)
            selected = [*names(task)]
        else:
            family = split(chosen)[0]
            _print_family(family)
            selected = [chosen] if "/" in name else [one for one in CONTROLLERS if split(one)[0] == family]
        for place in shown if (name, env) != (None, None) else ():
            if found := stored(selected, place):
                task_name, scene_name, period = place.parts
                title = f"{task_name}, {scene_name}, every {period.removesuffix('s')} s"
                table(title, SETTINGS, settings_table(found), text_columns=len(TEXTS))
                for one in found if name is not None else ():
                    if one.gains:
                        line(f"{one.name}: {', '.join(f'{gain}={value}' for gain, value in one.gains.items())}")
    if not shown:
        say(f"Nothing is tuned or trained for scene {scene}: classical controllers have default gains there.")
    elif chosen is None and env is None:
        say("NAME shows a family with its gains, --env ENV all controllers of a task, both with stored results.")


def _task(env: str | None) -> str | None:
    if env is None:
        return None
    check_environment(env)
    task = next((task for task, title in TASKS.items() if str(gymnasium.spec(env).name).startswith(title)), None)
    if task is None:
        raise fail(f"{env!r} is no environment of uvms_gym, such as UVMS-StationKeep-Storm-v0")
    return task


def _print_families(task: str | None) -> None:
    settings: dict[str, list[str]] = {}
    for key, setting in map(split, names(task)):
        settings.setdefault(key, []).append(f"{setting} (default)" if setting == FAMILIES[key].default else setting)
    rows = [
        (key, FAMILIES[key].about, FAMILIES[key].use, ", ".join(found) if len(found) > 1 else "")
        for key, found in settings.items()
    ]
    table("Families", ("family", "what it is", "when to use it", "settings"), rows, text_columns=4)


def _print_family(key: str) -> None:
    family = FAMILIES[key]
    line(f"{key}: {family.about}")
    line(f"Use: {family.use}")
    line(f"Tasks: {', '.join(TASKS[task] for task in family.tasks)}")
    if family.kind is not None:
        line(f"Class: uvms_gym.{family.kind.__name__}")
        table("Gains", ("gain", "meaning"), gain_texts(family.kind).items(), text_columns=2)
