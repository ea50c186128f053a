//! Storage of all instances in one precision, and access to single ones.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

use super::aligned::Aligned;
use super::inputs::Applied;
use super::lagged::Lagged;
use super::layout::Layout;
use super::monitor::{Bounds, Sighting, Watched};
use super::step::{Accelerate, Spare, Step, StepVaried, Switches};
use super::table::Table;
use super::threads::for_each;
use crate::error::SimulatorError;
use crate::hydro::Thrusts;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real, Shared};
use crate::system::{Compiled, Factors, Flow, State, System, UnscaledBodyTerms};

/// Instances that a thread takes at a time, in whole blocks: few enough that threads come to an end together, and so many
/// that it does not show that each chunk's work is fetched anew.
pub const CHUNK: usize = 128;
/// Instances per thread below which threads cost more than they bring.
const INSTANCES_PER_THREAD: usize = 256;

/// All instances, whatever the precision.
pub trait Storage: Send + Sync {
    /// State of instance `i`.
    fn state(&self, i: usize) -> State;
    /// Sets the state of instance `i`.
    fn set_state(&mut self, i: usize, state: &State);
    /// Coordinates of the attitude of instance `i` that the integrator keeps, if it does.
    fn attitude(&self, i: usize) -> Option<[f64; 4]>;
    /// Sets those coordinates.
    fn set_attitude(&mut self, i: usize, attitude: &[f64; 4]);
    /// What steps of size `h` showed of the motion of instance `i`.
    fn watched(&self, i: usize, h: f64) -> Watched;
    /// Flow of the water at instance `i`.
    fn flow(&self, i: usize) -> Flow;
    /// Sets the flow of the water at instance `i`.
    fn set_flow(&mut self, i: usize, flow: &Flow);
    /// Factors on the parameters of instance `i`.
    fn factors(&self, i: usize) -> Factors<f64>;
    /// Share of its thrust that each thruster with dynamics of instance `i` has lost.
    fn losses(&self, i: usize) -> Thrusts;
    /// Sets those factors.
    fn set_factors(&mut self, i: usize, factors: &Factors<f64>);
    /// Every number of instance `i`, to be saved.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets every number of instance `i`.
    fn set_column(&mut self, i: usize, column: &[f64]);
    /// Numbers in a column.
    fn column_len(&self) -> usize;
    /// Steps all instances, under loads that are given now or were before; the first one that the steps do not follow, if
    /// it is asked for.
    fn step(&mut self, run: &Run, given: Option<&Applied>) -> Option<Sighting>;
    /// `[V'; q'']` of all instances under the loads given, instance by instance.
    fn accelerations(&mut self, given: &Applied) -> Vec<f64>;
    /// Bytes per instance.
    fn bytes_per_instance(&self) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn Storage>;
    /// For those who know the precision.
    fn as_any(&mut self) -> &mut dyn Any;
}

/// How to step.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Integrator.
    pub integrator: Integrator,
    /// Step size, s.
    pub h: f64,
    /// Steps.
    pub substeps: usize,
    /// Steps before these on the clock of the servo targets.
    pub before: usize,
    /// Loads that are on.
    pub switches: Switches,
    /// Most threads.
    pub threads: usize,
    /// `h |rate|` up to which the integrator is right, where instances are watched for leaving it.
    pub bounds: Option<Bounds>,
}

/// Blocks of instances in one precision.
#[derive(Clone)]
pub struct Blocks<T> {
    scene: Parameters<T>,
    table: Table,
    isa: Isa,
    instances: usize,
    rows: Aligned<T>,
}

/// The scene's parameters.
#[derive(Clone)]
struct Parameters<T> {
    system: System<Shared<T>>,
    /// The same for one instance at a time.
    alone: System<Shared<T>, T>,
    unscaled: Vec<UnscaledBodyTerms<Shared<T>>>,
    /// Where payloads are held.
    payload_attachment: [Shared<T>; 3],
    /// Working memory of the steps.
    working: Spare,
    /// Memory for the parameters of single instances.
    spare: Spare,
    /// The system without added mass, and the filter of that, where it is a lagged force.
    rigid: Option<(System<Shared<T>>, f64)>,
}

impl<T: Real> Blocks<T> {
    /// `instances` instances of a compiled scene, all in `state` and in the same `flow`.
    ///
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(
        compiled: &Compiled,
        instances: usize,
        integrator: &Integrator,
        isa: Isa,
        state: &State,
        flow: &Flow,
    ) -> Result<Self, SimulatorError> {
        let number = |Shared(x)| Shared(T::from_f64(x));
        let unscaled: Vec<_> = compiled.unscaled.iter().map(|parts| parts.map(number)).collect();
        // Rounded as those of instances with factors of their own, so that these do not show in their neighbours.
        let system = compiled.system.map(number).with_factors(&unscaled, &Factors::ONE);
        let rigid = integrator.lag().map(|filter| (system.with_factors(&unscaled, &Factors::RIGID), filter));
        let payload_attachment = compiled.payload_attachment.map(|x| Shared(T::from_f64(x)));
        let alone = system.map_bodies(|Shared(x)| x);
        let scene = Parameters {
            system,
            alone,
            unscaled,
            payload_attachment,
            working: Spare::default(),
            spare: Spare::default(),
            rigid,
        };
        let layout =
            Layout::new(compiled.links.len(), compiled.system.thrusters.len(), compiled.system.fins.len(), integrator);
        let memory = || SimulatorError::Memory { instances };
        let columns = instances.checked_next_multiple_of(T::BLOCK).ok_or_else(memory)?;
        let size = columns.checked_mul(layout.rows).ok_or_else(memory)?;
        let rows = Aligned::filled(size, T::from_f64(0.0)).map_err(|_| memory())?;
        let table = Table { layout, links: compiled.links.clone() };
        let mut blocks = Self { scene, table, isa, instances, rows };
        // Columns past the last instance hold a sane state too: they are stepped along with it where lanes reach them.
        for i in 0..columns {
            blocks.set_state(i, state);
            blocks.set_flow(i, flow);
            blocks.table.set_factors(&mut blocks.rows, i, &Factors::ONE);
            blocks.table.set_fins(&mut blocks.rows, i, &compiled.system.deflections());
        }
        Ok(blocks)
    }

    /// Hands chunks of instances to `work`, each with its item, on as many threads as the run allows; the first instance
    /// that its steps did not follow.
    pub fn visit<I: Send>(
        &mut self,
        run: &Run,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut Part<'_, T>, I) + Sync,
    ) -> Option<Sighting> {
        let (scene, table, isa, instances) = (&self.scene, &self.table, self.isa, self.instances);
        let threads = run.threads.min(instances.div_ceil(INSTANCES_PER_THREAD));
        let least = First::default();
        let chunks = self.rows.chunks_mut(CHUNK * table.layout.rows);
        for_each(chunks.zip(items).enumerate(), threads, |(k, (rows, item))| {
            let first = k * CHUNK;
            let count = CHUNK.min(instances - first);
            let mut part = Part { scene, run, count, first, table, isa, rows, sighting: None };
            work(&mut part, item);
            least.note(first, part.sighting);
        });
        least.take()
    }

    /// Rows of a block, instruction set, and the blocks.
    pub fn parts(&mut self) -> (&Layout, Isa, &mut [T]) {
        (&self.table.layout, self.isa, &mut self.rows)
    }
}

/// A chunk of blocks that one thread works on.
pub struct Part<'a, T> {
    scene: &'a Parameters<T>,
    run: &'a Run,
    /// Instances in it; those past them are there to fill the last block.
    pub count: usize,
    /// Number of the first instance among all.
    pub first: usize,
    /// Access to single instances, numbered from 0.
    pub table: &'a Table,
    /// Instruction set to work with.
    pub isa: Isa,
    /// The blocks.
    pub rows: &'a mut [T],
    /// The first instance that the steps did not follow, if that was asked for.
    sighting: Option<Sighting>,
}

/// The first sighting of several parts.
#[derive(Default)]
struct First(Mutex<Option<Sighting>>);

impl First {
    /// Takes note of a sighting in a part that begins with instance `first`.
    fn note(&self, first: usize, sighting: Option<Sighting>) {
        let Some(mut sighting) = sighting else { return };
        sighting.instance += first;
        let mut least = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if least.is_none_or(|least| sighting.instance < least.instance) {
            *least = Some(sighting);
        }
    }

    fn take(self) -> Option<Sighting> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Real> Part<'_, T> {
    /// Steps all instances.
    pub fn step(&mut self) {
        let (scene, run) = (self.scene, self.run);
        let [varied, laden] = self.table.varied(self.rows);
        let mut step = Step {
            system: scene.rigid.as_ref().map_or(&scene.system, |(rigid, _)| rigid),
            alone: scene.rigid.is_none().then_some(&scene.alone),
            unscaled: varied.then_some(&scene.unscaled[..]),
            payload_attachment: laden.then_some(scene.payload_attachment),
            working: &scene.working,
            spare: &scene.spare,
            lagged: scene.rigid.as_ref().map(|&(_, filter)| Lagged { unscaled: &scene.unscaled, filter }),
            layout: &self.table.layout,
            integrator: run.integrator,
            h: T::from_f64(run.h),
            substeps: run.substeps,
            before: run.before,
            switches: run.switches,
            count: self.count,
            blocks: self.rows,
        };
        if (varied || run.integrator.needs_baseline_terms()) && self.isa.is_wide() {
            T::dispatch(self.isa, &mut StepVaried(&mut step));
        } else {
            T::dispatch(self.isa, &mut step);
        }
        if let (Some(bounds), None) = (run.bounds, &self.sighting) {
            self.sighting = self.table.sight(self.isa, self.rows, self.count, bounds, run.h);
        }
    }
}

impl<T: Real> Storage for Blocks<T> {
    fn state(&self, i: usize) -> State {
        self.table.state(&self.rows, i)
    }

    fn set_state(&mut self, i: usize, state: &State) {
        self.table.set_state(&mut self.rows, i, state);
    }

    fn attitude(&self, i: usize) -> Option<[f64; 4]> {
        self.table.attitude(&self.rows, i)
    }

    fn set_attitude(&mut self, i: usize, attitude: &[f64; 4]) {
        self.table.set_attitude(&mut self.rows, i, attitude);
    }

    fn watched(&self, i: usize, h: f64) -> Watched {
        self.table.watched(&self.rows, i, h)
    }

    fn flow(&self, i: usize) -> Flow {
        self.table.flow(&self.rows, i)
    }

    fn set_flow(&mut self, i: usize, flow: &Flow) {
        self.table.set_flow(&mut self.rows, i, flow);
    }

    fn factors(&self, i: usize) -> Factors<f64> {
        self.table.factors(&self.rows, i)
    }

    fn losses(&self, i: usize) -> Thrusts {
        self.table.losses(&self.rows, i)
    }

    fn set_factors(&mut self, i: usize, factors: &Factors<f64>) {
        self.table.set_factors(&mut self.rows, i, factors);
    }

    fn column(&self, i: usize) -> Vec<f64> {
        self.table.column(&self.rows, i)
    }

    fn set_column(&mut self, i: usize, column: &[f64]) {
        self.table.set_column(&mut self.rows, i, column);
    }

    fn column_len(&self) -> usize {
        self.table.layout.rows
    }

    fn step(&mut self, run: &Run, given: Option<&Applied>) -> Option<Sighting> {
        let parts = self.instances.div_ceil(CHUNK);
        self.visit(run, 0..parts, |part, _| {
            if let Some(given) = given {
                part.table.apply(part.isa, part.rows, given, part.first, part.count);
            }
            part.step();
        })
    }

    fn accelerations(&mut self, given: &Applied) -> Vec<f64> {
        self.table.apply(self.isa, &mut self.rows, given, 0, self.instances);
        let width = 6 + self.table.layout.joints;
        let blocks = self.rows.len() / (self.table.layout.rows * T::BLOCK);
        let mut out = vec![T::from_f64(0.0); blocks * width * T::BLOCK];
        let [varied, laden] = self.table.varied(&self.rows);
        let mut job = Accelerate {
            system: &self.scene.system,
            unscaled: varied.then_some(&self.scene.unscaled[..]),
            payload_attachment: laden.then_some(self.scene.payload_attachment),
            layout: &self.table.layout,
            switches: given.switches(),
            count: self.instances,
            blocks: &mut self.rows,
            out: &mut out,
        };
        T::dispatch_narrow(self.isa, &mut job);
        let entry = |i: usize, k: usize| out[(i / T::BLOCK * width + k) * T::BLOCK + i % T::BLOCK].to_f64();
        (0..self.instances).flat_map(|i| (0..width).map(move |k| (i, k))).map(|(i, k)| entry(i, k)).collect()
    }

    fn bytes_per_instance(&self) -> usize {
        self.rows.len() * size_of::<T>() / self.instances
    }

    fn boxed_clone(&self) -> Box<dyn Storage> {
        Box::new(self.clone())
    }

    fn as_any(&mut self) -> &mut dyn Any {
        self
    }
}
