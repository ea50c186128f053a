"""Threads of the pool: forks, many callers at once, idleness."""

import copy
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers import assert_same, moving, state_of

from uvms_gym import Simulator

# Some of the many starts are violent.
pytestmark = pytest.mark.filterwarnings("ignore::uvms_gym.StepWarning")

MANY = 1000


def simulator(seed: int = 0, threads: int = 2) -> Simulator:
    return moving("petasus-pum", MANY, seed, threads=threads)


def stepped(s: Simulator, substeps: int = 2) -> dict[str, np.ndarray]:
    s.step(thrust=np.ones((MANY, s.num_thrusters)), substeps=substeps)
    return state_of(s)


def child(work: Callable[[], Any], patience: float = 20.0) -> Any:
    """Result of `work` in a forked child; None if it does not end within `patience` (s)."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    with warnings.catch_warnings():
        # Python warns of threads, whosesoever they are.
        warnings.simplefilter("ignore", DeprecationWarning)
        process = os.fork()
    if process == 0:
        try:
            sender.send(work())
        finally:
            os._exit(0)
    try:
        return receiver.recv() if receiver.poll(patience) else None
    finally:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


def test_children_of_children_step_on() -> None:
    s = simulator()
    stepped(s)
    expected = stepped(copy.copy(s))

    def generation(k: int) -> list[dict[str, np.ndarray]]:
        before = stepped(copy.copy(s))
        younger = child(lambda: generation(k - 1)) if k else []
        return [before, *younger, stepped(copy.copy(s))]

    results = child(lambda: generation(3))
    assert results is not None, "a child hangs"
    assert len(results) == 8
    for result in results:
        assert_same(result, expected)


def test_a_fork_while_others_step_hangs_nobody() -> None:
    s = simulator()
    expected = stepped(copy.copy(s))
    stop = threading.Event()

    def busy() -> None:
        other = simulator(1)
        while not stop.is_set():
            stepped(other)

    others = [threading.Thread(target=busy) for _ in range(3)]
    for other in others:
        other.start()
    try:
        for _ in range(10):
            got = child(lambda: stepped(copy.copy(s)))
            assert got is not None, "the child hangs"
            assert_same(got, expected)
            assert_same(stepped(copy.copy(s)), expected)
    finally:
        stop.set()
        for other in others:
            other.join()


def in_process(seed: int) -> dict[str, np.ndarray]:
    return stepped(simulator(seed))


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_processes_of_multiprocessing_step_on() -> None:
    expected = [in_process(seed) for seed in range(4)]
    with multiprocessing.get_context("fork").Pool(2) as pool:
        first = pool.map_async(in_process, range(4)).get(timeout=30)
        assert_same(in_process(0), expected[0])
        second = pool.map_async(in_process, range(4)).get(timeout=30)
    for got in (first, second):
        for a, b in zip(got, expected, strict=True):
            assert_same(a, b)


def test_many_python_threads_step_at_once() -> None:
    expected = [stepped(simulator(seed, threads=1), substeps=5) for seed in range(8)]
    simulators = [simulator(seed) for seed in range(8)]

    def steps(s: Simulator) -> dict[str, np.ndarray]:
        for _ in range(4):
            stepped(s, substeps=1)
        return stepped(s, substeps=1)

    with ThreadPoolExecutor(8) as executor:
        for got, want in zip(executor.map(steps, simulators), expected, strict=True):
            for part in set(got) - {"time"}:
                assert got[part].tobytes() == want[part].tobytes(), part


def at_work(step: Callable[[], Any], calls: list[Callable[[], Any]]) -> Counter[str]:
    """Errors of calls while a step runs in another thread."""
    started, refused = threading.Event(), Counter[str]()

    def work() -> None:
        started.set()
        step()

    worker = threading.Thread(target=work)
    worker.start()
    started.wait()
    while worker.is_alive():
        for call in calls:
            try:
                call()
            except RuntimeError as error:
                refused[str(error)] += 1
    worker.join()
    return refused


def test_a_step_releases_the_gil_and_other_calls_are_refused() -> None:
    s = simulator(threads=1)
    calls: list[Callable[[], Any]] = [s.step, s.reset, s.mass_matrix, s.step_jacobians, s.forward_dynamics]
    calls += [lambda: s.position, lambda: s.set_state(time=0.0), lambda: s.scale_parameters(mass=1.0)]
    refused = at_work(lambda: s.step(substeps=500), calls)
    assert refused.total() > 100
    assert all("this Simulator is at work in another thread: wait for that call to end" in text for text in refused)


@pytest.mark.parametrize("task", ["StationKeep", "EETrack", "Dock"])
def test_a_step_of_environments_releases_the_gil_and_other_calls_are_refused(task: str) -> None:
    # One call takes some tenths of a second.
    envs: Any = gymnasium.make_vec(f"UVMS-{task}-v0", 64, threads=1, substeps=10_000)
    envs.reset(seed=0)
    assert at_work(lambda: envs.step(np.zeros(envs.action_space.shape)), [envs.get_state]).total() > 100


POOL = """
import os, gymnasium, uvms_gym
def threads(task, n):
    envs = gymnasium.make_vec(task, n, threads=4)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    for _ in range(20):
        envs.step(0.1 * envs.action_space.sample())
    return len(os.listdir("/proc/self/task"))
before = len(os.listdir("/proc/self/task"))
tasks = [name for name in gymnasium.registry if name.startswith("UVMS-")]
assert {threads(task, n) for task in tasks for n in (1, 2, 8)} == {before}
assert threads(tasks[0], 4096) > before, "so the count shows nothing"
"""


def test_few_instances_never_enter_the_pool() -> None:
    subprocess.run([sys.executable, "-c", POOL], check=True, timeout=60)


def test_idle_threads_take_no_time_of_the_processor() -> None:
    stepped(simulator())
    time.sleep(0.05)
    before = time.process_time()
    time.sleep(0.5)
    assert time.process_time() - before < 0.1
