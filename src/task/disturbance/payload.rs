//! A payload, grasped and released.

use nalgebra::{DVector, Matrix6};

use super::column::Column;
use super::component::{Component, Draws, Forcing, Moment, Place, component};
use super::context::DisturbanceContext;
use super::span::{Span, refuse};
use crate::dynamics::ClosedFormModel;
use crate::error::TaskError;
use crate::lane::{Lane, Real, Rows};
use crate::system::{Flow, State};

component! {
    /// A point mass at the end effector (at the vehicle's origin without an arm) between two times. It is at rest when grasped,
    /// by a rigid grip: an inelastic impact. Released, it keeps its own momentum.
    pub struct Payload = "payload" {
        /// Weight relative to the maximum thrust along the vehicle's weakest axis.
        share: Span = Span::of(0.03, 0.1), in 0.0, 10.0;
        /// Mass, kg; in place of the share.
        #[serde(skip_serializing_if = "Option::is_none")]
        mass: Option<Span> = None, in 0.0, 1e6;
        /// Time of the grasp, s.
        pick: Span = Span::of(2.0, 6.0), in 0.0, 1e5;
        /// Duration of the hold, s.
        hold: Span = Span::of(4.0, 8.0), in 0.0, 1e5;
    }
}

/// Event of a payload at a control instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PayloadEvent {
    /// Grasp of a mass, kg.
    Grasp(f64),
    /// Release of a mass, kg.
    Release(f64),
}

impl Payload {
    /// Event at the time `now` of a payload of these numbers.
    pub(super) fn event([mass, pick, drop, carried]: [f64; Self::ROWS], now: f64) -> Option<PayloadEvent> {
        if carried == 0.0 && now == pick && mass > 0.0 {
            Some(PayloadEvent::Grasp(mass))
        } else if carried > 0.0 && now >= drop {
            Some(PayloadEvent::Release(carried))
        } else {
            None
        }
    }
}

impl Component for Payload {
    const STREAM: u32 = 37;
    /// Mass; control periods at whose start it is grasped, and released; mass carried now.
    const ROWS: usize = 4;

    fn check(&self, context: &DisturbanceContext) -> Result<(), TaskError> {
        if self.mass.is_none() && context.gravity == 0.0 {
            return refuse("payload.share", "the scene has no gravity: give a mass".into());
        }
        Ok(())
    }

    fn begin<T: Real>(&self, memory: &mut Column<'_, T>, at: Place, draws: &Draws<'_>) {
        let Draws { stream: draw, context, .. } = draws;
        let mass = self.mass.unwrap_or_else(|| self.share.times(context.thrust / context.gravity));
        let pick = (self.pick.at(draw.uniform(1)) / context.period).round();
        let hold = (self.hold.at(draw.uniform(2)) / context.period).round().max(1.0);
        memory.set_all(at.row, [mass.at(draw.uniform(0)), pick, pick + hold, 0.0]);
    }

    #[inline(always)]
    fn add<L: Lane>(memory: &Rows<'_, L::Real>, at: Place, _moment: &Moment<'_, L>, forcing: &mut Forcing<L>) {
        forcing.payload = memory.get(at.row + Self::ROWS - 1);
    }
}

/// Velocities `nu = [V; q']` after the end effector has grasped a point mass at rest: `(M + J^T A_p J) nu+ = M nu-` with the
/// added mass in M.
pub fn grasp_impulse(model: &ClosedFormModel, state: &mut State, mass: f64) {
    let form = model.at(state, Flow::from(nalgebra::Vector3::zeros()));
    let n = form.joints();
    let before = DVector::from_iterator(6 + n, state.twist.iter().chain(&state.qd[..n]).copied());
    let (inertia, jacobian) = (form.mass_matrix(), form.jacobian());
    let mut point = Matrix6::zeros();
    (0..3).for_each(|k| point[(k, k)] = mass);
    let together = inertia + jacobian.transpose() * point * &jacobian;
    let Some(factors) = together.cholesky() else { return };
    let after = factors.solve(&(inertia * before));
    state.twist.copy_from(&after.fixed_rows::<6>(0));
    state.qd[..n].copy_from_slice(&after.as_slice()[6..]);
}
