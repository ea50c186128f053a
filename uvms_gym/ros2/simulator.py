"""Node of a simulated vehicle: sensors out, commands in."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from uvms_gym._extras import extra
from uvms_gym.controllers.contract import policy_contract
from uvms_gym.ros2.instruments import TOPICS
from uvms_gym.ros2.messages import COMMANDS, SENSORS, by_name, sensor_messages, time_of, wrench_of
from uvms_gym.ros2.session import DISCOVERY, LATCHED, Session
from uvms_gym.ros2.vehicle import DEADMAN, SimulatedVehicle

with extra("ros2-node"):
    from std_msgs.msg import String
    from std_srvs.srv import SetBool, Trigger

#: Parts of a contract that do not depend on the controller.
SHARED = ("form", "task", "scene", "end_effector", "control_period", "rate", "thruster_lag", "options")
#: Time after which a simulation in lockstep sends its measurement again, and ends, s.
AGAIN, PATIENCE = 0.5, 30.0


class SimulatorNode:
    """Sensors of a vehicle on topics, at the end of every control period, and its commands from topics.

    Parameters
    ----------
    session : Session
    vehicle : SimulatedVehicle
    factor : float
        Simulation time per wall time.
    lockstep : bool
        Wait at every instant for commands with the measurement's stamp; `factor` does not matter then.
    wait_for_controller : bool
        Begin at time 0 once another node receives `odom` and publishes `wrench` or `thrusts`.
    patience : float
        Time to wait for commands or a controller, s.
    """

    def __init__(
        self,
        session: Session,
        vehicle: SimulatedVehicle,
        *,
        factor: float = 1.0,
        lockstep: bool = False,
        wait_for_controller: bool = False,
        patience: float = PATIENCE,
    ) -> None:
        self.session, self.vehicle = session, vehicle
        self._factor, self._lockstep, self._patience = factor, lockstep, patience
        self._waits = wait_for_controller
        node = session.node
        self._publishers = {name: node.create_publisher(kind, name, 10) for name, kind in SENSORS.items()}
        self._contract = node.create_publisher(String, "contract", LATCHED)
        contract = policy_contract(vehicle.env)
        shared = {**{key: contract[key] for key in SHARED}, "lockstep": lockstep}
        self._contract.publish(String(data=json.dumps(shared)))
        self._kept = [
            *(node.create_subscription(COMMANDS[name], name, self._receiver(name), 10) for name in COMMANDS),
            node.create_service(Trigger, "reset", self._reset),
            *(
                node.create_service(SetBool, f"{TOPICS[name]}/fail", self._failer(name))
                for name in vehicle.instruments.suite
            ),
        ]
        self._answered: dict[str, float] = {}
        self._discovered: float | None = None
        self._sent = 0.0
        #: Wall times from a measurement to the command on it, s; periods that began late; times that the deadman acted.
        self.round_trips: list[float] = []
        self.late = self.deadman = 0
        self._first = float("nan")
        self._was_silent = True

    def run(self, seconds: float = float("inf")) -> None:
        """Simulate until this simulation time, s.

        Raises
        ------
        ValueError
            In lockstep no command comes, or no controller that was to be waited for.
        """
        if self._waits and not self.session.spin_until(self._is_controlled, self._patience):
            raise ValueError(f"no controller on odom and wrench or thrusts for {self._patience:g} s")
        self._publish()
        due = time.perf_counter()
        while self.vehicle.time < seconds - 1e-9:
            if self._lockstep:
                self._await_commands()
            else:
                due += self.vehicle.period / self._factor
                while (left := due - time.perf_counter()) > 0.0:
                    self.session.spin(left)
                if left < -self.vehicle.period / self._factor:
                    self.late += 1
                    due = time.perf_counter()
            self._watch()
            self.vehicle.step()
            if self.vehicle.over:
                self.session.say(f"the vehicle diverged at {self.vehicle.time:g} s: next episode", once=False)
                self.vehicle.reset()
            self._publish()

    def _is_controlled(self) -> bool:
        commanded = any(map(self.session.publishers, ("wrench", "thrusts")))
        return commanded and self.session.subscribers("odom") > 0

    def _publish(self) -> None:
        measurement = self.vehicle.measurement
        self._sent = time.perf_counter()
        deviations, joints = self.vehicle.state.deviations, self.vehicle.joints
        for name, message in sensor_messages(measurement, deviations, joints).items():
            self._publishers[name].publish(message)

    def _watch(self) -> None:
        """Log once that the deadman acts, and that commands are back."""
        silent = self.vehicle.silent
        if silent != self._was_silent:
            self.deadman += silent
            begin = f"no thrusts or wrench for {DEADMAN:g} s: thrusts are 0" if silent else "commands come"
            self.session.say(f"{begin} at {self.vehicle.time:g} s", once=False)
        self._was_silent = silent

    def _await_commands(self) -> None:
        end = time.monotonic() + self._patience
        while not self.session.spin_until(self._is_answered, AGAIN):
            if time.monotonic() > end:
                raise ValueError(f"no command on wrench or thrusts for {self._patience:g} s at {self.vehicle.time:g} s")
            self._publish()

    def _is_answered(self) -> bool:
        now = self.vehicle.time
        there = {name for name, stamp in self._answered.items() if abs(stamp - now) < 1e-6}
        if not there & {"wrench", "thrusts"}:
            return False
        if "joint_targets" in there or not self.vehicle.joints:
            return True
        # The topics of one controller are discovered one after the other.
        self._discovered = self._discovered or time.monotonic() + DISCOVERY
        return time.monotonic() > self._discovered and not self.session.publishers("joint_targets")

    def _receiver(self, name: str) -> Callable[[Any], None]:
        def receive(message: Any) -> None:
            try:
                self._command(name, message)
            except ValueError as error:
                self.session.say(f"{name} is ignored: {error}")
                return
            self._answered[name] = time_of(message.header.stamp)
            if np.isnan(self._first):
                self._first = self.vehicle.time
            if name != "joint_targets" and abs(self._answered[name] - self.vehicle.time) < 1e-6:
                self.round_trips.append(time.perf_counter() - self._sent)

        return receive

    def _command(self, name: str, message: Any) -> None:
        vehicle = self.vehicle
        if name == "wrench":
            vehicle.command_wrench(wrench_of(message))
        elif name == "thrusts":
            vehicle.command_thrust(by_name(name, message, vehicle.thrusters, "effort"))
        elif vehicle.driven:
            vehicle.command_joints((), effort=by_name(name, message, vehicle.driven, "effort"))
        else:
            rate = by_name(name, message, vehicle.joints, "velocity") if len(message.velocity) else ()
            vehicle.command_joints(by_name(name, message, vehicle.joints, "position"), rate)

    def _reset(self, request: Any, response: Any) -> Any:
        self.vehicle.reset()
        self._answered.clear()
        self._was_silent = True
        self._publish()
        response.success, response.message = True, f"episode {self.vehicle.episode} begins"
        self.session.say(response.message)
        return response

    def _failer(self, name: str) -> Callable[[Any, Any], Any]:
        def fail(request: Any, response: Any) -> Any:
            self.vehicle.instruments.fail(name, request.data)
            verb = "fails" if request.data else "works again"
            response.success, response.message = True, f"{TOPICS[name]} {verb} at {self.vehicle.time:g} s"
            self.session.say(response.message, once=False)
            return response

        return fail

    def summary(self) -> dict[str, float]:
        """Metrics of the episode so far, time of the first command, s, and round trips: median, 95 % and maximum, s."""
        counts = {
            "time": self.vehicle.time,
            "first_command": self._first,
            "late": float(self.late),
            "deadman": float(self.deadman),
        }
        found: dict[str, float] = {**self.vehicle.info, **counts}
        if self.round_trips:
            names = ("round_trip_median", "round_trip_95", "round_trip_maximum")
            found |= dict(zip(names, np.percentile(self.round_trips, [50, 95, 100]).tolist()))
        return found
