"""The README's Python runs, block by block."""

import re
import warnings
from pathlib import Path

import pytest

import uvms_gym

ROOT = Path(__file__).parents[2]


@pytest.mark.nightly
def test_the_blocks_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    scene = Path(uvms_gym.__file__).parent / "scenes" / "petasus-pum.toml"
    (tmp_path / "my.toml").write_text(scene.read_text())
    text = (ROOT / "README.md").read_text()
    blocks = re.findall(
        r"^```python\n(.*?)^```", text.replace("learn(1_000_000)", "learn(1)"), re.MULTILINE | re.DOTALL
    )
    assert len(blocks) >= 3
    names: dict[str, object] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for block in blocks:
            exec(block, names)
