"""Node of a controller or policy on the topics of a vehicle."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from uvms_gym._extras import extra
from uvms_gym.controllers.contract import differences, policy_contract
from uvms_gym.ros2.instruments import Floats
from uvms_gym.ros2.messages import COMMANDS, SENSORS, by_name, joint_message, pose_and_twist, time_of, wrench_message
from uvms_gym.ros2.observer import Observer
from uvms_gym.ros2.session import LATCHED, Session
from uvms_gym.ros2.vehicle import DEADMAN

with extra("ros2-node"):
    from std_msgs.msg import String

#: Time to wait for the first measurements, s.
PATIENCE = 10.0
#: Measurements from which the interval of odom is estimated, and its tolerance, relative to the control period.
MEASUREMENTS, TOLERANCE = 5, 0.1


class ControllerNode:
    """Commands of a controller on the measurements of a vehicle, at the controller's rate.

    It publishes `wrench` or `thrusts`, by the environment's actions, and `joint_targets`, all with the stamp of the
    odometry that they answer. A new time before the last one, or a gap of `DEADMAN`, begins anew with empty memory.

    Parameters
    ----------
    session : Session
    observer : Observer
    patience : float
        Time to wait for the first measurements, s.
    """

    def __init__(self, session: Session, observer: Observer, *, patience: float = PATIENCE) -> None:
        self.session, self.observer, self._patience = session, observer, patience
        env, node = observer.env, session.node
        self._joints = env.snapshot().joint_names
        self._thrusters = env.snapshot().thruster_names
        self._wrench = env.options.action == "wrench"
        self._driven = [block.name for block in env.action_layout[6 if self._wrench else len(self._thrusters) :]]
        self._own = policy_contract(env)
        kinds = ["wrench" if self._wrench else "thrusts", *(["joint_targets"] if self._joints else [])]
        self._publishers = {name: node.create_publisher(COMMANDS[name], name, 10) for name in kinds}
        topics: dict[str, tuple[Any, Callable[[Any], None], Any]] = {
            "odom": (SENSORS["odom"], self._on_odom, 10),
            "contract": (String, self._on_contract, LATCHED),
        }
        if self._joints:
            topics["joint_states"] = (SENSORS["joint_states"], self._on_joints, 10)
        self._kept = [node.create_subscription(kind, name, call, qos) for name, (kind, call, qos) in topics.items()]
        self._odom: tuple[Any, tuple[Floats, Floats, Floats]] | None = None
        self._state: tuple[float, Floats, Floats] | None = None
        self._stamps: deque[float] = deque(maxlen=MEASUREMENTS)
        #: Time from the last answered measurement at which the next one is due, s.
        self._due = 0.5 * self.observer.period
        self._last: float | None = None
        self._sent: dict[str, Any] = {}
        self._heard = time.monotonic()
        self._contract: dict[str, Any] | None = None
        self._error: str | None = None
        self._ready = False
        self.commands = 0

    def run(self, seconds: float = float("inf")) -> None:
        """Check contract and rate, then command until the stamp `seconds`, s.

        Raises
        ------
        ValueError
            A topic does not come or is too slow, the vehicle has another contract, or is out of bounds.
        """
        self._check_start()
        self._heard = time.monotonic()
        while self._last is None or self._last < seconds - 1e-9:
            self.session.spin(0.1)
            if self._error is not None:
                raise ValueError(self._error)
            text = f"no measurement for {DEADMAN:g} s: no commands"
            if time.monotonic() - self._heard > DEADMAN:
                self.session.say(text)
            else:
                self.session.forget(text)

    def _check_start(self) -> None:
        self.session.spin_until(lambda: self._error is not None or not self._missing(), self._patience)
        if self._error is None and (missing := self._missing()):
            names = " and ".join(self.session.node.resolve_topic_name(name) for name in missing)
            raise ValueError(f"no message on {names} for {self._patience:g} s")
        # On a busy machine the contract may come later than measurements, of which lockstep gives only one.
        self.session.spin_until(
            lambda: self._error is not None or self._lockstep or len(self._stamps) == MEASUREMENTS, self._patience
        )
        if self._contract is None and self.session.publishers("contract"):
            self.session.spin_until(lambda: self._contract is not None, 2.0)
        if self._error is not None:
            raise ValueError(self._error)
        if self._contract is None:
            self.session.say("the vehicle publishes no contract: only the rate is checked")
        if not self._lockstep:
            self._check_rate()
        self._ready = True

    @property
    def _lockstep(self) -> bool:
        return bool((self._contract or {}).get("lockstep"))

    def _check_rate(self) -> None:
        """Refuse a control period that is no multiple of the interval of odom."""
        period = self.observer.period
        interval = float(np.median(np.diff(self._stamps))) if len(self._stamps) > 1 else float("inf")
        if abs(max(1, round(period / interval)) * interval / period - 1.0) > TOLERANCE:
            raise ValueError(f"odom comes every {interval:.3g} s, but must come every {period:g} s or a fraction of it")
        self._due = period - 0.5 * interval

    def _missing(self) -> list[str]:
        """Topics of which no message has come."""
        there = {"odom": self._odom is not None, "joint_states": self._state is not None or not self._joints}
        return [name for name, come in there.items() if not come]

    def _on_contract(self, message: Any) -> None:
        try:
            given = json.loads(message.data)
            apart = list(differences(given, self._own))
        except (ValueError, KeyError, TypeError, AttributeError):
            self._error = "contract is no contract of uvms_gym"
            return
        self._contract = given
        if apart:
            self._error = f"the environment of the controller differs from the vehicle's contract: {'; '.join(apart)}"

    def _on_odom(self, message: Any) -> None:
        try:
            self._odom = message.header.stamp, pose_and_twist(message)
        except ValueError as error:
            self.session.say(f"a message is ignored: {error}")
            return
        stamp = time_of(message.header.stamp)
        if self._stamps and stamp < self._stamps[-1]:
            self._stamps.clear()
        if not self._stamps or stamp > self._stamps[-1]:
            self._stamps.append(stamp)
        if stamp == self._last:
            self._publish()  # The vehicle asks again.
        self._act()

    def _on_joints(self, message: Any) -> None:
        try:
            q, qd = (by_name("joint_states", message, self._joints, field) for field in ("position", "velocity"))
        except ValueError as error:
            # A contract of another vehicle explains it.
            self._error = self._error or str(error)
            return
        if np.isfinite(q).all() and np.isfinite(qd).all():
            self._state = (time_of(message.header.stamp), q, qd)
            self._act()

    def _act(self) -> None:
        """Command, if the last odometry has joints of its time and a control period has gone by."""
        if not self._ready or self._odom is None or self._error is not None:
            return
        at, measured = self._odom
        stamp, period = time_of(at), self.observer.period
        joints = self._state or (stamp, np.zeros(0), np.zeros(0))
        if abs(joints[0] - stamp) > 0.5 * period:
            return
        if self._last is not None:
            gap = stamp - self._last
            if 0.0 <= gap < self._due:
                return
            if not 0.0 <= gap < max(DEADMAN, 2.0 * period):
                self.session.say(f"memory begins anew at {stamp:g} s", once=False)
                self.observer.reset()
        try:
            command = self.observer.act(self.observer.observe(*measured, *joints[1:]))
        except ValueError as error:
            self._error = str(error)
            return
        self._last, self._heard = stamp, time.monotonic()
        m = 6 if self._wrench else len(self._thrusters)
        if self._wrench:
            self._sent = {"wrench": wrench_message(at, command[:m])}
        else:
            self._sent = {"thrusts": joint_message(at, self._thrusters, effort=command[:m])}
        if self.observer.joint_targets is not None:
            position, velocity = self.observer.joint_targets
            self._sent["joint_targets"] = joint_message(at, self._joints, position=position, velocity=velocity)
        elif self._driven:
            self._sent["joint_targets"] = joint_message(at, self._driven, effort=command[m:])
        self.commands += 1
        self._publish()

    def _publish(self) -> None:
        for name, message in self._sent.items():
            self._publishers[name].publish(message)
