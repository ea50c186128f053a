"""Vehicles drawn from physics, with and without arm: scenes for policies that must not depend on one vehicle.

None of them is a shipped scene or has a part of one. Bodies are boxes and ellipsoids with the project's own estimates
of added mass and drag (`uvms_gym.estimate`), which are then drawn anew within their uncertainty.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import Simulator, estimate

Floats = NDArray[np.float64]

#: Ranges: mass, kg; acceleration forward, m/s2, at the smallest and at the largest mass.
MASS = (5.0, 5000.0)
ACCELERATION = ((0.8, 8.0), (0.35, 1.5))
#: Minimum acceleration along an axis, m/s2 and rad/s2, and minimum force over the drag at this speed, m/s.
WEAKEST, SPEED = (0.3, 0.25), 0.7
#: Sensors' delays, control periods, with their probabilities; thruster lag, s; factor on the sensors' noise.
DELAYS, SHARES = (0, 1, 2), (0.1, 0.7, 0.2)
LAG, NOISE = (0.05, 0.25), (0.5, 2.0)
#: Standard deviations of the storm's sensors by their names in `disturbance`, m, rad, m/s and rad/s.
SENSORS = {"position": 0.005, "attitude": 0.005, "linear_velocity": 0.01, "angular_velocity": 0.01}


@dataclass(frozen=True)
class Vehicle:
    """Drawn vehicle, with its sensors and thrusters' lag."""

    scene: dict[str, Any]
    """Scene."""
    env_kwargs: dict[str, Any]
    """Arguments of its environment: scene, disturbance, thruster_lag."""


def draw_vehicle(seed: int, number: int) -> Vehicle:
    """Vehicle of this number, of the stream of this seed; the same for the same two.

    Vehicles whose thrusters cannot keep station are drawn again: those that push too weakly along an axis, or have less
    than twice the drag at 0.7 m/s.
    """
    generator = np.random.default_rng([seed, number])
    while True:
        scene = _scene(generator, f"drawn-{seed}-{number}")
        if _keeps_station(scene):
            break
    usual = generator.random() < 0.5
    lag = 0.1 if usual else _log_uniform(generator, *LAG)
    noise = 1.0 if usual else _log_uniform(generator, *NOISE)
    delay = 1 if usual else int(generator.choice(DELAYS, p=SHARES))
    disturbance = {
        "base": "storm",
        "delay": {"periods": delay},
        "noise": {name: noise * deviation for name, deviation in SENSORS.items()},
    }
    return Vehicle(scene, {"scene": scene, "disturbance": disturbance, "thruster_lag": round(lag, 4)})


def authority(scene: dict[str, Any]) -> float:
    """Acceleration that the thrusters reach along an axis of the body, geometric mean of the three, m/s2."""
    simulator = Simulator(scene, 1)
    inertia = simulator.mass_matrix()[0, :6, :6].diagonal()
    return float(np.exp(np.log(_wrench_limits(simulator)[:3] / inertia[:3]).mean()))


def _log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(generator.uniform(math.log(low), math.log(high))))


def _keeps_station(scene: dict[str, Any]) -> bool:
    simulator = Simulator(scene, 1)
    inertia = simulator.mass_matrix()[0, :6, :6].diagonal()
    limits = _wrench_limits(simulator)
    if (limits[:3] < WEAKEST[0] * inertia[:3]).any() or (limits[3:] < WEAKEST[1] * inertia[3:]).any():
        return False
    for axis in range(3):
        speeds = np.zeros((1, 6 + simulator.num_joints))
        speeds[0, axis] = SPEED
        found = simulator.equations(speeds)
        if limits[axis] < 2.0 * found["D_nu"][0, axis]:
            return False
    # Trim takes at most a fifth of the thrust.
    return bool((np.abs(found["g"][0, :6]) <= 0.2 * limits).all())


def _wrench_limits(simulator: Simulator) -> Floats:
    """Largest wrench along each axis alone, N and N m, in its weaker direction."""
    (lower, upper), found = simulator.thruster_limits.T, np.empty(6)
    for axis, thrusts in enumerate(np.linalg.pinv(simulator.thruster_configuration).T):
        both = [np.where(one > 0, upper, -lower) / np.maximum(np.abs(one), 1e-12) for one in (thrusts, -thrusts)]
        found[axis] = min(float(one.min()) for one in both)
    return found


def _scene(generator: np.random.Generator, name: str) -> dict[str, Any]:
    density = float(generator.choice([1000.0, 1025.0]))
    mass = _log_uniform(generator, *MASS)
    body, size = _body(generator, mass, density)
    scene: dict[str, Any] = {
        "name": name,
        "water": {"density": density, "gravity": [0.0, 0.0, -9.81]},
        "vehicle": {"name": name, "body": body},
    }
    if generator.random() < 0.45:
        scene["arm"] = _arm(generator, mass, size, density)
    arm_mass = sum(link["body"]["mass"] for link in scene.get("arm", {}).get("links", []))
    volume = sum(link["body"]["volume"] for link in scene.get("arm", {}).get("links", []))
    # Slightly buoyant or heavy as a whole.
    buoyant = generator.uniform(-0.005, 0.015)
    body["volume"] = float((mass + arm_mass) * (1.0 + buoyant) / density - volume)
    scene["vehicle"]["thrusters"] = _thrusters(generator, scene, size)
    inertia = Simulator(scene, 1).mass_matrix()[0, :6, :6].diagonal()
    speed = np.array([1.0] * 3 + [2.0] * 3)
    scene["vehicle"]["servo"] = {"kp": (speed**2 * inertia).tolist(), "kd": (2.0 * speed * inertia).tolist()}
    if "arm" in scene:
        _trim(scene)
    return scene


def _body(generator: np.random.Generator, mass: float, density: float) -> tuple[dict[str, Any], Floats]:
    """Body of a mass, kg, and its size, m: a closed ellipsoid or box, or an open frame."""
    size = np.array([1.0, generator.uniform(0.4, 1.0), generator.uniform(0.3, 0.9)])
    frame = generator.random() < 0.6
    displaced = generator.uniform(0.2, 0.6) if frame else 1.0
    shape: dict[str, Any]
    volume = mass / density / displaced
    if not frame and generator.random() < 0.5:
        size *= (volume / (math.pi / 6.0 * size.prod())) ** (1 / 3)
        shape = {"ellipsoid": (0.5 * size).tolist()}
    else:
        size *= (volume / size.prod()) ** (1 / 3)
        shape = {"box": size.tolist(), "displaced": displaced}
        if frame:
            shape["perforation"] = generator.uniform(0.1, 0.5)
    body = estimate({"density": density, "speed": [0.2, 0.3], "shapes": [shape | {"relative_density": 1.0}]})["body"]
    keys = ("mass", "inertia", "volume", "added_mass", "damping")
    body = {key: body[key] for key in keys}
    body["mass"] = mass
    envelope = size.prod() if "box" in shape else math.pi / 6.0 * size.prod()
    moments = np.array(body["inertia"]) * mass / (density * displaced * envelope)
    body["inertia"] = (moments * generator.uniform(0.8, 1.3)).tolist()

    def six(low: float, high: float) -> Floats:
        """The estimates' own uncertainty, by axis."""
        factors: Floats = np.exp(generator.uniform(math.log(low), math.log(high), 6))
        return factors

    body["added_mass"] = (np.array(body["added_mass"]) * six(0.4, 1.3)).tolist()
    body["damping"] = {
        "linear": (np.array(body["damping"]["linear"]) * six(0.4, 2.5)).tolist(),
        "quadratic": (np.array(body["damping"]["quadratic"]) * six(0.4, 1.6)).tolist(),
    }
    righting = float(size[2] * generator.uniform(0.0, 0.12))
    body["center_of_mass"] = [0.0, 0.0, -0.5 * righting]
    body["center_of_buoyancy"] = [0.0, 0.0, 0.5 * righting]
    return body, size


def _thrusters(generator: np.random.Generator, scene: dict[str, Any], size: Floats) -> list[dict[str, Any]]:
    """Eight vectored and vertical thrusters, eight at the corners of a cube, or three pairs, sized by acceleration."""
    place = size * generator.uniform(0.25, 0.5, 3)
    kind = generator.choice(["vectored", "corners", "pairs"], p=[0.6, 0.2, 0.2])
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    placed: list[tuple[Floats, Floats]] = []
    if kind == "vectored":
        angle, height = generator.uniform(0.5, 1.1), size[2] * generator.uniform(-0.2, 0.2)
        upper = size * generator.uniform(0.25, 0.5, 3)
        placed = [
            (np.array([x * place[0], y * place[1], height]), np.array([math.cos(angle), -x * y * math.sin(angle), 0.0]))
            for x, y in signs
        ]
        placed += [(np.array([x * upper[0], y * upper[1], upper[2]]), np.array([0.0, 0.0, 1.0])) for x, y in signs]
    elif kind == "corners":
        lean = generator.uniform(0.5, 1.0, 3)
        for x, y in signs:
            for z in (1, -1):
                # Turns of the cube's corners that give all six axes.
                placed.append((np.array([x, y, z]) * place, np.array([1.0, -x * y, x * z]) * lean))
    else:
        placed = [(np.array([0.0, y * place[1], 0.0]), np.array([1.0, 0.0, 0.0])) for y in (1, -1)]
        placed += [(np.array([0.0, 0.0, z * place[2]]), np.array([0.0, 1.0, 0.0])) for z in (1, -1)]
        placed += [(np.array([x * place[0], 0.0, 0.0]), np.array([0.0, 0.0, 1.0])) for x in (1, -1)]
    backward = generator.uniform(0.6, 1.0)
    made: list[dict[str, Any]] = []
    for i, (at, axis) in enumerate(placed):
        turned = (axis / np.linalg.norm(axis)).tolist()
        made.append({"name": f"t{i}", "position": at.tolist(), "axis": turned, "limits": [-backward, 1.0]})
    simulator = Simulator({**scene, "vehicle": {**scene["vehicle"], "thrusters": made}}, 1)
    # Large vehicles accelerate less.
    share = math.log(scene["vehicle"]["body"]["mass"] / MASS[0]) / math.log(MASS[1] / MASS[0])
    low, high = (math.exp((1 - share) * math.log(a) + share * math.log(b)) for a, b in zip(*ACCELERATION, strict=True))
    forward = _wrench_limits(simulator)[0] / simulator.mass_matrix()[0, 0, 0]
    thrust = _log_uniform(generator, low, high) / max(forward, 1e-9)
    horizontal = 1.0 if kind == "corners" else generator.uniform(0.6, 1.6)
    for thruster in made:
        vertical = kind != "corners" and thruster["axis"][2] == 1.0
        scale = thrust * (horizontal if vertical else 1.0)
        thruster["limits"] = [-backward * scale, scale]
    return made


def _arm(generator: np.random.Generator, mass: float, size: Floats, density: float) -> dict[str, Any]:
    """Arm of two to six cylinders with hinges in turn, of 2 to 12 % of the vehicle's mass."""
    count = int(generator.integers(2, 7))
    total, reach = mass * generator.uniform(0.02, 0.12), float(size[0]) * generator.uniform(0.5, 1.2)
    lengths = generator.dirichlet(np.full(count, 6.0)) * reach
    links: list[dict[str, Any]] = []
    beyond = np.cumsum(lengths[::-1])[::-1]
    for i, length in enumerate(lengths):
        heavy = total * length / reach
        relative = generator.uniform(1.2, 3.0)
        radius = max(math.sqrt(heavy / (relative * density * math.pi * length)), 1e-3)
        cylinder = {"cylinder": {"radius": radius, "length": float(length), "axis": "x"}, "ends": "joined"}
        shape = cylinder | {"position": [0.5 * length, 0.0, 0.0], "mass": heavy}
        body = estimate({"density": density, "speed": [0.1, 0.3], "shapes": [shape]})["body"]
        axis = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]][i % 2 if generator.random() < 0.8 else 1]
        # About the joint: the arm beyond, and a geared motor as heavy again.
        carried = total * beyond[i] / reach * (beyond[i] ** 2 / 3.0 + radius**2)
        links.append(
            {
                "name": f"link{i}",
                "joint": {
                    "kind": "revolute",
                    "frame": {"position": [float(lengths[i - 1]) if i else 0.0, 0.0, 0.0]},
                    "axis": axis,
                    "rotor_inertia": float(carried),
                    "friction": {"viscous": float(10.0 * carried)},
                    "servo": {"kp": float(200.0 * carried), "kd": float(30.0 * carried)},
                    "home": float(generator.uniform(-0.6, 0.6)),
                },
                "body": body,
            }
        )
    place = [0.4 * size[0] * generator.uniform(0.3, 1.0), 0.0, -0.45 * size[2]]
    pitch = generator.uniform(0.0, 1.5)
    return {
        "name": "arm",
        "mount": {"frame": {"position": [float(x) for x in place], "rpy": [0.0, float(pitch), 0.0]}},
        "links": links,
        "end_effector": {"position": [float(lengths[-1]), 0.0, 0.0]},
    }


def _trim(scene: dict[str, Any]) -> None:
    """Move the vehicle's centre of buoyancy so that the arm's weight in water does not tilt it."""
    body, water = scene["vehicle"]["body"], scene["water"]
    lift = water["density"] * 9.81 * body["volume"]
    moment = Simulator(scene, 1).equations()["g"][0, 3:6]
    # g stands on the left-hand side of the equations of motion.
    body["center_of_buoyancy"][0] -= float(moment[1] / lift)
    body["center_of_buoyancy"][1] += float(moment[0] / lift)
