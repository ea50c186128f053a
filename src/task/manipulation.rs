//! Tasks whose tool works on a fixture: the parts that they share.

use super::contact_force;
use super::definition::{ControlInstant, TaskDefinition, TaskKernel};
use super::episode::{EpisodeRows, RowAllocator, TaskRows};
use super::model::TaskModel;
use super::observation::{JOINT_SCALE, ObservationLayout, ObservationWriter, TWIST, six};
use super::tool_path::{ToolPath, ToolPathKernel};
use super::workplace::Workplace;
use crate::dynamics::tool_contact::{TOOL_SPHERES, ToolContact, ToolContacts};
use crate::lane::{Lane, Real, Rows, Shared};
use crate::lie::Vector3;
use crate::system::{System, compile};

/// Offsets of the rows that these tasks share: time since the start (s), and velocities of the target in world axes (6).
const CLOCK: usize = 0;
const MOTION: usize = 1;
/// Rows that [`TaskDefinition::update`] changes: sum of normal forces (N), its maximum (N), its integral (N s), duration of the hold
/// (s), success so far, time to it (s), reward term. Those of the task follow.
pub(super) const FORCE: usize = 7;
const HOLD: usize = 10;
const SUCCESS: usize = 11;
pub(super) const REWARD: usize = 13;
pub(super) const SHARED_ROWS: usize = 14;

/// Maximum force that counts, N.
const FORCE_BOUND: f64 = 1e4;
/// Physical values of 1 in an observation: force, N, and travel of a sliding fixture, m.
const FORCE_SCALE: f64 = 10.0;
const TRAVEL_SCALE: f64 = 0.01;
/// Maximum coordinate of a fixture, rad or m, and maximum rate, rad/s or m/s.
const FIXTURE_BOUND: f64 = 100.0;

/// Quantities beyond those of tracking that an observation has on request.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observes {
    /// Coordinate and rate of the fixture.
    pub fixture: bool,
    /// Force of the fixture on the tool.
    pub force: bool,
}

/// Numbers of the kernel.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ManipulationKernel<T> {
    /// First own row.
    pub own: usize,
    /// Index of the fixture's joint.
    pub fixture: usize,
    /// Spheres of the tool, by their indices in the scene.
    tool: Vec<usize>,
    path: ToolPathKernel<T>,
    system: System<Shared<T>>,
    observes: Observes,
}

/// Contacts of the tool at a control instant.
pub(super) struct ToolReading<L> {
    pub contacts: [ToolContact<L>; TOOL_SPHERES],
    /// Sum of the normal forces of all contacts of the robot, N.
    pub force: L,
}

/// A task whose tool works on a fixture.
pub(super) trait Manipulates: TaskDefinition {
    /// Numbers of the shared part.
    fn shared<T: Real>(kernel: &Self::Kernel<T>) -> &ManipulationKernel<T>;
}

/// Allocates the shared rows and `more` of the task.
pub(super) fn rows(rows: &mut RowAllocator, more: usize) -> TaskRows {
    let own = rows.take(SHARED_ROWS + more);
    TaskRows { own, updated: [own + FORCE, SHARED_ROWS - FORCE + more], ..TaskRows::default() }
}

/// Numbers of the kernel for a scene with the fixture as its last coordinate.
pub(super) fn kernel<T: Real>(
    model: &TaskModel,
    rows: &EpisodeRows,
    work: &Workplace,
    path: &ToolPath,
    observes: Observes,
) -> ManipulationKernel<T> {
    ManipulationKernel {
        own: rows.task.own,
        fixture: model.scene.coordinates().count() - 1,
        tool: work.indices.clone(),
        path: path.kernel(),
        system: compile(&model.scene).system.map(|Shared(x)| Shared(T::from_f64(x))),
        observes,
    }
}

/// Appends the blocks of the reference, and of what `observes` asks for.
pub(super) fn layout(model: &TaskModel, observes: Observes, layout: &mut ObservationLayout) {
    layout.push("reference_twist", "m/s and rad/s", "velocities of the reference, end-effector axes", &six(TWIST));
    if observes.fixture {
        let slides = model.scene.fixtures.last().is_some_and(|fixture| fixture.joint.slides());
        let scale = if slides { TRAVEL_SCALE } else { JOINT_SCALE };
        let entries = [(scale, FIXTURE_BOUND); 2];
        layout.push("fixture", "rad and rad/s, or m and m/s", "coordinate and rate of the fixture", &entries);
    }
    if observes.force {
        let about = "force of the fixture on the tool, end-effector axes";
        layout.push("contact_force", "N", about, &[(FORCE_SCALE, FORCE_BOUND); 3]);
    }
}

/// Sets the target and its velocities.
#[inline(always)]
fn set_target<L: Lane, K: Manipulates>(kernel: &TaskKernel<L::Real, K>, memory: &mut Rows<'_, L::Real>) {
    let shared = K::shared(&kernel.task);
    let point = shared.path.at::<L>(memory.get(shared.own + CLOCK));
    kernel.rows.set_target(memory, &point.pose);
    memory.set_all(shared.own + MOTION, &point.velocity.to_array());
}

/// Sets the target of the first control instant.
#[inline(always)]
pub(super) fn begin<L: Lane, K: Manipulates>(kernel: &TaskKernel<L::Real, K>, memory: &mut Rows<'_, L::Real>) {
    set_target::<L, K>(kernel, memory);
}

/// Moves the target to the next control instant.
#[inline(always)]
pub(super) fn advance<L: Lane, K: Manipulates>(kernel: &TaskKernel<L::Real, K>, memory: &mut Rows<'_, L::Real>) {
    let row = K::shared(&kernel.task).own + CLOCK;
    let time: L = memory.get(row);
    memory.set(row, time + L::splat(kernel.period));
    set_target::<L, K>(kernel, memory);
}

/// Writes the blocks of [`layout`].
#[inline(always)]
pub(super) fn observe<L: Lane, K: Manipulates>(
    at: &ControlInstant<'_, L, K>,
    writer: &mut ObservationWriter<'_, L::Real>,
) {
    let ControlInstant { kernel, memory, state, .. } = at;
    let shared = K::shared(&kernel.task);
    let rotation = kernel.frame(state).rotation;
    for part in [MOTION, MOTION + 3] {
        writer.put_vector(rotation.apply_transposed(Vector3(memory.get_all(shared.own + part))));
    }
    if shared.observes.fixture {
        writer.put(state.q[shared.fixture]);
        writer.put(state.qd[shared.fixture]);
    }
    if shared.observes.force {
        let reading = read(at);
        let mut sum = Vector3::zero();
        for k in 0..shared.tool.len() {
            sum = sum + reading.contacts[k].force;
        }
        writer.put_vector(rotation.apply_transposed(sum));
    }
}

/// Contacts of the tool.
#[inline(always)]
pub(super) fn read<L: Lane, K: Manipulates>(at: &ControlInstant<'_, L, K>) -> ToolReading<L> {
    let (shared, state) = (K::shared(&at.kernel.task), at.state);
    let mut reading = ToolReading { contacts: [ToolContact::none(); TOOL_SPHERES], force: L::zero() };
    L::call(&mut ToolContacts {
        system: &shared.system,
        spheres: &shared.tool,
        fixture: shared.fixture,
        pose: &state.pose,
        twist: state.twist,
        q: &state.q,
        qd: &state.qd,
        contacts: &mut reading.contacts,
        force: &mut reading.force,
    });
    reading
}

/// Records the forces of a control instant.
#[inline(always)]
pub(super) fn record_force<L: Lane, K: Manipulates>(at: &mut ControlInstant<'_, L, K>, reading: &ToolReading<L>) {
    contact_force::record_force(at, K::shared(&at.kernel.task).own + FORCE, reading.force, FORCE_BOUND);
}

/// Records and returns the duration for which `holds` has been true, s.
#[inline(always)]
pub(super) fn record_hold<L: Lane, K: Manipulates>(at: &mut ControlInstant<'_, L, K>, holds: L::Mask) -> L {
    let row = K::shared(&at.kernel.task).own + HOLD;
    let held: L = at.memory.get(row);
    let held = L::select(holds, held + L::splat(at.kernel.period), L::zero());
    at.memory.set(row, held);
    held
}

/// Records success, from the first instant on at which an instance succeeds. Returns the reward, `reward` from success on.
#[inline(always)]
pub(super) fn record_success<L: Lane, K: Manipulates>(
    at: &mut ControlInstant<'_, L, K>,
    succeeds: L::Mask,
    reward: L,
) -> L {
    let own = K::shared(&at.kernel.task).own;
    let [before, time]: [L; 2] = at.memory.get_all(own + SUCCESS);
    let success = L::select(succeeds, L::c(1.0), before);
    let going_on = L::c(1.0) - before;
    let time = going_on.mul_add(L::splat(at.kernel.period), time);
    let reward = success * reward;
    at.memory.set_all(own + SUCCESS, &[success, time, reward]);
    reward
}

/// Instances whose pose error and fixture are within their bounds.
#[inline(always)]
pub(super) fn in_bounds<L: Lane, K: Manipulates>(at: &ControlInstant<'_, L, K>, near: L::Mask) -> L::Mask {
    let shared = K::shared(&at.kernel.task);
    let (q, qd, bound) = (at.state.q[shared.fixture], at.state.qd[shared.fixture], L::c(FIXTURE_BOUND));
    L::and(near, L::and(q.abs().lt(bound), qd.abs().lt(bound)))
}

/// Coordinate of the fixture within its bound, rad or m.
#[inline(always)]
pub(super) fn fixture_coordinate<L: Lane, K: Manipulates>(at: &ControlInstant<'_, L, K>) -> L {
    let bound = L::c(FIXTURE_BOUND);
    at.state.q[K::shared(&at.kernel.task).fixture].min(bound).max(-bound)
}
