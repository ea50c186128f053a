//! Adjoint of the equations of motion of a stage.

use super::equations_of_motion::{EquationsOfMotion, StationServo};
use crate::dynamics::aba::{ArmLoads, Instant};
use crate::dynamics::aba_adjoint::{Accelerations, AdjointScratch, InstantCotangents, accelerations_adjoint};
use crate::dynamics::aba_implicit::Ahead;
use crate::dynamics::contact::ContactWrenches;
use crate::dynamics::contact_adjoint::ContactAdjoint;
use crate::hydro::{CourseCotangents, ThrustCotangents};
use crate::integrate::{DerivativeAdjoint, Rates, StageCotangents, StagePoint};
use crate::lane::{Lane, Routine, unroll};
use crate::lie::{Pose, Vector3, Vector6, exp_se3, rotate_back};
use crate::system::{Factors, JOINTS, UnscaledBodyTerms, VehicleServo};
use crate::terms::{FinAxes, TermCotangents, TermInstant};

/// Cotangents of a pose: of its position, world axes, and of delta in `R exp([delta])`.
#[derive(Debug, Clone, Copy)]
pub struct PlaceCotangents<L> {
    /// Cotangent of the position.
    pub position: Vector3<L>,
    /// Cotangent of the rotation.
    pub turn: Vector3<L>,
}

/// Cotangents of inputs and parameters, added up over stages and steps.
#[derive(Debug, Clone)]
pub struct InputCotangents<L> {
    /// Cotangent of the wrench on the vehicle, constant over a call.
    pub wrench: Vector6<L>,
    /// Cotangent of the wrench of thrusters with dynamics over the present step.
    pub course: CourseCotangents<L>,
    /// Cotangent of their thrusts over the step, where inflow reduces them.
    pub thrusts: ThrustCotangents<L>,
    /// Cotangent of the loads on joints and links.
    pub loads: ArmLoads<L>,
    /// Cotangent of chords and normals of the fins.
    pub surfaces: FinAxes<L>,
    /// Cotangent of the target of the vehicle's servo.
    pub station: PlaceCotangents<L>,
    /// Cotangent of the factors.
    pub factors: Factors<L>,
}

impl<L: Lane> InputCotangents<L> {
    /// Zeros.
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            wrench: Vector6::zero(),
            course: [Vector6::zero(); 3],
            thrusts: ThrustCotangents::zero(),
            loads: ArmLoads::none(),
            surfaces: FinAxes::blank(),
            station: PlaceCotangents { position: Vector3::zero(), turn: Vector3::zero() },
            factors: Factors::from_array([L::zero(); 8]),
        }
    }

    /// Sets all to 0; of the loads those of the joints in use.
    #[inline(always)]
    pub fn clear(&mut self, joints: usize) {
        let (three, six) = (Vector3::zero(), Vector6::zero());
        (self.wrench, self.course, self.thrusts) = (six, [six; 3], ThrustCotangents::zero());
        self.loads.clear(joints);
        self.surfaces = FinAxes::blank();
        self.station = PlaceCotangents { position: three, turn: three };
        self.factors = Factors::from_array([L::zero(); 8]);
    }
}

impl<L: Lane> StationServo<L> {
    /// Reverse of [`StationServo::wrench`]: returns the cotangents of pose and twist, adds to the cotangents of the target.
    #[inline(always)]
    fn wrench_adjoint(
        &self,
        gains: &VehicleServo<L>,
        pose: &Pose<L>,
        water: Vector3<L>,
        of: Vector6<L>,
        of_target: &mut PlaceCotangents<L>,
    ) -> (PlaceCotangents<L>, Vector6<L>) {
        let r = &pose.rotation;
        let offset = r.apply_transposed(pose.position - self.target.position);
        let (of, mut of_error, mut of_rate) = (of.to_array(), [L::zero(); 6], [L::zero(); 6]);
        unroll!(i in 0 1 2 3 4 5 => {
            of_error[i] = -(gains.kp[i] * of[i]);
            of_rate[i] = -(gains.kd[i] * of[i]);
        });
        let (of_error, of_twist) = (Vector6::from_array(of_error), Vector6::from_array(of_rate));
        let position = r.apply(of_error.linear);
        // With e = R_d^T R the attitude error changes by (tr e I - e^T) delta / 2.
        let e = self.target.rotation.transposed().times(r);
        let (of_turn, half) = (of_error.angular, L::c(0.5));
        let own = of_turn.scale(e.0[0][0] + e.0[1][1] + e.0[2][2]);
        let turn = (own - e.apply(of_turn)).scale(half) + of_error.linear.cross(offset);
        let of_target_turn = (own - e.apply_transposed(of_turn)).scale(half);
        of_target.position = of_target.position - position;
        of_target.turn = of_target.turn - of_target_turn;
        (PlaceCotangents { position, turn: turn + of_twist.linear.cross(water) }, of_twist)
    }
}

/// Equations of motion with the cotangents of their inputs.
pub struct EquationsAdjoint<'a, 'b, L: Lane> {
    /// The equations of motion.
    pub equations: &'a mut EquationsOfMotion<'b, L, L>,
    /// Parts of the bodies, where factors have cotangents.
    pub parts: &'a [UnscaledBodyTerms<L>],
    /// Cotangents of inputs and parameters.
    pub of: &'a mut InputCotangents<L>,
    /// Working memory.
    pub scratch: &'a mut AdjointScratch<L>,
    /// Cotangents of an instant: working memory.
    pub of_instant: &'a mut InstantCotangents<L>,
}

/// Adjoint of the accelerations, as a routine of its own.
struct StageAdjoint<'a, 'b, 'c, L: Lane, const IMPLICIT: bool> {
    adjoint: &'a mut EquationsAdjoint<'b, 'c, L>,
    at: Instant<'a, L>,
    step: Ahead<L>,
    rates: &'a Rates<L, JOINTS>,
    of_rates: &'a Rates<L, JOINTS>,
}

impl<L: Lane, const IMPLICIT: bool> Routine<L> for StageAdjoint<'_, '_, '_, L, IMPLICIT> {
    #[inline(always)]
    fn run(&mut self) {
        let EquationsAdjoint { equations, parts, of, scratch, of_instant } = &mut *self.adjoint;
        let factors = if parts.is_empty() { None } else { Some((*parts, &mut of.factors)) };
        let rates = Accelerations { twist: self.rates.twist, qd: &self.rates.qd };
        let of_rates = Accelerations { twist: self.of_rates.twist, qd: &self.of_rates.qd };
        let (system, loads) = (equations.system, &*equations.loads);
        accelerations_adjoint::<L, IMPLICIT>(
            system,
            &self.at,
            self.step,
            loads,
            rates,
            of_rates,
            scratch,
            of_instant,
            &mut of.loads,
            factors,
        );
    }
}

/// A vector in axes of the vehicle, which has moved from `start` by `theta`. No closure: it would not have the features of the
/// kernel's instruction set.
#[inline(always)]
fn to_body<L: Lane>(start: &Pose<L>, theta: Vector6<L>, vector: Vector3<L>) -> Vector3<L> {
    rotate_back(theta.angular, start.rotation.apply_transposed(vector))
}

impl<L: Lane> DerivativeAdjoint<L, JOINTS> for EquationsAdjoint<'_, '_, L> {
    #[inline(always)]
    fn joints(&self) -> usize {
        self.equations.system.chain().len()
    }

    #[inline(always)]
    fn rates_adjoint(
        &mut self,
        at: &StagePoint<L, JOINTS>,
        (begin, size): (L, Option<L>),
        rates: &Rates<L, JOINTS>,
        of_rates: &Rates<L, JOINTS>,
        of_stage: &mut StageCotangents<L, JOINTS>,
    ) {
        let system = self.equations.system;
        let StagePoint { start, theta, twist, q, qd } = *at;
        let elapsed = if let Some(h) = size { begin + h } else { begin };
        let water = self.equations.scratch.water;
        let gravity = to_body(start, theta, water.gravity);
        let time = self.equations.time + elapsed;
        let (wrench, fixed_rate) = (&Vector6::zero(), None);
        let instant = Instant { is_start: true, gravity, twist, q, qd, wrench, fixed_rate, time, elapsed };
        let vehicle = if system.contact.is_some() || self.equations.station.is_some() {
            let pose = start.times(&exp_se3(theta));
            // Contacts act at the start of an implicit step, the servo at its end.
            Some((water.place(&pose, elapsed, twist), water.place(&pose, begin, twist)))
        } else {
            None
        };
        self.scratch.scratch.water = water;
        if system.contact.is_some() {
            let (pose, scratch) = ((start, Some(theta)), &mut self.scratch.scratch);
            let (is_start, elapsed) = (true, begin);
            L::call(&mut ContactWrenches { system, is_start, pose, elapsed, twist, q, qd, scratch });
        }
        if let Some(h) = size {
            let step = Ahead { h, vehicle_servo: self.equations.station.is_some() };
            L::call(&mut StageAdjoint::<_, true> { adjoint: self, at: instant, step, rates, of_rates });
        } else {
            let step = Ahead { h: L::zero(), vehicle_servo: false };
            L::call(&mut StageAdjoint::<_, false> { adjoint: self, at: instant, step, rates, of_rates });
        }

        let Self { equations, parts, of, of_instant, scratch } = self;
        let of_wrench = of_instant.wrench;
        of.wrench = of.wrench + of_wrench;
        let mut turn = of_instant.gravity.cross(gravity);
        of_stage.twist = of_instant.twist;
        of_stage.pose.position = None;
        if system.fixed {
            let fixed_rate = -to_body(start, theta, water.acceleration);
            turn = turn + of_instant.fixed_rate.cross(fixed_rate);
        }
        if let Some((_, rate)) = &equations.thrust {
            let share = elapsed * *rate;
            let [first, linear, quadratic] = &mut of.course;
            *first = *first + of_wrench;
            *linear = of_wrench.scale_add(share, *linear);
            *quadratic = of_wrench.scale_add(share * share, *quadratic);
        }
        if let Some((courses, rate)) = &equations.lossy {
            let (thrusters, share) = (&system.thrusters, elapsed * *rate);
            let of_twist = courses.wrench_adjoint(thrusters, share, twist, of_wrench, &mut of.thrusts);
            of_stage.twist = of_stage.twist + of_twist;
        }
        if let (Some(station), Some(gains), Some((vehicle, _))) = (&equations.station, &system.vehicle_servo, &vehicle)
        {
            let velocity = vehicle.pose.rotation.apply_transposed(water.velocity_after(elapsed));
            let (place, of_twist) = station.wrench_adjoint(gains, &vehicle.pose, velocity, of_wrench, &mut of.station);
            of_stage.twist = of_stage.twist + of_twist;
            turn = turn + place.turn;
            of_stage.pose.position = Some(place.position);
        }
        if system.terms.any() {
            let gravity = gravity + to_body(start, theta, water.acceleration);
            let at = TermInstant { twist, gravity, fins: equations.surfaces };
            let (twist, none) = (Vector6::zero(), Vector3::zero());
            let mut sums = TermCotangents { twist, gravity: none, fins: &mut of.surfaces };
            system.terms.add_cotangents(&at, of_wrench, &mut sums);
            of_stage.twist = of_stage.twist + sums.twist;
            turn = turn + sums.gravity.cross(gravity);
            if !parts.is_empty() {
                system.terms.add_factor_cotangents(&at, of_wrench, &mut of.factors);
            }
        }
        if let (Some((_, vehicle)), true) = (vehicle, system.contact.is_some()) {
            let (memory, joints, none) = (&mut **scratch, (q, qd), Vector6::zero());
            let (of_displacement, of_twist) = (none, none);
            let mut adjoint = ContactAdjoint { system, vehicle, joints, memory, of_instant, of_displacement, of_twist };
            L::call(&mut adjoint);
            let ContactAdjoint { of_displacement, of_twist, .. } = adjoint;
            let rotation = &vehicle.pose.rotation;
            let position = rotation.apply(of_displacement.linear);
            let velocity = rotation.apply_transposed(water.velocity_after(begin));
            of_stage.twist = of_stage.twist + of_twist;
            turn = turn + of_displacement.angular + of_twist.linear.cross(velocity);
            of_stage.pose.position = Some(match of_stage.pose.position {
                Some(sum) => sum + position,
                None => position,
            });
        }
        of_stage.pose.turn = turn;
        for k in 0..system.chain().len() {
            (of_stage.q[k], of_stage.qd[k]) = (of_instant.q[k], of_instant.qd[k]);
        }
    }
}
