//! The kernels that visit blocks: steps and accelerations.

use std::any::Any;
use std::slice::ChunksExactMut;
use std::sync::Mutex;

use super::columns::Columns;
use super::dynamics::Dynamics;
use super::lagged::{Lag, Lagged};
use super::layout::Layout;
use crate::dynamics::aba::{Instant, Loads, Scratch, accelerations};
use crate::hydro::{FinAxes, ThrusterDynamics, thrust_wrench};
use crate::integrate::{Integrator, Motion, Stages, implicit_interval, interval};
use crate::lane::{Kernel, Lane, Param, Real, Shared, get_all, prefetch_after};
use crate::lie::{Matrix3, Vector3, Vector6};
use crate::system::{JOINTS, ScaledSystem, System, UnscaledBodyTerms};

/// Which loads are on, the same for all instances.
#[derive(Debug, Clone, Copy, Default)]
pub struct Switches {
    /// Coefficients of the joint servos' targets; none where these are off.
    pub terms: usize,
    /// External wrenches on links.
    pub on_links: bool,
    /// Station keeping within the stages.
    pub station: bool,
}

/// `V_r = V - [R^T v_c; 0]`, or back with `sign` +1. `[HC eq. 23]`
#[inline(always)]
fn shift_twist<L: Lane>(twist: Vector6<L>, rotation: &Matrix3<L>, current: Vector3<L>, sign: f64) -> Vector6<L> {
    Vector6 { linear: rotation.apply_transposed(current).scale_add(L::c(sign), twist.linear), ..twist }
}

/// How far water that moves at `current`, and gains `gained` within the step, carries a body.
#[inline(always)]
fn drift<L: Lane>(current: Vector3<L>, gained: Vector3<L>, h: L::Real) -> Vector3<L> {
    gained.scale_add(L::c(0.5), current).scale(L::splat(h))
}

/// Memory that nobody works with at the moment: to make it anew for every few blocks, or for every call of a single instance,
/// would show. Whoever finds it locked does without. Its numbers are those of the last who had it: it is for those alone who
/// write before they read.
#[derive(Debug, Default)]
pub struct Spare(Mutex<Vec<Box<dyn Any + Send>>>);

impl Spare {
    /// Most pieces that are kept; of more threads than that some make theirs anew.
    const MOST: usize = 64;

    /// A piece of it.
    fn take<M: Any>(&self) -> Option<Box<M>> {
        self.0.try_lock().ok()?.pop()?.downcast().ok()
    }

    fn put<M: Any + Send>(&self, piece: Box<M>) {
        if let Ok(mut spare) = self.0.try_lock()
            && spare.len() < Self::MOST
        {
            spare.push(piece);
        }
    }
}

/// A copy has none.
impl Clone for Spare {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Steps blocks of instances.
pub struct Step<'a, T> {
    /// The system.
    pub system: &'a System<Shared<T>>,
    /// The same with its numbers for a single instance: [`System::allocate_scaled`] takes its time.
    pub alone: Option<&'a System<Shared<T>, T>>,
    /// What its bodies are made of, if instances differ in their parameters.
    pub unscaled: Option<&'a [UnscaledBodyTerms<Shared<T>>]>,
    /// Where payloads are held, if some instances carry any.
    pub payload_attachment: Option<[Shared<T>; 3]>,
    /// Working memory.
    pub working: &'a Spare,
    /// Memory for the parameters of single instances.
    pub spare: &'a Spare,
    /// What acts in place of added mass, where `system` has none.
    pub lagged: Option<Lagged<'a, T>>,
    /// Rows of a block.
    pub layout: &'a Layout,
    /// How to step.
    pub integrator: Integrator,
    /// Step size.
    pub h: T,
    /// Steps.
    pub substeps: usize,
    /// Steps before these on the clock of the servo targets.
    pub before: usize,
    /// Loads that are on.
    pub switches: Switches,
    /// Instances: columns past them need not be stepped. (Where lanes are as wide as blocks there is nothing to ask: to ask
    /// nevertheless costs a hundredth of a step.)
    pub count: usize,
    /// Whole blocks.
    pub blocks: &'a mut [T],
}

/// Working memory of the steps.
struct Memory<L: Lane> {
    scratch: Scratch<L>,
    stages: Stages<L, JOINTS>,
    loads: Loads<L>,
    motion: Motion<L, JOINTS>,
    lag: Lag<L>,
    propulsion: ThrusterDynamics<L>,
    surfaces: FinAxes<L>,
}

impl<L: Lane> Memory<L> {
    /// Fresh memory, zero throughout: what is read of it has been written before.
    fn new() -> Box<Self> {
        let mut memory = Box::<Self>::new_uninit();
        // SAFETY: it consists of floating-point numbers (lanes of them) and flags, for all of which zero bits are a value.
        // Filled at once: number by number, outside the kernel's instruction set, it takes as long as half a step.
        unsafe {
            memory.as_mut_ptr().write_bytes(0, 1);
            memory.assume_init()
        }
    }

    /// Makes all its numbers NaN: where one is read before it is written, results show it.
    fn spoil(&mut self) {
        let memory = &raw mut *self;
        // SAFETY: bits that are all set are a number, and the flag is made such again.
        unsafe {
            memory.write_bytes(0xFF, 1);
            (&raw mut (*memory).loads.on_links).write(false);
        }
    }
}

impl<T: Real> Kernel<T> for Step<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        if L::SCALAR {
            return self.group_by_group::<L>();
        }
        let mut memory = self.memory::<L>();
        for (k, rows) in self.blocks().enumerate() {
            prefetch_after::<L, _>(rows.get(..self.layout.common * T::BLOCK).unwrap_or_default(), rows.len());
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if L::LANES < T::BLOCK && k * T::BLOCK + first >= self.count {
                    break;
                }
                self.visit::<_, _, false>(self.system, &mut Columns { rows: &mut *rows, first }, &mut memory);
            }
        }
        self.give_back(memory, None);
    }
}

/// Steps blocks of instances in wide lanes with parameters that differ between instances, or by a baseline method. (A kernel
/// by itself: where one function holds both ways, the common one takes a twelfth longer.)
pub struct StepVaried<'s, 'a, T>(pub &'s mut Step<'a, T>);

impl<T: Real> Kernel<T> for StepVaried<'_, '_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        assert!(L::LANES > 1, "scalars have one kernel for both");
        self.0.group_by_group::<L>();
    }
}

impl<'a, T: Real> Step<'a, T> {
    /// The blocks, once.
    #[inline(always)]
    fn blocks(&mut self) -> ChunksExactMut<'a, T> {
        std::mem::take(&mut self.blocks).chunks_exact_mut((self.layout.rows * T::BLOCK).max(1))
    }

    /// Steps each column group with parameters of its own. One number at a time, a parameter of all instances is no other
    /// number than that of one: no code for both.
    #[inline(always)]
    fn group_by_group<L: Lane<Real = T>>(&mut self) {
        let alone: Option<&ScaledSystem<L>> = match (self.unscaled, self.alone) {
            (None, Some(system)) => (system as &dyn Any).downcast_ref(),
            _ => None,
        };
        let (mut memory, mut varied) = self.memory_and_system::<L>(alone.is_none());
        for (k, rows) in self.blocks().enumerate() {
            prefetch_after::<L, _>(rows.get(..self.layout.common * T::BLOCK).unwrap_or_default(), rows.len());
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if L::LANES < T::BLOCK && k * T::BLOCK + first >= self.count {
                    break;
                }
                let mut columns = Columns { rows: &mut *rows, first };
                if let (Some(unscaled), Some(varied)) = (self.unscaled, &mut varied) {
                    let mut factors = columns.factors(self.layout);
                    if self.lagged.is_some() {
                        factors.added_mass = L::zero();
                    }
                    let body_frame_terms = matches!(self.integrator, Integrator::LinearlyImplicit);
                    varied.apply_factors(self.system, unscaled, &factors, body_frame_terms);
                }
                let Some(system) = varied.as_deref().or(alone) else { continue };
                self.visit::<_, _, true>(system, &mut columns, &mut memory);
            }
        }
        self.give_back(memory, varied);
    }

    /// Working memory. (A call, as is what follows: there are none where instances are stepped.)
    #[inline(never)]
    fn memory<L: Lane>(&self) -> Box<Memory<L>> {
        let mut memory = self.working.take().unwrap_or_else(Memory::new);
        if cfg!(debug_assertions) {
            memory.spoil();
        }
        memory
    }

    /// Working memory, and some for the parameters of single instances where it is needed. (One call for both: of two, the
    /// second would have to free what the first has given, should it panic.)
    #[inline(never)]
    fn memory_and_system<L: Lane<Real = T>>(&self, needed: bool) -> (Box<Memory<L>>, Option<Box<ScaledSystem<L>>>) {
        let laden =
            |system: &ScaledSystem<L>| system.joints.last().map_or(&system.vehicle, |j| &j.body).payload.is_some();
        let spare = self
            .unscaled
            .and_then(|_| self.spare.take().filter(|spare| laden(spare) == self.payload_attachment.is_some()));
        let make = || Box::new(self.system.allocate_scaled(self.unscaled.unwrap_or_default(), self.payload_attachment));
        (self.memory(), needed.then(|| spare.unwrap_or_else(make)))
    }

    /// Keeps both for the next who needs them.
    #[inline(never)]
    fn give_back<L: Lane>(&self, memory: Box<Memory<L>>, system: Option<Box<ScaledSystem<L>>>) {
        self.working.put(memory);
        if let (Some(system), Some(_)) = (system, self.unscaled) {
            self.spare.put(system);
        }
    }

    /// Steps the instances of one column group.
    #[inline(always)]
    fn visit<L: Lane<Real = T>, B: Param<L>, const BASELINES: bool>(
        &self,
        system: &System<Shared<T>, B>,
        columns: &mut Columns<T>,
        memory: &mut Memory<L>,
    ) {
        let motion = &mut memory.motion;
        columns.motion::<_, BASELINES>(self.layout, motion);
        columns.loads(self.layout, self.switches, &mut memory.loads);
        let mut current = columns.vector(self.layout.current);
        let acceleration: Vector3<L> = columns.vector(self.layout.acceleration);
        let gained = acceleration.scale(L::splat(self.h));
        let station = if self.switches.station { Some(columns.station(self.layout)) } else { None };
        let lagged = if BASELINES { self.lagged.as_ref() } else { None };
        if lagged.is_some() {
            columns.lag(self.layout, self.switches, &mut memory.lag);
        }
        let thrusters = &system.thrusters[..];
        let held = columns.six(self.layout.wrench);
        if !thrusters.is_empty() {
            columns.propulsion(self.layout, thrusters, self.h, &mut memory.propulsion);
        }
        if !system.fins.is_empty() {
            columns.surfaces(self.layout, &system.fins, &mut memory.surfaces);
        }
        let mut dynamics = Dynamics {
            system,
            loads: &mut memory.loads,
            gravity: Vector3(get_all(&system.gravity)) - acceleration,
            acceleration,
            wrench: held,
            station,
            surfaces: &memory.surfaces,
            time: L::zero(),
            scratch: &mut memory.scratch,
        };
        let mut watch = columns.watch(self.layout);
        for k in self.before..self.before + self.substeps {
            dynamics.time = L::splat(T::from_f64(k as f64) * self.h);
            motion.twist = shift_twist(motion.twist, &motion.pose.rotation, current, -1.0);
            if !thrusters.is_empty() {
                dynamics.wrench = held + memory.propulsion.step(thrusters, motion.twist);
                if lagged.is_some() {
                    memory.lag.wrench = dynamics.wrench;
                }
            }
            if let Some(lagged) = lagged {
                lagged.apply(L::splat(self.h), motion, &mut memory.lag, &mut dynamics);
            }
            match &self.integrator {
                Integrator::Explicit(method) => {
                    interval::<_, _, _, BASELINES>(
                        method,
                        self.h,
                        motion,
                        &mut watch,
                        &mut dynamics,
                        &mut memory.stages,
                    );
                }
                Integrator::LinearlyImplicit => {
                    implicit_interval(self.h, motion, &mut watch, &mut dynamics);
                }
            }
            motion.travel(drift(current, gained, self.h));
            current = current + gained;
            dynamics.flow_on(current);
            motion.twist = shift_twist(motion.twist, &motion.pose.rotation, current, 1.0);
            if system.fixed {
                // Where it stood before: the rows still say so.
                columns.place::<_, BASELINES>(self.layout, motion);
                motion.twist = Vector6::zero();
            }
        }
        columns.set_motion::<_, BASELINES>(self.layout, motion);
        columns.set_all(self.layout.current, &current.0, 3);
        columns.set_watch(self.layout, &watch);
        if lagged.is_some() {
            columns.set_lag(self.layout, &memory.lag);
        }
        if !thrusters.is_empty() {
            columns.set_all(self.layout.thrust, &memory.propulsion.thrust, self.layout.thrusters);
        }
        // Compensated, so that neither many steps nor their division into calls shows in the time.
        let (mut time, mut rest): (L, L) = (columns.get(self.layout.time), columns.get(self.layout.time + 1));
        for _ in 0..self.substeps {
            let passed = rest + L::splat(self.h);
            let next = time + passed;
            (time, rest) = (next, passed - (next - time));
        }
        columns.set_all(self.layout.time, &[time, rest], 2);
    }
}

/// Works out accelerations of blocks of instances.
pub struct Accelerate<'a, T> {
    /// The system.
    pub system: &'a System<Shared<T>>,
    /// What its bodies are made of, if instances differ in their parameters.
    pub unscaled: Option<&'a [UnscaledBodyTerms<Shared<T>>]>,
    /// Where payloads are held, if some instances carry any.
    pub payload_attachment: Option<[Shared<T>; 3]>,
    /// Rows of a block.
    pub layout: &'a Layout,
    /// Loads that are on.
    pub switches: Switches,
    /// Instances: columns past them are left out.
    pub count: usize,
    /// Whole blocks.
    pub blocks: &'a mut [T],
    /// `[V'; q'']`, absolute, in rows of `6 + joints` per block.
    pub out: &'a mut [T],
}

impl<T: Real> Kernel<T> for Accelerate<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.layout;
        // One form for instances that differ and for those that do not: speed does not matter here.
        let mut system: ScaledSystem<L> =
            self.system.allocate_scaled(self.unscaled.unwrap_or_default(), self.payload_attachment);
        let system_gravity: Vector3<L> = Vector3(get_all(&system.gravity));
        let mut scratch = Scratch::new();
        let mut loads = Loads::none();
        let mut motion = Motion::blank();
        let (mut propulsion, mut surfaces) = (ThrusterDynamics::blank(), FinAxes::blank());
        let (mut twist_rate, mut qdd) = (Vector6::zero(), [L::zero(); JOINTS]);
        let blocks = self.blocks.chunks_exact_mut(layout.rows * T::BLOCK);
        let results = self.out.chunks_exact_mut((6 + layout.joints) * T::BLOCK);
        for (k, (rows, out)) in blocks.zip(results).enumerate() {
            for first in (0..T::BLOCK).step_by(L::LANES) {
                if k * T::BLOCK + first >= self.count {
                    break;
                }
                let columns = Columns { rows: &mut *rows, first };
                columns.motion::<_, false>(layout, &mut motion);
                columns.loads(layout, self.switches, &mut loads);
                if let Some(unscaled) = self.unscaled {
                    system.apply_factors(self.system, unscaled, &columns.factors(layout), true);
                }
                let rotation = &motion.pose.rotation;
                let current = columns.vector(layout.current);
                let acceleration = columns.vector(layout.acceleration);
                let pull = rotation.apply_transposed(acceleration);
                let twist = shift_twist(motion.twist, rotation, current, -1.0);
                let mut wrench = columns.six(layout.wrench);
                if !system.thrusters.is_empty() {
                    columns.propulsion(layout, &system.thrusters, T::from_f64(1.0), &mut propulsion);
                    let acting = propulsion.acting(&system.thrusters, twist);
                    wrench = wrench + thrust_wrench(&system.thrusters, &acting);
                }
                if system.has_fins_or_tether() {
                    columns.surfaces(layout, &system.fins, &mut surfaces);
                    let gravity = rotation.apply_transposed(system_gravity);
                    wrench = wrench + system.fin_and_tether_wrench(&surfaces, twist, gravity);
                }
                if let (true, Some(gains)) = (self.switches.station, &system.vehicle_servo) {
                    let station = columns.station(layout);
                    wrench = wrench + station.wrench(gains, &motion.pose, L::zero(), twist);
                }
                let instant = Instant {
                    is_start: true,
                    gravity: rotation.apply_transposed(system_gravity - acceleration),
                    twist,
                    q: &motion.q,
                    qd: &motion.qd,
                    wrench,
                    held_rate: Vector3::zero() - pull,
                    time: L::zero(),
                };
                accelerations(&system, &instant, &loads, &mut scratch, &mut twist_rate, &mut qdd);
                // V' = V_r' - [omega x R^T v_c; 0] + [R^T a_c; 0]
                let turn = twist.angular.cross(rotation.apply_transposed(current));
                twist_rate.linear = if system.fixed { Vector3::zero() } else { twist_rate.linear - turn + pull };
                let mut out = Columns { rows: &mut *out, first };
                out.set_all(0, &twist_rate.to_array(), 6);
                out.set_all(6, &qdd, layout.joints);
            }
        }
    }
}
