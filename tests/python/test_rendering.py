"""Pictures, and `uvms play`."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from helpers import fake_moviepy
from PIL import Image

import uvms_gym
from uvms_gym import Renderer, Simulator
from uvms_gym.cli import main
from uvms_gym.envs.rendering import Pictures

PETASUS = "petasus-pum"
ARMED = ("petasus-pum", "bluerov2-heavy-alpha5")
ENV = "UVMS-StationKeep-v0"


def moved(scene: str, seed: int = 0) -> Simulator:
    """A simulator near home, with everything a little off."""
    simulator, rng = Simulator(scene), np.random.default_rng(seed)
    quaternion = np.concatenate([[1.0], 0.05 * rng.normal(size=3)])
    q = simulator.q[0] + 0.05 * rng.normal(size=simulator.num_joints)
    simulator.set_state(position=0.03 * rng.normal(size=3), quaternion=quaternion, q=q)
    return simulator


def drawn(renderer: Renderer, simulator: Simulator, **more: Any) -> np.ndarray:
    return renderer.draw(simulator.position[0], simulator.rotation[0], simulator.q[0], **more)


def tip(picture: np.ndarray) -> np.ndarray:
    """Middle of the pixels with the colour of the end effector, which nothing else has."""
    red, green, blue = np.moveaxis(picture.astype(float), 2, 0)
    rows, columns = np.nonzero((red > 1.8 * green) & (blue > 1.6 * green) & (red > 120.0))
    assert len(rows)
    return np.array([columns.mean() + 0.5, rows.mean() + 0.5])


@pytest.mark.parametrize("scene", ARMED)
@pytest.mark.parametrize("seed", range(3))
def test_the_end_effector_is_where_the_simulator_has_it(scene: str, seed: int) -> None:
    simulator, renderer = moved(scene, seed), Renderer(scene)
    end = simulator.end_effector_pose()[0, :3, 3]
    for target in (None, (np.array([0.05, 0.0, 0.1]), np.eye(3))):
        where = renderer.project([end], simulator.position, simulator.rotation, target=target)[0]
        assert np.hypot(*(tip(drawn(renderer, simulator, target=target)) - where[:2])) < 3.0


def test_a_picture_depends_only_on_its_arguments() -> None:
    simulator, renderer = moved(PETASUS), Renderer(PETASUS, width=160, height=120)
    more = {"thrust": [50.0, -100.0, 20.0, 0.0, 10.0, 70.0], "current": [0.2, 0.1, 0.0], "time": 2.0}
    first = drawn(renderer, simulator, **more)
    assert (first.dtype, first.shape) == (np.uint8, (120, 160, 3))
    others = [drawn(renderer, moved(PETASUS, 1)), drawn(renderer, simulator, **more | {"time": 3.0})]
    assert all((other != first).any() for other in others)
    copies = [copy.deepcopy(renderer), pickle.loads(pickle.dumps(renderer))]
    for again in (renderer, *copies, Renderer(PETASUS, width=160, height=120)):
        assert drawn(again, simulator, **more).tobytes() == first.tobytes()
    first[:] = 0
    assert drawn(renderer, simulator, **more).any()


@pytest.mark.parametrize(
    "more",
    [
        {"thrust": [100.0, 100.0, -100.0, -100.0, 100.0, 100.0]},
        {"target": np.eye(4)},
        {"path": [[0.5, 0.0, 0.0], [0.9, 0.2, -0.4], [0.2, -0.9, 0.5]]},
        {"point": (np.array([0.6, -0.4, 0.2]), np.eye(3))},
        {"trail": [[0.5, 0.0, 0.0], [0.9, -0.6, -0.4]]},
        {"current": [0.5, 0.0, 0.0]},
        {"payload": 5.0},
        {"time": 1.0},
    ],
)
def test_everything_that_can_be_drawn_is_seen(more: dict[str, Any]) -> None:
    simulator, renderer = moved(PETASUS), Renderer(PETASUS)
    assert (drawn(renderer, simulator, **more) != drawn(renderer, simulator)).any()


def test_pictures_are_drawn_side_by_side() -> None:
    simulator, renderer = moved(PETASUS), Renderer(PETASUS, width=160, height=120)
    expected = drawn(renderer, simulator)
    with ThreadPoolExecutor(4) as executor:
        for drawing in executor.map(lambda _: drawn(renderer, simulator), range(4)):
            assert (drawing == expected).all()


def test_what_is_not_finite_is_left_out() -> None:
    renderer = Renderer(PETASUS, width=64, height=48)
    for bad in (np.nan, np.inf, -np.inf, 1e300):
        place = (np.full(shape, bad) for shape in (3, (3, 3), 5))
        assert renderer.draw(*place, current=np.full(3, bad), time=bad).shape == (48, 64, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": 0}, "width must be at least 1"),
        ({"height": 5000}, "height is 5000, but must be 1 to 4096"),
        ({"elevation": 2.0}, "elevation is 2, but must be -1.5 to 1.5 rad"),
        ({"distance": 0.0}, "distance is 0, but must be"),
        ({"azimuth": np.nan}, "azimuth is NaN"),
        ({"scene": "nowhere"}, "nowhere"),
    ],
)
def test_settings_out_of_range_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Renderer(**{"scene": PETASUS} | arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"position": np.zeros(2)}, ValueError, r"position has shape \(2,\)"),
        ({"rotation": np.zeros(9)}, ValueError, "rotation has shape"),
        ({"q": np.zeros(4)}, ValueError, r"q has shape \(4,\), but must have \(5,\)"),
        ({"thrust": np.zeros(5)}, ValueError, "thrust has shape"),
        ({"target": np.zeros((4, 4))}, ValueError, "target: the last row"),
        ({"path": np.zeros(3)}, ValueError, r"path has shape \(3,\), but must have \(k, 3\)"),
        ({"current": "east"}, TypeError, "current must be an array of real numbers"),
        ({"time": "now"}, TypeError, "time must be a number"),
    ],
)
def test_misshaped_arguments_are_refused(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    given = {"position": np.zeros(3), "rotation": np.eye(3)} | arguments
    with pytest.raises(error, match=message):
        Renderer(PETASUS, width=8, height=8).draw(**given)


@pytest.mark.parametrize("shape", [{"kind": "box", "size": [1, -1, 1]}, {"kind": "sphere", "size": [1, 1, 1]}])
def test_impossible_shapes_are_refused(shape: dict[str, Any]) -> None:
    scene = uvms_gym.load_scene(PETASUS)
    scene["vehicle"]["shape"] = shape
    with pytest.raises(uvms_gym.SceneError, match=r"vehicle\.shape"):
        Renderer(scene)


def test_a_shape_is_no_matter_of_physics() -> None:
    scene = uvms_gym.load_scene(PETASUS)
    del scene["vehicle"]["shape"], scene["provenance"]["vehicle.shape"]
    with_shape, without = moved(PETASUS), Simulator(scene)
    without.set_state(position=with_shape.position, quaternion=with_shape.quaternion, q=with_shape.q)
    for simulator in (with_shape, without):
        simulator.step(substeps=20)
    assert with_shape.position.tobytes() == without.position.tobytes()
    assert (drawn(Renderer(scene), without) != drawn(Renderer(PETASUS), with_shape)).any()


def test_pictures_are_a_sequence_of_what_was() -> None:
    envs = gym.make_vec(ENV, num_envs=3, scene=PETASUS, render_mode="rgb_array")
    envs.reset(seed=0)
    frames = envs.render()
    assert isinstance(frames, Pictures)
    for _ in range(5):
        envs.step(np.ones(envs.action_space.shape, dtype=np.float32))
    later = envs.render()
    assert len(frames) == len(later) == 3
    assert (frames[1] != later[1]).any()
    assert (frames[-1] == frames[2]).all()
    assert [f.shape for f in frames[::2]] == [(480, 640, 3)] * 2
    with pytest.raises(IndexError):
        frames[3]


def test_videos_of_vector_environments_are_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips = fake_moviepy(monkeypatch)
    envs = gym.make_vec(ENV, num_envs=2, scene=PETASUS, render_mode="rgb_array")
    envs = gym.wrappers.vector.RecordVideo(envs, str(tmp_path / "videos"), episode_trigger=lambda episode: True)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(3):
        envs.step(envs.action_space.sample())
    envs.close()
    assert clips[0][1] in ((480, 1280, 3), (960, 640, 3))
    assert clips[0][2] == 20.0


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes")
@pytest.mark.parametrize(
    ("make", "mode", "known"),
    [
        (gym.make, "ansi", "'rgb_array' or 'human'"),
        *((gym.make_vec, mode, "'rgb_array'") for mode in ("ansi", "human")),
    ],
)
def test_modes_that_there_are_not_are_refused(make: Any, mode: str, known: str) -> None:
    with pytest.raises(ValueError, match=f"render_mode is '{mode}', but must be None or {known}$"):
        make(ENV, render_mode=mode)


# uvms play


@pytest.mark.parametrize("suffix", ["gif", "png"])
def test_a_play_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str) -> None:
    out = tmp_path / "new" / f"play.{suffix}"
    assert main(["play", "--scene", "bluerov2-heavy", "--seconds", "0.2", "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    with Image.open(out) as image:
        assert image.size == ((960, 720) if suffix == "png" else (640, 480))
        # Every 50 ms, from the start to the end.
        assert getattr(image, "n_frames", 1) == (1 if suffix == "png" else 5)


@pytest.mark.parametrize("task", ["UVMS-StationKeep-v0", "UVMS-EETrack-v0"])
def test_an_episode_is_plotted(tmp_path: Path, capsys: pytest.CaptureFixture[str], task: str) -> None:
    plot = tmp_path / "episode.png"
    assert main(["play", "--env", task, "--disturbance", "storm", "--seconds", "0.3", "--plot", str(plot)]) == 0
    assert capsys.readouterr().out.strip() == str(plot)
    with Image.open(plot) as image:
        assert min(image.size) > 500


def test_a_video_is_written(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    out = tmp_path / "play.mp4"
    assert main(["play", "--scene", "bluerov2-heavy", "--seconds", "0.2", "--out", str(out)]) == 0
    assert b"ftyp" in out.read_bytes()[:16]


def test_a_window_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    assert main(["play", "--scene", "bluerov2-heavy", "--seconds", "0.1", "--window"]) == 0


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("uvms_gym.cli.common.find_spec", lambda name: None)
    for arguments, message in [
        (["--out", "x.mp4"], "imageio-ffmpeg, pillow not installed; run: pip install 'uvms-gym[view]'"),
        (["--window"], "pillow, pygame not installed; run: pip install 'uvms-gym[view]'"),
        (["--web"], "viser not installed; run: pip install 'uvms-gym[view]'"),
    ]:
        assert main(["play", *arguments]) == 2
        assert message in capsys.readouterr().err
