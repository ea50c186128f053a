"""`uvms scenes`: list, show, check. The other subcommands are in `explain` and `robots`."""

import math
from typing import Annotated, Any

import typer
from typer import Option

import uvms_gym
from uvms_gym.cli.common import console, fail, prepare, read_scene
from uvms_gym.cli.options import Json, SceneArgument, ranged
from uvms_gym.cli.output import say, table, write_json
from uvms_gym.studies.numerics import bodies, buoyancy_of

Speed = Annotated[
    float | None,
    ranged(
        "Expected speed of the vehicle along each axis, m/s and rad/s. [default: where full thrust balances drag]",
        0.0,
        1000.0,
        metavar="SPEED",
    ),
]

#: Number of modes in tables.
SHOWN = 8
#: Default integrator and step of the environments, s.
DEFAULT = ("mk4", 0.01)
#: Steps that can be recommended, s.
STEPS = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001)


def list_scenes() -> None:
    """List the shipped scenes."""
    rows = []
    for name in uvms_gym.scene_names():
        simulator = uvms_gym.Simulator(name)
        summary = " ".join(simulator.scene["summary"].split()).split(". ")[0].rstrip(".")
        rows.append((name, summary, _freedom(simulator), simulator.num_joints, simulator.num_thrusters))
    table("Scenes", ("name", "description", "DoF", "joints", "thrusters"), rows, text_columns=2)


def show(scene: SceneArgument, json_file: Json = None) -> None:
    """Show a scene's bodies, joints, thrusters, fastest modes and the sources of its numbers."""
    loaded = read_scene(scene)
    prepare(None, json_file)
    simulator = uvms_gym.Simulator(loaded)
    console.print(loaded["name"], style="bold", markup=False)
    console.print(" ".join(loaded["summary"].split()), markup=False)
    console.print()
    water, links = loaded["water"], loaded.get("arm", {}).get("links", [])
    named = [("vehicle", loaded["vehicle"]["body"]), *((link["name"], link["body"]) for link in links)]
    rows: list[tuple[str, ...]] = []
    for name, body in named:
        buoyancy, of_litre = buoyancy_of(body, water), buoyancy_of({"volume": 1e-3}, water)
        # Scenes give the volume or the buoyancy.
        volume = 1e3 * body["volume"] if "volume" in body else buoyancy / of_litre if of_litre else 0.0
        rows.append((name, f"{body['mass']:.4g}", f"{volume:.4g}", f"{buoyancy:.4g}"))
    table("Bodies", ("body", "mass kg", "volume L", "buoyancy N"), rows)
    if simulator.num_joints:
        table("Joints", ("index", "joint"), enumerate(simulator.joint_names))
    if simulator.num_thrusters:
        rows = [
            (name, f"{low:g}", f"{high:g}")
            for name, (low, high) in zip(simulator.thruster_names, simulator.thruster_limits, strict=True)
        ]
        table("Thrusters", ("thruster", "minimum N", "maximum N"), rows)
    _show_rates(simulator, None)
    provenance = loaded.get("provenance", {})
    table("Provenance", ("key", "source"), sorted(provenance.items()), text_columns=2)
    if json_file is not None:
        write_json(json_file, loaded)


def check(
    scene: SceneArgument,
    speed: Speed = None,
    strict: Annotated[bool, Option("--strict", help="Exit status 1 if there are warnings.")] = False,
    json_file: Json = None,
) -> None:
    """Check a scene, and show its warnings, balance, fastest modes and stable steps.

    A fault is one line with file, key and value, and exit status 2.
    """
    loaded = read_scene(scene)
    prepare(None, json_file)
    try:
        simulator = uvms_gym.Simulator(loaded)
    except ValueError as error:
        raise fail(f"{scene}: {error}") from None
    found = uvms_gym.lint_scene(loaded)
    balance = _balance(simulator)
    steps = simulator.stable_steps(speed)
    maximum = steps[DEFAULT[0]]
    if maximum < DEFAULT[1]:
        fastest = [mode["what"] for mode in simulator.modes(speed) if not mode["end_stop"]]
        what = f"the environments' step of {DEFAULT[1]:g} s is unstable, the maximum stable one is {maximum:.2g} s"
        found.append(f"{fastest[0] if fastest else 'end stops'}: {what}")
    step = next((step for step in STEPS if 1.5 * step <= maximum), None)
    console.print(f"{loaded['name']}: no fault found", markup=False)
    for warning in found:
        console.print(f"warning: {warning}", markup=False)
    console.print()
    rows = [(name, f"{value:.6g}") for name, value in balance.items()]
    advice = f"{step:g}" if step is not None else "none: too stiff"
    table("Summary", ("", ""), [*rows, ("recommended step of mk4, s", advice)])
    modes, steps_shown = _show_rates(simulator, speed)
    if json_file is not None:
        data = [{**mode, "rate": [mode["rate"].real, mode["rate"].imag]} for mode in modes]
        summary = {"scene": loaded["name"], "speed": speed, "warnings": found, "summary": balance}
        write_json(json_file, {**summary, "recommended_step": step, "modes": data, "stable_steps": steps_shown})
    if strict and found:
        raise typer.Exit(1)


def _freedom(simulator: uvms_gym.Simulator) -> int:
    return simulator.num_joints + (0 if simulator.scene["vehicle"]["fixed"] else 6)


def _balance(simulator: uvms_gym.Simulator) -> dict[str, float]:
    scene = simulator.scene
    mass = sum(body["mass"] for body in bodies(scene))
    weight = mass * math.hypot(*scene["water"]["gravity"])
    buoyancy = sum(buoyancy_of(body, scene["water"]) for body in bodies(scene))
    return {
        "degrees of freedom": _freedom(simulator),
        "joints": simulator.num_joints,
        "thrusters": simulator.num_thrusters,
        "mass, kg": mass,
        "weight, N": weight,
        "buoyancy, N": buoyancy,
        "net weight in water, N": weight - buoyancy,
    }


def _show_rates(simulator: uvms_gym.Simulator, speed: float | None) -> tuple[list[Any], dict[str, dict[str, float]]]:
    """Print the fastest modes, servos on, and the stable steps of all integrators; return modes and steps."""
    modes = simulator.modes(speed)
    choices = {"servos off": (False, False), "servos on": (True, False), "servos on, at end stops": (True, True)}
    steps = {
        name: simulator.stable_steps(speed, joint_servos=on, vehicle_servo=on, end_stops=stops)
        for name, (on, stops) in choices.items()
    }
    if modes:
        table(
            "Fastest modes, servos on",
            ("mode", "state", "rate 1/s", "period s"),
            [(m["what"], m["where"], _rate(m["rate"]), _finite(m["period"], "")) for m in modes[:SHOWN]],
            text_columns=2,
        )
        if any(mode["rate"].real > 0.0 for mode in modes[:SHOWN]):
            say("A positive rate is unstable: the motion grows without control, as by the Munk moment in a flow.")
    rows = [(name, *(_finite(step[name], "any") for step in steps.values())) for name in steps["servos off"]]
    table("Maximum stable step, s", ("integrator", *choices), rows)
    return modes, steps


def _rate(rate: complex) -> str:
    return f"{rate.real:.3g}" + (f" ± {rate.imag:.3g}i" if rate.imag else "")


def _finite(seconds: float, otherwise: str) -> str:
    return f"{seconds:.3g}" if math.isfinite(seconds) else otherwise
