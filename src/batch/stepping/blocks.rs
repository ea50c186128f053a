//! Blocks of all instances in one precision: access to single instances, stepping in chunks on threads.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

use super::accelerate::Accelerate;
use super::scratch_pool::ScratchPool;
use super::step::{Step, StepScaled};
use super::threads::for_each;
use crate::batch::monitoring::step_quality::{QualityLimits, StepQuality, StepViolation};
use crate::batch::storage::active_loads::ActiveLoads;
use crate::batch::storage::aligned::Aligned;
use crate::batch::storage::inputs::CheckedInputs;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::own_numbers::{OwnLayout, OwnNumbers};
use crate::batch::storage::table::Table;
use crate::error::SimulatorError;
use crate::hydro::Thrusts;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real, Shared};
use crate::system::{Compiled, Factors, Flow, State, System, UnscaledBodyTerms};

/// Instances of a chunk, in whole blocks: the unit of work of a thread. Few enough that threads finish together, and so many
/// that fetching each chunk does not show.
pub const CHUNK: usize = 128;
/// Instances per thread below which threads cost more than they save.
const INSTANCES_PER_THREAD: usize = 256;

/// All instances, in either precision.
pub trait Storage: Send + Sync {
    /// State of instance `i`.
    fn state(&self, i: usize) -> State;
    /// Sets the state of instance `i`.
    fn set_state(&mut self, i: usize, state: &State);
    /// Attitude coordinates of instance `i`, where the integrator keeps any besides the rotation matrix.
    fn attitude(&self, i: usize) -> Option<[f64; 4]>;
    /// Sets these coordinates.
    fn set_attitude(&mut self, i: usize, attitude: &[f64; 4]);
    /// Quality of the last steps of size `h` (s) of instance `i`.
    fn step_quality(&self, i: usize, h: f64) -> StepQuality;
    /// Flow of the water at instance `i`.
    fn flow(&self, i: usize) -> Flow;
    /// Sets the flow of the water at instance `i`.
    fn set_flow(&mut self, i: usize, flow: &Flow);
    /// Factors on the parameters of instance `i`.
    fn factors(&self, i: usize) -> Factors<f64>;
    /// Fraction of its thrust that each thruster with dynamics of instance `i` has lost.
    fn losses(&self, i: usize) -> Thrusts;
    /// Sets these factors.
    fn set_factors(&mut self, i: usize, factors: &Factors<f64>);
    /// Sets the numbers that instance `i` has of its own: those of a scene of the same structure.
    fn set_own(&mut self, i: usize, compiled: &Compiled);
    /// Every number of instance `i`, for saving.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets every number of instance `i`.
    fn set_column(&mut self, i: usize, column: &[f64]);
    /// Numbers in a column.
    fn column_len(&self) -> usize;
    /// Steps all instances under new inputs, or under the present loads; the first violation of the settings' limits.
    fn step(&mut self, settings: &StepSettings, inputs: Option<&CheckedInputs>) -> Option<StepViolation>;
    /// `[V'; q'']` of all instances under these inputs, instance by instance.
    fn accelerations(&mut self, inputs: &CheckedInputs) -> Vec<f64>;
    /// Bytes of memory per instance.
    fn bytes_per_instance(&self) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn Storage>;
    /// For a downcast to [`Blocks`] of a known precision.
    fn as_any(&mut self) -> &mut dyn Any;
}

/// Settings of a call that steps.
#[derive(Debug, Clone, Copy)]
pub struct StepSettings {
    /// Integrator.
    pub integrator: Integrator,
    /// Step size, s.
    pub h: f64,
    /// Number of steps.
    pub substeps: usize,
    /// Number of steps before these on the clock of the servo targets.
    pub before: usize,
    /// Optional loads that are active.
    pub active: ActiveLoads,
    /// Greatest number of threads.
    pub threads: usize,
    /// Limits of the steps' quality; none where they are not monitored.
    pub limits: Option<QualityLimits>,
}

/// Blocks of instances in one precision.
#[derive(Clone)]
pub struct Blocks<T> {
    scene: Parameters<T>,
    table: Table,
    isa: Isa,
    instances: usize,
    rows: Aligned<T>,
    /// Numbers that instances have of their own.
    own: Option<OwnNumbers<T>>,
    /// Per chunk, [`Table::scaled`]; none once factors have been set.
    scaled: Vec<Option<[bool; 2]>>,
}

/// Parameters of the scene, and pools of memory for its kernels.
#[derive(Clone)]
struct Parameters<T> {
    system: System<Shared<T>>,
    /// The same in scalars.
    scalar_system: System<T>,
    unscaled: Vec<UnscaledBodyTerms<Shared<T>>>,
    /// Attachment point of payloads, m.
    payload_attachment: [Shared<T>; 3],
    /// Scratch memory of the steps.
    scratch_pool: ScratchPool,
    /// Memory for systems with parameters per instance.
    system_pool: ScratchPool,
    /// The system without added mass, and the filter's weight, where added mass is a lagged force.
    rigid: Option<(System<Shared<T>>, f64)>,
}

impl<T: Real> Blocks<T> {
    /// `instances` instances of a compiled scene, all in `state` and in the same `flow`; or of scenes of its structure, of which
    /// the number and the compiler are `own`: see [`OwnNumbers::new`].
    ///
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(
        compiled: &Compiled,
        own: Option<(usize, &dyn Fn(usize) -> Compiled)>,
        instances: usize,
        integrator: &Integrator,
        isa: Isa,
        state: &State,
        flow: &Flow,
    ) -> Result<Self, SimulatorError> {
        let number = |Shared(x)| Shared(T::from_f64(x));
        let unscaled: Vec<_> = compiled.unscaled.iter().map(|parts| parts.map(number)).collect();
        // Rounded like the terms of instances with factors, so that an instance's factors do not show in its neighbours.
        let system = compiled.system.map(number).with_factors(&unscaled, &Factors::ONE);
        let rigid = integrator.lag().map(|filter| (system.with_factors(&unscaled, &Factors::RIGID), filter));
        let payload_attachment = compiled.payload_attachment.map(|x| Shared(T::from_f64(x)));
        let scalar_system = system.map(|Shared(x)| x);
        let scene = Parameters {
            system,
            scalar_system,
            unscaled,
            payload_attachment,
            scratch_pool: ScratchPool::default(),
            system_pool: ScratchPool::default(),
            rigid,
        };
        let layout =
            Layout::new(compiled.links.len(), compiled.system.thrusters.len(), compiled.system.fins.len(), integrator);
        let memory = || SimulatorError::Memory { instances };
        let columns = instances.checked_next_multiple_of(T::BLOCK).ok_or_else(memory)?;
        let size = columns.checked_mul(layout.rows).ok_or_else(memory)?;
        let rows = Aligned::filled(size, T::from_f64(0.0)).map_err(|_| memory())?;
        let mut links = vec![compiled.links.clone()];
        if let Some((samples, own)) = own
            && (1..samples).any(|i| own(i).links != compiled.links)
        {
            links = (0..samples).map(|i| own(i).links).collect();
        }
        let own = own.map_or(Ok(None), |(samples, own)| OwnNumbers::new(instances, samples, own))?;
        let table = Table { layout, links };
        let scaled = vec![None; instances.div_ceil(CHUNK)];
        let mut blocks = Self { scene, table, isa, instances, rows, own, scaled };
        // Columns past the last instance hold a valid state too: lanes that reach past it step them.
        for i in 0..columns {
            blocks.set_state(i, state);
            blocks.set_flow(i, flow);
            blocks.table.set_factors(&mut blocks.rows, i, &Factors::ONE);
            blocks.table.set_fins(&mut blocks.rows, i, &compiled.system.deflections());
        }
        Ok(blocks)
    }

    /// Calls `work` on each chunk with its item, on as many threads as the settings allow; the first violation of the
    /// settings' limits.
    pub fn for_each_chunk<I: Send>(
        &mut self,
        settings: &StepSettings,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut PhysicsChunk<'_, T>, I) + Sync,
    ) -> Option<StepViolation> {
        let (scene, table, isa, instances) = (&self.scene, &self.table, self.isa, self.instances);
        let threads = settings.threads.min(instances.div_ceil(INSTANCES_PER_THREAD));
        let violations = FirstViolation::default();
        let mut own = self.own.as_mut().map(|own| {
            let (layout, rows) = own.parts();
            (layout, rows.chunks_mut(CHUNK * layout.width))
        });
        let own = move |rows| (rows, own.as_mut().and_then(|(layout, chunks)| Some((*layout, chunks.next()?))));
        let chunks = self.rows.chunks_mut(CHUNK * table.layout.rows).map(own);
        let chunks = chunks.zip(&mut self.scaled).zip(items);
        for_each(chunks.enumerate(), threads, |(k, (((rows, own), scaled), item))| {
            let first = k * CHUNK;
            let count = CHUNK.min(instances - first);
            let violation = None;
            let mut chunk = PhysicsChunk { scene, settings, count, first, table, isa, own, rows, scaled, violation };
            work(&mut chunk, item);
            violations.record(first, chunk.violation);
        });
        violations.take()
    }

    /// Rows of a block, instruction set, and the blocks.
    pub fn parts(&mut self) -> (&Layout, Isa, &mut [T]) {
        (&self.table.layout, self.isa, &mut self.rows)
    }
}

/// A chunk of blocks, which one thread steps.
pub struct PhysicsChunk<'a, T> {
    scene: &'a Parameters<T>,
    settings: &'a StepSettings,
    /// Number of its instances; further columns fill the last block.
    pub count: usize,
    /// Number of its first instance among all.
    pub first: usize,
    /// Access to single instances, counted from 0 in the chunk.
    pub table: &'a Table,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// Numbers that instances have of their own.
    own: Option<(&'a OwnLayout, &'a mut [T])>,
    /// The blocks.
    pub rows: &'a mut [T],
    /// [`Table::scaled`] of the chunk; none once factors have been set.
    scaled: &'a mut Option<[bool; 2]>,
    /// The first violation of the settings' limits.
    violation: Option<StepViolation>,
}

/// The first violation in several chunks.
#[derive(Default)]
struct FirstViolation(Mutex<Option<StepViolation>>);

impl FirstViolation {
    /// Records a violation in a chunk that begins with instance `first`.
    fn record(&self, first: usize, violation: Option<StepViolation>) {
        let Some(mut violation) = violation else { return };
        violation.instance += first;
        let mut least = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if least.is_none_or(|least| violation.instance < least.instance) {
            *least = Some(violation);
        }
    }

    fn take(self) -> Option<StepViolation> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Real> PhysicsChunk<'_, T> {
    /// Sets the numbers that instance `k` of the chunk has of its own: those of a scene of the same structure.
    pub fn set_own(&mut self, k: usize, compiled: &Compiled) {
        self.table.set_fins(self.rows, k, &compiled.system.deflections());
        if let Some((layout, rows)) = &mut self.own {
            layout.set(rows, k, compiled);
        }
    }

    /// Sets the factors on the parameters of instance `k` of the chunk.
    pub fn set_factors(&mut self, k: usize, factors: &Factors<f64>) {
        self.table.set_factors(self.rows, k, factors);
        *self.scaled = None;
    }

    /// Steps all instances.
    pub fn step(&mut self) {
        let (scene, settings) = (self.scene, self.settings);
        let [scaled, with_payload] = *self.scaled.get_or_insert_with(|| self.table.scaled(self.rows));
        let scaled = scaled || self.own.is_some();
        let mut step = Step {
            system: scene.rigid.as_ref().map_or(&scene.system, |(rigid, _)| rigid),
            scalar_system: scene.rigid.is_none().then_some(&scene.scalar_system),
            unscaled: &scene.unscaled,
            scaled,
            own: self.own.as_ref().map(|(layout, rows)| layout.columns(rows)),
            payload_attachment: with_payload.then_some(scene.payload_attachment),
            scratch_pool: &scene.scratch_pool,
            system_pool: &scene.system_pool,
            lag_filter: scene.rigid.as_ref().map(|&(_, filter)| filter),
            layout: &self.table.layout,
            integrator: settings.integrator,
            h: T::from_f64(settings.h),
            substeps: settings.substeps,
            before: settings.before,
            active: settings.active,
            count: self.count,
            blocks: self.rows,
        };
        if (scaled || settings.integrator.needs_baseline_terms()) && self.isa.is_wide() {
            T::dispatch(self.isa, &mut StepScaled(&mut step));
        } else {
            T::dispatch(self.isa, &mut step);
        }
        if let (Some(limits), None) = (settings.limits, &self.violation) {
            self.violation = self.table.first_violation(self.isa, self.rows, self.count, limits, settings.h);
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

    fn step_quality(&self, i: usize, h: f64) -> StepQuality {
        self.table.step_quality(&self.rows, i, h)
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
        self.scaled[i / CHUNK] = None;
    }

    fn set_own(&mut self, i: usize, compiled: &Compiled) {
        self.table.set_fins(&mut self.rows, i, &compiled.system.deflections());
        if let Some(own) = &mut self.own {
            own.set(i, compiled);
        }
    }

    fn column(&self, i: usize) -> Vec<f64> {
        self.table.column(&self.rows, i)
    }

    fn set_column(&mut self, i: usize, column: &[f64]) {
        self.table.set_column(&mut self.rows, i, column);
        self.scaled[i / CHUNK] = None;
    }

    fn column_len(&self) -> usize {
        self.table.layout.rows
    }

    fn step(&mut self, settings: &StepSettings, inputs: Option<&CheckedInputs>) -> Option<StepViolation> {
        let chunks = self.instances.div_ceil(CHUNK);
        self.for_each_chunk(settings, 0..chunks, |chunk, _| {
            if let Some(inputs) = inputs {
                chunk.table.apply(chunk.isa, chunk.rows, inputs, chunk.first, chunk.count);
            }
            chunk.step();
        })
    }

    fn accelerations(&mut self, inputs: &CheckedInputs) -> Vec<f64> {
        self.table.apply(self.isa, &mut self.rows, inputs, 0, self.instances);
        let width = 6 + self.table.layout.joints;
        let blocks = self.rows.len() / (self.table.layout.rows * T::BLOCK);
        let mut out = vec![T::from_f64(0.0); blocks * width * T::BLOCK];
        let [scaled, with_payload] = self.table.scaled(&self.rows);
        let mut kernel = Accelerate {
            system: &self.scene.system,
            unscaled: (scaled || self.own.is_some()).then_some(&self.scene.unscaled[..]),
            own: self.own.as_ref().map(OwnNumbers::columns),
            payload_attachment: with_payload.then_some(self.scene.payload_attachment),
            layout: &self.table.layout,
            active: inputs.active_loads(),
            count: self.instances,
            blocks: &mut self.rows,
            out: &mut out,
        };
        T::dispatch_narrow(self.isa, &mut kernel);
        let entry = |i: usize, k: usize| out[(i / T::BLOCK * width + k) * T::BLOCK + i % T::BLOCK].to_f64();
        (0..self.instances).flat_map(|i| (0..width).map(move |k| (i, k))).map(|(i, k)| entry(i, k)).collect()
    }

    fn bytes_per_instance(&self) -> usize {
        let own = self.own.as_ref().map_or(0, OwnNumbers::bytes);
        (self.rows.len() * size_of::<T>() + own) / self.instances
    }

    fn boxed_clone(&self) -> Box<dyn Storage> {
        Box::new(self.clone())
    }

    fn as_any(&mut self) -> &mut dyn Any {
        self
    }
}
