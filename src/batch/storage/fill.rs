//! Inputs to loads: from numbers by instance to rows of blocks.

use super::inputs::CheckedInputs;
use super::table::Table;
use crate::control::THRUSTERS;
use crate::lane::{Isa, Kernel, Lane, Real, Rows, transpose};
use crate::system::JOINTS;

/// Maximum number of instances in a block.
const WIDEST: usize = 16;
/// Numbers of a target pose: position, and rotation by rows.
const STATION: usize = 12;
/// Maximum number of numbers of an instance in a buffer: its thrusts; torques and target poses have fewer.
const SCRATCH: usize = THRUSTERS;

/// One number of each instance of a block. In f64 in either precision of the rows, by operations that are rounded one by one
/// in the order of [`CheckedInputs::loads`]: loads have the same bits on every instruction set.
type Row = [f64; WIDEST];

impl Table {
    /// Sets the loads of `count` instances, the first of which is number `first` among all.
    pub fn apply<T: Real>(&self, isa: Isa, rows: &mut [T], inputs: &CheckedInputs, first: usize, count: usize) {
        T::dispatch(isa, &mut Fill { given: inputs, table: self, first, count, blocks: &mut *rows });
        if inputs.active_loads().link_wrenches {
            for i in 0..count {
                self.set_links(rows, i, first + i, inputs.links(first + i));
            }
        }
        if inputs.own_actuators() {
            for i in 0..count {
                let loads = inputs.loads(first + i, self.factors(rows, i).thrust);
                self.set_actuators(rows, i, &loads);
            }
        }
    }
}

/// Kernel that fills blocks with all loads except loads on links.
struct Fill<'a, T> {
    given: &'a CheckedInputs<'a>,
    table: &'a Table,
    first: usize,
    count: usize,
    blocks: &'a mut [T],
}

impl<T: Real> Kernel<T> for Fill<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        const { assert!(T::BLOCK <= WIDEST && JOINTS <= SCRATCH && STATION <= SCRATCH) };
        let (given, layout) = (self.given, &self.table.layout);
        let n = layout.joints;
        let (mut scratch, mut targets) = ([[0.0; WIDEST]; SCRATCH], [[0.0; WIDEST]; 4 * JOINTS]);
        let terms = given.terms;
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut((layout.rows * T::BLOCK).max(1));
        for (k, rows) in blocks.enumerate() {
            let first = self.first + k * T::BLOCK;
            let count = T::BLOCK.min((self.first + self.count).saturating_sub(first));
            if count < T::BLOCK && k > 0 {
                // Columns past the last instance have no loads. (In the first block both are zero already.)
                scratch = [[0.0; WIDEST]; SCRATCH];
                targets = [[0.0; WIDEST]; 4 * JOINTS];
            }

            // Gathered well before they are read: a wide load of numbers that were stored one by one waits until all of them
            // have left the store buffer.
            let m = given.allocation.count();
            if let Some(thrust) = given.inputs.thrust {
                gather(thrust, m, 0, first, count, &mut scratch[..m]);
            }
            if let Some(target) = given.inputs.joint_target {
                gather(target, n * terms, 0, first, count, &mut targets[..n * terms]);
            }
            let mut wrench = [[0.0; WIDEST]; 6];
            if given.inputs.thrust.is_some() {
                for i in 0..m {
                    let [low, high] = given.allocation.limits(i);
                    for lane in 0..T::BLOCK {
                        scratch[i][lane] = scratch[i][lane].clamp(low, high);
                    }
                }
            }
            if layout.thrusters > 0 {
                match given.inputs.thrust {
                    Some(_) => set(rows, layout.command, &scratch[..layout.thrusters]),
                    None => clear(rows, layout.command, layout.thrusters),
                }
            } else if given.inputs.thrust.is_some() {
                let mut factor = [0.0; WIDEST];
                for group in (0..T::BLOCK).step_by(L::LANES) {
                    let columns = Rows::of_block(&mut *rows, group);
                    columns.factors::<L>(layout).thrust.store_double(&mut factor[group..]);
                }
                for i in 0..m {
                    for lane in 0..T::BLOCK {
                        scratch[i][lane] *= factor[lane];
                    }
                }
                for axis in 0..6 {
                    let mut sum = [0.0; WIDEST];
                    for i in 0..m {
                        let by = given.allocation.column(i)[axis];
                        for lane in 0..T::BLOCK {
                            sum[lane] += by * scratch[i][lane];
                        }
                    }
                    wrench[axis] = sum;
                }
            }
            let mut extra = [[0.0; WIDEST]; 6];
            for (values, width) in [(given.inputs.wrench, 6), (given.inputs.external, 6 * (n + 1))] {
                let Some(values) = values else { continue };
                gather(values, width, 0, first, count, &mut scratch[..6]);
                for axis in 0..6 {
                    for lane in 0..T::BLOCK {
                        extra[axis][lane] += scratch[axis][lane];
                    }
                }
            }
            for axis in 0..6 {
                for lane in 0..T::BLOCK {
                    wrench[axis][lane] += extra[axis][lane];
                }
            }
            set(rows, layout.wrench, &wrench);
            for (i, fin) in given.fins.iter().enumerate().take(layout.fins) {
                let [lower, upper] = fin.range();
                scratch[0] = [fin.deflection; WIDEST];
                if let Some(fins) = given.inputs.fin {
                    gather(fins, given.fins.len(), i, first, count, &mut scratch[..1]);
                    for lane in 0..T::BLOCK {
                        scratch[0][lane] = scratch[0][lane].clamp(lower, upper);
                    }
                }
                set(rows, layout.fin + i, &scratch[..1]);
            }

            match given.inputs.joint_torque {
                Some(torque) => {
                    gather(torque, n, 0, first, count, &mut scratch[..n]);
                    set(rows, layout.torque, &scratch[..n]);
                }
                None => clear(rows, layout.torque, n),
            }
            if given.inputs.joint_target.is_some() {
                for k in 0..n {
                    set(rows, layout.target + 4 * k, &targets[k * terms..][..terms]);
                    clear(rows, layout.target + 4 * k + terms, 4 - terms);
                }
            }
            if let Some(station) = given.inputs.pose_target {
                let scratch = &mut scratch[..STATION];
                gather(station, STATION, 0, first, count, scratch);
                // Inputs have the position first.
                set(rows, layout.station + 9, &scratch[..3]);
                set(rows, layout.station, &scratch[3..]);
            }
        }
    }
}

/// Gathers numbers of `count` instances from `first` on: of the `width` numbers of each, the numbers from `at` on.
#[inline(always)]
fn gather(values: &[f64], width: usize, at: usize, first: usize, count: usize, scratch: &mut [Row]) {
    let values = &values[(first * width + at).min(values.len())..];
    let columns = scratch.len();
    transpose(values, width, scratch.as_flattened_mut(), WIDEST, [count, columns]);
}

/// Sets successive rows of a block.
#[inline(always)]
fn set<T: Real>(rows: &mut [T], row: usize, scratch: &[Row]) {
    let rows = &mut rows[row * T::BLOCK..][..scratch.len() * T::BLOCK];
    for k in 0..scratch.len() {
        let to = &mut rows[k * T::BLOCK..][..T::BLOCK];
        for lane in 0..T::BLOCK {
            to[lane] = T::from_f64(scratch[k][lane]);
        }
    }
}

/// Sets `count` rows of a block to zero.
#[inline(always)]
fn clear<T: Real>(rows: &mut [T], row: usize, count: usize) {
    for x in &mut rows[row * T::BLOCK..][..count * T::BLOCK] {
        *x = T::from_f64(0.0);
    }
}
