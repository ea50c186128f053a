"""Button and valve under controllers: what succeeds, what does not, and what is reported."""

import gymnasium
import numpy as np
import pytest

from uvms_gym import Rollout, Simulator, make_controller

SCENE = "bluerov2-heavy-alpha5-tool"


def episodes(env, controller, count=32, seed=11, **options):
    """Statistics of episodes, natively."""
    envs = gymnasium.make_vec(env, num_envs=count, **{"scene": SCENE, **options})
    chosen = make_controller(controller, envs)
    envs.reset(seed=seed)
    rollout = Rollout(envs, chosen)
    rollout.run(gymnasium.spec(env).max_episode_steps)
    return rollout.pop_stats()


def test_a_button_is_pressed():
    stats = episodes("UVMS-Button-v0", "resolved-dob")
    assert stats.last["success"].mean() >= 0.95
    # At rest the spring's force is that of the contact.
    travel, force = stats.last["travel"], stats.last["contact_force"]
    assert np.median(np.abs(force - 1000.0 * travel)) < 0.5
    assert (stats.last["peak_force"] >= force).all()
    assert (stats.last["impulse"] > 0.0).all()


def test_without_control_nothing_is_pressed_or_turned():
    for env in ("UVMS-Button-v0", "UVMS-Valve-v0"):
        assert episodes(env, "none", max_current=0.0).last["success"].sum() == 0.0


@pytest.mark.parametrize("contract", ["push", "grasp"])
def test_a_valve_is_turned(contract):
    stats = episodes("UVMS-Valve-v0", "resolved-dob", contract=contract, torque=0.012 if contract == "push" else 0.3)
    assert stats.last["success"].mean() >= 0.8


@pytest.mark.parametrize("contract", ["push", "grasp"])
@pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")
def test_a_blocked_valve_is_not(contract):
    """The observer pushes with all it has until the tool slips, which is chaotic motion."""
    blocked = episodes("UVMS-Valve-v0", "resolved-dob", contract=contract, range=0.3)
    assert blocked.last["success"].sum() == 0.0
    assert blocked.last["angle"].max() < 0.5


def test_options_change_the_fixture():
    env = gymnasium.make("UVMS-Button-v0", scene=SCENE, stiffness=500.0, damping=10.0, travel=0.02)
    scene = env.unwrapped.snapshot().scene
    (fixture,) = scene["fixtures"]
    assert fixture["name"] == "button"
    assert fixture["joint"]["spring"]["stiffness"] == 500.0
    assert fixture["joint"]["limits"]["upper"] == 0.02
    # The scene of the environment is one for the simulator, button and panel included.
    simulator = Simulator(scene)
    assert simulator.joint_names[-1] == "button"


def test_fixture_and_force_are_observed_on_request():
    plain = gymnasium.make("UVMS-Button-v0", scene=SCENE)
    names = [block.name for block in plain.unwrapped.layout]
    assert "fixture" not in names and "contact_force" not in names
    asked = gymnasium.make("UVMS-Button-v0", scene=SCENE, observe_fixture=True, observe_force=True)
    blocks = {block.name: block for block in asked.unwrapped.layout}
    controller, state = make_controller("resolved-dob", asked), None
    observation, info = asked.reset(seed=3)
    for _ in range(250):
        action, state = controller.predict(observation, state)
        observation, _, _, _, info = asked.step(action)
    travel = observation[blocks["fixture"].slice][0] * blocks["fixture"].scale[0]
    assert travel == pytest.approx(info["travel"], rel=1e-5) and travel > 0.002
    force = observation[blocks["contact_force"].slice] * np.array(blocks["contact_force"].scale)
    # One contact: its force is at least the normal one, at most that and friction.
    assert info["contact_force"] * (1 - 1e-5) <= np.linalg.norm(force) <= info["contact_force"] * np.hypot(1.0, 0.41)


def test_range_checks_name_the_option():
    with pytest.raises(ValueError, match=r"option radius = 0.1: must be in \[0.02, 0.075\] m"):
        gymnasium.make("UVMS-Valve-v0", radius=0.1)
    with pytest.raises(ValueError, match=r"option pressed_travel = 0.02: must be in \[0, travel\] m"):
        gymnasium.make("UVMS-Button-v0", pressed_travel=0.02)
