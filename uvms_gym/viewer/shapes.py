"""Triangle meshes of the moving bodies, from the scene's `vehicle.shape`, thrusters and arm: for pictures only."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray
from trimesh import creation

Vector = NDArray[np.float64]

_DARK, _METAL, _WHITE = (62, 70, 80), (180, 188, 196), (236, 238, 234)
_LAMP, _DUCT, _NOSE = (255, 246, 216), (52, 58, 66), (232, 81, 42)
_FLOAT, _STARBOARD, _PORT = (242, 181, 29), (61, 255, 110), (255, 65, 54)
_LINK, _JOINT, _RING, _TIP = (217, 220, 221), (70, 77, 87), (240, 122, 34), (255, 47, 208)


def vehicle_size(scene: dict[str, Any]) -> tuple[Vector, Vector]:
    """Centre and edges, m, (3,) each, of the vehicle's bounding box in its frame."""
    if shape := scene["vehicle"].get("shape"):
        return np.array(shape["position"]), np.array(shape["size"])
    # The cube of the displaced volume, or of the mass in water.
    body = scene["vehicle"]["body"]
    edge = (body.get("volume") or body["mass"] / 1000.0) ** (1.0 / 3.0)
    return np.array(body.get("center_of_buoyancy", (0.0, 0.0, 0.0))), np.full(3, edge)


def vehicle_glb(scene: dict[str, Any]) -> bytes:
    """Vehicle with its thrusters' ducts, in its frame, as a GLB file."""
    shape = scene["vehicle"].get("shape") or {"kind": "box"}
    centre, size = vehicle_size(scene)
    coat = tuple(round(255 * c) for c in shape.get("colour", (0.96, 0.72, 0.11)))
    kinds = {"lattice": _lattice, "frame": _frame, "torpedo": _torpedo, "ellipsoid": _ellipsoid}
    meshes = kinds.get(shape["kind"], _box)(0.5 * size, coat)
    for mesh in meshes:
        mesh.apply_translation(centre)
    radius = 0.11 * float(np.prod(size)) ** (1.0 / 3.0)
    for thruster in scene["vehicle"].get("thrusters", ()):
        meshes += _duct(np.array(thruster["position"]), np.array(thruster["axis"]), radius)
    return _glb(meshes)


def link_glbs(scene: dict[str, Any], poses: NDArray[np.float64], tip: NDArray[np.float64]) -> list[bytes]:
    """Links of the arm, each in the frame of its joint, as GLB files.

    `poses` (n + 1, 4, 4) are the poses of the moving bodies at home, `tip` (4, 4) is the pose of the end effector.
    """
    arm = scene.get("arm")
    if arm is None:
        return []
    joints = [link["joint"] for link in arm["links"] if link.get("joint")]
    bodies = [link["body"] for link in arm["links"] if link.get("joint")]
    if joint := arm["mount"].get("joint"):
        joints, bodies = [joint, *joints], [arm["base"], *bodies]
    ends = [np.linalg.inv(a) @ b for a, b in zip(poses[1:], [*poses[2:], tip])]
    lengths = [float(np.linalg.norm(end[:3, 3])) for end in ends]
    total = max(sum(lengths), 1e-3)
    files = []
    for k, (joint, body, end, length) in enumerate(zip(joints, bodies, ends, lengths)):
        r = _link_radius(body, length, total)
        axis = np.array(joint["axis"], dtype=float)
        parts = [_rod(-1.35 * r * axis, 1.35 * r * axis, 1.18 * r, _JOINT)]
        parts += [_rod(s * 1.3 * r * axis, s * 1.45 * r * axis, 0.8 * r, _RING) for s in (-1.0, 1.0)]
        if k + 1 < len(joints):
            parts.append(_rod(np.zeros(3), end[:3, 3], 0.86 * r, _LINK))
        else:
            parts += _gripper(end, length, r)
        files.append(_glb(parts))
    return files


def dock_glb(scene: dict[str, Any]) -> bytes:
    """Dock about the docked vehicle, in the vehicle's frame, as a GLB file: the one of `src/render/dock.rs`."""
    centre, size = vehicle_size(scene)
    half = 0.5 * size
    s = float(np.prod(half)) ** (1.0 / 3.0)
    thin, buoy = 0.045 * s, 0.15 * s
    rear, end, wide, top = -half[0] - 0.3 * s, half[0] + 0.35 * s, half[1] + 0.3 * s + buoy, half[2] + 0.35 * s
    low, mouth, out, up = -0.5 * half[2], rear - 0.7 * s, wide + 0.5 * s, top + 0.4 * s
    parts = []

    def bar(start: Sequence[float], stop: Sequence[float], radius: float, colour: tuple[int, ...]) -> None:
        parts.append(_rod(centre + start, centre + stop, radius, colour))

    for side, light in ((-1.0, _STARBOARD), (1.0, _PORT)):
        y, flared = side * wide, side * out
        bar((rear, y, low), (end, y, low), buoy, _FLOAT)
        bar((rear, y, low), (mouth, flared, low), 0.75 * buoy, _FLOAT)
        bar((rear, y, top), (end, y, top), thin, _METAL)
        bar((rear, y, top), (mouth, flared, up), thin, _METAL)
        bar((mouth, flared, low), (mouth, flared, up), 1.2 * thin, _FLOAT)
        fender = end - 1.6 * thin, 0.5 * side * half[1]
        bar((*fender, low), (*fender, -low), 0.09 * s, _DARK)
        bar((mouth, flared, up + 0.12 * s), (mouth, flared, up + 0.12 * s), 0.11 * s, light)
        for x in (rear, 0.5 * (rear + end), end):
            bar((x, y, low), (x, y, top), thin, _METAL)
    bar((mouth, -out, up), (mouth, out, up), 1.2 * thin, _FLOAT)
    for x, z in ((rear, top), (0.5 * (rear + end), top), (end, top), (end, 0.1 * half[2])):
        bar((x, -wide, z), (x, wide, z), thin, _METAL)
    board, place = 0.3 * s, centre + np.array([end, 0.0, top + 0.32 * s])
    parts.append(_cuboid(place, (0.02 * s, board, board), _WHITE))
    parts.append(_cuboid(place, (0.03 * s, 0.5 * board, 0.5 * board), _DARK))
    return _glb(parts)


def payload_radius(mass: float) -> float:
    """Radius of a ball of 2500 kg/m3, m."""
    return float((mass / 2500.0 * 0.75 / math.pi) ** (1.0 / 3.0))


def _link_radius(body: dict[str, Any], length: float, total: float) -> float:
    """Radius of the cylinder of this volume and length, within bounds."""
    volume = body.get("volume") or body["mass"] / 1000.0
    even = math.sqrt(volume / (math.pi * max(length, 0.06 * total)))
    return float(min(max(even, 0.025 * total), 0.08 * total))


def _glb(parts: list[trimesh.Trimesh]) -> bytes:
    """GLB file of parts; parts of one colour are one mesh."""
    colours = sorted({part.metadata["colour"] for part in parts})
    scene = trimesh.Scene()
    for colour in colours:
        mesh = trimesh.util.concatenate([part for part in parts if part.metadata["colour"] == colour])
        # Colours of materials are linear. Without a material, GLB means metal.
        linear = [*((np.array(colour) / 255.0) ** 2.2), 1.0]
        material = trimesh.visual.material.PBRMaterial(baseColorFactor=linear, metallicFactor=0.1, roughnessFactor=0.6)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))


def _coloured(mesh: trimesh.Trimesh, colour: tuple[int, ...]) -> trimesh.Trimesh:
    mesh.metadata["colour"] = colour
    return mesh


def _cuboid(centre: ArrayLike, half: ArrayLike, colour: tuple[int, ...]) -> trimesh.Trimesh:
    mesh = creation.box(extents=2.0 * np.asarray(half))
    return _coloured(mesh.apply_translation(centre), colour)


def _rod(start: Vector, end: Vector, radius: float, colour: tuple[int, ...]) -> trimesh.Trimesh:
    """Cylinder from start to end; a ball where they coincide."""
    if np.linalg.norm(np.asarray(end) - start) < 1e-6:
        return _ball(start, np.full(3, radius), colour)
    return _coloured(creation.cylinder(radius, segment=[start, end], sections=24), colour)


def _ball(centre: ArrayLike, radii: ArrayLike, colour: tuple[int, ...]) -> trimesh.Trimesh:
    mesh = creation.icosphere(subdivisions=3).apply_scale(radii)
    return _coloured(mesh.apply_translation(centre), colour)


def _box(half: Vector, coat: tuple[int, ...]) -> list[trimesh.Trimesh]:
    x, y, z = half
    window = _cuboid((x, 0.0, 0.0), (0.015 * x, 0.55 * y, 0.4 * z), _DARK)
    stripe = _cuboid((0.0, 0.0, z), (0.7 * x, 0.12 * y, 0.012 * z), _NOSE)
    return [_cuboid(np.zeros(3), half, coat), window, stripe]


def _ellipsoid(half: Vector, coat: tuple[int, ...]) -> list[trimesh.Trimesh]:
    return [_ball(np.zeros(3), half, coat), _ball((0.9 * half[0], 0.0, 0.0), 0.45 * half, _NOSE)]


def _torpedo(half: Vector, coat: tuple[int, ...]) -> list[trimesh.Trimesh]:
    """Cylinder with a rounded nose, a tapered tail and four fins."""
    x, r = half[0], min(half[1:])
    nose = min(0.9 * x, 1.6 * r)
    angles = np.linspace(0.0, math.pi / 2, 12)
    profile = [(0.0, -x), (0.18 * r, -x), (r, -0.44 * x)]
    profile += [(r * math.cos(a), x - nose + nose * math.sin(a)) for a in angles]
    # Revolved about z, then turned to x.
    hull = creation.revolve(np.array(profile), sections=32)
    hull.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (0.0, 1.0, 0.0)))
    parts = [_coloured(hull, coat), _ball((x - 0.22 * nose, 0.0, 0.0), (0.23 * nose, 0.55 * r, 0.55 * r), _NOSE)]
    for k, side in ((1, -1.0), (1, 1.0), (2, -1.0), (2, 1.0)):
        centre, fin = np.array([-0.82 * x, 0.0, 0.0]), np.array([0.14 * x, 0.03 * r, 0.03 * r])
        centre[k], fin[k] = 0.95 * side * r, 0.62 * r
        parts.append(_cuboid(centre, fin, _DARK))
    return parts


def _frame(half: Vector, coat: tuple[int, ...]) -> list[trimesh.Trimesh]:
    """Open frame: floats on top, side plates, pressure hulls between them."""
    parts = []
    for s in (-1.0, 1.0):
        parts.append(_cuboid(half * (0.0, 0.31 * s, 0.72), half * (0.92, 0.27, 0.28), coat))
        parts.append(_cuboid(half * (0.0, 0.95 * s, -0.88), half * (1.0, 0.05, 0.12), _DARK))
        parts.append(_cuboid(half * (0.0, 0.95 * s, 0.46), half * (0.96, 0.03, 0.2), _DARK))
        parts += [_cuboid(half * (x, 0.95 * s, -0.26), half * (0.12, 0.03, 0.54), _DARK) for x in (-0.86, 0.0, 0.86)]
        lamp = half * (0.9, 0.6 * s, -0.05)
        parts.append(_rod(lamp, lamp + half * (0.11, 0.0, 0.0), 0.09 * half[2], _LAMP))
    for x in (-0.9, 0.9):
        parts.append(_cuboid(half * (x, 0.0, -0.88), half * (0.05, 0.95, 0.06), _DARK))
        parts.append(_cuboid(half * (x, 0.0, 0.4), half * (0.04, 0.95, 0.07), _DARK))
    r = 0.42 * min(half[1:])
    parts.append(_rod(half * (-0.7, 0.0, 0.12), half * (0.62, 0.0, 0.12), r, _WHITE))
    parts.append(_ball(half * (0.64, 0.0, 0.12), np.full(3, 0.98 * r), (111, 169, 196)))
    parts.append(_rod(half * (-0.6, 0.0, -0.62), half * (0.6, 0.0, -0.62), 0.7 * r, _METAL))
    return parts


def _lattice(half: Vector, coat: tuple[int, ...]) -> list[trimesh.Trimesh]:
    """Perforated box about a pressure hull."""
    beam = 0.055 * max(half)
    pale = tuple(round(0.88 * c + 0.12 * w) for c, w in zip(coat, _WHITE))
    inner = half - beam
    parts = []
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        for a, b in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
            centre, edge = np.zeros(3), np.full(3, beam)
            centre[u], centre[v], edge[k] = a * inner[u], b * inner[v], half[k]
            parts.append(_cuboid(centre, edge, coat))
        # Bars of the two faces across this axis; the top and bottom are closed more than the others.
        width = (1.3 if k == 2 else 0.75) * beam
        for run, over in ((u, v), (v, u)):
            for side in (-1.0, 1.0):
                for place in (-0.5, 0.0, 0.5):
                    centre, bar = np.zeros(3), np.zeros(3)
                    centre[k], centre[over] = side * inner[k], place * half[over]
                    bar[k], bar[run], bar[over] = 0.35 * beam, inner[run], width
                    parts.append(_cuboid(centre, bar, pale))
    r = 0.34 * min(half[1:])
    parts.append(_rod(half * (-0.6, 0.0, 0.0), half * (0.6, 0.0, 0.0), r, _WHITE))
    parts += [_rod(half * (x - 0.05, 0, 0), half * (x + 0.05, 0, 0), 1.06 * r, _METAL) for x in (-0.35, 0.35)]
    badge = half * (1.0, 0.0, 0.0)
    parts.append(_cuboid(badge, (0.6 * beam, 0.28 * half[1], 0.16 * half[2]), _DARK))
    for s in (-1.0, 1.0):
        lamp = np.add(badge, (0.5 * beam, 0.17 * s * half[1], 0.0))
        parts.append(_rod(lamp, np.add(lamp, (0.5 * beam, 0.0, 0.0)), 0.07 * half[2], _LAMP))
    return parts


def _duct(position: Vector, axis: Vector, radius: float) -> list[trimesh.Trimesh]:
    half = 0.55 * radius
    frame = trimesh.geometry.align_vectors((0.0, 0.0, 1.0), axis)
    frame[:3, 3] = position
    ring = creation.annulus(0.84 * radius, 1.03 * radius, 2.0 * half, sections=24)
    hub = creation.cylinder(0.26 * radius, 1.3 * half, sections=12)
    blades = [creation.box((1.1 * radius, 0.3 * radius, 0.05 * radius)) for _ in range(3)]
    for k, blade in enumerate(blades):
        blade.apply_transform(trimesh.transformations.rotation_matrix(0.6, (1.0, 0.0, 0.0)))
        blade.apply_translation((0.3 * radius, 0.0, 0.0))
        blade.apply_transform(trimesh.transformations.rotation_matrix(2.0 * math.pi * k / 3.0, (0.0, 0.0, 1.0)))
    parts = [_coloured(ring, _DUCT), _coloured(hub, _METAL), *(_coloured(blade, (138, 148, 158)) for blade in blades)]
    return [part.apply_transform(frame) for part in parts]


def _gripper(end: NDArray[np.float64], length: float, r: float) -> list[trimesh.Trimesh]:
    """Palm and two fingers, open towards the end effector."""
    reach = end[:3, 3]
    if length < 1e-6:
        return [_ball(reach, np.full(3, 0.3 * r), _TIP)]
    # Fingers turn with the end effector: of its axes that most across the reach.
    ahead = reach / length
    across = max((end[:3, k] - ahead * (end[:3, k] @ ahead) for k in range(3)), key=np.linalg.norm)
    across = across / np.linalg.norm(across)
    palm = 0.5 * reach
    parts = [
        _rod(np.zeros(3), palm, 0.86 * r, _LINK),
        _rod(palm - 1.2 * r * across, palm + 1.2 * r * across, 0.5 * r, _JOINT),
    ]
    for side in (-r * across, r * across):
        knee = 0.72 * reach + 1.15 * side
        parts.append(_rod(palm + 0.85 * side, knee, 0.24 * r, _JOINT))
        parts.append(_rod(knee, 0.99 * reach + 0.42 * side, 0.2 * r, _JOINT))
    return [*parts, _ball(reach, np.full(3, 0.3 * r), _TIP)]
