"""Files in the package: tuned gains, policies and their stored results; and the scripts that make them."""

import json
import py_compile
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from helpers import policy as random_policy

from uvms_gym import MLP
from uvms_gym.controllers.families import CONTROLLERS, is_bound, names
from uvms_gym.controllers.registry import PRETRAINED, make_controller, policies_in
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.verification import verify
from uvms_gym.training.evaluation import run_episodes
from uvms_gym.training.finished import is_finished

# Without control an arm may be flung at its stops.
pytestmark = pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")

TRAINING = Path(__file__).parents[2] / "training"
MORE = TRAINING / "policies"
FILES = sorted([*PRETRAINED.glob("*/*/*/*.safetensors"), *MORE.glob("*/*/*/*.safetensors")])
RESULTS = sorted(PRETRAINED.glob("*/*/*/results.json"))
GAINS = sorted(PRETRAINED.glob("*/*/*/gains.json"))
#: What learned policies are to beat, by task.
BASE = {"UVMS-StationKeep": "pd", "UVMS-EETrack": "resolved", "UVMS-Button": "resolved"}


def named(path: Path) -> str:
    return "/".join(path.parts[-4:])


def environment(folder: Path) -> dict[str, Any]:
    """Arguments of the storm with this folder's scene and control period."""
    period, env = float(folder.name.removesuffix("s")), f"{folder.parents[1].name}-Storm-v0"
    usual = gym.spec(env)
    return {
        "id": env,
        "scene": folder.parent.name,
        "substeps": round(usual.kwargs["substeps"] * period / 0.1),
        "max_episode_steps": round(20.0 / period),
    }


@pytest.mark.parametrize("path", RESULTS, ids=named)
def test_regress_the_stored_results_come_out_again(path: Path) -> None:
    with policies_in(MORE):
        assert verify(path) == ([], [])


@pytest.mark.parametrize("path", FILES, ids=named)
def test_policies_say_what_they_are_for_and_where_they_come_from(path: Path) -> None:
    stem, seed = path.stem.rsplit("-", 1)
    (name,) = [name for name in names(learned=True) if name.replace("/", "-") == stem]
    base = CONTROLLERS[name].setting.base
    policy = MLP.load(path, residual=base is not None)
    spec = policy.spec
    assert spec is not None
    said = (spec["task"], spec["scene"], f"{spec['control_period']:g}s")
    assert said == (path.parents[2].name, path.parents[1].name, path.parents[0].name)
    notes = policy.notes
    assert notes["seed"] == seed and notes.get("base") == base
    assert {"environment", "hyperparameters", "steps", "seconds", "commit", "versions", "evaluation"} <= notes.keys()
    assert f"`{path.name}`" in (path.parent / "README.md").read_text()
    # The package has only training seed 0, and only of the rivals.
    assert (PRETRAINED in path.parents) == (seed == "0" and CONTROLLERS[name].setting.role == "rival")


@pytest.mark.learning
@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES}), ids=named)
def test_a_model_card_says_whose_settings_it_lists(folder: Path) -> None:
    pytest.importorskip("torch")
    from uvms_gym.training.export import card

    text = (folder / "README.md").read_text()
    assert text == card(folder)
    for path in folder.glob("*.safetensors"):
        (listed,) = [
            part
            for part in text.partition("## Training")[2].split("\n\n`")
            if f"{path.name}`" in part.partition(":\n")[0]
        ]
        assert listed.count("- Commit: ") == 1 and MLP.load(path, residual=True).notes["commit"] in listed


@pytest.mark.learning
@pytest.mark.parametrize("path", FILES, ids=named)
def test_val_a_policy_is_what_torch_makes_of_its_file(path: Path) -> None:
    torch = pytest.importorskip("torch")
    data = path.read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    inside = json.loads(header.pop("__metadata__")["uvms_gym"])
    assert inside["activation"] == "tanh" and inside["output"] == "clip"
    body = data[8 + int.from_bytes(data[:8], "little") :]
    tensors = {
        name: torch.from_numpy(np.frombuffer(body[slice(*at["data_offsets"])], "<f4").reshape(at["shape"]).copy())
        for name, at in header.items()
    }
    policy = MLP.load(path, residual=True)
    d, history = policy.native.widths[0], policy.history
    rows = np.random.default_rng(0).normal(size=(500, d * history)).astype(np.float32)
    x = torch.from_numpy(rows)
    depth = len(inside["sizes"]) - 1
    for k in range(depth):
        x = torch.nn.functional.linear(x, tensors[f"layers.{k}.weight"], tensors[f"layers.{k}.bias"])
        x = torch.tanh(x) if k + 1 < depth else torch.clamp(x, -1.0, 1.0)
    past = rows[:, : d * (history - 1)] if history > 1 else None
    off = policy.predict(rows[:, d * (history - 1) :], past)[0] - x.numpy()
    assert np.sqrt(np.square(off).mean()) < 1e-6
    assert np.abs(off).max() < 1e-5


@pytest.mark.parametrize("path", GAINS, ids=named)
def test_tuned_gains_are_off_the_edges_at_equal_budgets_and_within_the_limit(path: Path) -> None:
    stored = json.loads(path.read_text())
    assert stored.keys() <= {*names(learned=False)}
    budgets = {name: entry["tuning"]["budget"]["episodes"] for name, entry in stored.items()}
    # Plans take time: fewer episodes.
    assert budgets.pop("nmpc", 0) <= min(budgets.values())
    assert len(set(budgets.values())) == 1
    for name, entry in stored.items():
        tuning = entry["tuning"]
        assert tuning["at_edge"] == [], name
        first, last = tuning["seeds"]["search"][0], tuning["seeds"]["final"][1]
        assert 1_000_000 <= first < last < 2_000_000
        limit = tuning["effort_limit"]
        assert limit is None or tuning["effort"] <= 1.001 * limit, name


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES}), ids=named)
def test_learned_policies_beat_what_they_are_set_against(folder: Path) -> None:
    made = environment(folder)
    errors = {}
    stems = {path.stem.rsplit("-", 1)[0] for path in folder.glob("*.safetensors")}
    learned = [name for name in names(learned=True) if name.replace("/", "-") in stems]
    for name in (BASE[folder.parents[1].name], *learned):
        # Bounds see the true state.
        sight = {"disturbance": {"base": "storm", "noise": None}} if is_bound(name) else {}
        envs = gym.make_vec(**made, **sight, num_envs=32)
        with policies_in(MORE):
            controller = make_controller(name, envs)
        errors[name] = np.median(pose_rms(run_episodes(envs, controller, 500_000, made["max_episode_steps"])))
    assert all(errors[name] < errors[BASE[folder.parents[1].name]] for name in learned), errors
    rivals = [error for name, error in errors.items() if not is_bound(name)]
    assert all(error < min(rivals) for name, error in errors.items() if is_bound(name)), errors


@pytest.mark.parametrize("script", sorted(TRAINING.glob("*.py")), ids=lambda path: path.name)
def test_a_script_compiles(script: Path, tmp_path: Path) -> None:
    py_compile.compile(str(script), cfile=str(tmp_path / "compiled"), doraise=True)


def test_a_policy_is_finished_where_its_run_took_all_steps(tmp_path: Path) -> None:
    file = tmp_path / "policy.safetensors"
    assert not is_finished(file)
    notes = {"hyperparameters": json.dumps({"n_timesteps": 6_000_000})}
    for steps, finished in (("369152", False), ("6000000", True), ("6000640", True)):
        random_policy(notes={**notes, "steps": steps}).save(file)
        assert is_finished(file) is finished
    file.write_bytes(file.read_bytes()[:-1])
    assert not is_finished(file)
    random_policy().save(file)
    assert not is_finished(file)
    assert all(map(is_finished, FILES))
