"""`uvms scenes`: list, show, check. `explain` is in a module of its own."""

import math
from typing import Annotated, Any

import typer

import uvms_gym
from uvms_gym.cli.common import Json, check_range, console, fail, prepare, table, write_json

app = typer.Typer(help="List, show, check and explain scenes.", no_args_is_help=True)

Scene = Annotated[str, typer.Argument(metavar="SCENE", help="Name of a shipped scene, or path of a TOML file.")]

Speed = Annotated[
    float | None,
    typer.Option(
        metavar="SPEED",
        help="Expected speed of the vehicle along each axis, m/s and rad/s. [default: where full thrust balances drag]",
    ),
]

#: Greatest expected speed, m/s and rad/s.
MOST_SPEED = 1000.0
#: Modes that are shown.
SHOWN = 8


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
    """Show what a scene consists of, how fast it is, and where its numbers come from."""
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
    _show_rates(simulator, None)
    provenance = loaded.get("provenance", {})
    table("Provenance", ("key", "source"), sorted(provenance.items()), text_columns=2)
    if json_file is not None:
        write_json(json_file, loaded)


@app.command()
def check(scene: Scene, speed: Speed = None, json_file: Json = None) -> None:
    """Check a scene, and show its fastest modes and the steps that are stable for them.

    What is wrong with a scene is one line that names file, key and value.
    """
    if speed is not None:
        check_range("--speed", speed, 0.0, MOST_SPEED)
    loaded = read_scene(scene)
    prepare(None, json_file)
    simulator = uvms_gym.Simulator(loaded)
    console.print(f"{loaded['name']}: no fault found", markup=False)
    console.print()
    modes, steps = _show_rates(simulator, speed)
    if json_file is not None:
        data = [{**mode, "rate": [mode["rate"].real, mode["rate"].imag]} for mode in modes]
        write_json(json_file, {"scene": loaded["name"], "speed": speed, "modes": data, "stable_steps": steps})


def _show_rates(simulator: uvms_gym.Simulator, speed: float | None) -> tuple[list[Any], dict[str, dict[str, float]]]:
    """Print the fastest modes, servos on, and the stable step of each integrator; return all of them."""
    modes = simulator.modes(speed)
    choices = {"servos off": (False, False), "servos on": (True, False), "servos on, at end stops": (True, True)}
    steps = {
        name: simulator.stable_steps(speed, joint_servos=on, station=on, end_stops=stops)
        for name, (on, stops) in choices.items()
    }
    if modes:
        table(
            "Fastest modes, servos on",
            ("what moves", "state", "rate 1/s", "period s"),
            [(m["what"], m["where"], _rate(m["rate"]), _period(m["period"])) for m in modes[:SHOWN]],
            text_columns=2,
        )
    rows = [(name, *(_step(step[name]) for step in steps.values())) for name in steps["servos off"]]
    table("Greatest stable step, s", ("integrator", *choices), rows)
    return modes, steps


def _rate(rate: complex) -> str:
    return f"{rate.real:.3g}" + (f" ± {rate.imag:.3g}i" if rate.imag else "")


def _period(period: float) -> str:
    return f"{period:.3g}" if math.isfinite(period) else ""


def _step(step: float) -> str:
    return f"{step:.3g}" if math.isfinite(step) else "any"


def _numbered(names: list[str]) -> list[tuple[str, str]]:
    return [(str(i), name) for i, name in enumerate(names)]
