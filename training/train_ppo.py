"""Train a policy by PPO: the same as `uvms train`, with its flags, which are those of rl_zoo3.

```sh
python training/train_ppo.py --env UVMS-StationKeep-Storm-v0 --seed 0
python training/train_ppo.py --env UVMS-StationKeep-Storm-v0 --seed 0 --base pd -n 3000000
```

From Python, with environments, models and callbacks of one's own in between:

```python
from pathlib import Path
from uvms_gym.training.hyperparameters import read_hyperparameters
from uvms_gym.training.ppo import Settings, make_envs, make_model, train

settings = Settings("UVMS-StationKeep-Storm-v0", read_hyperparameters("UVMS-StationKeep-Storm-v0"), seed=1)
outcome = train(settings, Path("out"))  # all of it; or the parts:
venv, envs, base = make_envs(settings)
model = make_model(settings, venv).learn(100_000)
```
"""

import sys

from uvms_gym.cli import main

if __name__ == "__main__":
    sys.exit(main(["train", *sys.argv[1:]]))
