"""Contracts of policies: an environment as plain data, its differences from another one, and their refusal."""

import copy
import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import SMALL, layers, task_ids

import uvms_gym
from uvms_gym import MLP, ControllerWarning, check_contract, load_scene, make_controller, policy_contract

STORM = "UVMS-StationKeep-Storm-v0"


def made(**changes: Any) -> gymnasium.Env[Any, Any]:
    return gymnasium.make(STORM, **{"scene": SMALL, **changes})


def altered(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """The small scene with other numbers, under its name."""
    scene = copy.deepcopy(load_scene(SMALL))
    change(scene)
    return scene


def heavier(scene: dict[str, Any]) -> None:
    scene["vehicle"]["body"]["mass"] *= 1.1


def stronger(scene: dict[str, Any]) -> None:
    for thruster in scene["vehicle"]["thrusters"]:
        thruster["limits"] = [1.25 * limit for limit in thruster["limits"]]


#: Arguments of another environment, the difference, and its counterpart in the training.
DIFFERENCES: list[tuple[dict[str, Any], str]] = [
    ({"scene": "bluerov2-heavy-alpha5"}, "scene is bluerov2-heavy-alpha5 instead of bluerov2-heavy"),
    ({"scene": altered(heavier)}, "vehicle.body.mass is 14.85 instead of 13.5 (+10 %)"),
    ({"scene": altered(stronger)}, "scale of action surge is "),
    ({"action": "thrusters"}, "action_kind is thrusters instead of wrench"),
    ({"substeps": 5}, "control_period is 0.05 instead of 0.1 (-50 %)"),
    ({"thruster_lag": 0.3}, "thruster_lag is 0.3 s instead of 0.1 s"),
    ({"thruster_lag": None}, "thruster_lag is as in the scene instead of 0.1 s"),
    ({"start_distance": 0.1}, "start_distance is 0.1 instead of 0.05 (+100 %)"),
    ({"disturbance": {"base": "storm", "delay": {"periods": 3}}}, "delay is 3 instead of 1 control periods"),
    (
        {"disturbance": {"base": "storm", "noise": {"position": 0.02}}},
        "noise.position is 0.02 instead of 0.005 (+300 %)",
    ),
    ({"disturbance": "storm-hard"}, "disturbance (storm-hard instead of storm) "),
]


@pytest.mark.parametrize(("changes", "difference"), DIFFERENCES, ids=lambda one: one if isinstance(one, str) else "")
def test_another_environment_is_refused_with_the_difference_and_its_size(
    changes: dict[str, Any], difference: str, tmp_path: Path
) -> None:
    file = tmp_path / "contract.json"
    file.write_text(json.dumps(policy_contract(made())))
    with pytest.raises(ValueError) as caught:
        check_contract(file, made(**changes))
    line = str(caught.value)
    assert line.startswith(f"{file}: the environment differs from the contract: ") and "\n" not in line
    assert line.count(difference) == 1


@pytest.mark.parametrize("env", task_ids())
def test_an_environment_keeps_its_own_contract_through_a_file(env: str, tmp_path: Path) -> None:
    file, works = tmp_path / "contract.json", any(tool in env for tool in ("Button", "Valve"))
    more: dict[str, Any] = {"observe_fixture": True, "observe_force": True} if works else {}
    file.write_text(json.dumps(policy_contract(gymnasium.make(env, **more))))
    found = check_contract(file, gymnasium.make_vec(env, num_envs=2, **more))
    inner: Any = gymnasium.make(env, **more).unwrapped
    assert len(found["observation"]) == inner.observation_space.shape[0]
    assert len(found["action"]) == inner.action_space.shape[0]
    for entry in [*found["observation"], *found["action"]]:
        assert entry["unit"] and entry["frame"] and entry["computation"], entry["name"]
        assert np.isfinite([entry["scale"], entry["low"], entry["high"]]).all(), entry["name"]


def test_every_difference_of_environment_and_controller_is_named_in_one_line(tmp_path: Path) -> None:
    env = made()
    policy, other = (
        MLP(env, **layers((env.observation_space.shape[0], 8, env.action_space.shape[0]), k)) for k in (0, 1)
    )
    file = uvms_gym.export_policy(policy, tmp_path / "policy.c", env)
    assert check_contract(file, env, controller=policy) == json.loads(file.read_text())
    # A classical controller may run in place of the policy.
    check_contract(file, env, controller=uvms_gym.PID(env))
    broken = json.loads(file.read_text())
    broken |= {"task": "dock", "control_period": 0.2, "delay": [2, 2], "thruster_lag": 0.4, "further_delay": 3}
    broken["scene"]["numbers"]["vehicle.body.mass"] *= 2.0
    broken["observation"][0]["unit"] = "ft"
    broken["disturbance"]["noise"]["position"] = 0.1
    broken["options"]["start_distance"] = 1.5
    file.write_text(json.dumps(broken))
    with pytest.raises(ValueError) as caught:
        check_contract(file, env, controller=other)
    line = str(caught.value)
    assert line.startswith(f"{file}: the environment differs from the contract: ") and "\n" not in line
    for words in (
        "task is UVMS-StationKeep instead of dock",
        "control_period is 0.1 instead of 0.2 (-50 %)",
        "delay is 1 instead of 2 control periods",
        "thruster_lag is 0.1 s instead of 0.4 s",
        "vehicle.body.mass is 13.5 instead of 27 (-50 %)",
        "unit of observation position_error[0] is m instead of ft",
        "noise.position is 0.005 instead of 0.1 (-95 %)",
        "start_distance is 0.05 instead of 1.5",
        "further_delay is 0 instead of 3",
        "the policy has the digest ",
    ):
        assert words in line, words
    assert line.count(";") == 9


def test_the_digest_is_of_the_numbers_of_the_scene() -> None:
    digest = policy_contract(made())["scene"]["digest"]
    assert (
        policy_contract(made(scene=altered(lambda scene: scene.update(summary="other"))))["scene"]["digest"] == digest
    )
    painted = altered(lambda scene: scene["vehicle"].update(shape={"kind": "box", "size": [1.0, 1.0, 1.0]}))
    assert policy_contract(made(scene=painted))["scene"]["digest"] == digest
    assert policy_contract(made(scene=altered(heavier)))["scene"]["digest"] != digest


def trained(file: Path, **notes: str) -> str:
    contract = json.dumps(policy_contract(made()))
    policy = MLP(made(), notes={"environment": STORM, "contract": contract, **notes}, **layers((24, 6)))
    policy.save(file)
    return f"mlp:{file}"


def said(name: str, env: Any) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make_controller(name, env)
    return [str(one.message) for one in caught if issubclass(one.category, ControllerWarning)]


def test_a_policy_file_warns_once_of_all_that_differs(tmp_path: Path) -> None:
    name = trained(tmp_path / "policy.safetensors")
    assert said(name, made()) == []
    (line,) = said(name, made(scene=altered(heavier), thruster_lag=0.2, start_distance=0.1))
    assert line == (
        f"{name} was trained in {STORM}; here vehicle.body.mass is 14.85 instead of 13.5 (+10 %); "
        "thruster_lag is 0.2 s instead of 0.1 s; start_distance is 0.1 instead of 0.05 (+100 %): it may be unstable"
    )


def test_a_policy_is_not_warned_of_less_than_its_training(tmp_path: Path) -> None:
    name = trained(
        tmp_path / "policy.safetensors", contract=json.dumps(policy_contract(made(disturbance="storm-wide")))
    )
    assert said(name, made()) == []
    narrow = trained(tmp_path / "narrow.safetensors")
    (line,) = said(narrow, made(disturbance="storm-wide"))
    assert "delay is 0 to 3 instead of 1 control periods" in line


def test_a_policy_with_other_scales_is_refused(tmp_path: Path) -> None:
    name = trained(tmp_path / "policy.safetensors")
    with pytest.raises(
        ValueError, match=r"the policy does not fit: scale of action surge is .* \(\+25 %\), and \d+ more"
    ):
        make_controller(name, made(scene=altered(stronger)))


def test_a_shipped_policy_warns_of_an_altered_scene() -> None:
    scene = load_scene("petasus-pum")
    scene["vehicle"]["body"]["damping"]["linear"] = (
        1.5 * np.array(scene["vehicle"]["body"]["damping"]["linear"])
    ).tolist()
    (line,) = said("ppo", gymnasium.make(STORM, scene=scene))
    assert "vehicle.body.damping.linear" in line and "(+50 %), and 5 more numbers of the scene" in line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "no JSON"),
        ("[]", "its form is None, but must be 'uvms-contract/1'"),
        ('{"form": "other"}', "'other'"),
        ('{"form": "uvms-contract/1", "scene": 1}', "no contract of uvms_gym: a part has another form"),
        ('{"form": "uvms-contract/1", "scene": {}}', "no contract of uvms_gym: 'name' is missing"),
    ],
)
def test_a_file_without_a_contract_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "contract.json"
    file.write_text(text)
    with pytest.raises(ValueError) as caught:
        uvms_gym.check_contract(file, made())
    assert str(caught.value).startswith(f"{file}: ") and words in str(caught.value) and "\n" not in str(caught.value)
