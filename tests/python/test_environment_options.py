"""Options of environments on the command line: policies are played and compared with those of their training."""

import json
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import typer
from helpers import SMALL, layers, same

import uvms_gym
from uvms_gym import MLP
from uvms_gym.cli import main
from uvms_gym.cli.app import app
from uvms_gym.cli.environments import environment_arguments
from uvms_gym.studies.comparison.conditions import make_conditions
from uvms_gym.studies.comparison.own import make_controller
from uvms_gym.studies.comparison.scoreboard import ENVS, RULE, read_entries
from uvms_gym.studies.comparison.verification import verify
from uvms_gym.training.hyperparameters import give_way

ENV = "UVMS-StationKeep-v0"
#: An environment of one's own, and the flags that make it.
OWN: dict[str, Any] = {"scene": SMALL, "substeps": 10, "disturbance": "storm", "dtype": "float32"}
FLAGS = ["--env", ENV, *(word for key, value in OWN.items() for word in ("--env-kwargs", f"{key}:{value}"))]
PYTHON = """
import uvms_gym

class Own:
    def __init__(self, env):
        self.pid = uvms_gym.make_controller("pid", env)

    def predict(self, observation, state, episode_start, deterministic):
        assert observation.ndim == 2 and episode_start.shape == (len(observation),)
        return self.pid.predict(observation, state, episode_start)
"""


@pytest.fixture
def trained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_pictures: None) -> str:
    """A policy of that environment, and a controller in Python, in the working folder."""
    monkeypatch.chdir(tmp_path)
    notes = {"environment": ENV, "env_kwargs": json.dumps(OWN)}
    MLP(scene=SMALL, substeps=10, notes=notes, **layers((24, 6))).save(tmp_path / "policy.safetensors")
    (tmp_path / "own.py").write_text(PYTHON)
    return "mlp:policy.safetensors"


def test_what_was_trained_is_played_compared_and_verified_with_one_set_of_flags(
    trained: str,
) -> None:
    controllers = (trained, "py:own.py:Own", "pid")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in controllers[:2]:
            assert main(["play", *FLAGS, "--controller", name, "--seconds", "0.2", "--plot", "x.png"]) == 0
        given = [word for name in controllers for word in ("--controller", name)]
        given += ["--env-kwargs", "reward:{'effort': 0.3}"]
        assert main(["compare", *FLAGS, *given, "--episodes", "4", "--out", "c"]) == 0
    data = json.loads(Path("c/compare.json").read_text())
    (result,) = data["results"]
    assert {key: result["options"][key] for key in ("substeps", "disturbance", "dtype")} | {
        "scene": result["scene"]
    } == OWN
    own, pid = (result["controllers"][name]["kept"]["pose"] for name in ("py:own.py:Own", "pid"))
    np.testing.assert_allclose(own, pid, rtol=1e-9)
    assert verify(Path("c/compare.json"), run_code=True).differences == []
    # An easier environment is no entry of the scoreboard.
    result |= RULE | {"env": ENVS[0], "controllers": {"pid": {"episodes": RULE["episodes"]}}}
    Path("c/compare.json").write_text(json.dumps(data))
    with pytest.raises(ValueError, match=r"env_kwargs is \{'substeps': 10"):
        read_entries(Path("c/compare.json"))


def test_a_controller_in_python_plays_as_the_native_one_that_it_wraps(trained: str) -> None:
    def actions(name: str) -> list[Any]:
        env = gymnasium.make(ENV, **OWN)
        controller, state, found = make_controller(name, env), None, []
        observation, _ = env.reset(seed=4)
        for _ in range(30):
            action, state = controller.predict(observation, state)
            found.append(action)
            observation, *_ = env.step(action)
        return found

    assert same(actions("py:own.py:Own"), actions("pid"))


def test_every_command_with_environments_shares_one_declaration() -> None:
    options = {
        name: next(one for one in command.params if "--env-kwargs" in one.opts)
        for name, command in typer.main.get_command(app).commands.items()  # type: ignore[attr-defined]
        if name in ("train", "play", "compare", "accuracy")
    }
    assert len(options) == 4
    assert len({(one.help, one.metavar) for one in options.values()}) == 1


def test_options_of_their_own_and_pairs_are_put_together() -> None:
    given = environment_arguments(["substeps:5", "reward:{'effort': 0.4}"], scene="rexrov", disturbance=None, dt=[])
    assert given == {"substeps": 5, "reward": {"effort": 0.4}, "scene": "rexrov"}
    components = {"disturbance": {"base": "storm", "delay": {"periods": 3}}, "max_episode_steps": 7}
    (condition,) = make_conditions([ENV], {SMALL: SMALL}, **components)
    assert condition.options["disturbance"] == components["disturbance"] and condition.steps == 7


def test_the_control_period_of_a_training_is_the_one_that_its_flags_have_elsewhere() -> None:
    shipped = {"n_envs": 8, "env_kwargs": {"dtype": "float32", "dt": 0.025, "substeps": 2}}
    assert give_way(shipped, {"scene": SMALL}) == shipped
    for flags in ({"substeps": 10}, {"dt": 0.02}):
        assert give_way(shipped, flags) == {"n_envs": 8, "env_kwargs": {"dtype": "float32"}}
    assert give_way({}, {"dt": 0.02}) == {"env_kwargs": {}}
    # The scene states a step, which divides the period of 5 default steps.
    assert give_way(shipped, {}, 0.01)["env_kwargs"] == {"dtype": "float32", "substeps": 5}
    assert give_way({}, {}, 0.01) == {"env_kwargs": {}}


@pytest.mark.learning
def test_a_policy_is_played_and_compared_with_the_flags_of_its_training(trained: str) -> None:
    given = [*FLAGS, *"--algo distill --teacher pid -n 100 -params n_envs:2 -params n_steps:20".split()]
    assert main(["train", *given, "--eval-episodes", "2", "--export", "learned.safetensors", "--verbose", "0"]) == 0
    assert main(["play", *FLAGS, "--controller", "mlp:learned.safetensors", "--seconds", "0.2", "--plot", "x.png"]) == 0
    contract = json.loads(MLP.load("learned.safetensors").notes["contract"])
    uvms_gym.check_contract(contract, gymnasium.make(ENV, **OWN))
    with pytest.raises(ValueError, match="disturbance"):
        uvms_gym.check_contract(contract, gymnasium.make(ENV, **OWN | {"disturbance": "waves"}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, None),
        ({"dtype": "float64", "disturbance": "waves"}, "delay is 0 instead of 1 control periods"),
        ({"thruster_lag": 0.1}, "thruster_lag is 0.1 s instead of as in the scene: it may be unstable"),
    ],
)
def test_a_policy_is_warned_of_what_it_was_not_trained_with(
    trained: str, changes: dict[str, Any], message: str | None
) -> None:
    env = gymnasium.make(ENV, **OWN | changes)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        uvms_gym.make_controller(trained, env)
    said = [str(one.message) for one in caught if issubclass(one.category, uvms_gym.ControllerWarning)]
    assert len(said) == (message is not None) and (message is None or message in said[0])


def test_a_certificate_is_of_an_environment_with_arguments_of_its_own(tmp_path: Path) -> None:
    given = ["--env", ENV, "--env-kwargs", f"scene:{SMALL}", "--env-kwargs", "dt:0.025", "--env-kwargs", "substeps:4"]
    given += ["--env-kwargs", "max_episode_steps:4", "--dtype", "float64"]
    assert main(["accuracy", *given, "--episodes", "2", "--out", str(tmp_path)]) == 0
    (found,) = json.loads((tmp_path / "certificate.json").read_text())["results"].values()
    assert [row["step"] for row in found["rows"]] == [0.025]
