"""Records of studies: JSON files, and the circumstances of a run."""

import errno
import json
import math
import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import uvms_gym
from uvms_gym._files import read, write

#: Size of the largest file of results that is read, bytes; the shipped ones have up to 2 MB.
MOST_BYTES = 1 << 26


def circumstances(command: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Everything that a result depends on: command, arguments, versions, commit and machine."""
    try:
        matplotlib = version("matplotlib")
    except PackageNotFoundError:
        matplotlib = None
    return {
        "command": command,
        "arguments": arguments,
        "uvms_gym": uvms_gym.__version__,
        "commit": _commit(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "gymnasium": gymnasium.__version__,
        "matplotlib": matplotlib,
        "machine": {
            "system": platform.platform(),
            "architecture": platform.machine(),
            "processor": _processor(),
            "cores": os.cpu_count(),
            "instruction_set": uvms_gym.Simulator("free-body", 2).instruction_set,
        },
    }


def write_json(path: Path, data: dict[str, Any]) -> None:
    """Write data as JSON; NaN and infinity, which JSON lacks, become null.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    write(path, json.dumps(plain(data), indent=1, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read JSON in the standard's own terms: UTF-8, no key twice in an object, no NaN and no infinity.

    Raises
    ------
    ValueError
        The file is larger than `MOST_BYTES`, nested too deeply, or no such JSON.
    OSError
        The file cannot be read, or is no regular file.
    """
    try:
        content = read(path, MOST_BYTES)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise ValueError(f"larger than {MOST_BYTES >> 20} MiB") from None
        raise
    try:
        return json.loads(
            content.decode(),
            object_pairs_hook=_once,
            parse_constant=_finite,
            parse_float=_finite,
            parse_int=_integer,
        )
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Object of pairs; no key twice."""
    made = dict(pairs)
    if len(made) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in made if names.count(name) > 1)
        raise ValueError(f"key {twice!a:.60} is there twice")
    return made


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"a number is {text:.40}, but must be finite")
    return value


def _integer(text: str) -> int:
    if len(text) > 20:
        raise ValueError(f"an integer has {len(text)} digits, but may have 20")
    return int(text)


def plain(value: Any) -> Any:
    """Convert to the types of JSON; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


def rounded(value: Any) -> Any:
    """Round the numbers of JSON to seven digits: no comparison is as exact, and files are a third smaller."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _commit() -> str | None:
    """Commit of the running sources if they are a checkout, with "+" after it where they differ from it."""
    package = Path(__file__).parents[1]

    def git(*arguments: str) -> str:
        command = ["git", "-C", os.fspath(package), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        # A package installed below some other checkout is no part of it.
        git("ls-files", "--error-unmatch", "__init__.py")
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
