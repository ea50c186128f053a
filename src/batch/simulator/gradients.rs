//! Gradients by the adjoint of steps, in the coordinates of their derivatives: the maps between coordinates and rows of
//! [`super::coordinates`], transposed.

use super::coordinates::{Coordinates, PAYLOAD};
use crate::batch::stepping::adjoint::{CotangentColumn, Cotangents};
use crate::batch::stepping::derivative::Slopes;
use crate::batch::storage::table::Table;
use crate::lie::{Matrix3, Vector3};

/// Cotangents of the stepped states in coordinates.
pub(super) struct Gradients<'a> {
    pub coordinates: &'a Coordinates<'a>,
    pub of: &'a [f64],
}

/// Inner product of the slopes of a coordinate with the cotangents of the rows.
struct Product<'a, 'b> {
    column: &'a CotangentColumn<'b>,
    sum: f64,
}

impl<'b> Slopes<'b> for Product<'_, 'b> {
    fn table(&self) -> &'b Table {
        self.column.table
    }
    fn value(&self, row: usize) -> f64 {
        self.column.get(self.column.start, row)
    }
    fn add_slope(&mut self, row: usize, slope: f64) {
        self.sum += slope * self.column.get(self.column.cotangents, row);
    }
}

impl Cotangents for Gradients<'_> {
    fn factors(&self) -> bool {
        !self.coordinates.parameters.is_empty()
    }

    fn payload(&self) -> bool {
        self.coordinates.parameters.contains(&PAYLOAD)
    }

    fn seed(&self, i: usize, column: &mut CotangentColumn) {
        let layout = &column.table.layout;
        let of = &self.of[i * self.coordinates.size..][..self.coordinates.size];
        let rotation =
            std::array::from_fn(|k| std::array::from_fn(|j| column.get(column.end, layout.rotation + 3 * k + j)));
        let position = Matrix3(rotation).apply(Vector3([of[0], of[1], of[2]])).0;
        let parts = [
            (layout.position, &position[..]),
            (layout.rotation, &of[3..6]),
            (layout.q, &of[6..6 + layout.joints]),
            (layout.twist, &of[6 + layout.joints..12 + layout.joints]),
            (layout.qd, &of[12 + layout.joints..12 + 2 * layout.joints]),
            (layout.thrust, &of[12 + 2 * layout.joints..]),
        ];
        for (row, numbers) in parts {
            for (k, x) in numbers.iter().enumerate() {
                column.set(row + k, *x);
            }
        }
    }

    fn read(&self, i: usize, column: &CotangentColumn, out: &mut [f64]) {
        // Lanes that become NaN within a step have not taken its last sub-interval.
        let layout = &column.table.layout;
        if [layout.twist, layout.q].into_iter().any(|row| column.get(column.end, row).is_nan()) {
            return out.fill(f64::NAN);
        }
        let mut out = out.iter_mut();
        for &(argument, width) in self.coordinates.arguments {
            for (k, out) in (0..width).zip(&mut out) {
                let mut product = Product { column, sum: 0.0 };
                self.coordinates.add(i, argument, k, 1.0, &mut product);
                *out = product.sum;
            }
        }
    }
}
