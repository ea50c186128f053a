"""Closed loops in one call: the same numbers as stepping from Python."""

import signal
import threading
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from helpers import SMALL, policies, policy

import uvms_gym
from uvms_gym import PD, PID, Rollout
from uvms_gym.envs import INFO, StationKeepVectorEnv


def stepped(env: StationKeepVectorEnv, controller: Any, seed: int, steps: int) -> dict[str, Any]:
    """A rollout in Python."""
    n = env.num_envs
    observations, _ = env.reset(seed=seed)
    result: dict[str, Any] = {"steps": np.zeros(n, np.uint32), "returns": np.zeros(n)}
    result |= {name: np.zeros(n, np.bool_) for name in ("terminated", "truncated")}
    result |= {kind: {name: np.zeros(n) for name in INFO} for kind in ("sums", "squares", "last")}
    running, state, seen = np.ones(n, np.bool_), None, []
    for _ in range(steps):
        actions, state = controller.predict(observations, state)
        seen.append((observations, actions))
        observations, rewards, terminated, truncated, infos = env.step(actions)
        seen[-1] += (rewards, np.stack([infos[name] for name in INFO], 1))
        result["steps"] += running
        result["returns"][running] += rewards[running]
        for name in INFO:
            result["sums"][name][running] += infos[name][running]
            result["squares"][name][running] += infos[name][running] ** 2
            result["last"][name][running] = infos[name][running]
        result["terminated"] |= running & terminated
        result["truncated"] |= running & truncated
        running &= ~(terminated | truncated)
    return result | {"seen": seen}


def assert_equal(rollout: Rollout, steps: int, expected: dict[str, Any]) -> Any:
    """Check a rollout from here on against the numbers of stepping; its statistics."""
    rollout.run(steps)
    stats = rollout.pop_stats()
    for name in expected.keys() - {"seen"}:
        np.testing.assert_equal(getattr(stats, name), expected[name], err_msg=name)
    return stats


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("kind", range(4))
def test_a_rollout_gives_the_numbers_of_stepping(dtype: Any, kind: int) -> None:
    controller = policies()[kind]
    # Some end within the run, by their time.
    env = StationKeepVectorEnv(70, scene=SMALL, dtype=dtype, max_episode_steps=25)
    expected = stepped(env, controller, 3, 30)
    env.reset(seed=3)
    stats = assert_equal(Rollout(env, controller), 30, expected)
    assert stats.truncated.all() and (stats.steps == 25).all()


def test_episodes_that_diverge_stop_counting() -> None:
    # Full thrust on all axes.
    wild = policy(weights=[np.zeros((6, 24))], biases=[np.ones(6)])
    env = StationKeepVectorEnv(9, scene=SMALL, max_episode_steps=None)
    expected = stepped(env, wild, 0, 300)
    env.reset(seed=0)
    rollout = Rollout(env, wild)
    stats = assert_equal(rollout, 300, expected)
    assert stats.terminated.all() and 10 < stats.steps.min() < 300
    rollout.run(10)
    assert rollout.pop_stats().steps.max() == 0


def test_taking_a_tally_counts_anew_but_forgets_no_integral() -> None:
    env = StationKeepVectorEnv(5, scene=SMALL)
    controller = PID(env)
    expected = stepped(env, controller, 1, 30)["seen"]
    env.reset(seed=1)
    rollout = Rollout(env, controller, trace=[4])
    rollout.run(20)
    rollout.pop_stats()
    rollout.run(10)
    stats = rollout.pop_stats()
    assert (stats.steps == 10).all()
    np.testing.assert_array_equal(stats.returns[4], sum(rewards[4] for _, _, rewards, _ in expected[20:]))


def test_traces_record_what_the_controller_saw_and_did() -> None:
    env = StationKeepVectorEnv(130, scene=SMALL, max_episode_steps=12)
    controller = PD(env)
    expected = stepped(env, controller, 2, 12)["seen"]
    env.reset(seed=2)
    rollout = Rollout(env, controller, trace=[128, 0, 64, 0])
    rollout.run(8)
    rollout.run(9)
    traces = rollout.traces
    assert list(traces) == [0, 64, 128]
    for i, trace in traces.items():
        for part, name in enumerate(("observations", "actions", "rewards", "info")):
            np.testing.assert_array_equal(trace[name], np.stack([entry[part][i] for entry in expected]))


def test_the_environment_goes_on_where_the_rollout_ends() -> None:
    env = StationKeepVectorEnv(4, scene=SMALL)
    controller = PD(env)
    expected = stepped(env, controller, 5, 21)["seen"]
    env.reset(seed=5)
    Rollout(env, controller).run(20)
    np.testing.assert_array_equal(env.step(expected[20][1])[1], expected[20][2])


def test_what_cannot_be_rolled_out_is_refused() -> None:
    env = StationKeepVectorEnv(2, scene=SMALL)
    with pytest.raises(gym.error.ResetNeeded):
        Rollout(env, PD(env)).run(1)
    with pytest.raises(TypeError, match="vector environment, not StationKeepEnv"):
        Rollout(gym.make("UVMS-StationKeep-v0"), PD(env))
    with pytest.raises(TypeError, match="controller of uvms_gym, not str"):
        Rollout(env, "pd")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="instance is 2, but must be from 0 to below 2"):
        Rollout(env, PD(env), trace=[2])
    env.reset(seed=0)
    with pytest.raises(ValueError, match="the policy reads 44 observation entries and gives 6 action entries"):
        Rollout(env, PD(scene="petasus-pum")).run(1)


def test_an_interrupt_stops_a_rollout_between_its_parts() -> None:
    env = StationKeepVectorEnv(256, scene=SMALL, max_episode_steps=None)
    env.reset(seed=0)
    done: list[int] = []

    def tick(steps: int) -> None:
        done.append(steps)
        if len(done) == 1:
            signal.raise_signal(signal.SIGINT)

    assert threading.current_thread() is threading.main_thread()
    # A parent may have it ignored.
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            Rollout(env, PD(env)).run(2 * uvms_gym.rollouts._PIECE // 256, tick)
    finally:
        signal.signal(signal.SIGINT, previous)
    assert len(done) == 1
