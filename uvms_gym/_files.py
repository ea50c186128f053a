"""Files: reading within a limit, writing without partial files, locks of folders."""

import contextlib
import errno
import fcntl
import io
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO

#: Maximum size of a file that a user names, bytes.
MOST = 100_000_000

#: Start and end of the names of files that are being written.
_PART = (".uvms-", ".part")


def read(path: str | os.PathLike[str], most: int = MOST) -> bytes:
    """Read a file that a user names; pipes and devices, which may have no end, are not opened.

    Raises
    ------
    OSError
        The file cannot be read, is no regular file, or has more than `most` bytes.
    """
    found, name = os.stat(path), os.fspath(path)
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise OSError(errno.EINVAL, "not a regular file", name)
    if found.st_size > most:
        raise OSError(errno.EFBIG, f"{found.st_size} bytes, but at most {most} are read", name)
    with open(path, "rb") as file:
        return file.read(most)


def read_text(path: str | os.PathLike[str], most: int = MOST, encoding: str = "utf-8") -> str:
    """Read the text of a file as `read` does; every end of a line becomes a newline.

    Raises
    ------
    OSError
        As from `read`.
    UnicodeDecodeError
        The file is not in this encoding.
    """
    return io.TextIOWrapper(io.BytesIO(read(path, most)), encoding).read()


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Give a new file in the folder of `path`, flush it to the disk at the end, and rename it to `path`.

    A full disk, an interruption or a kill at any instant leaves the old file or the new one. Libraries that write by
    name take the file's `name`. A link stays, and leads to the new file; a pipe or a device is written directly.

    Raises
    ------
    OSError
        The file cannot be written; `filename` is `path`.
    """
    target, part, old = os.path.realpath(path), None, None
    folder = os.path.dirname(target)
    try:
        with contextlib.suppress(FileNotFoundError):
            old = os.stat(target).st_mode
        if old is not None and stat.S_ISDIR(old):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if old is not None and not os.access(target, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        if old is not None and not stat.S_ISREG(old):
            with open(target, "wb") as device:
                yield device
            return
        _remove_orphans(folder)
        part, file = _new_part(folder)
        with file:
            yield file
            file.flush()
            if old is not None:
                os.fchmod(file.fileno(), stat.S_IMODE(old))
            os.fsync(file.fileno())
            os.replace(part, target)
        _flush_folder(folder)
    except OSError as error:
        # Writing names no file, and no one knows the new file.
        name = error.filename
        if name in (None, target, folder) or os.path.basename(str(name)).startswith(_PART[0]):
            error.filename, error.filename2 = os.fspath(path), None
        raise
    finally:
        if part is not None:
            with contextlib.suppress(OSError):
                os.unlink(part)


def write(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a whole file as `replacing` does; text in UTF-8.

    Raises
    ------
    OSError
        The file cannot be written; `filename` is `path`.
    """
    with replacing(path) as file:
        file.write(data.encode() if isinstance(data, str) else data)


@contextlib.contextmanager
def lock(folder: Path, wait: bool = False) -> Iterator[None]:
    """Lock an existing folder for this process; the system releases it if the process dies.

    Where the file system has no locks, nothing is held.

    Raises
    ------
    BlockingIOError
        Another process, or another part of this one, holds it; not with `wait`.
    OSError
        The folder cannot be read.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError as error:
            error.filename = os.fspath(folder)
            raise
        except OSError:
            pass
        yield
    finally:
        os.close(handle)


def _new_part(folder: str) -> tuple[str, IO[bytes]]:
    """New file with a lock, by which others know that it is being written."""
    while True:
        part = os.path.join(folder, os.urandom(6).hex().join(_PART))
        file = open(part, "xb")
        try:
            with contextlib.suppress(OSError):
                fcntl.flock(file, fcntl.LOCK_EX)
            # Another process may have removed it as an orphan before it was locked.
            if os.path.exists(part):
                return part, file
        except BaseException:
            os.unlink(part)
            raise
        file.close()


def _remove_orphans(folder: str) -> None:
    """Remove files that killed processes have left: their locks are free."""
    with os.scandir(folder) as entries:
        names = [entry.path for entry in entries if entry.name.startswith(_PART[0]) and entry.name.endswith(_PART[1])]
    for name in names:
        with contextlib.suppress(OSError), open(name, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(name)


def _flush_folder(folder: str) -> None:
    """Flush the names in a folder; not every file system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
