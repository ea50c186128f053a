"""Robots from MJCF: the package `mujoco` (extra `import`) resolves defaults, includes and meshes.

A process of its own reads the file, with a limit on time and memory: a short file can stand for millions of bodies.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from uvms_gym._core import SceneError

#: Limits of reading: seconds, and bytes of memory.
_SECONDS, _MEMORY = 30, 8_000_000_000


def read(path: Path) -> dict[str, Any]:
    """Read a robot, in the form of `read_robot`.

    Every body is a link, whose frame is at its joint's anchor, so that joint coordinates are those of MuJoCo. Sites
    are frames, or thrusters where an actuator with a force along the site's axes is attached.

    Raises
    ------
    SceneError
        The message names file and element; or the package `mujoco` is not installed.
    """
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(entry or "." for entry in sys.path)}
    command = [sys.executable, "-P", "-m", "uvms_gym._importing.mjcf_model", str(path), str(_SECONDS), str(_MEMORY)]
    try:
        run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        raise SceneError(f"{path}: takes more than {_SECONDS} s to read: it may stand for very many bodies") from None
    if run.returncode == 0:
        # MuJoCo may print before.
        robot = json.loads(run.stdout.splitlines()[-1])
        if isinstance(robot, dict):
            return robot
        raise SceneError(f"{path}: {robot}")
    last = run.stderr.strip().splitlines()[-1:] or [f"MuJoCo ended with code {run.returncode}"]
    raise SceneError(f"{path}: cannot be read by MuJoCo: {last[0]}")
