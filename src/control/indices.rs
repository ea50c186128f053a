//! Places of physical quantities in a row of observations, and the scales that undo the normalisation.

/// Distance that a rotation of 1 rad counts as where attitude and position errors are added up, m.
pub const ATTITUDE_LEVER: f64 = 0.5;

/// Pose error and twist of the vehicle: index and scale of each entry.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationIndices {
    /// Length of a row.
    pub width: usize,
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`, m and rad.
    pub error: [(usize, f64); 6],
    /// Body twist, m/s and rad/s.
    pub twist: [(usize, f64); 6],
}

/// Consecutive entries of an observation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BlockIndices {
    /// First entry.
    pub offset: usize,
    /// Physical value of 1, per entry.
    pub scale: Vec<f64>,
}

impl BlockIndices {
    /// Physical values at one row of observations.
    pub fn read<'a>(&'a self, observation: &'a [f32]) -> impl Iterator<Item = f64> + 'a {
        self.scale.iter().zip(&observation[self.offset..]).map(|(scale, x)| f64::from(*x) * scale)
    }
}

/// Vehicle and arm, for controllers with a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelIndices {
    /// Vehicle.
    pub vehicle: ObservationIndices,
    /// Joint coordinates and rates.
    pub arm: [BlockIndices; 2],
    /// Joint references for the next control instant: coordinates and rates.
    pub reference: [BlockIndices; 2],
    /// Home position, which joint coordinates are relative to, rad or m.
    pub home: Vec<f64>,
}
