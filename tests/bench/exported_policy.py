"""Time of a call of exported policies: the C file at several flags, the ONNX graph, and the native policy.

    python tests/bench/exported_policy.py [--out docs/_static/exported-policy.json]

Each is called with the same physical values on one thread; minima of interleaved rounds.
"""

import argparse
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import onnxruntime

from uvms_gym import export_policy, make_controller
from uvms_gym.export.policy import policy_model
from uvms_gym.studies.records import circumstances, write_json

ENVS = {"UVMS-StationKeep-Storm-v0": "shac-distilled", "UVMS-EETrack-Storm-v0": "shac"}
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


def main() -> None:
    """Time the shipped policies and write minima."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("docs/_static/exported-policy.json"))
    out, rows = parser.parse_args().out, []
    for env_id, name in ENVS.items():
        env = gymnasium.make(env_id)
        policy: Any = make_controller(name, env)
        model = policy_model(policy, env)
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
        minima = {label: min(times) for label, times in found.items()}
        rows.append({"env": env_id, "policy": name, "sizes": policy.sizes, "microseconds": minima})
        print(env_id, name, policy.sizes, {label: round(value, 2) for label, value in minima.items()})
    write_json(out, {"circumstances": circumstances("tests/bench/exported_policy.py", {}), "rows": rows})


if __name__ == "__main__":
    main()
