//! Reverse of recorded steps: from cotangents of the state after the steps to cotangents of the state before, inputs and
//! parameters. `of_x`, or `of`, is the cotangent of x.

use super::equations_of_motion::EquationsOfMotion;
use super::equations_of_motion_adjoint::{EquationsAdjoint, InputCotangents};
use super::joint_coordinates::JointSums;
use super::step::Step;
use crate::dynamics::aba::{ArmLoads, Scratch};
use crate::dynamics::aba_adjoint::{AdjointScratch, InstantCotangents, add_target};
use crate::dynamics::place::WaterFrame;
use crate::hydro::{THRUSTERS, ThrustCotangents, ThrustProfiles, ThrusterCotangents, ThrusterDynamics};
use crate::integrate::{ExplicitAdjoint, ImplicitAdjoint, Integrator, MethodAdjoint, MotionCotangents, StepRecord};
use crate::lane::{Lane, Real, Routine, Rows, Tape};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::limits::interrupt;
use crate::system::{InstanceSystem, JOINTS, System};
use crate::terms::FinAxes;

/// Reversed steps between two questions for an interrupt.
const PORTION: usize = 1 << 10;

/// [`interrupt::requested`]. (A call, and no closure: the steps themselves contain none.)
#[cold]
#[inline(never)]
fn interrupted() -> bool {
    interrupt::requested()
}

/// Memory of the reverse of a column group.
pub(super) struct ReverseMemory<L: Lane> {
    /// Record of the steps.
    pub record: StepRecord<L>,
    explicit: ExplicitAdjoint<L, JOINTS>,
    implicit: ImplicitAdjoint<L, JOINTS>,
    adjoint_scratch: AdjointScratch<L>,
    scratch: Scratch<L>,
    loads: ArmLoads<L>,
    joints: JointSums<L>,
    propulsion: ThrusterDynamics<L>,
    courses: ThrustProfiles<L>,
    surfaces: FinAxes<L>,
    of_motion: MotionCotangents<L, JOINTS>,
    of_instant: InstantCotangents<L>,
    of: InputCotangents<L>,
    of_thrusters: ThrusterCotangents<L>,
}

impl<L: Lane> ReverseMemory<L> {
    /// Zeros.
    pub fn new() -> Self {
        Self {
            record: StepRecord::empty(),
            explicit: ExplicitAdjoint::blank(),
            implicit: ImplicitAdjoint::blank(),
            adjoint_scratch: AdjointScratch::new(),
            scratch: Scratch::new(),
            loads: ArmLoads::none(),
            joints: JointSums::zero(),
            propulsion: ThrusterDynamics::blank(),
            courses: ThrustProfiles::zero(),
            surfaces: FinAxes::blank(),
            of_motion: MotionCotangents::zero(),
            of_instant: InstantCotangents::blank(),
            of: InputCotangents::zero(),
            of_thrusters: ThrusterCotangents::zero(),
        }
    }
}

/// Reverse of a sub-interval of a method, as a routine of its own.
struct ReverseSubInterval<'a, 'b, 'c, L: Lane, A: MethodAdjoint<L, JOINTS>> {
    method: &'a A::Method,
    tape: &'a mut Tape<L::Real>,
    adjoint: &'a mut A,
    equations: &'a mut EquationsAdjoint<'b, 'c, L>,
    of_motion: &'a mut MotionCotangents<L, JOINTS>,
}

impl<L: Lane, A: MethodAdjoint<L, JOINTS>> Routine<L> for ReverseSubInterval<'_, '_, '_, L, A> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { method, tape, adjoint, equations, of_motion } = self;
        adjoint.reverse(method, tape, *equations, of_motion);
    }
}

/// Cotangent of a rotation from the cotangent `of` of `R^T x`.
#[inline(always)]
fn turn_of<L: Lane>(rotation: &Matrix3<L>, x: Vector3<L>, of: Vector3<L>) -> Vector3<L> {
    of.cross(rotation.apply_transposed(x))
}

/// Sets the cotangents of a rotation's entries that give this cotangent of delta in `R exp([delta])`: `R [turn] / 2`.
#[inline(always)]
fn set_rotation<L: Lane>(of: &mut Rows<L::Real>, row: usize, rotation: &Matrix3<L>, turn: Vector3<L>) {
    for i in 0..3 {
        of.set_some(row + 3 * i, &Vector3(rotation.0[i]).cross(turn).scale(L::c(0.5)).0, 3);
    }
}

/// Prescribed joints follow their targets: adds their cotangents to the cotangents of the targets.
#[inline(always)]
fn prescribe_adjoint<L: Lane>(
    system: &System<L>,
    loads: &ArmLoads<L>,
    time: L,
    of: &mut MotionCotangents<L, JOINTS>,
    of_loads: &mut ArmLoads<L>,
) {
    if system.prescribed && loads.terms > 0 {
        for (i, joint) in system.chain().iter().enumerate() {
            if joint.prescribed {
                add_target(loads.terms, time, [of.q[i], of.qd[i]], &mut of_loads.target[i]);
                (of.q[i], of.qd[i]) = (L::zero(), L::zero());
            }
        }
    }
}

impl<T: Real> Step<'_, T> {
    /// Reverses recorded steps. `columns` has the numbers after the steps. `of_columns` has the cotangents of the state after the
    /// steps, and receives the cotangents of state, loads and factors before, in the same rows; of factors on bodies only if
    /// `of_factors`.
    #[inline(always)]
    pub(super) fn reverse_group<L: Lane<Real = T>>(
        &self,
        instances: &InstanceSystem<L>,
        columns: &Rows<T>,
        of_columns: &mut Rows<T>,
        memory: &mut ReverseMemory<L>,
        of_factors: bool,
    ) {
        let (layout, system) = (self.layout, &instances.system);
        let n = system.chain().len();
        let h = L::splat(self.h);
        // State after the steps, and loads.
        let mut rotation = columns.matrix(layout.rotation);
        let ReverseMemory {
            record,
            explicit,
            implicit,
            adjoint_scratch,
            scratch,
            loads,
            joints,
            propulsion,
            courses,
            surfaces,
            of_motion,
            of_instant,
            of,
            of_thrusters,
        } = memory;
        columns.loads(layout, self.active, loads);
        let acceleration: Vector3<L> = columns.vector(layout.acceleration);
        let gained = acceleration.scale(h);
        let mut current: Vector3<L> = columns.vector(layout.current);
        let station = if self.active.station { Some(columns.station(layout)) } else { None };
        let thrusters = &system.thrusters[..];
        let over_h = L::c(1.0) / h;
        if !thrusters.is_empty() {
            columns.propulsion(layout, thrusters, self.h, propulsion);
        }
        if !system.terms.fins.is_empty() {
            columns.surfaces(layout, &system.terms.fins, surfaces);
        }
        // Cotangents of the state after the steps; all others begin at zero.
        of.clear(n);
        *of_thrusters = ThrusterCotangents::zero();
        of_motion.clear(n);
        of_motion.position = of_columns.vector(layout.position);
        of_motion.turn = of_columns.vector(layout.rotation);
        of_motion.twist = of_columns.six(layout.twist);
        of_columns.get_some(layout.q, n, &mut of_motion.q);
        of_columns.get_some(layout.qd, n, &mut of_motion.qd);
        of_columns.get_some(layout.thrust, thrusters.len(), &mut of_thrusters.thrust);
        let end = L::splat(T::from_f64((self.before + self.substeps) as f64) * self.h);
        prescribe_adjoint(system, loads, end, of_motion, &mut of.loads);
        // Right-hand side, as in the steps.
        let gravity = Vector3(system.gravity) - acceleration;
        scratch.water = WaterFrame { velocity: current, acceleration, gravity };
        let mut equations = EquationsOfMotion {
            system,
            loads,
            wrench: Vector6::zero(),
            varies: EquationsOfMotion::wrench_varies(system, &station),
            thrust: None,
            lossy: if system.has_inflow_losses() { Some((courses, over_h)) } else { None },
            station,
            surfaces,
            joints,
            time: L::zero(),
            scratch,
        };
        let parts = if of_factors { &instances.unscaled[..] } else { &[] };
        for k in (self.before..self.before + self.substeps).rev() {
            if k % PORTION == PORTION - 1 && interrupted() {
                return;
            }
            // The end of the step: a fixed vehicle stays, another takes the drift of the water.
            let of_fixed_pose = (of_motion.position, of_motion.turn);
            if system.fixed {
                of_motion.twist = Vector6::zero();
                (of_motion.position, of_motion.turn) = (Vector3::zero(), Vector3::zero());
            } else {
                of_motion.turn = of_motion.turn + turn_of(&rotation, current, of_motion.twist.linear);
            }
            // Water, time and thrusts at the start of the step.
            current = current - gained;
            equations.scratch.water.velocity = current;
            equations.time = L::splat(T::from_f64(k as f64) * self.h);
            let mut thrusts = [L::zero(); THRUSTERS];
            record.tape.pop(&mut thrusts, thrusters.len());
            if let Some((courses, _)) = &mut equations.lossy {
                propulsion.thrust = thrusts;
                propulsion.step_courses(thrusters.len(), courses);
            } else if !thrusters.is_empty() {
                // The course enters the wrench linearly: its value is not needed.
                let course = ThrusterDynamics::blank().step(&thrusters[..0]);
                equations.thrust = Some((course, over_h));
            }
            of.course = [Vector6::zero(); 3];
            of.thrusts = ThrustCotangents::zero();
            // Sub-intervals, the last one first.
            let count = record.sub_intervals.pop().unwrap_or(0);
            for _ in 0..count {
                let equations = &mut EquationsAdjoint {
                    equations: &mut equations,
                    parts,
                    of: &mut *of,
                    scratch: &mut *adjoint_scratch,
                    of_instant: &mut *of_instant,
                };
                let (tape, of_motion) = (&mut record.tape, &mut *of_motion);
                match &self.integrator {
                    Integrator::Explicit(method) => {
                        let adjoint = &mut *explicit;
                        L::call(&mut ReverseSubInterval { method, tape, adjoint, equations, of_motion });
                        rotation = adjoint.start().pose.rotation;
                    }
                    Integrator::LinearlyImplicit(method) => {
                        let adjoint = &mut *implicit;
                        L::call(&mut ReverseSubInterval { method, tape, adjoint, equations, of_motion });
                        rotation = adjoint.start().pose.rotation;
                    }
                }
            }
            // The start of the step: thrusters, water and prescribed joints.
            if !thrusters.is_empty() {
                propulsion.step_adjoint(thrusters, &thrusts, of.course, &of.thrusts, of_thrusters);
            }
            of_motion.turn = of_motion.turn - turn_of(&rotation, current, of_motion.twist.linear);
            if system.fixed {
                of_motion.position = of_motion.position + of_fixed_pose.0;
                of_motion.turn = of_motion.turn + of_fixed_pose.1;
                of_motion.twist = Vector6::zero();
            }
            prescribe_adjoint(system, equations.loads, equations.time, of_motion, &mut of.loads);
        }
        // Commands, thrusts, and their factors.
        let EquationsOfMotion { loads, station, .. } = equations;
        if !thrusters.is_empty() {
            let factors = columns.factors(layout);
            let (mut commands, mut gains, mut kept) =
                ([L::zero(); THRUSTERS], [L::zero(); THRUSTERS], [L::zero(); THRUSTERS]);
            for k in 0..layout.thrusters.min(THRUSTERS) {
                commands[k] = columns.get(layout.command + k);
                kept[k] = L::c(1.0) - columns.get::<L>(layout.loss + k);
                gains[k] = kept[k] * factors.thrust;
            }
            let sums =
                propulsion.command_adjoint(thrusters, &commands, &gains, (h, factors.thruster_lag), of_thrusters);
            of_columns.set_some(layout.command, &sums.commands, layout.thrusters);
            of_columns.set_some(layout.thrust, &of_thrusters.thrust, layout.thrusters);
            for k in 0..layout.thrusters.min(THRUSTERS) {
                of.factors.thrust = kept[k].mul_add(sums.gains[k], of.factors.thrust);
            }
            of.factors.thruster_lag = sums.lag;
        }
        if !system.terms.fins.is_empty() {
            let of_fins = surfaces.deflect_adjoint(&of.surfaces, layout.fins);
            of_columns.set_some(layout.fin, &of_fins, layout.fins);
        }
        // State before the steps.
        set_rotation(of_columns, layout.rotation, &rotation, of_motion.turn);
        of_columns.set_some(layout.position, &of_motion.position.0, 3);
        of_columns.set_some(layout.twist, &of_motion.twist.to_array(), 6);
        of_columns.set_some(layout.q, &of_motion.q, n);
        of_columns.set_some(layout.qd, &of_motion.qd, n);
        // Loads, factors, and the target of the vehicle's servo.
        of_columns.set_some(layout.wrench, &of.wrench.to_array(), 6);
        of_columns.set_some(layout.torque, &of.loads.torque, n);
        for k in 0..n {
            of_columns.set_some(layout.target + 4 * k, &of.loads.target[k], 4);
            if loads.on_links {
                of_columns.set_some(layout.links + 6 * k, &of.loads.links[k].to_array(), 6);
            }
        }
        of_columns.set_some(layout.factors, &of.factors.to_array(), 8);
        if let Some(station) = station {
            set_rotation(of_columns, layout.station, &station.target.rotation, of.station.turn);
            of_columns.set_some(layout.station + 9, &of.station.position.0, 3);
        }
    }
}
