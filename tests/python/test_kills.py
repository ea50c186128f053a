"""Stopped at any instant, commands lose nothing that was whole, and go on to the result of a run without a stop."""

import io
import json
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers import SMALL, policy

from uvms_gym import MLP

Image = pytest.importorskip("PIL.Image")

ROOT = Path(__file__).parents[2]
POOL, URDF = ROOT / "tests/data/pool", ROOT / "tests/golden/alpha5.urdf"
#: Ways to stop a command.
WAYS = ("TERM", "KILL", "disk", "pipe")
#: Space that a full disk leaves, bytes: at most, and mostly less.
SPACE = 65536
#: Imported once, by the process from which the commands are forked.
PRELOAD = ["uvms_gym.cli.app", "matplotlib.backends.backend_agg", "PIL.PngImagePlugin", "scipy.stats"]
PRELOAD_LEARNING = ["uvms_gym.training.native", "uvms_gym.training.ppo", "torch._dynamo", "cma"]
#: Cases that need torch or CMA-ES.
LEARNING = ("train", "resume", "tune")


class Case(NamedTuple):
    """A command in a folder: the same function begins it and goes on; no stop may change its result.

    The folder is empty at first, or has what `begin` makes, or, with `old`, the files of an earlier run.
    """

    run: Callable[[Path], int]
    result: Callable[[Path], Any]
    begin: Callable[[Path], None] | None = None
    old: bool = False


def uvms(*arguments: Any) -> int:
    from uvms_gym.cli import main

    return main([str(argument) for argument in arguments])


def compare(folder: Path) -> int:
    names = [word for name in ("none", "pd", "pid") for word in ("--controller", name)]
    return uvms("compare", "--scene", SMALL, *names, "--episodes", 64, "--out", folder / "out")


def compared(folder: Path) -> Any:
    results = json.loads((folder / "out/compare.json").read_text())["results"]
    for result in results:
        for entry in result["controllers"].values():
            entry.pop("seconds")
    assert {path.name for path in (folder / "out").iterdir()} == {
        *("compare.json", "scores.npz", "compare.png", "profiles.png")
    }
    return results


SMALL_RUN = [
    *("--n-envs", 4, "--env-kwargs", "max_episode_steps:12", "--eval-episodes", 2, "--eval-freq", 240),
    *("--save-freq", 48, "--seed", 3),
]
DISTILL = {"net_arch": [8], "batch_size": 16, "n_updates": 2, "frame_stack": 1}
PPO = {"n_steps": 16, "batch_size": 32, "n_epochs": 2, "frame_stack": 1}


def begin(folder: Path, algo: str, steps: int, own: dict[str, Any]) -> int:
    pairs = [word for key, value in own.items() for word in ("-params", f"{key}:{value}")]
    given = ["train", "--algo", algo, "-n", steps, *SMALL_RUN, *pairs, "-f", folder / "logs"]
    return uvms(*given, "--export", folder / "policies/policy.safetensors")


def go_on(folder: Path) -> int:
    (config,) = folder.glob("logs/*/*/config.json")
    return uvms("train", "-i", config.parent, "--export", folder / "policies/policy.safetensors")


def train(folder: Path) -> int:
    return go_on(folder) if list(folder.glob("logs/*/*/config.json")) else begin(folder, "distill", 960, DISTILL)


def trained(folder: Path) -> bytes:
    """Weights of the exported policy."""
    data = (folder / "policies/policy.safetensors").read_bytes()
    return data[8 + int.from_bytes(data[:8], "little") :]


def half_run(folder: Path) -> None:
    """Leave a run as a kill after the second checkpoint of PPO does."""
    assert begin(folder, "ppo", 1024, PPO) == 0
    (config,) = folder.glob("logs/*/*/config.json")
    kept = ("config.json", "evaluations.json", "rl_model_64_steps.zip", "rl_model_128_steps.zip")
    for path in [*config.parent.iterdir(), folder / "policies/policy.safetensors"]:
        if path.name not in kept:
            path.unlink()


def tune(folder: Path) -> int:
    sys.path.append(str(ROOT / "training"))
    import tune as script

    from uvms_gym.cli.app import run

    small = ["--generations", "6", "--population", "4", "--episodes", "16", "--finals", "16", "--controller", "pd"]
    places = ["--policies", str(folder / "policies"), "--work", str(folder / "work"), "--env", "UVMS-StationKeep-v0"]
    return run([*small, *places], script.app, "tune.py")


def gains(folder: Path) -> Any:
    (file,) = folder.glob("policies/*/*/*/gains.json")
    found = json.loads(file.read_text())
    return {name: entry["gains"] for name, entry in found.items()}


def fit(folder: Path) -> int:
    free = ["--free", "vehicle.body.center_of_buoyancy", "--period", 0.5, "--no-balance", "--force"]
    return uvms("fit", POOL / "start.toml", POOL, "--map", POOL / "map.toml", *free, "--out", folder / "fitted.toml")


def fitted(folder: Path) -> Any:
    data = json.loads((folder / "fitted.json").read_text())
    assert (folder / "fitted.png").exists()
    texts = [(folder / f"fitted{end}").read_text() for end in (".toml", "-map.toml", "-randomize.toml")]
    return data["parameters"], data["errors"], texts


def export(folder: Path) -> int:
    for gain in range(1, 31):
        try:
            policy(notes={"gain": str(gain)}).save(folder / "policy.safetensors")
        except KeyboardInterrupt:
            return 130
        except OSError as error:
            print(f"cannot write {error.filename}: {error.strerror}", file=sys.stderr)
            return 2
    scenes = [
        ("import", URDF, "--out", folder / "arm.toml"),
        ("estimate", "--box", "0.4,0.3,0.2", "--out", folder / "box.toml", "--json", folder / "box.json"),
        ("show", SMALL, "--json", folder / "scene.json"),
    ]
    for arguments in scenes:
        force = [] if "show" in arguments else ["--force"]
        if status := uvms("scenes", *arguments, *force):
            return status
    return 0


def exported(folder: Path) -> Any:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


CASES = {
    "compare": Case(compare, compared),
    "fit": Case(fit, fitted, old=True),
    "export": Case(export, exported, old=True),
    "train": Case(train, trained),
    "resume": Case(go_on, trained, begin=half_run),
    "tune": Case(tune, gains),
}


def read_whole(path: Path) -> None:
    """Read all of a file; an error if it is cut off."""
    data = path.read_bytes()
    match path.suffix:
        case ".json":
            json.loads(data)
        case ".toml":
            tomllib.loads(data.decode())
        case ".safetensors":
            MLP.load(path)
        case ".npz":
            assert all(array is not None for array in np.load(io.BytesIO(data)).values())
        case ".zip":
            with zipfile.ZipFile(path) as file:
                assert file.testzip() is None
        case ".png":
            Image.open(io.BytesIO(data)).load()
        case ".md":
            assert data.endswith(b"\n")
        case _:
            raise AssertionError(f"unknown file {path}")


def files_of(folder: Path) -> list[Path]:
    """All files but those that were being written."""
    return [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".uvms-")]


def child(name: str, part: str, folder: Path, log: Path, leave: float | None, limit: int | None) -> None:
    """Run a part of a case; its output goes to a file, or to a pipe whose reader leaves after a time."""
    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 2)
    if leave is None:
        os.dup2(output, 1)
    else:
        reader, writer = os.pipe()
        os.dup2(writer, 1)
        os.close(writer)
        timer = threading.Timer(leave, os.close, [reader])
        timer.daemon = True
        timer.start()
    # Streams of the new files, as a command has from its start.
    sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    sys.exit(getattr(CASES[name], part)(folder))


class Lab:
    """Runs cases in processes forked from one that has imported everything."""

    def __init__(self, place: Path, names: list[str]) -> None:
        self.place = place
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(PRELOAD + (PRELOAD_LEARNING if {*names} & {*LEARNING} else []))
        self.starts, self.results, self.seconds = {}, {}, {}
        for name in names:
            begun, whole = place / name / "begun", place / name / "whole"
            begun.mkdir(parents=True)
            if CASES[name].begin is not None:
                self.finish(name, "begin", begun)
            shutil.copytree(begun, whole)
            started = time.monotonic()
            self.finish(name, "run", whole)
            self.seconds[name] = time.monotonic() - started
            self.results[name] = CASES[name].result(whole)
            self.starts[name] = whole if CASES[name].old else begun

    def start(
        self, name: str, part: str, folder: Path, leave: float | None = None, limit: int | None = None
    ) -> tuple[Any, Path]:
        log = self.place / "log"
        process = self.context.Process(target=child, args=(name, part, folder, log, leave, limit))
        process.start()
        return process, log

    def finish(self, name: str, part: str, folder: Path) -> None:
        """Run a part to its end."""
        process, log = self.start(name, part, folder)
        process.join()
        assert process.exitcode == 0, f"{name}: {log.read_text()[-2000:]}"

    def stop(self, name: str, way: str, instant: float, seed: int) -> str:
        """Stop a case at an instant, as a share of its duration; check its files, and go on. Returns what happened."""
        folder = self.place / name / f"{way}-{seed}"
        folder.mkdir()
        disk = Disk(folder) if way == "disk" else None
        try:
            shutil.copytree(self.starts[name], folder, dirs_exist_ok=True)
            before = {path: path.read_bytes() for path in files_of(folder)}
            seconds = instant * self.seconds[name]
            limit = disk.fill(round(instant**3 * SPACE)) if disk else None
            process, log = self.start(name, "run", folder, seconds if way == "pipe" else None, limit)
            if way in ("TERM", "KILL"):
                process.join(seconds)
                if process.is_alive():
                    os.kill(process.pid, getattr(signal, f"SIG{way}"))
            process.join(120)
            assert process.exitcode is not None, f"{name} does not end"
            told = log.read_text()
            self.check(name, way, process.exitcode, told, folder)
            for path in files_of(folder):
                read_whole(path)
            assert before.keys() <= set(files_of(folder)), "a whole file is lost"
            if disk:
                disk.free()
            if process.exitcode != 0:
                self.finish(name, "run", folder)
            assert CASES[name].result(folder) == self.results[name], f"{name} {way}, exit status {process.exitcode}"
            assert not list(folder.rglob(".uvms-*")) or process.exitcode == 0
            return "stopped" if process.exitcode else "ended"
        finally:
            if disk:
                disk.close()
            shutil.rmtree(folder, ignore_errors=True)

    def check(self, name: str, way: str, status: int, told: str, folder: Path) -> None:
        """Exit status and messages: no traceback, and a full disk names the file."""
        assert "Traceback" not in told, told
        match way:
            case "KILL":
                assert status in (0, -signal.SIGKILL)
            case "TERM":
                # Before the command has begun nothing answers the signal.
                assert status in (0, 130, -signal.SIGTERM), told
            case "pipe":
                assert status == 0, told
            case "disk":
                assert status in (0, 2), told
                assert status == 0 or str(folder) in told.splitlines()[-1], told


class Disk:
    """A disk with little space: a file system in memory where that can be mounted, a limit of files elsewhere."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        command = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)]
        self.mounted = subprocess.run(command, capture_output=True).returncode == 0

    def fill(self, left: int) -> int | None:
        """Leave so many bytes; a limit of files in place of a mount."""
        if not self.mounted:
            return left
        stat = os.statvfs(self.folder)
        self._resize((stat.f_blocks - stat.f_bfree) * stat.f_frsize + left)
        return None

    def free(self) -> None:
        if self.mounted:
            self._resize(64 * 2**20)

    def close(self) -> None:
        if self.mounted:
            subprocess.run(["umount", str(self.folder)], check=True)

    def _resize(self, size: int) -> None:
        subprocess.run(["mount", "-o", f"remount,size={size}", str(self.folder)], check=True)


def stop(place: Path, names: list[str], ways: Sequence[str], count: int, seed: int = 0) -> Counter[str]:
    """Stop the cases in turn, in all ways, at so many random instants; returns what happened."""
    lab, rng, found = Lab(place, names), np.random.default_rng(seed), Counter[str]()
    for i in range(count):
        name, way = names[i % len(names)], ways[i // len(names) % len(ways)]
        found[f"{name} {way} {lab.stop(name, way, rng.uniform(0.0, 1.1), i)}"] += 1
    return found


@pytest.mark.parametrize(("name", "ways"), [("export", WAYS), ("compare", ["KILL", "disk"])])
def test_a_stopped_command_loses_nothing_and_goes_on(name: str, ways: Sequence[str], tmp_path: Path) -> None:
    stop(tmp_path, [name], ways, len(ways))


@pytest.mark.learning
@pytest.mark.parametrize(
    ("name", "ways"), [("train", ["KILL", "TERM"]), ("resume", ["KILL", "disk"]), ("tune", ["KILL"]), ("fit", ["TERM"])]
)
def test_stopped_training_loses_nothing_and_goes_on(name: str, ways: Sequence[str], tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("cma")
    stop(tmp_path, [name], ways, len(ways))


@pytest.mark.nightly
def test_200_random_instants_of_all_commands(tmp_path: Path) -> None:
    found = stop(tmp_path, list(CASES), WAYS, 200)
    print("\n".join(f"{what}: {times}" for what, times in sorted(found.items())))
    assert sum(times for what, times in found.items() if what.endswith("stopped")) > 80
