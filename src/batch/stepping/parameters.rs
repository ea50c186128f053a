//! Parameters of the kernels that step, settings of a call, and the steps of some blocks.

use std::any::Any;
use std::sync::Mutex;

use super::step::{Step, StepScaled};
use crate::batch::monitoring::step_quality::QualityLimits;
use crate::batch::storage::inputs::ActiveLoads;
use crate::batch::storage::layout::Layout;
use crate::batch::storage::own_numbers::OwnColumns;
use crate::integrate::Integrator;
use crate::lane::{Isa, Lane, Real, Shared};
use crate::system::{Compiled, Factors, InstanceSystem, System, UnscaledBodyTerms};

/// Settings of a call that steps.
#[derive(Debug, Clone, Copy)]
pub struct StepSettings {
    /// Integrator of each step.
    pub integrator: Integrator,
    /// Step size, s.
    pub h: f64,
    /// Number of steps.
    pub substeps: usize,
    /// Number of steps before these in the call, on the clock of the servo targets.
    pub before: usize,
    /// Number of steps of the whole call.
    pub total: usize,
    /// Optional loads that are active.
    pub active: ActiveLoads,
    /// Maximum number of threads.
    pub threads: usize,
    /// Limits of the steps' quality; none where they are not monitored.
    pub limits: Option<QualityLimits>,
}

/// Pool of scratch buffers that are not in use. Allocating them for every few blocks, or for every call of a single instance,
/// would take a measurable time. A caller that finds the pool locked allocates its own. Buffers have the numbers of their last
/// user: write before reading.
#[derive(Debug, Default)]
pub struct ScratchPool(Mutex<Vec<Box<dyn Any + Send>>>);

impl ScratchPool {
    /// Maximum number of buffers in the pool; with more threads some allocate theirs anew.
    const MOST: usize = 64;

    /// A buffer of this type, if there is one.
    pub fn take<M: Any>(&self) -> Option<Box<M>> {
        self.0.try_lock().ok()?.pop()?.downcast().ok()
    }

    /// Returns a buffer.
    pub fn put<M: Any + Send>(&self, buffer: Box<M>) {
        if let Ok(mut buffers) = self.0.try_lock()
            && buffers.len() < Self::MOST
        {
            buffers.push(buffer);
        }
    }
}

/// A copy is empty.
impl Clone for ScratchPool {
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// Parameters of the scene, and pools of memory for its kernels.
#[derive(Clone)]
pub struct Parameters<T> {
    pub system: System<Shared<T>>,
    /// The system in scalars.
    pub scalar_system: System<T>,
    pub unscaled: Vec<UnscaledBodyTerms<Shared<T>>>,
    /// Attachment point of payloads, m.
    pub payload_attachment: [Shared<T>; 3],
    /// Scratch memory of the steps.
    pub scratch_pool: ScratchPool,
    /// Memory for systems with parameters per instance.
    pub system_pool: ScratchPool,
    /// Scratch memory of steps in dual numbers.
    pub dual_scratch_pool: ScratchPool,
    /// Memory for systems in dual numbers.
    pub dual_system_pool: ScratchPool,
    /// Memory of the adjoint: of its steps, of its systems, and its own.
    pub adjoint_pools: [ScratchPool; 3],
    /// The system without added mass, and the filter's weight, where added mass is a lagged force.
    pub rigid: Option<(System<Shared<T>>, f64)>,
}

impl<T: Real> Parameters<T> {
    /// Parameters of a compiled scene for an integrator.
    pub fn new(compiled: &Compiled, integrator: &Integrator) -> Self {
        let number = |Shared(x)| Shared(T::from_f64(x));
        let unscaled: Vec<_> = compiled.unscaled.iter().map(|parts| parts.map(number)).collect();
        // Rounded like the terms of instances with factors, so that an instance's factors do not show in its neighbours.
        let system = compiled.system.map(number).with_factors(&unscaled, &Factors::ONE);
        let rigid = integrator.lag().map(|filter| (system.with_factors(&unscaled, &Factors::RIGID), filter));
        let payload_attachment = compiled.payload_attachment.map(|x| Shared(T::from_f64(x)));
        let scalar_system = system.map(|Shared(x)| x);
        Self {
            system,
            scalar_system,
            unscaled,
            payload_attachment,
            scratch_pool: ScratchPool::default(),
            system_pool: ScratchPool::default(),
            dual_scratch_pool: ScratchPool::default(),
            dual_system_pool: ScratchPool::default(),
            adjoint_pools: Default::default(),
            rigid,
        }
    }

    /// Kernel of the steps of `count` instances in blocks, with the numbers that instances have of their own. `scaled`: any
    /// instance has a factor other than 1, any has a payload.
    pub fn steps<'a>(
        &'a self,
        layout: &'a Layout,
        own: Option<OwnColumns<'a, T>>,
        scaled: [bool; 2],
        settings: &StepSettings,
        count: usize,
        blocks: &'a mut [T],
    ) -> Step<'a, T> {
        let StepSettings { integrator, h, substeps, before, active, .. } = *settings;
        let [scaled, with_payload] = scaled;
        Step {
            system: self.rigid.as_ref().map_or(&self.system, |(rigid, _)| rigid),
            scalar_system: self.rigid.is_none().then_some(&self.scalar_system),
            unscaled: &self.unscaled,
            scaled: scaled || own.is_some(),
            own,
            payload_attachment: with_payload.then_some(self.payload_attachment),
            scratch_pool: &self.scratch_pool,
            system_pool: &self.system_pool,
            lag_filter: self.rigid.as_ref().map(|&(_, filter)| filter),
            layout,
            integrator,
            h: T::from_f64(h),
            substeps,
            before,
            active,
            count,
            blocks,
        }
    }
}

impl<T: Real> Step<'_, T> {
    /// A system with parameters per instance and these `parts` of its bodies: from the pool where instances differ.
    #[inline(never)]
    pub(super) fn system<L: Lane<Real = T>>(&self, parts: &[UnscaledBodyTerms<Shared<T>>]) -> Box<InstanceSystem<L>> {
        let has_payload = |system: &System<L>| system.payload_body().payload.is_some();
        let fits = |pooled: &InstanceSystem<L>| has_payload(&pooled.system) == self.payload_attachment.is_some();
        let pooled = if self.scaled { self.system_pool.take().filter(|pooled: &Box<_>| fits(pooled)) } else { None };
        pooled.unwrap_or_else(|| {
            let scaled = if self.scaled { self.unscaled } else { &[] };
            let system = self.system.allocate_scaled(scaled, self.payload_attachment);
            Box::new(InstanceSystem::allocate(system, parts, self.payload_attachment))
        })
    }

    /// Steps the blocks.
    pub fn run(&mut self, isa: Isa) {
        if (self.scaled || self.integrator.needs_baseline_terms()) && T::lanes(isa).is_wide() {
            T::dispatch(isa, &mut StepScaled(self));
        } else {
            T::dispatch(isa, self);
        }
    }
}
