//! Errors, one enum per boundary.

use std::fmt;

/// A scene that cannot be read or that no physical system can have.
#[derive(Debug, thiserror::Error)]
pub enum DescriptionError {
    /// The file cannot be read.
    #[error("{path}: {error}")]
    File {
        /// Path as given.
        path: String,
        /// What the system said.
        error: std::io::Error,
    },
    /// Neither a shipped scene nor a path to a TOML file.
    #[error("no scene named '{name}': give a path ending in .toml, or one of {}", shipped.join(", "))]
    UnknownScene {
        /// Name as given.
        name: String,
        /// Names of the shipped scenes.
        shipped: Vec<&'static str>,
    },
    /// Not TOML.
    #[error("{source_name}: {message}")]
    Syntax {
        /// File, or `<dict>`.
        source_name: String,
        /// The parser's message, with line and column.
        message: String,
    },
    /// An element of a URDF file that is wrong, or that no scene can have.
    #[error("{source_name}: line {line}: {element}: {problem}")]
    Urdf {
        /// File.
        source_name: String,
        /// Of the element.
        line: u32,
        /// Path of the element, such as `joint "elbow" <limit>`.
        element: String,
        /// What is wrong.
        problem: String,
    },
    /// One key has a value that cannot be.
    #[error("{source_name}: {key}: {problem}")]
    Value {
        /// File, or `<dict>`, or the scene's name.
        source_name: String,
        /// Path of the key, such as `arm.links[2].body.mass`, followed by ` (name)` of the list element if it has one.
        key: String,
        /// What is wrong.
        problem: Problem,
    },
}

/// What is wrong with the value of one key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// Required, but not there.
    #[error("missing")]
    Missing,
    /// No such key.
    #[error("unknown key with value {value}; expected {expected}")]
    UnknownKey {
        /// The value found there.
        value: String,
        /// The keys that there may be.
        expected: String,
    },
    /// Wrong type or wrong length.
    #[error("{reason}; the value is {value}")]
    Form {
        /// What was expected.
        reason: String,
        /// The value found there.
        value: String,
    },
    /// NaN, infinite, or too large to compute with.
    #[error("{value:?} is not a finite number of magnitude up to {max:e}")]
    NotFinite {
        /// The number.
        value: f64,
        /// Greatest magnitude.
        max: f64,
    },
    /// Out of the range of physical values.
    #[error("is {value:?}, but must be {rule}")]
    Range {
        /// The number.
        value: f64,
        /// The rule it breaks.
        rule: &'static str,
    },
    /// A pair of limits that does not enclose what it must.
    #[error("is [{lower:?}, {upper:?}], which must {rule}")]
    Limits {
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
        /// The rule it breaks.
        rule: &'static str,
    },
    /// A start outside of the joint's limits.
    #[error("{home:?} is outside of the limits [{lower:?}, {upper:?}]")]
    HomeOutside {
        /// Start.
        home: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// A map from command to thrust that is none.
    #[error("{reason}")]
    Map {
        /// Why.
        reason: &'static str,
    },
    /// A direction without length.
    #[error("{axis:?} has no direction")]
    ZeroAxis {
        /// The vector.
        axis: [f64; 3],
    },
    /// Asymmetric beyond rounding.
    #[error(
        "not symmetric: entries [{row}][{column}] and [{column}][{row}] are {upper:?} and {lower:?}, which differ by more \
         than {tolerance:e} of the largest entry"
    )]
    Asymmetric {
        /// Row.
        row: usize,
        /// Column.
        column: usize,
        /// Entry above the diagonal.
        upper: f64,
        /// Entry below the diagonal.
        lower: f64,
        /// Relative tolerance.
        tolerance: f64,
    },
    /// A matrix with an eigenvalue of the wrong sign.
    #[error("{what} must be positive {}definite, but has the eigenvalue {eigenvalue:.6e} (eigenvalues {eigenvalues})", if *.semi { "semi-" } else { "" })]
    Indefinite {
        /// Which matrix.
        what: &'static str,
        /// Whether zero is allowed.
        semi: bool,
        /// The least eigenvalue.
        eigenvalue: f64,
        /// All of them, in ascending order.
        eigenvalues: Numbers,
    },
    /// No mass distribution has such moments.
    #[error(
        "principal moments {moments} about the centre of mass break the triangle inequality: the largest exceeds the sum of the others"
    )]
    Triangle {
        /// Principal moments in ascending order, kg m2.
        moments: Numbers,
    },
    /// A negative diagonal entry.
    #[error("entry [{index}][{index}] is {value:?}, but drag must oppose motion: it must be >= 0")]
    NegativeDiagonal {
        /// Row and column.
        index: usize,
        /// The entry.
        value: f64,
    },
    /// A stated weight that is not mass times gravity.
    #[error(
        "{weight:?} N contradicts mass {mass:?} kg x gravity {gravity} m/s2 = {expected} N by more than {percent} %"
    )]
    Weight {
        /// As stated, N.
        weight: f64,
        /// Mass, kg.
        mass: f64,
        /// Magnitude of gravity, m/s2.
        gravity: f64,
        /// Mass times gravity, N.
        expected: f64,
        /// Tolerance.
        percent: f64,
    },
    /// Both ways to state one thing.
    #[error("{buoyancy:?} N is given besides volume {volume:?} m3: give one of them")]
    TwoBuoyancies {
        /// N.
        buoyancy: f64,
        /// m3.
        volume: f64,
    },
    /// Buoyancy that no water can give.
    #[error("{buoyancy:?} N cannot be without weight of water: density is {density} kg/m3, gravity {gravity} m/s2")]
    BuoyancyWithoutWater {
        /// N.
        buoyancy: f64,
        /// kg/m3.
        density: f64,
        /// Magnitude of gravity, m/s2.
        gravity: f64,
    },
    /// More list elements than there may be.
    #[error("{found} elements, of which there may be at most {max}")]
    TooMany {
        /// How many there are.
        found: usize,
        /// How many there may be.
        max: usize,
    },
    /// A name that is empty, reserved or taken.
    #[error("the name '{name}' is {reason}")]
    Name {
        /// The name.
        name: String,
        /// Why it cannot be.
        reason: &'static str,
    },
    /// A joint that would move a massless base.
    #[error("missing: mount.joint moves the arm's base, which therefore needs a mass")]
    MasslessBase,
    /// Provenance of something that the scene does not have.
    #[error("'{text}' describes no key of this scene: remove this entry, or set provenance = {{}}")]
    ProvenanceOfNothing {
        /// The text.
        text: String,
    },
    /// Provenance in other words than the four.
    #[error("'{text}' must be 'measured: ...', 'cited: ...', 'derived: ...' or 'assumed: ...'")]
    Provenance {
        /// The text.
        text: String,
    },
}

/// Numbers shown with few digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

impl fmt::Display for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text: Vec<_> = self.0.iter().map(|x| format!("{x:.4e}")).collect();
        write!(f, "[{}]", text.join(", "))
    }
}

/// What the closed form refuses.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum BalanceError {
    /// A system whose mass matrix does not determine its accelerations.
    #[error("the mass matrix is not positive definite: some motion of the system meets no inertia")]
    NotPositiveDefinite,
    /// An array of the wrong length.
    #[error("{what}: expected {expected} entries, got {got}")]
    Length {
        /// What the array is.
        what: &'static str,
        /// Length that fits the scene.
        expected: usize,
        /// Its length.
        got: usize,
    },
    /// More joints than a state holds.
    #[error("{joints} joints, but a state holds at most {max}")]
    Joints {
        /// Joints of the scene.
        joints: usize,
        /// Joints of a state.
        max: usize,
    },
}

/// A simulator that cannot be made, or an input that it cannot take.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// No instances.
    #[error("num_envs must be at least 1")]
    NoInstances,
    /// No threads.
    #[error("threads must be at least 1 (or None for one per core)")]
    NoThreads,
    /// A step that is no step.
    #[error("dt is {dt}, but must be a positive number of seconds")]
    Step {
        /// As given.
        dt: f64,
    },
    /// A gain of eq. 14 that is none.
    #[error("gamma is {gamma}, but must be a number >= 0")]
    Gamma {
        /// As given.
        gamma: f64,
    },
    /// An expected speed that is none.
    #[error("speed is {value}, but must be a number >= 0 (m/s and rad/s)")]
    Speed {
        /// As given.
        value: f64,
    },
    /// A tolerance that is none.
    #[error("tolerance is {tolerance}, but must be a positive number")]
    Tolerance {
        /// As given.
        tolerance: f64,
    },
    /// No such integrator.
    #[error("no integrator named '{name}': one of {}", known.join(", "))]
    UnknownIntegrator {
        /// As given.
        name: String,
        /// Names that there are.
        known: Vec<&'static str>,
    },
    /// Too many or too few numbers.
    #[error("{name} has {got} numbers, but {expected} are needed")]
    Length {
        /// Name of the input.
        name: &'static str,
        /// Numbers needed.
        expected: usize,
        /// Numbers given.
        got: usize,
    },
    /// NaN or infinite.
    #[error("{name} of instance {instance}, entry {entry}, is {value}: it must be finite in the simulator's dtype")]
    NotFinite {
        /// Name of the input.
        name: &'static str,
        /// Instance.
        instance: usize,
        /// Entry within the instance's row.
        entry: usize,
        /// The number.
        value: f64,
    },
    /// More memory than there is.
    #[error("num_envs is {instances}: there is not enough memory for that many instances")]
    Memory {
        /// Number of instances.
        instances: usize,
    },
    /// A matrix that does not rotate.
    #[error(
        "{name} of instance {instance} is no rotation: R^T R differs from the identity by {deviation:.3e}, det R is {determinant:.6}"
    )]
    NotARotation {
        /// Name of the input.
        name: &'static str,
        /// Instance.
        instance: usize,
        /// Greatest entry of `|R^T R - I|`.
        deviation: f64,
        /// Determinant.
        determinant: f64,
    },
    /// A quaternion without direction.
    #[error("quaternion of instance {instance} is zero, or too large or small to have a length")]
    NoAttitude {
        /// Instance.
        instance: usize,
    },
    /// Two attitudes at once.
    #[error("give the attitude as rotation or as quaternion, not as both")]
    TwoAttitudes,
    /// Motion of a vehicle that is held.
    #[error("twist of instance {instance} is not zero, but scene '{scene}' holds its vehicle (vehicle.fixed)")]
    Held {
        /// Name of the scene.
        scene: String,
        /// Instance.
        instance: usize,
    },
    /// Acceleration of water that has no weight.
    #[error(
        "current_acceleration of instance {instance} is not zero, but scene '{scene}' has no gravity (water.gravity), and so \
             neither weight nor buoyancy"
    )]
    Weightless {
        /// Name of the scene.
        scene: String,
        /// Instance.
        instance: usize,
    },
    /// Thrusts as a state where thrusters have none.
    #[error("scene '{scene}' gives its thrusters no dynamics, so thrust is no state: give it to step()")]
    NoThrusterState {
        /// Name of the scene.
        scene: String,
    },
    /// A thrust that the thruster cannot have.
    #[error("thrust {thruster} of instance {instance} is {value} N, beyond its limits [{lower}, {upper}] N")]
    Thrust {
        /// Instance.
        instance: usize,
        /// Thruster.
        thruster: usize,
        /// The thrust.
        value: f64,
        /// Least.
        lower: f64,
        /// Greatest.
        upper: f64,
    },
    /// Joint targets where nothing follows them.
    #[error("scene '{scene}' has no joint with a servo, so joint_target would have no effect")]
    NoJointServo {
        /// Name of the scene.
        scene: String,
    },
    /// A factor that no body's parameter can take.
    #[error(
        "factor on {name} of instance {instance} is {value}: it must be finite and not negative, and not 0 for mass"
    )]
    Factor {
        /// Name of the parameter.
        name: &'static str,
        /// Instance.
        instance: usize,
        /// The factor.
        value: f64,
    },
    /// A station for a vehicle without servo.
    #[error("scene '{scene}' has no [vehicle.servo], so its vehicle cannot keep a station")]
    NoVehicleServo {
        /// Name of the scene.
        scene: String,
    },
    /// The instruction set asked for is not there.
    #[error(transparent)]
    Lanes(#[from] crate::lane::UnknownIsa),
    /// The scene does not compose.
    #[error(transparent)]
    Balance(#[from] BalanceError),
    /// The vehicle's thrusters cannot be allocated.
    #[error(transparent)]
    Control(#[from] ControlError),
}

/// A vehicle that cannot be controlled as described, or arguments of the wrong shape.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ControlError {
    /// Saturation by uniform scaling needs zero thrust to be possible.
    #[error("thruster \"{name}\": limits [{lower}, {upper}] N must be finite, with lower <= 0 <= upper")]
    ThrusterLimits { name: String, lower: f64, upper: f64 },
    /// No direction, or no place.
    #[error("thruster \"{name}\": position {position:?} and axis {axis:?} must be finite, and the axis not zero")]
    ThrusterGeometry { name: String, position: [f64; 3], axis: [f64; 3] },
    /// More than the arrays hold.
    #[error("{count} thrusters: at most {greatest} are supported")]
    TooManyThrusters { count: usize, greatest: usize },
    /// A scene that no model can be made of.
    #[error("{0}")]
    Model(String),
    /// A gain that is no number, or that would drive the vehicle away.
    #[error("gain {name}[{index}] = {value}: must be finite and not negative")]
    Gain { name: &'static str, index: usize, value: f64 },
    /// A delay that nobody predicts.
    #[error("delay of {periods} control periods: at most {most} are predicted")]
    Delay { periods: u32, most: u32 },
    /// A bound that is not a share of an actuator's limit.
    #[error("{name} is {value}, but must be in [0, 1]")]
    Limit { name: &'static str, value: f64 },
    /// Arrays that do not fit together.
    #[error("{what}: {got} numbers, expected {expected}")]
    Shape { what: &'static str, got: usize, expected: usize },
    /// An instance that there is not.
    #[error("instance {instance}: there are {instances}, counted from 0")]
    Instance { instance: usize, instances: usize },
    /// A policy for other rows.
    #[error(
        "the policy reads {got} entries of an observation and gives {gives} of an action; here they are {expected} and {takes}"
    )]
    Widths { got: usize, gives: usize, expected: usize, takes: usize },
}

/// A task that cannot be set up, or started, as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TaskError {
    /// Thrusters, gains, shapes.
    #[error(transparent)]
    Control(#[from] ControlError),
    /// The scene lacks what the task needs.
    #[error("scene \"{scene}\" is not for this task: {reason}")]
    Scene { scene: String, reason: String },
    /// An option that there is not, or of the wrong kind.
    #[error("options: {0}")]
    Options(String),
    /// An option out of its range.
    #[error("option {name} = {value}: must be {allowed}")]
    Option { name: &'static str, value: f64, allowed: &'static str },
    /// A start override that is no start.
    #[error("start {name} = {value}: must be {allowed}")]
    Start { name: &'static str, value: f64, allowed: String },
    /// A disturbance that is none: where, and why.
    #[error("{key}: {reason}")]
    Disturbance { key: String, reason: String },
    /// An action that is no number; out of range is clipped instead.
    #[error("action {index} of instance {instance} is {value}: must be finite")]
    Action { instance: usize, index: usize, value: f32 },
    /// A step, or a reset that leaves an instance out, before its first reset.
    #[error("instance {instance} was never reset: call reset() first")]
    NotBegun { instance: usize },
    /// A step of an instance whose episode is over, without autoreset.
    #[error("the episode of instance {instance} is over: reset it first")]
    Over { instance: usize },
    /// The physics of the task.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// Numbers that are not a saved episode.
    #[error("saved episode: {0}")]
    Saved(String),
}

/// A policy that is none, or that does not fit where it is to be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PolicyError {
    /// Not a safetensors file, cut off, or not one of a policy.
    #[error("no policy of uvms_gym: {0}")]
    File(String),
    /// A network without layers.
    #[error("a policy needs at least one layer")]
    NoLayers,
    /// Layers that do not follow each other.
    #[error("layer {layer} has {got} weights, but must have {outputs} x {inputs}, and at least one")]
    Layer { layer: usize, outputs: usize, inputs: usize, got: usize },
    /// Inputs that are no whole observations.
    #[error("a policy that reads {history} observations at once cannot have {inputs} inputs")]
    History { history: usize, inputs: usize },
    /// Too many or too few numbers.
    #[error("{tensor} has {got} numbers, but must have {expected}")]
    Length { tensor: String, got: usize, expected: usize },
    /// NaN or infinite.
    #[error("{tensor}: number {index} is {value}, but must be finite")]
    NotFinite { tensor: String, index: usize, value: f32 },
    /// Out of its range.
    #[error("{name} is {value}, but must be {rule}")]
    Number { name: &'static str, value: f32, rule: &'static str },
    /// Made for something else.
    #[error("the policy does not fit: its {what} is {policy}, the environment's {environment}")]
    Mismatch { what: &'static str, policy: String, environment: String },
    /// The instruction set asked for is not there.
    #[error(transparent)]
    Lanes(#[from] crate::lane::UnknownIsa),
}

/// A renderer that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// A picture that is too large, or has no pixels.
    #[error("{what} is {got}, but must be 1 to {most}")]
    Size {
        /// Width or height.
        what: &'static str,
        /// As given.
        got: usize,
        /// Most that there may be.
        most: usize,
    },
    /// A setting that is out of range or not finite.
    #[error("{what} is {value}, but must be {rule}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// As given.
        value: f64,
        /// What it should be.
        rule: &'static str,
    },
}
