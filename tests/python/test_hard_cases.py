"""The hard cases: each meets its bar or warns, by every integrator in both precisions; and their truths."""

import dataclasses
import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer

import uvms_gym
from uvms_gym.cli.hard import CASES, arms, contact, spinning, water
from uvms_gym.cli.hard import case as hard_case
from uvms_gym.cli.hard.case import DTYPES, GROSS, MK4, Case, Floats, Lab, Lost, Method, Truth, errors, judge, methods
from uvms_gym.cli.hard.report import run_hard
from uvms_gym.cli.hard.truth import Top, complete_elliptic, ideal_body, incomplete_elliptic, jacobi, turn

MK1 = Method("mk1", 1)
BY_NAME = {case.name: case for case in CASES}


@pytest.mark.parametrize("method", methods(), ids=lambda method: method.name)
@pytest.mark.parametrize("name", BY_NAME)
def test_a_hard_case_meets_its_bar_or_warns(name: str, method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    if method != MK4:
        # The command takes a million steps by every method.
        monkeypatch.setattr(spinning, "DRIFT_STEPS", 100_000)
    for dtype in DTYPES:
        run = judge(BY_NAME[name], method, dtype)
        assert run.verdict != "SILENT", run


@pytest.mark.parametrize("name", [name for name in BY_NAME if name != "R'R over 1e6 steps"])
def test_the_default_meets_every_bar_without_a_warning(name: str) -> None:
    for dtype in DTYPES:
        run = judge(BY_NAME[name], MK4, dtype)
        assert run.verdict == "meets", run
        assert not run.warnings


@pytest.mark.parametrize("name", BY_NAME)
def test_a_method_that_chooses_its_pieces_is_never_grossly_wrong(name: str) -> None:
    for method in methods():
        for dtype in DTYPES if method.adaptive else ():
            for step in BY_NAME[name].coarser_steps(method):
                run = judge(BY_NAME[name], method, dtype, step)
                assert run.error <= run.bar, run


@pytest.mark.parametrize("name", BY_NAME)
def test_no_truth_is_in_doubt_near_the_bar(name: str) -> None:
    case = BY_NAME[name]
    assert case.truth().doubt <= 0.1 * case.bar(MK4, "float64")


# What the cases are judged by.


def _always(value: float) -> Case:
    truth = Truth({"x": np.ones((1, 1))}, "by definition")
    return Case("probe", "", lambda lab: {"x": np.full((1, 1), value)}, lambda: truth, {1: 0.01}, 0.01)


def test_what_misses_its_bar_without_a_warning_is_silent() -> None:
    assert judge(_always(1.0 + 0.9e-6), MK4, "float64").verdict == "meets"
    assert judge(_always(1.0 + 1.1e-6), MK4, "float64").verdict == "SILENT"
    assert judge(_always(1.0 + 1.1e-6), MK1, "float64").verdict == "meets"
    assert judge(_always(1.0 + 1.1e-6), MK4, "float32").verdict == "meets"
    assert judge(_always(1.0 + 1.1e-3), MK4, "float32").verdict == "SILENT"
    for lost in (math.nan, math.inf):
        assert judge(_always(lost), MK1, "float32").verdict == "SILENT"
    # A coarser step is asked for less.
    assert judge(_always(1.0 + 0.9 * GROSS), MK4, "float64", 0.1).verdict == "meets"
    assert judge(_always(1.0 + 1.1 * GROSS), MK4, "float64", 0.1).verdict == "SILENT"


def test_what_misses_its_bar_with_a_warning_is_no_failure() -> None:
    def run(lab: Lab) -> dict[str, Floats]:
        warnings.warn("probe", uvms_gym.StepWarning, stacklevel=1)
        raise Lost

    found = judge(dataclasses.replace(_always(1.0), run=run), MK4, "float64")
    assert (found.verdict, found.warnings, found.error) == ("warned", ["probe"], math.inf)


def test_errors_are_relative_and_those_of_rotations_are_angles() -> None:
    rotation = turn(np.array([0.6, 0.0, 0.8]), 0.5)
    for angle in (1e-9, 1e-3):
        off = rotation @ turn(np.eye(3)[1], angle)
        assert errors({"r": off}, {"r": rotation})["r"] == pytest.approx(angle, rel=1e-5)
    one = {"x": np.array([[3.0, 4.0], [0.0, 1.0]])}
    assert errors({"x": one["x"] + [[0.0, 0.0], [0.0, 0.1]]}, one)["x"] == pytest.approx(0.02)
    with pytest.raises(ValueError, match="not that of the truth"):
        errors({"x": np.zeros((1, 2))}, one)


def test_steps_and_bars_by_order() -> None:
    case = dataclasses.replace(_always(1.0), steps={4: 0.01, 2: 0.001}, implicit_step=0.05, interval=0.1)
    steps = {
        (order, implicit): case.step(Method("", order, False, implicit))
        for order in range(1, 6)
        for implicit in (False, True)
    }
    assert [steps[order, False] for order in range(1, 6)] == [0.001, 0.001, 0.001, 0.01, 0.01]
    assert {steps[order, True] for order in range(1, 6)} == {0.05}
    assert [case.bar(Method("", order), "float64") for order in (5, 4, 2)] == pytest.approx([1e-6, 1e-6, 1e-3])
    assert dataclasses.replace(case, smoothness=2).bar(MK4, "float64") == pytest.approx(1e-3)
    assert list(case.coarser_steps(MK4)) == pytest.approx([0.02, 0.05, 0.1])


# What the truths are worth.


def test_jacobi_functions_keep_their_laws() -> None:
    u = np.linspace(-30.0, 30.0, 601)
    for m in (0.0, 1e-6, 0.3, 0.9, 0.9999):
        sn, cn, dn = jacobi(u, m)
        assert np.allclose(sn**2 + cn**2, 1.0, atol=1e-15)
        assert np.allclose(dn**2 + m * sn**2, 1.0, atol=1e-15)
        h = 1e-4
        rate = (jacobi(u + h, m)[0] - jacobi(u - h, m)[0]) / (2.0 * h)
        assert np.allclose(rate, cn * dn, atol=1e-7)
        assert jacobi(np.array([complete_elliptic(m)]), m)[0] == pytest.approx(1.0, abs=1e-15)
        phi = np.linspace(-4.0, 4.0, 9)
        back = jacobi(np.array([incomplete_elliptic(x, m) for x in phi]), m)
        assert np.allclose(back[:2], [np.sin(phi), np.cos(phi)], atol=1e-12 / math.sqrt(1.0 - m))


def test_val_elliptic_functions_are_those_of_mpmath() -> None:
    mpmath = pytest.importorskip("mpmath")
    for m in (0.1, 0.7, 0.999):
        assert complete_elliptic(m) == pytest.approx(float(mpmath.ellipk(m)), rel=1e-15)
        for x in (-3.0, 0.4, 1.5, 7.7):
            assert incomplete_elliptic(x, m) == pytest.approx(float(mpmath.ellipf(x, m)), rel=1e-14)
            for mine, name in zip(jacobi(np.array([x]), m), ("sn", "cn", "dn"), strict=True):
                assert mine[0] == pytest.approx(float(mpmath.ellipfun(name, x, m=m)), abs=1e-14)


@pytest.mark.parametrize("spin", [(0.3, 2.0, 0.2), (2.0, -0.5, 0.1), (-0.1, 0.6, -1.5), (-1.2, 0.4, 0.3)])
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 0, 2), (2, 0, 1), (2, 1, 0)])
def test_the_closed_form_of_a_top_is_what_the_laws_of_impulse_give(
    spin: tuple[float, ...], axes: tuple[int, ...]
) -> None:
    inertia, times = np.array([1.0, 2.0, 3.0])[list(axes)], np.array([0.5, 2.0, 4.0])
    top = Top(inertia, np.array(spin)[list(axes)])
    twist = np.concatenate([np.zeros(3), top.spin])
    other = ideal_body(np.diag([1.0, 1.0, 1.0, *inertia]), twist, times, 0.01)
    assert np.allclose(top.rates(times), other["twist"][:, 3:], atol=1e-8)
    assert np.allclose(top.attitudes(times), other["attitude"], atol=1e-8)


def test_the_flip_flips() -> None:
    rates = spinning.DZHANIBEKOV.truth().values["rate"][:, 1]
    assert rates.max() > 1.9
    assert rates.min() < -1.9
    assert (np.diff(np.sign(rates)) != 0).sum() >= 2


def test_the_dead_band_chatters() -> None:
    assert contact.CHATTER.truth().values["switchings"] > 100


def test_a_wrong_pick_up_would_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """Had velocities stayed as they were, the payload would have got impulse and energy from nowhere."""
    contact.PAYLOAD_CASE.truth()
    monkeypatch.setattr(contact, "picked_up", lambda mass, joined, velocity: velocity)
    wrong = judge(contact.PAYLOAD_CASE, MK4, "float64").errors
    assert wrong["impulse kept"] > 1e-3
    assert wrong["energy won at pick-up"] > 1e-3
    assert wrong["inertia held"] < 1e-12


@pytest.mark.parametrize("name", [name for name in BY_NAME if name not in ("R'R over 1e6 steps", "reversal of time")])
def test_time_that_runs_too_fast_would_show(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Fast(Lab):
        def simulator(self, scene: str | dict[str, Any], num_envs: int = 1) -> uvms_gym.Simulator:
            return Lab(self.method, self.dtype, 1.01 * self.step).simulator(scene, num_envs)

    case = BY_NAME[name]
    case.truth()
    monkeypatch.setattr(hard_case, "Lab", Fast)
    assert judge(case, MK4, "float64").verdict == "SILENT"


@pytest.mark.parametrize(
    ("case", "factor"),
    [
        (water.MASS_RATIO, "quadratic_damping"),
        (water.OFF_DIAGONAL, "added_mass"),
        (water.MUNK_CASE, "added_mass"),
        (water.FAST_DRAG, "mass"),
        (water.DRAG_DECAY, "linear_damping"),
        (water.PENDULUM_CASE, "added_mass"),
        (water.DRIFT, "added_mass"),
        (water.DRIFT_ACCELERATING, "volume"),
        (arms.STIFF_DRAG, "linear_damping"),
        (contact.END_STOP, "mass"),
        (contact.CHATTER, "volume"),
    ],
    ids=lambda x: x.name if isinstance(x, Case) else x,
)
def test_other_water_would_show(case: Case, factor: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Other(Lab):
        def simulator(self, scene: str | dict[str, Any], num_envs: int = 1) -> uvms_gym.Simulator:
            made = super().simulator(scene, num_envs)
            made.scale_parameters(**{factor: 1.01})
            return made

    case.truth()
    monkeypatch.setattr(hard_case, "Lab", Other)
    assert judge(case, MK4, "float64").verdict == "SILENT"


# The command.


def test_the_report_has_every_run(tmp_path: Path) -> None:
    assert run_hard(tmp_path / "a", tmp_path / "b.json", ["free spin"]) == 0
    data = json.loads((tmp_path / "b.json").read_text())
    assert data["results"] == json.loads((tmp_path / "a/hard.json").read_text())["results"]
    (case,) = data["results"]
    assert case["case"] == "free spin"
    assert {(run["integrator"], run["dtype"]) for run in case["runs"]} == {
        (m.name, d) for m in methods() for d in DTYPES
    }
    assert (tmp_path / "a/hard.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_an_unknown_case_is_refused() -> None:
    with pytest.raises(typer.TyperException, match="no hard case has 'frobnicate' in its name; there are: free spin"):
        run_hard(None, None, ["frobnicate"])
