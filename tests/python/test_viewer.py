"""Browser view of episodes: `uvms play --web`."""

import socket
import threading
import time
import urllib.request
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import free_port

import uvms_gym
from uvms_gym.cli import main
from uvms_gym.viewer.episode import Conditions, LiveEpisode

STORM = "UVMS-StationKeep-Storm-v0"


def live(env: str = STORM, controller: str = "pd", **options: Any) -> LiveEpisode:
    made = gymnasium.make(env, threads=1, disable_env_checker=True, **options)
    return LiveEpisode(made.unwrapped, controller, 3)  # type: ignore[arg-type]


def test_strength_scales_flow_and_loads_and_leaves_sensors() -> None:
    storm = live().components
    assert Conditions(1.0, 0.2).disturbance(storm)["waves"] == storm["waves"]
    double, none = (Conditions(strength).disturbance(storm) for strength in (2.0, 0.0))
    assert double["waves"]["height"] == [2.0 * x for x in storm["waves"]["height"]]
    assert (none["gust"]["speed"], none["thrusters"]["gain"]) == ([0.0, 0.0], [1.0, 1.0])
    assert none["noise"] == double["noise"] == storm["noise"]
    assert none["delay"] == storm["delay"]


@pytest.mark.parametrize("env", [STORM, "UVMS-EETrack-Storm-v0"])
def test_a_change_goes_on_from_the_present_state(env: str) -> None:
    episode = live(env, "pd" if env == STORM else "resolved")
    start = episode.after["aim"][:3, 3]
    for _ in range(10):
        assert episode.step()
    before = episode.env.snapshot()
    target = (np.array([0.2, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
    episode.change(target, payload=1.5, current=0.0, strength=0.0)
    after = episode.env.snapshot()
    for quantity in ("position", "quaternion", "twist", "q", "qd"):
        np.testing.assert_allclose(getattr(after, quantity), getattr(before, quantity), rtol=0.0, atol=1e-12)
    assert after.parameters["payload"] == [1.5]
    # In still water, without a storm, the current is zero; before it was not.
    assert np.linalg.norm(after.current) == 0.0 < np.linalg.norm(before.current)
    # The reference of an end effector begins anew, moved by as much.
    np.testing.assert_allclose(episode.after["aim"][:3, 3] - start, target[0], rtol=0.0, atol=1e-12)
    assert episode.time == pytest.approx(1.0)


def test_a_refused_change_leaves_the_episode() -> None:
    episode = live()
    episode.step()
    with pytest.raises(ValueError, match="target_position"):
        episode.change((np.full(3, np.nan), np.array([1.0, 0.0, 0.0, 0.0])))
    assert episode.step()
    assert not episode.target[0].any()


def test_a_reset_repeats_the_episode() -> None:
    episode, ends = live(), []
    for _ in range(2):
        for _ in range(15):
            episode.step()
        ends.append(episode.after["poses"])
        episode.reset()
    np.testing.assert_array_equal(*ends)


def listening(port: int) -> set[str]:
    """Local addresses, in hexadecimal, that listen at a port."""
    rows = [line.split() for file in ("tcp", "tcp6") for line in Path(f"/proc/net/{file}").read_text().splitlines()[1:]]
    return {row[1].split(":")[0] for row in rows if row[3] == "0A" and int(row[1].split(":")[1], 16) == port}


def test_the_page_is_served_only_to_this_machine(viewer: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert listening(viewer.server.get_port()) == {"0100007F"}
    with urllib.request.urlopen(viewer.url, timeout=5.0) as page:
        assert page.status == 200
    # A browser asks for viser's public tunnel.
    from viser._messages import ShareUrlRequest

    tunnels: list[Any] = []
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *arguments: tunnels.append(arguments))
    (handler,) = viewer.server._websock_server._incoming_handlers[ShareUrlRequest]
    handler(0, None)
    viewer.server._thread_executor.shutdown(wait=True)
    assert tunnels == []


def test_a_closed_viewer_leaves_no_thread_and_no_port() -> None:
    pytest.importorskip("viser")
    from uvms_gym.viewer.server import Viewer

    before, port = set(threading.enumerate()), free_port()
    Viewer(live(), "title", port).close()
    until = time.monotonic() + 5.0
    while set(threading.enumerate()) - before and time.monotonic() < until:
        time.sleep(0.01)
    assert set(threading.enumerate()) <= before
    assert listening(port) == set()


def test_controls_act_at_the_next_picture(viewer: Any) -> None:
    episode, page = viewer.episode, viewer.page
    for _ in range(6):
        viewer.picture(1.0 / 30.0)
    assert episode.time == pytest.approx(0.2)
    body = np.array(viewer.world._bodies[0].position)
    low, high = sorted((episode.before["poses"][0, 0, 3], episode.after["poses"][0, 0, 3]))
    assert low <= body[0] <= high
    page.payload.value = 2.0
    act(viewer)
    assert episode.conditions.payload == 2.0
    page.press("Pause")
    viewer.picture(1.0)
    paused = episode.time
    page.press("Step")
    viewer.picture(1.0)
    assert episode.time == pytest.approx(paused + episode.period)
    for family, setting, expected in (("ppo", None, "ppo"), ("dob", "calm", "dob/calm"), ("pd", None, "pd")):
        page.controller.value = family
        act(viewer)
        if setting is not None:
            page.setting.value = setting
            act(viewer)
        assert episode.controller == expected
    page.press("Reset")
    viewer.picture(0.0)
    assert episode.time == 0.0


def act(viewer: Any) -> None:
    """Wait for the callback, which runs in a thread of the server; then one picture."""
    end = time.monotonic() + 2.0
    while not viewer.page._commands:
        assert time.monotonic() < end, "the callback put no command"
        time.sleep(0.01)
    viewer.picture(0.0)


def test_a_taken_port_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["play", "--web", "--port", str(port)]) == 2
    error = capsys.readouterr().err
    assert f"--port is {port}, but 127.0.0.1 refuses it" in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy", "remus-100"])
def test_a_dock_leaves_room_for_the_vehicle(scene: str) -> None:
    renderer = uvms_gym.Renderer(scene)
    (centre, size), (vertices, *_) = renderer.bounding_box, renderer.meshes()["dock"]
    away = (vertices - centre) / (0.5 * size)
    # Outside of the vehicle's box, and on all sides but below.
    assert (np.abs(away).max(axis=1) > 1.0).all()
    assert (away.min(axis=0)[:2] < -1.0).all()
    assert (away.max(axis=0) > 1.0).all()


def test_the_mesh_of_the_last_link_ends_at_the_end_effector() -> None:
    simulator = uvms_gym.Simulator("petasus-pum")
    simulator.set_state(q=simulator.q + 0.3)
    names = [f"link {k + 1}" for k in range(simulator.q.shape[1])]
    meshes = uvms_gym.Renderer("petasus-pum").meshes()
    assert list(meshes) == ["vehicle", *names, "dock"]
    vertices, normals, colours, triangles = meshes[names[-1]]
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    assert triangles.max() == len(vertices) - 1
    # The ball at the end effector has its own colour.
    ball = vertices[np.isclose(colours, np.array((255, 47, 208)) / 255.0).all(axis=1)]
    pose = simulator.body_poses()[0, -1]
    centre = pose[:3, :3] @ (0.5 * (ball.min(axis=0) + ball.max(axis=0))) + pose[:3, 3]
    assert np.allclose(centre, simulator.end_effector_pose()[0, :3, 3], atol=1e-3)
