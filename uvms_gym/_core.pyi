"""The native part of `uvms_gym`. `help` documents the classes that only this package calls."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, ClassVar, Final, TypeAlias, TypedDict, Unpack, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

from uvms_gym.inputs import StepInputs

__all__ = [
    "ATTITUDE_LEVER",
    "Controller",
    "Mlp",
    "NavigationFilter",
    "Renderer",
    "Rollout",
    "SceneError",
    "Sensors",
    "Simulator",
    "StepWarning",
    "Task",
    "__version__",
    "arm_names",
    "assemble_robot",
    "assess_scene",
    "disturbance_levels",
    "dump_scene",
    "estimate",
    "gain_names",
    "integrators",
    "lint_scene",
    "load_scene",
    "optimize_trajectory",
    "pulse_of",
    "read_robot",
    "recommend_integration",
    "scene_names",
    "scene_template",
    "task_defaults",
    "tasks",
    "thrust_of",
    "trajectory_inputs",
    "vehicle_terms",
]

_Scene: TypeAlias = str | PathLike[str] | dict[str, Any]
_Floats: TypeAlias = NDArray[np.float64]
_Rows: TypeAlias = ArrayLike | None
_Pose: TypeAlias = tuple[ArrayLike, ArrayLike] | ArrayLike | None

__version__: str
ATTITUDE_LEVER: float
"""Lever by which an attitude error counts in the pose error, m/rad."""

class _Integrator(TypedDict):
    name: str
    summary: str
    order: int
    kind: str
    adaptive: bool
    implicit: bool

class SceneError(ValueError):
    """A scene that cannot be read, or that no physical system can have. The message names the file, key and value."""

class StepWarning(UserWarning):
    """A step too large for the scene, with a wrong or not finite result; the message names a suitable step."""

class _Mode(TypedDict):
    rate: complex
    time_constant: float
    period: float
    what: str
    where: str
    end_stop: bool

def tasks() -> list[tuple[str, str]]: ...
def task_defaults(task: str) -> dict[str, Any]: ...
def scene_names() -> list[str]:
    """Names of the scenes that come with the package."""

def arm_names() -> list[str]:
    """Names of the shipped arms without vehicle: parts for `[arm] file` and `[[arms]]` of a scene."""

def vehicle_terms() -> list[tuple[str, str]]:
    """Terms of a vehicle beyond its body and thrusters: key in the vehicle's table, and a note for reports."""

def load_scene(scene: _Scene, *, end_effector: str | None = None) -> dict[str, Any]:
    """Read and check a scene (shipped name, path of a TOML file, or dict); the complete scene in SI units.

    `end_effector` is the name of the end effector to use.
    """

def disturbance_levels() -> list[tuple[str, str, str]]:
    """Levels of disturbances: name, description, and the components as JSON."""

def dump_scene(scene: _Scene) -> str:
    """A scene as TOML text, which reads back as an equal scene."""

def lint_scene(scene: _Scene) -> list[str]:
    """Warnings about implausible values of a valid scene: one line each, with key and numbers."""

def assess_scene(scene: _Scene) -> dict[str, Any]:
    """Trim (balance, righting moment, thrust to hold), authority by axis, and rates of joints of a scene."""

class _Recommendation(TypedDict):
    integrator: str
    step: float
    reason: str
    error: float
    accurate: bool

def recommend_integration(scene: _Scene, speed: ArrayLike | None = None) -> _Recommendation:
    """Integrator and step that follow a scene's motion at the speeds that its actuators reach."""

def scene_template() -> str:
    """TOML text of a scene with all keys, their units and defaults in comments."""

class _Estimate(TypedDict):
    body: dict[str, Any]
    formulas: dict[str, str]
    toml: str

def estimate(outline: _Scene, *, table: str = "vehicle.body") -> _Estimate:
    """Estimate a body's mass, inertia, buoyancy, added mass and drag from boxes, cylinders, capsules and ellipsoids."""

def thrust_of(pulse: ArrayLike, map: str | dict[str, Any] | None = None, voltage: ArrayLike | None = None) -> _Floats:
    """Steady thrust of pulse widths on the bench table of a thruster, in still water."""

def pulse_of(thrust: ArrayLike, map: str | dict[str, Any] | None = None, voltage: ArrayLike | None = None) -> _Floats:
    """Pulse widths that give thrusts on the bench table of a thruster, in still water: the inverse of `thrust_of`."""

def read_robot(path: str | PathLike[str]) -> dict[str, Any]:
    """A robot's file as plain data: name, source, format, notes, links, joints and thrusters."""

def assemble_robot(
    robot: dict[str, Any],
    *,
    vehicle: _Scene | None = None,
    thrusters: _Scene | None = None,
    position: _Rows = None,
    rpy: _Rows = None,
    base: str | None = None,
    tips: Sequence[tuple[str, str]] | None = None,
    lock: Sequence[str] | None = None,
    keep: Sequence[str] | None = None,
    density: Sequence[tuple[str | None, float]] | None = None,
) -> tuple[dict[str, Any], list[str]]:
    """The scene of a robot of the form of `read_robot`, and notes; see `uvms_gym.import_robot`."""

def gain_names(kind: str) -> list[str]: ...
def trajectory_inputs(simulator: Simulator, names: Sequence[str]) -> list[int]: ...
def optimize_trajectory(
    simulator: Simulator,
    inputs: Sequence[str],
    arrays: dict[str, _Floats],
    *,
    horizon: int,
    substeps: int,
    iterations: int,
    tolerance: float,
) -> dict[str, Any]: ...
def integrators() -> list[_Integrator]:
    """Integrators that a `Simulator` may use, the default first."""

@final
class Sensors:
    """Sensors on the vehicles of a simulator: IMU, DVL, depth, heading and acoustic position fixes.

    `suite` has the sensors by name with the settings that differ from their defaults, or True; or names; None: all.
    Instance i draws its noise as a single instance with the seed `seed + i`.
    """
    def __new__(
        cls, simulator: Simulator, suite: Mapping[str, Any] | Sequence[str] | None = None, *, seed: int = 0
    ) -> Sensors: ...
    @property
    def num_envs(self) -> int:
        """Number of instances N."""

    @property
    def suite(self) -> dict[str, dict[str, Any]]:
        """All settings of the sensors, by name."""

    def reset(self, seed: int | None = None, mask: ArrayLike | None = None) -> None:
        """Start a new episode of all instances, or of those in `mask` (N,): new biases, no samples on their way."""

    def fail(self, name: str, failed: bool = True, mask: ArrayLike | None = None) -> None:
        """Let a sensor fail or work again, of all instances or of those in `mask` (N,)."""

    def measure(self, simulator: Simulator) -> dict[str, Any]:
        """Sample the present motion; readings that have arrived: `valid`, `time` and values by sensor."""

    def biases(self) -> dict[str, _Floats]:
        """Biases now: "imu" (N, 6), m/s2 and rad/s; "depth" (N, 1), m; "heading" (N, 1), rad."""

@final
class NavigationFilter:
    """Error-state Kalman filter on SE(3): pose, twist and biases of vehicles from the readings of their sensors."""
    def __new__(cls, suite: Mapping[str, Any] | Sequence[str] | None = None, num_envs: int = 1) -> NavigationFilter: ...
    @property
    def num_envs(self) -> int:
        """Number of instances N."""

    @property
    def suite(self) -> dict[str, dict[str, Any]]:
        """All settings of the sensors, by name."""

    def reset(
        self,
        simulator: Simulator,
        position: _Rows = None,
        rotation: _Rows = None,
        twist: _Rows = None,
        *,
        deviations: tuple[float, float, float] = ...,
        mask: ArrayLike | None = None,
    ) -> None:
        """Start at given poses and twists, or the simulator's; deviations are 0.1 m, 0.05 rad, 0.05 m/s by default."""

    def update(self, readings: Mapping[str, Any]) -> None:
        """Move with the IMU and correct by the other sensors: readings of `Sensors.measure`."""

    @property
    def position(self) -> _Floats:
        """(N, 3) estimated vehicle origin in the world, m."""

    @property
    def rotation(self) -> _Floats:
        """(N, 3, 3) estimated rotation, body to world."""

    @property
    def twist(self) -> _Floats:
        """(N, 6) estimated absolute body twist, m/s and rad/s."""

    @property
    def covariance(self) -> _Floats:
        """(N, 12, 12) covariance of the errors of pose and twist in body axes."""

    @property
    def biases(self) -> _Floats:
        """(N, 6) estimated biases of specific force and angular velocity along the vehicle's axes."""

    def innovations(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Innovations of the last update by sensor: `nis`, `degrees` and `accepted`, (N,) each."""

@final
class Simulator:
    """Batched simulator of one scene, or of scenes that differ in their numbers, without any task.

    N is `num_envs`, n the number of joints, m the number of thrusters. SI units; world z up; body x forward, y left,
    z up; quaternions [w, x, y, z]; 6-vectors [linear; angular]: absolute twists [v; omega] in body axes at the vehicle
    frame, wrenches [f; m] in body axes at the body's frame origin. Moving bodies: the vehicle, then one per joint.
    Array arguments have one row for all instances, or one per instance (leading N).

    Integrators: see `integrators`; `tolerance` is for adaptive ones, `gamma` for those on quaternions.
    dtypes: "float64", "float32".

    `scene` may be a list of N scenes of the same structure. `parameters` has numbers of the scene that instances have
    of their own, by their keys in the scene, one row for each instance.
    """
    def __new__(
        cls,
        scene: _Scene | Sequence[_Scene],
        num_envs: int | None = None,
        *,
        dt: float | None = None,
        integrator: str | None = None,
        dtype: str | np.dtype[Any] | type[Any] = "float64",
        threads: int | None = None,
        gamma: float = 1.0,
        tolerance: float = 1e-8,
        prescribed_joints: bool | Sequence[str | int] = False,
        parameters: Mapping[str, ArrayLike] | None = None,
        end_effector: str | None = None,
        error_estimate: bool | None = None,
    ) -> Simulator: ...
    def error_estimate(self) -> dict[str, NDArray[Any]]:
        """Estimated errors of integration since the states were set, with `error_estimate=True`.

        position (N,), m; attitude (N,), rad; q (N, n), rad or m; end_effector_position (N,), m;
        end_effector_attitude (N,), rad; relative (N,), to the scales of the motion (in scenes with contact without
        the velocities, which jump); known (N,), bool.
        """
    num_envs: Final[int]
    """Number of instances N."""
    dt: Final[float]
    """Step size, s."""
    integrator: Final[str]
    """Name of the integrator."""
    dtype: Final[str]
    """Number type that the kernel computes with."""
    gamma: Final[float]
    """Gain of the quaternion integrators, 1/s. [HC eq. 14]"""
    tolerance: Final[float]
    """Bound on the estimated error of a sub-interval of a step, for adaptive integrators."""
    threads: Final[int]
    """Maximum number of threads of a step."""
    instruction_set: Final[str]
    """Instruction set of the kernel: "avx512", "avx2", "fma" or "plain" (see UVMS_INSTRUCTION_SET)."""
    scene: Final[dict[str, Any]]
    """The complete scene, as from `load_scene`; where scenes differ, the scene of the first instance."""
    scenes: Final[list[dict[str, Any]]]
    """The complete scene of each instance."""
    scene_name: Final[str]
    """Name of the scene."""
    num_joints: Final[int]
    """Number of joints n."""
    num_bodies: Final[int]
    """Number of moving bodies, n + 1."""
    num_thrusters: Final[int]
    """Number of thrusters m."""
    joint_names: Final[list[str]]
    """Names of the joints, in the order of every joint array."""
    body_names: Final[list[str]]
    """Names of the moving bodies, "vehicle" first."""
    end_effector_names: Final[list[str]]
    """Names of the end effectors; "default" is the scene's own where it has no other name."""
    thruster_names: Final[list[str]]
    """Names of the thrusters."""
    thruster_limits: Final[_Floats]
    """(m, 2) minimum and maximum thrust, N; of the first instance where they differ."""
    thruster_configuration: Final[_Floats]
    """(6, m) wrench on the vehicle per thrust; of the first instance where they differ. [HC eq. 25]"""
    num_fins: Final[int]
    """Number of fins k."""
    fin_names: Final[list[str]]
    """Names of the fins."""
    fin_limits: Final[_Floats]
    """(k, 2) minimum and maximum deflection, rad."""
    bytes_per_env: Final[int]
    """Bytes of memory per instance."""
    state_size: Final[int]
    """Coordinates s of the state in `step_jacobians`: 12 + 2n, and m more where thrusters have dynamics."""
    @property
    def position(self) -> _Floats:
        """(N, 3) vehicle origin in the world, m."""
    @property
    def rotation(self) -> _Floats:
        """(N, 3, 3) rotation matrix, body to world."""
    @property
    def quaternion(self) -> _Floats:
        """(N, 4) [w, x, y, z], w >= 0, body to world; of either sign for the quaternion integrators."""
    @property
    def twist(self) -> _Floats:
        """(N, 6) absolute body twist [v; omega], m/s and rad/s."""
    @property
    def q(self) -> _Floats:
        """(N, n) joint coordinates, rad or m."""
    @property
    def qd(self) -> _Floats:
        """(N, n) joint rates, rad/s or m/s."""
    @property
    def thrust(self) -> _Floats:
        """(N, m) thrusts in still water, N: the state of thrusters with dynamics, else 0."""
    @property
    def time(self) -> _Floats:
        """(N,) time, s."""
    @property
    def stiffness(self) -> _Floats:
        """(N,) dt times the fastest rate that each instance's motion excites, estimated from its last steps."""
    @property
    def step_error(self) -> _Floats:
        """(N,) relative velocity error of each instance's last steps, estimated from their stages."""
    @property
    def current(self) -> _Floats:
        """(N, 3) velocity of the water in the world, m/s."""
    @property
    def current_acceleration(self) -> _Floats:
        """(N, 3) acceleration of the water in the world, m/s^2."""
    def set_state(
        self,
        position: _Rows = None,
        rotation: _Rows = None,
        quaternion: _Rows = None,
        twist: _Rows = None,
        q: _Rows = None,
        qd: _Rows = None,
        time: _Rows = None,
        current: _Rows = None,
        current_acceleration: _Rows = None,
        thrust: _Rows = None,
    ) -> None:
        """Set parts of the state; parts that are not given do not change. ValueError before anything changes."""
    def reset(self) -> None:
        """Put all instances at the scene's home, at rest at time 0."""
    def step(self, *, substeps: int = 1, **inputs: Unpack[StepInputs]) -> None:
        """Step all instances under inputs held constant over the call."""
    def forward_dynamics(self, **inputs: Unpack[StepInputs]) -> _Floats:
        """(N, 6 + n) accelerations [V'; q''] under the inputs of `step`."""
    def mass_matrix(self) -> _Floats:
        """(N, 6 + n, 6 + n) M, added mass included. [HC eq. 13]"""
    def bias(self) -> _Floats:
        """(N, 6 + n) the vector C [V; q']: no damping, no restoring, no acceleration of the water. [HC eq. 13]"""
    def equations(self, nu: _Rows = None, *, axes: str = "flu") -> dict[str, _Floats]:
        """Fossen's M nu' + C(nu) nu + D(nu) nu + g(eta) = tau, nu relative to the water. [F21 sections 6.3, 10.3]

        nu (N, 6 + n), by default the present [V_r; q']; M (N, 6 + n, 6 + n); C_nu, D_nu, g (N, 6 + n). `axes` is "flu"
        or "ned" (x forward, y starboard, z down).
        """
    def wrench_influence(self) -> _Floats:
        """(N, 6 + n, 6 (n + 1)) W. [HC eq. 13]"""
    def torque_influence(self) -> _Floats:
        """(N, 6 + n, n) L. [HC eq. 13]"""
    def body_wrenches(self, **inputs: Unpack[StepInputs]) -> dict[str, _Floats]:
        """(N, n + 1, 6) each: damping, restoring, flow, thrust, `vehicle_terms`, contact, external, sum; N and N m."""
    def joint_torques(self, **inputs: Unpack[StepInputs]) -> dict[str, _Floats]:
        """(N, n) each: command, friction, spring, end_stop, sum; N m or N."""
    def energy(self) -> dict[str, _Floats]:
        """(N,) each: kinetic_rigid, kinetic_added, potential, elastic, contact, fixtures, total; J."""
    def power(self, **inputs: Unpack[StepInputs]) -> dict[str, _Floats]:
        """(N,) each: damping, friction, end_stop, flow, thrust, `vehicle_terms`, contact, fixtures, external,
        joint_command, total; W."""
    def contacts(self) -> dict[str, _Floats]:
        """Every sphere with every shape: depth, normal_force, slip (N, shapes, spheres); force, point,
        normal (N, shapes, spheres, 3); m, N and m/s, world axes."""
    def momentum(self) -> _Floats:
        """(N, 6) total momentum [linear; angular] in world axes about the world origin, N s and N m s."""
    def momentum_terms(self) -> dict[str, _Floats]:
        """Momentum by terms: rigid, added, total (N, 6); rigid_scale, total_scale (N, 2)."""
    def body_poses(self) -> _Floats:
        """(N, n + 1, 4, 4) poses of the moving bodies in the world."""
    def fixture_poses(self) -> _Floats:
        """(N, F, 4, 4) poses of the fixtures in the world."""
    def end_effector_pose(self, name: str | None = None) -> _Floats:
        """(N, 4, 4) pose in the world of the end effector in use, or of this name."""
    def jacobian(self, name: str | None = None) -> _Floats:
        """(N, 6, 6 + n) absolute body twist of the end effector in use, or of this name, per [V; q']. [MLS94]"""
    def inverse_dynamics(
        self, acceleration: ArrayLike, *, thrust: _Rows = None, external: _Rows = None
    ) -> tuple[_Floats, _Floats]:
        """Vehicle wrench (N, 6) and actuator torques (N, n) that give `acceleration` (6 + n,) or (N, 6 + n)."""
    def linearize(
        self,
        *,
        thrust: _Rows = None,
        wrench: _Rows = None,
        joint_torque: _Rows = None,
        external: _Rows = None,
        fin: _Rows = None,
    ) -> tuple[_Floats, _Floats]:
        """A (N, 12 + 2n, 12 + 2n) and B (N, 12 + 2n, 6 + n) of z = [xi; dq; dV; dq'] and u = [dF; dtau]. [PC05]"""
    def step_jacobians(
        self,
        *,
        substeps: int = 1,
        parameters: Sequence[str] = (),
        **inputs: Unpack[StepInputs],
    ) -> dict[str, _Floats]:
        """Derivatives of the step, (N, s, w) each: "state", each input given, "parameters"; docs/gradients.md."""
    def step_jvp(
        self,
        tangents: Mapping[str, ArrayLike],
        *,
        substeps: int = 1,
        parameters: Sequence[str] = (),
        **inputs: Unpack[StepInputs],
    ) -> _Floats:
        """(N, s) Jacobians of `step_jacobians` times tangents (w,) or (N, w) by its keys; absent ones are 0."""
    def step_vjp(
        self,
        cotangents: ArrayLike,
        *,
        substeps: int = 1,
        parameters: Sequence[str] = (),
        **inputs: Unpack[StepInputs],
    ) -> dict[str, _Floats]:
        """(N, w) each: cotangents (s,) or (N, s) of the next state times `step_jacobians`, by its keys."""
    @property
    def parameters(self) -> dict[str, _Floats]:
        """(N,) factors on mass, added mass, linear and quadratic damping, volume, thrust, thruster lag; payload, kg."""
    def scale_parameters(
        self,
        *,
        mass: _Rows = None,
        added_mass: _Rows = None,
        linear_damping: _Rows = None,
        quadratic_damping: _Rows = None,
        volume: _Rows = None,
        payload: _Rows = None,
        thrust: _Rows = None,
        thruster_lag: _Rows = None,
    ) -> None:
        """Set factors, () or (N,), on each instance's parameters, and its payload, kg; `reset` does not change them."""
    def trim(self) -> dict[str, _Floats]:
        """Trim at rest: wrench (N, 6), thrust (N, m), joint_torque (N, n), residual (N, 6)."""
    def modes(self, speed: _Rows = None, *, joint_servos: bool = True, vehicle_servo: bool = True) -> list[_Mode]:
        """Rates at which deviations decay, oscillate or grow, fastest first; at expected vehicle `speed` () or (6,)."""
    def stable_steps(
        self, speed: _Rows = None, *, joint_servos: bool = True, vehicle_servo: bool = True, end_stops: bool = True
    ) -> dict[str, float]:
        """Maximum step, s, at which each integrator is stable for all modes, by its name; infinite if every step is."""
    def allocate(self, wrench: ArrayLike) -> _Floats:
        """(N, m) thrusts that come closest to `wrench` (6,) or (N, 6), scaled uniformly into their limits."""
    def __copy__(self) -> Simulator: ...
    def __deepcopy__(self, memo: object, /) -> Simulator: ...
    def __getnewargs_ex__(self) -> tuple[tuple[dict[str, Any], int], dict[str, Any]]: ...
    def __getstate__(self) -> _Floats: ...
    def __setstate__(self, state: ArrayLike, /) -> None: ...

@final
class Renderer:
    """Draws pictures of one scene: vehicle, arm and thrusters where the physics has them.

    `vehicle.shape` of the scene is the shape of the vehicle. Camera at `azimuth` about the vertical from x and
    `elevation`, rad, and at `distance`, m; `floor` is the height of the floor, m, by default a level plane's.
    """
    def __new__(
        cls,
        scene: _Scene,
        *,
        width: int = 640,
        height: int = 480,
        azimuth: float | None = None,
        elevation: float = 0.32,
        distance: float | None = None,
        floor: float | None = None,
    ) -> Renderer: ...
    width: Final[int]
    """Pixels along."""
    height: Final[int]
    """Pixels down."""
    distance: Final[float]
    """Distance of the camera, m."""
    azimuth: Final[float]
    """Azimuth of the camera, rad."""
    floor: Final[float]
    """Height of the floor, m."""
    cell: Final[float]
    """Width of the cells of the floor's grid, m."""
    bounding_box: Final[_Floats]
    """(2, 3) centre and edges, m, of the box about the vehicle's body, in the vehicle frame."""
    @property
    def spheres(self) -> list[tuple[int, list[float], float]]:
        """Spheres of contact: number of the moving body, 0 for the vehicle, centre in its frame and radius, m."""
    def meshes(
        self,
    ) -> dict[str, tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]]:
        """Meshes of `vehicle`, `link 1`, ... in the frames of `Simulator.body_poses`, `fixture 1`, `world`, `dock`.

        Vertices, m, normals and colours, 0 to 1, (n, 3), and triangles (m, 3); joints at home.
        """
    def draw(
        self,
        position: ArrayLike,
        rotation: ArrayLike,
        q: _Rows = None,
        *,
        thrust: _Rows = None,
        target: _Pose = None,
        path: _Rows = None,
        point: _Pose = None,
        dock: _Pose = None,
        trail: _Rows = None,
        current: _Rows = None,
        payload: float = 0.0,
        time: float = 0.0,
    ) -> NDArray[np.uint8]:
        """(height, width, 3) picture of the vehicle at position (3,) and rotation (3, 3) with joints at q (n,).

        thrust (m,) N; target and point: poses (4, 4) or (position, rotation) of vehicle and end effector; dock: pose of
        the vehicle in it; path and trail (k, 3) of the end effector; current (3,) m/s; payload kg; time s. World frame.
        """
    def project(
        self,
        points: ArrayLike,
        position: ArrayLike,
        rotation: ArrayLike,
        *,
        target: _Pose = None,
        point: _Pose = None,
        dock: _Pose = None,
    ) -> _Floats:
        """(k, 3) pixels from left and top, and distance, of points (k, 3) in the picture of these poses."""
    def __getnewargs_ex__(self) -> tuple[tuple[dict[str, Any]], dict[str, Any]]: ...

_Finals: TypeAlias = tuple[NDArray[np.int64], NDArray[np.float32], _Floats, _Floats]
_StepArrays: TypeAlias = tuple[NDArray[np.float32], _Floats, NDArray[np.bool_], NDArray[np.bool_], _Floats]

@final
class Task:
    """Batch of episodes of a task; the environments in `uvms_gym.envs` document its arguments and attributes."""

    INFO: ClassVar[list[str]]
    metric_names: Final[list[str]]
    target_frame: Final[str]
    num_envs: Final[int]
    scene: Final[dict[str, Any]]
    layout: Final[list[dict[str, Any]]]
    action_layout: Final[list[dict[str, Any]]]
    privileged_layout: Final[list[dict[str, Any]]]
    control_period: Final[float]
    delays: Final[tuple[int, int]]
    late: Final[bool]
    observation_bound: Final[NDArray[np.float32]]
    def __new__(
        cls,
        scene: _Scene,
        options: dict[str, Any],
        *,
        num_envs: int = 1,
        integrator: str | None = None,
        dtype: str = "float64",
        threads: int | None = None,
        autoreset: str = "disabled",
        max_episode_steps: int | None = None,
        error_estimate: bool | None = None,
    ) -> Task: ...
    def error_estimate(self) -> dict[str, NDArray[Any]]: ...
    def snapshot(self) -> Simulator: ...
    def privileged(self) -> _Floats: ...
    def perfect_observations(self) -> NDArray[np.float32]: ...
    def record(
        self,
        actor: Mlp,
        noise: NDArray[np.float32],
        teacher: Controller | None = None,
        *,
        teacher_acts: bool = False,
        frames: bool = False,
    ) -> dict[str, NDArray[Any]]: ...
    gradient_widths: Final[tuple[int, int, int, int, int, int]]
    base: Final[Controller | None]
    def frames(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
    def forces(
        self, memories: NDArray[np.float32], actions: ArrayLike, base: ArrayLike | None = None
    ) -> tuple[_Floats, _Floats]: ...
    def act_vjp(
        self, memories: NDArray[np.float32], actions: ArrayLike, cotangents: ArrayLike, base: ArrayLike | None = None
    ) -> _Floats: ...
    def evaluate_vjp(
        self,
        states: NDArray[np.float32],
        memories: NDArray[np.float32],
        before: NDArray[np.float32],
        fresh: list[bool],
        cotangents: ArrayLike,
        *,
        perfect: bool = False,
    ) -> _Floats: ...
    def reset(
        self, seeds: list[int | None], mask: NDArray[np.bool_] | None = None, **given: Any
    ) -> tuple[NDArray[np.float32], _Floats]: ...
    def step(self, actions: NDArray[np.float32], out: _StepArrays) -> _Finals | None: ...
    def step_one(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, float]]: ...
    def episodes(self) -> dict[str, NDArray[Any]]: ...
    def disturbance(self, i: int, steps: int) -> dict[str, _Floats]: ...
    def paths(self, count: int) -> _Floats: ...
    def controller(self, kind: str, gains: dict[str, float | list[float] | None]) -> Controller: ...
    def rollout(self, controller: Controller, trace: list[int] = ...) -> Rollout: ...
    def run(self, rollout: Rollout, steps: int) -> None: ...
    def __getnewargs_ex__(self) -> tuple[tuple[dict[str, Any], dict[str, Any]], dict[str, Any]]: ...
    def __getstate__(self) -> tuple[_Floats, _Floats]: ...
    def __setstate__(self, state: tuple[ArrayLike, ArrayLike]) -> None: ...

@final
class Rollout:
    """Memory of a controller for a batch's instances, and statistics of the steps so far."""
    @property
    def traces(self) -> list[dict[str, Any]]: ...
    def pop_stats(self) -> dict[str, Any]: ...

@disjoint_base
class Controller:
    """A native controller: called by `act`, or in a closed loop by `Task.run`."""

    widths: Final[list[int]]
    gains: Final[dict[str, Any]]
    memory_layout: Final[list[tuple[str, int]]]
    @staticmethod
    def blend(parts: list[tuple[Controller, float]], guard: tuple[Task, tuple[float, float]] | None) -> Controller: ...
    def act(self, observations: NDArray[np.float32], memory: _Floats) -> tuple[NDArray[np.float32], _Floats]: ...

@final
class Mlp(Controller):
    """A multilayer perceptron in single precision; `uvms_gym.MLP` documents its attributes."""
    def __new__(
        cls,
        weights: list[NDArray[np.float32]],
        biases: list[NDArray[np.float32]],
        *,
        activation: str,
        output: str,
        history: int,
        normalisation: tuple[NDArray[np.float32], NDArray[np.float32], float, float] | None,
        task: Task | None,
        residual: bool,
        notes: dict[str, str],
    ) -> Mlp: ...
    @staticmethod
    def from_bytes(bytes: bytes) -> Mlp: ...
    def to_bytes(self) -> bytes: ...
    def check(self, task: Task, *, residual: bool) -> None: ...
    def correcting(self, base: Controller, limit: float) -> Controller: ...
    residual: Final[bool]
    history: Final[int]
    sizes: Final[list[int]]
    spec: Final[dict[str, Any] | None]
    notes: Final[dict[str, str]]
    activation: Final[str]
