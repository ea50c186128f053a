//! Systems of the instances of a column group.

use crate::batch::storage::own_numbers::{RunLoader, RunRows};
use crate::lane::{Lane, Routine};
use crate::system::{Factors, InstanceSystem};

/// Loads numbers that instances have of their own, and makes the terms of the bodies of them. (A routine by itself: it takes no
/// registers in the kernels, and its length does not add to theirs.)
pub struct LoadNumbers<'a, L: Lane> {
    /// The system of the column group.
    pub instances: &'a mut InstanceSystem<L>,
    /// First row of each run of numbers.
    pub run_rows: &'a RunRows,
    /// The block's rows of these numbers.
    pub block: &'a [L::Real],
    /// First column.
    pub first: usize,
    /// Factors on the bodies' terms.
    pub factors: &'a Factors<L>,
    /// As for [`crate::system::System::apply_factors`].
    pub body_frame_terms: bool,
}

impl<L: Lane> Routine<L> for LoadNumbers<'_, L> {
    #[inline(always)]
    fn run(&mut self) {
        self.instances.visit(&mut RunLoader::new(self.run_rows, self.block, self.first));
        self.instances.attach_payload();
        let InstanceSystem { system, unscaled, .. } = &mut *self.instances;
        system.apply_factors(unscaled, self.factors, self.body_frame_terms);
    }
}
