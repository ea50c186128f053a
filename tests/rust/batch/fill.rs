//! Inputs to loads: from numbers by instance to rows of blocks.

use uvms_gym::batch::insides::{Blocks, CheckedInputs, Storage, Table};
use uvms_gym::batch::{Inputs, Precision, SimulatorOptions};
use uvms_gym::control::Allocation;
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Gains, Integrator};
use uvms_gym::lane::{Isa, Real};
use uvms_gym::lie::Vector6;
use uvms_gym::system::{Factors, Flow, State, compile};

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
        let mut blocks = Blocks::<T>::new(&compiled, None, instances, &integrator, isa, (&state, &flow), None).unwrap();
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
            let applied = CheckedInputs::new(&inputs, &scene, &allocation, None, &options).unwrap();
            let active = applied.active_loads();
            // Earlier numbers must not show where a load is active.
            let (layout, _, rows) = blocks.parts();
            let (layout, width) = (layout.clone(), layout.rows * T::BLOCK);
            for rows in rows.chunks_exact_mut(width) {
                rows[layout.wrench * T::BLOCK..layout.factors * T::BLOCK].fill(T::from_f64(7.0));
            }
            let table = Table { layout: layout.clone(), links: vec![compiled.links.clone()] };
            let (_, _, rows) = blocks.parts();
            table.apply(isa, rows, &applied, 0, instances);
            let rows = &*rows;

            for i in 0..instances {
                let loads = applied.loads(i, table.factors(rows, i).thrust);
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
                        let wrench = table.links[0][k].co_adjoint_apply_inverse(Vector6::from_array(loads.links[k]));
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
