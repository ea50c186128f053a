"""Hard cases: each meets its bound or warns, by every integrator in both precisions; and their references."""

import dataclasses
import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uvms_gym
from uvms_gym._rotations import about
from uvms_gym.cli import main
from uvms_gym.studies.hard_cases import CASES, contact, spinning
from uvms_gym.studies.hard_cases import case as hard_case
from uvms_gym.studies.hard_cases.case import (
    DTYPES,
    GROSS,
    MK4,
    Case,
    CaseRunner,
    Floats,
    Method,
    NonFinite,
    Reference,
    errors,
    evaluate,
    methods,
)
from uvms_gym.studies.hard_cases.reference_solutions import Top, force_free_motion

MK1 = Method("mk1", 1)
BY_NAME = {case.name: case for case in CASES}


@pytest.mark.parametrize("method", methods(), ids=lambda method: method.name)
@pytest.mark.parametrize("name", BY_NAME)
def test_a_hard_case_meets_its_bound_or_warns(name: str, method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    if method != MK4:
        # The command takes a million steps by every method.
        monkeypatch.setattr(spinning, "DRIFT_STEPS", 100_000)
    for dtype in DTYPES:
        run = evaluate(BY_NAME[name], method, dtype)
        assert run.verdict != "SILENT", run


@pytest.mark.nightly
@pytest.mark.parametrize("method", methods(), ids=lambda method: method.name)
@pytest.mark.parametrize("name", BY_NAME)
def test_a_hard_case_meets_its_bound_or_warns_at_coarser_steps_too(name: str, method: Method) -> None:
    case = BY_NAME[name]
    for dtype in DTYPES:
        for step in [None, *case.coarser_steps(method)]:
            run = evaluate(case, method, dtype, step)
            assert run.verdict != "SILENT", run


@pytest.mark.parametrize("name", [name for name in BY_NAME if name != "R'R over 1e6 steps"])
def test_the_default_meets_every_bound_without_a_warning(name: str) -> None:
    for dtype in DTYPES:
        run = evaluate(BY_NAME[name], MK4, dtype)
        assert run.verdict == "meets", run
        assert not (run.warnings and run.judges_warnings), run


@pytest.mark.parametrize("name", BY_NAME)
def test_an_adaptive_method_never_has_a_gross_error(name: str) -> None:
    for method in methods():
        for dtype in DTYPES if method.adaptive else ():
            for step in BY_NAME[name].coarser_steps(method):
                run = evaluate(BY_NAME[name], method, dtype, step)
                assert run.error <= run.bound, run


@pytest.mark.parametrize("name", BY_NAME)
def test_the_uncertainty_of_references_is_far_below_the_bound(name: str) -> None:
    case = BY_NAME[name]
    assert case.reference().uncertainty <= 0.1 * case.bound(MK4, "float64")


# Evaluation of runs.


def _always(value: float) -> Case:
    reference = Reference({"x": np.ones((1, 1))}, "by definition")
    return Case("probe", "", lambda runner: {"x": np.full((1, 1), value)}, lambda: reference, {1: 0.01}, 0.01)


def test_a_missed_bound_without_a_warning_is_silent() -> None:
    assert evaluate(_always(1.0 + 0.9e-6), MK4, "float64").verdict == "meets"
    assert evaluate(_always(1.0 + 1.1e-6), MK4, "float64").verdict == "SILENT"
    assert evaluate(_always(1.0 + 1.1e-6), MK1, "float64").verdict == "meets"
    assert evaluate(_always(1.0 + 1.1e-6), MK4, "float32").verdict == "meets"
    assert evaluate(_always(1.0 + 1.1e-3), MK4, "float32").verdict == "SILENT"
    for lost in (math.nan, math.inf):
        assert evaluate(_always(lost), MK1, "float32").verdict == "SILENT"
    # Coarser steps have a greater bound.
    assert evaluate(_always(1.0 + 0.9 * GROSS), MK4, "float64", 0.1).verdict == "meets"
    assert evaluate(_always(1.0 + 1.1 * GROSS), MK4, "float64", 0.1).verdict == "SILENT"


def test_a_missed_bound_with_a_warning_is_no_failure() -> None:
    def run(runner: CaseRunner) -> dict[str, Floats]:
        warnings.warn("probe", uvms_gym.StepWarning, stacklevel=1)
        raise NonFinite

    found = evaluate(dataclasses.replace(_always(1.0), run=run), MK4, "float64")
    assert (found.verdict, found.warnings, found.error) == ("warned", ["probe"], math.inf)


def test_errors_are_relative_and_those_of_rotations_are_angles() -> None:
    rotation = about(np.array([0.6, 0.0, 0.8]), 0.5)[None]
    for angle in (1e-9, 1e-3):
        off = rotation @ about(np.eye(3)[1], angle)
        assert errors({"r": off}, {"r": rotation})["r"] == pytest.approx(angle, rel=1e-5)
    one = {"x": np.array([[3.0, 4.0], [0.0, 1.0]])}
    assert errors({"x": one["x"] + [[0.0, 0.0], [0.0, 0.1]]}, one)["x"] == pytest.approx(0.02)
    with pytest.raises(ValueError, match="differs from the reference's"):
        errors({"x": np.zeros((1, 2))}, one)


def test_steps_and_bounds_by_order() -> None:
    case = dataclasses.replace(_always(1.0), steps={4: 0.01, 2: 0.001}, implicit_steps={2: 0.05}, interval=0.1)
    steps = {
        (order, implicit): case.step(Method("", order, False, implicit))
        for order in range(1, 6)
        for implicit in (False, True)
    }
    assert [steps[order, False] for order in range(1, 6)] == [0.001, 0.001, 0.001, 0.01, 0.01]
    assert {steps[order, True] for order in range(1, 6)} == {0.05}
    assert [case.bound(Method("", order), "float64") for order in (5, 4, 2)] == pytest.approx([1e-6, 1e-6, 1e-3])
    assert dataclasses.replace(case, smoothness=2).bound(MK4, "float64") == pytest.approx(1e-3)
    assert list(case.coarser_steps(MK4)) == pytest.approx([0.02, 0.05, 0.1])


# Accuracy of the references.


@pytest.mark.parametrize("spin", [(0.3, 2.0, 0.2), (2.0, -0.5, 0.1), (-0.1, 0.6, -1.5), (-1.2, 0.4, 0.3)])
@pytest.mark.parametrize("axes", [(0, 1, 2), (1, 0, 2), (2, 0, 1), (2, 1, 0)])
def test_the_closed_form_of_a_top_is_what_the_laws_of_impulse_give(
    spin: tuple[float, ...], axes: tuple[int, ...]
) -> None:
    inertia, times = np.array([1.0, 2.0, 3.0])[list(axes)], np.array([0.5, 2.0, 4.0])
    top = Top(inertia, np.array(spin)[list(axes)])
    twist = np.concatenate([np.zeros(3), top.spin])
    other = force_free_motion(np.diag([1.0, 1.0, 1.0, *inertia]), twist, times)
    assert np.allclose(top.rates(times), other["twist"][:, 3:], atol=1e-8)
    assert np.allclose(top.attitudes(times), other["attitude"], atol=1e-8)


def test_the_flip_flips() -> None:
    rates = spinning.DZHANIBEKOV.reference().values["rate"][:, 1]
    assert rates.max() > 1.9
    assert rates.min() < -1.9
    assert (np.diff(np.sign(rates)) != 0).sum() >= 2


def test_the_dead_band_chatters() -> None:
    assert contact.CHATTER.reference().values["switchings"] > 100


def test_a_wrong_grasp_would_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """The payload would gain impulse and energy if velocities did not change."""
    contact.PAYLOAD_CASE.reference()
    monkeypatch.setattr(contact, "grasp_velocity", lambda mass, joined, velocity: velocity)
    wrong = evaluate(contact.PAYLOAD_CASE, MK4, "float64").errors
    assert wrong["impulse kept"] > 1e-3
    assert wrong["energy gain at grasp"] > 1e-3
    assert wrong["inertia held"] < 1e-12


CLOCK = "steps"


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        *((name, CLOCK) for name in BY_NAME if name not in ("R'R over 1e6 steps", "reversal of time")),
        ("added mass 0.01 to 1000 m", "quadratic_damping"),
        ("off-diagonal added mass", "added_mass"),
        ("Munk instability", "added_mass"),
        ("quadratic damping at 50 m/s", "mass"),
        ("damping over six decades", "linear_damping"),
        ("restoring pendulum", "added_mass"),
        ("drift with a current", "added_mass"),
        ("drift, water accelerating", "volume"),
        ("stiff damping of a light link", "linear_damping"),
        ("joint limit hit at speed", "mass"),
        ("thruster dead-band chatter", "volume"),
        ("quadratic damping at 200 m/s", "quadratic_damping"),
        ("weakly damped roll", "linear_damping"),
        ("slow rise", "added_mass"),
        ("resonance", "mass"),
    ],
)
def test_time_that_runs_too_fast_and_other_water_would_show(
    name: str, factor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = BY_NAME[name]

    class Other(CaseRunner):
        def simulator(self, scene: str | dict[str, Any], num_envs: int = 1) -> uvms_gym.Simulator:
            if factor == CLOCK:
                return CaseRunner(self.method, self.dtype, 1.01 * self.step).simulator(scene, num_envs)
            made = super().simulator(scene, num_envs)
            made.scale_parameters(**{factor: 1.01})
            return made

    case.reference()
    monkeypatch.setattr(hard_case, "CaseRunner", Other)
    assert evaluate(case, MK4, "float64").verdict == "SILENT"


# The command.


def test_the_report_has_every_run(tmp_path: Path) -> None:
    arguments = ["hard-cases", "--case", "free spin", "--out", str(tmp_path / "a"), "--json", str(tmp_path / "b.json")]
    assert main(arguments) == 0
    data = json.loads((tmp_path / "b.json").read_text())
    assert data["results"] == json.loads((tmp_path / "a/hard-cases.json").read_text())["results"]
    (case,) = data["results"]
    assert case["case"] == "free spin"
    assert {(run["integrator"], run["dtype"]) for run in case["runs"]} == {
        (m.name, d) for m in methods() for d in DTYPES
    }
    assert (tmp_path / "a/hard-cases.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
