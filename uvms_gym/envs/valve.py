"""Turning a valve: `UVMS-Valve-v0`, single and vector."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from uvms_gym._task.options import TaskOptions
from uvms_gym.envs.base import TaskEnv, TaskVectorEnv


@dataclass(frozen=True, kw_only=True)
class ValveOptions(TaskOptions, task="valve"):
    """Options of turning a valve: `TaskOptions`, the valve, the tool and the reference.

    Attributes
    ----------
    contract : {"push", "grasp"}
        "push": one finger pushes the handle round; success is a turn by 170 degrees. "grasp": two fingers turn the
        handle between them by 170 to 175 degrees, stop it and leave it.
    torque : float
        Coulomb friction of the valve, N m, in [0, 100].
    damping : float
        Viscous friction of the valve, N m s/rad, >= 0.
    range : float
        Turn of the valve from stop to stop, rad, in [0, 10]. A small one is a blocked valve.
    radius : float
        Distance of the fingers from the valve's axis, m, in [0.02, 0.075].
    standoff : float
        Distance of the tool from the handle for a vehicle at the origin with its arm at home, m, in [0.1, 1].
    approach_time : float
        Duration of the reference's approach, which begins after 1 s, s, >= 0.
    turn_time : float
        Duration of the reference's turn, s, >= 0.
    success_reward : float
        Reward per control period from success on, >= 0.
    observe_fixture : bool
        Angle and rate of the valve are observed.
    observe_force : bool
        The contact force on the tool is observed.
    terminate_on_success : bool
        Success ends the episode.
    """

    episode_time: ClassVar[float] = 40.0

    substeps: int = 10
    contract: Literal["push", "grasp"] = "push"
    torque: float = 0.012
    damping: float = 0.08
    range: float = 3.22
    radius: float = 0.059
    standoff: float = 0.12
    approach_time: float = 4.0
    turn_time: float = 20.0
    success_reward: float = 0.5
    observe_fixture: bool = False
    observe_force: bool = False
    terminate_on_success: bool = False


class ValveEnv(TaskEnv):
    """Turn a valve with the end effector of a free-floating vehicle.

    ## Description
    A panel with a valve stands in front of the robot: a bar of 150 x 12 x 20 mm on an axis that points away from it. A
    reference leads the end effector to the handle, and round its axis. With `contract="push"` the tool is one sphere
    of 8 mm radius at the end effector, which pushes the bar round on a circle of radius `radius`, at constant attitude.
    With `contract="grasp"` it is a fork of two such spheres, one on either side of the bar, which turns with the end
    effector about the valve's axis and then retreats. A scene with contact spheres on the end effector's body brings
    its own tool.

    A steady current of random strength and direction acts on the robot. The arm's joints are driven by torques as in
    `ButtonEnv`. Range, radius and friction, and both conditions of success, are those of a public suite of underwater
    manipulation tasks; the friction is an option, so that its influence can be measured.

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
    A `Box(-bound, bound, (d,), float32)`, as in `ButtonEnv`: neither the valve nor the force on the tool is observed,
    unless `observe_fixture` or `observe_force` ask for them. On `petasus-pum` with wrench actions:

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
    As in `ButtonEnv`; the valve is at one end of its range.

    ## Episode End
    Termination: the run diverges, as in `EETrackEnv`. With `terminate_on_success` success terminates the episode, too.
    Truncation: after 800 steps (40 s), by Gymnasium's `TimeLimit`.

    ## Information
    The same keys as in `EETrackEnv`. `success` is 1 from success on, which follows from the physics alone:

    - `contract="push"`: the valve has turned by 170 degrees.
    - `contract="grasp"`: two opposed fingers (normal forces of at least 0.1 N each, with a cosine below -0.25 between
      them) have turned the valve by at least 165 degrees, at most 5 degrees of turn came about otherwise, the valve
      came to rest at 170 to 175 degrees (0.05 rad/s, the tool 25 mm/s) for 1 s, and the tool was 80 mm clear of it for
      0.5 s, with the valve still there.

    In addition `angle` (of the valve, rad), `slip` (turn without two opposed fingers on the handle, rad),
    `time_to_success` (s; before it the time so far), `contact_force` (sum of the normal forces of all contacts, N),
    `peak_force` (its maximum over the control instants so far, N), `impulse` (its integral, N s) and `reward_success`.
    Forces are evaluated at control instants with the scene's nominal numbers.

    ## Arguments
    `options`, a `ValveOptions`, or its fields as keyword arguments; and `render_mode`, as in `StationKeepEnv`.
    `reset(options=...)` sets parts of the start as in `ButtonEnv`.

    `UVMS-Valve-Storm-v0` is this task under the conditions of `UVMS-StationKeep-Storm-v0`, with `substeps=20` for
    the same control period of 0.1 s, and the reward weight `action_rate` at 0.2.

    ```python
    >>> import gymnasium, uvms_gym
    >>> env = gymnasium.make("UVMS-Valve-v0", scene="bluerov2-heavy-alpha5", torque=0.1)
    >>> observation, info = env.reset(seed=1)
    >>> info["angle"], info["success"]
    (0.0, 0.0)

    ```

    ## Version History
    - v0: first version.
    """

    options_class = ValveOptions
    options: ValveOptions


class ValveVectorEnv(TaskVectorEnv):
    """N instances of `ValveEnv`, stepped together in one native call; parameters as in `TaskVectorEnv`."""

    options_class = ValveOptions
    options: ValveOptions
