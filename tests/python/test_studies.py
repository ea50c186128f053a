"""Studies are a library: they import without the extras, and raise ValueError for bad arguments."""

import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from uvms_gym import studies
from uvms_gym._rotations import distances
from uvms_gym.studies.numerics import convergence_order, loglog_interpolation

#: Modules that import a peer; others import these only when they need them.
PEERS = ("uvms_gym.studies.speed.mujoco_model", "uvms_gym.studies.speed.pinocchio_model")
MODULES = [found.name for found in pkgutil.walk_packages(studies.__path__, "uvms_gym.studies.")]


def test_studies_import_without_the_extras() -> None:
    absent = ("typer", "rich", "matplotlib", "scipy", "mujoco", "pinocchio", "torch", "stable_baselines3", "yaml")
    code = f"import sys; sys.modules |= dict.fromkeys({absent}); import importlib\n"
    code += f"for name in {[name for name in MODULES if name not in PEERS]}: importlib.import_module(name)"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_studies_do_not_import_the_command_line() -> None:
    sources = list(Path(studies.__path__[0]).rglob("*.py"))
    assert len(sources) >= len(MODULES)
    for source in sources:
        text = source.read_text()
        assert "uvms_gym.cli" not in text and "print(" not in text, source


def test_lines_through_powers_are_exact() -> None:
    x = np.array([1.0, 2.0, 8.0])
    assert loglog_interpolation(x, 3.0 * x**2, 4.0) == pytest.approx(48.0)
    assert loglog_interpolation(x, 3.0 * x**2, 100.0) == pytest.approx(3e4)
    assert convergence_order((0.1, 0.2, 0.4), (1e-4, 8e-4, 64e-4)) == pytest.approx(3.0)


def test_the_distance_of_rotations_is_their_angle() -> None:
    for angle in (1e-9, 0.5, 3.0):
        c, s = np.cos(angle), np.sin(angle)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        assert distances(rotation, np.eye(3)) == pytest.approx(angle, rel=1e-7)
