//! Integration on SE(3) x R^n: knows groups and tableaus, and nothing of water.

mod catalogue;
mod chart;
mod euler_angles;
mod explicit;
mod motion;
mod pieces;
mod quaternion;
mod rosenbrock;
mod stability;
mod stages;
mod tableau;
mod watch;

pub use catalogue::{Entry, Explicit, Gains, Integrator, Kind};
pub use chart::{Attitude, Chart, Correction};
pub use motion::Motion;
pub use pieces::interval;
pub use rosenbrock::{LinearlyImplicit, implicit_interval};
pub use stability::{GROWTH, PASSING, Stability};
pub use stages::Stages;
pub use tableau::{Contrast, DORMAND_PRINCE, EULER, HEUN3, MIDPOINT, RK4, STAGES, Tableau};
pub use watch::{Watch, step_error, stiffness};

use crate::lane::Lane;
use crate::lie::{Pose, Vector3, Vector6};

/// Rates of twist and joint rates.
#[derive(Debug, Clone, Copy)]
pub struct Rates<L, const N: usize> {
    /// V'.
    pub twist: Vector6<L>,
    /// q''.
    pub qd: [L; N],
}

/// The pose within a step, worked out only as far as it is asked for.
pub trait StagePose<L: Lane> {
    /// Whether it is that of the step's start; where this is not known, true.
    fn is_start(&self) -> bool;
    /// A world vector in body axes.
    fn to_body(&self, world: Vector3<L>) -> Vector3<L>;
    /// The whole pose.
    fn pose(&self) -> Pose<L>;
}

/// Right-hand side of `V' = K_V, q'' = K_q`. `[HC eq. 17]`
pub trait Derivative<L: Lane, const N: usize> {
    /// Number of joints in use, at most N.
    fn joints(&self) -> usize;
    /// Rates at a stage, `elapsed` after the start of the interval.
    fn rates(
        &mut self,
        at: &impl StagePose<L>,
        elapsed: L,
        twist: Vector6<L>,
        q: &[L; N],
        qd: &[L; N],
        rates: &mut Rates<L, N>,
    );
}
