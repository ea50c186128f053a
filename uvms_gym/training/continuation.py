"""Checkpoints of Stable-Baselines3's PPO with which runs resume bit-identically."""

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from uvms_gym._files import write

#: Additional member of a model's file.
_MEMBER = "continuation.npz"


def save(model: PPO, venv: VecEnv, seconds: float, path: Path) -> None:
    """Write a model in the format of Stable-Baselines3, with environments, random generators and the time so far, s.

    `stable_baselines3.PPO.load` and rl_zoo3 read it, too.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    kind, keys, *rest = np.random.get_state()  # noqa: NPY002 (Stable-Baselines3 draws from it)
    assert kind == "MT19937"
    arrays = {f"env.{name}": rows for name, rows in venv.get_state().items()}  # type: ignore[attr-defined]
    arrays |= {"torch": torch.get_rng_state().numpy(), "numpy.keys": keys, "numpy.rest": np.array(rest, dtype=float)}
    data, complete = io.BytesIO(), io.BytesIO()
    np.savez(data, seconds=seconds, **arrays)
    model.save(complete)
    with zipfile.ZipFile(complete, "a") as file:
        file.writestr(_MEMBER, data.getvalue())
    write(path, complete.getvalue())


def load(path: Path, venv: VecEnv, **arguments: Any) -> tuple[PPO, float]:
    """Read a checkpoint, and set environments and random generators; returns the model and the time so far, s.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        The file is of another kind, or for other environments.
    """
    try:
        with zipfile.ZipFile(path) as file:
            data = file.read(_MEMBER)
    except (zipfile.BadZipFile, KeyError):
        raise ValueError(f"{path} holds no training run of `uvms train`") from None
    # The observations before the next action belong to the environments' state.
    model = PPO.load(path, env=venv, force_reset=False, **arguments)
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        venv.set_state({name.removeprefix("env."): arrays[name] for name in arrays if name.startswith("env.")})  # type: ignore[attr-defined]
        torch.set_rng_state(torch.from_numpy(arrays["torch"]))
        position, has_gauss, gauss = arrays["numpy.rest"]
        np.random.set_state(("MT19937", arrays["numpy.keys"], int(position), int(has_gauss), gauss))  # noqa: NPY002
        return model, float(arrays["seconds"])
