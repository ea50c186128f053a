//! Kernel of accelerations without stepping.

use super::step::{Step, shift_twist};
use crate::batch::storage::own_numbers::LoadNumbers;
use crate::dynamics::aba::{ArmLoads, Instant, Scratch, accelerations};
use crate::dynamics::contact::ContactWrenches;
use crate::dynamics::place::WaterFrame;
use crate::hydro::{ThrusterDynamics, thrust_wrench};
use crate::integrate::Motion;
use crate::lane::{Kernel, Lane, Real, Rows, get_all};
use crate::lie::{Vector3, Vector6};
use crate::system::{InstanceSystem, JOINTS};
use crate::terms::{FinAxes, TermInstant};

/// Kernel of the accelerations of blocks of instances.
pub struct Accelerate<'a, T> {
    /// Parameters, loads and blocks.
    pub step: Step<'a, T>,
    /// `[V'; q'']`, absolute, in rows of `6 + joints` per block.
    pub out: &'a mut [T],
}

impl<T: Real> Kernel<T> for Accelerate<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let Step { layout, payload_attachment, active, count, .. } = self.step;
        // One form of the system, with parameters per instance: speed does not matter here.
        let parts = if self.step.scaled { self.step.unscaled } else { &[] };
        let system = self.step.system.allocate_scaled(parts, payload_attachment);
        let mut instances: InstanceSystem<L> = InstanceSystem::allocate(system, parts, payload_attachment);
        let mut scratch = Scratch::new();
        let mut loads = ArmLoads::none();
        let mut motion = Motion::blank();
        let (mut propulsion, mut surfaces) = (ThrusterDynamics::blank(), FinAxes::blank());
        let (mut twist_rate, mut qdd) = (Vector6::zero(), [L::zero(); JOINTS]);
        let (width, results) = (layout.rows * T::BLOCK, (6 + layout.joints) * T::BLOCK);
        for k in 0..count.div_ceil(T::BLOCK) {
            let (rows, out) = (&mut self.step.blocks[k * width..][..width], &mut self.out[k * results..][..results]);
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if k * T::BLOCK + first >= count {
                    break;
                }
                let columns = Rows::of_block(&mut *rows, first);
                columns.motion::<_, false>(layout, &mut motion);
                columns.loads(layout, active, &mut loads);
                let factors = &columns.factors(layout);
                if let Some(own) = &self.step.own {
                    let (instances, at) = (&mut instances, [k, first]);
                    L::call(&mut LoadNumbers { instances, own, at, factors, body_frame_terms: true });
                } else {
                    instances.system.apply_factors(parts, factors, true);
                }
                let system = &instances.system;
                let system_gravity: Vector3<L> = Vector3(get_all(&system.gravity));
                let rotation = &motion.pose.rotation;
                let current = columns.vector(layout.current);
                let acceleration = columns.vector(layout.acceleration);
                scratch.water = WaterFrame { velocity: current, acceleration, gravity: system_gravity - acceleration };
                let pull = rotation.apply_transposed(acceleration);
                let twist = shift_twist(motion.twist, rotation, current, -1.0);
                let vehicle = scratch.water.place(&motion.pose, L::zero(), twist);
                let mut wrench = columns.six(layout.wrench);
                if !system.thrusters.is_empty() {
                    columns.propulsion(layout, &system.thrusters, T::from_f64(1.0), &mut propulsion);
                    let acting = propulsion.acting(&system.thrusters, twist);
                    wrench = wrench + thrust_wrench(&system.thrusters, &acting);
                }
                if system.terms.any() {
                    columns.surfaces(layout, &system.terms.fins, &mut surfaces);
                    let gravity = rotation.apply_transposed(system_gravity);
                    wrench = wrench + system.terms.wrench(&TermInstant { twist, gravity, fins: &surfaces });
                }
                if let (true, Some(gains)) = (active.station, &system.vehicle_servo) {
                    let station = columns.station(layout);
                    wrench = wrench + station.wrench(gains, &vehicle);
                }
                if system.contact.is_some() {
                    let (pose, q, qd, scratch) = ((&motion.pose, None), &motion.q, &motion.qd, &mut scratch);
                    let (is_start, elapsed) = (true, L::zero());
                    L::call(&mut ContactWrenches { system, is_start, pose, elapsed, twist, q, qd, scratch });
                    wrench = wrench + scratch.contact.vehicle;
                }
                let instant = Instant {
                    is_start: true,
                    gravity: rotation.apply_transposed(system_gravity - acceleration),
                    twist,
                    q: &motion.q,
                    qd: &motion.qd,
                    wrench: &wrench,
                    fixed_rate: if system.fixed { Some(Vector3::zero() - pull) } else { None },
                    time: L::zero(),
                    elapsed: L::zero(),
                };
                accelerations::<_, _, _, false>(system, &instant, &loads, &mut scratch, &mut twist_rate, &mut qdd);
                // V' = V_r' - [omega x R^T v_c; 0] + [R^T a_c; 0]
                let turn = twist.angular.cross(rotation.apply_transposed(current));
                twist_rate.linear = if system.fixed { Vector3::zero() } else { twist_rate.linear - turn + pull };
                let mut out = Rows::of_block(&mut *out, first);
                out.set_some(0, &twist_rate.to_array(), 6);
                out.set_some(6, &qdd, layout.joints);
            }
        }
    }
}
