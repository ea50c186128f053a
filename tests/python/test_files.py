"""Files stay whole: after errors, a full disk, interruptions and kills there is the old file or the new one."""

import os
import re
import resource
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import policy

import uvms_gym
from uvms_gym._files import lock, read, read_text, replacing, write
from uvms_gym.cli import film
from uvms_gym.cli.output import write_json
from uvms_gym.studies import records
from uvms_gym.studies.comparison.scoreboard import read_entries
from uvms_gym.studies.comparison.verification import verify
from uvms_gym.studies.plotting import picture
from uvms_gym.training.hyperparameters import read_hyperparameters

#: Pictures of noise, which take space.
NOISE = np.random.default_rng(0).integers(0, 256, (3, 64, 64, 3), dtype=np.uint8)


def draw(path: Path) -> None:
    with picture(path, 2.0, 2.0) as figure:
        figure.add_subplot().plot([0.0, 1.0])


WRITERS: dict[str, Callable[[Path], Any]] = {
    "numbers.json": lambda path: records.write_json(path, {"rows": list(range(1000))}),
    "policy.safetensors": lambda path: policy().save(path),
    "figure.png": draw,
    "film.gif": lambda path: film.write_film(path, NOISE, 10.0),
    "film.png": lambda path: film.write_film(path, NOISE, 10.0),
    "scene.toml": lambda path: write(path, 1000 * "x = 1\n"),
}


@contextmanager
def full_disk(left: int) -> Iterator[None]:
    """Files of this process end at a number of bytes, as on a full disk."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (left, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_keeps_the_old_file_and_the_error_names_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    old = path.read_bytes()
    assert len(old) > 512
    with full_disk(512), pytest.raises(OSError) as raised:
        WRITERS[name](path)
    assert raised.value.filename == str(path)
    assert path.read_bytes() == old
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_command_names_the_file_that_a_full_disk_refused(tmp_path: Path) -> None:
    with full_disk(512), pytest.raises(Exception, match=r"cannot write .*numbers\.json: File too large"):
        write_json(tmp_path / "numbers.json", {"rows": list(range(1000))})


def test_an_interruption_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "numbers"
    write(path, "old")
    with pytest.raises(KeyboardInterrupt), replacing(path) as file:
        file.write(b"new")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_process_leaves_is_removed_by_the_next_and_a_file_at_work_stays(tmp_path: Path) -> None:
    path = tmp_path / "numbers"
    write(path, "old")
    if (child := os.fork()) == 0:
        with replacing(path) as file:
            file.write(b"new")
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert path.read_text() == "old" and len(list(tmp_path.iterdir())) == 2
    with replacing(tmp_path / "other") as file:
        file.write(b"other")
        write(path, "new")
        assert {entry.name for entry in tmp_path.iterdir()} == {"numbers", Path(file.name).name}
    assert path.read_text() == "new" and (tmp_path / "other").read_text() == "other"


def test_links_and_permissions_stay_and_devices_are_written_directly(tmp_path: Path) -> None:
    path, link = tmp_path / "numbers", tmp_path / "link"
    write(path, "old")
    assert path.stat().st_mode & 0o777 == 0o666 & ~_umask()
    path.chmod(0o640)
    link.symlink_to(path)
    write(link, "new")
    assert link.is_symlink() and path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640
    write("/dev/null", "nothing")
    with pytest.raises(OSError, match="No space left") as raised:
        write("/dev/full", "much")
    assert raised.value.filename == "/dev/full"


@pytest.mark.parametrize(("place", "kind"), [("folder", IsADirectoryError), ("none/file", FileNotFoundError)])
def test_errors_name_the_file_as_given(place: str, kind: type[OSError], tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(kind) as raised:
        write(tmp_path / place, "text")
    assert raised.value.filename == str(tmp_path / place)


@pytest.mark.parametrize("place", ["/dev/zero", "pipe"])
def test_pipes_and_devices_are_not_opened(place: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    file = tmp_path / place
    readers: list[Callable[[], Any]] = [
        lambda: read(file),
        lambda: uvms_gym.controllers.MLP.load(file),
        lambda: verify(file),
        lambda: read_entries(file),
        lambda: read_hyperparameters("UVMS-StationKeep", file),
    ]
    for reader in readers:
        with pytest.raises(OSError, match="not a regular file") as raised:
            reader()
        assert raised.value.filename == str(file)


def test_files_are_refused_by_size_before_they_are_read(tmp_path: Path) -> None:
    with open(tmp_path / "large", "wb") as file:
        file.truncate(10**9)
    with pytest.raises(OSError, match="1000000000 bytes, but at most 100000000 are read") as raised:
        uvms_gym.controllers.MLP.load(tmp_path / "large")
    assert raised.value.filename == str(tmp_path / "large")
    (tmp_path / "small").write_bytes(b"\xef\xbb\xbfa\r\nb")
    assert read(tmp_path / "small", 10) == b"\xef\xbb\xbfa\r\nb"
    assert read_text(tmp_path / "small", 10, "utf-8-sig") == "a\nb"


def test_a_folder_has_one_holder(tmp_path: Path) -> None:
    with lock(tmp_path), pytest.raises(BlockingIOError) as raised, lock(tmp_path):
        pass
    assert raised.value.filename == str(tmp_path)
    with lock(tmp_path):
        pass


def test_all_files_are_written_by_one_function() -> None:
    package = Path(uvms_gym.__file__).parent
    direct = re.compile(r"""\.write_(text|bytes)\(|\bopen\([^)]*["'][wax]|\.(savez|savefig)\((?!file\b|data\b)""")
    files = [*package.rglob("*.py"), *(Path(__file__).parents[2] / "training").glob("*.py")]
    found = [file.name for file in files if file.name != "_files.py" and direct.search(file.read_text())]
    assert len(files) > 100 and found == []
    assert direct.search((package / "_files.py").read_text())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
