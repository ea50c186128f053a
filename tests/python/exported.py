"""Exported policies in their C and ONNX form, and the native policy on the same physical values."""

import ctypes
import shutil
import subprocess
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort

from uvms_gym import MLP
from uvms_gym.export.policy import ERRORS, PolicyModel

CC = shutil.which("cc")
#: The flags that every file must compile with, without a warning.
FLAGS = ("-std=c99", "-Wall", "-Werror")
#: Bound on entries of actions and observations over an episode: two units in the last place of 1.
BOUND = 2.4e-7
POINTER = ctypes.c_void_p


class CPolicy:
    """A policy's C file, compiled, with a state between guards."""

    def __init__(self, file: Path, *flags: str) -> None:
        wrapped, library = file.with_name("wrapped.c"), file.with_name(f"wrapped{len(flags)}.so")
        wrapped.write_text(f'#include "{file}"\nunsigned long size(void) {{ return sizeof(policy_state); }}\n')
        subprocess.run([str(CC), *FLAGS, *flags, "-shared", "-fPIC", "-o", library, wrapped, "-lm"], check=True)
        self.library = ctypes.CDLL(str(library))
        self.library.size.restype = ctypes.c_ulong
        self.size = self.library.size()
        self.memory = np.full(self.size + 32, 0xA5, dtype=np.uint8)
        self.reset()

    def call(self, name: str, *arrays: np.ndarray) -> None:
        pointers = (POINTER(array.ctypes.data) for array in arrays)
        getattr(self.library, f"policy_{name}")(POINTER(self.memory.ctypes.data + 16), *pointers)
        assert (self.memory[:16] == 0xA5).all() and (self.memory[16 + self.size :] == 0xA5).all()

    def reset(self) -> None:
        self.call("reset")

    def act(self, observation: np.ndarray, actions: int) -> np.ndarray:
        action = np.empty(actions, dtype=np.float32)
        self.call("act", np.ascontiguousarray(observation), action)
        return action

    def step(self, model: PolicyModel, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Observation and action."""
        observation = np.empty(model.observation, dtype=np.float32)
        self.call("observe", np.ascontiguousarray(values), observation)
        return observation, self.act(observation, model.actions)


class OnnxPolicy:
    """A policy's ONNX file, with its memory."""

    def __init__(self, file: Path) -> None:
        options = ort.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = ort.InferenceSession(file, options, providers=["CPUExecutionProvider"])
        self.outputs = [one.name for one in self.session.get_outputs()]
        self.reset()

    def reset(self, rows: int = 1) -> None:
        kinds = {"tensor(double)": np.float64, "tensor(float)": np.float32, "tensor(bool)": np.bool_}
        found = [one for one in self.session.get_inputs() if one.name != "input"]
        self.state = {one.name: np.zeros((rows, one.shape[1]), dtype=kinds[one.type]) for one in found}

    def steps(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Observations and actions for rows of values."""
        given = dict(zip(self.outputs, self.session.run(None, {"input": values, **self.state}), strict=True))
        self.state = {name: given[f"next_{name}"] for name in self.state}
        return given["observation"], given["action"]

    def step(self, model: PolicyModel, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        observation, action = self.steps(values[None])
        return observation[0], action[0]


class Vehicle:
    """Observation from physical values, as the contract says it, and the native policy on it."""

    def __init__(self, policy: MLP, contract: dict[str, Any]) -> None:
        self.policy, self.contract, self.entries = policy, contract, contract["observation"]
        self.reset()

    def reset(self) -> None:
        self.last = np.full(len(self.contract["inputs"]), np.nan)
        self.integral, self.action = np.zeros(ERRORS), np.zeros(len(self.contract["action"]), dtype=np.float32)
        self.past: list[np.ndarray] = []
        self.state: Any = np.zeros(self.policy.native.widths[1])

    def step(self, model: PolicyModel, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.last = np.where(np.isfinite(values), values, self.last)
        self.past = [*(self.past or [self.last] * model.delay), self.last]
        used = np.where(model.delayed, self.past[-1 - model.delay], self.last)
        if len(self.past) > model.delay + 1:
            keep, gain = self.contract["integral"]["keep"], self.contract["integral"]["gain"]
            for k, error in enumerate(used[:ERRORS]):
                if np.isfinite(error):
                    # One rounding of the product and sum.
                    product = Fraction(float(error)) * Fraction(gain)
                    self.integral[k] = float(product + Fraction(float(self.integral[k]) * keep))
        physical = np.concatenate([used, self.action, self.integral])
        scale = np.array([entry["scale"] for entry in self.entries])
        bound = np.array([entry["high"] / entry["scale"] for entry in self.entries], dtype=np.float32).astype(float)
        scaled = np.clip(np.where(np.isnan(physical), np.inf, physical) * (1.0 / scale), -bound, bound)
        observation = scaled.astype(np.float32)
        self.action, self.state = self.policy.predict(observation, self.state)
        return observation, self.action


def values_of(observation: np.ndarray, model: PolicyModel) -> np.ndarray:
    """Physical values of the inputs."""
    return (observation.astype(np.float64) * model.scale)[: model.inputs]
