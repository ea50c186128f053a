"""Learners of this package: pairs of environments, learning, stops, export, refusals."""

import json
import signal
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("yaml")

import torch
import yaml

from uvms_gym import MLP
from uvms_gym.cli import main
from uvms_gym.controllers.families import TEACHERS
from uvms_gym.controllers.registry import make_controller
from uvms_gym.training.asymmetric_ppo import AsymmetricPPO
from uvms_gym.training.distillation import Distillation
from uvms_gym.training.episodes import TrainingEnvs
from uvms_gym.training.evaluation import evaluate
from uvms_gym.training.export import TOLERANCE
from uvms_gym.training.hyperparameters import SHIPPED, read_hyperparameters
from uvms_gym.training.native import LEARNERS, load, make_learner, save, train
from uvms_gym.training.networks import Actor, Tanh
from uvms_gym.training.run import CURVE, POLICY, Settings, latest_checkpoint

pytestmark = pytest.mark.learning

ENV, TRACK = "UVMS-StationKeep-Storm-v0", "UVMS-EETrack-Storm-v0"
ALGORITHMS = sorted(LEARNERS)
TINY = {"n_envs": 8, "n_timesteps": 4 * 8 * 12, "frame_stack": 2, "net_arch": [8], "batch_size": 32}
MORE = {
    "distill": {"n_updates": 4},
    "asymmetric-ppo": {"replicas": 4, "critic_arch": [8], "n_epochs": 2},
    "shac": {"critic_arch": [8], "horizon": 4, "n_steps": 12, "batch_size": 6},
}
#: Algorithms for all tasks; the others are for station keeping.
GENERAL = ("asymmetric-ppo", "distill")


def settings(algo: str, env: str = ENV, **options: Any) -> Settings:
    found = read_hyperparameters(env, algo=algo) | TINY | MORE[algo] | options.pop("hyperparameters", {})
    return Settings(env, found, {"max_episode_steps": 12}, algo=algo, **{"eval_episodes": 4, "seed": 3} | options)


def train_in(folder: Path, chosen: Settings, **options: Any) -> Any:
    """Outcome of a training in a folder of its own."""
    folder.mkdir(exist_ok=True)
    return train(chosen, folder, **options)


def weights(path: Path) -> bytes:
    data = path.read_bytes()
    return data[8 + int.from_bytes(data[:8], "little") :]


@pytest.mark.parametrize("algo", ALGORITHMS)
@pytest.mark.parametrize("env", [env for env in gymnasium.registry if env.startswith("UVMS-")])
def test_every_environment_has_hyperparameters_that_make_a_learner(algo: str, env: str) -> None:
    if algo not in GENERAL and ("Dock" in env or (algo, env) == ("asymmetric-ppo", "UVMS-EETrack-v0")):
        with pytest.raises(ValueError, match=f"no hyperparameters for {env}"):
            read_hyperparameters(env, algo=algo)
        return
    assert set(yaml.safe_load(SHIPPED.with_name(f"{algo}.yml").read_text())) >= {env}
    small = Settings(env, read_hyperparameters(env, algo=algo) | {"n_envs": 8}, algo=algo)
    make_learner(small).close()


def random(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


def idle(envs: TrainingEnvs, history: int) -> MLP:
    """Network whose actions are 0."""
    return MLP(
        weights=[np.zeros((envs.actions, history * envs.size))], biases=[np.zeros(envs.actions)], history=history
    )


@pytest.mark.parametrize("teacher_acts", [False, True])
def test_recorded_episodes_are_those_of_the_environment(teacher_acts: bool) -> None:
    options: dict[str, Any] = {"max_episode_steps": 10, "dtype": "float32"}
    envs, other = TrainingEnvs(ENV, options, 3, 2), TrainingEnvs(ENV, options, 3, 2)
    policy = MLP(weights=[0.3 * random(6, 2 * envs.size)], biases=[random(6)], history=2)
    teacher, noise = Distillation(settings("distill")).teacher, 0.1 * random(3, 12, 6)
    episodes = envs.run([5, 6, 7], policy, noise, teacher, teacher_acts=teacher_acts)
    seen, _ = other.env.reset(seed=[5, 6, 7])
    memories: list[Any] = [None, None]
    for t in range(10):
        np.testing.assert_array_equal(episodes.observations[:, t + 1], seen)
        np.testing.assert_array_equal(episodes.perfect[:, t], other.inner.perfect_observations())
        targets, memories[0] = teacher.predict(episodes.perfect[:, t], memories[0], np.full(3, t == 0))
        np.testing.assert_array_equal(episodes.targets[:, t], targets)
        actions, memories[1] = policy.predict(seen, memories[1], np.full(3, t == 0))
        acted = episodes.actions[:, t] - noise[:, t]
        np.testing.assert_allclose(targets if teacher_acts else actions, acted.clamp(-1.0, 1.0), atol=1e-6)
        seen, rewards, _, _, _ = other.env.step(episodes.actions[:, t].numpy())
        np.testing.assert_array_equal(episodes.rewards[:, t], rewards.astype(np.float32))
    np.testing.assert_array_equal(episodes.perfect[:, 10], other.inner.perfect_observations())
    # The mean is not clipped.
    assert teacher_acts or (episodes.actions.abs() > 1.2).any()
    assert episodes.alive[:, :10].all() and not episodes.alive[:, 10:].any() and not episodes.terminated.any()


def test_recorded_episodes_end_where_the_task_ends_them() -> None:
    envs = TrainingEnvs("UVMS-StationKeep-v0", {"max_episode_steps": 1000}, 2, 1)
    ahead = MLP(weights=[np.zeros((envs.actions, envs.size))], biases=[np.eye(envs.actions)[0]])
    noise = torch.zeros(2, 600, envs.actions)
    # The second stays.
    noise[1, :, 0] = -1.0
    episodes = envs.run([0, 1], ahead, noise)
    (instance,), (end,) = episodes.terminated.nonzero(as_tuple=True)
    assert instance == 0 and episodes.alive[1].all()
    assert episodes.alive[0, : end + 1].all() and not episodes.alive[0, end + 1 :].any()


def test_bad_recordings_are_refused() -> None:
    envs = TrainingEnvs(ENV, {}, 2, 1)
    network = idle(envs, 1)
    noise = torch.zeros(2, 4, 6)
    for shape in ((3, 4, 6), (2, 6, 4)):
        with pytest.raises(ValueError, match=r"noise has shape .*, but must have \(2, T, 6\)"):
            envs.run([0, 1], network, torch.zeros(shape))
    noise[1, 2, 3] = torch.nan
    with pytest.raises(ValueError, match="action 3 of instance 1 is NaN"):
        envs.run([0, 1], network, noise)
    with pytest.raises(ValueError, match="gives 7 action entries, but the environment has 44 and 6"):
        envs.run([0, 1], MLP(weights=[np.zeros((7, envs.size))], biases=[np.zeros(7)]), torch.zeros(2, 4, 6))


def test_perfect_observations_are_those_of_an_environment_without_noise_and_delay() -> None:
    envs = TrainingEnvs(ENV, {"max_episode_steps": 20}, 4, 3)
    noise = 0.3 * random(4, 20, 6)
    episodes = envs.run([5, 6, 7, 8], idle(envs, 3), noise)
    options = {"disturbance": {"base": "storm", "noise": None, "delay": None}, "max_episode_steps": 20}
    perfect: Any = gymnasium.make_vec(ENV, num_envs=4, **options)
    places = {block.name: block.slice for block in envs.inner.layout}
    first = places["error_integral"].start
    seen, _ = perfect.reset(seed=[5, 6, 7, 8])
    for t in range(20):
        # The integral of errors is that of measured ones.
        np.testing.assert_array_equal(episodes.perfect[:, t, :first].numpy(), seen[:, :first])
        seen = perfect.step(noise[:, t].numpy())[0]
    np.testing.assert_array_equal(episodes.perfect[:, 20, :first].numpy(), seen[:, :first])
    assert first == envs.size - 6
    place = places["position_error"]
    rows = episodes.observations[:, 2:]
    assert (episodes.inputs[:, 0, : 2 * envs.size] == 0.0).all()
    assert torch.equal(episodes.inputs[:, 9].reshape(4, 3, -1), rows[:, 7:10])
    # The sensors of the environment itself have noise and delay.
    assert (rows[:, 5, place] != episodes.perfect[:, 5, place]).all()
    assert episodes.alive.all() and not episodes.terminated.any()


def test_stacked_observations_are_selected_by_instance_and_time() -> None:
    envs = TrainingEnvs(ENV, {"max_episode_steps": 8}, 3, 4)
    episodes = envs.run([0, 1, 2], idle(envs, 4), torch.zeros(3, 8, 6))
    i, t = torch.ones(3, 8).nonzero().T
    assert torch.equal(episodes.select(i, t), episodes.inputs.flatten(0, 1))


def test_hyperbolic_tangent_and_its_gradient() -> None:
    x = torch.linspace(-12.0, 12.0, 101, dtype=torch.float64, requires_grad=True)
    torch.testing.assert_close(Tanh()(x), torch.tanh(x), rtol=0.0, atol=1e-15)
    assert torch.autograd.gradcheck(Tanh(), x)


def test_episodes_of_one_seed_are_paired_with_opposite_noise() -> None:
    learner = AsymmetricPPO(settings("asymmetric-ppo"))
    episodes, _ = learner.collect(learner.actor, 0, 12)
    mean = learner.actor(episodes.inputs[:, 0])
    noise = (episodes.actions[:, 0] - mean).reshape(2, 2, 2, 6)
    assert torch.allclose(noise[:, :, 0], -noise[:, :, 1], atol=1e-6) and (noise != 0.0).all()
    first = episodes.perfect[:, 0].reshape(2, 4, -1)
    assert (first == first[:, :1]).all() and (first[0] != first[1]).any()


def test_the_collected_part_of_episodes_grows() -> None:
    learner = make_learner(settings("asymmetric-ppo", hyperparameters={"n_steps": 3}))
    steps = []
    while learner.left > 0.0:
        before = learner.steps
        learner.iterate()
        steps.append((learner.steps - before) // learner.num_envs)
    assert steps[0] == 3 and steps[-1] == 12 and steps == sorted(steps)


def test_distillation_lowers_the_regression_error() -> None:
    larger = {"n_envs": 32, "n_timesteps": 4 * 32 * 12, "n_updates": 150, "net_arch": [32], "batch_size": 128}
    learner = Distillation(settings("distill", hyperparameters={**larger, "learning_rate": 0.005}))

    def error() -> float:
        episodes, targets = learner.collect(learner.actor, 1000, 12)
        return float(((learner.actor(episodes.inputs) - targets) ** 2).detach().mean())

    before = error()
    for _ in range(4):
        learner.iterate()
    # Seen: a sixth.
    assert error() < 0.25 * before


def test_a_distilled_policy_is_nearly_its_teacher(tmp_path: Path) -> None:
    quick = {"n_envs": 32, "n_timesteps": 8 * 32 * 100, "n_updates": 60, "net_arch": [64], "batch_size": 256}
    found = read_hyperparameters(ENV, algo="distill") | quick
    kwargs = {"max_episode_steps": 100, "disturbance": "current"}
    outcome = train(Settings(ENV, found, kwargs, algo="distill", eval_episodes=64), tmp_path)
    env = gymnasium.make(ENV, **kwargs)
    teacher = evaluate(ENV, kwargs, make_controller("dob", env), 64)["pose"]
    nothing = evaluate(ENV, kwargs, make_controller("none", env), 64)["pose"]
    # Seen: 1.4 times the teacher's error, which is a fiftieth of that without control.
    assert outcome.evaluation["pose"] < teacher + 0.1 * (nothing - teacher)


def test_ppo_improves_a_policy(tmp_path: Path) -> None:
    quick = {"n_envs": 64, "n_timesteps": 10 * 64 * 30, "batch_size": 480, "n_epochs": 4}
    found = read_hyperparameters(ENV, algo="asymmetric-ppo") | quick | {"net_arch": [16], "frame_stack": 1}
    kwargs = {"max_episode_steps": 30, "disturbance": "current", "reward": {"action_rate": 0.0}}
    chosen = Settings(ENV, found, kwargs, algo="asymmetric-ppo", eval_freq=10 * 64 * 30, eval_episodes=64)
    train(chosen, tmp_path)
    first, last = json.loads((tmp_path / CURVE).read_text())
    assert last["pose"] < 0.7 * first["pose"]


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_a_run_that_was_stopped_ends_as_if_it_had_not(algo: str, tmp_path: Path) -> None:
    chosen = settings(algo, eval_freq=96, save_freq=192)
    whole, parts, saved = (tmp_path / name for name in ("whole", "parts", "saved"))
    outcome = train_in(whole, chosen)
    assert outcome.finished and outcome.steps == 384
    assert [entry["steps"] for entry in json.loads((whole / CURVE).read_text())] == [0, 96, 192, 288, 384]
    stopped = train_in(parts, chosen, tick=lambda steps: signal.raise_signal(signal.SIGINT))
    assert (stopped.finished, stopped.steps, stopped.checkpoint.name) == (False, 96, "rl_model_96_steps.zip")
    assert weights(stopped.policy) != weights(outcome.policy)
    again = train(chosen, parts, agent=latest_checkpoint(parts))
    assert again.finished and again.seconds > stopped.seconds
    curves = [json.loads((folder / CURVE).read_text()) for folder in (whole, parts)]
    for one, other in zip(*curves, strict=True):
        assert {**one, "seconds": 0} == {**other, "seconds": 0}
    train_in(saved, chosen, agent=whole / "rl_model_192_steps.zip")
    assert weights(whole / POLICY) == weights(parts / POLICY) == weights(saved / POLICY)
    with pytest.raises(ValueError, match="has taken its 384 steps"):
        train(chosen, whole, agent=outcome.checkpoint)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_seeds_decide(algo: str, tmp_path: Path) -> None:
    env = TRACK if algo in GENERAL else ENV
    runs = [train_in(tmp_path / str(i), settings(algo, env, seed=seed)) for i, seed in enumerate((0, 0, 1))]
    one, again, other = (weights(run.policy) for run in runs)
    assert one == again != other


def test_the_exported_policy_says_what_the_actor_says_and_starts_another_run(tmp_path: Path) -> None:
    distilled = settings("distill")
    outcome = train_in(tmp_path / "distilled", distilled)
    learner = make_learner(distilled)
    load(learner, outcome.checkpoint)
    episodes, _ = learner.collect(learner.actor, 7, 12)
    past, now = episodes.inputs[:, 5].split(learner.envs.size, dim=1)
    policy = MLP.load(outcome.policy, learner.envs.env)
    expected = learner.actor(episodes.inputs[:, 5]).detach().clamp(-1.0, 1.0).numpy()
    assert np.abs(policy.predict(now.numpy(), past.numpy())[0] - expected).max() <= TOLERANCE
    assert policy.notes["teacher"] == "dob"
    text = (tmp_path / "distilled" / "README.md").read_text()
    assert "# Distillation: UVMS-StationKeep on petasus-pum" in text and "from dob with perfect sensors" in text
    begun = AsymmetricPPO(settings("asymmetric-ppo", start=str(outcome.policy)))
    np.testing.assert_allclose(
        begun.actor(episodes.inputs).detach(), learner.actor(episodes.inputs).detach(), atol=2e-6
    )
    train_in(tmp_path / "improved", settings("asymmetric-ppo", start=str(outcome.policy)))
    assert MLP.load(tmp_path / "improved" / POLICY).notes["start"] == POLICY
    for wrong, message in (
        ({"net_arch": [9]}, "sizes"),
        ({"frame_stack": 1}, "frame_stack is 2, but must be at most 1"),
    ):
        with pytest.raises(ValueError, match=message):
            AsymmetricPPO(settings("asymmetric-ppo", start=str(outcome.policy), hyperparameters=wrong))


SPANS = (4, 2, 1, 1)


def test_averages_are_those_of_the_observations() -> None:
    envs = TrainingEnvs(ENV, {}, 1, sum(SPANS))
    torch.manual_seed(0)
    actor = Actor(SPANS, [envs.size, 8, 6])
    rows = random(5, sum(SPANS), envs.size)
    averages = torch.stack([part.mean(dim=1) for part in rows.split(SPANS, dim=1)], dim=1)
    plain = Actor((1,) * len(SPANS), [envs.size, 8, 6])
    plain.load_state_dict(actor.state_dict())
    torch.testing.assert_close(actor(rows.flatten(1)), plain(averages.flatten(1)))
    assert actor.policy(envs.inner).history == sum(SPANS)


def test_a_longer_memory_begins_with_the_actions_of_the_shorter_one() -> None:
    envs = TrainingEnvs(ENV, {}, 1, 2)
    short, long = Actor((1, 1), [envs.size, 8, 6]), Actor(SPANS, [envs.size, 8, 6])
    long.load(short.policy(envs.inner))
    rows = random(5, sum(SPANS), envs.size)
    torch.testing.assert_close(long(rows.flatten(1)), short(rows[:, -2:].flatten(1)))
    again = Actor(SPANS, [envs.size, 8, 6])
    again.load(long.policy(envs.inner))
    torch.testing.assert_close(again.linears[0].weight, long.linears[0].weight)


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_learners_take_averages(algo: str) -> None:
    chosen = settings(algo, hyperparameters={"frame_stack": list(SPANS)})
    assert (chosen.spans, chosen.history) == (SPANS, sum(SPANS))
    learner = make_learner(chosen)
    learner.iterate()
    learner.close()


@pytest.mark.parametrize("given", [[4, 0], [], [1.5], "8", True])
def test_a_stack_is_a_number_or_a_list_of_numbers(given: Any) -> None:
    with pytest.raises(ValueError, match=r"frame_stack is .*, but must be a positive whole number"):
        settings("shac", hyperparameters={"frame_stack": given}).spans  # noqa: B018


def test_an_unfaithful_export_is_noticed() -> None:
    envs = TrainingEnvs(ENV, {}, 1, 1)
    actor = Actor((1,), [envs.size, 8, 6])
    actor.policy(envs.inner)
    actor.forward = lambda inputs: torch.full((len(inputs), 6), 0.5)  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match="differs from the model"):
        actor.policy(envs.inner)


def test_other_files_are_no_checkpoints(tmp_path: Path) -> None:
    learners = [make_learner(settings(algo)) for algo in ALGORITHMS]
    file = tmp_path / "model.zip"
    for write in (lambda: file.write_bytes(b"no"), lambda: save(learners[0], 0.0, file)):
        write()
        with pytest.raises(ValueError, match="holds no training run"):
            load(learners[1], file)


def test_teachers_are_tuned_controllers_without_delay() -> None:
    for env in (ENV, TRACK):
        learner = Distillation(settings("distill", env))
        assert learner.teacher_name == TEACHERS[learner.envs.inner.task]
        assert not learner.teacher.gains["delay"]
        tuned = make_controller(learner.teacher_name, learner.envs.env).gains
        for name in tuned.keys() - {"delay"}:
            np.testing.assert_array_equal(learner.teacher.gains[name], tuned[name])


def test_a_policy_on_perfect_observations_is_a_teacher(tmp_path: Path) -> None:
    envs = TrainingEnvs(ENV, {}, 1, 2)
    policy = MLP(envs.inner, weights=[0.1 * random(6, 2 * envs.size)], biases=[random(6)], history=2)
    policy.save(tmp_path / "teacher.safetensors")
    learner = Distillation(settings("distill", teacher=f"mlp:{tmp_path / 'teacher.safetensors'}"))
    episodes, targets = learner.collect(learner.actor, 1, 12)
    actions, _ = policy.predict(episodes.perfect[:, 5], episodes.perfect[:, 4])
    np.testing.assert_array_equal(targets[:, 5], actions)
    assert learner.notes() == {"teacher": "teacher.safetensors"}


def command(algo: str, *arguments: str) -> list[str]:
    small = {key: value for key, value in (TINY | MORE[algo]).items() if key not in ("n_timesteps", "n_envs")}
    pairs = [part for key, value in small.items() for part in ("-params", f"{key}:{value}")]
    common = ["--n-envs", "8", "--eval-episodes", "4", "--env-kwargs", "max_episode_steps:12"]
    return ["train", "--algo", algo, *common, *pairs, *arguments]


def test_the_command_distills_goes_on_and_improves(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs, policy = tmp_path / "logs", tmp_path / "policies/distilled-7.safetensors"
    options = ["-f", str(logs), "--seed", "7", "--teacher", "pd", "--export", str(policy), "-tb", str(tmp_path / "tb")]
    assert main(command("distill", "-n", "96", *options)) == 0
    folder = logs / "distill" / f"{ENV}_1"
    assert policy.read_bytes() == (folder / POLICY).read_bytes()
    assert MLP.load(policy).notes["teacher"] == "pd"
    assert (policy.parent / "README.md").is_file() and list((tmp_path / "tb").rglob("events*"))
    assert main(["train", "-i", str(folder), "-n", "192"]) == 0
    assert MLP.load(folder / POLICY).notes["steps"] == "192"
    for algo in ("asymmetric-ppo", "shac"):
        assert main(command(algo, "-n", "96", "-f", str(logs), "--start", str(policy))) == 0
    assert "96 steps" in capsys.readouterr().out
