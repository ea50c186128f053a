"""Pictures drawn when the site is built: scenes and environments, into `docs/_generated`."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from PIL import Image
from sphinx.application import Sphinx

import uvms_gym

FOLDER = "_generated"
#: Environments that are shown, under their basic controllers, and the control periods before the picture.
ENVIRONMENTS = {
    "UVMS-StationKeep-v0": ("pd", 60),
    "UVMS-EETrack-v0": ("resolved", 120),
    "UVMS-Dock-v0": ("dock-pd", 40),
    "UVMS-Button-v0": ("resolved-dob", 110),
    "UVMS-Valve-v0": ("resolved-dob", 240),
}


def draw_scene(name: str) -> np.ndarray:
    """Picture of a scene at home, (480, 640, 3) uint8."""
    simulator = uvms_gym.Simulator(name)
    joints = simulator.q[0]
    return uvms_gym.Renderer(name).draw(simulator.position[0], simulator.rotation[0], joints)


def draw_environment(name: str) -> np.ndarray:
    """Picture of an environment in an episode of seed 3, (480, 640, 3) uint8."""
    kind, steps = ENVIRONMENTS[name]
    env = gymnasium.make(name, render_mode="rgb_array")
    controller, state = uvms_gym.make_controller(kind, env), None
    observation, _ = env.reset(seed=3)
    for _ in range(steps):
        action, state = controller.predict(observation, state)
        observation, *_ = env.step(action)
    return env.render()


def _draw(app: Sphinx) -> None:
    folder = Path(app.srcdir) / FOLDER
    folder.mkdir(exist_ok=True)
    for name in uvms_gym.scene_names():
        Image.fromarray(draw_scene(name)).save(folder / f"scene-{name}.png")
    for name in ENVIRONMENTS:
        Image.fromarray(draw_environment(name)).save(folder / f"{name}.png")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("builder-inited", _draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
