"""PPO of Ray RLlib on the native vector environments, on one machine or many: `python training/train_rllib.py --help`.

Every environment runner steps one native vector environment (RLlib's `vector_entry_point` mode), and the learner is
RLlib's own. What comes out is a policy as `uvms_gym.MLP` runs it, without torch, and a checkpoint to go on from.
training/CLUSTER.md tells how to spread it over machines.
"""

import ast
import itertools
import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

# Before Ray itself: it says what is missing, and keeps Ray quiet.
from ray_common import Address, check_resources, connect, make_single, run  # isort: split

import gymnasium
import numpy as np
import ray
import torch
import typer
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.tune.registry import register_env
from tensorboardX import SummaryWriter

import uvms_gym
from uvms_gym.cli.common import check_range, circumstances, fail, prepare, write_json
from uvms_gym.cli.scenes import read_scene
from uvms_gym.cli.statistics import interquartile_mean

NAME = "train_rllib"
#: Environments train on seeds from here on, another such block for each training seed; below lie those of evaluation.
TRAINING_SEEDS = 10_000_000
EVALUATION_SEEDS = 2_000_000
#: Lever that turns angles into distances in the pose error, m.
LEVER = 0.5

# What works for station keeping (README.md): gamma is for a control period of 0.1 s.
GAMMA, PERIOD = 0.9, 0.1
LEARNING_RATES = (1e-3, 5e-5)
HIDDEN = [64, 64]
LOG_STD = -1.0
#: Factor on the actor's last layer, so that training starts from little action.
GENTLE = 0.1
#: Greatest difference between what RLlib and the exported policy do.
SAME = 1e-6


class Actor(DefaultPPOTorchRLModule):
    """RLlib's own network for PPO, which starts with small actions and little noise."""

    def setup(self) -> None:
        """Build the network."""
        super().setup()
        with torch.no_grad():
            self.pi.log_std.fill_(LOG_STD)
            for parameter in self.pi.net.parameters():
                parameter.mul_(GENTLE)


class Staggered(gymnasium.vector.VectorWrapper):
    """Instances are in different phases of their episodes, and infos, which RLlib would take apart, are left out.

    Instance i of n is cut (truncated) in its first episode after i / n of its length. Seeds of environment runners,
    which RLlib makes of its own seed and the runner's number, are set apart, so that no two instances share one.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv, seed: int, first: int, length: int) -> None:
        super().__init__(envs)
        self._seed, self._first = seed, first
        self._cuts = np.arange(self.num_envs) * length // self.num_envs
        self._step = 0
        self._fresh = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Start episodes."""
        if seed is not None:
            seed = self._first + (seed - self._seed) * self.num_envs
        self._step = 0
        self._fresh[:] = False
        return self.env.reset(seed=seed, options=options)[0], {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """One control period; as always the step after an episode's end starts the next one."""
        observations, rewards, terminated, truncated, _ = self.env.step(actions)
        if self._fresh.any():
            started, _ = self.env.reset(options={"reset_mask": self._fresh})
            observations[self._fresh] = started[self._fresh]
            for array in (rewards, terminated, truncated):
                array[self._fresh] = 0
        self._step += 1
        self._fresh = (self._cuts == self._step) & ~(terminated | truncated)
        return observations, rewards, terminated, truncated | self._fresh, {}


def make(config: dict[str, Any]) -> gymnasium.vector.VectorEnv:
    """Make the vector environment of a runner."""
    import uvms_gym  # noqa: F401 (registers the environments, on whatever machine this is)

    envs = gymnasium.make_vec(config["env"], num_envs=config["num_envs"], **config["options"])
    return Staggered(envs, config["seed"], config["first"], config["length"])


def export(algorithm: Algorithm, env: gymnasium.Env, notes: dict[str, str]) -> uvms_gym.MLP:
    """Make a native policy of the learner's: the mean of its actions.

    Raises
    ------
    RuntimeError
        It does not do what RLlib's environment runners would do without exploration.
    """
    weights = algorithm.learner_group.get_weights([DEFAULT_MODULE_ID])[DEFAULT_MODULE_ID]
    actor, head = "encoder.actor_encoder.net.mlp", "pi.net.mlp"
    hidden = sorted(int(name.split(".")[-2]) for name in weights if name.startswith(actor) and name.endswith("weight"))
    names = [*(f"{actor}.{i}" for i in hidden), f"{head}.0"]
    layers, biases = ([np.asarray(weights[f"{name}.{part}"]) for name in names] for part in ("weight", "bias"))
    policy = uvms_gym.MLP(env, weights=layers, biases=biases, activation="tanh", output="clip", notes=notes)
    observations = np.random.default_rng(0).normal(size=(256, policy.sizes[0])).astype(np.float32)
    module = algorithm.get_module()
    with torch.no_grad():
        given = module.forward_inference({Columns.OBS: torch.as_tensor(observations)})[Columns.ACTION_DIST_INPUTS]
        distribution = module.get_inference_action_dist_cls().from_logits(given).to_deterministic()
        expected = np.clip(distribution.sample().numpy(), env.action_space.low, env.action_space.high)
    worst = float(np.abs(policy.predict(observations)[0] - expected).max())
    if not worst <= SAME:
        raise RuntimeError(f"the exported policy differs by {worst:g} from RLlib's")
    return policy


def evaluate(env: str, options: dict[str, Any], controller: Any, episodes: int) -> tuple[float, float]:
    """Run held-out episodes natively.

    Returns
    -------
    error, effort : float
        Interquartile means over episodes of the root mean square of the pose error (m, of the end effector if that is
        what is to be held) and of the mean effort.
    """
    envs = gymnasium.make_vec(env, num_envs=episodes, **options)
    envs.reset(seed=EVALUATION_SEEDS)
    rollout = uvms_gym.Rollout(envs, controller)
    rollout.run(episode_length(env, options))
    tally = rollout.take()
    part = "end_effector_" if envs.unwrapped.task == "ee-track" else ""
    distance, angle = (tally.squares[f"{part}{name}_error"] for name in ("position", "attitude"))
    error = np.sqrt((distance + LEVER**2 * angle) / tally.steps)
    return float(interquartile_mean(error)), float(interquartile_mean(tally.sums["effort"] / tally.steps))


def episode_length(env: str, options: dict[str, Any]) -> int:
    """Tell an episode's steps."""
    return options.get("max_episode_steps") or gymnasium.spec(env).max_episode_steps


@contextmanager
def until_asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Note the first Ctrl-C (or SIGTERM) in place of being interrupted by it; the second interrupts."""
    asked: list[int] = []

    def note(number: int, _: Any) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass
class Recipe:
    """Numbers of PPO, and how it is spread."""

    n_timesteps: int
    seed: int
    num_env_runners: int
    num_envs_per_env_runner: int
    num_learners: int
    num_gpus_per_learner: float
    n_steps: int
    batch_size: int
    n_epochs: int
    gamma: float

    def build(self, env: str, options: dict[str, Any]) -> Algorithm:
        """Make RLlib's algorithm."""
        register_env(env, make)
        frames = self.n_steps * self.num_envs_per_env_runner * max(1, self.num_env_runners)
        per_learner = math.ceil(frames / max(1, self.num_learners))
        own = {
            "env": env,
            # More runners take more cores.
            "options": {**options, "threads": 1},
            "length": episode_length(env, options),
            "seed": self.seed,
            "first": TRAINING_SEEDS * (1 + self.seed),
        }
        network = DefaultModelConfig(
            fcnet_hiddens=HIDDEN, fcnet_activation="tanh", vf_share_layers=False, free_log_std=True
        )
        config = (
            PPOConfig()
            # The environments clip; RLlib would do it action by action.
            .environment(env, env_config=own, normalize_actions=False, clip_actions=False)
            .env_runners(
                num_env_runners=self.num_env_runners,
                num_envs_per_env_runner=self.num_envs_per_env_runner,
                gym_env_vectorize_mode="vector_entry_point",
                rollout_fragment_length=self.n_steps,
            )
            .learners(num_learners=self.num_learners, num_gpus_per_learner=self.num_gpus_per_learner)
            .rl_module(rl_module_spec=RLModuleSpec(module_class=Actor, model_config=network))
            .training(
                lr=[[0, LEARNING_RATES[0]], [self.n_timesteps, LEARNING_RATES[1]]],
                gamma=self.gamma,
                lambda_=0.95,
                clip_param=0.2,
                use_kl_loss=False,
                vf_loss_coeff=0.5,
                vf_clip_param=math.inf,
                entropy_coeff=0.0,
                grad_clip=0.5,
                grad_clip_by="global_norm",
                train_batch_size_per_learner=per_learner,
                minibatch_size=min(self.batch_size, per_learner),
                num_epochs=self.n_epochs,
            )
            .debugging(seed=self.seed, log_level="ERROR")
            .fault_tolerance(restart_failed_env_runners=True)
        )
        return config.build_algo()


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(help=__doc__)
def train(
    env: Annotated[str, typer.Option(help="Environment, by Gymnasium's id.")] = "UVMS-StationKeep-Storm-v0",
    n_timesteps: Annotated[int, typer.Option("-n", "--n-timesteps", help="Frames to train for.")] = 3_000_000,
    seed: Annotated[int, typer.Option(help="Seed of weights, noise and environments.")] = 0,
    scene: Annotated[str, typer.Option(help="Scene: name or TOML file.")] = "petasus-pum",
    disturbance: Annotated[str | None, typer.Option(help="Level of disturbances. [default: the environment's]")] = None,
    env_kwargs: Annotated[
        list[str] | None, typer.Option(metavar="NAME:VALUE", help="Another argument of the environment; repeatable.")
    ] = None,
    num_env_runners: Annotated[
        int, typer.Option(help="Processes that step environments, anywhere in the cluster; 0: this one does.")
    ] = 0,
    num_envs_per_env_runner: Annotated[int, typer.Option(help="Instances of each.")] = 512,
    num_learners: Annotated[int, typer.Option(help="Processes that learn, anywhere; 0: this one does.")] = 0,
    num_gpus_per_learner: Annotated[float, typer.Option(help="GPUs of each.")] = 0,
    n_steps: Annotated[int, typer.Option(help="Steps of every instance between two updates.")] = 32,
    batch_size: Annotated[int, typer.Option(help="Frames of a minibatch.")] = 4096,
    n_epochs: Annotated[int, typer.Option(help="Passes over the frames in an update.")] = 4,
    gamma: Annotated[
        float | None, typer.Option(help=f"Discount per control period. [default: {GAMMA:g} in {PERIOD:g} s]")
    ] = None,
    eval_freq: Annotated[int, typer.Option(help="Evaluate and save whenever so many frames have passed.")] = 250_000,
    eval_episodes: Annotated[int, typer.Option(help="Episodes of an evaluation, on held-out seeds.")] = 256,
    trained_agent: Annotated[
        Path | None, typer.Option("-i", "--trained-agent", metavar="DIR", help="Checkpoint to go on from.")
    ] = None,
    log_folder: Annotated[Path, typer.Option("-f", "--log-folder", metavar="DIR", help="Where results go.")] = Path(
        "out/rllib"
    ),
    address: Address = None,
) -> int:
    """Train."""
    arguments = {name: str(value) if isinstance(value, Path) else value for name, value in locals().items()}
    for name in NUMBERS:
        least = 0 if name in ("seed", "num_env_runners", "num_learners", "num_gpus_per_learner") else 1
        check_range(f"--{name.replace('_', '-')}", arguments[name], least, 2**31 - 1)
    options: dict[str, Any] = {"scene": read_scene(scene), **keywords(env_kwargs)}
    if disturbance is not None:
        options["disturbance"] = disturbance
    single = make_single(env, options)
    if gamma is None:
        gamma = GAMMA ** (1.0 / single.metadata["render_fps"] / PERIOD)
    check_range("--gamma", gamma, 0.0, 1.0)
    if trained_agent is not None and not (trained_agent / "rllib_checkpoint.json").is_file():
        raise fail(f"--trained-agent {trained_agent}: no checkpoint of RLlib")
    folder = make_folder(log_folder, env)

    connect(address)
    check_resources(CPU=num_env_runners + num_learners, GPU=num_gpus_per_learner * max(1, num_learners))
    torch.set_num_threads(1)
    recipe = Recipe(**{name: arguments[name] for name in NUMBERS if name in Recipe.__annotations__}, gamma=gamma)
    algorithm = recipe.build(env, options)
    if trained_agent is not None:
        try:
            algorithm.restore_from_path(trained_agent.absolute().as_posix())
        except (RuntimeError, ValueError, KeyError) as error:
            raise fail(f"--trained-agent {trained_agent}: {str(error).splitlines()[0]}") from None
    data = {"circumstances": circumstances(NAME, arguments), "ray": ray.__version__, "torch": torch.__version__}
    with until_asked_to_stop() as asked:
        stopped = run_training(algorithm, recipe, single, options, folder, data, (eval_freq, eval_episodes), asked)
    algorithm.stop()
    return 130 if stopped else 0


NUMBERS = (
    "n_timesteps",
    "seed",
    "num_env_runners",
    "num_envs_per_env_runner",
    "num_learners",
    "num_gpus_per_learner",
    "n_steps",
    "batch_size",
    "n_epochs",
    "eval_freq",
    "eval_episodes",
)


def run_training(
    algorithm: Algorithm,
    recipe: Recipe,
    single: gymnasium.Env,
    options: dict[str, Any],
    folder: Path,
    data: dict[str, Any],
    evaluation: tuple[int, int],
    asked: Callable[[], bool],
) -> bool:
    """Train until there are enough frames or it is asked to stop; returns whether it was."""
    env = single.spec.id
    every, episodes = evaluation
    curve: list[dict[str, Any]] = []
    started, best, due = time.perf_counter(), math.inf, 0
    frames = 0
    with SummaryWriter(folder.as_posix()) as board:
        while frames < recipe.n_timesteps and not asked():
            result = algorithm.train()
            frames = int(result["num_env_steps_sampled_lifetime"])
            seconds = time.perf_counter() - started
            learner = result["learners"][DEFAULT_MODULE_ID]
            returns = float(result["env_runners"].get("episode_return_mean", math.nan))
            for name, value in {
                "rollout/ep_rew_mean": returns,
                "time/total_seconds": seconds,
                **{f"train/{name}": learner[name] for name in LOGGED},
            }.items():
                board.add_scalar(name, float(value), frames)
            if frames < due and frames < recipe.n_timesteps and not asked():
                continue
            due = (frames // every + 1) * every
            notes = {
                "algorithm": f"PPO of RLlib {ray.__version__}",
                "seed": str(recipe.seed),
                "frames": str(frames),
                "uvms_gym": uvms_gym.__version__,
            }
            policy = export(algorithm, single, notes)
            policy.save(folder / f"{env}.safetensors")
            algorithm.save_to_path((folder / f"rl_model_{frames}_steps").absolute().as_posix())
            error, effort = evaluate(env, options, policy, episodes)
            if error < best:
                best = error
                policy.save(folder / "best_model.safetensors")
            board.add_scalar("eval/pose_error", error, frames)
            board.add_scalar("eval/effort", effort, frames)
            curve.append(
                {"frames": frames, "seconds": seconds, "return": returns, "pose_error": error, "effort": effort}
            )
            write_json(folder / "train.json", {**data, "curve": curve})
            typer.echo(
                f"{frames:>9} frames, {seconds:6.1f} s: return {returns:8.2f}, "
                f"held out: pose error {error:.4f} m, effort {effort:.4f}"
            )
    typer.echo(f"{folder}: {env}.safetensors, best_model.safetensors, train.json, rl_model_{frames}_steps")
    return frames < recipe.n_timesteps


#: What TensorBoard is given of the learner's numbers.
LOGGED = ("policy_loss", "vf_loss", "vf_explained_var", "entropy", "mean_kl_loss", "default_optimizer_learning_rate")


def keywords(given: list[str] | None) -> dict[str, Any]:
    """Read arguments NAME:VALUE, values as Python writes them."""
    read = {}
    for text in given or []:
        name, separator, value = text.partition(":")
        if not separator:
            raise fail(f"--env-kwargs {text!r} is no NAME:VALUE")
        try:
            read[name] = ast.literal_eval(value)
        except (ValueError, SyntaxError):
            read[name] = value
    return read


def make_folder(log_folder: Path, env: str) -> Path:
    """Make the next free folder ENV_1, ENV_2, ..."""
    prepare(log_folder, None)
    folders = (log_folder / f"{env}_{i}" for i in itertools.count(1))
    folder = next(folder for folder in folders if not folder.exists())
    prepare(folder, None)
    return folder


if __name__ == "__main__":
    raise SystemExit(run(app, NAME))
