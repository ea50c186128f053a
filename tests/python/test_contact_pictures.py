"""Shapes of contact in pictures and in the browser view."""

from typing import Any

import numpy as np
import pytest
from helpers import free_port

import uvms_gym
from uvms_gym import Renderer, Simulator

FACE = [0.0, -np.pi / 2.0, 0.0]
SEABED = {"name": "seabed", "kind": "plane", "frame": {"position": [0.0, 0.0, -0.9]}}
PANEL = {"name": "panel", "kind": "box", "size": [0.04, 0.9, 0.7], "frame": {"position": [1.0, 0.0, -0.2]}}
POST = {"name": "post", "kind": "cylinder", "radius": 0.04, "length": 1.3, "frame": {"position": [1.1, 0.3, -0.3]}}
RIM = {"name": "rim", "on": "valve", "kind": "torus", "radius": 0.12, "tube": 0.015}
CAP = {"name": "cap", "on": "button", "kind": "cylinder", "radius": 0.05, "length": 0.06}
VALVE, BUTTON = [0.9, 0.15, -0.2], [0.95, -0.25, -0.1]
LEVEL = (np.zeros(3), np.eye(3))


def scene_with(*shapes: dict[str, Any], fixtures: bool = False) -> dict[str, Any]:
    scene = uvms_gym.load_scene("bluerov2-heavy-alpha5")
    scene["contact"] = {"shapes": list(shapes)}
    joint = {"axis": [0.0, 0.0, 1.0], "rotor_inertia": 0.1}
    if fixtures:
        scene["fixtures"] = [
            {"name": "valve", "joint": {**joint, "kind": "revolute", "frame": {"position": VALVE, "rpy": FACE}}},
            {"name": "button", "joint": {**joint, "kind": "prismatic", "frame": {"position": BUTTON, "rpy": FACE}}},
        ]
    return scene


STATION = scene_with(SEABED, PANEL, POST, RIM, CAP, fixtures=True)


def changed(one: Any, other: Any) -> Any:
    """Columns and rows, from 0.5, of the pixels that differ."""
    rows, columns = np.nonzero((one != other).any(axis=2))
    return np.stack([columns, rows], axis=1) + 0.5


@pytest.mark.parametrize(("index", "motion", "place", "size"), [(-2, 1.5, VALVE, 0.14), (-1, -0.05, BUTTON, 0.11)])
def test_a_fixture_is_drawn_at_its_coordinate(index: int, motion: float, place: Any, size: float) -> None:
    simulator, renderer = Simulator(STATION), Renderer(STATION)
    q = simulator.q[0].copy()
    before = renderer.draw(*LEVEL, q)
    q[index] += motion
    moved = changed(before, renderer.draw(*LEVEL, q))
    assert len(moved) > 20
    [[x, y, _], *others] = renderer.project(
        np.array([place, *(place + size * np.eye(3)), *(place - size * np.eye(3))]), *LEVEL
    )
    assert np.linalg.norm(moved - [x, y], axis=1).max() < 1.1 * max(np.hypot(u - x, v - y) for u, v, _ in others)


WALL = {"name": "wall", "kind": "plane", "frame": {"position": [1.0, 0.0, 0.0], "rpy": FACE}}
SLOPE = {"name": "slope", "kind": "plane", "frame": {"position": [0.0, 0.0, -0.9], "rpy": [0.0, -0.3, 0.0]}}
HIDING = [
    (SEABED, [0.2, -0.3, -1.1], [0.2, -0.3, -0.7]),
    # Solid beyond x = 1.
    (WALL, [1.2, 0.0, 0.0], [0.8, 0.0, 0.0]),
    (SLOPE, [0.4, 0.0, -1.0], [0.4, 0.0, -0.6]),
    (PANEL, [1.2, 0.0, -0.2], [0.8, 0.0, -0.2]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("shape", "inside", "outside"), HIDING, ids=lambda shape: isinstance(shape, dict) and shape["name"]
)
def test_a_shape_hides_what_is_behind_it(shape: dict[str, Any], inside: Any, outside: Any) -> None:
    for scene, hidden in ((scene_with(shape), True), (scene_with(), False)):
        # From behind the vehicle, where the arm hides nothing.
        renderer = Renderer(scene, azimuth=-2.4, distance=4.0)
        bare = renderer.draw(*LEVEL)
        for at, expected in ((inside, hidden), (outside, False)):
            path = np.array([at, np.add(at, [0.0, 0.05, 0.0])])
            assert (len(changed(bare, renderer.draw(*LEVEL, path=path))) == 0) == expected


def test_near_shapes_are_in_the_picture_and_hide_no_vehicle() -> None:
    plain, renderer = Renderer(scene_with()), Renderer(STATION)
    corners = np.array([[1.0, y, z] for y in (-0.45, 0.45) for z in (-0.55, 0.15)])
    seen = renderer.project(corners, *LEVEL)[:, :2]
    assert (seen > 0.0).all() and (seen < [640.0, 480.0]).all()
    # The panel is in front of the vehicle (x), and the camera behind it.
    assert np.cos(plain.azimuth) > 0.0 > np.cos(renderer.azimuth) and np.sin(renderer.azimuth) < 0.0
    assert renderer.floor == -0.9
    far = {**PANEL, "frame": {"position": [20.0, 0.0, 0.0]}}
    distant = Renderer(scene_with(far))
    np.testing.assert_array_equal(distant.project(corners, *LEVEL), plain.project(corners, *LEVEL))
    # A long pipe counts by its part beside the vehicle.
    pipe = {**POST, "length": 200.0, "frame": {"position": [0.0, -1.0, -0.4], "rpy": [0.0, np.pi / 2.0, 0.0]}}
    ahead = Renderer(scene_with(pipe)).project([[0.0, 0.0, 0.0]], *LEVEL)[0, 2]
    assert ahead < 3.0 * plain.project([[0.0, 0.0, 0.0]], *LEVEL)[0, 2]


def beyond(q: Any) -> Any:
    return np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)


def test_triangles_are_on_the_surfaces() -> None:
    meshes = Renderer(STATION).meshes()
    assert list(meshes)[-4:] == ["fixture 1", "fixture 2", "world", "dock"]
    rim, cap, world = (meshes[name][0].astype(float) for name in ("fixture 1", "fixture 2", "world"))
    ring = np.hypot(np.hypot(rim[:, 0], rim[:, 1]) - 0.12, rim[:, 2])
    np.testing.assert_allclose(ring, 0.015, atol=1e-6)
    cylinder = beyond(np.stack([np.hypot(cap[:, 0], cap[:, 1]) - 0.05, np.abs(cap[:, 2]) - 0.03], axis=1))
    np.testing.assert_allclose(cylinder, 0.0, atol=1e-6)
    panel, post = world - [1.0, 0.0, -0.2], world - [1.1, 0.3, -0.3]
    box = beyond(np.abs(panel) - [0.02, 0.45, 0.35])
    tube = beyond(np.stack([np.hypot(post[:, 0], post[:, 1]) - 0.04, np.abs(post[:, 2]) - 0.65], axis=1))
    assert (np.abs(box) < 1e-6).sum() >= 24
    np.testing.assert_allclose(np.minimum(np.abs(box), np.abs(tube)), 0.0, atol=1e-6)


def with_spheres() -> dict[str, Any]:
    scene = scene_with(SEABED)
    wrist = {"name": "tip", "on": "wrist", "position": [0.12, 0.01, -0.02], "radius": 0.05}
    camera = {"name": "camera", "parent": scene["arm"]["links"][0]["name"], "joint": {"kind": "fixed"}}
    camera["joint"]["frame"] = {"position": [0.1, 0.0, 0.05], "rpy": [0.3, 0.2, 0.1]}
    scene["arm"]["links"].append(camera)
    lens = {"name": "lens", "on": "camera", "position": [0.02, 0.03, 0.04], "radius": 0.01}
    skid = {"name": "skid", "on": "vehicle", "position": [0.2, 0.1, -0.25], "radius": 0.03}
    scene["contact"]["spheres"] = [wrist, lens, skid]
    return uvms_gym.load_scene(scene)


def test_spheres_are_drawn_where_contact_has_them() -> None:
    scene = with_spheres()
    simulator, renderer = Simulator(scene), Renderer(scene)
    q = simulator.q + np.linspace(0.1, 0.5, simulator.num_joints)
    simulator.set_state(position=[0.1, 0.2, 0.3], q=q)
    found, radii = simulator.contacts(), np.array([radius for *_, radius in renderer.spheres])
    # A contact's point is the middle of the penetration.
    arm = found["normal"][0, 0] * (0.5 * found["depth"][0, 0] - radii)[:, None]
    poses = simulator.body_poses()[0]
    centers = np.array([(poses[body] @ [*center, 1.0])[:3] for body, center, _ in renderer.spheres])
    np.testing.assert_allclose(centers, found["point"][0, 0] - arm, atol=1e-12)

    place = (simulator.position[0], simulator.rotation[0])

    def draw(*spheres: dict[str, Any]) -> Any:
        return Renderer({**scene, "contact": {**scene["contact"], "spheres": list(spheres)}}).draw(*place, q[0])

    before, after = draw(), draw(scene["contact"]["spheres"][0])
    moved = changed(before, after)
    middle, edge = renderer.project(np.array([centers[0], centers[0] + [0.0, 0.0, 0.05]]), *place)[:, :2]
    size = np.linalg.norm(edge - middle)
    assert len(moved) > 0.5 * np.pi * size**2
    assert np.linalg.norm(moved - middle, axis=1).max() < 1.2 * size
    # The tool is seen through it.
    columns, rows = moved.astype(int).T
    assert after[rows, columns].std(axis=0).max() > 0.4 * before[rows, columns].std(axis=0).max()


def test_poses_of_fixtures_are_those_of_their_joints() -> None:
    simulator = Simulator(STATION, 2)
    q = simulator.q
    q[1, -2:] = [0.7, -0.3]
    simulator.set_state(position=[[1.0, 2.0, 3.0]] * 2, q=q)
    assert simulator.fixture_poses().shape == (2, 2, 4, 4)
    turn, slide = simulator.fixture_poses()[1]
    # The frames' z axis points to -x.
    np.testing.assert_allclose(turn[:3, 2], [-1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn[:3, 0], [0.0, np.sin(0.7), np.cos(0.7)], atol=1e-12)
    np.testing.assert_allclose(turn[:3, 3], VALVE, atol=1e-12)
    np.testing.assert_allclose(slide[:3, 3], np.add(BUTTON, [0.3, 0.0, 0.0]), atol=1e-12)
    assert Simulator("free-body").fixture_poses().shape == (1, 0, 4, 4)


def test_the_browser_view_shows_and_moves_them() -> None:
    viser = pytest.importorskip("viser")
    from uvms_gym.viewer.world import World

    skid = {"name": "skid", "on": "vehicle", "position": [0.2, 0.1, -0.2], "radius": 0.03}
    simulator = Simulator({**STATION, "contact": {**STATION["contact"], "spheres": [skid]}})
    server = viser.ViserServer(port=free_port(), verbose=False)
    try:
        world = World(server, simulator, (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
        shots = []
        for motion in (0.0, 0.8):
            q = simulator.q.copy()
            q[0, -2:] += motion
            simulator.set_state(q=q)
            poses = np.concatenate([simulator.body_poses(), simulator.end_effector_pose()[:, None]], axis=1)[0]
            still = {"thrust": np.zeros(simulator.num_thrusters), "current": np.zeros(3), "aim": np.eye(4)}
            fixtures = simulator.fixture_poses()[0]
            shots.append({**still, "poses": poses, "fixtures": fixtures, "path": np.zeros((0, 3)), "payload": 0.0})
        world.show(*shots, 1.0)
        valve, button = world._fixtures.values()
        np.testing.assert_allclose(valve.position, VALVE, atol=1e-12)
        np.testing.assert_allclose(button.position, np.subtract(BUTTON, [0.8, 0.0, 0.0]), atol=1e-12)
        # About the frame's z axis, which points to -x.
        turn = viser.transforms.SO3(np.array(valve.wxyz)) @ viser.transforms.SO3(np.array(button.wxyz)).inverse()
        np.testing.assert_allclose(turn.log(), [-0.8, 0.0, 0.0], atol=1e-9)
        assert {"/world/surroundings", "/world/floor", "/world/bodies/0/spheres/0"} <= set(
            server.scene._handle_from_node_name
        )
    finally:
        server.stop()
