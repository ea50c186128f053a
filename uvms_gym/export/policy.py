"""Neural policies as plain data for other programs: network, scaling, memory and contract."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym._task.options import native
from uvms_gym.controllers import MLP, Controller
from uvms_gym.controllers.base import given_options
from uvms_gym.controllers.contract import digest_of, policy_contract, refused
from uvms_gym.controllers.registry import training_contract

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
#: Blocks at the end of every observation, which the exported policy forms by itself.
_OWN = ("previous_action", "error_integral")
#: Blocks that sensors measure; a further delay holds only these back.
_MEASURED = (
    *("position_error", "attitude_error", "linear_velocity", "angular_velocity", "relative_velocity"),
    *("relative_angular_velocity", "up", "joint_position", "joint_rate"),
)
#: Numbers of the pose error at the start of every observation, which are integrated.
ERRORS = 6
#: Maximum further delay, control periods.
MOST_DELAY = 100


@dataclass(frozen=True)
class PolicyModel:
    """A policy with all that surrounds its network.

    Attributes
    ----------
    contract : dict
        See `uvms_gym.policy_contract`, with `inputs`, `policy` and `further_delay`.
    layers : list of (weights (outputs, inputs), biases (outputs,))
    activation : {"tanh", "relu", "elu"}
    output : {"clip", "tanh"}
    history : int
        Number of stacked observations.
    normalisation : (mean, factor, clip) or None
        Of the stacked observations.
    scale, bound : (d,)
        Physical value of an entry of 1, and its maximum magnitude.
    delayed : (m,), bool
        Inputs that a further delay holds back.
    delay : int
        Further delay, control periods.
    """

    contract: dict[str, Any]
    layers: list[tuple[Singles, Singles]]
    activation: str
    output: str
    history: int
    normalisation: tuple[Singles, Singles, np.float32] | None
    scale: Floats
    bound: Floats
    delayed: NDArray[np.bool_]
    delay: int

    @property
    def inputs(self) -> int:
        """Number of physical values that a call reads."""
        return len(self.delayed)

    @property
    def observation(self) -> int:
        """Entries of an observation."""
        return len(self.scale)

    @property
    def actions(self) -> int:
        """Entries of an action."""
        return len(self.layers[-1][1])

    @property
    def past(self) -> int:
        """Entries of the observations before the present one."""
        return (self.history - 1) * self.observation


def policy_model(policy: Controller, env: Any = None, *, delay: int = 0, **options: Any) -> PolicyModel:
    """Policy as plain data.

    Parameters
    ----------
    policy : Controller
        An `MLP` that is not a residual policy.
    env : UVMS environment or None
        Environment of the policy.
    delay : int
        Further delay of the measurements, control periods: for a vehicle whose sensors are faster than in the training.
    **options
        Without `env`: arguments of its environment, and `task`.

    Raises
    ------
    TypeError, ValueError
        Another controller, environment or delay.
    """
    if not isinstance(policy, MLP) or policy.residual:
        kind = "a residual policy" if isinstance(policy, MLP) else type(policy).__name__
        raise ValueError(f"{kind} cannot be exported; neural policies can: mlp:FILE, and families such as ppo and shac")
    if not 0 <= delay <= MOST_DELAY:
        raise ValueError(f"delay is {delay}, but must be 0 to {MOST_DELAY} control periods")
    given = given_options("policy", env, options)
    policy.native.check(native(given), residual=False)
    data, here, training = policy.native.to_bytes(), policy_contract(**given), training_contract(policy)
    if apart := list(refused(training, here)):
        raise ValueError(f"the policy does not fit: {'; '.join(apart)}")
    # The conditions are those of the training, if known.
    contract = {**here, **training}
    if contract["action_kind"] == "residual":
        raise ValueError("actions of kind residual cannot be exported; those of kind wrench and thrusters can")
    header, tensors = _read(data)
    entries = contract["observation"]
    inputs = [entry for entry in entries if entry["block"] not in _OWN]
    normalisation = None
    if (bounds := header["normalisation"]) is not None:
        mean, variance = tensors["observation.mean"], tensors["observation.variance"].astype(np.float64)
        factor = (1.0 / np.sqrt(variance + np.float64(np.float32(bounds["epsilon"])))).astype(np.float32)
        normalisation = mean, factor, np.float32(bounds["clip"])
    count = len(header["sizes"]) - 1
    contract["inputs"] = [entry["name"] for entry in inputs]
    contract["further_delay"] = delay
    contract["policy"] = {
        "digest": digest_of(policy),
        **{key: header[key] for key in ("sizes", "activation", "output", "history")},
    }
    return PolicyModel(
        contract=contract,
        layers=[(tensors[f"layers.{k}.weight"], tensors[f"layers.{k}.bias"]) for k in range(count)],
        activation=header["activation"],
        output=header["output"],
        history=header["history"],
        normalisation=normalisation,
        scale=np.array([entry["scale"] for entry in entries]),
        bound=np.array([entry["high"] / entry["scale"] for entry in entries]).astype(np.float32).astype(np.float64),
        delayed=np.array([entry["block"] in _MEASURED for entry in inputs]),
        delay=delay,
    )


def _read(data: bytes) -> tuple[dict[str, Any], dict[str, Singles]]:
    """Header and tensors of a policy's file."""
    length = int.from_bytes(data[:8], "little")
    table, body = json.loads(data[8 : 8 + length]), data[8 + length :]
    header: dict[str, Any] = json.loads(table.pop("__metadata__")["uvms_gym"])
    tensors = {
        name: np.frombuffer(body[slice(*entry["data_offsets"])], "<f4").reshape(entry["shape"])
        for name, entry in table.items()
    }
    return header, tensors
