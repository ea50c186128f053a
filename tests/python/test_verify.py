"""`uvms verify`: everything stored is made again and compared; files that anyone may have written are one line."""

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers import SMALL, layers, policy, ship

from uvms_gym import MLP
from uvms_gym.cli import main
from uvms_gym.controllers import registry
from uvms_gym.studies import records
from uvms_gym.studies.comparison import summary, verification
from uvms_gym.studies.comparison.statistics import Draws
from uvms_gym.studies.comparison.verification import verify

STORM = "UVMS-StationKeep-Storm-v0"
CONTROLLERS = ("pd", "ppo", "mlp:own.safetensors")
#: Entries that no other run makes again: checked for their form.
RECORDS = {"uvms_gym", "commit", "python", "numpy", "gymnasium", "matplotlib", "machine", "seconds"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The working folder, with compare.json of two conditions, and policies shipped for the small scene."""
    path = tmp_path_factory.mktemp("verify")
    ship(path / "policies")
    policy(substeps=10).save(path / "own.safetensors")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(path)
        patch.setattr(registry, "FOLDERS", [path / "policies"])
        # Fewer numbers of each kind: the laws below go through all of them.
        patch.setattr(summary, "Draws", lambda episodes, seed: Draws(episodes, seed, 50))
        patch.setattr(summary, "THRESHOLDS", 5)
        given = [word for name in CONTROLLERS for word in ("--controller", name)]
        given += ["--condition", "design", "--condition", "lag"]
        assert main(["compare", "--scene", SMALL, "--episodes", "18", "--seed", "3", *given, "--out", "."]) == 0
        yield path


@pytest.fixture
def stored(folder: Path) -> Any:
    return json.loads((folder / "compare.json").read_text())


def written(folder: Path, data: Any) -> Path:
    file = folder / "forged.json"
    file.write_text(json.dumps(data))
    return file


def test_everything_stored_is_reproduced(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(folder / "compare.json") == ([], [])
    assert main(["verify", "compare.json"]) == 0
    assert "compare.json: all entries are reproduced, numbers to 0.0001" in capsys.readouterr().out


def places(entry: Any, place: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Every entry below, with its container and key."""
    for key in entry if isinstance(entry, dict) else range(len(entry)):
        plain = isinstance(key, str) and re.fullmatch(r"[\w-]+", key)
        name = f"{place}.{key}".removeprefix(".") if plain else f"{place}[{key}]"
        yield name, entry, key
        if isinstance(entry[key], (dict, list)):
            yield from places(entry[key], name)


def forged(value: Any) -> Iterator[Any]:
    """Values that a reader may take for the true one, and one of another type."""
    if isinstance(value, dict):
        yield value | {"no such key": 1.0}
        yield from ({name: part for name, part in value.items() if name != left} for left in value)
    elif isinstance(value, list):
        yield [*value, 1.0]
        yield value[:-1] if value else None
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value + 1e-5)
    elif isinstance(value, float):
        yield value * 1.001 + 1e-6
    else:
        yield 1.5 if value is None else value + "1"
    yield {"value": 0.0} if isinstance(value, list) else [0.0]


def forgeries(data: Any, place: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Forge every entry below in turn: its place, its key, and the value that it has now."""
    for name, container, key in places(data, place):
        value = container[key]
        for other in forged(value):
            container[key] = other
            yield name, key, other
        container[key] = value


def test_every_forged_entry_of_a_result_is_refused_by_its_place(stored: Any) -> None:
    """Each leaf one by one, and each key and entry left out or added."""
    arguments = stored["circumstances"]["arguments"]
    condition = verification._conditions(arguments, 2)[1]
    comparison, _ = verification._comparison(condition, {}, arguments["controllers"], run_code=False)
    expected = verification.expect(comparison, arguments["episodes"], arguments["seed"])
    result = stored["results"][1]
    assert list(verification.differences("", result, expected)) == []
    count = 0
    # In parts, since each forgery is looked for among all entries.
    for part, whole in zip(parts(result), parts(expected), strict=True):
        for place, key, other in forgeries(part):
            found = next(verification.differences("", part, whole), "nothing").replace('"', "")
            assert found.startswith(place) or (key == "seconds" and isinstance(other, float)), (place, found)
            count += 1
    assert count > 1500


def parts(result: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Each controller, and each other entry of a result."""
    yield from ({"controllers": {name: entry}} for name, entry in result["controllers"].items())
    yield from ({key: result[key]} for key in sorted(result) if key != "controllers")


def test_every_forged_circumstance_is_refused_but_for_plausible_records(stored: Any) -> None:
    arguments = stored["circumstances"]["arguments"]
    comparisons = [
        verification._comparison(condition, {}, arguments["controllers"], run_code=False)[0]
        for condition in verification._conditions(arguments, 2)
    ]
    assert list(verification._heads(stored, comparisons)) == []
    passed = set()
    for key in ("circumstances", "statistics"):
        for place, _, _ in forgeries(stored[key], key):
            if place.startswith("circumstances.arguments"):
                continue
            if next(verification._heads(stored, comparisons), None) is None:
                passed.add(place.split(".")[1])
    assert passed <= RECORDS


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("env", ["UVMS-Dock-Storm-v0"], "its task is UVMS-StationKeep, the environment's UVMS-Dock"),
        ("scene", ["rexrov"], "its scene is bluerov2-heavy"),
        ("controllers", ["pd", "ppo"], 'controllers["mlp:own.safetensors"] is stored, but unknown'),
        ("controllers", ["pd", "pid", *CONTROLLERS[1:]], "controllers.pid is not stored"),
        ("controllers", None, 'controllers["mlp:own.safetensors"] is stored, but unknown'),
        ("episodes", 2, "controllers.pd.episodes: 18 is stored, 2 found"),
        ("seed", 2, "statistics.seed: 3 is stored, 2 found"),
        ("condition", ["design", "calm"], 'condition: "lag" is stored, "calm" found'),
        ("condition", ["design"], "results: 2 are stored, but circumstances.arguments name 1 condition"),
        ("disturbance", ["calm"], 'disturbance: null is stored, "calm" found'),
        ("action", "thrusters", "its action is wrench, the environment's thrusters"),
        ("max_current", 0.2, "options.max_current is not stored"),
        ("episodes", 1, "circumstances.arguments.episodes is 1, but must be an integer from 2 to 100000"),
        ("episodes", True, "circumstances.arguments.episodes is true"),
        ("seed", -1, "circumstances.arguments.seed is -1"),
        ("scene", "rexrov", 'circumstances.arguments.scene is "rexrov", but must be a list'),
        ("env", [], "circumstances.arguments.env is a list of 0"),
        ("env", [STORM, STORM], "circumstances.arguments.env is a list of 2, but must be a list of at least 1 diff"),
        ("action", {}, "circumstances.arguments.action is an object of 0, but must be wrench or thrusters"),
        ("max_current", 1e6, "circumstances.arguments.max_current is 1000000, but must be a number from 0 to 10"),
        ("env_kwargs", {"thruster_lag": 0.3}, "options.thruster_lag: 0.1 is stored, 0.3 found"),
        ("env_kwargs", {"scene": "rexrov"}, "circumstances.arguments.env_kwargs is an object of 1, but must be"),
        (
            "env_kwargs",
            {"reward": {"effort": 0.3}},
            "circumstances.arguments.env_kwargs is an object of 1, but must be",
        ),
        ("env_kwargs", {"no_such": 1}, "no_such"),
        ("rewards", 1.0, "circumstances.arguments.rewards is stored, but unknown"),
    ],
)
def test_forged_arguments_are_refused(
    name: str, value: Any, message: str, folder: Path, stored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    stored["circumstances"]["arguments"][name] = value
    assert main(["verify", str(written(folder, stored))]) == 2
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert message in captured.out + captured.err


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_a_policy_that_is_another_is_a_difference_and_a_missing_one_is_named(
    folder: Path, stored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = (folder / f"policies/UVMS-StationKeep/{SMALL}/0.1s/ppo-{seed}.safetensors" for seed in (0, 1))
    kept = one.read_bytes(), other.read_bytes()
    label = f"{STORM}, {SMALL}, design: "
    MLP(scene=SMALL, substeps=10, notes={"steps": "7"}, **layers((24, 6), 7)).save(other)
    (lines, unchecked), file = verify(folder / "compare.json"), written(folder, stored)
    assert lines[0].startswith(f"{label}controllers.ppo.origin.files[1].sha256: ")
    assert lines[1].startswith(f"{label}controllers.ppo.kept.pose[1][0]: ") and unchecked == []
    for path, seeds in ((other, "1"), (one, "0, 1")):
        path.unlink()
        for full in (False, True):
            lines, unchecked = verify(folder / "compare.json", full)
            assert lines == [] and len(unchecked) == 2
            assert unchecked[0].startswith(f"{label}ppo: not checked for training seeds {seeds}, as their policies")
        assert main(["verify", str(file)]) == 0
        out = capsys.readouterr().out
        assert "ppo: not checked" in out and "all other entries are reproduced" in out
        # The others are still checked, and the policy that is there.
        entries = stored["results"][0]["controllers"]
        for name in ("pd", "ppo")[: 2 - seeds.count("0")]:
            entries[name]["kept"]["pose"][0][0] *= 1.001
            lines, _ = verify(written(folder, stored))
            entries[name]["kept"]["pose"][0][0] /= 1.001
            assert [line.partition(": ")[2].partition(":")[0] for line in lines] == [
                f"controllers.{name}.kept.pose[0][0]"
            ]
    for path, data in zip((one, other), kept, strict=True):
        path.write_bytes(data)
    # Seeds that came later change nothing.
    path = one.with_name("ppo-7.safetensors")
    path.write_bytes(kept[0])
    assert verify(folder / "compare.json") == ([], [])
    path.unlink()


# Files that anyone may have written


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "Expecting value"),
        (b"[]", "a list of 0 is stored"),
        (b"{}", "circumstances is not stored"),
        (b'{"circumstances": {"arguments": {}}, "results": [{}]}', "statistics is not stored"),
        (b'{"circumstances": {"arguments": {"seed": 0}}, "statistics": {}, "results": [{}]}', "arguments.env is not"),
        (b'{"circumstances": {"arguments": []}, "statistics": {}, "results": [{}]}', "circumstances.arguments: a list"),
        (b'{"circumstances": [], "statistics": {}, "results": [{}]}', "circumstances.arguments: null"),
        (b'{"circumstances": {}, "statistics": {}, "results": []}', "results is a list of 0"),
        (b"[" * 100_000, "nested too deeply"),
        (b"[" * 900 + b"]" * 900, "a list of 1 is stored"),
        (b'{"a":' * 100_000, "nested too deeply"),
        (b'{"results": 1, "results": 2}', "key 'results' is there twice"),
        (b'{"results": NaN}', "a number is nan, but must be finite"),
        (b'{"results": -Infinity}', "a number is -Infinity, but must be finite"),
        (b'{"results": 1e999}', "a number is 1e999, but must be finite"),
        (b'{"results": 1' + b"0" * 5000 + b"}", "an integer has 5001 digits, but may have 20"),
        (b"\xff\xfe{}", "invalid start byte"),
        (b'{"results": "\xc3', "unexpected end of data"),
        (b'{"\\u001b[31m": 1, "circumstances": {}, "statistics": {}, "results": []}', r'["\u001b[31m"] is stored, but'),
    ],
)
def test_a_file_without_results_is_one_line(
    text: bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "results.json"
    file.write_bytes(text)
    for options in ([], ["--scoreboard"]):
        assert main(["verify", *options, str(file)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{file} holds no results of uvms compare: " in line and message.lower() in line.lower()
        assert len(line) < 300 + len(str(file))


def test_every_truncated_file_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (folder / "compare.json").read_bytes()
    for end in range(0, len(text) - 2, len(text) // 97):
        (folder / "forged.json").write_bytes(text[:end])
        assert main(["verify", "forged.json"]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_file_beyond_the_limit_is_refused_before_it_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(records, "MOST_BYTES", 1 << 20)
    file = tmp_path / "results.json"
    with file.open("wb") as sparse:
        os.truncate(sparse.fileno(), 1 << 40)
    assert main(["verify", str(file)]) == 2
    assert "larger than 1 MiB" in capsys.readouterr().err
    assert main(["verify", str(tmp_path / "none.json")]) == 2
    assert "cannot read" in capsys.readouterr().err


def test_the_certificate_of_an_environment_is_no_comparison(
    folder: Path, stored: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    stored["circumstances"]["command"] = "accuracy"
    assert main(["verify", str(written(folder, stored))]) == 2
    assert 'circumstances.command: "accuracy" is stored, "compare" found' in capsys.readouterr().out


def test_a_map_of_logs_that_is_nested_too_deeply_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "map.toml").write_text("map = " + "[" * 100_000)
    assert main(["validate", SMALL, str(tmp_path), "--map", str(tmp_path / "map.toml"), "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "nested too deeply" in line
