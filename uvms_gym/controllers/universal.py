"""One policy of station keeping for any vehicle: a map from a vehicle's physics to an ordinary neural policy.

The policy sees errors, velocities and its own past actions as accelerations relative to those that the vehicle reaches,
and acts in such accelerations. Both are linear for one vehicle, so that there the policy is an `MLP`: it runs, is
differentiated and exported as any other. Each axis has units of its own, whose weights are mixtures by the axis's
constants (`FEATURES`) of those of a few experts; further units see all axes. Units of an axis have no biases: opposite
errors have opposite actions.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from uvms_gym._files import read, write
from uvms_gym._task.options import native
from uvms_gym.controllers.base import given_options, options_of
from uvms_gym.controllers.contract import policy_contract
from uvms_gym.controllers.mlp import MLP
from uvms_gym.controllers.plant import FEATURES, NOISE, SEEN, Floats, Plant, mean_lag, plant, stack_shares

#: Form of the files.
FORM = "uvms-universal/1"
#: Control period of the policy, s.
PERIOD = 0.1
#: Usual lag of the thrusters in the training, s.
LAG = 0.1


class Weights(NamedTuple):
    """Weights of the policy for one vehicle, arrays of numpy or tensors of torch.

    Attributes
    ----------
    axis_in : (6, k, s, f)
        From averages s of the quantities f along an axis to its units.
    shared_in : (m, s, f, 6)
        From all of them to the shared units.
    shared_bias : (m,)
    axis_hidden : (6, l, k)
    shared_hidden : (6, l, m)
    out : (6, l)
        To the acceleration along the axis.
    """

    axis_in: Any
    shared_in: Any
    shared_bias: Any
    axis_hidden: Any
    shared_hidden: Any
    out: Any


def weights(xp: Any, given: Mapping[str, Any], features: Any) -> Weights:
    """Weights for a vehicle with these features (6, p), by parameters of numpy (`xp` is numpy) or of torch."""
    mixed = xp.tanh(xp.einsum("ip,hp->ih", features, given["mix_in"]) + given["mix_bias"])
    mix = xp.einsum("ih,eh->ie", mixed, given["mix_out"]) + given["mix_offset"]
    scale_in = xp.exp(xp.einsum("ip,fp->if", features, given["scale_in"]))
    scale_out = xp.exp(xp.einsum("ip,p->i", features, given["scale_out"]))
    return Weights(
        axis_in=xp.einsum("ie,eksf->iksf", mix, given["axis_in"]) * scale_in[:, None, None, :],
        shared_in=given["shared_in"],
        shared_bias=xp.einsum("ip,mip->m", features, given["shared_bias"]),
        axis_hidden=xp.einsum("ie,elk->ilk", mix, given["axis_hidden"]),
        shared_hidden=given["shared_hidden"],
        out=xp.einsum("ie,el->il", mix, given["out"]) * scale_out[:, None],
    )


def fold(given: Mapping[str, Any], spans: Sequence[int], at: Plant) -> tuple[list[Floats], list[Floats]]:
    """Weights and biases of the ordinary network that the policy is for a vehicle, on stacked observations."""
    own, shares = weights(np, given, at.features), stack_shares(spans)
    (axes, units, _, _), shared, hidden = own.axis_in.shape, len(own.shared_in), own.axis_hidden.shape[1]
    by_axis = np.einsum("iksf,fid->iksd", own.axis_in, at.seen).reshape(axes * units, len(spans), -1)
    averaged = np.concatenate([by_axis, np.einsum("msfi,fid->msd", own.shared_in, at.seen)])
    first = np.einsum("ksd,sh->khd", averaged, shares).reshape(len(averaged), -1)
    second = np.zeros((axes * hidden, axes * units + shared))
    for i in range(axes):
        rows = slice(i * hidden, (i + 1) * hidden)
        second[rows, i * units : (i + 1) * units] = own.axis_hidden[i]
        second[rows, axes * units :] = own.shared_hidden[i]
    last = np.einsum("ai,il->ail", at.acted, own.out).reshape(len(at.acted), axes * hidden)
    biases = [np.concatenate([np.zeros(axes * units), own.shared_bias]), np.zeros(axes * hidden), np.zeros(len(last))]
    return [first, second, last], biases


@dataclass(frozen=True)
class UniversalPolicy:
    """Policy for any vehicle.

    Attributes
    ----------
    parameters : mapping of str to array
        As `weights` takes them.
    spans : tuple of int
        Number of successive observations in each average, oldest first.
    limits : (2, p)
        Least and largest features of the training; those of other vehicles count as these.
    notes : mapping of str to str
        Seeds, steps, scores and, as JSON, `conditions` of the training: ranges of delay (control periods), lag (s) and
        noise (over the storm's).
    """

    parameters: Mapping[str, NDArray[np.float32]]
    spans: tuple[int, ...]
    limits: Floats
    notes: Mapping[str, str] = field(default_factory=dict)

    def network(self, env: Any = None, **options: Any) -> MLP:
        """The policy for the vehicle of an environment.

        Parameters
        ----------
        env : UVMS environment or None
        **options
            Without `env`: arguments of its environment, and `task`.

        Raises
        ------
        ValueError
            The task is another one, actions are no wrenches, the control period is not 0.1 s, or the thrusters do not
            push along some axis alone.
        """
        given = given_options("universal", env, options)
        contract = policy_contract(**given)
        found = (contract["task"], contract["action_kind"], round(contract["control_period"], 9))
        if found != ("UVMS-StationKeep", "wrench", PERIOD):
            raise ValueError(
                f"universal is for UVMS-StationKeep, actions wrench, control period {PERIOD:g} s, "
                f"not for {found[0]}, actions {found[1]}, control period {found[2]:g} s"
            )
        task = native(given)
        at = plant(task, contract["thruster_lag"], contract["disturbance"].get("noise"))
        layers, biases = fold(self.parameters, self.spans, at._replace(features=at.features.clip(*self.limits)))
        notes = {**self.notes, "contract": json.dumps(self._conditions(contract, task.scene))}
        return MLP(
            weights=layers, biases=biases, history=sum(self.spans), notes=notes, **options_of("MLP", env, options)
        )

    def _conditions(self, contract: dict[str, Any], scene: dict[str, Any]) -> dict[str, Any]:
        """Contract of the environment under the conditions of the training."""
        ranges = json.loads(self.notes["conditions"])
        (low, high), lag = ranges["lag"], contract["thruster_lag"]
        within = low <= (mean_lag(scene) if lag is None else lag) <= high
        storm = policy_contract(task="station-keep", disturbance="storm")["disturbance"]
        noise = {name: [0.0, ranges["noise"][1] * usual] for name, usual in NOISE.items()}
        return contract | {
            "delay": ranges["delay"],
            "thruster_lag": lag if within else LAG,
            "level": "storm",
            "disturbance": storm | {"noise": storm["noise"] | noise},
        }

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the policy to a safetensors file.

        Raises
        ------
        OSError
            The file cannot be written.
        """
        arrays = {name: np.asarray(array, dtype="<f4") for name, array in sorted(self.parameters.items())}
        form = {"form": FORM, "spans": self.spans, "limits": self.limits.tolist(), "notes": dict(self.notes)}
        header: dict[str, Any] = {"__metadata__": {"uvms_gym": json.dumps(form)}}
        end = 0
        for name, array in arrays.items():
            header[name] = {"dtype": "F32", "shape": array.shape, "data_offsets": (end, end := end + array.nbytes)}
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 8)
        write(file, len(text).to_bytes(8, "little") + text + b"".join(array.tobytes() for array in arrays.values()))

    @classmethod
    def load(cls, file: str | os.PathLike[str]) -> Self:
        """Read a policy from a file of `save`.

        Raises
        ------
        OSError
            The file cannot be read.
        ValueError
            It holds no policy for any vehicle, or one for other features.
        """
        data = read(file)
        try:
            start = 8 + int.from_bytes(data[:8], "little")
            header = json.loads(data[8:start])
            form = json.loads(header.pop("__metadata__")["uvms_gym"])
            if form["form"] != FORM:
                raise ValueError(f"form {form['form']}")
            parameters = {}
            for name, entry in header.items():
                begin, end = entry["data_offsets"]
                parameters[name] = np.frombuffer(data[start + begin : start + end], "<f4").reshape(entry["shape"])
            policy = cls(parameters, tuple(form["spans"]), np.array(form["limits"]), form["notes"])
            fold(parameters, policy.spans, _blank())
        except (LookupError, TypeError, ValueError) as error:
            raise ValueError(f"{os.fspath(file)}: no policy for any vehicle of this version: {error}") from None
        return policy


def _blank() -> Plant:
    """A vehicle without numbers."""
    return Plant(np.zeros((6, len(FEATURES))), np.zeros((len(SEEN), 6, 1)), np.zeros((6, 6)))
