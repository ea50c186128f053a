"""`uvms scenes export`: scenes as files for other programs."""

from pathlib import Path
from typing import Annotated

from typer import Option

from uvms_gym.cli.common import console, fail, read_scene
from uvms_gym.cli.options import Force, SceneArgument
from uvms_gym.cli.output import write_text
from uvms_gym.export import mjcf, urdf


def export(
    scene: SceneArgument,
    mjcf_file: Annotated[
        Path | None, Option("--mjcf", metavar="FILE", help="MJCF file, for MuJoCo. [default: none]")
    ] = None,
    urdf_file: Annotated[Path | None, Option("--urdf", metavar="FILE", help="URDF file. [default: none]")] = None,
    force: Force = False,
) -> None:
    """Write a scene as MJCF or URDF, and list what the format cannot express.

    At least one of --mjcf and --urdf is needed.
    """
    if mjcf_file is None and urdf_file is None:
        raise fail("at least one of --mjcf and --urdf is needed")
    loaded = read_scene(scene)
    for option, file, convert in (("--mjcf", mjcf_file, mjcf.export), ("--urdf", urdf_file, urdf.export)):
        if file is not None:
            text, omissions = convert(loaded)
            write_text(text, file, force, option)
            for omission in omissions:
                console.print(f"- left out: {omission}", markup=False)
