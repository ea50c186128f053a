//! Tables of the vehicle's terms, by the list of all terms.

use nalgebra::Vector6;

use super::axes::NedTables;
use super::{SceneWarning, Vehicle, Water, warnings};
use crate::keys::Fault;
use crate::terms::{DenseInstant, Medium, PerTerm, TermTable, VehicleTerms, vehicle_terms};

macro_rules! table_methods {
    (() $($(#[$about:meta])* $field:ident: $term:ident, $note:literal;)*) => {
        impl Vehicle {
            /// Terms, compiled.
            pub fn terms(&self, water: &Water) -> VehicleTerms<f64> {
                let medium = Medium { density: water.density, gravity: water.gravity };
                VehicleTerms { $($field: self.$field.iter().filter_map(|table| table.compile(&medium)).collect()),* }
            }

            /// Dense twins: wrench of each term on the vehicle.
            pub fn dense_term_wrenches(&self, at: &DenseInstant) -> PerTerm<Vector6<f64>> {
                PerTerm { $($field: self.$field.iter().enumerate().map(|(i, table)| table.dense_wrench(i, at)).sum()),* }
            }

            /// True for each term that is a damping.
            pub fn damping_terms(&self) -> PerTerm<bool> {
                fn is_damping<T: TermTable>(_: &[T]) -> bool {
                    T::DAMPING
                }
                PerTerm { $($field: is_damping(self.$field.as_slice())),* }
            }

            pub(super) fn check_terms(&self) -> Result<(), Fault> {
                $(TermTable::check(self.$field.as_slice(), concat!("vehicle.", stringify!($field)))?;)*
                Ok(())
            }

            pub(super) fn lint_terms(&self, found: &mut Vec<SceneWarning>) {
                $(for (key, text) in self.$field.iter().flat_map(|table| table.warnings(concat!("vehicle.", stringify!($field)))) {
                    found.push(warnings::implausible(key, text));
                })*
            }

            pub(super) fn convert_term_axes(&mut self, ned: &NedTables) {
                $(for (i, table) in self.$field.iter_mut().enumerate() {
                    if ned.has(concat!("vehicle.", stringify!($field)), i) {
                        table.flip_axes();
                    }
                })*
            }

            pub(super) fn normalise_terms(&mut self) {
                $(self.$field.iter_mut().for_each(|table| table.normalise());)*
            }

            pub(super) fn scale_linear_damping(&mut self, factor: f64) {
                $(self.$field.iter_mut().for_each(|table| table.scale_linear_damping(factor));)*
            }
        }
    };
}
vehicle_terms! { table_methods! }
