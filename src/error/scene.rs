//! Errors of scenes: reading and physical validity.

use std::fmt;

/// A scene that cannot be read or is not physical.
#[derive(Debug, thiserror::Error)]
pub enum DescriptionError {
    /// The file cannot be read.
    #[error("{path}: {error}")]
    File {
        /// Path as given.
        path: String,
        /// Error of the operating system.
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
    /// Malformed TOML.
    #[error("{source_name}: {message}")]
    Syntax {
        /// File, or `<dict>`.
        source_name: String,
        /// The parser's message, with line and column.
        message: String,
    },
    /// Malformed or unsupported element of a URDF file.
    #[error("{source_name}: line {line}: {element}: {problem}")]
    Urdf {
        /// File.
        source_name: String,
        /// Line of the element.
        line: u32,
        /// Path of the element: `joint "elbow" <limit>`.
        element: String,
        /// Problem.
        problem: String,
    },
    /// Invalid value of a key.
    #[error("{source_name}: {key}: {problem}")]
    Value {
        /// File, or `<dict>`, or the scene's name.
        source_name: String,
        /// Path of the key, followed by the name of its list element if it has one: `arm.links[2].body.mass (forearm)`.
        key: String,
        /// Problem.
        problem: Problem,
    },
}

/// Problem with the value of a key.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Problem {
    /// Required key that is missing.
    #[error("missing")]
    Missing,
    /// Unknown key.
    #[error("unknown key with value {value}; expected {expected}")]
    UnknownKey {
        /// Value found.
        value: String,
        /// Allowed keys.
        expected: String,
    },
    /// Wrong type or wrong length.
    #[error("{reason}; the value is {value}")]
    Form {
        /// Expected form.
        reason: String,
        /// Value found.
        value: String,
    },
    /// Unknown body axes of a table.
    #[error("is {value}, but must be \"flu\" or \"ned\"")]
    Axes {
        /// Value found.
        value: String,
    },
    /// NaN, infinite, or too large to compute with.
    #[error("{value:?} is not a finite number of magnitude up to {max:e}")]
    NotFinite {
        /// Value.
        value: f64,
        /// Greatest magnitude allowed.
        max: f64,
    },
    /// Value out of range.
    #[error("is {value:?}, but must be {rule}")]
    Range {
        /// Value.
        value: f64,
        /// Rule that it breaks.
        rule: &'static str,
    },
    /// Invalid pair of limits.
    #[error("is [{lower:?}, {upper:?}], which must {rule}")]
    Limits {
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
        /// Rule that it breaks.
        rule: &'static str,
    },
    /// Initial joint coordinate outside the joint's limits.
    #[error("is {home:?}, but must be within the limits [{lower:?}, {upper:?}]")]
    HomeOutside {
        /// Initial coordinate, rad or m.
        home: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// Invalid combination of values.
    #[error("{reason}")]
    Invalid {
        /// Reason.
        reason: &'static str,
    },
    /// Direction of zero length.
    #[error("is {axis:?}, but must have a nonzero length")]
    ZeroAxis {
        /// Vector.
        axis: [f64; 3],
    },
    /// Matrix that is asymmetric beyond rounding.
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
    /// Matrix that is not positive (semi-)definite.
    #[error("{what} must be positive {}definite, but has the eigenvalue {eigenvalue:.6e} (eigenvalues {eigenvalues})", if *.semi { "semi-" } else { "" })]
    Indefinite {
        /// Name of the matrix.
        what: &'static str,
        /// True if zero is allowed.
        semi: bool,
        /// Least eigenvalue.
        eigenvalue: f64,
        /// All eigenvalues in ascending order.
        eigenvalues: Numbers,
    },
    /// Moments of inertia that no mass distribution has.
    #[error(
        "principal moments {moments} about the centre of mass break the triangle inequality: the largest exceeds the sum of the others"
    )]
    Triangle {
        /// Principal moments in ascending order, kg m2.
        moments: Numbers,
    },
    /// Negative diagonal entry of a damping matrix.
    #[error("entry [{index}][{index}] is {value:?}, but must be >= 0: damping opposes motion")]
    NegativeDiagonal {
        /// Row and column.
        index: usize,
        /// Entry.
        value: f64,
    },
    /// Stated weight that differs from mass times gravity.
    #[error(
        "{weight:?} N contradicts mass {mass:?} kg x gravity {gravity} m/s2 = {expected} N by more than {percent} %"
    )]
    Weight {
        /// Stated weight, N.
        weight: f64,
        /// Mass, kg.
        mass: f64,
        /// Magnitude of gravity, m/s2.
        gravity: f64,
        /// Mass times gravity, N.
        expected: f64,
        /// Tolerance, %.
        percent: f64,
    },
    /// Buoyancy and volume both stated.
    #[error("is {buoyancy:?} N, but volume is {volume:?} m3 as well: give one of them")]
    TwoBuoyancies {
        /// Buoyancy, N.
        buoyancy: f64,
        /// Volume, m3.
        volume: f64,
    },
    /// Buoyancy in weightless water.
    #[error("is {buoyancy:?} N, but the water has no weight: density is {density} kg/m3, gravity {gravity} m/s2")]
    BuoyancyWithoutWater {
        /// Buoyancy, N.
        buoyancy: f64,
        /// Density, kg/m3.
        density: f64,
        /// Magnitude of gravity, m/s2.
        gravity: f64,
    },
    /// Too many list elements.
    #[error("{found} elements, but at most {max} are allowed")]
    TooMany {
        /// Number found.
        found: usize,
        /// Greatest number allowed.
        max: usize,
    },
    /// Name that is empty, reserved or taken.
    #[error("the name '{name}' is {reason}")]
    Name {
        /// Name.
        name: String,
        /// Reason.
        reason: &'static str,
    },
    /// Joint-loaded arm base without mass.
    #[error("missing: mount.joint moves the arm's base, so it needs a mass")]
    MasslessBase,
    /// Provenance of a key that the scene does not have.
    #[error("'{text}' describes no key of this scene: remove this entry, or set provenance = {{}}")]
    ProvenanceOfNothing {
        /// Text.
        text: String,
    },
    /// Provenance of unknown origin.
    #[error("'{text}' must be 'measured: ...', 'cited: ...', 'derived: ...' or 'assumed: ...'")]
    Provenance {
        /// Text.
        text: String,
    },
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
