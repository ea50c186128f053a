//! A simulator in single precision, in double precision.

use nalgebra as na;

use super::Simulator;
use super::states::orthonormalised;
use crate::batch::options::{Precision, SimulatorOptions};
use crate::batch::stepping::blocks::Storage;
use crate::error::SimulatorError;

impl Simulator {
    /// The instances of a simulator in single precision, in double: of the same scenes and integrator, made on first use and kept.
    /// Their numbers are those that the instances have now; rotations are made orthonormal.
    pub(super) fn in_double_precision(&mut self) -> Result<&mut Self, SimulatorError> {
        let mut double = match self.in_double.take() {
            Some(double) => double,
            None => {
                let options = SimulatorOptions {
                    precision: Precision::Double,
                    threads: Some(self.threads),
                    error_estimate: Some(false),
                    ..self.options.clone()
                };
                let scenes = self.scenes().map(<[_]>::to_vec);
                let mut double = Self::of(self.scene.clone(), scenes, &self.samples, options)?;
                // No tolerance below the minimum of single precision.
                double.integrator = self.integrator.at_ratio(1.0, 1.0, Precision::Single.epsilon());
                Box::new(double)
            }
        };
        let single = self.blocks::<f32>();
        let layout = single.parts().0.clone();
        let positions = (0..3).map(|k| [layout.position + k, layout.position + 3 + k]);
        let sums = positions.chain((0..layout.rests).map(|k| [layout.q + k, layout.q_rest + k]));
        for i in 0..double.instances() {
            let mut column = single.column(i);
            for [sum, rest] in sums.clone() {
                column[sum] += std::mem::take(&mut column[rest]);
            }
            let rotation = &mut column[layout.rotation..][..9];
            let orthonormal = orthonormalised(&na::Matrix3::from_row_slice(rotation));
            rotation.copy_from_slice(orthonormal.transpose().as_slice());
            column.drain(layout.q_rest..layout.q_rest + layout.rests);
            double.storage.set_column(i, &column);
        }
        // Those of scenes are in double precision.
        if double.own.is_none() {
            double.blocks::<f64>().set_own_numbers(single);
        }
        Ok(self.in_double.insert(double))
    }
}
