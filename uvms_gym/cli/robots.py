"""`uvms scenes template`, `estimate` and `import`: scenes from a template, from shapes, or from a robot's file."""

import re
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

import uvms_gym
from uvms_gym.cli.common import console, fail, prepare, user_errors
from uvms_gym.cli.options import Force, Json, TextFile, placement, vector
from uvms_gym.cli.output import write_json, write_text
from uvms_gym.robots import import_with_notes


def _shapes(dimensions: str, text: str) -> Any:
    return Option(metavar=f"{dimensions}[@X,Y,Z[,ROLL,PITCH,YAW]]", help=f"{text}; may be repeated.")


def template(out: TextFile = None, force: Force = False) -> None:
    """Print or write a scene with every key, units and defaults in comments."""
    write_text(uvms_gym.scene_template(), out, force)


def estimate(
    outline: Annotated[
        Path | None, Argument(metavar="FILE", help="TOML file of shapes: see `help(uvms_gym.estimate)`.")
    ] = None,
    box: Annotated[list[str] | None, _shapes("X,Y,Z", "Edges, m, and placement")] = None,
    cylinder: Annotated[list[str] | None, _shapes("RADIUS,LENGTH[,AXIS]", "m; axis x (default), y or z")] = None,
    capsule: Annotated[list[str] | None, _shapes("RADIUS,LENGTH[,AXIS]", "Length without its half spheres")] = None,
    ellipsoid: Annotated[list[str] | None, _shapes("A,B,C", "Semi-axes, m")] = None,
    perforation: Annotated[
        str | None,
        Option(metavar="P[,P,P]", help="Open part of the faces, 0 to 0.5, of all axes or each. [default: 0]"),
    ] = None,
    solidity: Annotated[
        str | None, Option(metavar="S[,S,S]", help="Damping relative to the closed shape. [default: 1 - perforation]")
    ] = None,
    displaced: Annotated[
        float | None, Option(metavar="PART", help="Part of the envelope that displaces water. [default: 1]")
    ] = None,
    relative_density: Annotated[
        float | None, Option(metavar="D", help="Mass relative to the displaced water. [default: 1]")
    ] = None,
    joined: Annotated[bool, Option("--joined", help="Boxes and cylinders are parts of an arm.")] = False,
    density: Annotated[float, Option(metavar="RHO", help="Density of the water, kg/m3.")] = 1000.0,
    speed: Annotated[
        str, Option(metavar="V,W", help="Speeds of equal linear and quadratic damping, m/s and rad/s.")
    ] = "0.1,0.3",
    table: Annotated[str, Option(metavar="KEY", help="Table of the scene.")] = "vehicle.body",
    out: TextFile = None,
    force: Force = False,
    json_file: Json = None,
) -> None:
    """Estimate mass, buoyancy, inertia, added mass and damping from boxes, cylinders, capsules and ellipsoids.

    The text can be pasted into a scene; each number has its formula in a comment.
    """
    kinds = {"box": box, "cylinder": cylinder, "capsule": capsule, "ellipsoid": ellipsoid}
    shapes = [_shape(kind, text) for kind, texts in kinds.items() for text in texts or []]
    if (outline is None) == (not shapes):
        raise fail("either a file of shapes or at least one of --box, --cylinder, --capsule and --ellipsoid is needed")
    given: Path | dict[str, Any] | None = outline
    if given is None:
        common: dict[str, Any] = {"ends": "joined" if joined else "free"}
        for option, text in (("perforation", perforation), ("solidity", solidity)):
            if text is not None:
                numbers = vector(f"--{option}", text)
                common[option] = numbers[0] if len(numbers) == 1 else numbers
        factors = {"displaced": displaced, "relative_density": relative_density}
        common |= {key: number for key, number in factors.items() if number is not None}
        shapes = [common | shape for shape in shapes]
        given = {"density": density, "speed": vector("--speed", speed), "shapes": shapes}
    prepare(None, json_file)
    with user_errors():
        try:
            found = uvms_gym.estimate(given, table=table)
        except uvms_gym.SceneError as error:
            raise _of_options(error, box, cylinder, capsule, ellipsoid) from None
    write_text(found["toml"], out, force)
    if json_file is not None:
        write_json(json_file, {"table": table, "body": found["body"], "formulas": found["formulas"]})


def _of_options(error: Exception, *texts: list[str] | None) -> Exception:
    """Error of a shape, with the option in place of its place in the data."""
    given = [text for one in texts for text in one or []]
    found = re.match(r"<dict>: shapes\[(\d+)\]\.(\w+)(.*)", str(error), re.S)
    if found is None:
        return error
    shape = f" {given[int(found[1])]}" if found[2] in ("box", "cylinder", "capsule", "ellipsoid") else ""
    return ValueError(f"--{found[2].replace('_', '-')}{shape}{found[3]}")


def import_robot(
    file: Annotated[Path, Argument(metavar="FILE", help="URDF, SDF, MJCF or YAML file; xacro must be expanded first.")],
    vehicle: Annotated[
        str | None,
        Option(
            metavar="SCENE",
            help="Scene whose vehicle takes the place of the file's. [default: under an arm alone bluerov2-heavy, or "
            "rexrov if the arm weighs more than a quarter of it]",
        ),
    ] = None,
    thrusters: Annotated[
        str | None,
        Option(
            metavar="file|assumed|SCENE",
            help="Thrusters of a vehicle in the file. [default: the file's; assumed ones if it states none]",
        ),
    ] = None,
    mount: Annotated[
        str | None,
        Option(
            metavar="X,Y,Z,ROLL,PITCH,YAW",
            help="Pose of the first link on that vehicle, m and rad. [default: 0]",
        ),
    ] = None,
    base: Annotated[
        str | None, Option(metavar="LINK", help="First link of the robot. [default: the one without parent]")
    ] = None,
    tip: Annotated[
        list[str] | None,
        Option(
            metavar="[NAME=]LINK", help="Link that is an end effector; may be repeated. [default: the ends of the arms]"
        ),
    ] = None,
    lock: Annotated[
        list[str] | None, Option(metavar="JOINT", help="Joint to freeze; may be repeated. [default: none]")
    ] = None,
    keep: Annotated[
        list[str] | None,
        Option(metavar="JOINT", help="Joint that moves, no others do; may be repeated. [default: all]"),
    ] = None,
    density: Annotated[
        list[str] | None,
        Option(
            metavar="[LINK=]RHO",
            help="Density, kg/m3, of a link or of all without mass; may be repeated. [default: none]",
        ),
    ] = None,
    out: TextFile = None,
    force: Force = False,
) -> None:
    """Make a scene from a robot's file: a vehicle with its arms, a vehicle alone, or an arm on a vehicle.

    Notes list all that was guessed, merged, frozen or left out, by link or joint. With --out they are printed; they are
    comments at the top of the text, too.
    """
    pose = None if mount is None else vector("--mount", mount)
    densities = [_density(text) for text in density or ()]
    chosen: dict[str, Any] = {
        "thrusters": thrusters,
        "tip": tip,
        "lock": lock or (),
        "keep": keep or (),
        "density": densities,
    }
    with user_errors():
        scene, notes = import_with_notes(file, vehicle=vehicle, mount=pose, base=base, **chosen)
        warnings = uvms_gym.lint_scene(scene)
    notes = _together(notes)
    text = "".join(f"# {line}\n" for line in [f"{file.name}, by uvms scenes import.", *notes])
    write_text(text + uvms_gym.dump_scene(scene), out, force)
    if out is not None:
        for note in [*notes, *(f"warning: {warning}" for warning in warnings)]:
            console.print(f"- {note}", markup=False)


def _together(notes: list[str]) -> list[str]:
    """Notes with the same text in one line, which begins with all their links or joints."""
    names: dict[str, list[str]] = {}
    for note in notes:
        name, _, text = note.partition(": ")
        names.setdefault(text or note, []).append(name)
    return [f"{', '.join(found)}: {text}" if text not in found else text for text, found in names.items()]


def _density(text: str) -> tuple[str | None, float]:
    link, equals, number = text.rpartition("=")
    try:
        return link if equals else None, float(number)
    except ValueError:
        raise fail(f'--density "{text}" is not [LINK=]NUMBER') from None


def _shape(kind: str, text: str) -> dict[str, Any]:
    """Read one shape: dimensions and, after an @, placement."""
    option = f"--{kind}"
    dimensions, at, place = text.partition("@")
    given, _, last = dimensions.rpartition(",")
    axis = last.strip() if last.strip() in ("x", "y", "z") else None
    numbers = vector(option, given if axis else dimensions)
    is_round = kind in ("cylinder", "capsule")
    minimum = 2 if is_round else 3
    if len(numbers) != minimum or (axis and not is_round):
        raise fail(f'{option} "{text}" needs {minimum} dimensions')
    size: Any = {"radius": numbers[0], "length": numbers[1], "axis": axis or "x"} if is_round else numbers
    shape: dict[str, Any] = {kind: size}
    if at:
        shape |= placement(option, text, place)
    return shape
