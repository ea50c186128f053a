"""Dry scenes whose links branch, for comparisons with rigid-body programs."""

from typing import Any

import numpy as np

#: Kinds of joints, and the frame of an arm's first link on either side.
KINDS = ("revolute", "prismatic")


def body(rng: np.random.Generator, mass: float, size: float) -> dict[str, Any]:
    """A rigid body of random density within a cube of this edge."""
    points = rng.uniform(-size / 2.0, size / 2.0, (12, 3))
    masses = mass * rng.dirichlet(np.ones(12))
    center = masses @ points / mass
    at = "com" if rng.random() < 0.5 else "origin"
    arms = points - center if at == "com" else points
    inertia = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True))
    return {"mass": mass, "center_of_mass": center.tolist(), "inertia": inertia.tolist(), "inertia_at": at}


def joint(rng: np.random.Generator, kind: str | None = None) -> dict[str, Any]:
    """A joint in general position; every fourth is pitched by almost 90 degrees."""
    rpy = rng.uniform(-3.0, 3.0, 3)
    if rng.random() < 0.25:
        rpy[1] = np.pi / 2.0 - 1e-9
    found = {"kind": kind or str(rng.choice(KINDS)), "axis": rng.normal(size=3).tolist()}
    found["frame"] = {"position": rng.uniform(-0.3, 0.3, 3).tolist(), "rpy": rpy.tolist()}
    return found | {"rotor_inertia": float(rng.choice([0.0, rng.uniform(0.0, 0.3)]))}


def scene(rng: np.random.Generator, links: list[dict[str, Any]], **arm: Any) -> dict[str, Any]:
    """A vehicle with these links in a vacuum."""
    frame = {"position": rng.uniform(-0.3, 0.3, 3).tolist(), "rpy": rng.uniform(-1.5, 1.5, 3).tolist()}
    return {
        "name": "tree",
        "water": {"density": 0.0, "gravity": (9.81 * np.array([0.1, -0.2, -0.97])).tolist()},
        "vehicle": {"name": "vehicle", "body": body(rng, 30.0, 0.8)},
        "arm": {"name": "arm", "mount": {"frame": frame}, "links": links, "end_effector": joint(rng)["frame"]} | arm,
    }


def random_tree(seed: int) -> dict[str, Any]:
    """A tree of up to twelve links, some fixed, and two end effectors; with or without base, q0 and payload."""
    rng = np.random.default_rng(seed)
    links: list[dict[str, Any]] = []
    carriers = ["vehicle", "base"]
    for k in range(int(rng.integers(1, 13))):
        links.append({"name": f"link-{k}", "parent": str(rng.choice(carriers)), "joint": joint(rng)})
        if fixed := rng.random() < 0.25:
            links[-1]["joint"] = {"kind": "fixed", "frame": joint(rng)["frame"]}
        carriers.append(f"link-{k}")
        # A link that is fixed may be a mere frame.
        if not fixed or rng.random() < 0.5:
            links[-1]["body"] = body(rng, float(rng.uniform(1.0, 5.0)), 0.4)
    made = scene(rng, links)
    made["arm"]["end_effector"]["on"] = str(rng.choice(carriers))
    made["arm"]["end_effectors"] = {"second": joint(rng)["frame"] | {"on": str(rng.choice(carriers))}}
    if rng.random() < 0.5:
        made["arm"]["base"] = body(rng, 3.0, 0.3)
        if rng.random() < 0.5:
            made["arm"]["mount"]["joint"] = joint(rng)
    if rng.random() < 0.5:
        on = str(rng.choice(["default", "second"]))
        made["payload"] = {"on": on, "frame": joint(rng)["frame"], "body": body(rng, 2.0, 0.2)}
    return made


def chain(rng: np.random.Generator, name: str, parent: str, count: int) -> list[dict[str, Any]]:
    """Revolute links, each on the one before."""
    names = [parent, *(f"{name}-{k}" for k in range(count))]
    links = zip(names[1:], names, strict=False)
    return [
        {"name": own, "parent": on, "joint": joint(rng, "revolute"), "body": body(rng, 3.0, 0.4)} for own, on in links
    ]


def two_arms() -> dict[str, Any]:
    """Two arms of four joints on one vehicle."""
    rng = np.random.default_rng(1)
    return scene(rng, chain(rng, "left", "base", 4) + chain(rng, "right", "vehicle", 4))


def gripper() -> dict[str, Any]:
    """An arm of three joints with two fingers that slide, and a third that turns."""
    rng = np.random.default_rng(2)
    links = chain(rng, "arm", "base", 3)
    fingers = [chain(rng, f"finger-{kind}", "arm-2", 1)[0] for kind in "abc"]
    for finger, kind in zip(fingers, ("prismatic", "prismatic", "revolute"), strict=True):
        finger["joint"] = joint(rng, kind)
    return scene(rng, links + fingers, base=body(rng, 2.0, 0.3))


def mast() -> dict[str, Any]:
    """An arm, and a mast and a camera beside it on the vehicle, listed among the arm's links."""
    rng = np.random.default_rng(3)
    arm, others = chain(rng, "arm", "base", 3), chain(rng, "mast", "vehicle", 2)
    return scene(rng, [arm[0], others[0], arm[1], others[1], arm[2]])


HAND_MADE = {"two arms": two_arms, "gripper": gripper, "mast": mast}
