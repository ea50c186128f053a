//! Blocks of all instances in one precision: access to single instances, stepping in chunks on threads.

use std::any::Any;
use std::sync::{Mutex, PoisonError};

use super::accelerate::Accelerate;
use super::chunk::{CHUNK, PhysicsChunk};
use super::companion::{ChunkCompanions, CompanionScene, Companions, Follow};
use super::parameters::{Parameters, StepSettings};
use super::step::Step;
use super::threads::for_each;
use super::track::Stage;
use crate::batch::monitoring::step_quality::{StepQuality, Violations};
use crate::batch::storage::aligned::Aligned;
use crate::batch::storage::inputs::CheckedInputs;
use crate::batch::storage::layout::{Layout, index};
use crate::batch::storage::own_numbers::OwnNumbers;
use crate::batch::storage::table::Table;
use crate::error::SimulatorError;
use crate::hydro::Thrusts;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real};
use crate::limits::interrupt;
use crate::system::{Compiled, Factors, Flow, State};

/// Instances per thread below which threads cost more than they save.
const INSTANCES_PER_THREAD: usize = 256;

/// All instances, in either precision.
pub trait Storage: Send + Sync {
    /// State of instance `i`.
    fn state(&self, i: usize) -> State;
    /// Sets the state of instance `i`.
    fn set_state(&mut self, i: usize, state: &State);
    /// Attitude coordinates of instance `i`, where the integrator has any besides the rotation matrix.
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
    /// State of the companion of instance `i`, if it has one that follows it, and the relative error.
    fn companion(&self, i: usize) -> Option<(State, f64)>;
    /// True where all instances are followed by companions.
    fn follows_all(&self) -> bool;
    /// Sets the numbers that instance `i` has of its own, from a scene of the same structure.
    fn set_own(&mut self, i: usize, compiled: &Compiled);
    /// Every number of instance `i`, for saving.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets every number of instance `i`.
    fn set_column(&mut self, i: usize, column: &[f64]);
    /// Numbers in a column.
    fn column_len(&self) -> usize;
    /// Steps all instances under new inputs, or under the present loads; violations of the settings' limits.
    fn step(&mut self, settings: &StepSettings, inputs: Option<&CheckedInputs>) -> Violations;
    /// `[V'; q'']` of all instances under these inputs, instance by instance.
    fn accelerations(&mut self, settings: &StepSettings, inputs: &CheckedInputs) -> Vec<f64>;
    /// Bytes of memory per instance.
    fn bytes_per_instance(&self) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn Storage>;
    /// For a downcast to [`Blocks`] of a known precision.
    fn as_any(&mut self) -> &mut dyn Any;
}

/// Blocks of instances in one precision.
#[derive(Clone)]
pub struct Blocks<T> {
    pub(super) scene: Parameters<T>,
    pub(super) table: Table,
    pub(super) isa: Isa,
    pub(super) instances: usize,
    pub(super) rows: Aligned<T>,
    /// Numbers that instances have of their own.
    pub(super) own: Option<OwnNumbers<T>>,
    /// Per chunk, [`Table::scaled`]; none once factors have been set.
    scaled: Vec<Option<[bool; 2]>>,
    companions: Option<Companions>,
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
        (state, flow): (&State, &Flow),
        follow: Option<Follow>,
    ) -> Result<Self, SimulatorError> {
        let scene = Parameters::new(compiled, integrator);
        let counts = [compiled.links.len(), compiled.system.thrusters.len(), compiled.system.terms.fins.len()];
        let layout = Layout::new::<T>(counts, integrator);
        let memory = || SimulatorError::Memory { instances };
        let columns = instances.checked_next_multiple_of(T::BLOCK).ok_or_else(memory)?;
        let size = columns.checked_mul(layout.rows).ok_or_else(memory)?;
        let rows = Aligned::filled(size, T::from_f64(0.0)).map_err(|_| memory())?;
        let mut links = vec![compiled.links.clone()];
        if let Some((samples, own)) = own
            && (1..samples).any(|i| interrupt::requested() || own(i).links != compiled.links)
        {
            if interrupt::requested() {
                return Err(SimulatorError::Interrupted);
            }
            links = (0..samples).map(|i| own(i).links).collect();
        }
        let own = own.map_or(Ok(None), |(samples, own)| OwnNumbers::new(instances, samples, own))?;
        let table = Table { layout, links };
        let scaled = vec![None; instances.div_ceil(CHUNK)];
        let mut blocks = Self { scene, table, isa, instances, rows, own, scaled, companions: None };
        // Columns past the last instance need a valid state: lanes that reach past it step them too.
        for i in 0..columns {
            blocks.set_state(i, state);
            blocks.set_flow(i, flow);
            blocks.table.set_factors(&mut blocks.rows, i, &Factors::ONE);
            blocks.table.set_fins(&mut blocks.rows, i, &compiled.system.terms.deflections());
        }
        if let Some(follow) = follow {
            let scene = CompanionScene::new::<T>(follow, compiled, integrator, isa, &blocks.table.layout);
            let own = blocks.own.as_ref().map(|own| &own.layout);
            let chunks = instances.div_ceil(CHUNK);
            let of_chunk = |chunk| {
                let count = CHUNK.min(instances - chunk * CHUNK);
                ChunkCompanions::new(&scene, [chunk, chunks, count], compiled, (state, flow), own)
            };
            let chunks = (0..chunks).map(of_chunk).collect::<Option<_>>().ok_or_else(memory)?;
            blocks.companions = Some(Companions { scene, chunks });
        }
        Ok(blocks)
    }

    /// Scene of the companions, companions of the chunk of instance `i`, and the index of the instance in the chunk.
    fn companions_of(&mut self, i: usize) -> Option<(&CompanionScene, &mut ChunkCompanions, usize)> {
        let companions = self.companions.as_mut()?;
        Some((&companions.scene, companions.chunks.get_mut(i / CHUNK)?, i % CHUNK))
    }

    /// Calls `work` on each chunk with its item, on the threads that the settings allow, until an interrupt;
    /// violations of the settings' limits.
    pub fn for_each_chunk<I: Send>(
        &mut self,
        settings: &StepSettings,
        items: impl ExactSizeIterator<Item = I> + Send,
        work: impl Fn(&mut PhysicsChunk<'_, T>, I) + Sync,
    ) -> Violations {
        let (scene, table, isa, instances) = (&self.scene, &self.table, self.isa, self.instances);
        let threads = settings.threads.min(instances.div_ceil(INSTANCES_PER_THREAD));
        let violations = Mutex::new(Violations::default());
        let own = self.own.as_mut().map(|OwnNumbers { layout, rows }| (&*layout, rows));
        let mut own = own.map(|(layout, rows)| (layout, rows.chunks_mut(CHUNK * layout.width)));
        let own = move |rows| (rows, own.as_mut().and_then(|(layout, chunks)| Some((*layout, chunks.next()?))));
        let chunks = self.rows.chunks_mut(CHUNK * table.layout.rows).map(own);
        let mut companions = self.companions.as_mut().map(|all| (&all.scene, all.chunks.iter_mut()));
        let companions = (0..instances.div_ceil(CHUNK))
            .map(move |_| companions.as_mut().and_then(|(scene, chunks)| Some((*scene, chunks.next()?))));
        let chunks = chunks.zip(&mut self.scaled).zip(companions).zip(items);
        for_each(chunks.enumerate(), threads, |(k, ((((rows, own), scaled), companions), item))| {
            if interrupt::requested() {
                return;
            }
            let first = k * CHUNK;
            let count = CHUNK.min(instances - first);
            let mut chunk = PhysicsChunk {
                scene,
                settings,
                count,
                first,
                table,
                isa,
                own,
                rows,
                scaled,
                companions,
                violations: Violations::default(),
            };
            work(&mut chunk, item);
            if !chunk.violations.is_empty() {
                violations.lock().unwrap_or_else(PoisonError::into_inner).merge(&chunk.violations, first);
            }
        });
        violations.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Rows of a block, instruction set, and the blocks.
    pub fn parts(&mut self) -> (&Layout, Isa, &mut [T]) {
        (&self.table.layout, self.isa, &mut self.rows)
    }
}

impl Blocks<f64> {
    /// Copies the numbers that instances have of their own from blocks in single precision, of the same samples.
    pub fn set_own_numbers(&mut self, single: &Blocks<f32>) {
        if let (Some(own), Some(single)) = (&mut self.own, &single.own) {
            for i in 0..own.rows.len() / own.layout.width {
                own.layout.copy(&single.rows, i, &mut own.rows, i);
            }
        }
    }
}

impl<T: Real> Storage for Blocks<T> {
    fn state(&self, i: usize) -> State {
        self.table.state(&self.rows, i)
    }

    fn set_state(&mut self, i: usize, state: &State) {
        let followed = self.companions_of(i).is_some_and(|(_, companions, k)| companions.follows(k));
        let before = followed.then(|| self.table.state(&self.rows, i));
        self.table.set_state(&mut self.rows, i, state);
        if let (Some(before), Some((scene, companions, k))) = (before, self.companions_of(i)) {
            companions.change_state(scene, k, &before, state);
        }
    }

    fn attitude(&self, i: usize) -> Option<[f64; 4]> {
        self.table.attitude(&self.rows, i)
    }

    fn set_attitude(&mut self, i: usize, attitude: &[f64; 4]) {
        self.table.set_attitude(&mut self.rows, i, attitude);
        if let Some((scene, companions, k)) = self.companions_of(i) {
            companions.set_attitude(scene, k, attitude);
        }
    }

    fn step_quality(&self, i: usize, h: f64) -> StepQuality {
        let accumulated = self.companion(i).map_or(0.0, |(_, relative)| relative);
        StepQuality { accumulated, ..self.table.step_quality(&self.rows, i, h) }
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
        self.table.set_fins(&mut self.rows, i, &compiled.system.terms.deflections());
        if let Some(own) = &mut self.own {
            own.layout.set(&mut own.rows, i, compiled);
        }
        if let Some(track) = self.companions_of(i).and_then(|(_, companions, k)| companions.track(k)) {
            track.own_stale = true;
        }
    }

    fn companion(&self, i: usize) -> Option<(State, f64)> {
        let companions = self.companions.as_ref()?;
        companions.chunks[i / CHUNK].of(&companions.scene, i % CHUNK)
    }

    fn follows_all(&self) -> bool {
        self.companions.as_ref().is_some_and(|companions| companions.scene.follows_all())
    }

    fn column(&self, i: usize) -> Vec<f64> {
        let mut column = self.table.column(&self.rows, i);
        if let Some(Companions { scene, chunks }) = self.companions.as_ref().filter(|all| all.scene.saved() > 0) {
            column.extend(chunks[i / CHUNK].save(scene, i % CHUNK));
        }
        column
    }

    fn set_column(&mut self, i: usize, column: &[f64]) {
        self.table.set_column(&mut self.rows, i, column);
        self.scaled[i / CHUNK] = None;
        let numbers = &column[self.table.layout.rows..];
        if let Some((scene, companions, k)) = self.companions_of(i) {
            if let Some(track) = companions.track(k) {
                track.stage = Stage::Fresh;
            }
            if scene.saved() > 0 {
                companions.load(scene, k, numbers);
            }
        }
    }

    fn column_len(&self) -> usize {
        self.table.layout.rows + self.companions.as_ref().map_or(0, |companions| companions.scene.saved())
    }

    fn step(&mut self, settings: &StepSettings, inputs: Option<&CheckedInputs>) -> Violations {
        let chunks = self.instances.div_ceil(CHUNK);
        self.for_each_chunk(settings, 0..chunks, |chunk, _| {
            if let Some(inputs) = inputs {
                chunk.table.apply(chunk.isa, chunk.rows, inputs, chunk.first, chunk.count);
            }
            chunk.step();
        })
    }

    fn accelerations(&mut self, settings: &StepSettings, inputs: &CheckedInputs) -> Vec<f64> {
        self.table.apply(self.isa, &mut self.rows, inputs, 0, self.instances);
        let width = 6 + self.table.layout.joints;
        let blocks = self.rows.len() / (self.table.layout.rows * T::BLOCK);
        let mut out = vec![T::from_f64(0.0); blocks * width * T::BLOCK];
        let (scaled, own) = (self.table.scaled(&self.rows), self.own.as_ref().map(OwnNumbers::columns));
        let step = self.scene.steps(&self.table.layout, own, scaled, settings, self.instances, &mut self.rows);
        // With added mass as inertia, whatever the method.
        let mut kernel = Accelerate { step: Step { system: &self.scene.system, ..step }, out: &mut out };
        T::dispatch_narrow(self.isa, &mut kernel);
        let entries = (0..self.instances).flat_map(|i| (0..width).map(move |k| index::<T>(width, i, k)));
        entries.map(|at| out[at].to_f64()).collect()
    }

    fn bytes_per_instance(&self) -> usize {
        let own = self.own.as_ref().map_or(0, |own| size_of_val(&own.rows[..]));
        let companions = self.companions.iter().flat_map(|all| &all.chunks).map(ChunkCompanions::bytes).sum::<usize>();
        (self.rows.len() * size_of::<T>() + own + companions) / self.instances
    }

    fn boxed_clone(&self) -> Box<dyn Storage> {
        Box::new(self.clone())
    }

    fn as_any(&mut self) -> &mut dyn Any {
        self
    }
}
