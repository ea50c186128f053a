//! Kernels of a task over blocks of instances: act, evaluate, observe.

use std::ops::Range;

use super::outputs::Outputs;
use crate::batch::storage::layout::Layout;
use crate::control::ACTIONS;
use crate::lane::{Kernel, Lane, Real, Routine, Rows, prefetch_after, transpose};
use crate::lie::{Pose, Vector6};
use crate::system::JOINTS;
use crate::task::disturbance::{Battery, Forcing};
use crate::task::observation::LONGEST;
use crate::task::{ActionKernel, Command, ControlInstant, Evaluation, METRICS, StageState, TaskDefinition, TaskKernel};

/// Maximum number of lanes.
const WIDEST: usize = 16;

/// Blocks of instances, and their episodes' numbers.
pub(super) struct EpisodeBlocks<'a, T> {
    /// Rows of a block of instances, and of one of episodes.
    pub layout: &'a Layout,
    pub rows: usize,
    pub physics: &'a mut [T],
    pub episodes: &'a mut [T],
}

impl<T: Real> EpisodeBlocks<'_, T> {
    /// Physics and episodes of the group that starts with instance `first`. The `needed` rows of either in the next block
    /// are prefetched.
    #[inline(always)]
    fn group<L: Lane>(&mut self, first: usize, needed: &[Range<usize>; 2]) -> (Rows<'_, T>, Rows<'_, T>) {
        let (block, lane) = (first / T::BLOCK, first % T::BLOCK);
        let [of_physics, of_episodes] = needed;
        let width = self.layout.rows * T::BLOCK;
        let physics = &mut self.physics[block * width..][..width];
        prefetch_after::<L, _>(&physics[of_physics.start * T::BLOCK..of_physics.end * T::BLOCK], width);
        let width = self.rows * T::BLOCK;
        let episodes = &mut self.episodes[block * width..][..width];
        prefetch_after::<L, _>(&episodes[of_episodes.start * T::BLOCK..of_episodes.end * T::BLOCK], width);
        (Rows::of_block(physics, lane), Rows::of_block(episodes, lane))
    }
}

/// State of a group of instances.
#[inline(always)]
fn stage_state<L: Lane>(layout: &Layout, physics: &Rows<'_, L::Real>) -> StageState<L> {
    let (mut q, mut qd) = ([L::zero(); JOINTS], [L::zero(); JOINTS]);
    physics.get_some(layout.q, layout.joints, &mut q);
    physics.get_some(layout.qd, layout.joints, &mut qd);
    let pose = Pose { rotation: physics.matrix(layout.rotation), position: physics.vector(layout.position) };
    StageState { pose, twist: physics.six(layout.twist), q, qd }
}

/// Applies actions: thrusts and servo targets become the loads of the coming steps.
pub(super) struct ActKernel<'a, T: Real> {
    pub blocks: EpisodeBlocks<'a, T>,
    pub kernel: ActionKernel<'a, T>,
    /// (n, a) for the first n instances of the blocks.
    pub actions: &'a [f32],
    /// Actions of the base controller, (n, a), with residual actions.
    pub base: Option<&'a [f32]>,
}

impl<T: Real> Kernel<T> for ActKernel<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let (kernel, rows) = (&self.kernel, self.kernel.rows());
        let (width, disturbance) = (rows.actions, kernel.disturbance);
        let count = self.actions.len() / width;
        let needed = match disturbance {
            Some(_) => [0..layout.common, 0..rows.rows],
            None => [layout.wrench..layout.target + 4 * layout.joints, rows.first_for_action()..rows.integral],
        };
        let mut scratch = [0.0; ACTIONS * WIDEST];
        // Zeroed once, not for each group: most of these numbers belong to no thruster and no joint.
        let (mut action, mut base, mut command) = ([L::zero(); ACTIONS], [L::zero(); ACTIONS], Command::none());
        let mut forcing = Forcing::none();
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            read(&self.actions[first * width..], lanes, width, &mut scratch, &mut action);
            if let Some(given) = self.base {
                read(&given[first * width..], lanes, width, &mut scratch, &mut base);
            }
            let (mut physics, mut memory) = self.blocks.group::<L>(first, &needed);
            kernel.act(&mut memory, &mut action, self.base.is_some().then_some(&base), &mut command);
            let mut disturbing = Vector6::zero();
            if let Some(disturbance) = disturbance {
                let state = stage_state::<L>(layout, &physics);
                let places = disturbance.places();
                if let Some(at) = places.battery {
                    Battery::load(&mut memory, at, command.actuated.power);
                }
                disturbance.pass_period(&mut memory, &state.pose, &state.twist, rows.current, &mut forcing);
                for k in 0..layout.thrusters {
                    physics.set(layout.loss + k, L::c(1.0) - forcing.gains[k]);
                }
                if (places.thrusters.is_some() || places.battery.is_some()) && layout.thrusters == 0 {
                    kernel.scale_thrusts(&forcing, &mut command.actuated);
                }
                physics.set_all(layout.current, &forcing.velocity.0);
                physics.set_all(layout.acceleration, &forcing.acceleration.0);
                disturbing = forcing.wrench;
            }
            if layout.thrusters > 0 {
                // The physics computes the thrusts.
                physics.set_some(layout.command, &command.actuated.thrusts, layout.thrusters);
                physics.set_all(layout.wrench, &disturbing.to_array());
            } else {
                let thrust = physics.factors::<L>(layout).thrust;
                physics.set_all(layout.wrench, &command.actuated.wrench.scale_add(thrust, disturbing).to_array());
            }
            if kernel.drives_joints {
                physics.set_some(layout.torque, &command.actuated.torques, layout.joints);
            } else {
                for k in 0..layout.joints {
                    physics.set_all(layout.target + 4 * k, &command.joints[k]);
                }
            }
        }
    }
}

/// Loads rows (lanes, width) of actions into lanes; `scratch` is working memory.
#[inline(always)]
fn read<L: Lane>(
    rows: &[f32],
    lanes: usize,
    width: usize,
    scratch: &mut [f32; ACTIONS * WIDEST],
    entries: &mut [L; ACTIONS],
) {
    if lanes == L::LANES {
        transpose(rows, width, scratch, L::LANES, [L::LANES, width]);
    } else {
        let mut some = [0.0; ACTIONS * WIDEST];
        some[..lanes * width].copy_from_slice(&rows[..lanes * width]);
        transpose(&some, width, scratch, L::LANES, [L::LANES, width]);
    }
    for k in 0..width {
        entries[k] = L::load_single(&scratch[k * L::LANES..]);
    }
}

/// Evaluates the states after a control period, and observes.
pub(super) struct EvaluateKernel<'a, 'b, T: Real, K: TaskDefinition> {
    pub blocks: EpisodeBlocks<'a, T>,
    pub kernel: &'a TaskKernel<T, K>,
    /// Completed control periods, this one included, of each instance of the blocks.
    pub counts: &'a [T],
    /// For the instances of the blocks.
    pub out: &'a mut Outputs<'b>,
}

impl<T: Real, K: TaskDefinition> Kernel<T> for EvaluateKernel<'_, '_, T, K> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let kernel = self.kernel;
        let (count, width) = (self.out.len(), kernel.observation_len());
        let needed = [0..layout.time, 0..kernel.rows().rows];
        let mut scratch = [0.0; LONGEST * WIDEST];
        for first in (0..count).step_by(L::LANES) {
            let (physics, mut memory) = self.blocks.group::<L>(first, &needed);
            let state = stage_state::<L>(layout, &physics);
            kernel.advance::<L>(&mut memory);
            let mut at = ControlInstant::new(kernel, memory, &state);
            let evaluation = at.evaluate(L::c(1.0) / L::load(&self.counts[first..]));
            let lanes = L::LANES.min(count - first);
            let rows = &mut self.out.observations[first * width..];
            if L::LANES == 1 {
                // The entries of a single instance are in order already.
                at.observe(rows);
            } else {
                at.observe(&mut scratch);
                prefetch_after::<L, _>(&rows[..lanes * width], lanes * width);
                if lanes == L::LANES {
                    transpose(&scratch, L::LANES, rows, width, [width, L::LANES]);
                } else {
                    let mut all = [0.0; LONGEST * WIDEST];
                    transpose(&scratch, L::LANES, &mut all, width, [width, L::LANES]);
                    rows[..lanes * width].copy_from_slice(&all[..lanes * width]);
                }
            }
            L::call(&mut Writer { evaluation: &evaluation, own: K::METRICS.len(), first, lanes, out: self.out });
        }
    }
}

/// Writes the first `lanes` lanes of an evaluation with `own` metrics of the task; the kernels of all tasks share it.
struct Writer<'a, 'b, L: Lane> {
    evaluation: &'a Evaluation<L>,
    own: usize,
    first: usize,
    lanes: usize,
    out: &'a mut Outputs<'b>,
}

impl<L: Lane> Routine<L> for Writer<'_, '_, L> {
    #[inline(always)]
    fn run(&mut self) {
        let Self { evaluation, own, first, lanes, out } = self;
        let (first, lanes) = (*first, *lanes);
        let continues = L::bits(evaluation.continues);
        for lane in 0..lanes {
            out.terminated[first + lane] = continues >> lane & 1 == 0;
        }
        let metrics = evaluation.metrics.to_array();
        for k in 0..METRICS {
            put(metrics[k], out.info[k], first, lanes);
        }
        for k in 0..*own {
            put(evaluation.own[k], out.info[METRICS + k], first, lanes);
        }
        put(evaluation.reward, out.rewards, first, lanes);
    }
}

/// Writes the first `lanes` lanes of a number to a row, from instance `first` on.
#[inline(always)]
fn put<L: Lane>(x: L, row: &mut [f64], first: usize, lanes: usize) {
    let to = &mut row[first..first + lanes];
    prefetch_after::<L, _>(to, lanes);
    if lanes == L::LANES {
        x.store_double(to);
    } else {
        let mut all = [0.0; WIDEST];
        x.store_double(&mut all);
        to.copy_from_slice(&all[..lanes]);
    }
}

/// Observations and metrics of instances at their current control instant.
pub(super) struct ObserveKernel<'a, 'b, T: Real, K: TaskDefinition> {
    pub blocks: EpisodeBlocks<'a, T>,
    pub kernel: &'a TaskKernel<T, K>,
    /// Chosen instances of the blocks.
    pub chosen: &'a [bool],
    /// True values in place of the sensors' readings.
    pub perfect: bool,
    /// Observations of the chosen instances of the blocks, and metrics where there are rows for them.
    pub out: &'a mut Outputs<'b>,
}

impl<T: Real, K: TaskDefinition> Kernel<T> for ObserveKernel<'_, '_, T, K> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        let layout = self.blocks.layout;
        let kernel = self.kernel;
        let (count, width) = (self.chosen.len(), kernel.observation_len());
        let metrics = if self.out.info[0].is_empty() { 0 } else { METRICS + K::METRICS.len() };
        let mut scratch = [0.0; LONGEST * WIDEST];
        let mut all = [0.0; WIDEST];
        for first in (0..count).step_by(L::LANES) {
            let lanes = L::LANES.min(count - first);
            let chosen = &self.chosen[first..first + lanes];
            let mut any = false;
            for lane in 0..lanes {
                any |= chosen[lane];
            }
            if !any {
                continue;
            }
            let (physics, memory) = self.blocks.group::<L>(first, &[0..0, 0..0]);
            let state = stage_state::<L>(layout, &physics);
            let at = ControlInstant::new(kernel, memory, &state);
            let measured = if self.perfect { at.true_values() } else { at.measured() };
            at.observe_as(&measured, &mut scratch);
            if metrics > 0 {
                let evaluation = at.current_metrics();
                let common = evaluation.metrics.to_array();
                for k in 0..metrics {
                    let x = if k < METRICS { common[k] } else { evaluation.own[k - METRICS] };
                    x.store_double(&mut all);
                    for lane in 0..lanes {
                        if chosen[lane] {
                            self.out.info[k][first + lane] = all[lane];
                        }
                    }
                }
            }
            for lane in 0..lanes {
                if chosen[lane] {
                    let row = &mut self.out.observations[(first + lane) * width..][..width];
                    for k in 0..width {
                        row[k] = scratch[k * L::LANES + lane];
                    }
                }
            }
        }
    }
}
