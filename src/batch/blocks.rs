//! Storage of all instances in one precision, and access to single ones.

use nalgebra as na;

use super::layout::Layout;
use super::step::{Accelerate, Step, Switches};
use super::threads::for_each_chunk;
use crate::error::SimulatorError;
use crate::integrate::Integrator;
use crate::lane::{Isa, Real, Shared};
use crate::lie::{Pose, Vector6};
use crate::system::{Compiled, JOINTS, State, System};

/// Instances per thread below which threads cost more than they bring.
const INSTANCES_PER_THREAD: usize = 256;

/// What is applied to one instance until it is changed.
#[derive(Debug, Clone, PartialEq)]
pub struct InstanceLoads {
    /// Wrench on the vehicle, body frame at its origin.
    pub wrench: [f64; 6],
    /// Actuator torques.
    pub torque: [f64; JOINTS],
    /// Servo targets: polynomials in the time since the step's call, constant term first.
    pub target: [[f64; 4]; JOINTS],
    /// External wrenches on the links, each in its link frame.
    pub links: [[f64; 6]; JOINTS],
    /// Station: target rotation and position.
    pub station: (na::Matrix3<f64>, na::Vector3<f64>),
}

impl Default for InstanceLoads {
    fn default() -> Self {
        Self {
            wrench: [0.0; 6],
            torque: [0.0; JOINTS],
            target: [[0.0; 4]; JOINTS],
            links: [[0.0; 6]; JOINTS],
            station: (na::Matrix3::identity(), na::Vector3::zeros()),
        }
    }
}

/// All instances, whatever the precision.
pub trait Storage: Send + Sync {
    /// State of instance `i`.
    fn state(&self, i: usize) -> State;
    /// Sets the state of instance `i`.
    fn set_state(&mut self, i: usize, state: &State);
    /// Quaternion `[w, x, y, z]` of instance `i` as the integrator keeps it, if it keeps one.
    fn quaternion(&self, i: usize) -> Option<[f64; 4]>;
    /// Sets that quaternion, if one is kept.
    fn set_quaternion(&mut self, i: usize, quaternion: &[f64; 4]);
    /// Current at instance `i`.
    fn current(&self, i: usize) -> na::Vector3<f64>;
    /// Sets the current at instance `i`.
    fn set_current(&mut self, i: usize, current: &na::Vector3<f64>);
    /// Sets the loads of instance `i`, as far as they are on.
    fn set_loads(&mut self, i: usize, loads: &InstanceLoads, switches: Switches);
    /// Every number of instance `i`, to be saved.
    fn column(&self, i: usize) -> Vec<f64>;
    /// Sets every number of instance `i`.
    fn set_column(&mut self, i: usize, column: &[f64]);
    /// Numbers in a column.
    fn column_len(&self) -> usize;
    /// Steps all instances.
    fn step(&mut self, run: &Run);
    /// `[V'; q'']` of all instances under their loads, instance by instance.
    fn accelerations(&mut self, switches: Switches) -> Vec<f64>;
    /// Bytes per instance.
    fn bytes_per_instance(&self) -> usize;
    /// An independent copy.
    fn boxed_clone(&self) -> Box<dyn Storage>;
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
}

/// Blocks of instances in one precision.
#[derive(Clone)]
pub struct Blocks<T> {
    system: System<Shared<T>>,
    links: Vec<Pose<f64>>,
    layout: Layout,
    isa: Isa,
    instances: usize,
    rows: Vec<T>,
}

impl<T: Real> Blocks<T> {
    /// `instances` instances of a compiled scene, all in `state` and in the same `current`.
    ///
    /// # Errors
    /// [`SimulatorError::Memory`] if they do not fit into memory.
    pub fn new(
        compiled: &Compiled,
        instances: usize,
        keeps_quaternion: bool,
        isa: Isa,
        state: &State,
        current: &na::Vector3<f64>,
    ) -> Result<Self, SimulatorError> {
        let system = compiled.system.map(|Shared(x)| Shared(T::from_f64(x)));
        let layout = Layout::new(system.joints.len(), keeps_quaternion);
        let memory = || SimulatorError::Memory { instances };
        let columns = instances.checked_next_multiple_of(T::BLOCK).ok_or_else(memory)?;
        let size = columns.checked_mul(layout.rows).ok_or_else(memory)?;
        let mut rows = Vec::new();
        rows.try_reserve_exact(size).map_err(|_| memory())?;
        rows.resize(size, T::from_f64(0.0));
        let mut blocks = Self { system, links: compiled.links.clone(), layout, isa, instances, rows };
        // Columns past the last instance hold a sane state too: they are stepped along.
        for i in 0..columns {
            blocks.set_state(i, state);
            blocks.set_current(i, current);
        }
        Ok(blocks)
    }

    fn place(&self, i: usize, row: usize) -> usize {
        (i / T::BLOCK * self.layout.rows + row) * T::BLOCK + i % T::BLOCK
    }

    fn get(&self, i: usize, row: usize) -> f64 {
        self.rows[self.place(i, row)].to_f64()
    }

    fn get_all<const K: usize>(&self, i: usize, row: usize) -> [f64; K] {
        std::array::from_fn(|k| self.get(i, row + k))
    }

    fn set_all(&mut self, i: usize, row: usize, values: impl IntoIterator<Item = f64>) {
        for (k, value) in values.into_iter().enumerate() {
            let place = self.place(i, row + k);
            self.rows[place] = T::from_f64(value);
        }
    }
}

impl<T: Real> Storage for Blocks<T> {
    fn state(&self, i: usize) -> State {
        let layout = &self.layout;
        let mut state = State {
            position: self.get_all::<3>(i, layout.position).into(),
            rotation: na::Matrix3::from_row_slice(&self.get_all::<9>(i, layout.rotation)),
            twist: self.get_all::<6>(i, layout.twist).into(),
            time: self.get(i, layout.time) + self.get(i, layout.time + 1),
            ..State::default()
        };
        for k in 0..layout.joints {
            state.q[k] = self.get(i, layout.q + k);
            state.qd[k] = self.get(i, layout.qd + k);
        }
        state
    }

    fn set_state(&mut self, i: usize, state: &State) {
        let layout = self.layout.clone();
        self.set_all(i, layout.rotation, state.rotation.transpose().iter().copied());
        self.set_all(i, layout.position, state.position.iter().copied());
        self.set_all(i, layout.twist, state.twist.iter().copied());
        self.set_all(i, layout.q, state.q[..layout.joints].iter().copied());
        self.set_all(i, layout.qd, state.qd[..layout.joints].iter().copied());
        let time = T::from_f64(state.time).to_f64();
        self.set_all(i, layout.time, [time, state.time - time]);
        if layout.quaternion < layout.rows {
            self.set_all(i, layout.quaternion, crate::system::quaternion(&state.rotation));
        }
    }

    fn quaternion(&self, i: usize) -> Option<[f64; 4]> {
        (self.layout.quaternion < self.layout.rows).then(|| self.get_all(i, self.layout.quaternion))
    }

    fn set_quaternion(&mut self, i: usize, quaternion: &[f64; 4]) {
        if self.layout.quaternion < self.layout.rows {
            self.set_all(i, self.layout.quaternion, *quaternion);
        }
    }

    fn current(&self, i: usize) -> na::Vector3<f64> {
        self.get_all::<3>(i, self.layout.current).into()
    }

    fn set_current(&mut self, i: usize, current: &na::Vector3<f64>) {
        self.set_all(i, self.layout.current, current.iter().copied());
    }

    fn set_loads(&mut self, i: usize, loads: &InstanceLoads, switches: Switches) {
        let layout = self.layout.clone();
        self.set_all(i, layout.wrench, loads.wrench);
        self.set_all(i, layout.torque, loads.torque[..layout.joints].iter().copied());
        if switches.servo {
            self.set_all(i, layout.target, loads.target[..layout.joints].iter().flatten().copied());
        }
        if switches.on_links {
            for k in 0..layout.joints {
                let wrench = self.links[k].co_adjoint_apply_inverse(Vector6::from_array(loads.links[k]));
                self.set_all(i, layout.links + 6 * k, wrench.to_array());
            }
        }
        if switches.station {
            let (rotation, position) = &loads.station;
            self.set_all(i, layout.station, rotation.transpose().iter().copied());
            self.set_all(i, layout.station + 9, position.iter().copied());
        }
    }

    fn column(&self, i: usize) -> Vec<f64> {
        (0..self.layout.rows).map(|row| self.get(i, row)).collect()
    }

    fn set_column(&mut self, i: usize, column: &[f64]) {
        self.set_all(i, 0, column.iter().copied());
    }

    fn column_len(&self) -> usize {
        self.layout.rows
    }

    fn step(&mut self, run: &Run) {
        let threads = run.threads.min(self.instances.div_ceil(INSTANCES_PER_THREAD));
        let (system, layout, isa) = (&self.system, &self.layout, self.isa);
        for_each_chunk(&mut self.rows, layout.rows * T::BLOCK, threads, |_, blocks| {
            let mut step = Step {
                system,
                layout,
                integrator: run.integrator,
                h: T::from_f64(run.h),
                substeps: run.substeps,
                before: run.before,
                switches: run.switches,
                blocks,
            };
            T::dispatch(isa, &mut step);
        });
    }

    fn accelerations(&mut self, switches: Switches) -> Vec<f64> {
        let width = 6 + self.layout.joints;
        let blocks = self.rows.len() / (self.layout.rows * T::BLOCK);
        let mut out = vec![T::from_f64(0.0); blocks * width * T::BLOCK];
        let (system, layout) = (&self.system, &self.layout);
        let mut job = Accelerate { system, layout, switches, blocks: &mut self.rows, out: &mut out };
        T::dispatch(self.isa, &mut job);
        let entry = |i: usize, k: usize| out[(i / T::BLOCK * width + k) * T::BLOCK + i % T::BLOCK].to_f64();
        (0..self.instances).flat_map(|i| (0..width).map(move |k| (i, k))).map(|(i, k)| entry(i, k)).collect()
    }

    fn bytes_per_instance(&self) -> usize {
        self.rows.len() * size_of::<T>() / self.instances
    }

    fn boxed_clone(&self) -> Box<dyn Storage> {
        Box::new(self.clone())
    }
}
