//! Errors of scenes: reading and physical validity.

use std::fmt;

/// A scene that cannot be read or is not physical. `source_name` is a file, `<dict>` or the scene's name.
#[derive(Debug, thiserror::Error)]
pub enum DescriptionError {
    /// The file cannot be read.
    #[error("{path}: {error}")]
    File { path: String, error: std::io::Error },
    /// Neither a shipped scene nor a path to a TOML file.
    #[error("no scene named '{name}': give a path ending in .toml, or one of {}", shipped.join(", "))]
    UnknownScene { name: String, shipped: Vec<&'static str> },
    /// Malformed TOML; the message has line and column.
    #[error("{source_name}: {message}")]
    Syntax { source_name: String, message: String },
    /// Malformed or unsupported part of a robot's file, by its path: `joint "elbow" <limit>`; line 0 stands for no line.
    #[error("{source_name}: {}{element}: {problem}", if *.line > 0 { format!("line {line}: ") } else { String::new() })]
    Robot { source_name: String, line: u32, element: String, problem: String },
    /// Invalid value of a key; names of list elements follow its path: `arm.links[2].body.mass (forearm)`.
    #[error("{source_name}: {key}: {problem}")]
    Value { source_name: String, key: String, problem: Problem },
}

/// Problem with the value of a key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// Required key that is missing.
    #[error("missing")]
    Missing,
    /// Unknown key.
    #[error("unknown key with value {value}; expected {expected}")]
    UnknownKey { value: String, expected: String },
    /// Key that the scene does not have.
    #[error("the scene has no such key; the most similar one is {nearest}")]
    NoSuchKey { nearest: String },
    /// Name of nothing of a kind: a body that comes before, an end effector.
    #[error("is \"{value}\", but must be one of the {of}: {expected}")]
    NoneOf { value: String, of: &'static str, expected: String },
    /// Part that cannot be used.
    #[error("is \"{value}\": {reason}")]
    Part { value: String, reason: String },
    /// Name of a list element that a part does not have.
    #[error("the part has no \"{value}\" there; expected {expected}")]
    NoSuchElement { value: String, expected: String },
    /// Wrong type or wrong length.
    #[error("{reason}; the value is {value}")]
    Form { reason: String, value: String },
    /// Unknown body axes of a table.
    #[error("is {value}, but must be \"flu\" or \"ned\"")]
    Axes { value: String },
    /// NaN, infinite, or too large to compute with.
    #[error("{value:?} is not a finite number of magnitude up to {max:e}")]
    NotFinite { value: f64, max: f64 },
    /// Value out of range.
    #[error("is {value:?}, but must be {rule}")]
    Range { value: f64, rule: &'static str },
    /// Invalid pair of limits.
    #[error("is [{lower:?}, {upper:?}], which must {rule}")]
    Limits { lower: f64, upper: f64, rule: &'static str },
    /// Supply voltage outside of the bench table of a thruster, V.
    #[error("is {voltage:?} V, but the bench table of a thruster has {lower:?} to {upper:?} V")]
    Voltage { voltage: f64, lower: f64, upper: f64 },
    /// Initial joint coordinate outside the joint's limits, rad or m.
    #[error("is {home:?}, but must be within the limits [{lower:?}, {upper:?}]")]
    HomeOutside { home: f64, lower: f64, upper: f64 },
    /// Invalid combination of values.
    #[error("{reason}")]
    Invalid { reason: &'static str },
    /// Direction of zero length.
    #[error("is {axis:?}, but must have a nonzero length")]
    ZeroAxis { axis: [f64; 3] },
    /// Matrix whose entries above and below the diagonal differ beyond rounding of published digits; the tolerance is relative.
    #[error(
        "not symmetric: entries [{row}][{column}] and [{column}][{row}] are {upper:?} and {lower:?}, which differ by more \
         than {tolerance:e} of the root of the product of the diagonal entries {row} and {column}"
    )]
    Asymmetric { row: usize, column: usize, upper: f64, lower: f64, tolerance: f64 },
    /// Matrix that is not positive (semi-)definite: its minimum eigenvalue, and all in ascending order.
    #[error("{what} must be positive {}definite, but has the eigenvalue {eigenvalue:.6e} (eigenvalues {eigenvalues})", if *.semi { "semi-" } else { "" })]
    Indefinite { what: &'static str, semi: bool, eigenvalue: f64, eigenvalues: Numbers },
    /// Moments of inertia that no mass distribution has, in ascending order, kg m2.
    #[error(
        "principal moments {moments} about the centre of mass break the triangle inequality: the largest exceeds the sum of the others"
    )]
    Triangle { moments: Numbers },
    /// Negative diagonal entry of a damping matrix.
    #[error("entry [{index}][{index}] is {value:?}, but must be >= 0: damping opposes motion")]
    NegativeDiagonal { index: usize, value: f64 },
    /// Stated weight that differs from mass times gravity.
    #[error(
        "{weight:?} N contradicts mass {mass:?} kg x gravity {gravity} m/s2 = {expected} N by more than {percent} %"
    )]
    Weight { weight: f64, mass: f64, gravity: f64, expected: f64, percent: f64 },
    /// Buoyancy and volume both stated.
    #[error("is {buoyancy:?} N, but volume is {volume:?} m3 as well: give one of them")]
    TwoBuoyancies { buoyancy: f64, volume: f64 },
    /// Buoyancy in weightless water.
    #[error("is {buoyancy:?} N, but the water has no weight: density is {density} kg/m3, gravity {gravity} m/s2")]
    BuoyancyWithoutWater { buoyancy: f64, density: f64, gravity: f64 },
    /// Too many list elements.
    #[error("{found} elements, but at most {max} are allowed")]
    TooMany { found: usize, max: usize },
    /// Too many moving joints.
    #[error("{found} moving joints, but at most {max} are allowed, fixtures included: fix some (kind = \"fixed\")")]
    TooManyJoints { found: usize, max: usize },
    /// Name that is empty, reserved or taken.
    #[error("the name '{name}' is {reason}")]
    Name { name: String, reason: &'static str },
    /// Joint-loaded arm base without mass.
    #[error("missing: mount.joint moves the arm's base, so it needs a mass")]
    MasslessBase,
    /// Provenance of a key that the scene does not have.
    #[error("'{text}' describes no key of this scene: remove this entry, or set provenance = {{}}")]
    ProvenanceOfNothing { text: String },
    /// Provenance of unknown origin.
    #[error("'{text}' must be 'measured: ...', 'fitted: ...', 'cited: ...', 'derived: ...' or 'assumed: ...'")]
    Provenance { text: String },
}

/// Numbers, displayed with five digits.
#[derive(Debug, Clone, PartialEq)]
pub struct Numbers(pub Vec<f64>);

impl fmt::Display for Numbers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text: Vec<_> = self.0.iter().map(|x| format!("{x:.4e}")).collect();
        write!(f, "[{}]", text.join(", "))
    }
}
