"""Training: settings, wrappers, one run from start to export, and its continuation."""

import json
import signal
import threading
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("yaml")

import torch
import yaml
from helpers import same
from stable_baselines3 import PPO

from uvms_gym import MLP, PD, PID, Residual
from uvms_gym.cli import main
from uvms_gym.controllers import NoControl
from uvms_gym.sb3 import make_vec_env
from uvms_gym.training.evaluation import evaluate
from uvms_gym.training.export import TOLERANCE, card, policy_of, write_card
from uvms_gym.training.hyperparameters import SHIPPED, arguments, parse_pairs, read_hyperparameters
from uvms_gym.training.ppo import load, make_envs, make_model, train
from uvms_gym.training.run import CURVE, POLICY, SETTINGS, Settings, latest_checkpoint
from uvms_gym.training.wrappers import ResidualVecEnv, StaggeredStart

pytestmark = pytest.mark.learning

ENV = "UVMS-StationKeep-Storm-v0"
#: Five seconds of station keeping in a current.
EASY = {"disturbance": "current", "max_episode_steps": 50, "reward": {"action_rate": 0.1}}
TINY = {"n_timesteps": 4 * 64, "n_envs": 8, "n_steps": 8, "batch_size": 32, "n_epochs": 2, "frame_stack": 1}


def settings(**options: Any) -> Settings:
    more = options.pop("hyperparameters", {})
    return Settings(
        ENV,
        read_hyperparameters(ENV, variant="residual" if options.get("base") else None) | TINY | more,
        {"max_episode_steps": 12, "disturbance": "current"},
        **{"eval_episodes": 4, "seed": 3} | options,
    )


def weights(path: Path) -> dict[str, np.ndarray]:
    return {name: x.numpy() for name, x in PPO.load(path, device="cpu").policy.state_dict().items()}


@pytest.mark.parametrize("env", [env for env in gymnasium.registry if env.startswith("UVMS-")])
@pytest.mark.parametrize("residual", [False, True])
def test_every_environment_has_hyperparameters_that_make_a_model(env: str, residual: bool) -> None:
    found = read_hyperparameters(env, variant="residual" if residual else None)
    small = Settings(env, found | {"n_envs": 16, "batch_size": 64})
    assert small.steps >= 1_000_000
    venv, _, base = make_envs(small)
    model = make_model(small, venv)
    assert base is None
    assert model.learning_rate(0.5) == pytest.approx(0.5 * model.learning_rate(1.0))
    assert bool((model.policy.log_std == (-1.8 if residual else -1.0)).all())
    # What rl_zoo3 hands to the algorithm as it is must be known to it.
    assert set(found) - {"n_timesteps", "n_envs", "env_kwargs", "frame_stack"} <= set(PPO.__init__.__annotations__)


def test_hyperparameters_are_what_rl_zoo3_makes_of_them() -> None:
    given = {
        "learning_rate": "lin_1e-3",
        "clip_range": 0.2,
        "policy_kwargs": "dict(log_std_init=-1, net_arch=dict(pi=[8], vf=[4, 4]), activation_fn=nn.ReLU)",
    }
    made = arguments(given | {"n_envs": 4, "n_timesteps": 1e6, "policy": "MlpPolicy", "env_kwargs": {}})
    assert made.keys() == given.keys()
    assert (made["learning_rate"](1.0), made["learning_rate"](0.0)) == (1e-3, 0.0)
    nets = {"pi": [8], "vf": [4, 4]}
    assert made["policy_kwargs"] == {"log_std_init": -1, "net_arch": nets, "activation_fn": torch.nn.ReLU}
    for key, text in (("policy_kwargs", "__import__('os')"), ("policy_kwargs", "nn.init"), ("clip_range", "fast")):
        with pytest.raises(ValueError, match=key):
            arguments({key: text})


def test_pairs_are_literals_or_strings() -> None:
    pairs = parse_pairs(["substeps:5", "reward:{'effort': 0.4}", "scene:petasus-pum", "file:a:b"])
    assert pairs == {"substeps": 5, "reward": {"effort": 0.4}, "scene": "petasus-pum", "file": "a:b"}


def test_the_yaml_is_plain() -> None:
    tables = yaml.safe_load(SHIPPED.read_text())
    assert set(tables) == {f"{env}{part}" for env in gymnasium.registry if "UVMS-" in env for part in ("", "/residual")}


def test_staggered_episodes_end_at_different_times() -> None:
    venv = StaggeredStart(make_vec_env(ENV, 16, 0, max_episode_steps=16), 16, groups=4)
    observations = venv.reset()
    assert observations.shape == (16, 44)
    still = np.zeros((16, 6), dtype=np.float32)
    ends = np.array([venv.step(still)[2] for _ in range(16)])
    assert (ends.sum(axis=0) == 1).all()
    assert sorted(set(ends.argmax(axis=0))) == [3, 7, 11, 15]
    first, again = (StaggeredStart(make_vec_env(ENV, 16, 5, max_episode_steps=16), 16) for _ in range(2))
    assert same(first.reset(), again.reset())


@pytest.mark.parametrize("kind", [PD, PID])
def test_zero_corrections_are_the_controller(kind: type[PD] | type[PID]) -> None:
    one, other = (make_vec_env(ENV, 3, 1, max_episode_steps=7) for _ in range(2))
    base = kind(one)
    corrected = ResidualVecEnv(one, base, 0.3)
    extended, plain = corrected.reset(), other.reset()
    state, starts = None, np.ones(3, dtype=bool)
    for step in range(20):
        actions, before = base.predict(plain, state, starts)
        assert same(extended, np.hstack([plain, actions]))
        assert corrected.observation_space.contains(extended[0])
        extended, rewards, dones, infos = corrected.step(np.zeros((3, 6)))
        plain, expected, starts, wanted = other.step(actions)
        assert same((rewards, dones), (expected, starts))
        state = before
        for i in np.flatnonzero(dones):
            final = wanted[i]["terminal_observation"]
            memory = None if state is None else state[i]
            assert same(infos[i]["terminal_observation"], np.concatenate([final, base.predict(final, memory)[0]]))
        assert dones.all() == (step % 7 == 6)


def test_corrections_are_limited() -> None:
    one, other = (make_vec_env(ENV, 2, 1) for _ in range(2))
    corrected = ResidualVecEnv(one, NoControl(one), 0.25)
    corrected.reset()
    other.reset()
    for action in (0.4, -7.0):
        clipped = 0.25 * np.clip(action, -1.0, 1.0)
        got = corrected.step(np.full((2, 6), action))
        assert same(got[0][:, :-6], other.step(np.full((2, 6), clipped, dtype=np.float32))[0])
    with pytest.raises(ValueError, match=r"limit is 1\.5"):
        ResidualVecEnv(one, NoControl(one), 1.5)


def test_learning_beats_doing_nothing(tmp_path: Path) -> None:
    quick = {"n_timesteps": 61_440, "n_envs": 128, "n_steps": 16, "batch_size": 512, "n_epochs": 8}
    found = read_hyperparameters(ENV) | quick | {"learning_rate": "lin_0.002", "gamma": 0.9, "frame_stack": 1}
    outcome = train(Settings(ENV, found, EASY, eval_episodes=128), tmp_path)
    env = gymnasium.make(ENV, **EASY)
    for seed in (0, 10_000):
        learned, nothing = (
            evaluate(ENV, EASY, controller, 128, seed) for controller in (MLP.load(outcome.policy, env), NoControl(env))
        )
        # Seen: 0.02 m against 0.3 m.
        assert learned["pose"] < 0.3 * nothing["pose"]
        assert learned["pose_95"] < 0.5 * nothing["pose_95"]
        assert learned["effort"] < 0.1


@pytest.mark.parametrize(("base", "stack"), [(None, 1), ("pid", 1), (None, 3), ("pid", 3)])
def test_a_run_that_was_stopped_ends_as_if_it_had_not(tmp_path: Path, base: str | None, stack: int) -> None:
    chosen = settings(eval_freq=64, save_freq=128, hyperparameters={"frame_stack": stack}, base=base)
    folders = [tmp_path / name for name in ("whole", "parts", "saved")]
    for folder in folders:
        folder.mkdir()
    whole, parts, saved = folders
    outcome = train(chosen, whole)
    assert outcome.finished and outcome.steps == 256
    assert [entry["steps"] for entry in json.loads((whole / CURVE).read_text())] == [0, 64, 128, 192, 256]
    stopped = train(chosen, parts, tick=lambda steps: signal.raise_signal(signal.SIGINT))
    assert (stopped.finished, stopped.steps, stopped.checkpoint.name) == (False, 64, "rl_model_64_steps.zip")
    assert MLP.load(stopped.policy, residual=base is not None).notes["steps"] == "64"
    assert Settings.load(parts) == chosen
    # What came after does not matter, as after a crash.
    again = train(chosen, parts, agent=latest_checkpoint(parts))
    assert again.finished and again.steps == 256 and again.seconds > stopped.seconds
    curves = [json.loads((folder / CURVE).read_text()) for folder in (whole, parts)]
    for one, other in zip(*curves, strict=True):
        assert {**one, "seconds": 0} == {**other, "seconds": 0}
    train(chosen, saved, agent=whole / "rl_model_128_steps.zip")
    first, *others = (weights(folder / f"{ENV}.zip") for folder in folders)
    assert all(same(first, other) for other in others)


def test_seeds_decide(tmp_path: Path) -> None:
    found = []
    for i, seed in enumerate((0, 0, 1)):
        (tmp_path / str(i)).mkdir()
        found.append(weights(train(settings(seed=seed), tmp_path / str(i)).checkpoint))
    assert same(*found[:2]) and not same(*found[1:])


def test_more_steps_go_on_from_the_end(tmp_path: Path) -> None:
    done = train(settings(), tmp_path)
    with pytest.raises(ValueError, match="has taken its 256 steps"):
        train(settings(), tmp_path, agent=done.checkpoint)
    more = train(settings(hyperparameters={"n_timesteps": 320}), tmp_path, agent=done.checkpoint)
    assert more.steps == 320


def test_other_files_are_no_checkpoints(tmp_path: Path) -> None:
    venv, _, _ = make_envs(settings())
    file = tmp_path / "model.zip"
    for write in (lambda: file.write_bytes(b"no"), lambda: make_model(settings(), venv).save(file)):
        write()
        with pytest.raises(ValueError, match="holds no training run"):
            load(file, venv)
    with pytest.raises(ValueError, match="has no checkpoint"):
        settings().save(tmp_path)
        latest_checkpoint(tmp_path)


def test_the_exported_policy_says_what_the_model_says(tmp_path: Path) -> None:
    outcome = train(settings(hyperparameters={"policy_kwargs": "dict(activation_fn=nn.ELU, net_arch=[16])"}), tmp_path)
    model = PPO.load(outcome.checkpoint, device="cpu")
    env = gymnasium.make(ENV)
    policy = MLP.load(outcome.policy, env)
    rows = np.random.default_rng(1).normal(size=(100, 44)).astype(np.float32)
    assert np.abs(policy.predict(rows)[0] - model.predict(rows, deterministic=True)[0]).max() <= TOLERANCE
    notes = policy.notes
    assert (notes["environment"], notes["seed"], notes["steps"]) == (ENV, "3", "256")
    assert json.loads(notes["versions"])["stable-baselines3"]
    found = json.loads(notes["evaluation"])
    kwargs = settings().kwargs
    assert evaluate(ENV, kwargs, policy, 4) == {key: found[key] for key in evaluate(ENV, kwargs, policy, 4)}
    text = (tmp_path / "README.md").read_text()
    assert text == card(tmp_path)
    assert "UVMS-StationKeep on petasus-pum, every 0.1 s" in text
    assert "| `policy.safetensors` | from scratch | 3 | 256 |" in text
    # A card by another hand stays.
    (tmp_path / "README.md").write_text("mine")
    write_card(tmp_path)
    assert (tmp_path / "README.md").read_text() == "mine"


@pytest.mark.parametrize(("base", "stack"), [("pid", 1), (None, 3), ("pid", 3)])
def test_the_closed_loop_is_what_was_trained(base: str | None, stack: int) -> None:
    chosen = settings(hyperparameters={"frame_stack": stack, "n_envs": 4}, base=base)
    venv, envs, corrected = make_envs(chosen)
    model = make_model(chosen, venv)
    with torch.no_grad():
        # So that it says something.
        model.policy.action_net.weight.mul_(100.0)
    policy = policy_of(model, envs, residual=corrected is not None, history=stack)
    control = policy if corrected is None else Residual(corrected, policy, chosen.limit)
    other = make_vec_env(ENV, 4, 11, **chosen.kwargs)
    plain = other.reset()
    layers = venv
    while not isinstance(layers, StaggeredStart):
        layers = layers.venv
    # Episodes start together here.
    layers.reset = layers.venv.reset
    venv.seed(11)
    observations = venv.reset()
    state, starts = None, np.ones(4, dtype=bool)
    for _ in range(30):
        actions, state = control.predict(plain, state, starts)
        plain, rewards, starts, _ = other.step(actions)
        observations, expected, dones, _ = venv.step(model.predict(observations, deterministic=True)[0])
        np.testing.assert_allclose(rewards, expected, rtol=1e-4, atol=1e-5)
        assert same(starts, dones)


def test_models_that_cannot_be_exported_are_refused() -> None:
    odd = settings(hyperparameters={"policy_kwargs": "dict(activation_fn=nn.SiLU)"})
    venv, envs, _ = make_envs(odd)
    with pytest.raises(ValueError, match="tanh, relu, elu"):
        policy_of(make_model(odd, venv), envs)


def test_an_unfaithful_export_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    venv, envs, _ = make_envs(settings())
    model = make_model(settings(), venv)
    monkeypatch.setattr(model, "predict", lambda rows, deterministic: (np.full((len(rows), 6), 0.5), None))
    with pytest.raises(RuntimeError, match="differs from the model"):
        policy_of(model, envs)


def uvms_train(*arguments: str) -> list[str]:
    small = [f"{key}:{value}" for key, value in TINY.items() if key not in ("n_timesteps", "n_envs")]
    pairs = [part for pair in small for part in ("-params", pair)]
    common = ["--n-envs", "8", "--eval-episodes", "4", "--env-kwargs", "max_episode_steps:12"]
    return ["train", "--algo", "ppo", *common, *pairs, *arguments]


def test_the_command_trains_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs, policy = tmp_path / "logs", tmp_path / "policies/ppo-7.safetensors"
    options = ["-f", str(logs), "--seed", "7", "--export", str(policy), "-tb", str(tmp_path / "tb")]
    assert main(uvms_train("-n", "128", *options)) == 0
    folder = logs / "ppo" / f"{ENV}_1"
    assert policy.read_bytes() == (folder / POLICY).read_bytes()
    assert (policy.parent / "README.md").is_file()
    assert list((tmp_path / "tb").rglob("events*"))
    assert json.loads((folder / SETTINGS).read_text())["seed"] == 7
    text = capsys.readouterr().out
    assert "128 steps" in text and "pose" in text
    assert main(["train", "-i", str(folder), "-n", "192"]) == 0
    assert MLP.load(folder / POLICY).notes["steps"] == "192"
    # A second run has a folder of its own.
    assert main(uvms_train("-n", "64", "-f", str(logs), "--base", "pd", "--residual", "0.2", "--verbose", "0")) == 0
    assert MLP.load(logs / "ppo-pd" / f"{ENV}_1" / POLICY, residual=True).notes["limit"] == "0.2"


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("uvms_gym.cli.train.NEEDS", {"no_such_module": "some-package"})
    assert main(["train"]) == 2
    assert capsys.readouterr().err == "uvms: some-package not installed; run: pip install 'uvms-gym[train]'\n"


def test_an_interrupt_saves_and_exports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "ppo" / f"{ENV}_1"

    def interrupt() -> None:
        limit = time.monotonic() + 60
        while not (folder / CURVE).exists() and time.monotonic() < limit:
            time.sleep(0.05)
        signal.raise_signal(signal.SIGINT)

    threading.Thread(target=interrupt).start()
    assert main(uvms_train("-n", "100_000_000", "--eval-freq", "64", "-f", str(tmp_path))) == 130
    assert "to resume: uvms train -i" in capsys.readouterr().out
    steps = int(MLP.load(folder / POLICY).notes["steps"])
    assert latest_checkpoint(folder).name == f"rl_model_{steps}_steps.zip"
    assert not list(folder.glob(".*"))
