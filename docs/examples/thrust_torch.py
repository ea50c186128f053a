"""Thrusts that stop a drifting vehicle, by gradients through the simulator; needs torch."""

import torch

from uvms_gym import Simulator
from uvms_gym.torch import state, step


def main(iterations: int = 60, num_envs: int = 4, periods: int = 10) -> list[float]:
    """Descend by Adam over control periods of 0.1 s and return the cost of each iteration."""
    sim = Simulator("bluerov2-heavy", num_envs, dt=0.02)
    start = state(sim)
    speeds = torch.linspace(0.1, 0.4, num_envs)[:, None]  # m/s
    start[:, 7:10] = speeds * torch.tensor([1.0, 0.5, -0.5])
    thrust = torch.zeros(periods, num_envs, sim.num_thrusters, dtype=torch.float64)
    thrust.requires_grad_()
    adam = torch.optim.Adam([thrust], lr=1.0)
    costs = []
    for _ in range(iterations):
        adam.zero_grad()
        x, cost = start, 1e-5 * thrust.square().sum()
        for period in thrust:
            x = step(sim, x, {"thrust": period}, substeps=5)
            cost = cost + (x[:, :3] - start[:, :3]).square().sum() + x[:, 7:13].square().sum()
        cost.backward()
        adam.step()
        costs.append(cost.item())
    return costs


if __name__ == "__main__":
    costs = main()
    print(f"cost {costs[0]:.3f}, after {len(costs)} iterations {costs[-1]:.3f}")
