"""Training by Stable-Baselines3 (extra `train`): parts of `uvms train` and of the scripts in training/."""
