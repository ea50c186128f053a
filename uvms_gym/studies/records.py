"""Records of studies: JSON files, and the circumstances of a run."""

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
from uvms_gym._files import write


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
    write(path, json.dumps(_plain(data), indent=1, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """Convert to the types of JSON."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


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
