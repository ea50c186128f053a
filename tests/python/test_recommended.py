"""Recommended training: recipes, prices by a controller's effort, stages, stops."""

import importlib
import signal
from pathlib import Path
from typing import Any

import gymnasium
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("yaml")

import yaml

from uvms_gym import MLP, Rollout, make_controller
from uvms_gym.cli import main
from uvms_gym.studies.records import read_json
from uvms_gym.training import native
from uvms_gym.training.export import weights_hash
from uvms_gym.training.finished import is_finished
from uvms_gym.training.hyperparameters import SHIPPED
from uvms_gym.training.recommended import EPISODES, check, priced, read_recipe, rescaled, summary
from uvms_gym.training.run import POLICY, SEED_STRIDE, Settings

pytestmark = pytest.mark.learning

ENV = "UVMS-StationKeep-Storm-v0"
ROOT = Path(__file__).parents[2]
#: Stages of two iterations each.
COMMON = {"n_timesteps": 192, "n_envs": 8, "n_steps": 12, "frame_stack": 2, "net_arch": [8], "batch_size": 6}
RECIPE = {
    "why": "It is short.",
    "distill": {"teacher": "pd", "n_updates": 4, **COMMON},
    "shac": {
        "critic_arch": [8],
        "horizon": 4,
        "prices": {"reference": "pd", "effort": 0.2, "action_rate": 0.1},
        **COMMON,
    },
}


@pytest.fixture
def command(tmp_path: Path) -> list[str]:
    file = tmp_path / "recipes.yml"
    file.write_text(yaml.safe_dump({ENV: RECIPE}))
    short = ["--env-kwargs", "max_episode_steps:12", "--eval-episodes", "4"]
    return ["train", "--conf-file", str(file), "-f", str(tmp_path), "--seed", "3", *short]


@pytest.mark.parametrize("env", [env for env in gymnasium.registry if env.startswith("UVMS-")])
def test_every_environment_has_a_recipe_that_makes_learners(env: str) -> None:
    recipe = read_recipe(env)
    small = {algo: stage | {"n_envs": 8} for algo, stage in recipe["stages"].items()}
    check(Settings(env, {**recipe, "stages": small}, algo="recommended"))
    assert len(recipe["why"].splitlines()) == 1
    # The next stage could not begin with another network.
    assert len({str((stage["frame_stack"], stage["net_arch"])) for stage in recipe["stages"].values()}) == 1


def test_scenes_with_an_entry_exist() -> None:
    names = [name.partition("/")[2] for name in yaml.safe_load(SHIPPED.with_name("recommended.yml").read_text())]
    for scene in filter(None, names):
        gymnasium.make(ENV, scene=scene)


def test_steps_are_shared_among_stages() -> None:
    recipe = rescaled(read_recipe(ENV), 4000)
    assert sum(stage["n_timesteps"] for stage in recipe["stages"].values()) == 4000
    assert summary(recipe) == "distill mpc for 1e+03 steps, then shac for 3e+03 steps"


@pytest.mark.parametrize("scene", ["petasus-pum", "bluerov2-heavy"])
def test_prices_make_costs_that_are_shares_of_the_error_cost(scene: str) -> None:
    options: dict[str, Any] = {"scene": scene}
    weights = priced(ENV, options, reference="mpc", effort=0.2, action_rate=0.05)
    none = dict.fromkeys(weights, 0.0) | {"pose_scale": weights["pose_scale"]}
    costs = {}
    for name in ("pose", "effort", "action_rate"):
        envs = gymnasium.make_vec(ENV, num_envs=EPISODES, reward=none | {name: weights[name]}, **options)
        rollout = Rollout(envs, make_controller("mpc", envs))
        envs.reset(seed=SEED_STRIDE)
        rollout.run(200)
        costs[name] = -float(rollout.pop_stats().returns.mean())
    # Weights have two digits.
    assert costs["effort"] / costs["pose"] == pytest.approx(0.2, rel=0.05)
    assert costs["action_rate"] / costs["pose"] == pytest.approx(0.05, rel=0.05)


def test_a_run_stopped_in_any_stage_ends_as_if_it_had_not(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, "--export", str(tmp_path / "whole.safetensors")]) == 0
    folder = tmp_path / "recommended" / f"{ENV}_1"
    text = capsys.readouterr().out
    assert "distill pd for 192 steps, then shac for 192 steps. It is short." in text
    assert f"weights: sha256 {weights_hash(folder / POLICY)}" in text
    assert [path.name for path in sorted(folder.iterdir()) if path.is_dir()] == ["1-distill", "2-shac"]
    policy = MLP.load(folder / POLICY)
    assert (tmp_path / "whole.safetensors").read_bytes() == (folder / "2-shac" / POLICY).read_bytes()
    assert policy.notes["recipe"] == "distill pd for 192 steps, then shac for 192 steps"
    assert main(["train", "-i", str(folder)]) == 2
    assert "the run has taken its 384 steps" in capsys.readouterr().err

    parts = tmp_path / "recommended" / f"{ENV}_2"
    for i, algo in enumerate(("distill", "shac")):
        iterate = native.LEARNERS[algo].iterate

        def interrupted(learner: Any, iterate: Any = iterate) -> None:
            iterate(learner)
            signal.raise_signal(signal.SIGTERM)

        with monkeypatch.context() as patch:
            patch.setattr(native.LEARNERS[algo], "iterate", interrupted)
            assert main(["train", "-i", str(parts)] if i else command) == 130
        assert f"to resume: uvms train -i {parts}" in capsys.readouterr().out
        assert not is_finished(parts / POLICY)
    assert main(["train", "-i", str(parts)]) == 0
    assert weights_hash(parts / POLICY) == weights_hash(folder / POLICY)
    assert "sha256" in capsys.readouterr().out


def test_a_stop_between_two_stages_is_a_stop(command: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    save = MLP.save

    def interrupted(*arguments: Any) -> None:
        save(*arguments)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(MLP, "save", interrupted)
    assert main(command) == 130


def test_weights_depend_on_the_seed_only(command: list[str], tmp_path: Path) -> None:
    hashes = []
    for i, more in enumerate((["--seed", "3"], ["--seed", "3", "--num-threads", "2"], ["--seed", "4"]), 1):
        assert main([*command, *more]) == 0
        hashes.append(weights_hash(tmp_path / "recommended" / f"{ENV}_{i}" / POLICY))
    assert hashes[0] == hashes[1] != hashes[2]


def test_the_table_of_the_recipes_is_that_of_their_results(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "training")
    results = read_json(ROOT / "docs/_static/defaults.json")["results"]
    assert importlib.import_module("defaults").table(results) in (ROOT / "docs/training.md").read_text()
