"""The README and its short form for PyPI: Python that runs, links that lead to files."""

import re
import shlex
import warnings
from pathlib import Path

import pytest

from uvms_gym.cli import main

ROOT = Path(__file__).parents[2]
TEXT, PYPI = ((ROOT / name).read_text() for name in ("README.md", "src/python/README.md"))
BLOCKS = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(
    "block",
    [pytest.param(b, marks=pytest.mark.learning if "stable_baselines3" in b else ()) for b in BLOCKS],
    ids=lambda block: re.sub(r"\W+", "-", block.splitlines()[0]),
)
def test_a_block_of_the_readme_runs_by_itself(block: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        exec(block.replace("learn(1_000_000)", "learn(1)"), {})


def test_the_commands_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"^```sh\n(uvms .*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    commands = [shlex.split(line, comments=True)[1:] for line in block.replace("\\\n", " ").splitlines()]
    assert [command[:2] for command in commands] == [["scenes", "import"], ["scenes", "check"], ["compare", "--env"]]
    for command in commands:
        assert main([*command, *(["--episodes", "2"] if command[0] == "compare" else [])]) == 0


def test_links_of_the_readme_lead_to_files_and_pictures_are_described() -> None:
    links = re.findall(r"(!?)\[([^\]]*)\]\(([^()\s]+)\)", TEXT)
    assert links
    for picture, text, target in links:
        assert (ROOT / target.partition("#")[0]).is_file(), target
        assert len(text) > (20 if picture else 2)


def test_the_form_for_pypi_has_the_example_and_no_link_to_a_file() -> None:
    assert BLOCKS[0] in PYPI
    assert "](" not in PYPI
