"""3-D scene of the page: vehicle, arm, surroundings, thrust, current, reference and target."""

import itertools
import math
from typing import Any

import numpy as np
import trimesh
import viser
import viser.transforms
from numpy.typing import NDArray

from uvms_gym import Renderer, Simulator
from uvms_gym.envs.rendering import Shot, between
from uvms_gym.viewer.episode import Target

Floats = NDArray[np.float64]

_WATER, _JET, _CURRENT, _AIM = (12, 62, 84), (255, 140, 40), (60, 170, 255), (120, 235, 160)
_SEABED, _SPHERE = (150, 145, 120), (56, 201, 214)
#: Length of the arrow of the current, edges of the vehicle per m/s.
_CURRENT_SCALE = 2.0
#: Width from which viser puts the controls beside the picture, px.
_NARROW = 576


class World:
    """Objects of one scene on a server, under one frame.

    `gizmo` are the handles of the target; with `follow` the frame moves so that the vehicle stays at the origin.
    """

    def __init__(self, server: viser.ViserServer, simulator: Simulator, target: Target, dock: bool = False) -> None:
        scene, api = simulator.scene, server.scene
        renderer = Renderer(scene)
        (centre, size), meshes = renderer.bounding_box, renderer.meshes()
        aim, fixed = meshes.pop("dock"), meshes.pop("world", None)
        planes = [s for s in (scene.get("contact") or {}).get("shapes", ()) if s["kind"] == "plane"]
        seabed = any(plane["frame"]["position"][2] == renderer.floor for plane in planes)
        reach = float(np.max(size))
        self._limits = np.maximum(np.abs(simulator.thruster_limits).max(axis=1), 1e-9)
        thrusters = scene["vehicle"].get("thrusters", ())
        self._places = np.array([t["position"] for t in thrusters]).reshape(-1, 3)
        self._jets = np.array([t["axis"] for t in thrusters]).reshape(-1, 3) * (-0.6 * reach)

        self._world, self.follow = api.add_frame("/world", show_axes=False), False
        api.set_background_image(_gradient())
        # The default lights' environment map would be fetched from the network.
        api.configure_environment_map(None)
        api.add_light_hemisphere("/light", sky_color=(235, 248, 255), ground_color=(40, 80, 95), intensity=2.6)
        cell = renderer.cell
        api.add_grid(
            "/world/floor",
            60.0 * cell,
            60.0 * cell,
            cell_size=cell,
            section_size=5.0 * cell,
            cell_color=(70, 125, 140),
            section_color=(110, 165, 178),
            fade_distance=3.0 * renderer.distance,
            position=(0.0, 0.0, renderer.floor),
            plane_color=_SEABED,
            plane_opacity=0.8 if seabed else 0.0,
        )
        if fixed is not None:
            api.add_glb("/world/surroundings", _glb(*fixed))
        # Fixtures that have shapes, by their index.
        self._fixtures: dict[int, Any] = {}
        for k in range(len(scene.get("fixtures") or [])):
            if len((mesh := meshes.pop(f"fixture {k + 1}"))[0]):
                self._fixtures[k] = api.add_glb(f"/world/fixtures/{k}", _glb(*mesh))
        self._bodies = [api.add_glb(f"/world/bodies/{k}", _glb(*mesh)) for k, mesh in enumerate(meshes.values())]
        for k, (body, center, radius) in enumerate(renderer.spheres):
            name = f"/world/bodies/{body}/spheres/{k}"
            api.add_icosphere(name, radius, _SPHERE, opacity=0.45, position=tuple(center))
        self._thrust = api.add_line_segments(
            "/world/bodies/0/thrust", np.zeros((len(thrusters), 2, 3), np.float32), _JET, thickness=0.03 * reach
        )
        self._tip = api.add_frame("/world/tip", show_axes=False)
        self._payload = api.add_icosphere("/world/tip/payload", 1.0, (168, 72, 58), visible=False)
        self._current = api.add_arrows(
            "/world/current",
            np.zeros((1, 2, 3), np.float32),
            _CURRENT,
            shaft_radius=0.02 * reach,
            head_radius=0.05 * reach,
            head_length=0.12 * reach,
        )
        self._above, self._arrow = np.array([0.0, 0.0, 0.5 * size[2] + 0.3 * reach]), _CURRENT_SCALE * reach
        self._aim: Any = (
            api.add_glb("/world/aim", _glb(*aim))
            if dock and len(aim[0])
            else api.add_line_segments("/world/aim", _brackets(centre, size), _AIM, thickness=0.012 * reach)
        )
        self._axes = api.add_frame(
            "/world/reference", axes_length=0.2 * reach, axes_radius=0.008 * reach, visible=False
        )
        self._path = api.add_line_segments("/world/path", np.zeros((1, 2, 3), np.float32), _AIM, thickness=0.01 * reach)
        self._drawn_path = np.zeros((0, 3))
        self.gizmo = api.add_transform_controls(
            "/world/target",
            scale=reach,
            # Squares to drag in planes would cover the vehicle.
            disable_sliders=True,
            position=target[0],
            wxyz=target[1],
        )
        self._vehicle, self._distance, self._azimuth = target[0], 0.75 * renderer.distance, renderer.azimuth
        self.place_camera(server.initial_camera)

    def show(self, before: Shot, after: Shot, share: float) -> None:
        """Draw the state between two control instants; `share` is 0 at the first and 1 at the second."""
        now = between(before, after, share)
        positions, rotations = now["poses"][:, :3, 3], _quaternions(now["poses"])
        for body, position, wxyz in zip(self._bodies, positions, rotations):
            body.position, body.wxyz = position, wxyz
        for k, fixture in self._fixtures.items():
            pose = now["fixtures"][k]
            fixture.position, fixture.wxyz = pose[:3, 3], _quaternions(pose)
        self._tip.position, self._tip.wxyz = positions[-1], rotations[-1]
        self._vehicle = positions[0]
        self._world.position = -positions[0] if self.follow else np.zeros(3)
        if self._places.size:
            jets = self._jets * (now["thrust"] / self._limits)[:, None]
            self._thrust.points = np.stack([self._places, self._places + jets], axis=1).astype(np.float32)
        start = positions[0] + self._above
        self._current.points = np.stack([start, start + self._arrow * now["current"]])[None].astype(np.float32)
        self._show_aim(now["aim"], now["path"])
        if (visible := now["payload"] > 0.0) != self._payload.visible:
            self._payload.visible = visible
        # Ball of 2500 kg/m3.
        if visible and self._payload.scale != (radius := math.cbrt(now["payload"] / 2500.0 * 0.75 / math.pi)):
            self._payload.scale = radius

    def place_camera(self, camera: viser.InitialCameraConfig | viser.CameraHandle, width: int = 1280) -> None:
        """Look at the vehicle from the side of the software renderer's pictures, beside or above the controls.

        `camera` belongs to coming browsers or to an open one; `width` is the width of the browser's picture, px.
        """
        azimuth, elevation = self._azimuth, 0.32
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
        # The controls cover the right, or the lower 60 % of a narrow window.
        narrow = width < _NARROW
        aside = -0.45 * np.cross(away, right) if narrow else 0.16 * right - (0.0, 0.0, 0.06)
        distance = (1.6 if narrow else 1.0) * self._distance
        look_at = (0.0 if self.follow else self._vehicle) + distance * aside
        camera.position = tuple(look_at + distance * away)
        camera.look_at = tuple(look_at)

    def _show_aim(self, aim: Floats, path: Floats) -> None:
        """Brackets or the dock at the vehicle's desired pose, or axes and path of the end effector's."""
        tracks = len(path) > 0
        shown, hidden = (self._axes, self._aim) if tracks else (self._aim, self._axes)
        if not shown.visible or hidden.visible:
            shown.visible, hidden.visible = True, False
        shown.position, shown.wxyz = aim[:3, 3], _quaternions(aim)
        if tracks and not np.array_equal(path, self._drawn_path):
            self._drawn_path = path
            self._path.points = np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)


def _glb(vertices: NDArray[Any], normals: NDArray[Any], colours: NDArray[Any], triangles: NDArray[np.uint32]) -> bytes:
    mesh = trimesh.Trimesh(vertices, triangles, vertex_normals=normals, process=False)
    # Without a material, GLB means metal. Colours of vertices are linear, as the squares that `draw` shades.
    material = trimesh.visual.material.PBRMaterial(metallicFactor=0.1, roughnessFactor=0.6)
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    mesh.visual.vertex_attributes["color"] = np.round(255.0 * np.insert(colours**2, 3, 1.0, axis=1))
    return bytes(mesh.export(file_type="glb"))


def _quaternions(poses: Floats) -> Floats:
    return np.asarray(viser.transforms.SO3.from_matrix(poses[..., :3, :3]).wxyz)


def _brackets(centre: Floats, size: Floats) -> NDArray[np.float32]:
    """Corners of a box somewhat larger than the vehicle, (24, 2, 3)."""
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))[:, None]
    inner = corners * (1.0 - 0.3 * np.eye(3))
    lines = centre + 0.56 * size * np.stack([np.broadcast_to(corners, inner.shape), inner], axis=2)
    return np.asarray(lines.reshape(24, 2, 3), dtype=np.float32)


def _gradient() -> NDArray[np.uint8]:
    """Water, lighter above, (64, 1, 3)."""
    share = np.linspace(0.0, 1.0, 64)[:, None, None]
    return np.asarray((1.0 - share) * (70, 150, 176) + share * _WATER, dtype=np.uint8)
