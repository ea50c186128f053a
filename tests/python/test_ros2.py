"""Nodes of ROS 2 on the genuine middleware (rclpy, Fast DDS): `make test-ros2`."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from uvms_gym import export_policy, make_controller
from uvms_gym.ros2.observer import Observer
from uvms_gym.ros2.vehicle import DEADMAN, SimulatedVehicle

pytest.importorskip("rclpy", reason="rclpy is not installed (make test-ros2)")
# rclpy imports deprecated modules.
pytestmark = [pytest.mark.ros2, pytest.mark.filterwarnings("ignore::DeprecationWarning")]

from uvms_gym.ros2 import messages  # noqa: E402
from uvms_gym.ros2.controller import ControllerNode  # noqa: E402
from uvms_gym.ros2.session import Session, session  # noqa: E402
from uvms_gym.ros2.simulator import SimulatorNode  # noqa: E402

STORM = "UVMS-StationKeep-Storm-v0"


def make(env: str = STORM, **options: Any) -> Any:
    return gymnasium.make(env, disable_env_checker=True, **options).unwrapped


def vehicle(env: str = STORM, seed: int = 0, **options: Any) -> SimulatedVehicle:
    return SimulatedVehicle(make(env, **{**options, "action": "thrusters"}), seed)


@pytest.fixture
def space(request: pytest.FixtureRequest) -> str:
    """Namespace of the test, apart from those of other tests and processes."""
    return f"/test_{os.getpid()}_{abs(hash(request.node.name)) % 10**6}"


@pytest.fixture
def open_session(space: str) -> Iterator[Callable[..., Session]]:
    from contextlib import ExitStack

    with ExitStack() as stack:
        yield lambda name, **more: stack.enter_context(session(name, space, [f"/clock:={space}/clock"], **more))


class Background:
    """Call in a thread, with its result or error at the end."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self.error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, args=(call,), daemon=True)
        self._thread.start()

    def _run(self, call: Callable[[], Any]) -> None:
        try:
            call()
        except BaseException as error:
            self.error = error

    def join(self, seconds: float = 60.0) -> None:
        self._thread.join(seconds)
        assert not self._thread.is_alive()
        if self.error is not None:
            raise self.error


def in_process(env: str, name: str, seed: int, steps: int) -> dict[str, float]:
    own = make(env)
    control, state = make_controller(name, own), None
    observation, info = own.reset(seed=seed)
    for _ in range(steps):
        action, state = control.predict(observation, state)
        observation, *_, info = own.step(action)
    return dict(info)


def control_node(
    running: Session, env: str = STORM, name: str = "dob", seed: int = 0, **options: Any
) -> ControllerNode:
    own = make(env, **options)
    return ControllerNode(running, Observer(own, make_controller(name, own), seed), patience=5.0)


@pytest.mark.parametrize(("name", "seed"), [("dob", 0), ("pid", 1), ("ppo", 2)])
def test_a_controller_holds_the_vehicle_in_the_storm_as_in_process(open_session: Any, name: str, seed: int) -> None:
    """In lockstep, 20 s: equal but for rounding, far within 10 %."""
    simulator = SimulatorNode(open_session("simulator"), vehicle(seed=seed), lockstep=True)
    node = control_node(open_session("controller"), name=name, seed=seed)
    work = Background(lambda: node.run(19.9))
    simulator.run(20.0)
    work.join()
    found, expected = simulator.summary(), in_process(STORM, name, seed, 200)
    for key in ("rms_position_error", "rms_attitude_error", "rms_end_effector_position_error", "mean_power"):
        assert found[key] == pytest.approx(expected[key], rel=1e-4), key
    assert node.commands == 200 and simulator.deadman == 0 and found["first_command"] == 0.0


def test_the_deadman_acts_where_the_controller_dies_and_a_new_one_recovers(open_session: Any) -> None:
    """In real time, four times as fast."""
    simulator = SimulatorNode(open_session("simulator"), vehicle(seed=4), factor=4.0)
    running = open_session("controller")
    first = control_node(running, seed=4)
    work = Background(lambda: simulator.run(40.0))
    first.run(8.0)
    # Nothing handles its topics any more.
    end = time.monotonic() + 20.0
    while simulator.deadman == 0 and time.monotonic() < end:
        time.sleep(0.02)
    assert simulator.vehicle.silent
    assert 8.0 + DEADMAN <= simulator.vehicle.time < 8.0 + DEADMAN + 4.0
    second = control_node(open_session("controller_2"), seed=4)
    adrift = simulator.vehicle.info["position_error"]
    second.run(39.8)
    work.join()
    assert second.commands > 50
    assert simulator.vehicle.info["position_error"] < 0.08 < adrift


def test_a_reset_begins_controller_and_vehicle_anew(open_session: Any) -> None:
    from std_srvs.srv import Trigger

    simulator = SimulatorNode(open_session("simulator"), vehicle(seed=5), lockstep=True)
    node = control_node(open_session("controller"), seed=5)
    guest = open_session("guest")
    client = guest.node.create_client(Trigger, "reset")
    # Before the run, which takes a fraction of a second.
    assert client.wait_for_service(timeout_sec=10.0)
    work, acting = Background(lambda: simulator.run(10.0)), Background(lambda: node.run(9.9))
    while simulator.vehicle.time < 2.0:
        time.sleep(0.001)
    answer = client.call_async(Trigger.Request())
    assert guest.spin_until(answer.done, 10.0) and answer.result().success
    work.join()
    acting.join()
    assert simulator.vehicle.episode == 1
    assert node.commands > 120  # Those before the reset, then 100.
    assert node.observer.env.episode["step"].tolist() == [100]  # References and memory begin anew.
    assert simulator.vehicle.info["rms_position_error"] < 0.1


def test_messages_have_the_vehicle_s_values_frames_and_covariances(open_session: Any) -> None:
    simulator, guest = SimulatorNode(open_session("simulator"), vehicle(seed=1), factor=10.0), open_session("guest")
    got: dict[str, Any] = {}
    kept = [
        guest.node.create_subscription(kind, name, lambda m, name=name: got.setdefault(name, m), 10)
        for name, kind in messages.SENSORS.items()
    ]
    work = Background(lambda: simulator.run(5.0))
    assert guest.spin_until(lambda: len(got) == len(kept), 20.0)
    work.join()
    odom, joints, imu = got["odom"], got["joint_states"], got["imu"]
    assert (odom.header.frame_id, odom.child_frame_id, imu.header.frame_id) == ("odom", "base_link", "base_link")
    assert list(joints.name) == simulator.vehicle.joints and len(joints.velocity) == 5
    assert odom.pose.covariance[0] == pytest.approx(0.005**2) and odom.pose.covariance[35] == pytest.approx(0.005**2)
    assert odom.twist.covariance[0] == pytest.approx(0.01**2) and got["dvl"].twist.covariance[35] == np.inf
    assert 5.0 < imu.linear_acceleration.z < 15.0
    # 0.12e-3 rad/s and 1.2e-3 m/s2 per root Hz over 0.1 s; 2 mm of water.
    assert imu.angular_velocity_covariance[0] == pytest.approx(0.12e-3**2 / 0.1)
    assert imu.linear_acceleration_covariance[8] == pytest.approx(1.2e-3**2 / 0.1)
    assert got["pressure"].variance == pytest.approx((0.002 * 9810.0) ** 2, rel=0.05)
    assert got["pressure"].fluid_pressure == pytest.approx(101325.0 + 98100.0, rel=0.02)
    assert messages.time_of(got["/clock"].clock) <= 5.0


def test_sensors_have_their_rate_and_fail_and_work_again_on_demand(open_session: Any) -> None:
    """10 times as fast: the DVL at 5 Hz beside 10 Hz of the others, and the pressure sensor fails for a while."""
    from std_srvs.srv import SetBool

    simulator, guest = SimulatorNode(open_session("simulator"), vehicle(seed=1), factor=10.0), open_session("guest")
    stamps: dict[str, list[float]] = {"imu": [], "dvl": [], "pressure": []}
    kept = [
        guest.node.create_subscription(
            messages.SENSORS[name],
            name,
            lambda m, name=name: stamps[name].append(messages.time_of(m.header.stamp)),
            500,
        )
        for name in stamps
    ]
    client = guest.node.create_client(SetBool, "pressure/fail")
    assert client.wait_for_service(timeout_sec=10.0)
    work = Background(lambda: simulator.run(60.0))
    answers = []
    for end, failed in ((20.0, True), (40.0, False)):
        assert guest.spin_until(lambda end=end: bool(stamps["imu"]) and stamps["imu"][-1] >= end, 30.0)
        answer = client.call_async(SetBool.Request(data=failed))
        assert guest.spin_until(answer.done, 10.0) and answer.result().success
        answers.append(float(answer.result().message.split()[-2]))
    guest.spin_until(lambda: stamps["imu"][-1] >= 59.9, 10.0)
    work.join()
    assert kept and answer.result().message.startswith("pressure works again at ")
    # A message may be lost on its way.
    assert np.median(np.diff(stamps["imu"])) == pytest.approx(0.1) and np.median(
        np.diff(stamps["dvl"])
    ) == pytest.approx(0.2)
    assert [t for t in stamps["pressure"] if t > answers[1]] and [t for t in stamps["pressure"] if t <= answers[0]]
    assert not [t for t in stamps["pressure"] if answers[0] < t <= answers[1]]


def test_messages_and_measurements_convert_both_ways() -> None:
    one = vehicle(seed=7)
    one.command_wrench([30.0, 20.0, -10.0, 5.0, 3.0, -4.0])
    for _ in range(5):
        m = one.step()
    made = messages.sensor_messages(m, {}, one.joints)
    position, quaternion, twist = messages.pose_and_twist(made["odom"])
    np.testing.assert_array_equal(np.concatenate([position, quaternion, twist]), [*m.position, *m.quaternion, *m.twist])
    assert made["imu"].orientation.w == m.quaternion[0] and made["imu"].orientation.x == m.quaternion[1]
    turned = made["joint_states"]
    order = list(reversed(one.joints))
    np.testing.assert_array_equal(messages.by_name("joint_states", turned, order, "position"), m.q[::-1])
    wrench = np.arange(6.0)
    np.testing.assert_array_equal(messages.wrench_of(messages.wrench_message(messages.stamp_of(1.5), wrench)), wrench)
    assert messages.time_of(messages.stamp_of(12.1)) == pytest.approx(12.1, abs=1e-9)


def test_a_controller_of_another_contract_gives_no_command(open_session: Any) -> None:
    simulator = SimulatorNode(open_session("simulator"), vehicle(seed=0), factor=4.0)
    work = Background(lambda: simulator.run(12.0))
    node = control_node(open_session("controller"), scene="bluerov2-heavy-alpha5")
    with pytest.raises(
        ValueError, match=r"differs from the vehicle's contract: scene is bluerov2-heavy-alpha5 instead"
    ):
        node.run(5.0)
    assert node.commands == 0
    work.join()


@pytest.mark.parametrize(
    ("period", "message"),
    [
        (0.25, r"odom comes every 0\.25 s, but must come every 0\.1 s or a fraction of it"),
        (0.07, r"odom comes every 0\.07 s, but must come every 0\.1 s or a fraction of it"),
        (None, "no message on .*joint_states for 5 s"),
    ],
)
def test_a_topic_of_wrong_rate_or_that_never_comes_is_one_line(
    open_session: Any, period: float | None, message: str
) -> None:
    guest, one, stop = open_session("guest"), vehicle(), threading.Event()
    names = ["odom", *(["joint_states"] if period else [])]
    publishers = {name: guest.node.create_publisher(messages.SENSORS[name], name, 10) for name in names}

    def publish() -> None:
        for k in range(10_000):
            made = messages.sensor_messages(one.measurement, {}, one.joints)
            for name, publisher in publishers.items():
                made[name].header.stamp = messages.stamp_of(k * (period or 0.1))
                publisher.publish(made[name])
            if stop.wait(0.02):
                return

    work = Background(publish)
    try:
        node = control_node(open_session("controller"))
        with pytest.raises(ValueError, match=message):
            node.run(5.0)
        assert node.commands == 0
    finally:
        stop.set()
        work.join()


def test_of_faster_measurements_one_per_control_period_is_answered(open_session: Any) -> None:
    guest, one, stop, stamps = open_session("guest"), vehicle(), threading.Event(), []
    publishers = {
        name: guest.node.create_publisher(messages.SENSORS[name], name, 10) for name in ("odom", "joint_states")
    }
    kept = guest.node.create_subscription(
        messages.COMMANDS["wrench"], "wrench", lambda m: stamps.append(messages.time_of(m.header.stamp)), 10
    )

    def publish() -> None:
        for k in range(10_000):
            made = messages.sensor_messages(one.measurement, {}, one.joints)
            for name, publisher in publishers.items():
                made[name].header.stamp = messages.stamp_of(k / 30.0)
                if k % 10 == 9:
                    made["odom"].pose.pose.position.x = np.nan
                publisher.publish(made[name])
            guest.spin(0.01)
            if stop.is_set():
                return

    work = Background(publish)
    try:
        node = control_node(open_session("controller"))
        node.run(20.0)
    finally:
        stop.set()
        work.join()
    assert kept is not None and len(stamps) > 20
    # One message in ten is ignored, as it has a number that is not finite.
    assert np.median(np.diff(stamps)) == pytest.approx(0.1, abs=1e-6)
    assert np.min(np.diff(stamps)) > 0.06


def test_a_simulation_in_lockstep_without_a_controller_ends_with_one_line(open_session: Any) -> None:
    simulator = SimulatorNode(open_session("simulator"), vehicle(), lockstep=True, patience=1.0)
    with pytest.raises(ValueError, match="no command on wrench or thrusts for 1 s at 0 s"):
        simulator.run(5.0)


def test_a_simulation_may_begin_with_its_controller(open_session: Any) -> None:
    one = SimulatorNode(open_session("alone"), vehicle(seed=3), wait_for_controller=True, patience=0.5)
    with pytest.raises(ValueError, match=r"no controller on odom and wrench or thrusts for 0\.5 s"):
        one.run(1.0)
    assert one.vehicle.time == 0.0
    simulator = SimulatorNode(open_session("simulator"), vehicle(seed=3), wait_for_controller=True)
    work = Background(lambda: simulator.run(4.0))
    time.sleep(1.5)
    assert simulator.vehicle.time == 0.0
    control_node(open_session("controller"), seed=3).run(3.9)
    work.join()
    assert simulator.summary()["first_command"] < 2.0


def test_lockstep_goes_on_without_joint_targets_where_nobody_publishes_them(open_session: Any) -> None:
    simulator, guest = SimulatorNode(open_session("simulator"), vehicle(), lockstep=True), open_session("guest")
    wrench = guest.node.create_publisher(messages.COMMANDS["wrench"], "wrench", 10)
    kept = guest.node.create_subscription(
        messages.SENSORS["odom"],
        "odom",
        lambda m: wrench.publish(messages.wrench_message(m.header.stamp, np.zeros(6))),
        10,
    )
    work = Background(lambda: simulator.run(2.0))
    assert guest.spin_until(lambda: simulator.vehicle.time > 1.99, 20.0) and kept is not None
    work.join()


def test_bad_commands_are_ignored(open_session: Any) -> None:
    simulator, guest = SimulatorNode(open_session("simulator"), vehicle(), factor=4.0), open_session("guest")
    thrusts = guest.node.create_publisher(messages.COMMANDS["thrusts"], "thrusts", 10)
    wrench = guest.node.create_publisher(messages.COMMANDS["wrench"], "wrench", 10)
    work, end = Background(lambda: simulator.run(6.0)), time.monotonic() + 1.0
    while time.monotonic() < end:
        stamp = messages.stamp_of(0.0)
        thrusts.publish(messages.joint_message(stamp, ["nobody"], effort=[5.0]))
        wrench.publish(messages.wrench_message(stamp, np.full(6, np.nan)))
        time.sleep(0.05)
    assert simulator.vehicle.silent
    work.join()


def test_a_name_that_is_taken_is_one_line(open_session: Any) -> None:
    open_session("simulator")
    with pytest.raises(ValueError, match=r"/simulator is the name of another node"):
        open_session("simulator")


def test_topics_are_counted_under_their_other_names(space: str) -> None:
    """Two vehicles on one machine: the second one's clock has another name."""
    names = [f"/clock:={space}/clock_{k}" for k in range(2)]
    with session("a", space, names[:1]) as first, session("b", space, names[1:]) as second:
        kept = first.node.create_publisher(messages.SENSORS["/clock"], "/clock", 10)
        with session("c", space, names[:1]) as third:
            assert third.spin_until(lambda: third.publishers("/clock") == 1, 10.0)
        # It has heard of the publisher, but under another name.
        assert second.spin_until(lambda: second.node.count_publishers(f"{space}/clock_0") == 1, 10.0)
        assert second.publishers("/clock") == 0
    assert kept is not None


def test_a_topic_that_another_node_publishes_is_one_line(open_session: Any) -> None:
    # rclpy ends publishers that nobody refers to.
    simulator = SimulatorNode(open_session("simulator"), vehicle())
    with pytest.raises(ValueError, match=r"/odom is published by another node"):
        open_session("other", owned=["odom"])
    assert simulator.vehicle.time == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "--remap", "odom=x"], "remap is 'odom=x', but must be FROM:=TO"),
        (["simulate", "--remap", "odom:=x:=y"], "remap is 'odom:=x:=y', but must be FROM:=TO"),
        (["simulate", "--namespace", "a b"], "cannot start"),
        (["simulate", "--sensors", "none.toml"], "cannot read none.toml: No such file or directory"),
        (["simulate", "--sensors", "bad.toml"], "bad.toml: "),
        (["simulate", "--sensors", "rate.toml"], "sensors: imu.rate: -1 must be within [0.001, 10000]"),
        (["control", "--target", "1,2"], "must be 4 finite numbers"),
        (["control", "--env-kwargs", "action:residual"], "its actions are corrections to a controller"),
        (["control", "--wait", "1"], "no message on /odom and /joint_states for 1 s"),
    ],
)
def test_commands_answer_bad_input_with_one_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("[imu\n")
    (tmp_path / "rate.toml").write_text("[imu]\nrate = -1\n")
    done = subprocess.run(
        [sys.executable, "-m", "uvms_gym", "ros2", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2 and message in done.stderr and "Traceback" not in done.stderr
    assert len([line for line in done.stderr.splitlines() if line.startswith("uvms: ")]) == 1


def test_a_broken_contract_file_is_refused_at_the_start(tmp_path: Path) -> None:
    env = make()
    file = export_policy(make_controller("ppo", env), tmp_path / "ppo.c", env)
    command = [
        sys.executable,
        "-m",
        "uvms_gym",
        "ros2",
        "control",
        "--env",
        STORM,
        "--controller",
        "ppo",
        "--wait",
        "1",
    ]
    command += ["--contract", str(file)]
    sound = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "no message on /odom and /joint_states for 1 s" in sound.stderr
    broken = json.loads(file.read_text())
    broken |= {"control_period": 0.2, "further_delay": 1}
    broken["policy"]["digest"] = "0" * 64
    broken["observation"][3]["scale"] *= 2.0
    file.write_text(json.dumps(broken))
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("uvms: ")]
    assert done.returncode == 2 and "0 commands" not in done.stdout
    assert f"{file}: the environment differs from the contract: control_period is 0.1 instead of 0.2 (-50 %); " in line
    assert "scale of observation attitude_error[0] is " in line and "further_delay is 0 instead of 1" in line
    assert line.endswith("instead of 000000000000")


def test_ctrl_c_ends_a_simulation_with_its_figures(tmp_path: Path) -> None:
    import signal

    command = [
        sys.executable,
        "-m",
        "uvms_gym",
        "ros2",
        "simulate",
        "--namespace",
        f"c{os.getpid()}",
        "--json",
        "r.json",
    ]
    env = {**os.environ, "PYTHONUNBUFFERED": "1"}
    command += ["--remap", f"/clock:=/c{os.getpid()}/clock"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=-1, stderr=-1, text=True, env=env) as running:
        assert running.stdout is not None and "petasus-pum" in running.stdout.readline()
        time.sleep(0.5)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=20.0)
    assert running.returncode == 0 and "RMS position error" in out and "Traceback" not in err
    assert '"time"' in (tmp_path / "r.json").read_text()
