"""Neural policies as C and ONNX, over whole episodes against the native policy."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import SMALL, layers

from uvms_gym import MLP, PID, check_contract, export_policy, make_controller
from uvms_gym.cli import main
from uvms_gym.export.policy import ERRORS, policy_model

ort = pytest.importorskip("onnxruntime")

from exported import BOUND, CC, FLAGS, CPolicy, OnnxPolicy, Vehicle, values_of  # noqa: E402

needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler `cc` on this machine")
STORM = "UVMS-StationKeep-Storm-v0"


def random_policy(env: Any, sizes: tuple[int, ...] = (24,), seed: int = 0, **arguments: Any) -> MLP:
    """A network that looks random, for an environment."""
    d, a = env.observation_space.shape[0], env.action_space.shape[0]
    return MLP(env, **(layers((d * arguments.get("history", 1), *sizes, a), seed) | arguments))


def episodes(env: Any, policy: MLP, count: int = 2) -> Any:
    """Observation and action of every control instant, and whether an episode begins."""
    for seed in range(count):
        (observation, _), state, over, first = env.reset(seed=seed), None, False, True
        while not over:
            action, state = policy.predict(observation, state)
            yield first, observation, action
            observation, _, terminated, truncated, _ = env.step(action)
            over, first = terminated or truncated, False


#: Networks of all kinds.
KINDS: dict[str, dict[str, Any]] = {
    "tanh": {},
    "relu": {"activation": "relu"},
    "elu": {"activation": "elu"},
    "squashed": {"output": "tanh"},
    "deep": {"sizes": (17, 9, 5)},
    "linear": {"sizes": ()},
    "stacked": {"history": 4},
    "normalised": {"history": 3, "normalised": True, "activation": "elu", "output": "tanh"},
}


def of_kind(env: Any, kind: str) -> MLP:
    given = dict(KINDS[kind])
    if given.pop("normalised", False):
        rng, n = np.random.default_rng(5), env.observation_space.shape[0] * given["history"]
        given |= {"mean": rng.normal(size=n), "variance": rng.uniform(0.01, 2.0, size=n), "clip": 2.0, "epsilon": 1e-4}
    return random_policy(env, **given)


@needs_cc
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_file_has_the_bits_of_the_native_policy(kind: str, tmp_path: Path) -> None:
    env = gymnasium.make(STORM, scene=SMALL)
    policy = of_kind(env, kind)
    export_policy(policy, tmp_path / "policy.c", env)
    rng, a, d = np.random.default_rng(1), env.action_space.shape[0], env.observation_space.shape[0]
    for flags in ((), ("-O3", "-march=native")):
        made = CPolicy(tmp_path / "policy.c", *flags)
        state = None
        for k in range(300):
            observation = (rng.normal(size=d) * 10.0 ** rng.uniform(-3, 2)).astype(np.float32)
            expected, state = policy.predict(observation, state)
            assert made.act(observation, a).tobytes() == expected.tobytes(), k


@pytest.mark.parametrize("form", [pytest.param("c", marks=needs_cc), "onnx"])
@pytest.mark.parametrize("env", [STORM, "UVMS-EETrack-Storm-v0"])
def test_a_shipped_policy_acts_alike_over_whole_episodes(env: str, form: str, tmp_path: Path) -> None:
    made = gymnasium.make(env, max_episode_steps=150)
    policy: Any = make_controller("ppo", made)
    file = tmp_path / f"policy.{form}"
    export_policy(policy, file, made)
    model, exported = policy_model(policy, made), CPolicy(file) if form == "c" else OnnxPolicy(file)
    assert model.history > 1
    for seed in range(2):
        (observation, _), state, over = made.reset(seed=seed), None, False
        exported.reset()
        while not over:
            # The loop is closed by the exported policy: with measurements from another loop its actions are not stable.
            seen, acted = exported.step(model, values_of(observation, model))
            expected, state = policy.predict(observation, state)
            np.testing.assert_allclose(seen, observation, rtol=BOUND, atol=BOUND)
            np.testing.assert_allclose(acted, expected, rtol=0.0, atol=BOUND)
            observation, _, terminated, truncated, _ = made.step(acted)
            over = terminated or truncated


@pytest.mark.parametrize("form", [pytest.param("c", marks=needs_cc), "onnx"])
@pytest.mark.parametrize("delay", [0, 3])
def test_missing_measurements_and_resets_act_as_the_contract_says(form: str, delay: int, tmp_path: Path) -> None:
    env = gymnasium.make(STORM, max_episode_steps=60)
    policy = random_policy(env, history=4)
    contract = json.loads(export_policy(policy, file := tmp_path / f"policy.{form}", env, delay=delay).read_text())
    model = policy_model(policy, env, delay=delay)
    exported, vehicle = CPolicy(file) if form == "c" else OnnxPolicy(file), Vehicle(policy, contract)
    rng = np.random.default_rng(2)
    for k, (first, observation, _) in enumerate(episodes(env, policy, 3)):
        if first:
            exported.reset()
            vehicle.reset()
        values = values_of(observation, model)
        # The first of an episode, too; now and then all at once.
        missing = rng.uniform(size=model.inputs) < rng.choice([0.0, 0.3, 1.0], p=[0.6, 0.3, 0.1])
        values[missing] = rng.choice([np.nan, np.inf, -np.inf], size=missing.sum())
        # Some far beyond their limits, late in the episode: the integral stays there.
        values[k % model.inputs] *= 1e5 if k % 60 > 50 else 1.0
        for found, expected in zip(exported.step(model, values), vehicle.step(model, values), strict=True):
            if form == "c":
                assert found.tobytes() == expected.tobytes()
            np.testing.assert_allclose(found, expected, rtol=BOUND, atol=BOUND)


@needs_cc
@pytest.mark.parametrize("env", ["StationKeep", "EETrack", "Dock", "Button", "Valve"])
def test_a_further_delay_is_the_delay_of_the_simulator(env: str, tmp_path: Path) -> None:
    made = gymnasium.make(f"UVMS-{env}-v0", disturbance={"delay": {"periods": 2}}, max_episode_steps=40)
    policy = random_policy(made)
    export_policy(policy, tmp_path / "policy.c", made, delay=2)
    model, exported, inner = policy_model(policy, made, delay=2), CPolicy(tmp_path / "policy.c"), made.unwrapped
    # Blocks that the task forms from late measurements and present references.
    formed = ["preview", "reference_twist"]
    compared = [entry["block"] not in formed for entry in model.contract["observation"][: model.inputs]]
    for first, observation, _ in episodes(made, policy):
        if first:
            exported.reset()
        present = inner._native.perfect_observations()[0]  # type: ignore[attr-defined]
        seen, _ = exported.step(model, values_of(present, model))
        # All but the last action, which is that of other entries.
        for part in (np.flatnonzero(compared), np.arange(-ERRORS, 0)):
            np.testing.assert_allclose(seen[part], observation[part], rtol=BOUND, atol=BOUND)


def test_rows_of_the_graph_are_independent(tmp_path: Path) -> None:
    env = gymnasium.make(STORM, scene=SMALL)
    policy = random_policy(env, history=3)
    export_policy(policy, tmp_path / "policy.onnx", env, delay=1)
    several, one = OnnxPolicy(tmp_path / "policy.onnx"), OnnxPolicy(tmp_path / "policy.onnx")
    rows = np.random.default_rng(0).normal(size=(5, 4, policy_model(policy, env).inputs))
    several.reset(4)
    together = np.array([several.steps(values)[1] for values in rows])
    for k in range(4):
        one.reset()
        alone = np.array([one.steps(values[k : k + 1])[1][0] for values in rows])
        np.testing.assert_allclose(together[:, k], alone, rtol=0.0, atol=BOUND)


@needs_cc
def test_the_c_file_needs_nothing_but_the_state_and_fma(tmp_path: Path) -> None:
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("no `nm` on this machine")
    env = gymnasium.make(STORM, scene=SMALL)
    export_policy(of_kind(env, "normalised"), tmp_path / "policy.c", env, delay=2)
    subprocess.run([str(CC), *FLAGS, "-Wextra", "-pedantic", "-O2", "-c", "policy.c"], cwd=tmp_path, check=True)
    table = subprocess.run([nm, "-P", "policy.o"], cwd=tmp_path, check=True, capture_output=True, text=True).stdout
    kinds: dict[str, set[str]] = {}
    for line in table.splitlines():
        kinds.setdefault(line.split()[1], set()).add(line.split()[0])
    # Functions, constants, and what the linker adds; no data that can change.
    assert kinds.keys() <= set("TtrRU") and kinds["U"] <= {"fma", "fmaf", "memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}
    assert kinds["T"] == {f"policy_{name}" for name in ("reset", "observe", "act", "step")}


def test_the_contract_beside_the_file_is_that_of_the_training(tmp_path: Path) -> None:
    env = gymnasium.make(STORM)
    policy, calm = make_controller("shac-distilled", env), gymnasium.make(STORM, disturbance="calm")
    file = export_policy(policy, tmp_path / "policy.onnx", calm, delay=1)
    assert file == tmp_path / "policy.contract.json"
    found = check_contract(file, env)
    assert found["further_delay"] == 1 and found["delay"] == [1, 1] and found["rate"] == pytest.approx(10.0)
    assert [entry["name"] for entry in found["observation"]][: len(found["inputs"])] == found["inputs"]
    assert "previous_action[0]" not in found["inputs"]
    with pytest.raises(ValueError, match="delay is 0 instead of 1 control periods"):
        check_contract(file, calm)
    # Also in the graph.
    inside = ort.InferenceSession(tmp_path / "policy.onnx").get_modelmeta().custom_metadata_map["contract"]
    assert json.loads(inside) == found


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda env: PID(env),
            "PID cannot be exported; neural policies can: mlp:FILE, and families such as ppo and shac",
        ),
        (lambda env: make_controller("residual", env), "Residual cannot be exported"),
        (lambda env: make_controller("mpc", env), "MPC cannot be exported"),
        (lambda env: random_policy(gymnasium.make(STORM, substeps=5)), "its control period is 0.050000000 s"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(make: Callable[[Any], Any], words: str, tmp_path: Path) -> None:
    env = gymnasium.make(STORM)
    with pytest.raises(ValueError) as caught:
        export_policy(make(env), tmp_path / "policy.c", env)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    env = gymnasium.make(STORM, scene=SMALL)
    export_policy(random_policy(env), tmp_path / "policy.c", env)
    with pytest.raises(ModuleNotFoundError, match=r"^onnx is not installed; run: pip install 'uvms-gym\[onnx\]'$"):
        export_policy(random_policy(env), tmp_path / "policy.onnx", env)


def test_the_command_exports_a_policy_for_the_environment_of_its_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    env = gymnasium.make(STORM, scene=SMALL)
    notes = {"environment": STORM, "env_kwargs": json.dumps({"scene": SMALL})}
    random_policy(env, notes=notes).save("own.safetensors")
    assert main(["export", "mlp:own.safetensors", "--onnx", "own.onnx", "--c", "own.c", "--delay", "2"]) == 0
    assert capsys.readouterr().out.splitlines() == [f"wrote own.{end} and own.contract.json" for end in ("onnx", "c")]
    assert check_contract("own.contract.json", env)["further_delay"] == 2
    text = Path("own.c").read_text()
    assert "own.contract.json" in text and check_contract("own.contract.json", env)["scene"]["digest"] in text
    for given, words in (
        ("mlp:own.safetensors --c own.c", "own.c exists: give another --c, or --force to overwrite it"),
        ("mlp:own.safetensors", "at least one of --onnx and --c is needed"),
        ("mlp:own.safetensors --c x.cpp", "--c is 'x.cpp', but must end in .c"),
        ("mlp:own.safetensors --c /proc/x.c", "cannot write /proc/x.c: No such file or directory"),
        ("mlp:own.safetensors --c x.c --delay 101", "--delay is 101, but must be 0 to 100"),
        ("mlp:own.c --c x.c", "own.c: not a policy of uvms_gym"),
        (f"mlp:own.safetensors --c x.c --env {STORM}", "its scene is bluerov2-heavy, the environment's petasus-pum"),
        ("ppo --c x.c", "POLICY is 'ppo': give its environment by --env"),
        (f"nmpc --env {STORM} --c x.c", "nmpc: NMPC cannot be exported; neural policies can: mlp:FILE"),
        ("mlp:none.safetensors --c x.c", "none.safetensors"),
    ):
        assert main(["export", *given.split()]) == 2, given
        line = capsys.readouterr().err
        assert line.count("\n") == 1 and words in line
    assert sorted(file.name for file in tmp_path.iterdir()) == [
        *("own.c", "own.contract.json", "own.onnx", "own.safetensors"),
    ]
