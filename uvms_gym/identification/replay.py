"""Replays: recordings of all trials as one batch, joints prescribed, and the attitude of static equilibrium."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uvms_gym import _rotations as rotations
from uvms_gym._core import Simulator
from uvms_gym.identification.recordings import ANGLES, Floats, Recording, padded
from uvms_gym.logs import LogError, interpolation

#: Steps of the integrator for a floating vehicle, one with thrusters, and one with servos in its arm, s. At 0.1 s the
#: error of a floating vehicle reaches 2 % of its motion after 6 s.
STEP, DRIVEN_STEP, SERVO_STEP = 0.05, 0.0125, 0.005
#: Intervals of a recording for each computed equilibrium.
STRIDE = 4
#: x of the body points up.
_UPENDED = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Corrections:
    """Corrections of logs by parameters of a map."""

    #: (joints,) further zeros of the joints, rad or m: q = logged - zero.
    zeros: Floats | None = None
    #: (thrusters,) factors on commands.
    scales: Floats | None = None
    #: Further lateness of the stamps of "joints", "thrusters" and "imu", s.
    lags: dict[str, float] = field(default_factory=dict)


def stated_step(scene: dict[str, Any]) -> float:
    """Step that a scene states, s; infinite where it states none."""
    return float(scene.get("integration", {}).get("step", np.inf))


class Replay:
    """Inputs of all trials, side by side.

    All recordings have the same period. `thrusters` gives thrust as commanded in the logs, else none; with `prescribed`
    the joints move as in the logs, else the scene's servos follow them. Steps are at most `step`, s; with `dt`, s, they
    are the longest of at most `dt` that divide the period. None: the scene's integrator.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        *,
        thrusters: bool = True,
        prescribed: bool = True,
        step: float = np.inf,
        dt: float | None = None,
        integrator: str | None = None,
    ) -> None:
        self.recordings = list(recordings)
        self.prescribed, self.step, self.dt, self.integrator = prescribed, step, dt, integrator
        self.period = self.recordings[0].period
        self.thrusters = thrusters and all(r.log.thrusters is not None for r in self.recordings)
        # (Calls per interval, for a driven vehicle: thrust is no linear function of commands, of which means count.)
        servos = not prescribed and self.recordings[0].log.joints is not None
        own = SERVO_STEP if servos else DRIVEN_STEP if self.thrusters else STEP
        self.substeps = max(round(self.period / own), 1)
        if dt is not None or step < own:
            step = step if dt is None else dt
            self.substeps = max(int(np.ceil(self.period / step - 1e-9)), 1)
        self.measured = padded([r.measured for r in self.recordings])
        for row, r in zip(self.measured, self.recordings):
            row[r.periods + 1 :] = np.nan
        self.initial = np.stack([r.initial for r in self.recordings])
        # By lag: the uncorrected one, and those of a fit's last steps.
        self._cubics = lru_cache(4)(lambda lag: padded([_resting(r.cubics(lag)) for r in self.recordings])[:, :-1])
        self._commands = lru_cache(4)(lambda lag: padded([r.commands(lag, self.substeps) for r in self.recordings]))

    @property
    def integration(self) -> dict[str, Any]:
        """Arguments of replays with the same integrator and steps."""
        return {"step": self.step, "dt": self.dt, "integrator": self.integrator}

    def cubics(self, corrections: Corrections) -> Floats:
        """(N, T, joints, 4) motion of the joints."""
        cubics = self._cubics(corrections.lags.get("joints", 0.0))
        if corrections.zeros is not None:
            cubics = cubics.copy()
            cubics[..., 0] -= corrections.zeros
        return cubics

    def commands(self, corrections: Corrections) -> Floats:
        """(N, T, steps, thrusters) commands, N."""
        commands = self._commands(corrections.lags.get("thrusters", 0.0))
        return commands if corrections.scales is None else commands * corrections.scales

    def measured_with(self, corrections: Corrections) -> Floats:
        """(N, T + 1, 12) measured channels, with a further lag of the IMU."""
        lag = corrections.lags.get("imu", 0.0)
        if lag == 0.0:
            return self.measured
        times = self.period * np.arange(self.measured.shape[1])
        shifted = self.measured.copy()
        for trial in shifted:
            for k in range(6):
                known = np.isfinite(trial[:, k])
                if known.sum() > 1:
                    inside = np.interp(times + lag, times[known], trial[known, k])
                    trial[known, k] = inside[known]
        return shifted

    def run(
        self,
        scene: dict[str, Any],
        corrections: Corrections | None = None,
        initial: Floats | None = None,
        current: Floats | None = None,
    ) -> Floats:
        """Predict the motion of the vehicle.

        `initial` (N, 12) are channels at the start, by default as measured; `current` (N, 3) is the velocity of the
        water in world axes, m/s, in addition to the scene's.

        Returns
        -------
        numpy.ndarray (N, T + 1, 12)
            Predicted channels; yaw continuous.
        """
        corrections = corrections or Corrections()
        start = self.initial if initial is None else initial
        cubics = self.cubics(corrections)
        count, periods, joints = cubics.shape[:3]
        dt, prescribed = self.period / self.substeps, self.prescribed and joints > 0
        # Thrusters that are off are left out: steps are judged by the speeds that they could give.
        if not self.thrusters:
            vehicle = {key: v for key, v in scene["vehicle"].items() if key not in ("thrusters", "thruster_lag")}
            scene = scene | {"vehicle": vehicle, "provenance": {}}
        simulator = Simulator(scene, count, dt=dt, integrator=self.integrator, threads=1, prescribed_joints=prescribed)
        state: dict[str, Any] = {
            "position": start[:, 6:9],
            "quaternion": rotations.from_rpy(start[:, ANGLES]),
            "twist": np.concatenate([start[:, 9:12], start[:, 3:6]], axis=1),
        }
        if joints:
            state |= {"q": cubics[:, 0, :, 0], "qd": cubics[:, 0, :, 1]}
        if current is not None:
            state["current"] = current + np.array(scene["water"].get("current", [0.0, 0.0, 0.0]))
        simulator.set_state(**state)
        commands = self.commands(corrections) if self.thrusters else None
        quaternion = np.empty((periods + 1, count, 4))
        twist, position = np.empty((periods + 1, count, 6)), np.empty((periods + 1, count, 3))
        for k in range(periods + 1):
            quaternion[k], twist[k], position[k] = simulator.quaternion, simulator.twist, simulator.position
            if k == periods:
                break
            target: dict[str, Any] = {"joint_target": cubics[:, k]} if joints else {}
            if commands is None:
                simulator.step(substeps=self.substeps, **target)
                continue
            for j in range(self.substeps):
                if joints and j:
                    target = {"joint_target": shifted(cubics[:, k], j * dt)}
                simulator.step(thrust=commands[:, k, j], **target)
        return _channels(quaternion, twist, position)

    def constant(self) -> Floats:
        """(N, T + 1, 12) prediction of a vehicle that keeps its attitude and velocity of the start, turning no more."""
        predicted = np.repeat(self.initial[:, None], self.measured.shape[1], axis=1)
        predicted[:, :, 3:6] = 0.0
        R = rotations.matrices(rotations.from_rpy(self.initial[:, ANGLES]))
        velocity = np.einsum("nij,nj->ni", R, self.initial[:, 9:12])
        time = self.period * np.arange(self.measured.shape[1])
        predicted[:, :, 6:9] += velocity[:, None] * time[:, None]
        return predicted

    def constant_velocity(self) -> Floats:
        """(N, T + 1, 12) prediction of a vehicle whose velocities in body axes stay as at the start."""
        return self._integrated(np.zeros((*self.measured.shape[:2], 6))[:, 1:])

    def double_integrator(self, scene: dict[str, Any]) -> Floats:
        """(N, T + 1, 12) prediction by thrust and inertia: no damping, weight, buoyancy or motion of the joints.

        The acceleration in body axes is the wrench of the logged commands over the mass matrix at the start, with added
        mass. Without thrusters in the logs it is `constant_velocity`.
        """
        if not self.thrusters:
            return self.constant_velocity()
        simulator = Simulator(scene, len(self.recordings), threads=1)
        cubics = self.cubics(Corrections())
        if cubics.shape[2]:
            simulator.set_state(q=cubics[:, 0, :, 0])
        wrench = self.commands(Corrections()).mean(axis=2) @ simulator.thruster_configuration.T
        return self._integrated(np.linalg.solve(simulator.mass_matrix()[:, None, :6, :6], wrench[..., None])[..., 0])

    def _integrated(self, acceleration: Floats) -> Floats:
        """(N, T + 1, 12) motion from the start with accelerations (N, T, 6) in body axes, constant over each period."""
        twist = np.concatenate([self.initial[:, 9:12], self.initial[:, 3:6]], axis=1)
        q, position = rotations.from_rpy(self.initial[:, ANGLES]), self.initial[:, 6:9]
        motion = [(q, twist, position)]
        for a in np.moveaxis(acceleration, 1, 0):
            mean = twist + 0.5 * self.period * a
            turn = 0.5 * self.period * mean[:, 3:]
            angle = np.linalg.norm(turn, axis=1, keepdims=True)
            half = np.concatenate([np.cos(angle / 2.0), np.sinc(angle / 2.0 / np.pi) * turn / 2.0], axis=1)
            middle = rotations.multiply(q, half)
            position = position + self.period * np.einsum("nij,nj->ni", rotations.matrices(middle), mean[:, :3])
            q, twist = rotations.multiply(middle, half), twist + self.period * a
            motion.append((q, twist, position))
        return _channels(*(np.stack(column) for column in zip(*motion)))

    def balance(self, scene: dict[str, Any], corrections: Corrections | None = None) -> Floats:
        """(N, T + 1, 12) attitude at which weight and buoyancy balance, and its rates; the rest as of `constant`."""
        cubics = self.cubics(corrections or Corrections())
        count, periods, joints = cubics.shape[:3]
        last = cubics[:, -1:] @ self.period ** np.arange(4)
        q = np.concatenate([cubics[..., 0], last], axis=1)
        knots = np.unique(np.r_[0 : periods + 1 : STRIDE, periods])
        known = equilibrium(scene, q[:, knots].reshape(count * len(knots), joints)).reshape(count, len(knots), 3)
        up = between(knots, known, periods + 1)
        predicted = self.constant()
        predicted[..., 0] = np.arctan2(up[..., 1], up[..., 2])
        predicted[..., 1] = -np.arcsin(np.clip(up[..., 0], -1.0, 1.0))
        rates = np.gradient(predicted[..., :2], self.period, axis=1)
        predicted[..., 3] = rates[..., 0]
        predicted[..., 4] = rates[..., 1] * np.cos(predicted[..., 0])
        predicted[..., 5] = -rates[..., 1] * np.sin(predicted[..., 0])
        return predicted


def between(knots: NDArray[np.int64], values: Floats, count: int) -> Floats:
    """Values (N, k, 3) at increasing indices (k,), at all indices (N, count, 3), by monotone cubics."""
    columns = np.moveaxis(values, 1, 0).reshape(len(knots), -1)
    found = interpolation.pchip(knots.astype(np.float64), columns, np.arange(count, dtype=np.float64))[0]
    return np.moveaxis(found.reshape(count, len(values), 3), 0, 1)


def equilibrium(scene: dict[str, Any], q: Floats) -> Floats:
    """(n, 3) direction against gravity, body axes, at which weight and buoyancy balance with joints at q (n, joints).

    A net force besides is taken to act at the vehicle frame's origin, as drag does in steady motion.
    """
    bodies = Simulator(scene, 2, threads=1)
    bodies.set_state(rotation=np.stack([np.eye(3), _UPENDED]))
    # Restoring wrenches give each body's net force n and first moments s: the moment is s x up.
    poses, wrenches = bodies.body_poses(), bodies.body_wrenches()["restoring"]
    up = poses[:, :, 2, :3]
    net = np.sum(wrenches[0, :, :3] * up[0], axis=-1)
    # s = sum over two directions of up x moment, and the part along both: least squares.
    cross = -rotations.skew(up)
    rows = np.concatenate(list(cross), axis=1)
    moments = np.concatenate([wrenches[0, :, 3:], wrenches[1, :, 3:]], axis=1)
    s = np.einsum("bij,bj->bi", np.linalg.pinv(rows), moments)
    simulator = Simulator(scene, len(q), threads=1)
    if q.shape[1]:
        simulator.set_state(q=q)
    poses = simulator.body_poses()
    total = np.einsum("nbij,bj->ni", poses[..., :3, :3], s) + np.einsum("nbi,b->ni", poses[..., :3, 3], net)
    return np.asarray(total / np.linalg.norm(total, axis=1, keepdims=True))


def check(scene: dict[str, Any], recordings: Sequence[Recording]) -> None:
    """Refuse logs that lack the joints of a scene."""
    names = tuple(Simulator(scene).joint_names)
    for r in recordings:
        found = r.log.joints.names if r.log.joints is not None else ()
        if found != names:
            raise LogError(
                f"{r.name}: joints {', '.join(found) or 'none'}, but the scene has {', '.join(names) or 'none'}; "
                "read the log with the scene"
            )


def shifted(cubics: Floats, time: float) -> Floats:
    """Cubics (..., 4) from a later start of time, s, on."""
    c0, c1, c2, c3 = np.moveaxis(cubics, -1, 0)
    value, slope = c0 + time * (c1 + time * (c2 + time * c3)), c1 + time * (2.0 * c2 + time * 3.0 * c3)
    return np.stack([value, slope, c2 + 3.0 * time * c3, c3], axis=-1)


def _resting(cubics: Floats) -> Floats:
    """Cubics (n, joints, 4) with one more at their end, that rests."""
    last = np.zeros_like(cubics[-1:])
    last[0, :, 0] = cubics[-1, :, 0]
    return np.concatenate([cubics, last])


def _channels(quaternion: Floats, twist: Floats, position: Floats) -> Floats:
    """Channels (N, T, 12) of quaternions (T, N, 4), twists (T, N, 6) and positions (T, N, 3)."""
    rpy = rotations.to_rpy(quaternion.reshape(-1, 4)).reshape(*quaternion.shape[:2], 3)
    rpy[..., 2] = np.unwrap(rpy[..., 2], axis=0)
    found = np.concatenate([rpy, twist[..., 3:], position, twist[..., :3]], axis=-1)
    return np.ascontiguousarray(np.moveaxis(found, 0, 1))
