"""Scripts in training/ compile, also those whose packages are not installed."""

import py_compile
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[2] / "training").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_a_script_compiles(script: Path, tmp_path: Path) -> None:
    py_compile.compile(str(script), cfile=str(tmp_path / "compiled"), doraise=True)
