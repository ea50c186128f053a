//! Box-constrained differential dynamic programming, of any problem that has quadratic models.

mod backward;
mod box_qp;
mod solver;

pub use backward::{Expansion, Knot, Policy, Ranges};
pub use solver::{Problem, STEP_SIZES, Settings, Solution, solve};
