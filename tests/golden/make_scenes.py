"""Writes tests/golden/scenes/*.toml: frozen copies of shipped scenes, random scenes, and a dry form of each.

Run from the repository root: python tests/golden/make_scenes.py
Rerun only on purpose: the golden files hold results for these very scenes. NumPy 2.4.6 made the random ones.

The copies keep physics only (no servos, no thrusters, no provenance), so that tuning a shipped scene's gains does
not disturb the golden data. Dry scenes lack all that water and joints add: only rigid bodies and gravity remain.
Viscous scenes are dry ones whose joints keep their viscous friction, geared ones have rotor inertia at most joints.
"""

import copy
import tomllib
from pathlib import Path

import numpy as np

SHIPPED = Path("uvms_gym/scenes")
OUT = Path("tests/golden/scenes")


def toml(table, path=()):
    """TOML text of nested dicts, lists of dicts, and plain values."""

    def value(v):
        return repr(v).lower() if isinstance(v, bool) else repr(v).replace("'", '"')

    def leaf(v):
        return not isinstance(v, dict) and not (isinstance(v, list) and v and isinstance(v[0], dict))

    lines = []
    for key, v in table.items():
        if leaf(v) and isinstance(v, list) and v and isinstance(v[0], list):
            lines += [f"{key} = [", *(f"    {value(row)}," for row in v), "]"]
        elif leaf(v):
            lines.append(f"{key} = {value(v)}")
    for key, v in table.items():
        name = ".".join((*path, key))
        if isinstance(v, dict):
            lines += ["", f"[{name}]", *toml(v, (*path, key))]
        elif not leaf(v):
            for row in v:
                lines += ["", f"[[{name}]]", *toml(row, (*path, key))]
    return lines


def write(scene, name, summary):
    scene = {"name": name, "summary": summary} | {k: v for k, v in scene.items() if k not in ("name", "summary")}
    text = "\n".join(toml(scene)) + "\n"
    assert tomllib.loads(text) == scene
    (OUT / f"{name}.toml").write_text(text)


def bodies(scene):
    arm = scene.get("arm", {})
    return [
        scene["vehicle"]["body"],
        *([arm["base"]] if "base" in arm else []),
        *(link["body"] for link in arm.get("links", [])),
        *([scene["payload"]["body"]] if "payload" in scene else []),
    ]


def joints(scene):
    arm = scene.get("arm", {})
    mount = arm.get("mount", {})
    return [*([mount["joint"]] if "joint" in mount else []), *(link["joint"] for link in arm.get("links", []))]


def physics(scene):
    """Without servos, thrusters, provenance and start values."""
    scene = copy.deepcopy(scene)
    scene.pop("provenance", None)
    for key in ("thrusters", "servo"):
        scene["vehicle"].pop(key, None)
    for joint in joints(scene):
        for key in ("servo", "home", "speed"):
            joint.pop(key, None)
    return scene


def dry(scene, viscous=False):
    """Without water, joint friction (but the viscous part if `viscous`), end stops and effort limits."""
    scene = copy.deepcopy(scene)
    scene["water"] = {"density": 0.0, "gravity": scene["water"]["gravity"]}
    for body in bodies(scene):
        for key in (
            "weight",
            "volume",
            "buoyancy",
            "center_of_buoyancy",
            "hydrodynamic_frame",
            "added_mass",
            "damping",
        ):
            body.pop(key, None)
    for joint in joints(scene):
        kept = {"friction": {"viscous": joint["friction"]["viscous"]}} if viscous else {}
        for key in ("friction", "limits", "effort"):
            joint.pop(key, None)
        joint |= kept
    return scene


class Random:
    """Random parts of scenes, in short decimals."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)

    def vector(self, size):
        return np.round(self.rng.uniform(-size, size, 3), 3).tolist()

    def frame(self, size):
        return {"position": self.vector(size), "rpy": self.vector(1.5)}

    def matrix(self, scale, spread):
        """Symmetric positive definite, with diagonal near `scale`."""
        root = np.eye(6) + spread * self.rng.normal(size=(6, 6))
        matrix = np.sqrt(np.outer(scale, scale)) * (root @ root.T)
        return np.round((matrix + matrix.T) / 2, 4)

    def body(self, mass, size, form):
        turn, _ = np.linalg.qr(self.rng.normal(size=(3, 3)))
        a, b, c = (size * self.rng.uniform(0.3, 1.0, 3)) ** 2
        inertia = np.round(turn @ np.diag([b + c, a + c, a + b]) @ turn.T * mass / 5, 6)
        inertia = np.round((inertia + inertia.T) / 2, 7)
        com = self.vector(0.3 * size)
        body = {"mass": mass, "center_of_mass": com}
        if form == "origin":
            c = np.array(com)
            shifted = inertia + mass * (c @ c * np.eye(3) - np.outer(c, c))
            body |= {"inertia": np.round(shifted, 9).tolist(), "inertia_at": "origin"}
        elif form == "six":
            body["inertia"] = inertia[np.triu_indices(3)].tolist()
        elif form == "three":
            body["inertia"] = np.diag(inertia).tolist()
        else:
            body["inertia"] = inertia.tolist()
        if form == "three":
            body["buoyancy"] = round(mass * 9.0, 3)
        else:
            body["volume"] = round(mass * self.rng.uniform(5e-4, 1.1e-3), 7)
        scale = mass * np.array([1, 1, 1, size**2 / 3, size**2 / 3, size**2 / 3])
        skew = np.sqrt(np.outer(scale, scale)) * self.rng.normal(size=(6, 6)) * 0.3
        body |= {
            "center_of_buoyancy": self.vector(0.3 * size),
            "hydrodynamic_frame": self.frame(0.3 * size),
            "added_mass": self.matrix(scale * self.rng.uniform(0.2, 1.5, 6), 0.25).tolist(),
            "damping": {
                "linear": np.round(self.matrix(2 * scale, 0.2) + skew - skew.T, 4).tolist(),
                "quadratic": np.round(
                    np.diag(4 * scale * self.rng.uniform(0.5, 2.0, 6)) + 0.3 * (skew + np.diag(np.diag(skew))), 4
                ).tolist(),
            },
        }
        # The diagonal must stay positive whatever the random part.
        quadratic = np.array(body["damping"]["quadratic"])
        assert (np.diag(quadratic) > 0).all()
        return body

    def joint(self, kind):
        reach = 0.4 if kind == "prismatic" else 2.5
        return {
            "kind": kind,
            "axis": self.vector(1.0),
            "effort": round(self.rng.uniform(5, 15), 2),
            "frame": self.frame(0.3),
            "friction": {
                "viscous": round(self.rng.uniform(0, 2), 3),
                "coulomb": round(self.rng.uniform(0, 1), 3),
                "coulomb_speed": round(self.rng.uniform(0.01, 0.1), 3),
            },
            "limits": {"lower": -reach, "upper": round(0.8 * reach, 3), "stiffness": 200.0, "damping": 40.0},
        }

    def scene(self, mass, kinds, mount=None, base=True, payload=True, fixed=False, gravity=(0.0, 0.0, -9.81)):
        forms = ("rows", "origin", "six", "three")
        scene = {
            "water": {"density": 1025.0, "gravity": list(gravity)},
            "vehicle": {"name": "random", "fixed": fixed, "body": self.body(mass, 0.8, "origin")},
        }
        if kinds is not None:
            arm = scene["arm"] = {"name": "random", "mount": {"frame": self.frame(0.5)}}
            if mount:
                arm["mount"]["joint"] = self.joint(mount)
            if base:
                arm["base"] = self.body(round(0.05 * mass, 3), 0.3, "six")
            names = {"r": "revolute", "p": "prismatic"}
            arm["links"] = [
                {
                    "name": f"link {i + 1}",
                    "joint": self.joint(names[kind]),
                    "body": self.body(round(mass * self.rng.uniform(0.02, 0.1), 3), 0.4, forms[i % 4]),
                }
                for i, kind in enumerate(kinds)
            ]
            arm["end_effector"] = self.frame(0.3)
        if payload:
            scene["payload"] = {"frame": self.frame(0.1), "body": self.body(round(0.04 * mass, 3), 0.3, "rows")}
        return scene


RANDOM = {
    "random-fixed-loading": (11, {"mass": 60.0, "kinds": "rprp"}),
    "random-joint-loading": (
        12,
        {"mass": 40.0, "kinds": "rrr", "mount": "revolute", "payload": False, "gravity": (1.2, -2.5, -9.1)},
    ),
    "random-nine-joints": (13, {"mass": 80.0, "kinds": "rrprrrpr", "mount": "prismatic"}),
    "random-fixed-base": (14, {"mass": 30.0, "kinds": "rpr", "fixed": True}),
    "random-no-links": (15, {"mass": 20.0, "kinds": "", "mount": "revolute", "base": True}),
    "random-no-arm": (16, {"mass": 25.0, "kinds": None}),
}
VISCOUS_AND_GEARED = ("random-nine-joints", "random-fixed-base", "petasus-pum")
FROZEN = ("petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy", "rexrov")


def coupled(scene, seed):
    """Scene with off-diagonal entries in all added masses, at most half of what would cost them their definiteness."""
    scene = copy.deepcopy(scene)
    rng = np.random.default_rng(seed)
    for body in bodies(scene):
        diagonal = np.array(body["added_mass"])
        diagonal = np.maximum(diagonal, 1e-3 * diagonal.max())
        root = rng.normal(size=(6, 6))
        correlation = root @ root.T
        size = np.sqrt(np.diag(correlation))
        correlation = 0.5 * (np.eye(6) + correlation / np.outer(size, size))
        body["added_mass"] = np.round(np.sqrt(np.outer(diagonal, diagonal)) * correlation, 6).tolist()
    return scene


def merged(part, own):
    """Table of a part with the values of a scene in their place."""
    both = {key: merged(part[key], own[key]) for key in part if isinstance(own.get(key), dict)}
    return part | own | both


def read(name):
    """Shipped scene with its parts."""
    scene = tomllib.loads((SHIPPED / f"{name}.toml").read_text())
    for key in ("vehicle", "arm"):
        if file := scene.get(key, {}).pop("file", None):
            part = read(file)
            scene[key] = merged(part[key], scene[key])
            scene.setdefault("water", part.get("water"))
    return {"water": None} | scene


def write_viscous_and_geared(scene, name):
    if name in VISCOUS_AND_GEARED:
        summary = f"{name} without water, with viscous friction at the joints alone, made for tests."
        write(dry(scene, viscous=True), f"{name}-viscous", summary)
        scene = dry(scene)
        for i, joint in enumerate(joints(scene)):
            if i % 3 != 1:
                joint["rotor_inertia"] = round(0.3 / (1 + i), 3)
        write(scene, f"{name}-geared", f"{name} without water and joint losses, with rotor inertia, made for tests.")


def main():
    OUT.mkdir(exist_ok=True)
    for name, (seed, parts) in RANDOM.items():
        scene = Random(seed).scene(**parts)
        write(scene, name, "Random numbers, made for tests.")
        write(dry(scene), f"{name}-dry", "Random numbers, made for tests; without water and joint losses.")
        write_viscous_and_geared(scene, name)
    for name in FROZEN:
        scene = physics(read(name))
        write(scene, f"{name}-frozen", f"Physics of {name}, frozen for tests.")
        if "arm" in scene:
            write(dry(scene), f"{name}-dry", f"{name} without water and joint losses, frozen for tests.")
        write_viscous_and_geared(scene, name)
        if name == "petasus-pum":
            summary = f"{name} with off-diagonal added mass on every body, made for tests."
            write(coupled(scene, 17), f"{name}-coupled", summary)


if __name__ == "__main__":
    main()
