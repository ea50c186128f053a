//! Computed torque: inverse dynamics of the nominal model, with a disturbance observer.

use super::dob::{Dob, FeedbackGains};
use super::observer::{Estimate, Observer};
use crate::dynamics::CompositeBody;
use crate::lane::Lane;
use crate::lie::Vector6;

/// `F = M a + (h(q^+, q'^+) - h(q, q')) / T + V x* h - f - d` with `a = -kp e - kd V`, and the momentum h at the arm's
/// references for the next control instant. `[HC eq. 13]`
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ComputedTorque(Dob);

impl ComputedTorque {
    pub fn new(gains: FeedbackGains, observer: &Observer) -> Self {
        Self(Dob::new(gains, observer))
    }

    pub fn gains(&self) -> &FeedbackGains {
        self.0.gains()
    }

    /// Wrench for an estimate, the composite bodies at it and a control period (s) later.
    #[inline(always)]
    pub fn wrench<L: Lane<Real = f64>>(
        &self,
        at: &Estimate<L>,
        bodies: &[CompositeBody<L>; 2],
        period: f64,
    ) -> Vector6<L> {
        let [now, next] = bodies;
        let held = now.momentum_transport(at.motion.twist) - now.force - self.0.disturbance(at);
        let wrench = now.momentum.scale_add(L::c(-1.0 / period), now.inertia.apply(self.0.feedback(at)) + held);
        next.momentum.scale_add(L::c(1.0 / period), wrench)
    }
}
