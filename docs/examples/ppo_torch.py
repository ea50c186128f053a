"""PPO in one file, on `gymnasium.make_vec`; needs torch.

With the default autoreset mode, `NextStep`, the step after an episode's end ignores the action and
returns the next episode's first observation. Such steps are masked out of the losses; the
observation before them is the episode's true last one, so a truncated episode is bootstrapped from
its value without further care.
"""

import gymnasium
import numpy as np
import torch
from torch import nn

import uvms_gym  # noqa: F401 (registers the environments)

#: Quantities stored for every step.
ROWS = "observation", "action", "log_prob", "value", "reward", "terminated", "ended", "valid"


def mlp(inputs: int, outputs: int, scale: float) -> nn.Sequential:
    """Two hidden layers of 64; `scale` for the weights of the last one."""
    layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh()]
    layers.append(nn.Linear(64, outputs))
    for layer, gain in ((layers[0], 2**0.5), (layers[2], 2**0.5), (layers[4], scale)):
        nn.init.orthogonal_(layer.weight, gain)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers)


class Agent(nn.Module):
    """Gaussian policy with a state-independent deviation, and value."""

    def __init__(self, observations: int, actions: int) -> None:
        super().__init__()
        self.mean, self.value = mlp(observations, actions, 0.01), mlp(observations, 1, 1.0)
        self.log_deviation = nn.Parameter(torch.full((actions,), -1.0))

    def policy(self, observation: torch.Tensor) -> torch.distributions.Normal:
        """Distribution of the action."""
        return torch.distributions.Normal(self.mean(observation), self.log_deviation.exp())


def advantages(rewards, values, last_value, terminated, ended, discount, decay):
    """Generalised advantage estimates (T, N), cut at the end of episodes."""
    found, running = torch.zeros_like(rewards), torch.zeros_like(last_value)
    following = torch.cat([values[1:], last_value[None]])
    for t in reversed(range(len(rewards))):
        delta = rewards[t] + discount * following[t] * ~terminated[t] - values[t]
        running = delta + discount * decay * running * ~ended[t]
        found[t] = running
    return found


def main(
    frames: int = 3_000_000,
    num_envs: int = 256,
    steps: int = 32,
    epochs: int = 4,
    minibatch: int = 2048,
    rate: float = 1e-3,
    discount: float = 0.95,
    seed: int = 0,
) -> list[float]:
    """Train, and return the mean reward per step of each iteration."""
    torch.manual_seed(seed)
    envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=num_envs)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimiser = torch.optim.Adam(agent.parameters(), lr=rate, eps=1e-5)
    observation = torch.from_numpy(envs.reset(seed=seed)[0])
    fresh = torch.zeros(num_envs, dtype=torch.bool)  # the action of this step is ignored
    iterations = max(1, frames // (num_envs * steps))
    history = []
    for iteration in range(iterations):
        optimiser.param_groups[0]["lr"] = rate * (1 - iteration / iterations)
        rows = {name: [] for name in ROWS}
        for _ in range(steps):
            with torch.no_grad():
                policy = agent.policy(observation)
                action = policy.sample()
                log_prob, value = policy.log_prob(action).sum(1), agent.value(observation)[:, 0]
            clipped = np.clip(action.numpy(), -1.0, 1.0)
            following, reward, terminated, truncated, _ = envs.step(clipped)
            reward, terminated = torch.from_numpy(reward).float(), torch.from_numpy(terminated)
            ended = terminated | torch.from_numpy(truncated)
            # A step that only resets ends nothing, but no advantage may pass it.
            now = (observation, action, log_prob, value, reward, terminated, ended | fresh, ~fresh)
            for row, part in zip(rows.values(), now, strict=True):
                row.append(part)
            observation, fresh = torch.from_numpy(following), ended
        batch = {name: torch.stack(row) for name, row in rows.items()}
        with torch.no_grad():
            last = agent.value(observation)[:, 0]
        ends = batch["terminated"], batch["ended"]
        gain = advantages(batch["reward"], batch["value"], last, *ends, discount, 0.95)
        target = gain + batch["value"]
        valid = batch["valid"]
        data = [batch[name][valid] for name in ROWS[:3]] + [gain[valid], target[valid]]
        history.append(batch["reward"][valid].mean().item())
        for _ in range(epochs):
            for chosen in torch.randperm(len(data[0])).split(minibatch):
                seen, action, before, gain, target = (x[chosen] for x in data)
                policy = agent.policy(seen)
                ratio = (policy.log_prob(action).sum(1) - before).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                surrogate = torch.min(gain * ratio, gain * ratio.clamp(0.8, 1.2)).mean()
                loss = 0.5 * (agent.value(seen)[:, 0] - target).square().mean() - surrogate
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimiser.step()
        if iteration % 10 == 0 or iteration == iterations - 1:
            taken = (iteration + 1) * num_envs * steps
            print(f"{taken:8} frames: reward per step {history[-1]:.4f}")
    return history


if __name__ == "__main__":
    main()
