"""Every shipped policy as C and ONNX: agreement with the native policy over whole episodes, and time of a call.

    python tests/bench/exported_policy.py [--out docs/_static/exported-policy.json]

Agreement: two episodes of the training's environment with a reset between them, without and with drop-outs, and with
drop-outs where the environment has no delay and the exported policy holds the measurements back. Time: the C file at
several flags, the ONNX graph, and the native policy on the same values, on one thread; minima of interleaved rounds.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnxruntime

import uvms_gym
from uvms_gym import MLP, check_contract, export_policy, policy_contract
from uvms_gym.export.policy import PolicyModel, policy_model
from uvms_gym.studies.records import circumstances, write_json

sys.path.insert(0, str(Path(__file__).parents[1] / "python"))
from exported import CPolicy, OnnxPolicy, Vehicle, values_of

#: Policies whose calls are timed.
TIMED = {("UVMS-StationKeep", "shac-distilled"), ("UVMS-EETrack", "shac")}
EPISODES = 2
FLAGS = ("-O2", "-O2 -march=native", "-O3 -march=native")
CALLS, ROUNDS = 100, 101
_MAIN = """
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "policy.c"
int main(void) {{
    static policy_state state;
    double input[POLICY_INPUTS] = {{0.0}};
    float action[POLICY_ACTIONS];
    struct timespec from, to;
    int k;
    policy_reset(&state);
    clock_gettime(CLOCK_MONOTONIC, &from);
    for (k = 0; k < {calls}; k++) {{
        input[k % POLICY_INPUTS] = 0.001 * (k % 97);
        policy_step(&state, input, action);
    }}
    clock_gettime(CLOCK_MONOTONIC, &to);
    printf("%.17g", ((to.tv_sec - from.tv_sec) * 1e9 + (to.tv_nsec - from.tv_nsec)) / {calls} * 1e-3);
    return action[0] != action[0];
}}
"""


def c_call(folder: Path, number: int, flags: str) -> Callable[[], float]:
    """Time of a call of the C file, us."""
    (folder / "main.c").write_text(_MAIN.format(calls=CALLS))
    program = folder / f"time{number}"
    subprocess.run(
        ["cc", "-std=c99", "-Wall", "-Werror", *flags.split(), "-o", program, folder / "main.c", "-lm"], check=True
    )
    return lambda: float(subprocess.run([program], check=True, capture_output=True, text=True).stdout)


def timed(call: Callable[[], Any]) -> float:
    """Time of a call from Python, us."""
    begun = time.perf_counter()
    for _ in range(CALLS):
        call()
    return (time.perf_counter() - begun) / CALLS * 1e6


def shipped() -> Iterator[tuple[str, str, Path]]:
    """Task, name and file of every shipped policy."""
    folder = Path(uvms_gym.__file__).parent / "pretrained"
    for file in sorted(folder.glob("*/*/*/*.safetensors")):
        yield file.relative_to(folder).parts[0], file.stem.rpartition("-")[0], file


def agreement(policy: MLP, env: Any, delay: int, dropouts: bool, form: str) -> dict[str, Any]:
    """Calls, and how far an exported policy is from the native one on observations by the contract."""
    model, rng = policy_model(policy, env, delay=delay), np.random.default_rng(0)
    found = {"form": form, "further_delay": delay, "dropouts": dropouts, "calls": 0, "missing": 0, "different_bits": 0}
    largest = {"observation": 0.0, "action": 0.0}
    with tempfile.TemporaryDirectory() as folder:
        contract = export_policy(policy, file := Path(folder, f"policy.{form}"), env, delay=delay)
        reference = Vehicle(policy, json.loads(contract.read_text()))
        exported = CPolicy(file) if form == "c" else OnnxPolicy(file)
        for seed in range(EPISODES):
            for one in (reference, exported):
                one.reset()
            (observation, _), over = env.reset(seed=seed), False
            while not over:
                values = values_of(observation, model)
                if dropouts:
                    missing = rng.uniform(size=model.inputs) < rng.choice([0.0, 0.3, 1.0], p=[0.6, 0.3, 0.1])
                    values[missing] = np.nan
                    found["missing"] += int(missing.sum())
                expected, given = reference.step(model, values), exported.step(model, values)
                found["calls"] += 1
                found["different_bits"] += any(e.tobytes() != g.tobytes() for e, g in zip(expected, given))
                for name, e, g in zip(largest, expected, given):
                    largest[name] = max(largest[name], float(np.abs(e - g).max()))
                # The exported policy closes the loop, and its action is the last one of both.
                reference.action = given[1]
                observation, _, terminated, truncated, _ = env.step(given[1])
                over = terminated or truncated
    return {**found, "largest_difference": largest}


def refusal(policy: MLP, env: Any, other: Any) -> str:
    """Refusal of another environment by the exported contract."""
    with tempfile.TemporaryDirectory() as folder:
        contract = export_policy(policy, Path(folder, "policy.c"), env)
        check_contract(contract, env, controller=policy)
        try:
            check_contract(contract, other)
        except ValueError as error:
            return str(error).partition(": ")[2]
    raise AssertionError("another environment is not refused")


def call_times(policy: MLP, model: PolicyModel, env: Any) -> dict[str, float]:
    """Minima of the times of a call, us."""
    with tempfile.TemporaryDirectory() as folder:
        for ending in ("c", "onnx"):
            export_policy(policy, Path(folder, f"policy.{ending}"), env)
        calls = {f"C, {flags}": c_call(Path(folder), k, flags) for k, flags in enumerate(FLAGS)}
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        session = onnxruntime.InferenceSession(Path(folder, "policy.onnx"), options)
        kinds = {"tensor(double)": np.float64, "tensor(float)": np.float32, "tensor(bool)": np.bool_}
        feed = {one.name: np.zeros((1, one.shape[1]), dtype=kinds[one.type]) for one in session.get_inputs()}
        calls["ONNX Runtime"] = partial(timed, partial(session.run, None, feed))
        observation, state = np.zeros((1, model.observation), np.float32), np.zeros((1, policy.native.widths[1]))
        calls["native, from Python"] = partial(timed, partial(policy.native.act, observation, state))
        found: dict[str, list[float]] = {label: [] for label in calls}
        for _ in range(ROUNDS):
            for label, call in calls.items():
                found[label].append(call())
    return {label: min(times) for label, times in found.items()}


def main() -> None:
    """Compare and time the shipped policies, print and write all; no difference is left without an error."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("docs/_static/exported-policy.json"))
    out, rows = parser.parse_args().out, []
    for task, name, file in shipped():
        policy: Any = MLP.load(file, residual=True)
        row: dict[str, Any] = {"task": task, "policy": name, "sizes": policy.sizes, "history": policy.history}
        rows.append(row)
        env_id, arguments = policy.notes["environment"], json.loads(policy.notes.get("env_kwargs", "{}"))
        env = gymnasium.make(env_id, **arguments)
        row["env"] = env_id
        if policy.residual:
            try:
                policy_model(policy, env)
            except ValueError as error:
                row["refused"] = str(error)
            print(env_id, name, row["refused"], flush=True)
            continue
        level = {"base": policy_contract(env)["level"], "delay": {"periods": 0}}
        prompt = gymnasium.make(env_id, **{**arguments, "disturbance": level})
        cases = ((env, 0, False), (env, 0, True), (prompt, 1, True))
        row["agreement"] = [agreement(policy, *case, form) for form in ("c", "onnx") for case in cases]
        row["mismatch"] = refusal(policy, env, gymnasium.make(env_id, **{**arguments, "thruster_lag": 0.3}))
        if (task, name) in TIMED:
            row["microseconds"] = call_times(policy, policy_model(policy, env), env)
        print(env_id, name, policy.sizes, row, flush=True)
        for one in row["agreement"]:
            assert max(one["largest_difference"].values()) <= 1e-6, one
            assert one["form"] == "onnx" or one["different_bits"] == 0, one
    write_json(out, {"circumstances": circumstances("tests/bench/exported_policy.py", {}), "rows": rows})


if __name__ == "__main__":
    main()
