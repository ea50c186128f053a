//! Inputs to loads: from numbers by instance to rows of blocks.

use super::columns::Columns;
use super::inputs::CheckedInputs;
use super::table::Table;
use crate::control::THRUSTERS;
use crate::lane::{Isa, Kernel, Lane, Real, transpose};
use crate::system::JOINTS;

/// Greatest number of instances in a block.
const WIDEST: usize = 16;
/// Numbers of a target pose: position, and rotation by rows.
const STATION: usize = 12;
/// Most numbers of an instance in a buffer: its thrusts; torques and target poses have fewer.
const PAGE: usize = THRUSTERS;

/// One number of each instance of a block. In f64 in either precision of the rows, by operations that are rounded one by one
/// in the order of [`CheckedInputs::fill`]: loads have the same bits on every instruction set.
type Row = [f64; WIDEST];

impl Table {
    /// Sets the loads of `count` instances, the first of which is number `first` among all.
    pub fn apply<T: Real>(&self, isa: Isa, rows: &mut [T], inputs: &CheckedInputs, first: usize, count: usize) {
        T::dispatch(isa, &mut Fill { given: inputs, table: self, first, count, blocks: &mut *rows });
        if inputs.active_loads().link_wrenches {
            for i in 0..count {
                self.set_links(rows, i, inputs.links(first + i));
            }
        }
    }
}

/// Kernel that fills blocks with all loads except those on links.
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
        const { assert!(T::BLOCK <= WIDEST && JOINTS <= PAGE && STATION <= PAGE) };
        let (given, layout) = (self.given, &self.table.layout);
        let n = layout.joints;
        let (mut page, mut targets) = ([[0.0; WIDEST]; PAGE], [[0.0; WIDEST]; 4 * JOINTS]);
        let terms = given.terms;
        let blocks = std::mem::take(&mut self.blocks).chunks_exact_mut((layout.rows * T::BLOCK).max(1));
        for (k, rows) in blocks.enumerate() {
            let first = self.first + k * T::BLOCK;
            let count = T::BLOCK.min((self.first + self.count).saturating_sub(first));
            if count < T::BLOCK {
                // Columns past the last instance have no loads.
                page = [[0.0; WIDEST]; PAGE];
                targets = [[0.0; WIDEST]; 4 * JOINTS];
            }

            // Gathered well before they are read: a wide load of numbers that were stored one by one waits until all of them
            // have left the store buffer.
            let m = given.allocation.count();
            if let Some(thrust) = given.inputs.thrust {
                gather(thrust, m, 0, first, count, &mut page[..m]);
            }
            if let Some(target) = given.inputs.joint_target {
                gather(target, n * terms, 0, first, count, &mut targets[..n * terms]);
            }
            let mut wrench = [[0.0; WIDEST]; 6];
            if given.inputs.thrust.is_some() {
                for i in 0..m {
                    let [low, high] = given.allocation.limits(i);
                    for lane in 0..T::BLOCK {
                        page[i][lane] = page[i][lane].clamp(low, high);
                    }
                }
            }
            if layout.thrusters > 0 {
                match given.inputs.thrust {
                    Some(_) => set(rows, layout.command, &page[..layout.thrusters]),
                    None => clear(rows, layout.command, layout.thrusters),
                }
            } else if given.inputs.thrust.is_some() {
                let mut factor = [0.0; WIDEST];
                for group in (0..T::BLOCK).step_by(L::LANES) {
                    let columns = Columns { rows: &mut *rows, first: group };
                    columns.factors::<L>(layout).thrust.store_double(&mut factor[group..]);
                }
                for i in 0..m {
                    for lane in 0..T::BLOCK {
                        page[i][lane] *= factor[lane];
                    }
                }
                for axis in 0..6 {
                    let mut sum = [0.0; WIDEST];
                    for i in 0..m {
                        let by = given.allocation.column(i)[axis];
                        for lane in 0..T::BLOCK {
                            sum[lane] += by * page[i][lane];
                        }
                    }
                    wrench[axis] = sum;
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
            for (i, fin) in given.fins.iter().enumerate().take(layout.fins) {
                let [lower, upper] = fin.range();
                page[0] = [fin.deflection; WIDEST];
                if let Some(fins) = given.inputs.fin {
                    gather(fins, given.fins.len(), i, first, count, &mut page[..1]);
                    for lane in 0..T::BLOCK {
                        page[0][lane] = page[0][lane].clamp(lower, upper);
                    }
                }
                set(rows, layout.fin + i, &page[..1]);
            }

            match given.inputs.joint_torque {
                Some(torque) => {
                    gather(torque, n, 0, first, count, &mut page[..n]);
                    set(rows, layout.torque, &page[..n]);
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
                let page = &mut page[..STATION];
                gather(station, STATION, 0, first, count, page);
                // Inputs have the position first.
                set(rows, layout.station + 9, &page[..3]);
                set(rows, layout.station, &page[3..]);
            }
        }
    }
}

/// Gathers numbers of `count` instances from `first` on, out of `width` numbers each: those from number `at` on.
#[inline(always)]
fn gather(values: &[f64], width: usize, at: usize, first: usize, count: usize, page: &mut [Row]) {
    let values = &values[(first * width + at).min(values.len())..];
    let columns = page.len();
    transpose(values, width, page.as_flattened_mut(), WIDEST, [count, columns]);
}

/// Sets successive rows of a block.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::options::{Precision, SimulatorOptions};
    use crate::batch::stepping::blocks::{Blocks, Storage};
    use crate::batch::storage::inputs::Inputs;
    use crate::batch::storage::instance_loads::InstanceLoads;
    use crate::control::Allocation;
    use crate::description::Scene;
    use crate::integrate::{Gains, Integrator};
    use crate::lie::Vector6;
    use crate::system::{Factors, Flow, State, compile};

    /// Distinct numbers of both signs and sizes up to `size`.
    fn numbers(count: usize, size: f64) -> Vec<f64> {
        (0..count).map(|k| size * (1.7 * k as f64 + 0.3).sin()).collect()
    }

    /// Inputs given, one bit each; and the terms of the targets.
    const GIVEN: [(usize, usize); 9] = [(0, 1), (1, 1), (2, 1), (4, 1), (8, 1), (8, 4), (16, 1), (32, 1), (63, 3)];

    fn loads_are_those_of_single_instances<T: Real>(precision: Precision) {
        let scene = Scene::shipped("petasus-pum").unwrap();
        let compiled = compile(&scene);
        let allocation = Allocation::new(&scene.vehicle).unwrap();
        let (m, n) = (allocation.count(), compiled.links.len());
        let integrator = Integrator::named("mk4", &Gains::DEFAULT).unwrap();
        let mut saturated = 0;
        for (isa, instances) in Isa::available().flat_map(|isa| [1, 5, 8, 16, 17, 35].map(|count| (isa, count))) {
            let options = SimulatorOptions { instances, precision, ..SimulatorOptions::default() };
            let (state, flow) = (State::default(), Flow::from(scene.water.current));
            let mut blocks = Blocks::<T>::new(&compiled, instances, &integrator, isa, &state, &flow).unwrap();
            for i in 0..instances {
                blocks.set_factors(i, &Factors { thrust: 0.9 + 0.01 * i as f64, ..Factors::ONE });
            }
            let stations: Vec<f64> = (0..instances)
                .flat_map(|i| [numbers(3, i as f64), vec![0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]].concat())
                .collect();
            let [thrust, wrench, torque] =
                [(m, 2.0 * allocation.range(0)), (6, 20.0), (n, 3.0)].map(|(w, size)| numbers(instances * w, size));
            let external = numbers(instances * 6 * (n + 1), 2.0);
            for (given, terms) in GIVEN {
                let target = numbers(instances * n * terms, 0.5);
                let pick = |bit: usize| given >> bit & 1 == 1;
                let inputs = Inputs {
                    thrust: pick(0).then_some(&thrust[..]),
                    wrench: pick(1).then_some(&wrench[..]),
                    joint_torque: pick(2).then_some(&torque[..]),
                    joint_target: pick(3).then_some(&target[..]),
                    external: pick(4).then_some(&external[..]),
                    pose_target: pick(5).then_some(&stations[..]),
                    fin: None,
                };
                let applied = CheckedInputs::new(&inputs, &scene, &allocation, &options).unwrap();
                let active = applied.active_loads();
                // Earlier numbers must not show where a load is active.
                let (layout, _, rows) = blocks.parts();
                let (layout, width) = (layout.clone(), layout.rows * T::BLOCK);
                for rows in rows.chunks_exact_mut(width) {
                    rows[layout.wrench * T::BLOCK..layout.factors * T::BLOCK].fill(T::from_f64(7.0));
                }
                let table = Table { layout: layout.clone(), links: compiled.links.clone() };
                let (_, _, rows) = blocks.parts();
                table.apply(isa, rows, &applied, 0, instances);
                let rows = &*rows;

                for i in 0..instances {
                    let mut loads = InstanceLoads::default();
                    applied.fill(i, table.factors(rows, i).thrust, &mut loads);
                    let same = |row: usize, values: &[f64], what: &str| {
                        for (k, x) in values.iter().enumerate() {
                            let (got, expected) = (table.get(rows, i, row + k), T::from_f64(*x).to_f64());
                            let place = format!("{isa:?}, {instances} instances, given {given:b}: {what} {k} of {i}");
                            assert_eq!(got.to_bits(), expected.to_bits(), "{place}: {got}, expected {expected}");
                        }
                    };
                    same(layout.wrench, &loads.wrench, "wrench");
                    same(layout.torque, &loads.torque[..n], "torque");
                    if active.target_terms > 0 {
                        same(layout.target, loads.target[..n].as_flattened(), "target");
                    }
                    if active.link_wrenches {
                        for k in 0..n {
                            let wrench = table.links[k].co_adjoint_apply_inverse(Vector6::from_array(loads.links[k]));
                            same(layout.links + 6 * k, &wrench.to_array(), "link");
                        }
                    }
                    if active.station {
                        same(layout.station, loads.station.0.transpose().as_slice(), "rotation");
                        same(layout.station + 9, loads.station.1.as_slice(), "position");
                    }
                    let factor = table.factors(rows, i).thrust;
                    let limits = (0..m).map(|k| allocation.limits(k)[1] * factor);
                    saturated += applied.thrust(i, factor).iter().zip(limits).filter(|(x, most)| *x == most).count();
                }
            }
        }
        assert!(saturated > 0, "some thrusts saturate");
    }

    #[test]
    fn loads_in_double_precision_are_those_of_single_instances() {
        loads_are_those_of_single_instances::<f64>(Precision::Double);
    }

    #[test]
    fn loads_in_single_precision_are_those_of_single_instances() {
        loads_are_those_of_single_instances::<f32>(Precision::Single);
    }
}
