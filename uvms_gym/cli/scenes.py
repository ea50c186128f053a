"""`uvms scenes`: list, show, check. `explain` is in a module of its own."""

from typing import Annotated, Any

import typer

import uvms_gym
from uvms_gym.cli.common import Json, console, fail, prepare, table, write_json

app = typer.Typer(help="List, show, check and explain scenes.", no_args_is_help=True)

Scene = Annotated[str, typer.Argument(metavar="SCENE", help="Name of a shipped scene, or path of a TOML file.")]


def read_scene(scene: str) -> dict[str, Any]:
    """Read and check a scene.

    Raises
    ------
    TyperException
        There is none, or it is wrong.
    """
    try:
        loaded: dict[str, Any] = uvms_gym.load_scene(scene)
    except ValueError as error:
        raise fail(str(error)) from None
    return loaded


@app.command("list")
def list_scenes() -> None:
    """List the scenes that come with the package."""
    rows = []
    for name in uvms_gym.scenes():
        simulator = uvms_gym.Simulator(name)
        scene = simulator.scene
        freedom = simulator.num_joints + (0 if scene["vehicle"]["fixed"] else 6)
        counts = (str(freedom), str(simulator.num_joints), str(simulator.num_thrusters))
        rows.append((name, " ".join(scene["summary"].split()).split(". ")[0].rstrip("."), *counts))
    table("Scenes", ("name", "what it is", "DoF", "joints", "thrusters"), rows, text_columns=2)


@app.command()
def show(scene: Scene, json_file: Json = None) -> None:
    """Show what a scene consists of and where its numbers come from."""
    loaded = read_scene(scene)
    prepare(None, json_file)
    simulator = uvms_gym.Simulator(loaded)
    console.print(loaded["name"], style="bold", markup=False)
    console.print(" ".join(loaded["summary"].split()), markup=False)
    console.print()
    bodies = [loaded["vehicle"]["body"]] + [link["body"] for link in loaded.get("arm", {}).get("links", [])]
    names = ["vehicle"] + [link["name"] for link in loaded.get("arm", {}).get("links", [])]
    table(
        "Bodies",
        ("body", "mass kg", "volume L"),
        [(n, f"{b['mass']:.4g}", f"{1e3 * b.get('volume', 0.0):.4g}") for n, b in zip(names, bodies, strict=True)],
    )
    if simulator.num_joints:
        table("Joints", ("index", "joint"), list(_numbered(simulator.joint_names)))
    if simulator.num_thrusters:
        rows = [
            (name, f"{low:g}", f"{high:g}")
            for name, (low, high) in zip(simulator.thruster_names, simulator.thruster_limits, strict=True)
        ]
        table("Thrusters", ("thruster", "least N", "greatest N"), rows)
    provenance = loaded.get("provenance", {})
    table("Provenance", ("key", "source"), sorted(provenance.items()), text_columns=2)
    if json_file is not None:
        write_json(json_file, loaded)


@app.command()
def check(scene: Scene) -> None:
    """Check a scene; what is wrong with it is one line that names file, key and value."""
    loaded = read_scene(scene)
    console.print(f"{loaded['name']}: no fault found", markup=False)


def _numbered(names: list[str]) -> list[tuple[str, str]]:
    return [(str(i), name) for i, name in enumerate(names)]
