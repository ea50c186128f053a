//! Quadratic program with bounds by a projected Newton method. `[TMT14]`

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Maximum number of iterations; two or three suffice from a good start.
const ITERATIONS: usize = 100;

/// Minimiser of `x^T H x / 2 + g^T x` within bounds.
pub struct Minimum {
    /// The minimiser: on a bound exactly where it is active.
    pub x: DVector<f64>,
    /// Entries that are on no active bound.
    pub free: Vec<usize>,
    /// Factor of H among these.
    pub factor: Cholesky<f64, Dyn>,
}

/// Minimises by H, positive definite, and g within bounds that include 0. None where H is not positive definite.
pub fn minimise(h: &DMatrix<f64>, g: &DVector<f64>, lower: &DVector<f64>, upper: &DVector<f64>) -> Option<Minimum> {
    let value = |x: &DVector<f64>| x.dot(&(h * x * 0.5 + g));
    let (mut x, mut previous, mut full) = (DVector::zeros(g.len()), None, false);
    let mut iterations = 0;
    loop {
        let gradient = h * &x + g;
        let fixed = |k: usize| (x[k] <= lower[k] && gradient[k] >= 0.0) || (x[k] >= upper[k] && gradient[k] <= 0.0);
        let free: Vec<usize> = (0..g.len()).filter(|k| !fixed(*k)).collect();
        let factor = Cholesky::new(h.select_rows(&free).select_columns(&free))?;
        iterations += 1;
        // A full Newton step along the same entries has found their minimum.
        if free.is_empty() || (full && previous.as_ref() == Some(&free)) || iterations > ITERATIONS {
            return Some(Minimum { x, free, factor });
        }
        let move_free = -factor.solve(&gradient.select_rows(&free));
        let (mut direction, before) = (DVector::zeros(g.len()), value(&x));
        free.iter().zip(move_free.iter()).for_each(|(k, d)| direction[*k] = *d);
        let mut size = 1.0;
        loop {
            let mut next = &x + &direction * size;
            full = size == 1.0;
            for k in 0..g.len() {
                full &= lower[k] <= next[k] && next[k] <= upper[k];
                next[k] = next[k].clamp(lower[k], upper[k]);
            }
            // Armijo's condition on the projected step.
            if full || value(&next) - before <= 0.1 * gradient.dot(&(&next - &x)) || size < 1e-12 {
                x = next;
                break;
            }
            size *= 0.6;
        }
        previous = Some(free);
    }
}
