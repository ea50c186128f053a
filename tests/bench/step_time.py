"""Time per MK4 step and instance, through the Python call: `python tests/bench/step_time.py`."""

import os
import platform
import statistics
import time

import numpy as np

from uvms_gym import Simulator

N, SUBSTEPS, REPEATS = 1024, 10, 15


def simulator(scene: str, dtype: str, varied: bool) -> Simulator:
    """Instances that differ in their states, driven by their thrusters, on one thread."""
    s = Simulator(scene, N, dt=0.01, dtype=dtype, threads=1)
    s.set_state(twist=0.1 * np.random.default_rng(0).normal(size=(N, 6)))
    if varied:
        s.set_parameters(mass=np.linspace(1.0, 1.1, N), added_mass=np.linspace(0.8, 1.2, N))
    return s


def main() -> None:
    """Interleave all cases and print the median and the least of each."""
    cases = [
        (scene, dtype, varied)
        for scene in ("petasus-pum", "bluerov2-heavy-alpha5", "bluerov2-heavy")
        for dtype in ("float64", "float32")
        for varied in (False, True)
    ]
    simulators = [simulator(*case) for case in cases]
    thrusts = [np.random.default_rng(1).uniform(-5, 5, (N, s.num_thrusters)) for s in simulators]
    times: list[list[float]] = [[] for _ in cases]
    for _ in range(REPEATS + 1):
        for s, thrust, sample in zip(simulators, thrusts, times, strict=True):
            start = time.perf_counter()
            s.step(thrust=thrust, substeps=SUBSTEPS)
            sample.append((time.perf_counter() - start) / (N * SUBSTEPS))
    assert all(np.isfinite(s.twist).all() for s in simulators)
    print(f"{platform.processor() or platform.machine()}, lanes {simulators[0].lanes}, load {os.getloadavg()[0]:.1f}")
    print(f"{N} instances, {SUBSTEPS} substeps, one thread, median of {REPEATS}: ns per MK4 step and instance")
    for (scene, dtype, varied), s, sample in zip(cases, simulators, times, strict=True):
        kind = "own parameters" if varied else "shared parameters"
        print(
            f"{scene:22} {dtype} {kind:18} {1e9 * statistics.median(sample[1:]):6.0f}"
            f"  least {1e9 * min(sample[1:]):6.0f}  {s.bytes_per_env} B"
        )


if __name__ == "__main__":
    main()
