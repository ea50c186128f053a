"""Snippets and examples of the documentation run, and its commands exist."""

import doctest
import importlib
import importlib.util
import math
import re
import shlex
import shutil
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import typer
from helpers import fake_moviepy, free_port, module_of
from log_files import write_marinarium

import uvms_gym
from uvms_gym.cli import main
from uvms_gym.cli.app import app
from uvms_gym.controllers.registry import policies

ROOT = Path(__file__).parents[2]
#: Texts with snippets; cells of notebooks run when the site is built, README and its short form in test_readme.
PAGES = [
    pytest.param(page, id=page.name, marks=pytest.mark.learning if "stable_baselines3" in page.read_text() else ())
    for pattern in ("*.md", "docs/**/*.md", "src/**/*.md", "tests/**/*.md", "training/**/*.md")
    for page in sorted(ROOT.glob(pattern))
    if "```python\n" in page.read_text() and page not in (ROOT / "README.md", ROOT / "src" / "python" / "README.md")
]
TEXTS = [
    ROOT / "README.md",
    ROOT / "src" / "NOTATION.md",
    ROOT / "src" / "python" / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "training" / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
#: Width of code on the site, without scrolling.
COLUMNS = 100
#: What makes commands quick, after their own options, of which the last counts.
QUICK = {
    "scenes": [],
    "compare": ["--episodes", "2"],
    "export": [],
    "accuracy": ["--episodes", "2"],
    "validate": [],
    "fit": ["--period", "0.5", "--no-balance"],
    "train": ["-n", "1", "--eval-episodes", "2"],
}
#: Marks of texts with these commands. (Verification takes all episodes.)
MARKS = {"train": pytest.mark.learning, "accuracy": pytest.mark.nightly, "verify": pytest.mark.nightly}
#: Code that a page's snippets continue.
#: Folder of the Marinarium set that its page names.
RECORDED = "bluerov2_dynamics/rosbags/rosbag2_2025_11_06"
BEFORE = {"add-a-task.md": "from uvms_gym.envs import *"}


@pytest.mark.parametrize("page", PAGES)
def test_the_snippets_of_a_page_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    shutil.copy(Path(uvms_gym.__file__).parent / "scenes" / "petasus-pum.toml", tmp_path / "my.toml")
    monkeypatch.chdir(tmp_path)
    if page.name == "marinarium.md":
        write_marinarium(tmp_path / RECORDED)
    clips = fake_moviepy(monkeypatch)
    names: dict[str, object] = {}
    exec(BEFORE.get(page.name, ""), names)
    text = page.read_text().replace("learn(1_000_000)", "learn(1)")
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        exec(compile(block, str(page), "exec"), names)
    assert len(clips) == text.count("wrappers.RecordVideo(") + text.count("vector.RecordVideo(")


def test_examples_of_docstrings_run() -> None:
    package = Path(uvms_gym.__file__).parent
    files = [path for path in sorted(package.rglob("*.py")) if "    >>> " in path.read_text()]
    assert len(files) >= 4
    for path in files:
        module = importlib.import_module(".".join(("uvms_gym", *path.relative_to(package).with_suffix("").parts)))
        failed, attempted = doctest.testmod(module)
        assert attempted > 0 and failed == 0, path


def test_rust_snippets_are_lines_of_the_source() -> None:
    source = "".join((ROOT / "src" / "task" / file).read_text() for file in ("dock.rs", "registry.rs"))
    page = (ROOT / "docs" / "add-a-task.md").read_text()
    blocks = re.findall(r"^```rust\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    lines = {line.strip() for block in blocks for line in block.splitlines() if "///" not in line}
    assert len(blocks) == 3
    assert lines <= {line.strip() for line in source.splitlines()}


def commands(text: str) -> list[list[str]]:
    """Arguments of the `uvms` commands in the shell blocks of a text."""
    found = []
    for block in re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            if match := re.match(r"\s*uvms (.*)", line):
                found.append(shlex.split(match[1].replace("$seed", "0"), comments=True))
    return found


def parse(arguments: list[str]) -> None:
    """Parse the arguments of `uvms` without running anything; an exception for those that it does not take."""
    command, parent, name = typer.main.get_command(app), None, "uvms"
    while True:
        context = command.make_context(name, list(arguments), parent=parent)
        if not hasattr(command, "commands"):
            return
        name, command, arguments = command.resolve_command(context, arguments)
        parent = context


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_commands_of_a_text_exist(text: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for arguments in commands(text.read_text()):
        parse(arguments)


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(found, id=str(text.relative_to(ROOT)), marks=[MARKS[a[0]] for a in found if a[0] in MARKS])
        # Those of the README run in test_readme.
        for text in TEXTS[1:]
        if (found := commands(text.read_text()))
    ],
)
def test_the_commands_of_a_text_run(found: list[list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(policies(scene="petasus-pum", dt=0.02, substeps=5)["ppo"][0], tmp_path / "policy.safetensors")
    shutil.copy(Path(uvms_gym.__file__).parent / "scenes" / "petasus-pum.toml", tmp_path / "my-scene.toml")
    shutil.copy(ROOT / "tests" / "golden" / "alpha5.urdf", tmp_path / "arm.urdf")
    shutil.copy(ROOT / "tests" / "data" / "robots" / "trait-uuv-simulator.urdf", tmp_path / "robot.urdf")
    (tmp_path / "controller.py").write_text("from uvms_gym import PID as Controller\n")
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    pool(tmp_path / "pool")
    if any(RECORDED in arguments for arguments in found):
        write_marinarium(tmp_path / RECORDED, 21.0)
    monkeypatch.chdir(tmp_path)
    verified = any(arguments[0] == "verify" for arguments in found)
    for arguments in found:
        if any(argument.endswith(".mp4") for argument in arguments) and not importlib.util.find_spec("imageio_ffmpeg"):
            continue
        if arguments[0] == "play" and "--web" not in arguments:
            more = ["--seconds", "0.1"]
        elif arguments[0] == "play":
            more = ["--port", str(port_of_short_viewers(monkeypatch))]
        else:
            more = [] if verified else QUICK[arguments[0]]
        assert main([*arguments, *more]) == 0, arguments


def pool(folder: Path) -> None:
    """Make trials of the names that the documentation holds out, and two others, of the one that is kept."""
    folder.mkdir()
    for name in ("004-1", "007-1", "015-1", "025-1", "_alt_011-1", "026-1", "027-1"):
        for file in (ROOT / "tests" / "data" / "pool").glob("*026-1*"):
            (folder / file.name.replace("026-1", name)).symlink_to(file)


def port_of_short_viewers(monkeypatch: pytest.MonkeyPatch) -> int:
    """Free port, and viewers that Ctrl-C ends after ten pictures."""
    server = pytest.importorskip("uvms_gym.viewer.server")

    def run(viewer: Any) -> None:
        for _ in range(10):
            viewer.picture(0.05)
        raise KeyboardInterrupt

    monkeypatch.setattr(server.Viewer, "run", run)
    return free_port()


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_code_fits_its_column(text: Path) -> None:
    found = text.read_text()
    code = [block for _, block in re.findall(r"^```[^\n]*\n(---\n.*?^---\n)?(.*?)^```", found, re.M | re.S)]
    code += [(text.parent / file).read_text() for file in re.findall(r"\{literalinclude\} (\S+)", found)]
    assert [line for block in code for line in block.splitlines() if len(line) > COLUMNS] == []


def test_other_commands_would_show() -> None:
    assert commands("```sh\nuvms play --seconds 3 \\\n  --seed $seed  # now\nls\n```") == [
        ["play", "--seconds", "3", "--seed", "0"]
    ]
    for wrong in (["plan"], ["play", "--second", "3"], ["scenes", "chek", "x"], ["play", "--seconds", "x"]):
        with pytest.raises(typer.TyperException):
            parse(wrong)


def example(name: str) -> ModuleType:
    return module_of(ROOT / "docs" / "examples" / f"{name}.py")


def test_every_example_is_run_and_shown() -> None:
    names = {path.stem for path in (ROOT / "docs" / "examples").glob("*.py")}
    text, page = Path(__file__).read_text(), (ROOT / "docs" / "examples.md").read_text()
    assert names == set(re.findall(r'example\("(\w+)"\)', text)) == set(re.findall(r"\} examples/(\w+)\.py", page))


def test_an_own_controller_settles_with_less_effort_where_the_shipped_one_does() -> None:
    errors = example("own_controller").main(num_envs=8)
    assert errors["saturated PD"] == pytest.approx(errors["PD"], rel=0.01)


def test_an_own_scene_keeps_station() -> None:
    assert example("own_scene").main(steps=100) < 0.05


def test_randomization_spreads_the_errors() -> None:
    errors = example("randomize").main(num_envs=16, steps=50)
    assert all(not np.array_equal(errors["none"], error) for name, error in errors.items() if name != "none")


def test_a_reach_with_the_arm_saves_thrust() -> None:
    results = example("reach").main()
    (distance, impulse), (_, held) = results.values()
    assert distance < 0.01 and impulse < 0.5 * held


def test_the_regulator_is_stable_and_holds_closer_than_the_pd() -> None:
    lqr = example("lqr")
    errors = lqr.main(num_envs=8, steps=200)
    assert errors["LQR"] < 0.5 * errors["PD"]


@pytest.mark.filterwarnings("ignore")
def test_a_data_set_is_read_as_it_was_collected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    pytest.importorskip("jax")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    data = example("minari_dataset").main(episodes=2, max_episode_steps=10)
    assert (data.total_episodes, data.total_steps) == (2, 20)
    episode = next(data.iterate_episodes([0]))
    assert episode.observations.shape == (11, 44)
    assert list(episode.truncations) == [False] * 9 + [True]


@pytest.mark.learning
def test_stable_baselines3_trains(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("stable_baselines3")
    assert math.isfinite(example("ppo_sb3").main(frames=1024, n_envs=16, episodes=2))
    assert "over 2 episodes" in capsys.readouterr().out


@pytest.mark.learning
def test_the_ppo_of_one_file_trains_and_cuts_advantages_at_ends() -> None:
    torch = pytest.importorskip("torch")
    ppo = example("ppo_torch")
    history = ppo.main(frames=3 * 16 * 8, num_envs=16, steps=8, minibatch=64)
    assert len(history) == 3
    assert np.isfinite(history).all()
    rewards, values = torch.tensor([[1.0], [2.0], [4.0]]), torch.tensor([[10.0], [20.0], [30.0]])
    ended, never = torch.tensor([[False], [True], [False]]), torch.zeros(3, 1, dtype=torch.bool)
    last = torch.tensor([40.0])
    # Truncated after the second step: its value bootstraps from the observation after it.
    truncated = ppo.advantages(rewards, values, last, never, ended, 0.5, 1.0)
    assert truncated[:, 0].tolist() == [1 + 0.5 * (2 + 0.5 * 30) - 10, 2 + 0.5 * 30 - 20, 4 + 0.5 * 40 - 30]
    terminated = ppo.advantages(rewards, values, last, ended, ended, 0.5, 1.0)
    assert terminated[:, 0].tolist() == [1 + 0.5 * 2 - 10, 2 - 20, 4 + 0.5 * 40 - 30]


@pytest.mark.learning
def test_thrusts_by_torch_stop_the_vehicle() -> None:
    pytest.importorskip("torch")
    costs = example("thrust_torch").main(iterations=20)
    assert costs[-1] < 0.5 * costs[0]


@pytest.mark.learning
@pytest.mark.filterwarnings("ignore")
def test_skrl_trains(tmp_path: Path) -> None:
    pytest.importorskip("skrl")
    assert example("skrl_ppo").main(frames=256, num_envs=8, folder=str(tmp_path)) is not None


@pytest.mark.learning
@pytest.mark.filterwarnings("ignore")
def test_rsl_rl_trains_and_tells_time_limits_apart() -> None:
    pytest.importorskip("rsl_rl")
    torch = pytest.importorskip("torch")
    import gymnasium

    rsl = example("rsl_rl_ppo")
    rsl.main(frames=256, num_envs=8)
    env = rsl.RslRlVecEnv(
        gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=2, autoreset_mode="SameStep", max_episode_steps=3)
    )
    for step in range(3):
        _, _, dones, extras = env.step(torch.zeros(2, 6))
        assert dones.tolist() == extras["time_outs"].tolist() == [step == 2] * 2
    assert env.episode_length_buf.tolist() == [0, 0]
