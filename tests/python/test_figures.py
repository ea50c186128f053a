"""Layout of figures: no text covers another, a legend covers no curve, and nothing leaves the picture."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

import uvms_gym
from uvms_gym.cli import disturbances
from uvms_gym.cli.episode_plot import Instant, plot_episode
from uvms_gym.studies.accuracy import plots as accuracy
from uvms_gym.studies.comparison import plots as comparison
from uvms_gym.studies.hard_cases import plots as hard_cases
from uvms_gym.studies.identification import plots as identification
from uvms_gym.studies.paper import plots as paper
from uvms_gym.studies.plotting import label_points, legend_above, picture
from uvms_gym.viewer.curves import CURVES

STORED = [
    Path(uvms_gym.__file__).parent / "pretrained" / f"UVMS-{task}" / "petasus-pum" / "0.1s" / "results.json"
    for task in ("StationKeep", "EETrack")
]
TIME = np.linspace(0.0, 20.0, 200)
#: Pixels by which boxes may touch.
TOUCH = 1.0


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[Figure, float]]]:
    """Figures and their resolution, in their final layout, in place of files; the laws hold for each."""
    found: list[tuple[Figure, float]] = []

    def keep(figure: Figure, _: Any, dpi: float, **__: Any) -> None:
        figure.set_dpi(dpi)
        figure.draw_without_rendering()
        check(figure)
        found.append((figure, dpi))

    monkeypatch.setattr(Figure, "savefig", keep)
    # Files are made, though empty.
    monkeypatch.chdir(tmp_path)
    yield found
    assert found


def overlap(a: Any, b: Any) -> bool:
    """True if two boxes have more than an edge in common."""
    return bool(
        min(a.x1, b.x1) - max(a.x0, b.x0) > TOUCH
        and min(a.y1, b.y1) - max(a.y0, b.y0) > TOUCH
    )  # fmt: skip


def shown(texts: Any) -> list[Any]:
    return [text for text in texts if text.get_visible() and text.get_text().strip()]


def ticks(axis: Any) -> list[Any]:
    low, high = sorted(axis.get_view_interval())
    return shown(t.label1 for t in axis.get_major_ticks() if low <= t.get_loc() <= high and t.label1.get_visible())


def check(figure: Figure) -> None:
    """Laws of a figure in its final layout."""
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    legends += [legend for part in figure.subfigs for legend in part.legends]
    for axes in (axes for axes in figure.axes if axes.get_visible()):
        for axis in (axes.xaxis, axes.yaxis):
            labels = ticks(axis)
            for one, other in itertools.pairwise(labels):
                if not one.get_rotation():
                    boxes = one.get_window_extent(), other.get_window_extent()
                    assert not overlap(*boxes), f"ticks {one.get_text()} and {other.get_text()}"
        titles = shown([axes.title, axes._left_title, axes._right_title])  # type: ignore[attr-defined]
        texts = [*titles, *shown([axes.xaxis.label, axes.yaxis.label]), *ticks(axes.xaxis), *ticks(axes.yaxis)]
        whole = figure.bbox
        for text in [*texts, *shown(axes.texts)]:
            box = text.get_window_extent()
            assert whole.x0 - TOUCH <= box.x0 and box.x1 <= whole.x1 + TOUCH, text.get_text()
            assert whole.y0 - TOUCH <= box.y0 and box.y1 <= whole.y1 + TOUCH, text.get_text()
        for legend in legends:
            box = legend.get_window_extent()
            assert whole.x0 - TOUCH <= box.x0 and box.x1 <= whole.x1 + TOUCH
            for text in titles:
                assert not overlap(text.get_window_extent(), box), f"legend over {text.get_text()}"
            for line in axes.lines:
                points = line.get_transform().transform(np.asarray(line.get_xydata(), float))
                inside = axes.bbox.padded(2.0).containsx, axes.bbox.padded(2.0).containsy
                points = [p for p in points[np.isfinite(points).all(axis=1)] if inside[0](p[0]) and inside[1](p[1])]
                assert not any(box.contains(*p) for p in points), f"legend over {line.get_label()}"


def test_a_legend_over_a_curve_is_found(drawn: Any) -> None:
    with pytest.raises(AssertionError, match="legend over line"), picture(Path("x.png"), 4.0, 3.0) as figure:
        axes = figure.subplots()
        axes.plot(TIME, np.sin(TIME), label="line")
        axes.legend(loc="center")
    with picture(Path("x.png"), 4.0, 3.0) as figure:
        axes = figure.subplots()
        axes.plot(TIME, np.sin(TIME), label="line")
        axes.set_title("A title that leaves no room beside it")
        legend_above(axes)


def test_names_along_the_frontier_are_apart(drawn: Any) -> None:
    comparison.plot_frontier(Path("frontier.png"), comparison.stored_panels(STORED))
    figure, dpi = drawn[0]
    assert figure.get_figwidth() * dpi < 1200
    for axes in figure.axes:
        # Without the line to the point.
        boxes = [Text.get_window_extent(text) for text in axes.texts]
        assert len(boxes) >= 5
        assert not any(overlap(a, b) for a, b in itertools.combinations(boxes, 2))
        for box in boxes:
            assert axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1
            assert axes.bbox.y0 <= box.y0 and box.y1 <= axes.bbox.y1


@pytest.mark.parametrize("scale", [1.0, 3e-4])
def test_bars_of_calm_water_have_short_ticks(drawn: Any, scale: float) -> None:
    (controllers,) = comparison.stored_panels(STORED[:1]).values()
    chosen = {}
    for name in ("pd", "dob", "ppo"):
        metrics: dict[str, Any] = {}
        for metric, parts in controllers[name]["metrics"].items():
            factor = scale if metric == "variation" else 1.0
            whole = {
                key: SimpleNamespace(**row) if key == "p95" else [factor * row[end] for end in ("value", "low", "high")]
                for key, row in parts["whole"].items()
                if isinstance(row, dict)
            }
            metrics[metric] = {"whole": whole}
        chosen[name] = {"metrics": metrics, "episodes": 2}
    condition = SimpleNamespace(name="an environment")
    result: Any = (SimpleNamespace(condition=condition), SimpleNamespace(controllers=chosen, winner="ppo"))
    comparison.plot_bars(Path("compare.png"), [result])
    for axes in drawn[0][0].axes:
        texts = [label.get_text().removeprefix("$\\mathdefault{").removesuffix("}$") for label in ticks(axes.xaxis)]
        assert all(len(text) <= 5 for text in texts), texts


@pytest.mark.parametrize("names", [["surge"], [f"a joint of the arm {k}" for k in range(11)]])
def test_an_episode_is_drawn_with_its_legends_aside(drawn: Any, names: list[str]) -> None:
    rng = np.random.default_rng(0)
    info = ("disturbance_force", "payload", "thruster_gain", *(f"current_{axis}" for axis in "xyz"))
    calm = dict.fromkeys([*info, *(curve.entry for curve in CURVES)], 0.0)
    actions = [None, *rng.uniform(-1.0, 1.0, (len(TIME) - 1, len(names)))]
    instants = [Instant(t, calm | {"payload": 1.0 + 0.1 * t}, action) for t, action in zip(TIME, actions, strict=True)]
    plot_episode(Path("x.png"), "a scene  ·  shac-distilled/medium, storm-wide", names, CURVES, instants)


def test_disturbances_name_their_axes(drawn: Any) -> None:
    scene = uvms_gym.load_scene("petasus-pum")
    profile = disturbances.disturbance_profile(scene, "storm", 0, 5.0)
    disturbances._plot(Path("x.png"), "storm: a scene, seed 0", profile)
    shapes = {f"shape {k}": profile for k in range(9)}
    disturbances._plot_shapes(Path("x.png"), shapes)
    for figure, _ in drawn:
        for axes in figure.axes:
            if len(axes.lines) == 3 and "thrust" not in axes.get_ylabel():
                assert [text.get_text() for text in axes.get_legend().get_texts()] == ["x", "y", "z"]


@pytest.mark.parametrize("count", [1, 30])
def test_the_bar_of_hard_cases_is_whole(drawn: Any, count: int) -> None:
    cases: Any = [SimpleNamespace(name=f"a case with a long name {k}") for k in range(count)]
    runs: Any = [
        SimpleNamespace(
            case=case.name, method=method.name, dtype=dtype, recommended=True, verdict="meets", error=1e-8, bound=1e-6
        )
        for case in cases
        for method in hard_cases.methods()
        for dtype in hard_cases.DTYPES
    ]
    hard_cases.plot_hard_cases(Path("x.png"), cases, runs)
    bar = drawn[0][0].axes[-1]
    assert "decades" in bar.get_xlabel() + bar.get_ylabel()


@pytest.mark.parametrize("span", [1.2, 3.0, 30.0, 1000.0])
@pytest.mark.parametrize("others", [0, 5])
def test_ticks_of_work_precision_are_apart(drawn: Any, span: float, others: int) -> None:
    def result(seed: int) -> dict[str, Any]:
        rows = [
            {
                "integrator": name,
                "precision": precision,
                "step": step,
                "cost": 1e3 * (3.0 + seed) * span ** (k / 5.0),
                "end_effector": {"median": 1e-3 * step**2},
            }
            for name in accuracy.STYLES
            for precision in ("f64", "f32")
            for k, step in enumerate((0.05, 0.02, 0.01, 0.005, 0.002, 0.001))
        ]
        return {"rows": rows, "reference": {"uncertainty": {"end_effector": {"median": 1e-13}}}, "comparison": None}

    accuracy.plot_work_precision(Path("x.png"), {f"scene {k}": result(k) for k in range(1 + others)}, 10.0)
    for axes in drawn[0][0].axes:
        assert len(ticks(axes.xaxis)) >= 2


def test_figures_of_the_paper_keep_legends_aside(drawn: Any) -> None:
    columns = {"time": TIME, "position": np.ones((200, 3)), "rpy": np.ones((200, 3)), "end_effector": np.ones((200, 3))}
    paper.plot_vehicle_motion(Path("x.png"), "Fig. 5: a vehicle that is not controlled", columns)
    paper.plot_end_effector(Path("x.png"), dict.fromkeys(("uncontrolled", "PD-controlled", "vehicle held"), columns))
    run = {"drift": np.full((200, 2), 1e-9), "time": TIME, "linear": 1e-9, "angular": 1e-9}
    runs = [{**run, "step": step} for step in (0.04, 0.02, 0.01, 0.005)]
    study = {"runs": runs, "orders": {"linear": 4.0, "angular": 4.0}}
    paper.plot_momentum(Path("x.png"), {"in water": study, "in a vacuum": study})
    errors = {name: np.geomspace(1e-9, 1e-3, 4) for name in ("MK4", "quaternion, RK4", "quaternion, Euler")}
    orders = dict.fromkeys(errors, 4.0)
    paper.plot_tumbling(
        Path("x.png"), {"steps": [0.1, 0.2, 0.4, 0.8], "errors": errors, "orders": orders, "time": 10.0}
    )


@pytest.mark.parametrize("count", [1, 2, 6])
def test_replays_and_intervals_are_sharp(drawn: Any, count: int) -> None:
    recordings = [SimpleNamespace(name=f"trial-{k}", periods=199, time=TIME) for k in range(count)]
    values = np.random.default_rng(0).normal(size=(count, 200, 12))
    table = SimpleNamespace(channels=["roll", "pitch", "gyro x"])
    predicted = {"replay": values, "balance": values, "constant": values}
    replays: Any = SimpleNamespace(recordings=recordings, predicted=predicted, measured=values, table=table)
    identification.plot_replays(Path("x.png"), replays)
    names = [f"vehicle.body.damping.quadratic[{k}]" for k in range(count)]
    ones = np.ones(count)
    uncertainty = SimpleNamespace(prior=ones, quantile=2.0, deviations=0.3 * ones, shares=0.1 * ones)
    fit: Any = SimpleNamespace(
        uncertainty=uncertainty,
        parameters=[SimpleNamespace(key=name, origin=0.0) for name in names],
        solution=SimpleNamespace(common=ones),
        values=dict.fromkeys(names, 1.234),
    )
    identification.plot_intervals(Path("x.png"), fit)
    for figure, dpi in drawn:
        assert figure.get_figwidth() * dpi >= 800


def test_a_name_as_near_to_another_point_is_joined_to_its_own(tmp_path: Path) -> None:
    with picture(tmp_path / "names.png", 3.0, 3.0) as figure:
        axes = figure.subplots()
        axes.set(xlim=(0.0, 100.0), ylim=(0.0, 100.0))
        label_points(axes, [(50.0, 50.0, "one", "black"), (52.0, 50.0, "other", "black"), (10.0, 10.0, "far", "black")])
        notes: Any = axes.texts
        assert {note.get_text(): note.arrow_patch.get_visible() for note in notes} == {
            "one": True,
            "other": True,
            "far": False,
        }
