"""Pool trials of a BlueROV2 with a Reach Alpha 5: the vehicle floats freely while its arm moves."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import uvms_gym
from uvms_gym import Log

POOL = Path(__file__).parents[1] / "data" / "pool"
GRAVITY = 9.81
# x of the body points up.
UPENDED = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def arm_moments(scene: dict[str, Any], q: np.ndarray) -> np.ndarray:
    """First moments of mass less displaced mass at joint coordinates q (n, 4), body axes, kg m (n, 3).

    Of the scene with the arm mounted as on the vehicle of the trials; g(eta) is GRAVITY times their product with the
    direction against gravity.
    """
    scene["arm"]["mount"]["frame"] = {"position": [0.25, -0.10965, 0.005]}
    simulator = uvms_gym.Simulator(scene, len(q))
    simulator.set_state(q=q)
    level = simulator.equations()["g"]
    simulator.set_state(rotation=np.broadcast_to(UPENDED, (len(q), 3, 3)), q=q)
    upended = simulator.equations()["g"]
    return np.stack([-level[:, 4], level[:, 3], upended[:, 4]], axis=1) / GRAVITY


def trial(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Joint coordinates (n, 4) and direction against gravity in body axes (n, 3), ten times a second."""
    log = Log.read(POOL, POOL / "map.toml", name, scene="bluerov2-heavy-alpha5")
    time = np.arange(log.start + 0.5, log.end - 0.5, 0.1)
    q, up = log.joints.position_at(time), log.imu.attitude.rotation_at(time)[:, 2]
    known = np.isfinite(q).all(axis=1) & np.isfinite(up).all(axis=1)
    return q[known], up[known]


def angles(up: np.ndarray) -> np.ndarray:
    """Roll and pitch, deg (n, 2)."""
    return np.degrees([np.arctan2(up[:, 1], up[:, 2]), -np.arcsin(up[:, 0])]).T


def held_out_error(scene: dict[str, Any], fitted: str, held_out: str) -> np.ndarray:
    """RMS error of roll and pitch, deg, of static equilibria in one trial; the vehicle's moments fitted to another."""

    def errors(name: str) -> Any:
        q, up = trial(name)
        moments = arm_moments(scene, q)

        def of(vehicle: np.ndarray) -> np.ndarray:
            down = moments + vehicle
            return angles(-down / np.linalg.norm(down, axis=1)[:, None]) - angles(up)

        return of

    vehicle = least_squares(lambda x: errors(fitted)(x).ravel(), [0.0, 0.0, -0.4]).x
    return np.sqrt((errors(held_out)(vehicle) ** 2).mean(axis=0))


def test_val_static_equilibria_follow_the_arm() -> None:
    """Roll and pitch of a trial held out within 1 deg; of the arm as its tables give it, off by over 2 deg.

    In the tables the upper arm has x along the link, and z of the wrist points towards the base: the axes of the joints
    are others.
    """
    scene = uvms_gym.load_scene("bluerov2-heavy-alpha5")
    assert (held_out_error(scene, "007-1", "026-1") < 1.0).all()
    for link, centre in ((1, [0.073, 0.0, 0.0]), (3, [0.0, -0.003, -0.098])):
        body = scene["arm"]["links"][link]["body"]
        body["center_of_mass"] = body["center_of_buoyancy"] = centre
    assert held_out_error(scene, "007-1", "026-1").max() > 2.0
