"""The scripts in training/ where something is missing."""

import subprocess
import sys
from pathlib import Path

import pytest

TRAINING = Path(__file__).parents[2] / "training"


@pytest.mark.parametrize("script", ["train_rllib", "evaluate_ray"])
@pytest.mark.parametrize("lacking", ["ray", "typer"])
def test_scripts_on_ray_say_in_one_line_what_they_lack(script: str, lacking: str) -> None:
    code = f"import runpy, sys; sys.modules[{lacking!r}] = None; sys.path.insert(0, {str(TRAINING)!r})"
    code += f"; runpy.run_path({str(TRAINING / script)!r} + '.py', run_name='__main__')"
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1 and "pip install 'uvms-gym[rllib]'" in ran.stderr
