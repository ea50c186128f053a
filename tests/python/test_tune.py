"""Tuning finds what is there, sees edges, goes on where it was stopped, and touches nobody else's gains."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cma")
sys.path.append(str(Path(__file__).parents[2] / "training"))

from parameters import ALIKE, EACH, parameters, space_of
from search import Space, search, store
from tune import SEEDS, Arena, Limits, Score, app

from uvms_gym import PD
from uvms_gym.cli.app import run

pytestmark = pytest.mark.learning

TINY = ["--generations", "2", "--population", "4", "--episodes", "8", "--finals", "8", "--threads", "1"]
TINY += ["--env", "UVMS-StationKeep-v0"]


def bowl(best, noise=0.0, seed=0):
    """Scores 1 + the squared distance from `best` in the logarithm."""
    rng = np.random.default_rng(seed)

    def evaluate(_, candidates):
        distance = np.square(np.log(candidates / best)).sum(axis=1)
        return 1.0 + distance + noise * rng.normal(size=len(candidates))

    return evaluate


def space(n, low=0.1, high=10.0, floor=False):
    return Space([f"g{i}" for i in range(n)], [low] * n, [high] * n, [floor] * n)


def test_the_optimum_of_a_noisy_bowl_is_found():
    best = np.array([0.3, 1.0, 4.0, 2.0])
    found = search(space(4), bowl(best, noise=0.01), generations=30, population=16, seed=0)
    assert np.allclose(np.log(found[0]), np.log(best), atol=0.1)


def test_a_range_is_widened_where_the_best_is_beyond_it():
    best = np.array([100.0, 1.0])
    ours = space(2)
    found = search(ours, bowl(best), generations=60, population=12, seed=0)
    assert np.allclose(np.log(found[0]), np.log(best), atol=0.1)
    assert set(ours.widened) == {"g0 up"}
    assert ours.ranges["g0"][1] > 100.0
    assert ours.ranges["g1"] == [0.1, 10.0]


def test_a_search_begins_where_it_is_told_to():
    seen = []

    def evaluate(_, candidates):
        seen.append(candidates)
        return bowl(np.ones(2))(0, candidates)

    search(space(2, 0.01, 100.0), evaluate, start=np.array([10.0, np.nan]), generations=1, population=400, seed=0)
    places = np.log(seen[0])
    assert np.allclose(places.mean(axis=0), np.log([10.0, 1.0]), atol=0.3)
    assert places[:, 0].std() < 0.5 * places[:, 1].std()


def test_edges_are_seen_unless_they_are_floors():
    assert space(3).edges(space(3).places([0.11, 1.0, 9.5])) == [(0, False), (2, True)]
    assert space(3, floor=True).edges(space(3).places([0.11, 1.0, 9.5])) == [(2, True)]
    assert space(1).values(np.array([[-3.0], [0.5], [2.0]])).ravel() == pytest.approx([0.1, 1.0, 10.0])


def test_the_same_scores_make_the_same_search():
    def run(evaluate):
        return np.array(search(space(3), evaluate, generations=5, population=6, seed=3))

    scores = []

    def remember(generation, candidates):
        scores.append(bowl(np.ones(3) * 2.0)(generation, candidates))
        return scores[-1]

    assert (run(remember) == run(lambda generation, _: scores[generation])).all()


def test_what_is_beyond_a_limit_and_divergence_cost():
    score = Score(0.1, 0.2, 0.3, 0.0)
    assert score.objective(Limits()) == score.objective(Limits(0.2, 0.3)) == 0.1
    assert score.objective(Limits(effort=0.1)) == pytest.approx(0.4)
    assert score.objective(Limits(0.2, 0.1)) == pytest.approx(0.9)
    assert Score(0.1, 0.2, 0.3, 0.1).objective(Limits()) == pytest.approx(0.2)
    assert score.within(Limits(0.2, 0.3)) and not score.within(Limits(0.2, 0.29))


@pytest.mark.parametrize("axes", [ALIKE, EACH])
def test_every_axis_is_tuned_once(axes):
    assert sorted(axis for group in axes for axis in group) == list(range(6))
    for task in ("station-keep", "ee-track"):
        for sought in parameters(axes, task).values():
            labels = space_of(sought).labels
            assert len(set(labels)) == len(labels)


def test_an_entry_is_updated_and_the_others_stay(tmp_path):
    file = tmp_path / "some" / "gains.json"
    store(file, "pd", {"kp": [1.0, 2.0]}, {"score": 1.0})
    store(file, "pid", {"kp": [3.0]}, {"score": 2.0})
    store(file, "pd", {"kp": [4.0]}, {"score": 0.5})
    assert json.loads(file.read_text()) == {
        "pd": {"gains": {"kp": [4.0]}, "tuning": {"score": 0.5}},
        "pid": {"gains": {"kp": [3.0]}, "tuning": {"score": 2.0}},
    }
    assert [path.name for path in file.parent.iterdir()] == ["gains.json"]


def command(folder, *arguments):
    """Exit status of the command."""
    return run([*TINY, "--policies", str(folder / "p"), "--work", str(folder / "w"), *arguments], app, "tune.py")


def test_the_command_tunes_and_goes_on_where_it_was(tmp_path):
    assert command(tmp_path, "--controller", "pd", "--controller", "pid") == 0
    file = tmp_path / "p" / "UVMS-StationKeep" / "petasus-pum" / "0.05s" / "gains.json"
    first = json.loads(file.read_text())
    assert list(first) == ["pd", "pid"]
    assert len(first["pid"]["gains"]["ki"]) == 6
    record = first["pid"]["tuning"]
    assert record["effort_limit"] == pytest.approx(1.1 * first["pd"]["tuning"]["effort"])
    assert record["budget"]["episodes"] == 2 * 4 * 8 + 8 * record["budget"]["finalists"]
    factors = record["start"]
    assert len(factors) == 12 and None not in factors[:8] and factors[8:] == [None] * 4
    assert first["pd"]["gains"]["kd"][2] == pytest.approx(factors[5] * PD(scene="petasus-pum").kd[2], rel=1e-3)
    assert SEEDS.start == record["seeds"]["search"][0] <= record["seeds"]["final"][1] < SEEDS.stop
    # What a run stopped after the first generation leaves; the second is flown again and comes out the same.
    checkpoint = tmp_path / "w" / "UVMS-StationKeep" / "petasus-pum" / "0.05s" / "pid.json"
    stored = json.loads(checkpoint.read_text())
    checkpoint.write_text(json.dumps({**stored, "scores": stored["scores"][:1]}))
    assert command(tmp_path, "--controller", "pid") == 0
    assert json.loads(checkpoint.read_text())["scores"] == stored["scores"]
    again = json.loads(file.read_text())
    assert again["pid"]["gains"] == first["pid"]["gains"]
    assert again["pd"] == first["pd"]


def test_gains_that_cannot_be_read_are_refused_before_the_search(tmp_path, capsys):
    file = tmp_path / "p" / "UVMS-StationKeep" / "petasus-pum" / "0.05s" / "gains.json"
    file.parent.mkdir(parents=True)
    file.write_text('{"pid": {')
    assert command(tmp_path, "--controller", "pd") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(file) in line
    assert file.read_text() == '{"pid": {' and not list(tmp_path.glob("w/*/*/*/pd.json"))


def test_an_interrupt_is_told_and_loses_nothing(tmp_path, capsys, monkeypatch):
    score, calls = Arena.score, iter(range(6))

    def interrupted(*arguments):
        if next(calls, None) is None:
            raise KeyboardInterrupt
        return score(*arguments)

    monkeypatch.setattr(Arena, "score", interrupted)
    assert command(tmp_path, "--controller", "pd") == 130
    assert capsys.readouterr().err == "tune.py: interrupted\n"
    (checkpoint,) = tmp_path.glob("w/*/*/*/pd.json")
    assert len(json.loads(checkpoint.read_text())["scores"]) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--controller", "pdd"], "unknown controller 'pdd'; close to it: pd, pid"),
        (["--controller", "pid"], "tune pd first"),
        (["--controller", "none"], "none has no gains to tune"),
        (["--controller", "resolved"], "'resolved' is not for UVMS-StationKeep"),
        (["--controller", "pd", "--period", "0.013"], "multiple of the step"),
        (["--controller", "pd", "--generations", "1000", "--episodes", "2000"], "but must be below 1000000"),
    ],
)
def test_bad_input_gives_one_clear_line(tmp_path, capsys, arguments, message):
    assert command(tmp_path, *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
