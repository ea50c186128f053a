"""Estimates of the accumulated error against the true errors of the hard cases: share within a factor 3, by precision.

python tests/bench/estimate_accuracy.py [part of a name ...]
"""

import sys
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uvms_gym import Simulator
from uvms_gym.studies.hard_cases.case import DTYPES, CaseRunner, NonFinite, Quantities, methods
from uvms_gym.studies.hard_cases.study import select
from uvms_gym.studies.numerics import Floats

#: True errors that count, rad or m, and the factor.
RANGE, FACTOR = (1e-8, 0.1), 3.0
#: Quantities that are estimated.
NAMES = ("position", "attitude", "q")


@dataclass(frozen=True)
class Recorder(CaseRunner):
    """Runner that keeps the estimates at the samples of a single instance."""

    found: dict[str, list[float]] = field(default_factory=dict)

    def sampled(self, simulator: Simulator, times: Floats, observe: Any, **inputs: Any) -> Quantities:
        """As `CaseRunner.sampled`."""
        if callable(observe) or simulator.num_envs > 1:
            return super().sampled(simulator, times, observe, **inputs)
        rows = []
        for _ in times:
            rows.append(super().sampled(simulator, times[:1], observe, **inputs))
            estimate = simulator.error_estimate()
            for name in set(NAMES) & set(observe):
                self.found.setdefault(name, []).append(float(np.max(estimate[name])))
        return {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}


def error(name: str, value: Floats, reference: Floats) -> float:
    """Maximum absolute error of any sample, rad or m."""
    difference = np.abs(value - reference)
    if name == "attitude":
        return float(np.linalg.norm(value - reference, axis=(1, 2)).max() / np.sqrt(2.0))
    return float((np.linalg.norm(value - reference, axis=1) if name == "position" else difference).max())


def main() -> None:
    """Print the share of each precision, and the runs outside."""
    warnings.simplefilter("ignore")
    np.seterr(all="ignore")
    ratios: dict[str, list[float]] = {dtype: [] for dtype in DTYPES}
    for case in select(sys.argv[1:]):
        reference = case.reference().values
        for dtype in DTYPES:
            for method in methods():
                for step in (case.step(method), *case.coarser_steps(method)):
                    runner = Recorder(method, dtype, step, True)
                    try:
                        values = case.run(runner)
                    except NonFinite:
                        continue
                    for name, estimates in runner.found.items():
                        true = error(name, values[name], reference[name])
                        if RANGE[0] < true < RANGE[1]:
                            ratio = max(estimates) / true
                            ratios[dtype].append(ratio)
                            if not 1.0 / FACTOR < ratio < FACTOR:
                                print(
                                    f"{case.name}, {method.name} {dtype} {step:g} s, {name}: {true:.1e}, x {ratio:.2g}"
                                )
    for dtype, found in ratios.items():
        inside = sum(1.0 / FACTOR < ratio < FACTOR for ratio in found)
        print(f"{dtype}: {inside} of {len(found)} within a factor {FACTOR:g}: {100.0 * inside / len(found):.1f} %")


if __name__ == "__main__":
    main()
