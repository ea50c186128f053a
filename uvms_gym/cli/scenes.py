"""`uvms scenes`: list, show, check. The other subcommands are in `explain` and `robots`."""

import itertools
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

import uvms_gym
from uvms_gym._importing.meshes import missing
from uvms_gym._scene import bodies, buoyancy_of, surroundings
from uvms_gym.cli.common import console, fail, prepare, read_scene
from uvms_gym.cli.contact_tables import show_contact
from uvms_gym.cli.environments import Integrator, Step, stating_integration
from uvms_gym.cli.options import Json, SceneArgument, ranged
from uvms_gym.cli.output import say, table, write_json
from uvms_gym.cli.scene_file import write_integration

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


def list_scenes() -> None:
    """List the shipped scenes, and the arms without vehicle."""
    rows = []
    for name in uvms_gym.scene_names():
        simulator = uvms_gym.Simulator(name)
        summary = " ".join(simulator.scene["summary"].split()).split(". ")[0].rstrip(".")
        rows.append((name, summary, _freedom(simulator), simulator.num_joints, simulator.num_thrusters))
    table("Scenes", ("name", "description", "DoF", "joints", "thrusters"), rows, text_columns=2)
    parts = []
    for name in uvms_gym.arm_names():
        scene = {"name": name, "vehicle": {"file": "bluerov2-heavy"}, "arm": {"file": name}}
        simulator = uvms_gym.Simulator(scene)
        parts.append((name, simulator.scene["arm"]["name"], simulator.num_joints))
    table("Arms, parts for scenes", ("name", "arm", "joints"), parts, text_columns=2)


def show(scene: SceneArgument, json_file: Json = None) -> None:
    """Show a scene's bodies, joints, thrusters, fastest modes and the sources of its numbers."""
    loaded = read_scene(scene)
    prepare(None, json_file)
    simulator = uvms_gym.Simulator(loaded)
    console.print(loaded["name"], style="bold", markup=False)
    console.print(" ".join(loaded["summary"].split()), markup=False)
    console.print()
    rows: list[tuple[str, ...]] = []
    for name, body in bodies(loaded):
        buoyancy, of_litre = (buoyancy_of(part, loaded["water"]) for part in (body, {"volume": 1e-3}))
        # Scenes give the volume or the buoyancy.
        volume = 1e3 * body["volume"] if "volume" in body else buoyancy / of_litre if of_litre else 0.0
        rows.append((name, f"{body['mass']:.4g}", f"{volume:.4g}", f"{buoyancy:.4g}"))
    table("Bodies", ("body", "mass kg", "volume L", "buoyancy N"), rows)
    if simulator.num_joints:
        table("Joints", ("index", "joint"), enumerate(simulator.joint_names))
    if len(ends := simulator.end_effector_names) > 1:
        places = (simulator.end_effector_pose(name)[0, :3, 3] for name in ends)
        rows = [(name, *(f"{x:.3f}" for x in place)) for name, place in zip(ends, places, strict=True)]
        table("End effectors at home, world axes", ("end effector", "x m", "y m", "z m"), rows)
    if simulator.num_thrusters:
        rows = [
            (name, f"{low:g}", f"{high:g}")
            for name, (low, high) in zip(simulator.thruster_names, simulator.thruster_limits, strict=True)
        ]
        table("Thrusters", ("thruster", "minimum N", "maximum N"), rows)
    show_contact(loaded)
    _show_rates(simulator, None)
    provenance = loaded.get("provenance", {})
    table("Provenance", ("key", "source"), sorted(provenance.items()), text_columns=2)
    if json_file is not None:
        write_json(json_file, loaded)


def check(
    scene: SceneArgument,
    speed: Speed = None,
    integrator: Integrator = None,
    dt: Step = None,
    strict: Annotated[bool, Option("--strict", help="Exit status 1 if there are warnings.")] = False,
    write: Annotated[
        bool, Option("--write", help="Write the recommended integrator and step into the file; all else stays.")
    ] = False,
    json_file: Json = None,
) -> None:
    """Check a scene: warnings, balance and trim, authority of the thrusters, rates, integrator and step.

    A fault is one line with file, key and value, and exit status 2.
    """
    loaded = stating_integration(read_scene(scene), integrator, dt)
    if write and not scene.endswith(".toml"):
        raise fail(f"--write needs a file of your own, but {scene} is a shipped scene")
    prepare(None, json_file)
    try:
        simulator = uvms_gym.Simulator(loaded)
    except ValueError as error:
        raise fail(f"{scene}: {error}") from None
    # The file as it stands: reading makes rounded matrices symmetric.
    found, assessed = uvms_gym.lint_scene(scene) + missing(loaded), uvms_gym.assess_scene(loaded)
    advice = uvms_gym.recommend_integration(loaded, speed)
    maximum = _stable_step(simulator, speed)
    if simulator.dt > maximum:
        what = next((f" for {mode['what']}" for mode in simulator.modes(speed) if not mode["end_stop"]), "")
        what = f"{simulator.integrator} at {simulator.dt:g} s is unstable{what}, beyond a step of {maximum:.2g} s"
        found.append(f"integration: {what}; --write states the recommended one")
    if not advice["accurate"]:
        found.append(f"integration: no integrator and step of those tried follows the motion: {advice['reason']}")
    console.print(f"{loaded['name']}: no fault found", markup=False)
    for warning in found:
        console.print(f"warning: {warning}", markup=False)
    console.print()
    balance = _balance(simulator)
    rows = [(name, f"{value:.6g}") for name, value in balance.items()]
    named = ((key, ", ".join(each["name"] for each in tables)) for key, tables in surroundings(loaded).items())
    rows += [row for row in named if row[1]]
    used, wanted = f"{simulator.integrator}, {simulator.dt:g} s", f"{advice['integrator']}, {advice['step']:g} s"
    table("Summary", ("", ""), [*rows, ("integration", used), ("recommended integration", wanted)])
    say(f"Recommended integration: {advice['reason']}.")
    _show_assessment(simulator, assessed)
    modes, steps_shown = _show_rates(simulator, speed)
    if write:
        write_integration(Path(scene), advice["integrator"], advice["step"], advice["reason"])
        say(f"wrote [integration] into {scene}")
    if json_file is not None:
        data = [{**mode, "rate": [mode["rate"].real, mode["rate"].imag]} for mode in modes]
        summary = {"scene": loaded["name"], "speed": speed, "warnings": found, "summary": balance, **assessed}
        write_json(json_file, {**summary, "recommended": advice, "modes": data, "stable_steps": steps_shown})
    if strict and found:
        raise typer.Exit(1)


def _stable_step(simulator: uvms_gym.Simulator, speed: float | None) -> float:
    """Maximum stable step of the scene's integrator with any servos on or off, s."""
    choices = itertools.product((False, True), repeat=2)
    steps = [simulator.stable_steps(speed, joint_servos=one, vehicle_servo=other) for one, other in choices]
    return min(step[simulator.integrator] for step in steps)


def _show_assessment(simulator: uvms_gym.Simulator, assessed: dict[str, Any]) -> None:
    """Print trim, authority, and rates of the joints."""
    if (trim := assessed["trim"]) is not None:
        rows: list[tuple[str, ...]] = [("righting moment, N m/rad", f"{trim['righting_moment']:.4g}")]
        if trim["equilibrium"] is not None:
            roll, pitch = (math.degrees(angle) for angle in trim["equilibrium"])
            rows = [("equilibrium roll, deg", f"{roll:.3g}"), ("equilibrium pitch, deg", f"{pitch:.3g}"), *rows]
        table("Trim at rest, joints at home", ("", ""), rows)
        held = [
            (name, f"{force:.4g}", f"{100.0 * share:.3g}")
            for names, forces in (
                (simulator.thruster_names, trim["thrusts"]),
                (simulator.joint_names, trim["joint_torques"]),
            )
            for name, (force, share) in zip(names, forces, strict=True)
        ]
        if held:
            table("To hold it level", ("actuator", "N or N m", "% of the limit"), held)
    if assessed["authority"]:
        rows = [
            (a["axis"], *(f"{x:.4g}" for x in (*a["maximum"], a["alone"], a["acceleration"])))
            for a in assessed["authority"]
        ]
        table("Authority, N or N m", ("axis", "forward", "backward", "alone", "m/s2 or rad/s2"), rows)
    if assessed["joints"]:
        causes = ("inertia", "friction", "servo", "spring", "detent", "end_stop")
        rows = [(joint["name"], *(f"{joint[cause]:.3g}" for cause in causes)) for joint in assessed["joints"]]
        heads = ("joint", *(cause.replace("_", " ") for cause in causes))
        table("Rates of joints by their cause, 1/s", heads, rows)


def _freedom(simulator: uvms_gym.Simulator) -> int:
    return simulator.num_joints + (0 if simulator.scene["vehicle"]["fixed"] else 6)


def _balance(simulator: uvms_gym.Simulator) -> dict[str, float]:
    scene = simulator.scene
    mass = sum(body["mass"] for _, body in bodies(scene))
    weight = mass * math.hypot(*scene["water"]["gravity"])
    buoyancy = sum(buoyancy_of(body, scene["water"]) for _, body in bodies(scene))
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
