"""Directive `scenes`: the shipped scenes with pictures, sizes and provenance, from their files."""

from collections import Counter
from typing import Any

from made_markdown import MarkdownDirective, table
from sphinx.application import Sphinx

import uvms_gym

KINDS = ("measured", "fitted", "cited", "derived", "assumed")


def describe(name: str) -> str:
    """Section of one scene."""
    scene = uvms_gym.load_scene(name)
    simulator = uvms_gym.Simulator(name)
    kinds = Counter(note.partition(":")[0] for note in scene["provenance"].values())
    joints = ", ".join(f"`{joint}`" for joint in simulator.joint_names) or "none"
    fins = [("Fins", ", ".join(f"`{fin}`" for fin in simulator.fin_names))] if simulator.num_fins else []
    rows = [
        ("Degrees of freedom", 6 + simulator.num_joints),
        ("Joints", joints),
        ("Thrusters", f"{simulator.num_thrusters}, {_limits(simulator)}" if simulator.num_thrusters else "none"),
        *fins,
        ("Mass of the vehicle", f"{scene['vehicle']['body']['mass']:g} kg"),
        ("Entries of provenance", ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])),
    ]
    picture = f"![{name} at its home](/_generated/scene-{name}.png)"
    return f"## {name}\n\n{scene['summary'].strip()}\n\n{picture}\n\n" + table(("", ""), rows)


def _limits(simulator: uvms_gym.Simulator) -> str:
    minimum, maximum = simulator.thruster_limits[:, 0].min(), simulator.thruster_limits[:, 1].max()
    return f"{minimum:.4g} to {maximum:.4g} N"


class Scenes(MarkdownDirective):
    """Shipped scenes, one section each."""

    def markdown(self) -> str:
        """Sections in the order of `scene_names`."""
        return "\n\n".join(describe(name) for name in uvms_gym.scene_names())


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.add_directive("scenes", Scenes)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
