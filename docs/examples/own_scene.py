"""A scene of your own as a dict: a box with six thrusters and a two-joint arm, made from shapes.

`uvms_gym.estimate` derives mass, inertia, buoyancy, added mass and drag; `uvms scenes template`
lists every key there is.
"""

from typing import Any

import gymnasium
import numpy as np

import uvms_gym


def link(name: str, z: float, home: float) -> dict[str, Any]:
    """Cylinder of 0.35 m below a revolute joint."""
    cylinder = {"radius": 0.03, "length": 0.35, "axis": "z"}
    shapes = [{"cylinder": cylinder, "position": [0.0, 0.0, -0.175]}]
    body = uvms_gym.estimate({"shapes": shapes})["body"]
    joint = {
        "kind": "revolute",
        "frame": {"position": [0.0, 0.0, z]},
        "axis": [0.0, 1.0, 0.0],
        "home": home,
        "effort": 10.0,
        "servo": {"kp": 4.0, "kd": 0.8},
    }
    return {"name": name, "joint": joint, "body": body}


def scene() -> dict[str, Any]:
    """Scene as a dict; only what it states is modelled."""
    box = {"box": [0.6, 0.5, 0.4], "perforation": 0.3, "displaced": 0.5}
    vehicle = uvms_gym.estimate({"shapes": [box]})["body"]
    # A righting moment: buoyancy above weight.
    vehicle["center_of_mass"] = [0.0, 0.0, -0.05]
    thrusters = []
    for name, axis, arm in (
        ("surge", [1, 0, 0], [0, 0.2, 0]),
        ("sway", [0, 1, 0], [0, 0, 0.15]),
        ("heave", [0, 0, 1], [0.2, 0, 0]),
    ):
        for side, sign in (("a", 1.0), ("b", -1.0)):
            thruster = {"name": f"{name}-{side}", "axis": axis, "limits": [-40.0, 40.0]}
            thrusters.append(thruster | {"position": [sign * float(x) for x in arm]})
    return {
        "name": "box-with-arm",
        "summary": "A box with six thrusters and an arm of two joints, from shapes.",
        "water": {"density": 1000.0, "gravity": [0.0, 0.0, -9.81]},
        "vehicle": {
            "name": "box",
            "body": vehicle,
            "thrusters": thrusters,
            "servo": {"kp": [200.0] * 3 + [60.0] * 3, "kd": [250.0] * 3 + [40.0] * 3},
        },
        "arm": {
            "name": "two links",
            "links": [link("shoulder", -0.2, 0.3), link("elbow", -0.35, 0.5)],
            "end_effector": {"position": [0.0, 0.0, -0.35]},
        },
    }


def main(steps: int = 400) -> float:
    """Check the scene, hold it at a pose by its own PD, and return the RMS position error, m."""
    made = scene()
    for warning in uvms_gym.lint_scene(made):
        print(warning)
    print(f"maximum stable step of mk4: {uvms_gym.Simulator(made).stable_steps()['mk4']:.3f} s")
    env = gymnasium.make("UVMS-StationKeep-v0", scene=made)
    controller, state = uvms_gym.PD(env), None
    observation, info = env.reset(seed=0)
    for _ in range(steps):
        action, state = controller.predict(observation, state)
        observation, *_, info = env.step(action)
    assert np.isfinite(observation).all()
    print(f"RMS position error {100 * info['rms_position_error']:.1f} cm")
    return float(info["rms_position_error"])


if __name__ == "__main__":
    main()
