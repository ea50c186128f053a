"""Pictures of `uvms play`: nothing that matters is covered, and every curve differs from the others."""

import itertools
import re
import sys
from pathlib import Path
from typing import Any
from unittest import mock

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

import uvms_gym
from uvms_gym import Renderer
from uvms_gym.cli import main
from uvms_gym.cli.film import COLOURS, Overlay, film
from uvms_gym.cli.pictures import Frame, read_settings
from uvms_gym.cli.play import _run
from uvms_gym.envs.rendering import between, shots
from uvms_gym.viewer.curves import CURVES, error_curves

TASKS = {"UVMS-StationKeep-Storm-v0": "pd", "UVMS-EETrack-Storm-v0": "resolved", "UVMS-Dock-Storm-v0": "dock-pd"}
SCENES = ("petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy")
CASES = [
    (task, scene)
    for task, scene in itertools.product(TASKS, SCENES)
    if not (task.startswith("UVMS-EETrack") and scene == "bluerov2-heavy")
]


def play(task: str, scene: str, seed: int, steps: int, look: Any) -> None:
    """Call `look(env, info)` at the start of an episode and after each control period."""
    env = gym.make(task, scene=scene)
    controller, state = uvms_gym.make_controller(TASKS[task], env), None
    observation, info = env.reset(seed=seed)
    look(env.unwrapped, info)
    for _ in range(steps):
        action, state = controller.predict(observation, state)
        observation, _, _, _, info = env.step(action)
        look(env.unwrapped, info)
    env.close()


@pytest.mark.parametrize(("task", "scene"), CASES)
@pytest.mark.parametrize("size", [(640, 480), (960, 540)])
def test_the_task_is_inside_the_picture_of_the_scene(task: str, scene: str, size: tuple[int, int]) -> None:
    env = gym.make(task, scene=scene)
    overlay = Overlay("title", "", 4.0, size, error_curves(env))
    width, height = overlay.view
    renderer = Renderer(scene, width=width, height=height)

    def look(env: Any, _: Any) -> None:
        shot = {name: rows[0] for name, rows in shots(env._native).items()}
        aims = {name: shot[name] for name in ("target", "point", "dock") if name in shot}
        points = [env.snapshot().end_effector_pose()[0, :3, 3], shot["position"], *(a[:3, 3] for a in aims.values())]
        for x, y, _depth in renderer.project(points, shot["position"], shot["rotation"], **aims):
            assert 0.0 < x < width
            assert 0.0 < y < height

    for seed in range(4):
        play(task, scene, seed, 40, look)


@pytest.mark.parametrize("scene", SCENES)
def test_a_dock_is_seen_from_the_start(scene: str) -> None:
    env: Any = gym.make("UVMS-Dock-v0", scene=scene, render_mode="rgb_array")
    env.reset(seed=3)
    shot = {name: rows[0] for name, rows in shots(env.unwrapped._native).items()}
    picture, renderer = env.render(), Renderer(env.unwrapped.snapshot().scene)
    assert (picture == renderer.draw(**shot)).all()
    place = {name: shot[name] for name in ("position", "rotation", "dock")}
    x, y, _ = renderer.project([shot["dock"][:3, 3]], **place)[0]
    # Its colour, which neither water nor floor has, is about its place.
    red, green, blue = np.moveaxis(picture[int(y) - 60 : int(y) + 60, int(x) - 60 : int(x) + 60].astype(int), 2, 0)
    assert ((red > 1.15 * green) & (green > 1.5 * blue)).sum() > 100


def test_the_picture_of_the_scene_is_whole() -> None:
    overlay = Overlay("A title that is much too long for a picture of this size " * 3, "storm", 4.0, (320, 240), CURVES)
    width, height = overlay.view
    picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    for time in (0.0, 1.0, 2.0):
        overlay.note(time, {curve.entry: 0.01 * time for curve in CURVES})
    whole = overlay.draw(picture)
    assert whole.shape == (240, 320, 3)
    (top,) = [y for y in range(240 - height + 1) if (whole[y : y + height] == picture).all()]
    assert 0 < top < 240 - height


@pytest.mark.parametrize(("task", "scene"), CASES)
def test_no_two_curves_are_one_line(task: str, scene: str) -> None:
    infos: list[dict[str, float]] = []
    play(task, scene, 3, 20, lambda _, info: infos.append(info))
    rows = {curve: [info[curve.entry] for info in infos] for curve in CURVES}
    drawn = [rows[curve] for curve in error_curves(gym.make(task, scene=scene))]
    for one, other in itertools.combinations(drawn, 2):
        assert not np.allclose(one, other)
    # None is lost: curves that are left out are equal to one that is drawn.
    for row in rows.values():
        assert any(np.allclose(row, other) for other in drawn)


def test_an_animation_keeps_the_colours_of_the_curves(tmp_path: Path) -> None:
    out = tmp_path / "play.gif"
    assert main(["play", "--seconds", "0.5", "--disturbance", "storm", "--out", str(out), "--size", "320x240"]) == 0
    with Image.open(out) as image:
        assert image.size == (320, 240)
        assert (image.n_frames, image.info["duration"]) == (11, 50)
        for k in (0, 10):
            image.seek(k)
            pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
            # A curve's line in the legend, and white text.
            for colour in COLOURS:
                assert (np.abs(pixels - colour).max(axis=1) <= 3).sum() >= 8, colour


def test_a_film_shows_what_is_between_control_instants() -> None:
    env: Any = gym.make("UVMS-StationKeep-Storm-v0", disable_env_checker=True)
    controller = uvms_gym.make_controller("pd", env)
    frame = Frame("title", "", 0.4, read_settings("160x120", 50.0, None, ".mp4"))
    pictures = list(film(env.unwrapped, _run(env, controller, 0, 4, 0.1, None), frame))
    # One every 20 ms, from the start to the end.
    assert len(pictures) == 21
    assert all((a != b).any() for a, b in itertools.pairwise(pictures))
    (last,) = film(env.unwrapped, _run(env, controller, 0, 4, 0.1, None), frame, last=True)
    assert (last[:90] == pictures[-1][:90]).all()


def test_poses_between_two_are_poses() -> None:
    envs = gym.make_vec("UVMS-StationKeep-v0", num_envs=2)
    envs.reset(seed=0)
    before, after = ({name: rows[i] for name, rows in shots(envs.unwrapped._native).items()} for i in (0, 1))
    for share in (0.0, 0.3, 1.0):
        shot = between(before, after, share)
        for rotation in (shot["rotation"], shot["target"][:3, :3]):
            assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
            assert np.linalg.det(rotation) > 0.0
        assert np.allclose(shot["position"], (1.0 - share) * before["position"] + share * after["position"])
    assert np.allclose(between(before, after, 0.0)["rotation"], before["rotation"])
    assert np.allclose(between(before, after, 1.0)["rotation"], after["rotation"])


@pytest.mark.parametrize(("camera", "size"), [("30,40", "200x150"), ("-54.4,18.3,5", "200x160")])
def test_size_and_camera_are_as_asked(tmp_path: Path, camera: str, size: str) -> None:
    files = [tmp_path / "a.png", tmp_path / "b.png"]
    for file, more in zip(files, ([], ["--camera", camera]), strict=True):
        assert main(["play", "--seconds", "0.1", "--size", size, "--out", str(file), *more]) == 0
    one, other = (np.asarray(Image.open(file)) for file in files)
    width, height = map(int, size.split("x"))
    assert one.shape == other.shape == (height, width, 3)
    assert (one != other).any()


# Windows


def test_a_window_without_pygame_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    # Warnings are errors here.
    with pytest.raises(gym.error.DependencyNotInstalled, match=re.escape("pip install 'uvms-gym[view]'")):
        gym.make("UVMS-StationKeep-v0", render_mode="human")


def test_a_window_shows_every_state(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = mock.MagicMock()
    monkeypatch.setitem(sys.modules, "pygame", pygame)
    env = gym.make("UVMS-StationKeep-Storm-v0", render_mode="human")
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(env.action_space.shape, np.float32))
    env.close()
    shown = [call.args[0] for call in pygame.surfarray.make_surface.call_args_list]
    assert [picture.shape for picture in shown] == [(640, 480, 3)] * 4
    assert all((a != b).any() for a, b in itertools.pairwise(shown))
    pygame.time.Clock.return_value.tick.assert_called_with(10.0)
    pygame.display.quit.assert_called_once()
