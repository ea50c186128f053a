"""The map of the Marinarium set, on a simulated file with its columns."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_files import MARINARIUM, MARINARIUM_PARTS, MARINARIUM_SIGNS, write_marinarium

import uvms_gym
from uvms_gym import Log, LogError
from uvms_gym.cli import main

ROOT = Path(__file__).parents[2]
MAP = MARINARIUM / "map.toml"


def test_the_map_reads_the_sets_columns(tmp_path: Path) -> None:
    thrusts = write_marinarium(tmp_path, 2.0)
    logs = Log.read_all(tmp_path, MAP, scene="bluerov2-heavy")
    assert [log.name for log in logs] == list(MARINARIUM_PARTS)
    for log, thrust in zip(logs, thrusts):
        assert np.allclose(log.thrusters.command, thrust, atol=1e-6) and np.abs(thrust).max() > 5.0
    # Thrust up moves the vehicle up: a table of thrusts as in the set's script, in x forward, y left, z up.
    simulator = uvms_gym.Simulator("bluerov2-heavy")
    script = np.array([[1, 1, 0], [1, -1, 0], [1, -1, 0], [1, 1, 0], [0, 0, 1], [0, 0, -1], [0, 0, -1], [0, 0, 1]])
    script = script / np.linalg.norm(script, axis=1, keepdims=True)
    assert np.allclose(simulator.thruster_configuration[:3] * list(MARINARIUM_SIGNS.values()), script.T)


def test_the_replay_beats_the_predictors_and_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    write_marinarium(tmp_path / "bluerov2_dynamics/rosbags/rosbag2_2025_11_06")
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/marinarium.md").read_text()
    (code,) = re.findall(r"^```python\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    exec(code, {})
    found = {
        name: [float(x) for x in numbers.split(",")]
        for name, numbers in re.findall(r"^(.*) \[(.*)\]$", capsys.readouterr().out, re.MULTILINE)
    }
    for name in ("constant velocity", "double integrator"):
        assert found["scene"][2] < 0.1 * found[name][2] and found["scene"][1] < 0.2 * found[name][1]
    assert found["scene"][2] < 0.02
    validate = re.search(r"^uvms (validate .*?)\n(?:uvms|```)", page, re.MULTILINE | re.DOTALL)
    assert validate is not None
    arguments = validate[1].replace("\\\n", " ").split()
    assert main([*arguments[:-1], "4", "--out", "out"]) == 0
    out = capsys.readouterr().out
    assert "double integrator" in out and "-stabilized-2" in out


def test_pieces_are_consecutive_and_whole(tmp_path: Path) -> None:
    write_marinarium(tmp_path, 3.0)
    log = Log.read_all(tmp_path, MAP)[0]
    pieces = log.pieces(0.9)
    assert np.allclose([[piece.start, piece.end] for piece in pieces], [[0.0, 0.9], [0.9, 1.8], [1.8, 2.7]])
    assert [piece.name for piece in pieces] == [f"{log.name}-{k}" for k in (1, 2, 3)]
    times = np.linspace(0.95, 1.75, 9)
    assert np.array_equal(pieces[1].pose.position_at(times), log.pose.position_at(times))
    with pytest.raises(LogError, match=r"manual: 2\.98 s, shorter than a piece of 3 s$"):
        log.pieces(3.0)
