//! Errors of the simulator: options and inputs.

use super::{ControlError, DynamicsError, OutOfMemory};

/// Invalid option or input of a simulator.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// No instances.
    #[error("num_envs must be at least 1")]
    NoInstances,
    /// No threads.
    #[error("threads must be at least 1 (or None for one per core)")]
    NoThreads,
    /// Invalid step size.
    #[error("dt is {dt}, but must be a positive number of seconds")]
    Step { dt: f64 },
    /// Invalid gain of `[HC eq. 14]`.
    #[error("gamma is {gamma}, but must be a number >= 0")]
    Gamma { gamma: f64 },
    /// Invalid expected speed.
    #[error("speed is {value}, but must be a number >= 0 (m/s and rad/s)")]
    Speed { value: f64 },
    /// Invalid tolerance.
    #[error("tolerance is {tolerance}, but must be a positive number")]
    Tolerance { tolerance: f64 },
    /// Unknown integrator.
    #[error("no integrator named '{name}': one of {}", known.join(", "))]
    UnknownIntegrator { name: String, known: Vec<&'static str> },
    /// Input of the wrong length.
    #[error("{name} has {got} numbers, but must have {expected}")]
    Length { name: &'static str, expected: usize, got: usize },
    /// NaN or infinite entry of an instance's row of an input.
    #[error("{name} of instance {instance}, entry {entry}, is {value}: must be finite in the simulator's dtype")]
    NotFinite { name: &'static str, instance: usize, entry: usize, value: f64 },
    /// Scenes of one batch that differ in more than numbers.
    #[error("scene {instance} ('{scene}') differs in structure from scene 0: {place}")]
    Structure { instance: usize, scene: String, place: String },
    /// Number of scenes other than the number of instances.
    #[error("{scenes} scenes, but num_envs is {instances}: one scene, or one for each")]
    Scenes { scenes: usize, instances: usize },
    /// Out of memory.
    #[error("num_envs is {instances}: not enough memory for that many instances")]
    Memory { instances: usize },
    /// Interrupted by the caller.
    #[error("interrupted")]
    Interrupted,
    /// Out of memory for results.
    #[error(transparent)]
    OutOfMemory(#[from] OutOfMemory),
    /// Matrix that is not a rotation, by the maximum entry of `|R^T R - I|`.
    #[error(
        "{name} of instance {instance} is not a rotation: R^T R differs from the identity by {deviation:.3e}, det R is {determinant:.6}"
    )]
    NotARotation { name: &'static str, instance: usize, deviation: f64, determinant: f64 },
    /// Quaternion that cannot be normalised.
    #[error("quaternion of instance {instance} is zero, or too large or small to be normalised")]
    NoAttitude { instance: usize },
    /// Attitude given twice.
    #[error("give the attitude as rotation or as quaternion, not both")]
    TwoAttitudes,
    /// Nonzero twist of a fixed vehicle.
    #[error("twist of instance {instance} is not zero, but the vehicle of scene '{scene}' is fixed (vehicle.fixed)")]
    FixedVehicle { scene: String, instance: usize },
    /// Acceleration of the water without gravity.
    #[error(
        "current_acceleration of instance {instance} is not zero, but scene '{scene}' has no gravity (water.gravity), so \
             neither weight nor buoyancy"
    )]
    Weightless { scene: String, instance: usize },
    /// Thrust as a state of ideal thrusters.
    #[error("the thrusters of scene '{scene}' have no dynamics, so thrust is not a state: pass it to step()")]
    NoThrusterState { scene: String },
    /// Thrust out of the thruster's limits.
    #[error("thrust {thruster} of instance {instance} is {value} N, but must be within [{lower}, {upper}] N")]
    Thrust { instance: usize, thruster: usize, value: f64, lower: f64, upper: f64 },
    /// Joint targets without a joint servo.
    #[error("scene '{scene}' has no joint with a servo and no prescribed one, so joint_target would have no effect")]
    NoJointServo { scene: String },
    /// Invalid factor on a parameter.
    #[error("factor on {name} of instance {instance} is {value}, but must be finite and >= 0 (mass: > 0)")]
    Factor { name: &'static str, instance: usize, value: f64 },
    /// Pose target for a vehicle without servo.
    #[error("scene '{scene}' has no [vehicle.servo], so its vehicle cannot hold a pose")]
    NoVehicleServo { scene: String },
    /// Derivatives without wide lanes.
    #[error("derivatives of steps need a machine with AVX2 or NEON")]
    DerivativeLanes,
    /// Derivatives of an integrator without them.
    #[error("integrator '{name}' has no derivatives of steps: use one of {}", known.join(", "))]
    DerivativeIntegrator { name: String, known: Vec<&'static str> },
    /// Unknown parameter.
    #[error("parameters: no parameter '{name}': one of {}", known.join(", "))]
    UnknownParameter { name: String, known: Vec<&'static str> },
    /// Unavailable instruction set.
    #[error(transparent)]
    Lanes(#[from] crate::lane::UnknownIsa),
    /// Error of the dynamics.
    #[error(transparent)]
    ClosedFormModel(#[from] DynamicsError),
    /// Error of the thruster allocation.
    #[error(transparent)]
    Control(#[from] ControlError),
}
