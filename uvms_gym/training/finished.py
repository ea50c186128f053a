"""Policies of finished runs."""

import json
from pathlib import Path

from uvms_gym.controllers import MLP


def is_finished(file: Path | str) -> bool:
    """True if a file has the complete policy of a run that took all of its steps."""
    try:
        notes = MLP.load(file, residual=True).notes
        return int(notes["steps"]) >= int(json.loads(notes["hyperparameters"])["n_timesteps"])
    except (OSError, ValueError, LookupError, TypeError):
        return False
