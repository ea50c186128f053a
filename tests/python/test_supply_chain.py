"""Dependencies: licence texts beside the native module, and the workflows' actions and permissions."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
TEXTS = "target/THIRD-PARTY.txt"
#: Actions that are named by a branch; docs/release.md says why.
UNPINNED = ["pypa/gh-action-pypi-publish@release/v1"]
#: Jobs that may write, and what.
WRITING = {"docs.yml": {"pages: write", "id-token: write"}, "wheels.yml": {"id-token: write"}}


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Licence texts of the installed wheel; in a source tree, as they are gathered for one."""
    for found in Path(os.environ.get("UVMS_GYM_UNDER_TEST", ROOT)).glob("uvms_gym-*.dist-info"):
        return (found / "licenses" / TEXTS).read_text(encoding="utf-8")
    folder = tmp_path_factory.mktemp("licences")
    for name in ("Cargo.toml", "Cargo.lock", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    for name in ("src", "tests"):
        (folder / name).symlink_to(ROOT / name)
    subprocess.run([sys.executable, str(ROOT / ".ci/licenses.py")], cwd=folder, check=True)
    return (folder / TEXTS).read_text(encoding="utf-8")


def test_the_wheel_holds_the_licences_of_all_crates_that_it_links(texts: str) -> None:
    entries = [re.split(r"\n\n", entry, maxsplit=1) for entry in texts.split(f"\n{'=' * 80}\n")[1:]]
    named: dict[str, str] = {}
    for names, text in entries:
        for name in re.findall(r"(?:^|, )([\w-]+) \d", names):
            named[name] = named.get(name, "") + text
    direct = {
        name
        for manifest in ("Cargo.toml", "src/python/Cargo.toml")
        for name in tomllib.loads((ROOT / manifest).read_text())["dependencies"]
    }
    assert direct - {"uvms-gym"} <= named.keys()
    # What these link in turn; no crate that only the build or the tests run.
    assert {"simba", "rayon-core", "num-traits", "pyo3-ffi"} <= named.keys()
    assert not {"syn", "serde_derive", "pyo3-build-config", "criterion", "proptest"} & named.keys()
    assert all(re.search(r"without\s+warrant|as[\s-]+is", text, re.IGNORECASE) for text in named.values())


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_actions_are_pinned_and_write_nothing_that_they_need_not(path: Path) -> None:
    text = path.read_text()
    for action, comment in re.findall(r"uses: *(\S+)(.*)", text):
        pinned = re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", action) and re.fullmatch(r"  # v\d+\.\d+\.\d+", comment)
        assert pinned or action in UNPINNED, action
    assert "\npermissions:\n  contents: read\n\njobs:" in text
    assert set(re.findall(r"[\w-]+: write\b", text)) == WRITING.get(path.name, set())
    assert text.count("actions/checkout@") == text.count("persist-credentials: false")
    assert "pull_request_target" not in text
