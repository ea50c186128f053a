//! Equations of motion of a stage: the right-hand side that the integrators call.

use std::hint::cold_path;

use super::joint_coordinates::JointSums;
use crate::batch::storage::layout::Layout;
use crate::dynamics::aba::{ArmLoads, Instant, Scratch, accelerations};
use crate::dynamics::aba_implicit::{Ahead, implicit_accelerations};
use crate::dynamics::contact::{ContactRate, ContactWrenches};
use crate::dynamics::lost_bounce;
use crate::dynamics::place::Place;
use crate::hydro::{ThrustProfile, ThrustProfiles};
use crate::integrate::{Derivative, LinearlyImplicit, Motion, Rates, StagePose};
use crate::lane::{Lane, Param, Real, Rows, unroll};
use crate::lie::{Pose, Vector3, Vector6};
use crate::system::{JOINTS, System, VehicleServo};
use crate::terms::{FinAxes, TermInstant};

/// Pose control by the vehicle's servo within the stages (station keeping).
#[derive(Clone, Copy)]
pub struct StationServo<L> {
    /// Target pose in the world, m.
    pub target: Pose<L>,
}

impl<L: Lane> StationServo<L> {
    /// PD on the vehicle `[HC sec. 5.2]`: `F = -kp e - kd V` with `e = [R^T (r - r_d); vee(R_d^T R - R^T R_d) / 2]` and the
    /// absolute twist V. This attitude error, "vee", is the sine of the angle about its axis; the controller
    /// [`crate::control::Pd`] uses "log", the angle.
    #[inline(always)]
    pub fn wrench<P: Param<L>>(&self, gains: &VehicleServo<P>, place: &Place<L>) -> Vector6<L> {
        let r = &place.pose.rotation;
        let offset = place.pose.position - self.target.position;
        let e = self.target.rotation.transposed().times(r).0;
        let turn = Vector3([e[2][1] - e[1][2], e[0][2] - e[2][0], e[1][0] - e[0][1]]).scale(L::c(0.5));
        let error = Vector6 { linear: r.apply_transposed(offset), angular: turn }.to_array();
        let rate = place.twist.to_array();
        let mut wrench = [L::zero(); 6];
        unroll!(i in 0 1 2 3 4 5 => {
            wrench[i] = gains.kd[i].get().neg_mul_add(rate[i], -(gains.kp[i].get() * error[i]));
        });
        Vector6::from_array(wrench)
    }
}

/// Equations of motion of a system under loads, in the frame that moves with the water.
pub struct EquationsOfMotion<'a, L: Lane, P> {
    /// System with the parameters of the instances in the lanes.
    pub system: &'a System<P>,
    /// Loads on joints and links.
    pub loads: &'a mut ArmLoads<L>,
    /// Wrench on the vehicle in body axes at the start of a step, N and N m.
    pub wrench: Vector6<L>,
    /// [`Self::wrench_varies`]: one test for all that may add to `wrench`.
    pub varies: bool,
    /// Wrench of thrusters with dynamics over a step, whose start is part of `wrench`, and 1 over its size, 1/s.
    pub thrust: Option<(ThrustProfile<L>, L)>,
    /// Thrusts in still water in place of `thrust`, where inflow reduces them.
    pub lossy: Option<(&'a mut ThrustProfiles<L>, L)>,
    /// The vehicle's servo, where it is on.
    pub station: Option<StationServo<L>>,
    /// Deflected fins.
    pub surfaces: &'a FinAxes<L>,
    /// Sums of the joint coordinates.
    pub joints: &'a mut JointSums<L>,
    /// Time of the step's start on the clock of the servo targets, s.
    pub time: L,
    /// Scratch memory.
    pub scratch: &'a mut Scratch<L>,
}

impl<'a, L: Lane, P: Param<L>> EquationsOfMotion<'a, L, P> {
    /// The system, loaded anew at each stage: otherwise the compiler broadcasts all of it onto the stack beforehand.
    #[inline(always)]
    fn reload_system(&self) -> &'a System<P> {
        std::hint::black_box(self.system)
    }

    /// True if the wrench on the vehicle varies within a step, or has parts besides `wrench`.
    #[inline(always)]
    pub fn wrench_varies(system: &System<P>, station: &Option<StationServo<L>>) -> bool {
        !system.thrusters.is_empty() || station.is_some() || system.terms.any() || system.contact.is_some()
    }

    /// Wrench on the vehicle at a stage, where it varies, at the time `elapsed` after the start of the interval.
    #[inline(always)]
    fn varying_wrench(
        &self,
        system: &System<P>,
        at: &impl StagePose<L>,
        elapsed: L,
        gravity: Vector3<L>,
        twist: Vector6<L>,
    ) -> Vector6<L> {
        let (mut wrench, water) = (self.wrench, &self.scratch.water);
        if let Some((course, rate)) = &self.thrust {
            wrench = wrench + course.change(elapsed * *rate);
        }
        if let Some((courses, rate)) = &self.lossy {
            cold_path();
            wrench = wrench + courses.wrench(&system.thrusters, elapsed * *rate, twist);
        }
        if let (Some(station), Some(gains)) = (&self.station, &system.vehicle_servo) {
            wrench = wrench + station.wrench(gains, &water.place(&at.pose(), elapsed, twist));
        }
        if system.terms.any() {
            let gravity = gravity + at.to_body(water.acceleration);
            wrench = wrench + system.terms.wrench(&TermInstant { twist, gravity, fins: self.surfaces });
        }
        if system.contact.is_some() {
            cold_path();
            wrench = wrench + self.scratch.contact.vehicle;
        }
        wrench
    }

    /// Gravity at a stage and, for a fixed vehicle, the rate of its twist.
    #[inline(always)]
    fn pull(&self, system: &System<P>, at: &impl StagePose<L>) -> (Vector3<L>, Option<Vector3<L>>) {
        let water = &self.scratch.water;
        let rate = if system.fixed { Some(at.to_body(water.acceleration.scale(L::c(-1.0)))) } else { None };
        (at.to_body(water.gravity), rate)
    }

    /// Wrenches of contacts at a stage, left in the scratch memory. Implicit steps are each the start of a step.
    #[inline(always)]
    fn touch(
        &mut self,
        system: &System<P>,
        at: &impl StagePose<L>,
        (elapsed, is_start): (L, bool),
        (twist, q, qd): (Vector6<L>, &[L; JOINTS], &[L; JOINTS]),
    ) {
        if system.contact.is_some() {
            cold_path();
            let (pose, scratch) = (at.start_and_motion(), &mut *self.scratch);
            L::call(&mut ContactWrenches { system, is_start, pose, elapsed, twist, q, qd, scratch });
        }
    }
}

impl<T: Real> Rows<'_, T> {
    /// The vehicle's servo.
    #[inline(always)]
    pub fn station<L: Lane<Real = T>>(&self, layout: &Layout) -> StationServo<L> {
        let target = Pose { rotation: self.matrix(layout.station), position: self.vector(layout.station + 9) };
        StationServo { target }
    }
}

impl<L: Lane, P: Param<L>> Derivative<L, JOINTS> for EquationsOfMotion<'_, L, P> {
    #[inline(always)]
    fn joints(&self) -> usize {
        self.system.chain().len()
    }

    #[inline(always)]
    fn contact_rate(&mut self, motion: &Motion<L, JOINTS>, h: L) -> Option<L> {
        let system = self.system;
        system.contact.as_ref()?;
        cold_path();
        let mut sums = [L::zero(); JOINTS];
        let q = self.joints.coordinates(&motion.q, system.chain().len(), &mut sums);
        let at = ContactWrenches {
            system,
            is_start: true,
            pose: (&motion.pose, None),
            elapsed: L::zero(),
            twist: motion.twist,
            q,
            qd: &motion.qd,
            scratch: &mut *self.scratch,
        };
        let mut rate = ContactRate { at, h, rate: L::zero() };
        L::call(&mut rate);
        Some(rate.rate)
    }

    #[inline(always)]
    fn rates(
        &mut self,
        at: &impl StagePose<L>,
        elapsed: L,
        twist: Vector6<L>,
        q: &[L; JOINTS],
        qd: &[L; JOINTS],
        rates: &mut Rates<L, JOINTS>,
    ) {
        let system = self.reload_system();
        let mut sums = [L::zero(); JOINTS];
        let q = self.joints.coordinates(q, system.chain().len(), &mut sums);
        self.touch(system, at, (elapsed, at.is_start()), (twist, q, qd));
        let (gravity, fixed_rate) = self.pull(system, at);
        let varying;
        let wrench = if self.varies {
            varying = self.varying_wrench(system, at, elapsed, gravity, twist);
            &varying
        } else {
            &self.wrench
        };
        let (is_start, time) = (at.is_start(), self.time + elapsed);
        let instant = Instant { is_start, gravity, twist, q, qd, wrench, fixed_rate, time, elapsed };
        let Rates { twist, qd } = rates;
        accelerations::<_, _, _, false>(system, &instant, self.loads, self.scratch, twist, qd);
    }
}

impl<L: Lane, P: Param<L>> LinearlyImplicit<L, JOINTS> for EquationsOfMotion<'_, L, P> {
    #[inline(always)]
    fn implicit_rates(
        &mut self,
        at: &impl StagePose<L>,
        (elapsed, h): (L, L),
        twist: Vector6<L>,
        q: &[L; JOINTS],
        qd: &[L; JOINTS],
        rates: &mut Rates<L, JOINTS>,
    ) {
        let system = self.reload_system();
        let mut sums = [L::zero(); JOINTS];
        let q = self.joints.coordinates(q, system.chain().len(), &mut sums);
        self.touch(system, at, (elapsed, true), (twist, q, qd));
        let (gravity, fixed_rate) = self.pull(system, at);
        let wrench = &self.varying_wrench(system, at, elapsed + h, gravity, twist);
        let (is_start, elapsed, time) = (at.is_start(), elapsed + h, self.time + (elapsed + h));
        let instant = Instant { is_start, gravity, twist, q, qd, wrench, fixed_rate, time, elapsed };
        let ahead = Ahead { h, vehicle_servo: self.station.is_some() };
        let Rates { twist, qd } = rates;
        implicit_accelerations(system, &instant, ahead, self.loads, self.scratch, twist, qd);
    }

    #[inline(always)]
    fn lost_bounce(&self, h: L, range: f64, ends: [(&[L; JOINTS], &[L; JOINTS]); 2]) -> L {
        let joints = self.system.chain();
        let mut maximum = L::zero();
        for i in 0..joints.len().min(JOINTS) {
            let mut both = [(L::zero(), L::zero()); 2];
            for k in 0..2 {
                both[k] = (ends[k].0[i], ends[k].1[i]);
                if <L::Real as Real>::SINGLE {
                    both[k].0 += self.joints.base[i];
                }
            }
            let (inertia, servo_on) = (self.scratch.inertia(i), self.loads.terms > 0);
            maximum = lost_bounce(&joints[i], (h, range), inertia, servo_on, both).max(maximum);
        }
        maximum
    }
}
