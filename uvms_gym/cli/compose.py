"""`uvms scenes compose`: a scene from a vehicle and arms."""

import os
import re
from pathlib import Path
from typing import Annotated, Any

from typer import Option

import uvms_gym
from uvms_gym.cli.common import console, fail
from uvms_gym.cli.options import Force, TextFile, placement
from uvms_gym.cli.output import write_text

_ARM = re.compile(r"(?P<name>[^=]+)=(?P<part>.+?)(@(?P<pose>[^@:]*))?(:on=(?P<on>.+))?")
_VEHICLE_HELP = "Part with the vehicle: a shipped scene, or a TOML file."
_ARM_HELP = "Name, part (a shipped one, or a TOML file) and mount, m and rad, relative to the vehicle or the LINK"


def compose(
    vehicle: Annotated[str, Option(metavar="PART", help=_VEHICLE_HELP)],
    arm: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=PART[@X,Y,Z[,ROLL,PITCH,YAW]][:on=LINK]",
            help=f"{_ARM_HELP}; may be repeated. [default: none]",
        ),
    ] = None,
    name: Annotated[str | None, Option(help="Name of the scene. [default: that of --out, or composed]")] = None,
    expand: Annotated[bool, Option("--expand", help="Write all numbers instead of the names of the parts.")] = False,
    out: TextFile = None,
    force: Force = False,
) -> None:
    """Compose a scene of a vehicle and any number of arms.

    The links of an arm are called NAME-LINK, its base NAME-base. Without a pose an arm has the mount of its part.
    """
    arms = [_arm(text) for text in arm or []]
    name = name or (out.stem if out else "composed")
    scene: dict[str, Any] = {"name": name, "vehicle": {"file": vehicle}, "arms": arms}
    try:
        loaded = uvms_gym.load_scene(scene)
        text = uvms_gym.dump_scene(loaded) if expand else _short(scene, out.parent if out else Path())
        warnings = uvms_gym.lint_scene(loaded)
    except uvms_gym.SceneError as error:
        raise fail(_of_options(str(error), arm or [])) from None
    write_text(text, out, force)
    if out is not None:
        for warning in warnings:
            console.print(f"- warning: {warning}", markup=False)


def _arm(text: str) -> dict[str, Any]:
    """Entry of `[[arms]]` for one option."""
    found = _ARM.fullmatch(text)
    if found is None:
        raise fail(f'--arm "{text}" must be NAME=PART[@X,Y,Z[,ROLL,PITCH,YAW]][:on=LINK]')
    entry: dict[str, Any] = {"name": found["name"], "file": found["part"]}
    if found["on"]:
        entry["on"] = found["on"]
    if found["pose"] is not None:
        entry["mount"] = {"frame": placement("--arm", text, found["pose"])}
    return entry


def _short(scene: dict[str, Any], folder: Path) -> str:
    """TOML text that names the parts, whose files are relative to `folder`."""

    def line(key: str, value: Any) -> str:
        if key == "file" and value.endswith(".toml"):
            value = os.path.relpath(value, folder)
        quoted = '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"' if isinstance(value, str) else value
        return f"{key} = {quoted}"

    lines = [line("name", scene["name"]), "", "[vehicle]", line("file", scene["vehicle"]["file"])]
    for arm in scene["arms"]:
        lines += ["", "[[arms]]", *(line(key, value) for key, value in arm.items() if key != "mount")]
        if "mount" in arm:
            frame = arm["mount"]["frame"]
            lines.append(f"mount.frame = {{ position = {frame['position']}, rpy = {frame['rpy']} }}")
    return "\n".join(lines) + "\n"


def _of_options(message: str, arms: list[str]) -> str:
    """Error of a composed dict, with the option in place of the key."""
    found = re.fullmatch(r"<dict>: (vehicle|arms\[(\d+)\])\.(\w+)( \([^)]*\))?(.*)", message, re.S)
    if found is None:
        return message
    key, rest = f": {found[3]}", found[5]
    part = re.fullmatch(r': is "(.*?)"(: .*)', rest, re.S)
    option = f"--arm {arms[int(found[2])]}" if found[2] else "--vehicle" + (f" {part[1]}" if part else "")
    return f"{option}{part[2]}" if found[3] == "file" and part else f"{option}{key}{rest}"
