//! Inputs of many instances at once: from numbers by instance to rows of blocks.

use super::columns::Columns;
use super::inputs::Applied;
use super::table::Table;
use crate::control::THRUSTERS;
use crate::lane::{Isa, Kernel, Lane, Real};

/// Greatest number of instances in a block.
const WIDEST: usize = 16;

/// A number of each instance of a block. In f64 whatever the precision of the rows, by operations that are rounded one by
/// one, in the order of [`Applied::fill`]: the same loads, bit for bit, whatever the instruction set.
type Row = [f64; WIDEST];

impl Table {
    /// Sets the loads of `count` instances, the first of which is number `first` among all.
    pub(super) fn apply<T: Real>(&self, isa: Isa, rows: &mut [T], given: &Applied, first: usize, count: usize) {
        T::dispatch(isa, &mut Fill { given, table: self, first, count, blocks: &mut *rows });
        if given.switches().on_links {
            for i in 0..count {
                self.set_links(rows, i, given.links(first + i));
            }
        }
    }
}

/// Fills blocks with all loads but those on links.
struct Fill<'a, T> {
    given: &'a Applied<'a>,
    table: &'a Table,
    first: usize,
    count: usize,
    blocks: &'a mut [T],
}

impl<T: Real> Kernel<T> for Fill<'_, T> {
    #[inline(always)]
    fn run<L: Lane<Real = T>>(&mut self) {
        const { assert!(T::BLOCK <= WIDEST) };
        let (given, layout) = (self.given, &self.table.layout);
        let n = layout.joints;
        let mut page = [[0.0; WIDEST]; THRUSTERS];
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut((layout.rows * T::BLOCK).max(1));
        for (k, rows) in blocks.enumerate() {
            let first = self.first + k * T::BLOCK;
            let count = T::BLOCK.min((self.first + self.count).saturating_sub(first));
            if count < T::BLOCK {
                // Columns past the last instance bear no loads.
                page = [[0.0; WIDEST]; THRUSTERS];
            }

            let mut wrench = [[0.0; WIDEST]; 6];
            if let Some(thrust) = given.inputs.thrust {
                let m = given.allocation.count();
                gather(thrust, m, 0, first, count, &mut page[..m]);
                let mut factor = [0.0; WIDEST];
                for group in (0..T::BLOCK).step_by(L::LANES) {
                    let columns = Columns { rows: &mut *rows, first: group };
                    columns.factors::<L>(layout).thrust.store_double(&mut factor[group..]);
                }
                for i in 0..m {
                    let ([low, high], column) = (given.allocation.limits(i), given.allocation.column(i));
                    for lane in 0..T::BLOCK {
                        page[i][lane] = factor[lane] * page[i][lane].clamp(low, high);
                    }
                    for axis in 0..6 {
                        for lane in 0..T::BLOCK {
                            wrench[axis][lane] += column[axis] * page[i][lane];
                        }
                    }
                }
            }
            let mut extra = [[0.0; WIDEST]; 6];
            for (values, width) in [(given.inputs.wrench, 6), (given.inputs.external, 6 * (n + 1))] {
                let Some(values) = values else { continue };
                gather(values, width, 0, first, count, &mut page[..6]);
                for axis in 0..6 {
                    for lane in 0..T::BLOCK {
                        extra[axis][lane] += page[axis][lane];
                    }
                }
            }
            for axis in 0..6 {
                for lane in 0..T::BLOCK {
                    wrench[axis][lane] += extra[axis][lane];
                }
            }
            set(rows, layout.wrench, &wrench);

            match given.inputs.joint_torque {
                Some(torque) => {
                    gather(torque, n, 0, first, count, &mut page[..n]);
                    set(rows, layout.torque, &page[..n]);
                }
                None => clear(rows, layout.torque, n),
            }
            if let Some(target) = given.inputs.joint_target {
                for k in 0..n {
                    let page = &mut page[..given.terms];
                    gather(target, n * given.terms, k * given.terms, first, count, page);
                    set(rows, layout.target + 4 * k, page);
                    clear(rows, layout.target + 4 * k + given.terms, 4 - given.terms);
                }
            }
            if let Some(station) = given.inputs.station {
                let page = &mut page[..12];
                gather(station, 12, 0, first, count, page);
                // Given by position and rotation.
                set(rows, layout.station + 9, &page[..3]);
                set(rows, layout.station, &page[3..]);
            }
        }
    }
}

/// Numbers of `count` instances, from `first` on, that have `width` numbers each: those from number `at` on.
#[inline(always)]
fn gather(values: &[f64], width: usize, at: usize, first: usize, count: usize, page: &mut [Row]) {
    let values = &values[first * width..(first + count) * width];
    for lane in 0..count.min(WIDEST) {
        let row = &values[lane * width + at..][..page.len()];
        for k in 0..row.len() {
            page[k][lane] = row[k];
        }
    }
}

/// Sets rows of a block, one after the other.
#[inline(always)]
fn set<T: Real>(rows: &mut [T], row: usize, page: &[Row]) {
    let rows = &mut rows[row * T::BLOCK..][..page.len() * T::BLOCK];
    for k in 0..page.len() {
        let to = &mut rows[k * T::BLOCK..][..T::BLOCK];
        for lane in 0..T::BLOCK {
            to[lane] = T::from_f64(page[k][lane]);
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
