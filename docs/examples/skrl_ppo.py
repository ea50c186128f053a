"""PPO of skrl on the native vector environment; needs `skrl` and torch.

skrl's wrapper for Gymnasium takes the vector environment as it is, with
`autoreset_mode="SameStep"`.
"""

from itertools import pairwise

import gymnasium
import torch
from skrl.agents.torch.ppo import PPO
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model
from skrl.trainers.torch import SequentialTrainer
from skrl.utils import set_seed

import uvms_gym  # noqa: F401 (registers the environments)


def layers(inputs: int, outputs: int) -> torch.nn.Sequential:
    """Two hidden layers of 64."""
    sizes = [inputs, 64, 64]
    hidden = [part for a, b in pairwise(sizes) for part in (torch.nn.Linear(a, b), torch.nn.Tanh())]
    return torch.nn.Sequential(*hidden, torch.nn.Linear(64, outputs))


class Policy(GaussianMixin, Model):
    """Gaussian policy."""

    def __init__(self, **spaces) -> None:
        Model.__init__(self, **spaces)
        GaussianMixin.__init__(self)
        self.net = layers(self.num_observations, self.num_actions)
        self.log_std = torch.nn.Parameter(torch.full((self.num_actions,), -1.0))

    def compute(self, inputs, role):
        """Mean and logarithm of the deviation."""
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    """Value of a state."""

    def __init__(self, **spaces) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = layers(self.num_observations, 1)

    def compute(self, inputs, role):
        """Value."""
        return self.net(inputs["observations"]), {}


def main(frames: int = 1_000_000, num_envs: int = 256, folder: str = "out/skrl") -> PPO:
    """Train, and return the agent."""
    set_seed(0)
    env = wrap_env(
        gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs, autoreset_mode="SameStep"),
        wrapper="gymnasium",
        verbose=False,
    )
    spaces = {
        "observation_space": env.observation_space,
        "action_space": env.action_space,
        "device": env.device,
    }
    agent = PPO(
        models={"policy": Policy(**spaces), "value": Value(**spaces)},
        memory=RandomMemory(memory_size=32, num_envs=num_envs, device=env.device),
        cfg={
            "rollouts": 32,
            "learning_epochs": 4,
            "mini_batches": 4,
            "discount_factor": 0.95,
            "experiment": {"directory": folder, "write_interval": 0, "checkpoint_interval": 0},
        },
        **spaces,
    )
    timesteps = max(32, frames // num_envs)
    SequentialTrainer(
        env=env,
        agents=agent,
        cfg={
            "timesteps": timesteps,
            "headless": True,
            "disable_progressbar": True,
            "close_environment_at_exit": False,
        },
    ).train()
    return agent


if __name__ == "__main__":
    main()
