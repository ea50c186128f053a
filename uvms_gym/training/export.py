"""Export of models as policies that run without torch, and their model cards."""

import contextlib
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray
from torch import nn

from uvms_gym import MLP
from uvms_gym._files import write

if TYPE_CHECKING:
    from stable_baselines3 import PPO

#: Bound on the root mean square difference between the actions of the model and of the exported policy.
TOLERANCE = 1e-6
#: Mark of model cards that may be overwritten.
_MARK = "<!-- Written by `uvms train` from the notes in the policies' files. -->"
_CARD = """\
{mark}
# {algorithms}: {task} on {scene}, every {control_period:g} s

| File | Learned | Training seed | Steps | Wall-clock | Pose error | 95th percentile | Power | Diverged |
| --- | --- | --: | --: | --: | --: | --: | --: | --: |
{policies}

Pose error: interquartile mean, and 95th percentile, over {episodes} held-out episodes (seeds from {seed} on) of an \
episode's root mean square pose error, sqrt(position² + (0.5 m · attitude)²). Power: mean of |T/T_max|^1.5. Diverged: \
share of episodes that left all bounds.
{comparison}
## Training

{training}

## Intended use

These policies serve to compare controllers of {task} in simulation, on the scene {scene} at a control period of \
{control_period:g} s. `uvms_gym.MLP.load` refuses other tasks. Do not use them on real vehicles: outside the states of \
the training, only the clip to [-1, 1] bounds the network's output.

## Known failures

- In the worst 5 % of the episodes the error is at least {tail:.1f} times the typical one (`{worst}`).
- Disturbances, parameters or sensor delays beyond the training increase the error: see the off-design comparison.
"""
_COMPARISON = "`results.json` has the comparison with classical controllers on other seeds.\n"
#: Keys of the notes on the training, by their titles.
_TRAINING = {
    "Environment": "environment",
    "Arguments": "env_kwargs",
    "Algorithm": "algorithm",
    "Hyperparameters": "hyperparameters",
    "Commit": "commit",
    "Versions": "versions",
    "Processor": "processor",
}
_ACTIVATIONS = {nn.Tanh: "tanh", nn.ReLU: "relu", nn.ELU: "elu"}


def policy_of(
    model: "PPO", env: Any, *, history: int = 1, residual: bool = False, notes: Mapping[str, str] | None = None
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
    check_actions(policy.predict(now, past if history > 1 else None)[0], expected)
    return policy


def check_actions(actions: NDArray[np.float32], expected: NDArray[np.float32]) -> None:
    """Compare the actions of an exported policy with its model's.

    Raises
    ------
    RuntimeError
        They are not equal to `TOLERANCE`.
    """
    off = actions - expected
    # Both round hundreds of products: single entries may differ by a few units in the last place of their sum.
    if (typical := float(np.sqrt(np.square(off).mean()))) > TOLERANCE or np.abs(off).max() > 10 * TOLERANCE:
        raise RuntimeError(
            f"the exported policy differs from the model by {typical:.1e}, at most {np.abs(off).max():.1e}"
        )


def weights_hash(policy: Path) -> str:
    """SHA-256 of the weights in a policy's file, without its notes: hexadecimal."""
    data = policy.read_bytes()
    return hashlib.sha256(data[8 + int.from_bytes(data[:8], "little") :]).hexdigest()


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
        write(path, card(folder))


def card(folder: Path) -> str:
    """Model card in Markdown, from the notes of the policies in a folder."""
    files = {}
    for file in sorted(folder.glob("*.safetensors")):
        # One that a full disk cut off is no reason to lose the others' card.
        with contextlib.suppress(ValueError):
            files[file.name] = MLP.load(file, residual=True)
    notes = {file: policy.notes for file, policy in files.items() if "evaluation" in policy.notes}
    if not notes:
        raise ValueError(f"{folder} has no policies of `uvms train`")
    found = {file: json.loads(note["evaluation"]) for file, note in notes.items()}
    tails = {file: numbers["pose_95"] / numbers["pose"] for file, numbers in found.items()}
    worst = max(tails, key=tails.__getitem__)
    first = next(iter(notes))
    algorithms = (note["algorithm"] + (f" on {note['base']}" if "base" in note else "") for note in notes.values())
    text = _CARD.format(
        mark=_MARK,
        algorithms=", ".join(dict.fromkeys(algorithms)),
        policies="\n".join(_row(file, notes[file], found[file]) for file in notes),
        episodes=found[first]["episodes"],
        seed=found[first]["seed"],
        comparison=_COMPARISON if (folder / "results.json").exists() else "",
        training=_training(notes),
        tail=tails[worst],
        worst=worst,
        **cast(Any, files[first].spec),
    )
    diverged = {file: numbers["diverged"] for file, numbers in found.items() if numbers["diverged"]}
    return text + "".join(f"- `{file}` diverges in {share:.1%} of the episodes.\n" for file, share in diverged.items())


def _row(file: str, notes: Mapping[str, str], found: Mapping[str, Any]) -> str:
    learned = "from scratch"
    if "recipe" in notes:
        learned = notes["recipe"]
    elif "base" in notes:
        learned = f"corrections to {notes['base']}, up to {notes['limit']}"
    elif "teacher" in notes:
        learned = f"from {notes['teacher']} with perfect sensors"
    elif "start" in notes:
        learned = f"from {notes['start']}"
    return (
        f"| `{file}` | {learned} | {notes['seed']} | {int(notes['steps']):,} | {notes['seconds']} s | "
        f"{found['pose']:.3f} m | {found['pose_95']:.3f} m | {found['effort']:.3f} | {found['diverged']:.1%} |"
    )


def _training(notes: Mapping[str, Mapping[str, str]]) -> str:
    """Settings of the training, one list per group of policies that share all of them."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for file, note in notes.items():
        settings = tuple(f"- {title}: {_plain(note.get(key, 'unknown'))}" for title, key in _TRAINING.items())
        groups.setdefault(settings, []).append(f"`{file}`")
    return "\n\n".join("\n".join([f"{', '.join(files)}:\n", *lines]) for lines, files in groups.items())


def _plain(value: str) -> str:
    """List of the entries of a JSON object; other values unchanged."""
    try:
        data = json.loads(value)
    except ValueError:
        return value
    if not isinstance(data, dict):
        return value
    return (
        "the environment's own"
        if not data
        else ", ".join(f"{key} `{item if isinstance(item, str) else json.dumps(item)}`" for key, item in data.items())
    )
