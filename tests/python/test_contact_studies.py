"""Contact beside MuJoCo, added mass as a lagged force in contact, and cost of contact."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from uvms_gym.studies.contact import cost, lagged_added_mass, peers
from uvms_gym.studies.contact.lagged_added_mass import bound, deviation, exact, lagged
from uvms_gym.studies.contact.plots import plot_lagged_added_mass
from uvms_gym.studies.contact.scenes import DROP, FRICTION, GRAVITY, LAW, SCENES, SLIDE
from uvms_gym.studies.records import plain

BY_NAME = {scene.name: scene for scene in SCENES}
BY_TITLE = {peer.title: peer for peer in peers.PEERS}
RK4, NOSLIP = BY_TITLE["MuJoCo RK4"], BY_TITLE["MuJoCo implicitfast, noslip"]
STEP = 0.001


def both(name: str, peer: peers.Peer = RK4, time: float | None = None) -> list[dict[str, float]]:
    """Results of a scene by us and by MuJoCo, with the depths at the end."""
    pytest.importorskip("mujoco")
    scene = BY_NAME[name]
    tracks = peers.by_us(scene, STEP, time=time), peers.by_mujoco(scene, peers.matched(scene), peer, STEP, time)
    return [scene.results(track) | {"depth": track.depth} for track in tracks]


def test_val_a_ball_rests_as_deep_in_mujoco_and_leaves_as_fast() -> None:
    ours, theirs = both("drop")
    for found in (ours, theirs):
        assert found["depth"] == pytest.approx(DROP.depth, rel=1e-5)
    assert theirs["exit speed (m/s)"] == pytest.approx(ours["exit speed (m/s)"], rel=0.02)


def test_val_a_box_slides_as_far_in_mujoco() -> None:
    (ours, theirs), coulomb = both("slide"), 0.5**2 / (2.0 * FRICTION * GRAVITY)
    assert ours["distance (m)"] == pytest.approx(coulomb, rel=0.01)
    assert theirs["distance (m)"] == pytest.approx(ours["distance (m)"], rel=0.03)
    # One time constant for both directions makes MuJoCo's friction viscous: it takes half as far again.
    _, viscous = both("slide", BY_TITLE["MuJoCo implicitfast, one solref"])
    assert viscous["distance (m)"] > 1.5 * ours["distance (m)"]


def test_val_a_box_creeps_on_a_slope_by_the_law_and_sticks_in_mujoco_without_slip() -> None:
    ours, theirs = both("slope", NOSLIP, time=2.0)
    # At half of the limit of friction.
    assert ours["creep (m/s)"] == pytest.approx(LAW["slip_speed"] / math.sqrt(3.0), rel=1e-5)
    assert abs(theirs["creep (m/s)"]) < 0.01 * ours["creep (m/s)"]


@pytest.mark.parametrize("name", ["rest", "bounce"])
def test_val_rest_stays_at_rest_and_a_bounce_without_dissipation_keeps_its_energy(name: str) -> None:
    ours, theirs = both(name, time=2.0)
    for found, tolerance in ((ours, 5e-4), (theirs, 0.02)):
        expected = 0.0 if name == "rest" else 1.0
        assert next(iter(found.values())) == pytest.approx(expected, abs=tolerance)


def test_val_a_finger_turns_a_lever_as_far_in_mujoco() -> None:
    ours, theirs = both("lever")
    assert 0.2 < ours["angle (rad)"] < 0.6
    assert theirs["angle (rad)"] == pytest.approx(ours["angle (rad)"], rel=0.01)


def test_our_results_are_the_same_from_a_step_of_20_ms() -> None:
    for scene in (DROP, SLIDE, BY_NAME["lever"]):
        coarse, fine = (scene.results(peers.by_us(scene, step)) for step in (0.02, 0.0005))
        for name, value in fine.items():
            assert coarse[name] == pytest.approx(value, rel=1e-3), (scene.name, name)


def test_the_coarsest_step_has_no_worse_one_below_it() -> None:
    steps = (0.02, 0.01, 0.005)
    assert peers.coarsest(steps, (0.0, 0.0, 0.0)) == 0.02
    assert peers.coarsest(steps, (0.0, 0.02, 0.0)) == 0.005
    assert peers.coarsest(steps, (0.0, 0.0, math.nan)) is None


def test_the_table_of_peers_has_every_program() -> None:
    pytest.importorskip("mujoco")
    (row,) = peers.study([BY_NAME["lever"]], repeats=1)
    assert list(row["programs"]) == ["mk4", "mk4, f32", *BY_TITLE]
    for found in row["programs"].values():
        assert len(found["deviations"]) == len(row["steps"])
        assert (found["cost"] is None) == (found["coarsest"] is None)
    assert row["programs"]["mk4"]["coarsest"] == 0.02
    json.dumps(plain(row), allow_nan=False)


@pytest.mark.parametrize("wall", [True, False])
def test_a_lagged_force_is_the_baseline_integrator(wall: bool) -> None:
    ratios = (1.0, 3.0, 5.0)
    ours, native = lagged(ratios, 0.005, 0.3, wall), exact(ratios, 0.005, wall, "lagged-added-mass")
    np.testing.assert_allclose(ours, native, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("alpha", "limit"), [(0.2, 9.0), (0.3, 17.0 / 3.0)])
def test_val_a_lagged_force_diverges_beyond_its_bound_at_every_step(alpha: float, limit: float) -> None:
    assert bound(alpha) == pytest.approx(limit)
    ratios = (1.0, 0.95 * limit, 1.1 * limit, 2.0 * limit)
    for wall in (True, False):
        reference = exact(ratios, 1e-4, wall)
        for step in (0.005, 0.001):
            off = deviation(lagged(ratios, step, alpha, wall), reference)
            np.testing.assert_array_equal(np.isfinite(off), [True, True, False, False])
            assert (deviation(exact(ratios, step, wall), reference) < 1e-6).all()


def test_val_a_lagged_force_loses_the_bounce() -> None:
    # A plate with eight times its mass of water leaves the wall by some 10 mm.
    reference = exact((8.0,), 1e-4)[0, :, 0]
    touched = int(np.argmax(reference > 0.1))
    away = {name: 0.1 - found[0, touched + 20 :, 0].min() for name, found in motions().items()}
    assert away["mk4"] == pytest.approx(0.1 - reference[touched + 20 :].min(), rel=1e-3)
    assert away["mk4"] > 0.005
    assert away["lagged"] < 0.5 * away["mk4"]


def motions() -> dict[str, np.ndarray]:
    return {"mk4": exact((8.0,), 0.005), "lagged": lagged((8.0,), 0.005, 0.2)}


def test_the_figure_of_added_mass_is_drawn(tmp_path: Path) -> None:
    found = lagged_added_mass.study((3.0, 8.0), (0.005,), 2e-4)
    plot_lagged_added_mass(tmp_path / "a.png", plain(found))
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_the_motions_that_are_timed_touch_what_they_say() -> None:
    rows = cost.study(1, 4, ("float64",))["cases"]
    for name, row in rows.items():
        assert row["touching"] == (8 if "rest" in name else 1 if "finger" in name else 0), name
        assert row["nanoseconds"]["float64"]["median"] > 0.0
        if row["turn"] is not None:
            assert abs(row["turn"]) > 0.1 if "finger" in name else row["turn"] == 0.0
