"""Cost of watching and of estimating the accumulated error, and of ros3 over ros2: interleaved calls, one thread.

python tests/bench/estimates.py
"""

import statistics
import time

from uvms_gym import Simulator

ROUNDS = 15


def ratio(instances: int, dtype: str, substeps: int, first: dict[str, object], second: dict[str, object]) -> float:
    """Time of a call of `step` by the first options over that by the second, petasus-pum."""
    pair = [Simulator("petasus-pum", instances, dtype=dtype, threads=1, **options) for options in (first, second)]
    calls = max(1, 40_000 // (instances * substeps))
    quotients = []
    for _ in range(ROUNDS + 1):
        times = []
        for simulator in pair:
            begun = time.process_time()
            for _ in range(calls):
                simulator.step(substeps=substeps)
            times.append(time.process_time() - begun)
        quotients.append(times[0] / times[1])
    # The first instances are followed in the first rounds.
    return statistics.median(quotients[1:])


if __name__ == "__main__":
    for instances in (1, 64, 1024):
        for dtype in ("float64", "float32"):
            for substeps in (1, 5, 10):
                off = {"error_estimate": False}
                watched, estimated = (
                    ratio(instances, dtype, substeps, {"error_estimate": x}, off) for x in (None, True)
                )
                print(
                    f"{instances} instances, {dtype}, {substeps} steps a call: times {watched:.3f} and {estimated:.2f}"
                )
    for dtype in ("float64", "float32"):
        found = ratio(1024, dtype, 5, {"integrator": "ros3"}, {"integrator": "ros2"})
        print(f"ros3 over ros2, 1024 instances, {dtype}: {found:.2f}")
