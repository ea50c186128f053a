"""Offline data: episodes of a controller as a Minari data set; needs `minari[create,hdf5]`.

Data sets lie in the folder of the environment variable MINARI_DATASETS_PATH, `~/.minari/datasets`
by default.
"""

import gymnasium
import minari

import uvms_gym

NAME = "uvms/station-keep/pd-v0"


def main(episodes: int = 50, max_episode_steps: int = 400) -> minari.MinariDataset:
    """Collect episodes of the PD in the storm, write the data set, and return it as read back."""
    env = minari.DataCollector(
        gymnasium.make(
            "UVMS-StationKeep-v0", disturbance="storm", max_episode_steps=max_episode_steps
        )
    )
    controller = uvms_gym.make_controller("pd", env.unwrapped)
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        state, over = None, False
        while not over:
            action, state = controller.predict(observation, state)
            observation, _, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
    env.create_dataset(
        NAME, algorithm_name="PD", description="PD in the storm", eval_env="UVMS-StationKeep-v0"
    )
    data = minari.load_dataset(NAME)
    print(f"{data.total_episodes} episodes, {data.total_steps} steps, {data.spec.data_path}")
    return data


if __name__ == "__main__":
    main()
