"""Long calls end soon after Ctrl-C, and calls that need more memory than there is raise a MemoryError."""

import subprocess
import sys

import pytest

#: Makes `interrupted(call)`: CPU time that a call takes after a signal, s. It counts no time of other processes.
BEGIN = """
import resource, signal, threading, time, warnings
import gymnasium, numpy as np, uvms_gym
from uvms_gym import Simulator, controllers
warnings.simplefilter("ignore")
signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent may have it ignored

def interrupted(name, call):
    times = []
    def send():
        times.append(time.process_time())
        signal.raise_signal(signal.SIGINT)
    timer = threading.Timer(0.15, send)
    timer.start()
    try:
        call()
    except KeyboardInterrupt:
        print(name, time.process_time() - times[0], flush=True)
    finally:
        timer.join()

def varied(count):
    many = Simulator("bluerov2-heavy-alpha5", count, threads=1)
    many.scale_parameters(mass=1.1)
    return many
one = Simulator("bluerov2-heavy-alpha5", threads=1)
"""

SHORT = """
many = varied(50000)
interrupted("mass_matrix", many.mass_matrix)
interrupted("linearize", lambda: many.linearize(thrust=np.ones(8)))
interrupted("step_jacobians", lambda: one.step_jacobians(substeps=10**8))
interrupted("step_jvp", lambda: one.step_jvp({}, substeps=10**8))
interrupted("step_vjp", lambda: many.step_vjp(np.ones(many.state_size), substeps=1000))
plan = dict(weights={"position": 1.0}, input_weights={"thrust": 1e-3}, references={"position": [5.0, 0.0, 0.0]})
interrupted("plan", lambda: uvms_gym.optimize_trajectory(one, horizon=5000, substeps=200, tolerance=0.0, **plan))
envs = gymnasium.make_vec("UVMS-StationKeep-Storm-v0", num_envs=256, threads=1)
envs.reset(seed=0)
interrupted("rollout", lambda: uvms_gym.Rollout(envs, controllers.MPC(envs)).run(10**6))
several = Simulator("petasus-pum", 64)
interrupted("step", lambda: several.step(substeps=10**15))
assert (several.time > 0).all()  # what was done stays
"""

LONG = """
many = varied(200000)
for name in ("bias", "energy", "body_poses", "jacobian", "trim", "equations", "joint_torques", "power"):
    interrupted(name, getattr(many, name))
interrupted("inverse_dynamics", lambda: many.inverse_dynamics(np.ones(6 + many.num_joints)))
interrupted("step", lambda: one.step(substeps=10**9))
interrupted("reverse", lambda: one.step_vjp(np.ones(one.state_size), substeps=200000))
two = Simulator("bluerov2-heavy-alpha5", 2000, threads=2)
interrupted("threads", lambda: two.step_jacobians(substeps=10**6))
scene = uvms_gym.load_scene("bluerov2-heavy-alpha5")
interrupted("scenes", lambda: Simulator(20000 * [scene]))
interrupted("parameters", lambda: Simulator(scene, parameters={"vehicle.body.mass": np.linspace(11.0, 12.0, 20000)}))
for task in ("StationKeep", "EETrack"):
    envs = gymnasium.make_vec(f"UVMS-{task}-v0", num_envs=64, threads=1)
    observations, _ = envs.reset(seed=0)
    nmpc = controllers.NMPC(envs)
    interrupted(task, lambda: nmpc.predict(np.repeat(observations, 2000, axis=0)))
    interrupted(task + " rollout", lambda: uvms_gym.Rollout(envs, nmpc).run(10**6))
envs = gymnasium.make_vec("UVMS-StationKeep-v0", num_envs=20000, threads=1, dt=1e-6, substeps=10000)
envs.reset(seed=0)
interrupted("env", lambda: envs.step(np.zeros(envs.action_space.shape, np.float32)))
"""


def run(script: str) -> list[str]:
    command = [sys.executable, "-P", "-c", BEGIN + script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize("script", [SHORT, pytest.param(LONG, marks=pytest.mark.nightly)], ids=["short", "long"])
def test_an_interrupt_ends_each_long_call_within_a_second(script: str) -> None:
    lines = run(script)
    assert len(lines) >= script.count("interrupted(")
    for line in lines:
        name, spent = line.rsplit(maxsplit=1)
        assert float(spent) < 1.0, name


def test_where_memory_ends_calls_raise_a_memory_error_and_nothing_is_lost() -> None:
    script = """
def refused(call, *arguments, **keywords):
    try:
        call(*arguments, **keywords)
    except MemoryError as error:
        print(error)
import copy, pickle
np.linalg.det(np.ones((4, 64, 64)) @ np.ones((4, 64, 64)))  # its library takes memory at its first call
many = Simulator("free-body", 200000, threads=2)
many.step()
before = many.position
used = 4096 * int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (used + 50_000_000, resource.RLIM_INFINITY))
refused(many.step_jacobians)
refused(many.mass_matrix)
refused(copy.copy, many)
refused(pickle.dumps, many)
refused(one.step_vjp, np.ones(one.state_size), substeps=10**7)
keywords = dict(weights={"position": 1.0}, input_weights={"thrust": 1.0})
refused(uvms_gym.optimize_trajectory, one, horizon=20000, **keywords)
refused(uvms_gym.optimize_trajectory, one, horizon=10**6, **keywords)
assert (many.position == before).all()
many.step()
"""
    lines = run(script)
    assert len(lines) == script.count("\nrefused(")
    assert all(lines)
