"""Tables of commands on a terminal of 80 columns."""

import json
import re
from pathlib import Path

import pytest
from helpers import SMALL, policy

from uvms_gym.cli import common, main
from uvms_gym.cli.output import table
from uvms_gym.studies.accuracy.study import Criterion
from uvms_gym.studies.comparison.conditions import make_conditions
from uvms_gym.studies.comparison.summary import short_names


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> pytest.CaptureFixture[str]:
    monkeypatch.setattr(common.console, "width", 80)
    return capsys


def test_a_table_fits_and_breaks_no_number_and_no_word(printed: pytest.CaptureFixture[str]) -> None:
    header = ("controller", "pose error, mm", "p95, mm", *(f"{cost} / pd" for cost in ("p95", "power", "variation")))
    numbers = ("47.62 [45.61, 49.63]", "142", "0.951 [0.912, 0.990]", "-1.0 % [-2.2, -0.1]", "10.11 [9.52, 10.73]")
    table(
        "Errors",
        header,
        [("shac-distilled", *numbers), ("a-name-that-is-much-longer-than-half-a-line-may-be", *numbers)],
    )
    lines = printed.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert all(sum(number in line for line in lines) == 2 for number in numbers)
    words = {word for name in header for word in name.split()}
    assert words <= {word for line in lines for word in line.split()}
    # What follows below begins with the names again.
    assert sum("controller" in line for line in lines) == sum("shac-distilled" in line for line in lines) > 1


def test_criteria_of_accuracy_leave_their_numbers_whole(printed: pytest.CaptureFixture[str]) -> None:
    what = "petasus-pum: MK4 f64 at 0.02 s, median error at the end effector"
    table("Criteria", ("criterion", "found", "bound", ""), [Criterion(what, "1.2e-09 m", "1e-06 m", True)])
    out = printed.readouterr().out
    assert re.search(r"criterion +found +bound", out) and re.search(r"1\.2e-09 m +1e-06 m +True", out)


def test_compare_names_policies_shortly_and_tells_their_files(
    printed: pytest.CaptureFixture[str], no_pictures: None, tmp_path: Path
) -> None:
    files = [tmp_path / "out/train/asymmetric-ppo" / f"UVMS-StationKeep-v0_{k}" / "policy.safetensors" for k in (1, 2)]
    for file in files:
        file.parent.mkdir(parents=True)
        policy().save(file)
    names = [f"mlp:{file}" for file in files]
    given = [word for name in ("pd", *names) for word in ("--controller", name)]
    given += ["--condition", "design", "--condition", "calm", "--env", "UVMS-StationKeep-v0", "--scene", SMALL]
    assert main(["compare", *given, "--episodes", "4", "--out", str(tmp_path)]) == 0
    lines = printed.readouterr().out.splitlines()
    legends = [f"policy {k}: {name}" for k, name in enumerate(names, 1)]
    assert all(lines.count(legend) == 2 for legend in legends)
    tables = [line for line in lines if line not in legends and not line.startswith(str(tmp_path))]
    assert max(map(len, tables)) <= 80
    assert not any("safetensors" in line for line in tables)
    assert sum(line.startswith("policy 1 ") for line in tables) >= 4
    assert all(line.count("[") == line.count("]") for line in tables)
    # Results keep the whole names.
    assert [*json.loads((tmp_path / "compare.json").read_text())["results"][0]["controllers"]] == ["pd", *names]


def test_short_names_are_told_apart() -> None:
    given = ["pd", "mlp:pd.safetensors", "mlp:a/x.safetensors", "mlp:b/x.safetensors", "py:c/own.py:LQR"]
    assert list(short_names(given).values()) == ["pd", "pd 1", "x 1", "x 2", "own.py:LQR"]
    assert short_names(["mlp:a/b/own.safetensors"]) == {"mlp:a/b/own.safetensors": "own"}


def test_scenes_whose_results_would_have_one_name_are_refused() -> None:
    scenes = dict.fromkeys(("a/own.toml", "b/own.toml"), SMALL)
    with pytest.raises(ValueError, match=r"a/own\.toml and b/own\.toml have the same name"):
        make_conditions(["UVMS-StationKeep-v0"], scenes)
