//! Box-constrained differential dynamic programming, of any problem that has quadratic models.

mod backward;
mod box_qp;
mod condensed;
mod riccati;
mod solver;

pub use backward::{Expansion, Knot, Policy, Ranges};
pub use box_qp::{Minimum, minimise};
pub use condensed::condensed;
pub use riccati::cost_to_go;
pub use solver::{Problem, STEP_SIZES, Settings, Solution, solve};
