//! Kernels that step blocks of instances.

use std::any::Any;
use std::mem::ManuallyDrop;
use std::slice::ChunksExactMut;

use super::equations_of_motion::EquationsOfMotion;
use super::joint_coordinates::JointSums;
use super::lagged_added_mass::{LagState, LaggedAddedMass};
use super::parameters::ScratchPool;
use crate::batch::storage::inputs::ActiveLoads;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::own_numbers::{LoadNumbers, OwnColumns};
use crate::dynamics::aba::{ArmLoads, Scratch};
use crate::dynamics::place::WaterFrame;
use crate::hydro::{ThrustProfiles, ThrusterDynamics};
use crate::integrate::{
    Explicit, Implicit, ImplicitStages, Integrator, Motion, Recorder, Stages, StepEstimates, StepRecord,
    implicit_interval, interval,
};
use crate::lane::{Kernel, Lane, Param, Real, Routine, Rows, Shared, get_all, prefetch_after};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::system::{InstanceSystem, JOINTS, System, UnscaledBodyTerms};
use crate::terms::FinAxes;

/// Twist relative to the water `V_r = V - [R^T v_c; 0]`, or back with `sign` +1. `[HC eq. 23]`
#[inline(always)]
pub fn shift_twist<L: Lane>(twist: Vector6<L>, rotation: &Matrix3<L>, current: Vector3<L>, sign: f64) -> Vector6<L> {
    Vector6 { linear: rotation.apply_transposed(current).scale_add(L::c(sign), twist.linear), ..twist }
}

/// Displacement of water that moves at `current` and gains `gained` within the step.
#[inline(always)]
fn drift<L: Lane>(current: Vector3<L>, gained: Vector3<L>, h: L::Real) -> Vector3<L> {
    gained.scale_add(L::c(0.5), current).scale(L::splat(h))
}

/// Kernel that steps blocks of instances.
///
/// Wide lanes: production methods with parameters that all instances share. `StepScaled` does the rest. Scalar lanes:
/// everything.
pub struct Step<'a, T> {
    /// System with the parameters that all instances share.
    pub system: &'a System<Shared<T>>,
    /// The system in scalars, made beforehand: [`System::allocate_scaled`] takes long for a single instance.
    pub scalar_system: Option<&'a System<T>>,
    /// Unscaled terms of its bodies.
    pub unscaled: &'a [UnscaledBodyTerms<Shared<T>>],
    /// True where instances differ in their parameters.
    pub scaled: bool,
    /// Numbers that instances have of their own.
    pub own: Option<OwnColumns<'a, T>>,
    /// Attachment point of payloads, where instances carry any, m.
    pub payload_attachment: Option<[Shared<T>; 3]>,
    /// Scratch memory of the steps.
    pub scratch_pool: &'a ScratchPool,
    /// Memory for systems with parameters per instance.
    pub system_pool: &'a ScratchPool,
    /// Filter of forces in place of added mass, where `system` has none.
    pub lag_filter: Option<f64>,
    /// Rows of a block.
    pub layout: &'a Layout,
    /// Integrator of each step.
    pub integrator: Integrator,
    /// Step size, s.
    pub h: T,
    /// Number of steps.
    pub substeps: usize,
    /// Number of steps before these on the clock of the servo targets.
    pub before: usize,
    /// Optional loads that are active.
    pub active: ActiveLoads,
    /// Instances: columns past them need not be stepped. (Where lanes are as wide as blocks nothing is compared: the
    /// comparison costs 1 % of a step.)
    pub count: usize,
    /// Whole blocks.
    pub blocks: &'a mut [T],
}

/// Scratch memory of the steps.
pub(super) struct Memory<L: Lane> {
    scratch: Scratch<L>,
    stages: Stages<L, JOINTS>,
    implicit_stages: ImplicitStages<L, JOINTS>,
    loads: ArmLoads<L>,
    motion: Motion<L, JOINTS>,
    joints: JointSums<L>,
    lag: LagState<L>,
    propulsion: ThrusterDynamics<L>,
    courses: ThrustProfiles<L>,
    surfaces: FinAxes<L>,
}

impl<L: Lane> Memory<L> {
    /// Fresh memory, zero throughout; every number is written before it is read.
    fn new() -> Box<Self> {
        let mut memory = Box::<Self>::new_uninit();
        // SAFETY: it consists of floating-point numbers (lanes of them) and flags, for all of which zero bits are a value.
        // Filled in one go: number by number, outside the kernel's instruction set, it takes as long as half a step.
        unsafe {
            memory.as_mut_ptr().write_bytes(0, 1);
            memory.assume_init()
        }
    }

    /// Sets all numbers to NaN: a number that is read before it is written then shows in the results.
    fn poison(&mut self) {
        let memory = &raw mut *self;
        // SAFETY: bits that are all set are a number, and the flag is made valid again.
        unsafe {
            memory.write_bytes(0xFF, 1);
            (&raw mut (*memory).loads.on_links).write(false);
        }
    }
}

/// One step of an explicit method.
struct ExplicitStep<'a, 'b, L: Lane, P, R> {
    method: &'a Explicit,
    h: L::Real,
    motion: &'a mut Motion<L, JOINTS>,
    estimates: &'a mut StepEstimates<L>,
    equations: &'a mut EquationsOfMotion<'b, L, P>,
    stages: &'a mut Stages<L, JOINTS>,
    recorder: R,
}

/// Kernel of the steps, with the terms of baseline methods if `BASELINES`.
struct WithBaselines<'a, S, const BASELINES: bool>(&'a mut S);

impl<L: Lane, P: Param<L>, R: Recorder<L, JOINTS>, const BASELINES: bool> Routine<L>
    for WithBaselines<'_, ExplicitStep<'_, '_, L, P, R>, BASELINES>
{
    #[inline(always)]
    fn run(&mut self) {
        let ExplicitStep { method, h, motion, estimates, equations, stages, recorder } = &mut *self.0;
        interval::<_, _, _, _, BASELINES>(method, *h, motion, estimates, *equations, stages, recorder);
    }
}

/// One step of a linearly implicit method.
struct ImplicitStep<'a, 'b, L: Lane, P, R> {
    method: &'a Implicit,
    h: L::Real,
    motion: &'a mut Motion<L, JOINTS>,
    estimates: &'a mut StepEstimates<L>,
    equations: &'a mut EquationsOfMotion<'b, L, P>,
    stages: &'a mut ImplicitStages<L, JOINTS>,
    recorder: R,
}

impl<L: Lane, P: Param<L>, R: Recorder<L, JOINTS>> Routine<L> for ImplicitStep<'_, '_, L, P, R> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { method, h, motion, estimates, equations, stages, recorder } = self;
        implicit_interval(method, *h, motion, estimates, *equations, stages, recorder);
    }
}

impl<T: Real> Kernel<T> for Step<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        if L::SCALAR {
            return self.step_scaled::<L>();
        }
        let mut memory = self.memory::<L>();
        for (k, rows) in self.blocks().enumerate() {
            prefetch_after::<L, _>(rows.get(..self.layout.common * T::BLOCK).unwrap_or_default(), rows.len());
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if L::LANES < T::BLOCK && k * T::BLOCK + first >= self.count {
                    break;
                }
                let columns = &mut Rows::of_block(&mut *rows, first);
                self.step_group::<_, _, _, false>(self.system, &[], columns, &mut memory, &mut ());
            }
        }
        self.return_memory(memory, None);
    }
}

/// Kernel that steps blocks of instances in wide lanes with parameters that differ between instances, or by a baseline
/// method. (A kernel by itself: with both ways in one function, the common one takes a twelfth longer.)
pub struct StepScaled<'s, 'a, T>(pub &'s mut Step<'a, T>);

impl<T: Real> Kernel<T> for StepScaled<'_, '_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        assert!(L::LANES > 1, "scalar lanes have one kernel for both");
        self.0.step_scaled::<L>();
    }
}

impl<'a, T: Real> Step<'a, T> {
    /// The blocks, once.
    #[inline(always)]
    fn blocks(&mut self) -> ChunksExactMut<'a, T> {
        std::mem::take(&mut self.blocks).chunks_exact_mut((self.layout.rows * T::BLOCK).max(1))
    }

    /// Steps each column group with the parameters of its instances, or with shared parameters. (In scalar lanes both are
    /// one number, so that one code serves both.)
    #[inline(always)]
    fn step_scaled<L: Lane<Real = T>>(&mut self) {
        let shared: Option<&System<L>> = match (self.scaled, self.scalar_system) {
            (false, Some(system)) => (system as &dyn Any).downcast_ref(),
            _ => None,
        };
        let (mut memory, instances) = self.memory_and_system::<L>(shared.is_none());
        // Nothing here panics: no code that would free it then.
        let mut instances = ManuallyDrop::new(instances);
        for (k, rows) in self.blocks().enumerate() {
            prefetch_after::<L, _>(rows.get(..self.layout.common * T::BLOCK).unwrap_or_default(), rows.len());
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if L::LANES < T::BLOCK && k * T::BLOCK + first >= self.count {
                    break;
                }
                let mut columns = Rows::of_block(&mut *rows, first);
                if let (true, Some(instances)) = (self.scaled, &mut *instances) {
                    let mut factors = columns.factors(self.layout);
                    if self.lag_filter.is_some() {
                        factors.added_mass = L::zero();
                    }
                    let body_frame_terms = self.integrator.implicit();
                    if let Some(own) = &self.own {
                        let (at, factors) = ([k, first], &factors);
                        L::call(&mut LoadNumbers { instances, own, at, factors, body_frame_terms });
                    } else {
                        instances.system.apply_factors(self.unscaled, &factors, body_frame_terms);
                    }
                }
                let (system, unscaled) = match (&*instances, shared) {
                    (Some(instances), _) => (&instances.system, &instances.unscaled[..]),
                    (None, Some(shared)) => (shared, &[][..]),
                    (None, None) => continue,
                };
                self.step_group::<_, _, _, true>(
                    system,
                    unscaled,
                    &mut columns,
                    &mut memory,
                    &mut None::<&mut StepRecord<L>>,
                );
            }
        }
        self.return_memory(memory, ManuallyDrop::into_inner(instances));
    }

    /// Scratch memory. (A call, as are the next two functions: the steps themselves contain none.)
    #[inline(never)]
    pub(super) fn memory<L: Lane>(&self) -> Box<Memory<L>> {
        let mut memory = self.scratch_pool.take().unwrap_or_else(Memory::new);
        if cfg!(debug_assertions) {
            memory.poison();
        }
        memory
    }

    /// Scratch memory, and a system with parameters per instance where it is needed. (One call for both: of two, the second
    /// would have to free the result of the first in a panic.)
    #[inline(never)]
    pub(super) fn memory_and_system<L: Lane<Real = T>>(
        &self,
        needed: bool,
    ) -> (Box<Memory<L>>, Option<Box<InstanceSystem<L>>>) {
        let parts = if self.own.is_some() || self.lag_filter.is_some() { self.unscaled } else { &[] };
        (self.memory(), needed.then(|| self.system(parts)))
    }

    /// Returns both to their pools.
    #[inline(never)]
    pub(super) fn return_memory<L: Lane>(&self, memory: Box<Memory<L>>, instances: Option<Box<InstanceSystem<L>>>) {
        self.scratch_pool.put(memory);
        if let (Some(instances), true) = (instances, self.scaled) {
            self.system_pool.put(instances);
        }
    }

    /// Steps the instances of one column group. Terms of baseline methods, with the `unscaled` terms of the bodies, are compiled
    /// if `BASELINES`.
    #[inline(always)]
    pub(super) fn step_group<L: Lane<Real = T>, P: Param<L>, R: Recorder<L, JOINTS>, const BASELINES: bool>(
        &self,
        system: &System<P>,
        unscaled: &[UnscaledBodyTerms<P>],
        columns: &mut Rows<T>,
        memory: &mut Memory<L>,
        recorder: &mut R,
    ) {
        let motion = &mut memory.motion;
        columns.motion::<_, BASELINES>(self.layout, motion);
        columns.joint_sums(self.layout, &mut memory.joints);
        let joints = system.chain().len();
        columns.loads(self.layout, self.active, &mut memory.loads);
        let mut current = columns.vector(self.layout.current);
        let acceleration: Vector3<L> = columns.vector(self.layout.acceleration);
        let gained = acceleration.scale(L::splat(self.h));
        let station = if self.active.station { Some(columns.station(self.layout)) } else { None };
        let filter = if BASELINES { self.lag_filter } else { None };
        let lagged = if let Some(filter) = filter { Some(LaggedAddedMass { unscaled, filter }) } else { None };
        if lagged.is_some() {
            columns.lag_state(self.layout, self.active, &mut memory.lag);
        }
        let thrusters = &system.thrusters[..];
        let constant = columns.six(self.layout.wrench);
        let over_h = L::c(1.0) / L::splat(self.h);
        if !thrusters.is_empty() {
            columns.propulsion(self.layout, thrusters, self.h, &mut memory.propulsion);
        }
        if !system.terms.fins.is_empty() {
            columns.surfaces(self.layout, &system.terms.fins, &mut memory.surfaces);
        }
        let gravity = Vector3(get_all(&system.gravity)) - acceleration;
        memory.scratch.water = WaterFrame { velocity: current, acceleration, gravity };
        let mut equations = EquationsOfMotion {
            system,
            loads: &mut memory.loads,
            wrench: constant,
            varies: EquationsOfMotion::wrench_varies(system, &station),
            thrust: None,
            lossy: if system.has_inflow_losses() { Some((&mut memory.courses, over_h)) } else { None },
            station,
            surfaces: &memory.surfaces,
            joints: &mut memory.joints,
            time: L::zero(),
            scratch: &mut memory.scratch,
        };
        let mut estimates = columns.step_estimates(self.layout);
        for k in self.before..self.before + self.substeps {
            equations.time = L::splat(T::from_f64(k as f64) * self.h);
            equations.joints.prescribe(system, equations.loads, equations.time, motion);
            recorder.begin();
            let thrust = memory.propulsion.thrust;
            motion.twist = shift_twist(motion.twist, &motion.pose.rotation, current, -1.0);
            if let Some((courses, _)) = &mut equations.lossy {
                memory.propulsion.step_courses(thrusters.len(), courses);
            } else if !thrusters.is_empty() {
                let course = memory.propulsion.step(thrusters);
                equations.wrench = constant + course.start;
                equations.thrust = Some((course, over_h));
                if lagged.is_some() {
                    memory.lag.wrench = equations.wrench;
                }
            }
            if let Some(lagged) = &lagged {
                lagged.apply(L::splat(self.h), motion, &mut memory.lag, &mut equations);
            }
            equations.joints.begin(motion, joints);
            match &self.integrator {
                Integrator::Explicit(method) => {
                    let (estimates, equations) = (&mut estimates, &mut equations);
                    let (stages, recorder, h) = (&mut memory.stages, recorder.lend(), self.h);
                    let mut step = ExplicitStep { method, h, motion, estimates, equations, stages, recorder };
                    if L::LEAN_STEPS {
                        if self.integrator.needs_baseline_terms() {
                            L::call(&mut WithBaselines::<_, BASELINES>(&mut step));
                        } else {
                            L::call(&mut WithBaselines::<_, false>(&mut step));
                        }
                    } else {
                        L::call(&mut WithBaselines::<_, BASELINES>(&mut step));
                    }
                }
                Integrator::LinearlyImplicit(method) => {
                    let (estimates, equations) = (&mut estimates, &mut equations);
                    let (stages, recorder) = (&mut memory.implicit_stages, recorder.lend());
                    L::call(&mut ImplicitStep { method, h: self.h, motion, estimates, equations, stages, recorder });
                }
            }
            recorder.end(&thrust, thrusters.len());
            equations.joints.end(motion, joints);
            motion.travel(drift(current, gained, self.h));
            current = current + gained;
            equations.scratch.water.velocity = current;
            motion.twist = shift_twist(motion.twist, &motion.pose.rotation, current, 1.0);
            if system.fixed {
                // The rows still have the pose before the step.
                columns.place::<_, BASELINES>(self.layout, motion);
                motion.twist = Vector6::zero();
            }
        }
        let end = L::splat(T::from_f64((self.before + self.substeps) as f64) * self.h);
        equations.joints.prescribe(system, equations.loads, end, motion);
        columns.set_joint_sums(self.layout, equations.joints);
        columns.set_motion::<_, BASELINES>(self.layout, motion);
        columns.set_some(self.layout.current, &current.0, 3);
        columns.set_step_estimates(self.layout, &estimates);
        if lagged.is_some() {
            columns.set_lag_state(self.layout, &memory.lag);
        }
        if !thrusters.is_empty() {
            columns.set_some(self.layout.thrust, &memory.propulsion.thrust, self.layout.thrusters);
        }
        columns.add_time::<L>(self.layout, self.h, self.substeps);
    }
}
