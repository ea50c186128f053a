"""Controllers of Python files in `uvms compare`, submitted results in `uvms verify`, and the rule of the scoreboard."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import SMALL, layers, policy

from uvms_gym.cli import main
from uvms_gym.controllers.registry import PRETRAINED
from uvms_gym.studies.comparison import conditions, contenders
from uvms_gym.studies.comparison.scoreboard import read_entries

SUBMITTED = sorted((Path(__file__).parents[2] / "docs" / "scoreboard").glob("*/compare.json"))
RESULTS = sorted(PRETRAINED.glob("*/*/*/results.json"))
OWN = """
import numpy as np
import uvms_gym

GAIN = 1.0


class Own:
    def __init__(self, env):
        self.pid = uvms_gym.make_controller("pid", env)

    def predict(self, observation, state, episode_start, deterministic):
        action, state = self.pid.predict(observation, state, episode_start)
        return (GAIN * action).astype(np.float32), state


def policy(env):
    return uvms_gym.MLP.load("policy.safetensors", env=env)

"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with a submission's files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    # At the limits throughout: it leaves the task's bounds.
    made = layers((24, 6))
    policy(substeps=10, **made | {"biases": [np.full(6, 1e3)]}).save(tmp_path / "policy.safetensors")
    return tmp_path


def scores(name: str, **options: Any) -> dict[str, np.ndarray]:
    (of,) = conditions.make_conditions(["UVMS-StationKeep-Storm-v0"], {SMALL: SMALL}, **options)
    envs = contenders.make_envs(of, 6)
    return contenders.run(envs, of, contenders.make_contender(of, name), 5).scores


@pytest.mark.parametrize(("own", "shipped"), [("Own", "pid"), ("policy", "mlp:policy.safetensors")])
def test_a_controller_in_python_scores_as_the_native_one_that_it_wraps(own: str, shipped: str) -> None:
    found, expected = scores(f"py:own.py:{own}"), scores(shipped)
    assert (expected["diverged/whole"].max() > 0.0) == (own == "policy")
    for key, values in expected.items():
        np.testing.assert_allclose(found[key], values, rtol=1e-12, atol=1e-15, err_msg=key)


def test_a_submitted_result_is_computed_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    controllers = ["pd", "py:own.py:Own", "mlp:policy.safetensors"]
    given = [word for name in controllers for word in ("--controller", name)]
    assert main(["compare", "--scene", SMALL, "--episodes", "4", *given, "--out", "."]) == 0
    stored = json.loads((folder / "compare.json").read_text())
    (own,) = stored["results"][0]["controllers"]["py:own.py:Own"]["origin"]["files"]
    assert own["name"] == "own.py" and len(own["sha256"]) == 64
    (folder / "own.py").write_text(OWN + 'open("ran", "w")\n')
    assert main(["verify", "compare.json"]) == 2
    assert "py:own.py:Own is Python code; read it, then run it with --run-code" in capsys.readouterr().err
    assert not (folder / "ran").exists()
    (folder / "own.py").write_text(OWN)
    assert main(["verify", "--run-code", "compare.json"]) == 0
    capsys.readouterr()
    assert main(["verify", "--scoreboard", "compare.json"]) == 2
    error = capsys.readouterr().err
    assert "compare.json: pd: scene is 'bluerov2-heavy', but the scoreboard has 'petasus-pum'" in error
    assert error.count("\n") == 1
    (folder / "own.py").write_text(OWN.replace("GAIN = 1.0", "GAIN = 0.99"))
    assert main(["verify", "--run-code", "compare.json"]) == 2
    lines = capsys.readouterr().out.splitlines()
    assert 'controllers["py:own.py:Own"].origin.files[0].sha256: ' in lines[0]
    assert any('controllers["py:own.py:Own"].kept.pose[0][0]: ' in line for line in lines)


@pytest.mark.parametrize("path", [*RESULTS, *SUBMITTED], ids=str)
def test_the_tables_are_of_files_that_follow_the_rule(path: Path) -> None:
    entries = read_entries(path)
    assert len(entries) >= 2
    assert all(entry["episodes"] == 1024 for _, _, entry in entries)


@pytest.mark.nightly
@pytest.mark.parametrize("path", SUBMITTED, ids=str)
def test_entries_of_the_scoreboard_come_out_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(path.parent)
    assert main(["verify", "--scoreboard", "--run-code", path.name]) == 0


def refused(folder: Path, text: str, words: str) -> None:
    (folder / "compare.json").write_text(text)
    with pytest.raises(ValueError, match=words):
        read_entries(folder / "compare.json")


@pytest.mark.parametrize(
    ("place", "key", "value"),
    [
        ("results", "env", "UVMS-StationKeep-v0"),
        ("results", "scene", SMALL),
        ("results", "disturbance", "calm"),
        ("results", "condition", "calm"),
        ("arguments", "seed", 7),
        ("arguments", "action", "thrusters"),
        ("arguments", "max_current", 0.1),
    ],
)
def test_other_conditions_and_arguments_are_refused(place: str, key: str, value: Any, folder: Path) -> None:
    stored = json.loads(RESULTS[0].read_text())
    (stored["results"][0] if place == "results" else stored["circumstances"]["arguments"])[key] = value
    refused(folder, json.dumps(stored), f"{key} is {value!r}, but (the scoreboard has|must be)")


@pytest.mark.parametrize("name", ["`<script>`", "mlp:a|b", "py:a.py:N\nb", "nobody"])
def test_a_name_that_would_alter_the_table_is_refused(name: str, folder: Path) -> None:
    stored = json.loads(RESULTS[0].read_text())
    controllers = stored["results"][0]["controllers"]
    controllers[name] = controllers.pop("pd" if "pd" in controllers else "resolved")
    refused(folder, json.dumps(stored), r"controller .* is unknown")
