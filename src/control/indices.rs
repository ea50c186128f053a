//! Places of physical quantities in a row of observations, and the scales that undo the normalisation.

/// Distance that a rotation of 1 rad counts as where attitude and position errors are added up, m.
pub const ATTITUDE_LEVER: f64 = 0.5;

/// Pose error and twist of the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservationIndices {
    /// Length of a row.
    pub width: usize,
    /// Pose error `[R^T (r - r_d); log(R_d^T R)]`, m and rad, 6.
    pub error: BlockIndices,
    /// Body twist, m/s and rad/s, 6.
    pub twist: BlockIndices,
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

    #[inline(always)]
    pub(super) fn six(&self, observation: &[f32]) -> [f64; 6] {
        let mut six = [0.0; 6];
        for k in 0..6 {
            six[k] = f64::from(observation[self.offset + k]) * self.scale[k];
        }
        six
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
