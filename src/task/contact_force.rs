//! Sum of the normal forces of all contacts of a robot, as tasks record it.

use super::definition::{ControlInstant, TaskDefinition};
use crate::dynamics::tool_contact::{TOOL_SPHERES, ToolContact, ToolContacts};
use crate::lane::{Lane, Shared};
use crate::system::System;

/// Rows of the record: force (N), its maximum (N), its integral (N s).
pub(super) const FORCE_ROWS: usize = 3;

/// Sum of the normal forces, N.
#[inline(always)]
pub(super) fn contact_force<L: Lane, K: TaskDefinition>(
    at: &ControlInstant<'_, L, K>,
    system: &System<Shared<L::Real>>,
) -> L {
    let (state, mut force) = (at.state, L::zero());
    L::call(&mut ToolContacts {
        system,
        spheres: &[],
        fixture: 0,
        pose: &state.pose,
        twist: state.twist,
        q: &state.q,
        qd: &state.qd,
        contacts: &mut [ToolContact::none(); TOOL_SPHERES],
        force: &mut force,
    });
    force
}

/// Records a force in the rows from `row` on, and returns it, between 0 and `bound`, N; one that is not finite counts as the bound.
#[inline(always)]
pub(super) fn record_force<L: Lane, K: TaskDefinition>(
    at: &mut ControlInstant<'_, L, K>,
    row: usize,
    force: L,
    bound: f64,
) -> L {
    let force = force.min(L::c(bound)).max(L::zero());
    let [peak, impulse]: [L; FORCE_ROWS - 1] = at.memory.get_all(row + 1);
    let impulse = force.mul_add(L::splat(at.kernel.period), impulse);
    at.memory.set_all(row, &[force, peak.max(force), impulse]);
    force
}
