"""Training by Stable-Baselines3, which the extra `train` brings: what `uvms train` and `training/` are made of."""
