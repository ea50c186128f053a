//! Integration on SE(3) x R^n: groups and tableaus, independent of the equations of motion.

mod chart;
mod euler_angles;
mod explicit;
mod explicit_adjoint;
mod linearly_implicit;
mod linearly_implicit_adjoint;
mod motion;
mod motion_adjoint;
mod quaternion;
mod recorder;
mod registry;
mod stability;
mod stages;
mod step_estimates;
mod sub_intervals;
mod tableau;

pub use chart::{Attitude, Chart, Correction};
pub use explicit_adjoint::ExplicitAdjoint;
pub use linearly_implicit::{ImplicitStages, LinearlyImplicit, implicit_interval};
pub use linearly_implicit_adjoint::ImplicitAdjoint;
pub use motion::Motion;
pub use motion_adjoint::{
    DerivativeAdjoint, MethodAdjoint, MotionCotangents, PoseCotangents, StageCotangents, StagePoint,
};
pub use recorder::{Recorder, StepRecord, SubInterval};
pub use registry::{Explicit, Gains, Implicit, Integrator, IntegratorKind, NamedIntegrator};
pub use stability::{GROWTH, PASSING, Stability};
pub use stages::Stages;
pub use step_estimates::{StepEstimates, step_error, stiffness};
pub use sub_intervals::interval;
pub use tableau::{Contrast, DORMAND_PRINCE, EULER, HEUN3, MIDPOINT, RK4, STAGES, Tableau};

use crate::lane::Lane;
use crate::lie::{Pose, Vector3, Vector6};

/// Rates of twist and joint rates.
#[derive(Debug, Clone, Copy)]
pub struct Rates<L, const N: usize> {
    /// V', m/s^2 and rad/s^2.
    pub twist: Vector6<L>,
    /// q'', rad/s^2 or m/s^2.
    pub qd: [L; N],
}

impl<L: Lane, const N: usize> Rates<L, N> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self { twist: Vector6::zero(), qd: [L::zero(); N] }
    }
}

/// Pose within a step, computed on demand.
pub trait StagePose<L: Lane> {
    /// True at the step's start, and where this is not known.
    fn is_start(&self) -> bool;
    /// A world vector in body axes.
    fn to_body(&self, world: Vector3<L>) -> Vector3<L>;
    /// Pose at the step's start, and the motion since then, if any, in exponential coordinates.
    fn start_and_motion(&self) -> (&Pose<L>, Option<Vector6<L>>);
    /// The whole pose.
    fn pose(&self) -> Pose<L>;
}

/// Right-hand side of `V' = K_V, q'' = K_q`. `[HC eq. 17]`
pub trait Derivative<L: Lane, const N: usize> {
    /// Number of joints in use, at most N.
    fn joints(&self) -> usize;
    /// `h` times the frequency of contacts that an interval of length `h` from this motion may meet; none where nothing can touch.
    fn contact_rate(&mut self, motion: &Motion<L, N>, h: L) -> Option<L>;
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
