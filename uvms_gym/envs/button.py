"""Pressing a button: `UVMS-Button-v0`, single and vector."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from uvms_gym._task.options import TaskOptions
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv


@dataclass(frozen=True, kw_only=True)
class ButtonOptions(TaskOptions, task="button"):
    """Options of pressing a button: `TaskOptions`, the approach, and the button.

    Attributes
    ----------
    standoff : float
        Distance of the tool from the button for a vehicle at the origin with its arm at home, m, in [0, 1].
    approach_time : float
        Duration of the reference's approach, which begins after 1 s, s, >= 0.
    press_depth : float
        Depth to which the reference presses the button, m, in [0, 0.1].
    pressed_travel : float
        Travel from which on the button counts as pressed, m, in [0, travel].
    hold_time : float
        Duration for which it has to be pressed, s, >= 0.
    travel : float
        Travel of the button, m, > 0.
    stiffness : float
        Stiffness of its spring, N/m, > 0.
    damping : float
        Damping of its motion, N s/m, >= 0.
    success_reward : float
        Reward per control period from success on, >= 0.
    observe_fixture : bool
        Travel and rate of the button are observed.
    observe_force : bool
        The contact force on the tool is observed.
    terminate_on_success : bool
        Success ends the episode.
    """

    # The waves move the vehicle by as much as the button gives way.
    storm: ClassVar[Mapping[str, Any]] = {"press_depth": 0.02}

    substeps: int = 10
    standoff: float = 0.12
    approach_time: float = 4.0
    press_depth: float = 0.012
    pressed_travel: float = 0.004
    hold_time: float = 0.5
    travel: float = 0.01
    stiffness: float = 1000.0
    damping: float = 80.0
    success_reward: float = 0.5
    observe_fixture: bool = False
    observe_force: bool = False
    terminate_on_success: bool = False


class ButtonEnv(TaskEnv):
    """Press a button with the end effector of a free-floating vehicle.

    ## Description
    A panel with a button stands in front of the robot. The tool is a sphere of 8 mm radius at the end effector, or the
    contact spheres that the scene has on the end effector's body. A reference leads the end effector to the button in a
    straight line, and 12 mm into it; the button gives way under a force, 1000 N/m and 80 N s/m, so that vehicle and arm
    have to push. A steady current of random strength and direction acts on the robot. The arm's joints are driven by
    torques as in `EETrackEnv`, but without the damping of their servos (joints without rotor inertia keep it). The
    physics is `uvms_gym.Simulator`, with the contacts of all spheres of the scene.

    The button has the dimensions and forces of the button in a public suite of underwater manipulation tasks. Success
    follows from the physics alone: the button has moved by 4 mm for half a second.

    ## Action Space
    The action space of `EETrackEnv`: wrench or thrusts, and joint torques. On `petasus-pum` with wrench actions:

    | Num | Action | -1   | +1  | Unit |
    | --- | ------ | ---- | --- | ---- |
    | 0 | surge | -200 | 200 | N |
    | 1 | sway | -200 | 200 | N |
    | 2 | heave | -200 | 200 | N |
    | 3 | roll | -60 | 60 | N m |
    | 4 | pitch | -60 | 60 | N m |
    | 5 | yaw | -60 | 60 | N m |
    | 6 | yaw | -35.91 | 35.91 | N m |
    | 7 | upper-arm | -48.24 | 48.24 | N m |
    | 8 | forearm | -17.78 | 17.78 | N m |
    | 9 | wrist | -7.198 | 7.198 | N m |
    | 10 | gripper | -1.626 | 1.626 | N m |

    ## Observation Space
    A `Box(-bound, bound, (d,), float32)`: physical values divided by fixed scales, clipped to bounds. Only what such a
    vehicle measures is observed: neither the button nor the force on the tool, unless `observe_fixture` or
    `observe_force` ask for them. r_e and R_e are position and rotation of the end effector, r_d and R_d the
    reference's. With n joints there are 33 + 2 n + (6 + n) entries; on `petasus-pum` with wrench actions:

    | Num | Observation | Scale | Bound | Unit |
    | --- | ----------- | ----- | ----- | ---- |
    | 0-2 | `position_error`: R_e^T (r_e - r_d), end-effector axes | 0.1 | 100 | m |
    | 3-5 | `attitude_error`: rotation vector log(R_d^T R_e), end-effector axes | 0.1 | 31.42 | rad |
    | 6-8 | `linear_velocity`: absolute velocity of the vehicle origin, body axes | 0.2 | 50 | m/s |
    | 9-11 | `angular_velocity`: absolute angular velocity, body axes | 0.2 | 100 | rad/s |
    | 12-14 | `up`: direction against gravity, body axes | 1 | 1.001 | 1 |
    | 15-19 | `joint_position`: joint coordinates relative to home | 0.5 | 20 to 24.8 | rad or m |
    | 20-24 | `joint_rate`: joint rates | 0.5 | 40 | rad/s or m/s |
    | 25-30 | `reference_twist`: velocities of the reference, end-effector axes | 0.2 | 50 to 100 | m/s and rad/s |
    | 31-41 | `previous_action`: the last action, as clipped | 1 | 1 | 1 |
    | 42-47 | `error_integral`: leaky integral of both errors, I' = e - 0.1 I | 0.2 | 157.1 to 500 | m s and rad s |

    `env.unwrapped.layout` describes the entries for any scene.

    ## Rewards
    The reward of `EETrackEnv`, and 0.5 per step from success on.

    ## Starting State
    The vehicle is at rest up to 0.05 m and 0.05 rad from its target pose (by default the world origin, level), and
    joints are at home. The panel does not move with the target pose: it is placed for a vehicle at the origin.

    ## Episode End
    Termination: the run diverges, as in `EETrackEnv`. With `terminate_on_success` success terminates the episode, too.
    Truncation: after 400 steps (20 s), by Gymnasium's `TimeLimit`.

    ## Information
    The same keys as in `EETrackEnv`. `success` is 1 from success on. In addition `travel` (of the button, m),
    `time_to_success` (s; before it the time so far), `contact_force` (sum of the normal forces of all contacts, N),
    `peak_force` (its maximum over the control instants so far, N), `impulse` (its integral, N s) and `reward_success`.
    Forces are evaluated at control instants with the scene's nominal numbers.

    ## Arguments
    `options`, a `ButtonOptions`, or its fields as keyword arguments; and `render_mode`, as in `StationKeepEnv`.
    `reset(options=...)` sets parts of the start as in `StationKeepEnv`; `target_position` and `target_attitude` are the
    pose near which the vehicle starts.

    `UVMS-Button-Storm-v0` is this task under the conditions of `UVMS-StationKeep-Storm-v0`, with `substeps=20` for
    the same control period of 0.1 s, a `press_depth` of 0.02 m, and the reward weight `action_rate` at 0.2.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-Button-v0", scene="bluerov2-heavy-alpha5", observe_fixture=True)
    >>> observation, info = env.reset(seed=1)
    >>> info["travel"], info["success"]
    (0.0, 0.0)

    ```

    ## Version History
    - v0: first version.
    """

    options_class = ButtonOptions
    options: ButtonOptions


class ButtonVectorEnv(TaskVectorEnv):
    """N instances of `ButtonEnv`, stepped together in one native call; parameters as in `TaskVectorEnv`."""

    options_class = ButtonOptions
    options: ButtonOptions
