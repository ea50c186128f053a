"""A dock that the vehicle touches: forces, conditions of success, starts, parity, pictures."""

import copy

import gymnasium as gym
import numpy as np
import pytest
from helpers import SMALL, assert_parity, run

import uvms_gym
from uvms_gym import DockPD, Simulator
from uvms_gym.envs import DockEnv, DockVectorEnv

SCENES = ["petasus-pum", SMALL, "rexrov"]
PLANKS = ["dock-port", "dock-port-entrance", "dock-starboard", "dock-starboard-entrance"]
POSTS = ["dock-port-post", "dock-starboard-post"]
#: Weight in water of a vehicle that rests in the cradle, N.
WEIGHT = 12.0


def cradle(scene=SMALL, **options):
    return DockEnv(scene=scene, **options)


def heavy(scene=SMALL, **options):
    """Simulator of the dock's scene with a vehicle that is heavier than water."""
    found = copy.deepcopy(cradle(scene).unwrapped.snapshot().scene)
    body, water = found["vehicle"]["body"], found["water"]
    body["volume"] = body["mass"] / water["density"] - WEIGHT / (water["density"] * 9.81)
    found["water"]["gravity"] = [0.0, 0.0, -9.81]
    return Simulator(found, **options)


def forces(simulator):
    """Forces on the vehicle by shape, world axes, N."""
    names = [shape["name"] for shape in simulator.scene["contact"]["shapes"]]
    return dict(zip(names, simulator.contacts()["force"][0].sum(axis=1), strict=True))


def settle(simulator, wrench=(0.0,) * 6, steps=4000):
    for _ in range(steps // 100):
        simulator.step(wrench=np.array([wrench]), substeps=100)
    return forces(simulator)


def test_a_vehicle_at_rest_presses_with_its_weight_in_water():
    simulator = heavy(dt=0.005)
    found = settle(simulator)
    np.testing.assert_allclose(sum(found.values()), [0.0, 0.0, WEIGHT], atol=1e-3 * WEIGHT)
    for name in ("dock-port", "dock-starboard"):
        assert found[name][2] == pytest.approx(0.5 * WEIGHT, rel=1e-2)
    assert all(not found[name].any() for name in found if "entrance" in name)
    # Some tenths of a millimetre deep, and at rest.
    assert 1e-4 < simulator.contacts()["depth"].max() < 2e-3
    assert np.abs(simulator.twist).max() < 1e-4
    assert np.linalg.norm(simulator.position) < 2e-3


@pytest.mark.parametrize("push", [20.0, 40.0])
def test_the_posts_alone_stop_a_vehicle_that_is_pushed_forward(push):
    simulator = heavy(dt=0.005)
    found = settle(simulator, (push, 0.0, 0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(sum(found[name][0] for name in POSTS), -push, rtol=2e-3)
    assert abs(sum(found[name][0] for name in PLANKS)) < 2e-3 * push
    assert 0.0 < simulator.position[0, 0] < 5e-3
    # Without the dock it goes on.
    free = Simulator(SMALL, dt=0.005)
    free.step(wrench=np.array([[push, 0.0, 0.0, 0.0, 0.0, 0.0]]), substeps=1000)
    assert free.position[0, 0] > 1.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_plank_stops_a_vehicle_that_is_pushed_aside(side):
    simulator = heavy(dt=0.005)
    push = 0.5
    found = settle(simulator, (0.0, side * push, 0.0, 0.0, 0.0, 0.0), 8000)
    near, far = ("dock-port", "dock-starboard")[:: int(side)]
    # The push is along the vehicle's axis, which has rolled.
    wanted = [0.0, 0.0, WEIGHT] - simulator.rotation[0] @ [0.0, side * push, 0.0]
    np.testing.assert_allclose(sum(found.values()), wanted, atol=0.01)
    assert side * found[near][1] < -push < 0.0 < side * found[far][1]
    # It swings in the trough, and goes no further.
    assert 0.0 < side * simulator.position[0, 1] < 0.03


@pytest.mark.parametrize(("push", "slides"), [(6.0, True), (1.0, False)])
def test_friction_of_the_planks_is_coulombs(push, slides):
    """0.2 of the normal force where the vehicle slides out, regularised below 10 mm/s."""
    simulator = heavy(dt=0.005)
    settle(simulator)
    simulator.step(wrench=np.array([[-push, 0.0, 0.0, 0.0, 0.0, 0.0]]), substeps=70)
    found, speed = forces(simulator), -simulator.twist[0, 0]
    for name in ("dock-port", "dock-starboard"):
        along, normal = found[name][0], np.hypot(*found[name][1:])
        assert normal == pytest.approx(0.5 * WEIGHT / np.cos(0.6), rel=0.02)
        assert along / normal == pytest.approx(0.2 * speed / np.hypot(speed, 0.01), rel=1e-2)
    assert (speed > 0.05) == slides and (speed < 0.005) != slides


def test_the_ledger_of_energy_closes_in_an_impact():
    simulator = heavy(dt=2e-4)
    simulator.set_state(position=[[-0.03, 0.01, 0.02]], twist=[[0.3, 0.05, -0.1, 0.1, 0.0, 0.2]])
    start, work, before = simulator.energy()["total"][0], 0.0, simulator.power()["total"][0]
    deepest = 0.0
    for _ in range(5000):
        simulator.step()
        after = simulator.power()["total"][0]
        work, before = work + 1e-4 * (before + after), after
        deepest = max(deepest, simulator.contacts()["depth"].max())
    lost = start - simulator.energy()["total"][0]
    assert deepest > 2e-3 and lost > 0.3
    assert lost == pytest.approx(-work, rel=1e-3)


@pytest.mark.parametrize("scene", SCENES)
def test_episodes_start_in_front_of_the_entrance(scene):
    envs = DockVectorEnv(64, scene=scene, target_distance=2.0, target_heading=3.0)
    envs.reset(seed=4)
    contacts = envs.snapshot().contacts()
    assert contacts["depth"].max() < 0.0
    assert not envs.episode["target_position"].any()
    assert (envs.episode["target_rotation"] == np.eye(3)).all()


def test_the_cradle_does_not_move_with_the_waves():
    envs = DockVectorEnv(2, scene=SMALL, disturbance="storm")
    envs.reset(seed=1)
    for _ in range(20):
        envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))
        assert not envs.episode["target_position"].any()
        assert (envs.episode["target_rotation"] == np.eye(3)).all()


def test_a_docked_vehicle_touches_the_dock():
    envs = DockVectorEnv(32, scene=SMALL, disturbance="calm")
    last = run(envs, DockPD(envs), 400, seed=100).last
    docked = last["docked"] == 1.0
    assert docked.mean() >= 0.9 and (last["contact_force"][docked] > 1.0).all()
    assert (last["peak_force"] >= last["contact_force"]).all() and (last["impulse"] > 0.0).all()


def test_success_needs_contact():
    """A vehicle that keeps to the docking pose without being pressed on the dock has not docked."""
    for press, wanted in (([0.0, 0.0], 0.0), ([0.15, 0.1], 1.0)):
        envs = DockVectorEnv(16, scene=SMALL, disturbance="calm")
        last = run(envs, DockPD(envs, press=press), 400, seed=2).last
        assert (last["position_error"] < 0.1).all()
        assert (last["success"] == wanted).all()


def test_the_vector_environment_is_the_single_one():
    arguments = {"scene": SMALL, "dtype": "float32", "disturbance": "storm", "start_distance": 2.0}
    envs = DockVectorEnv(3, max_episode_steps=25, **arguments)
    assert_parity(envs, lambda: gym.wrappers.TimeLimit(DockEnv(**arguments), 25), 60)


def own_spheres(places):
    scene = copy.deepcopy(Simulator(SMALL).scene)
    spheres = [
        {"name": f"skid-{k}", "on": "vehicle", "position": place, "radius": 0.02} for k, place in enumerate(places)
    ]
    scene["contact"] = {"spheres": spheres}
    return scene


def test_spheres_of_the_vehicle_rest_in_the_cradle():
    skids = [[x, y, -0.2] for x in (-0.2, 0.2) for y in (-0.15, 0.15)]
    scene = cradle(own_spheres(skids)).unwrapped.snapshot().scene
    assert [sphere["name"] for sphere in scene["contact"]["spheres"]] == [f"skid-{k}" for k in range(4)]
    # The spheres touch the planks, and no other shape is inside them.
    depth = Simulator(scene).contacts()["depth"][0]
    names = [shape["name"] for shape in scene["contact"]["shapes"]]
    for name, row in zip(names, depth, strict=True):
        assert row.max() == pytest.approx(0.0, abs=1e-12) or row.max() < 0.0, name
    assert depth[names.index("dock-port")].max() == pytest.approx(0.0, abs=1e-12)


def test_scenes_that_do_not_fit_are_refused_in_one_line():
    with pytest.raises(ValueError, match=r'"bluerov2-heavy" does not fit.*has 2 contact spheres, but at least 4'):
        cradle(own_spheres([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]]))
    again = cradle().unwrapped.snapshot().scene
    with pytest.raises(ValueError, match=r"dock-port") as error:
        cradle(again)
    assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match="harbour"):
        DockEnv(scene=SMALL, dock="harbour")


def test_the_drawn_dock_is_the_touched_one():
    env = cradle(render_mode="rgb_array", start_distance=2.5)
    env.reset(seed=0)
    scene = env.unwrapped.snapshot().scene
    meshes = uvms_gym.Renderer(scene).meshes()
    # The garage of a floating dock is not drawn; the shapes are, with all their corners.
    assert len(meshes["dock"][0]) == 0
    vertices = meshes["world"][0]
    for shape in scene["contact"]["shapes"]:
        apart = vertices - np.array(shape["frame"]["position"])
        reach = 0.5 * np.linalg.norm(shape["size"])
        assert np.abs(np.linalg.norm(apart, axis=1) - reach).min() < 1e-5
    red, green, blue = np.moveaxis(env.render().astype(int), 2, 0)
    assert ((red > 1.15 * green) & (green > 1.5 * blue)).sum() > 100
