"""Export of Stable-Baselines3 models as policies that run without torch, and their model cards."""

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3 import PPO
from torch import nn

from uvms_gym import MLP

#: Bound on the root mean square difference between the actions of the model and of the exported policy.
TOLERANCE = 1e-6
#: Mark of model cards that may be overwritten.
_MARK = "<!-- Written by `uvms train` from the notes in the policies' files. -->"
_ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu", nn.ELU: "elu"}


def policy_of(
    model: PPO, env: Any, *, history: int = 1, residual: bool = False, notes: Mapping[str, str] | None = None
) -> MLP:
    """Take the actor out of a model.

    Parameters
    ----------
    model : stable_baselines3.PPO
        With a `MlpPolicy`.
    env : UVMS environment
        Environment of the training.
    history : int
        Number of observations in the input.
    residual : bool
        True for a residual policy (`uvms_gym.Residual`).
    notes : mapping of str to str, or None
        Notes in the policy's file.

    Raises
    ------
    ValueError
        The actor is more than layers with one of the known activations between them.
    RuntimeError
        The policy's actions are not the model's, to `TOLERANCE`.
    """
    activation: Any = _ACTIVATIONS.get(getattr(model.policy, "activation_fn", None))  # type: ignore[arg-type]
    if activation is None or model.policy.squash_output:
        raise ValueError(f"only a MlpPolicy of {', '.join(_ACTIVATIONS.values())} layers can be exported")
    state = {name: array.detach().cpu().numpy() for name, array in model.policy.state_dict().items()}
    policy = MLP.from_state_dict(state, env, activation=activation, history=history, residual=residual, notes=notes)
    # Observations of the training, if known: rounding grows with the inputs.
    rows: Any = model._last_obs
    if rows is None:
        size = (256, *model.observation_space.shape)  # type: ignore[misc]
        rows = np.random.default_rng(0).normal(size=size).astype(np.float32)
    expected, _ = model.predict(rows, deterministic=True)
    past, now = np.split(rows, [rows.shape[1] - rows.shape[1] // history], axis=1)
    off = policy.predict(now, past if history > 1 else None)[0] - expected
    # Both round hundreds of products: single entries may differ by a few units in the last place of their sum.
    if (typical := float(np.sqrt(np.square(off).mean()))) > TOLERANCE or np.abs(off).max() > 10 * TOLERANCE:
        raise RuntimeError(
            f"the exported policy differs from the model by {typical:.1e}, at most {np.abs(off).max():.1e}"
        )
    return policy


def versions() -> dict[str, str]:
    """Versions of the training libraries."""
    return {name: version(name) for name in ("stable-baselines3", "torch", "numpy", "gymnasium")}


def write_card(folder: Path) -> None:
    """Write README.md, the model card of all policies in a folder, unless a handwritten one exists.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    path = folder / "README.md"
    if not path.exists() or path.read_text().startswith(_MARK):
        path.write_text(card(folder))


def card(folder: Path) -> str:
    """Model card in Markdown, from the notes of the policies in a folder."""
    files = {file.name: MLP.load(file, residual=True) for file in sorted(folder.glob("*.safetensors"))}
    files = {name: policy for name, policy in files.items() if "environment" in policy.notes}
    if not files:
        raise ValueError(f"{folder} has no policies of `uvms train`")
    spec: Any = next(iter(files.values())).spec
    lines = [
        _MARK,
        f"# {', '.join(dict.fromkeys(_name(policy) for policy in files.values()))}: {spec['task']} on "
        f"{spec['scene']}, every {spec['control_period']:g} s",
        "",
        "| File | Learned | Training seed | Steps | Wall-clock | Pose error | 95th percentile | Power | Diverged |",
        "| --- | --- | --: | --: | --: | --: | --: | --: | --: |",
    ]
    for file, policy in files.items():
        notes = policy.notes
        found = json.loads(notes["evaluation"])
        lines.append(
            f"| `{file}` | {_learned(policy)} | {notes['seed']} | {int(notes['steps']):,} | {notes['seconds']} s | "
            f"{found['pose']:.3f} m | {found['pose_95']:.3f} m | {found['effort']:.3f} | {found['diverged']:.1%} |"
        )
    first = next(iter(files.values())).notes
    evaluation = json.loads(first["evaluation"])
    lines += [
        "",
        f"Over {evaluation['episodes']} held-out episodes with seeds from {evaluation['seed']} on: "
        "interquartile mean and 95th percentile of the root mean square pose error "
        "(sqrt(position² + (0.5 m · attitude)²)), mean of |T/T_max|^1.5, share of episodes that left all bounds.",
    ]
    if (folder / "results.json").exists():
        lines.append("`results.json` has the comparison with classical controllers on other seeds.")
    lines += ["", "## Training", ""]
    for title, key in (
        ("Environment", "environment"),
        ("Its arguments", "env_kwargs"),
        ("Algorithm", "algorithm"),
        ("Hyperparameters", "hyperparameters"),
        ("Commit", "commit"),
        ("Versions", "versions"),
        ("Processor", "processor"),
    ):
        for value in dict.fromkeys(policy.notes.get(key, "unknown") for policy in files.values()):
            lines.append(f"- {title}: {_plain(value)}")
    lines += [
        "",
        "## Intended use",
        "",
        f"To compare controllers of {spec['task']} in simulation, on the scene {spec['scene']} at a control "
        f"period of {spec['control_period']:g} s; `uvms_gym.MLP.load` refuses other tasks. Not for real vehicles: "
        "outside the states of the training only the clip to [-1, 1] bounds the network's output.",
        "",
        "## Known failures",
        "",
        *_failures(files),
    ]
    return "\n".join(lines) + "\n"


def _failures(files: Mapping[str, MLP]) -> list[str]:
    """Failures in the evaluation, and those of all policies."""
    found = {file: json.loads(policy.notes["evaluation"]) for file, policy in files.items()}
    worst = max(found, key=lambda file: found[file]["pose_95"] / found[file]["pose"])
    ratio = found[worst]["pose_95"] / found[worst]["pose"]
    lines = [
        f"- The error of the worst twentieth of episodes is at least {ratio:.1f} times the typical one (`{worst}`).",
        "- Disturbances, parameters or delays beyond those of the training: see the off-design comparison.",
    ]
    for file, numbers in found.items():
        if numbers["diverged"]:
            lines.append(f"- `{file}` diverges in {numbers['diverged']:.1%} of the episodes.")
    return lines


def _name(policy: MLP) -> str:
    base = policy.notes.get("base")
    return f"PPO on {base}" if base else "PPO"


def _learned(policy: MLP) -> str:
    base = policy.notes.get("base")
    return f"corrections to {base}, up to {policy.notes['limit']}" if base else "from scratch"


def _plain(value: str) -> str:
    """List of the entries of a JSON object; other values unchanged."""
    try:
        data = json.loads(value)
    except ValueError:
        return value
    if not isinstance(data, dict):
        return value
    if not data:
        return "the environment's own"
    return ", ".join(f"{key} `{item if isinstance(item, str) else json.dumps(item)}`" for key, item in data.items())
