//! Integration on SE(3) x R^n: knows groups and tableaus, and nothing of water.

mod munthe_kaas;
mod quaternion;
mod stability;
mod tableau;

pub use munthe_kaas::{Motion, Stages, munthe_kaas};
pub use quaternion::{Correction, QuaternionMotion, quaternion_runge_kutta};
pub use stability::{GROWTH, PASSING, Stability};
pub use tableau::{EULER, HEUN3, MIDPOINT, RK4, Tableau};

use crate::lane::Lane;
use crate::lie::{DexpInverse, Pose, Vector3, Vector6};

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
    /// A world vector in body axes.
    fn to_body(&self, world: Vector3<L>) -> Vector3<L>;
    /// The whole pose.
    fn pose(&self) -> Pose<L>;
}

/// Right-hand side of `V' = K_V, q'' = K_q`. `[HC eq. 17]`
pub trait Derivative<L: Lane, const N: usize> {
    /// Number of joints in use, at most N.
    fn joints(&self) -> usize;
    /// Rates at a stage, `elapsed` after the start of the step.
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

/// How a step is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Integrator {
    /// Munthe-Kaas with a Runge-Kutta tableau. `[HC eq. 18]`
    MuntheKaas(&'static Tableau, DexpInverse),
    /// Runge-Kutta on the components of a quaternion: the paper's rivals. `[HC eq. 14]`
    Quaternion(&'static Tableau, Correction),
}

impl Integrator {
    /// Names of the integrators, each with what it is.
    pub const NAMES: [(&'static str, &'static str); 8] = [
        ("mk4", "Munthe-Kaas, order 4, closed-form inverse of dexp (the default)"),
        ("mk4-truncated", "Munthe-Kaas, order 4, inverse of dexp cut off after ad^2/12: adds an error of order 5"),
        ("mk3", "Munthe-Kaas on Heun's third-order tableau"),
        ("mk2", "Munthe-Kaas on the midpoint rule"),
        ("mk1", "Munthe-Kaas on the Euler rule (Lie-Euler)"),
        ("quaternion-euler", "Euler on a quaternion with the norm-restoring term of eq. 14"),
        ("quaternion-rk4", "RK4 on a quaternion with the norm-restoring term of eq. 14"),
        ("rk4-normalise", "RK4 on a quaternion, normalised after each step"),
    ];

    /// By name; `gamma` is the gain of eq. 14.
    pub fn named(name: &str, gamma: f64) -> Option<Self> {
        use {Correction::*, DexpInverse::*, Integrator::*};
        Some(match name {
            "mk4" => MuntheKaas(&RK4, Closed),
            "mk4-truncated" => MuntheKaas(&RK4, Truncated),
            "mk3" => MuntheKaas(&HEUN3, Closed),
            "mk2" => MuntheKaas(&MIDPOINT, Closed),
            "mk1" => MuntheKaas(&EULER, Closed),
            "quaternion-euler" => Quaternion(&EULER, Fossen { gamma }),
            "quaternion-rk4" => Quaternion(&RK4, Fossen { gamma }),
            "rk4-normalise" => Quaternion(&RK4, Normalise),
            _ => return None,
        })
    }

    /// Whether the attitude is kept as a quaternion.
    pub fn keeps_quaternion(&self) -> bool {
        matches!(self, Integrator::Quaternion(..))
    }
}
