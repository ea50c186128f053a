//! Stability of steps: amplification of a mode `exp(rate t)` by a step.

use nalgebra::Complex;

use super::linearly_implicit::extrapolation_weights;
use super::{Attitude, Chart, Integrator, STAGES, Tableau};

/// Maximum accepted growth of a mode that is due to integration, 1/s: 1 % per second. Some is inevitable: the methods of order 1
/// and 2 amplify an undamped oscillation at any step.
pub const GROWTH: f64 = 0.01;
/// Maximum accepted error of a mode's damping relative to its rate, for motions that do not last.
pub const PASSING: f64 = 0.1;
/// Minimum real part of the rate, relative to its size, of a mode that grows physically.
const GROWING: f64 = 0.01;
/// Rates below this need no step shorter than hours, and are close to rounding, 1/s.
const SLOW: f64 = 1e-4;
/// Maximum error of an accurate step relative to a mode's size.
const WRONG: f64 = 0.25;
/// Maximum `h |rate|` at which an L-stable method amplifies an oscillation.
const IMPLICIT_RANGE: f64 = 4.0;
/// Resolution of the search along a ray, in `h |rate|`.
const FINENESS: f64 = 1.0 / 16.0;

impl Tableau {
    /// `R(z) = 1 + z b^T (I - z A)^-1 1`: one step of size h multiplies a mode by `R(h rate)`; exact is `exp(h rate)`.
    pub fn stability(&self, z: Complex<f64>) -> Complex<f64> {
        let mut stages = [Complex::new(0.0, 0.0); STAGES];
        for i in 0..self.stages {
            let inner: Complex<f64> = (0..i).map(|j| stages[j] * self.a[i][j]).sum();
            stages[i] = z * inner + 1.0;
        }
        let sum: Complex<f64> = (0..self.stages).map(|i| stages[i] * self.b[i]).sum();
        z * sum + 1.0
    }
}

/// Stability function of an integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stability {
    /// An explicit Runge-Kutta method.
    Explicit(&'static Tableau),
    /// `v += h a(x, v); x += h v`, on each pair of complex rates as a separate oscillator.
    SemiImplicitEuler,
    /// A linearly implicit method, which is L-stable: decaying modes decay at any step.
    LinearlyImplicit {
        /// Order of the method.
        order: usize,
    },
    /// An explicit method with error control.
    Adaptive,
}

impl Stability {
    /// Amplification of a mode's size by a step, with `z = h rate`.
    pub fn factor(&self, z: Complex<f64>) -> f64 {
        match self {
            Stability::Explicit(tableau) => tableau.stability(z).norm(),
            Stability::SemiImplicitEuler => semi_implicit_euler(z),
            Stability::LinearlyImplicit { order } => linearly_implicit(*order, z).norm(),
            Stability::Adaptive => z.re.exp(),
        }
    }

    /// Maximum h such that all steps up to h are stable for a mode of that rate, at most `most`; s.
    ///
    /// A step is stable where the mode grows by no more than [`GROWTH`] beyond its physical growth; or, below `h |rate| = 1`,
    /// by no more than with a damping error of `lenience` times the rate: 0 for motions that last, [`PASSING`] for others.
    /// Modes that grow fast physically do not count.
    pub fn max_step(&self, rate: Complex<f64>, lenience: f64, most: f64) -> f64 {
        let size = rate.norm();
        let stable_at_any = matches!(self, Stability::LinearlyImplicit { order: 2 } | Stability::Adaptive);
        if stable_at_any || size < SLOW || rate.re > GROWING * size {
            return most;
        }
        // L-stable methods are stable at longer steps again; those do not count.
        let searched =
            if matches!(self, Stability::LinearlyImplicit { .. }) { IMPLICIT_RANGE / size } else { f64::INFINITY };
        let stable = |h: f64| {
            let growth = rate.re.max(0.0) * h + GROWTH * h.min(1.0);
            let passing = if h * size < 1.0 { (rate.re + lenience * size) * h } else { growth };
            self.factor(rate * h) <= growth.max(passing).exp()
        };
        let step = FINENESS / size;
        let mut low = 0.0;
        loop {
            let high = (low + step).min(most);
            if !stable(high) {
                return crossing(stable, low, high);
            }
            if high == most || high > searched {
                return most;
            }
            low = high;
        }
    }
}

impl Stability {
    /// Maximum `h |rate|` at which a step is accurate for modes that decay or oscillate: within a quarter of their size of
    /// `exp(h rate)`. 2.0 for RK4, 1.6 for Heun's third order, 1.2 for the midpoint rule, 0.7 for Euler's.
    pub fn range(&self) -> f64 {
        let Stability::Explicit(tableau) = self else { return f64::INFINITY };
        let ends = [Complex::new(-1.0, 0.0), Complex::new(0.0, 1.0)].map(|ray| {
            let follows = |r: f64| (tableau.stability(ray * r) - (ray * r).exp()).norm() <= WRONG;
            let first = (1..).map(|i| f64::from(i) * FINENESS).find(|r| !follows(*r)).unwrap_or(0.0);
            crossing(follows, first - FINENESS, first)
        });
        ends[0].min(ends[1])
    }
}

/// Bisection for the end of a property that holds at `low` and not at `high`.
fn crossing(holds: impl Fn(f64) -> bool, mut low: f64, mut high: f64) -> f64 {
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

/// Maximum eigenvalue of a step of `x'' = -c x' - k x` with the rates `z / h` and its conjugate.
fn semi_implicit_euler(z: Complex<f64>) -> f64 {
    if z.im == 0.0 {
        return (1.0 + z.re).abs();
    }
    let (damping, stiffness) = (-2.0 * z.re, z.norm_sqr());
    let (half_trace, determinant) = (1.0 - 0.5 * (damping + stiffness), 1.0 - damping);
    let discriminant = half_trace * half_trace - determinant;
    if discriminant < 0.0 { determinant.sqrt() } else { half_trace.abs() + discriminant.sqrt() }
}

/// `R(z) = sum_j w_j (1 - z/j)^-j`: implicit Euler, extrapolated.
fn linearly_implicit(order: usize, z: Complex<f64>) -> Complex<f64> {
    let end = |j: usize| (Complex::new(1.0, 0.0) - z / j as f64).powu(j as u32).inv();
    (1..).zip(extrapolation_weights(order)).map(|(j, weight)| end(j) * *weight).sum()
}

impl Integrator {
    /// Stability function. A method on the group has the stability of its tableau.
    pub fn stability(&self) -> Stability {
        match self {
            Integrator::Explicit(method) if method.tableau.error.is_some() => Stability::Adaptive,
            Integrator::Explicit(method) if method.chart == Chart::VelocityFirst => Stability::SemiImplicitEuler,
            Integrator::Explicit(method) => Stability::Explicit(method.tableau),
            Integrator::LinearlyImplicit(method) => Stability::LinearlyImplicit { order: method.order },
        }
    }

    /// [`Stability::range`]; infinite for integrators that keep a quaternion, which are baselines.
    pub fn range(&self) -> f64 {
        match self.attitude() {
            Attitude::Quaternion => f64::INFINITY,
            Attitude::Matrix | Attitude::Angles => self.stability().range(),
        }
    }
}
