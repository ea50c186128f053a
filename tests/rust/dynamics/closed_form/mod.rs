//! The closed form against laws, hand calculation and the literature.

use nalgebra::allocator::Allocator;
use nalgebra::{DefaultAllocator, Dim, OMatrix};

mod composition;
mod energy;
mod fossen;

mod motion;
mod solve;
mod water;

/// `|a - b| / |b|`.
fn relative<R: Dim, C: Dim>(a: &OMatrix<f64, R, C>, b: &OMatrix<f64, R, C>) -> f64
where
    DefaultAllocator: Allocator<R, C>,
{
    (a - b).norm() / b.norm()
}
