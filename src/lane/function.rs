//! Functions of numbers in lanes: their values, and exact derivatives by dual numbers.

use super::dispatch::WIDE;
use super::{Dual, Isa, Kernel, Lane, Real};

/// Lanes of f64 at most.
const WIDEST: usize = 16;

/// Function of K numbers with M results.
pub trait Function<const K: usize, const M: usize> {
    /// Working memory.
    type Memory<L: Lane>: Default;
    /// Results at an argument. Implementations, and what they call, are `#[inline(always)]`.
    fn at<L: Lane<Real = f64>>(&self, x: &[L; K], memory: &mut Self::Memory<L>) -> [L; M];
}

/// Results of a function at an argument.
pub fn evaluate<const K: usize, const M: usize>(function: &impl Function<K, M>, x: &[f64; K]) -> [f64; M] {
    let mut evaluation = Evaluation { function, x, results: [0.0; M] };
    f64::dispatch_narrow(Isa::best().unwrap_or(Isa::Plain), &mut evaluation);
    evaluation.results
}

/// Results of a function at an argument, and their derivatives by these entries of it, which differ.
pub fn differentiate<const K: usize, const M: usize>(
    function: &impl Function<K, M>,
    x: &[f64; K],
    by: &[usize],
) -> ([f64; M], Vec<[f64; M]>) {
    let slopes = vec![[0.0; M]; by.len()];
    let mut differentiation = Differentiation { function, x, by, results: [0.0; M], slopes };
    if Isa::best().is_ok_and(|isa| isa != Isa::Plain && WIDE.detected()) {
        f64::dispatch_wide(&mut differentiation);
    } else {
        f64::dispatch_plain(&mut differentiation);
    }
    (differentiation.results, differentiation.slopes)
}

struct Evaluation<'a, F, const K: usize, const M: usize> {
    function: &'a F,
    x: &'a [f64; K],
    results: [f64; M],
}

impl<F: Function<K, M>, const K: usize, const M: usize> Kernel<f64> for Evaluation<'_, F, K, M> {
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let mut x = [L::zero(); K];
        for k in 0..K {
            x[k] = L::c(self.x[k]);
        }
        let results = self.function.at(&x, &mut Default::default());
        for k in 0..M {
            self.results[k] = first_lane(results[k]);
        }
    }
}

struct Differentiation<'a, F, const K: usize, const M: usize> {
    function: &'a F,
    x: &'a [f64; K],
    by: &'a [usize],
    results: [f64; M],
    slopes: Vec<[f64; M]>,
}

impl<F: Function<K, M>, const K: usize, const M: usize> Kernel<f64> for Differentiation<'_, F, K, M> {
    /// A direction in each lane.
    #[inline(always)]
    fn run<L: Lane<Real = f64>>(&mut self) {
        let mut x = [Dual::new(L::zero(), L::zero()); K];
        for k in 0..K {
            x[k].value = L::c(self.x[k]);
        }
        let mut memory = Default::default();
        for from in (0..self.by.len()).step_by(L::LANES) {
            let lanes = L::LANES.min(self.by.len() - from);
            let mut seeded = x;
            for lane in 0..lanes {
                let mut along = [0.0; WIDEST];
                along[lane] = 1.0;
                seeded[self.by[from + lane]].slope = L::load(&along);
            }
            let results = self.function.at(&seeded, &mut memory);
            for k in 0..M {
                self.results[k] = first_lane(results[k].value);
                let mut slopes = [0.0; WIDEST];
                results[k].slope.store(&mut slopes);
                for lane in 0..lanes {
                    self.slopes[from + lane][k] = slopes[lane];
                }
            }
        }
    }
}

#[inline(always)]
fn first_lane<L: Lane<Real = f64>>(x: L) -> f64 {
    let mut all = [0.0; WIDEST];
    x.store(&mut all);
    all[0]
}
