"""Estimates of accumulated errors: interface, environments, warnings."""

import warnings

import gymnasium
import numpy as np
import pytest

from uvms_gym import Simulator
from uvms_gym.studies.hard_cases.scenes import single_body

KEYS = ("position", "attitude", "q", "end_effector_position", "end_effector_attitude", "relative", "known")


def driven(error_estimate: bool | None = True, **options: object) -> Simulator:
    """Three instances of petasus-pum under random wrenches, 1 s."""
    simulator = Simulator("petasus-pum", 3, error_estimate=error_estimate, **options)
    rng = np.random.default_rng(0)
    for _ in range(10):
        simulator.step(
            wrench=rng.uniform(-10, 10, (3, 6)), joint_target=simulator.q, substeps=round(0.1 / simulator.dt)
        )
    return simulator


def test_estimates_are_near_the_errors():
    simulator, exact = driven(dt=0.02), driven(dt=0.002)
    found = simulator.error_estimate()
    assert tuple(found) == KEYS and found["known"].all()
    ends = [s.end_effector_pose()[:, :3, 3] for s in (simulator, exact)]
    for name, error in (
        ("position", np.linalg.norm(simulator.position - exact.position, axis=1)),
        ("end_effector_position", np.linalg.norm(ends[0] - ends[1], axis=1)),
    ):
        assert found[name].shape == (3,) and (error > 1e-10).all()
        # Single errors may pass through zero.
        assert 1 / 3 < np.median(found[name] / error) < 3, (name, found[name] / error)
    assert found["q"].shape == simulator.q.shape


def test_estimates_are_only_made_on_request():
    for option in (False, None):
        with pytest.raises(ValueError, match="error_estimate=True"):
            driven(error_estimate=option).error_estimate()
    with pytest.raises(TypeError):
        Simulator("free-body", error_estimate="yes")


def test_environments_show_them_on_request():
    kind = "UVMS-StationKeep-v0"
    vector = gymnasium.make_vec(kind, num_envs=2, error_estimate=True)
    plain = gymnasium.make(kind)
    singles = [gymnasium.make(kind, error_estimate=True) for _ in range(2)]
    _, infos = vector.reset(seed=5)
    assert np.all(infos["error_estimate"] == 0.0)
    plain.reset(seed=5)
    for i, single in enumerate(singles):
        _, info = single.reset(seed=5 + i)
        assert info["error_estimate"].shape == (6,)
    actions = vector.action_space.sample()
    for _ in range(3):
        observations, _, _, _, infos = vector.step(actions)
        observation, _, _, _, info = plain.step(actions[0])
        assert "error_estimate" not in info
        np.testing.assert_array_equal(observation, observations[0])
        for i, single in enumerate(singles):
            info = single.step(actions[i])[4]
            np.testing.assert_array_equal(info["error_estimate"], infos["error_estimate"][i])
    assert infos["_error_estimate"].all() and (infos["error_estimate"] > 0.0).any(axis=1).all()


@pytest.mark.parametrize("n", [1, 32])
def test_environments_watch_errors_by_default(n):
    def warned(**options):
        envs = gymnasium.make_vec("UVMS-EETrack-v0", num_envs=n, integrator="mk1", action="thrusters", **options)
        envs.reset(seed=0)
        rng = np.random.default_rng(0)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            for _ in range(100):
                envs.step(rng.uniform(-1, 1, envs.action_space.shape))
        return [str(w.message) for w in said if "added up" in str(w.message)]

    assert len(warned()) == 1
    assert not warned(error_estimate=False)


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_a_companion_takes_shorter_pieces_of_a_turn_that_begins_at_rest() -> None:
    # The instance halves its first steps: a companion at half the step would take the same pieces, and see no error.
    body = {"mass": 20.0, "inertia": [1.0, 1.2, 1.5], "volume": 0.02, "center_of_buoyancy": [0.0, 0.0, 0.03]}
    body |= {"added_mass": [10, 12, 14, 0.5, 0.5, 0.5], "damping": {"linear": [5] * 3 + [0.3] * 3}}
    tether = {"position": [-0.4, 0.0, 0.2], "length": 60.0, "diameter": 0.012, "mass_per_length": 0.15, "drag": 1.2}
    scene = {"name": "tethered", "water": {"density": 1000.0, "gravity": [0.0, 0.0, -9.81]}}
    scene["vehicle"] = {"name": "tethered", "body": body, "tether": tether}
    motions = []
    for dt in (0.1, 0.001):
        s = Simulator(scene, dt=dt, integrator="ros3", error_estimate=True)
        s.set_state(position=[0.0, 0.0, -20.0], current=[1.5, 0.5, 0.0])
        s.step(substeps=round(0.5 / dt))
        motions.append(s)
    coarse, fine = motions
    error = np.linalg.norm(coarse.rotation - fine.rotation) / np.sqrt(2)
    assert error > 1e-3
    assert 1 / 3 < coarse.error_estimate()["attitude"][0] / error < 3


@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
@pytest.mark.parametrize("part", ["time", "position", "twist"])
def test_parts_of_a_state_that_are_not_set_keep_their_errors(part: str) -> None:
    errors = []
    for given in (False, True):
        brick = single_body("brick", {"mass": 3.0, "inertia": [0.1, 0.2, 0.25]})
        s = Simulator(brick, dt=0.05, integrator="mk2", error_estimate=True)
        s.set_state(twist=[0.3, 0.0, 0.0, 3.0, 1.0, 2.0])
        for _ in range(40):
            s.step()
            if given:
                s.set_state(**{part: getattr(s, part) + (0.0 if part == "twist" else 1.0)})
        errors.append(s.error_estimate()["attitude"][0])
    assert errors[0] > 1e-3 and errors[1] == errors[0]
