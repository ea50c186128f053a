"""`uvms scenes template`, `estimate` and `import`: scenes from a template, from shapes, or from a URDF file."""

from pathlib import Path
from typing import Annotated, Any

import typer

import uvms_gym
from uvms_gym.cli.common import Json, console, fail, prepare, user_errors, write_json
from uvms_gym.robots import import_with_notes

File = Annotated[
    Path | None, typer.Option("--out", metavar="FILE", help="File to write the TOML text to. [default: the terminal]")
]
Force = Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")]
_AT = "[@X,Y,Z[,ROLL,PITCH,YAW]]"


def template(out: File = None, force: Force = False) -> None:
    """Print or write a scene with every key, units and defaults in comments."""
    _write(uvms_gym.scene_template(), out, force)


def estimate(
    outline: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="TOML file of shapes: see `help(uvms_gym.estimate)`.")
    ] = None,
    box: Annotated[
        list[str] | None, typer.Option(metavar=f"X,Y,Z{_AT}", help="Edges, m, and placement; may be repeated.")
    ] = None,
    cylinder: Annotated[
        list[str] | None,
        typer.Option(metavar=f"RADIUS,LENGTH[,AXIS]{_AT}", help="m; axis x (default), y or z; may be repeated."),
    ] = None,
    capsule: Annotated[
        list[str] | None,
        typer.Option(metavar=f"RADIUS,LENGTH[,AXIS]{_AT}", help="Length without its half spheres; may be repeated."),
    ] = None,
    ellipsoid: Annotated[
        list[str] | None, typer.Option(metavar=f"A,B,C{_AT}", help="Semi-axes, m; may be repeated.")
    ] = None,
    perforation: Annotated[
        str | None, typer.Option(metavar="P[,P,P]", help="Open part of the faces, 0 to 0.5, of all axes or each.")
    ] = None,
    solidity: Annotated[
        str | None,
        typer.Option(metavar="S[,S,S]", help="Damping over that of the closed shape. [default: 1 - perforation]"),
    ] = None,
    displaced: Annotated[
        float | None, typer.Option(metavar="PART", help="Part of the envelope that displaces water. [default: 1]")
    ] = None,
    relative_density: Annotated[
        float | None, typer.Option(metavar="D", help="Mass over that of the displaced water. [default: 1]")
    ] = None,
    joined: Annotated[bool, typer.Option("--joined", help="Boxes and cylinders are parts of an arm.")] = False,
    density: Annotated[float, typer.Option(metavar="RHO", help="Density of the water, kg/m3.")] = 1000.0,
    speed: Annotated[
        str, typer.Option(metavar="V,W", help="Speeds of equal linear and quadratic damping, m/s and rad/s.")
    ] = "0.1,0.3",
    table: Annotated[str, typer.Option(metavar="KEY", help="Table of the scene.")] = "vehicle.body",
    out: File = None,
    force: Force = False,
    json_file: Json = None,
) -> None:
    """Estimate mass, buoyancy, inertia, added mass and damping from boxes, cylinders, capsules and ellipsoids.

    The text can be pasted into a scene; each number has its formula in a comment.
    """
    shapes = [
        *(_shape("--box", text, lambda numbers: {"box": numbers}) for text in box or []),
        *(_shape("--cylinder", text, lambda numbers: {"cylinder": _round(numbers)}) for text in cylinder or []),
        *(_shape("--capsule", text, lambda numbers: {"capsule": _round(numbers)}) for text in capsule or []),
        *(_shape("--ellipsoid", text, lambda numbers: {"ellipsoid": numbers}) for text in ellipsoid or []),
    ]
    if (outline is None) == (not shapes):
        raise fail("either a file of shapes or at least one of --box, --cylinder, --capsule and --ellipsoid is needed")
    given: Path | dict[str, Any]
    if outline is not None:
        given = outline
    else:
        common: dict[str, Any] = {"ends": "joined" if joined else "free"}
        for option, text in (("perforation", perforation), ("solidity", solidity)):
            if text is not None:
                numbers = _numbers(f"--{option}", text)
                common[option] = numbers[0] if len(numbers) == 1 else numbers
        for key, number in (("displaced", displaced), ("relative_density", relative_density)):
            if number is not None:
                common[key] = number
        shapes = [common | shape for shape in shapes]
        given = {"density": density, "speed": _numbers("--speed", speed), "shapes": shapes}
    prepare(None, json_file)
    with user_errors():
        found = uvms_gym.estimate(given, table=table)
    _write(found["toml"], out, force)
    if json_file is not None:
        write_json(json_file, {"table": table, "body": found["body"], "formulas": found["formulas"]})


def import_arm(
    urdf: Annotated[Path, typer.Argument(metavar="URDF", help="URDF file; a xacro file must be expanded first.")],
    vehicle: Annotated[
        str, typer.Option(metavar="SCENE", help="Scene with the water and the vehicle.")
    ] = "bluerov2-heavy",
    mount: Annotated[
        str, typer.Option(metavar="X,Y,Z,ROLL,PITCH,YAW", help="Pose of the base link in the vehicle frame, m and rad.")
    ] = "0,0,0,0,0,0",
    base: Annotated[str | None, typer.Option(metavar="LINK", help="First link. [default: the root]")] = None,
    tip: Annotated[str | None, typer.Option(metavar="LINK", help="Last link. [default: the only leaf]")] = None,
    out: File = None,
    force: Force = False,
) -> None:
    """Make a scene from a vehicle and the arm of a URDF file."""
    numbers = _numbers("--mount", mount)
    with user_errors():
        scene, notes = import_with_notes(urdf, vehicle, mount=numbers, base=base, tip=tip)
        warnings = uvms_gym.lint_scene(scene)
    heading = [f"{urdf.name} on the vehicle of {vehicle}, by uvms scenes import.", *notes]
    text = "".join(f"# {line}\n" for line in heading) + uvms_gym.dump_scene(scene)
    _write(text, out, force)
    if out is not None:
        for note in [*notes, *(f"warning: {warning}" for warning in warnings)]:
            console.print(f"- {note}", markup=False)


def _write(text: str, out: Path | None, force: bool) -> None:
    """Print a text, or write it to a file."""
    if out is None:
        print(text, end="")
        return
    if out.exists() and not force:
        raise fail(f"{out} exists: give another --out, or --force to overwrite it")
    prepare(None, out)
    with user_errors(verb="write"):
        out.write_text(text)
    console.print(f"wrote {out}", markup=False)


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise fail(f'{option} "{text}" is no vector of numbers separated by commas') from None


def _round(parts: list[Any]) -> dict[str, Any]:
    radius, length, *axis = parts
    return {"radius": radius, "length": length, "axis": axis[0] if axis else "x"}


def _shape(option: str, text: str, make: Any) -> dict[str, Any]:
    """Read one shape: dimensions and, after an @, placement."""
    dimensions, at, place = text.partition("@")
    dimensions, comma, last = dimensions.rpartition(",")
    axis = last.strip() if last.strip() in ("x", "y", "z") else None
    parts: list[Any] = _numbers(option, dimensions if axis else dimensions + comma + last)
    least = 2 if option in ("--cylinder", "--capsule") else 3
    if len(parts) != least or (axis and least == 3):
        raise fail(f'{option} "{text}" needs {least} dimensions')
    shape: dict[str, Any] = make([*parts, axis] if axis else parts)
    if at:
        pose = _numbers(option, place)
        if len(pose) not in (3, 6):
            raise fail(f'{option} "{text}" needs 3 or 6 numbers after the @')
        shape["position"] = pose[:3]
        shape["rpy"] = pose[3:] or [0.0, 0.0, 0.0]
    return shape
