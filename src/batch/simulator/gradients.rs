//! Gradients by the adjoint of steps, in the coordinates of their derivatives: the maps between coordinates and rows of
//! [`super::coordinates`], transposed.

use super::coordinates::Coordinates;
use crate::batch::stepping::adjoint::Cotangents;
use crate::batch::stepping::derivative::DerivativeColumn;
use crate::lie::{Matrix3, Vector3};

/// Cotangents of the stepped states in coordinates.
pub(super) struct Gradients<'a> {
    pub coordinates: &'a Coordinates<'a>,
    pub of: &'a [f64],
}

impl Cotangents for Gradients<'_> {
    fn seed(&self, i: usize, column: &mut DerivativeColumn) {
        let layout = &column.start.table.layout;
        let of = &self.of[i * self.coordinates.size..][..self.coordinates.size];
        let rotation = std::array::from_fn(|k| std::array::from_fn(|j| column.value(layout.rotation + 3 * k + j)));
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

    fn read(&self, i: usize, column: &DerivativeColumn, out: &mut [f64]) {
        // Lanes that become NaN within a step have not taken its last sub-interval.
        let layout = &column.start.table.layout;
        if [layout.twist, layout.q].into_iter().any(|row| column.value(row).is_nan()) {
            return out.fill(f64::NAN);
        }
        let mut out = out.iter_mut();
        for &(argument, width) in self.coordinates.arguments {
            for (k, out) in (0..width).zip(&mut out) {
                let mut sum = 0.0;
                let mut to = |row: usize, slope: f64| sum += slope * column.derivative(row);
                self.coordinates.add(i, argument, k, 1.0, column.start, &mut to);
                *out = sum;
            }
        }
    }
}
