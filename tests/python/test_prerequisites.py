"""The check of what building needs, on machines made of stubs."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "prerequisites.sh"
GOOD = {
    "rustc": "echo 'rustc 1.95.0 (0123456 2025-01-01)'",
    "cargo": "echo 'cargo 1.95.0'",
    "cc": "exit 0",
    "python3": f'exec "{sys.executable}" "$@"',
}


def check(directory: Path, tools: dict[str, str | None]) -> subprocess.CompletedProcess[str]:
    """Runs the script where only `tools` are installed; None is a tool that is not there."""
    shell = shutil.which("sh")
    assert shell is not None
    for name in ("mktemp", "rm"):
        found = shutil.which(name)
        assert found is not None
        (directory / name).symlink_to(found)
    for name, text in (GOOD | tools).items():
        if text is not None:
            (directory / name).write_text(f"#!{shell}\n{text}\n")
            (directory / name).chmod(0o755)
    environment = {"PATH": str(directory), "TMPDIR": str(directory)}
    return subprocess.run([shell, str(SCRIPT)], env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("version", ["1.95.0", "1.96.1", "1.100.0-nightly", "2.0.0"])
def test_what_suffices_passes(tmp_path: Path, version: str) -> None:
    result = check(tmp_path, {"rustc": f"echo 'rustc {version} (0123456 2025-01-01)'"})
    assert (result.returncode, result.stdout, result.stderr) == (0, "python3\n", "")


@pytest.mark.parametrize(
    ("tools", "expected"),
    [
        ({"rustc": None}, "Rust >= 1.95"),
        ({"cargo": None}, "Rust >= 1.95"),
        ({"rustc": "echo 'rustc 1.94.1 (0123456 2025-01-01)'"}, "found 1.94.1"),
        ({"rustc": "echo 'rustc 0.99.0'"}, "found 0.99.0"),
        ({"cc": None}, "C compiler and linker"),
        ({"cc": "exit 1"}, "C compiler and linker"),
        ({"python3": None}, "Python >= 3.11"),
        ({"python3": "exit 1"}, "Python >= 3.11"),
        ({"python3": 'case "$2" in *venv*) exit 1;; esac'}, "venv module of python3"),
    ],
)
def test_what_is_missing_is_said_in_one_line(tmp_path: Path, tools: dict[str, str | None], expected: str) -> None:
    result = check(tmp_path, tools)
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("missing: ")
    assert expected in line
    assert "install" in line


def test_everything_missing_is_a_line_each(tmp_path: Path) -> None:
    result = check(tmp_path, dict.fromkeys(GOOD))
    assert result.returncode == 1
    assert len(result.stderr.splitlines()) == 3


def test_a_newer_python_under_another_name_is_found(tmp_path: Path) -> None:
    result = check(tmp_path, {"python3": "exit 1", "python3.12": "exit 0"})
    assert (result.returncode, result.stdout) == (0, "python3.12\n")
