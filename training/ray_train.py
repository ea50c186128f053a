"""PPO of Ray RLlib on native vector environments, and export of the policy.

```sh
pip install --group ray  # with pip 25.1, in an environment of its own: Ray pins Gymnasium 1.2.2
python training/ray_train.py --frames 3000000 --runners 4
```

The same command goes on where it was stopped, by Ctrl-C, SIGTERM or a kill; runners that die are
replaced. The state lies in a folder beside the policy until the end.

Each environment runner steps one vector environment on one thread. The policy is a `uvms_gym.MLP`,
which runs without torch and Ray. RLlib keeps steps as Python objects, so RLlib, not the
environment, limits the speed.
"""

import argparse
import importlib
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import ray
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env

import uvms_gym
from uvms_gym.training.run import interrupt_event

ENV = "UVMS-StationKeep-Storm-v0"


class WithoutInfos(gymnasium.vector.VectorWrapper):
    """Leaves out infos, which RLlib would split by instance."""

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Start episodes."""
        return self.env.reset(**options)[0], {}

    def step(self, actions: np.ndarray) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One control period."""
        return (*self.env.step(actions)[:4], {})


def make(config: dict[str, Any]) -> gymnasium.vector.VectorEnv:
    """Make the vector environment of a runner."""
    # Registers the environments in the processes of runners.
    importlib.import_module("uvms_gym")
    return WithoutInfos(gymnasium.make_vec(ENV, num_envs=config["num_envs"], threads=1))


def configure(frames: int, runners: int, instances: int) -> PPOConfig:
    """Configure PPO: discount per 0.1 s, 32 steps between updates, networks of 64 and 64."""
    batch = 32 * instances * max(1, runners)
    network = DefaultModelConfig(
        fcnet_hiddens=[64, 64], fcnet_activation="tanh", vf_share_layers=False, free_log_std=True
    )
    return (
        PPOConfig()
        # The environments clip actions.
        .environment(ENV, normalize_actions=False, clip_actions=False)
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=instances,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=32,
        )
        .fault_tolerance(restart_failed_env_runners=True)
        .rl_module(model_config=network)
        .training(
            lr=[[0, 1e-3], [frames, 5e-5]],
            gamma=0.9,
            lambda_=0.95,
            clip_param=0.2,
            use_kl_loss=False,
            vf_loss_coeff=0.5,
            vf_clip_param=float("inf"),
            grad_clip=0.5,
            train_batch_size_per_learner=batch,
            minibatch_size=min(4096, batch),
            num_epochs=4,
        )
    )


def export(algorithm: Algorithm) -> uvms_gym.MLP:
    """Make a native policy of the learner's mean action."""
    weights = algorithm.learner_group.get_weights([DEFAULT_MODULE_ID])[DEFAULT_MODULE_ID]
    names = ("encoder.actor_encoder.net.mlp.0", "encoder.actor_encoder.net.mlp.2", "pi.net.mlp.0")
    layers = [np.asarray(weights[f"{name}.weight"]) for name in names]
    biases = [np.asarray(weights[f"{name}.bias"]) for name in names]
    env = gymnasium.make(ENV)
    return uvms_gym.MLP(env, weights=layers, biases=biases, activation="tanh", output="clip")


def save(algorithm: Algorithm, folder: Path, frames: int) -> None:
    """Write the state after a number of frames, whole or not at all, and remove those before it."""
    part, old = folder / ".part", states(folder)
    shutil.rmtree(part, ignore_errors=True)
    algorithm.save_to_path(part.absolute())
    if frames not in old:
        part.rename(folder / str(frames))
    for earlier in old.keys() - {frames}:
        shutil.rmtree(old[earlier])


def states(folder: Path) -> dict[int, Path]:
    """States of an unfinished run, by their frames."""
    return {int(path.name): path for path in folder.glob("[0-9]*")}


def main() -> None:
    """Train, and write the policy."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--frames", type=int, default=3_000_000)
    parser.add_argument("--runners", type=int, default=0, help="runners; 0: this process")
    parser.add_argument("--instances", type=int, default=512, help="instances of each runner")
    parser.add_argument("--address", help="cluster, such as auto; default: this machine")
    parser.add_argument("--out", type=Path, default=Path("ray.safetensors"))
    parser.add_argument("--save-every", type=int, default=10, help="iterations from state to state")
    options = parser.parse_args()
    ray.init(address=options.address)
    register_env(ENV, make)
    algorithm = configure(options.frames, options.runners, options.instances).build_algo()
    folder, frames, iteration = options.out.with_name(f"{options.out.stem}-state"), 0, 0
    if found := states(folder):
        frames = max(found)
        algorithm.restore_from_path(found[frames].absolute())
        print(f"going on after {frames} frames", flush=True)
    folder.mkdir(parents=True, exist_ok=True)
    with interrupt_event() as stopped:
        while frames < options.frames and not stopped.is_set():
            result = algorithm.train()
            frames, iteration = int(result["num_env_steps_sampled_lifetime"]), iteration + 1
            episodes = result["env_runners"].get("episode_return_mean", float("nan"))
            print(f"{frames} frames: return {episodes:.2f}", flush=True)
            if stopped.is_set() or iteration % options.save_every == 0:
                save(algorithm, folder, frames)
    if frames < options.frames:
        print(f"stopped after {frames} frames; the same command goes on")
    else:
        export(algorithm).save(options.out)
        shutil.rmtree(folder)
    ray.shutdown()


if __name__ == "__main__":
    main()
