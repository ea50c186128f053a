//! Derivatives of steps: values as in the steps, bit for bit, and slopes as by differences with 106 bits.

use crate::batch::inputs::{GENTLE, RandomInputs};
use crate::cases::{branched, sprung};
use crate::contact::wrestling;
use crate::double_double::DoubleDouble;
use crate::random_scene::{Options, Random, random_scene, random_state};
use nalgebra::Vector3;
use uvms_gym::batch::SimulatorOptions;
use uvms_gym::batch::insides::{
    Blocks, CheckedInputs, DerivativeColumn, Directions, Duals, Layout, Pairs, Step, StepSettings, Storage, step_pairs,
};
use uvms_gym::control::Allocation;
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Gains, Integrator, IntegratorKind};
use uvms_gym::lane::Isa;
use uvms_gym::system::{FACTORS, Factors, Flow, compile};

/// Numbers of 106 bits, one instance at a time.
struct Expanded;

impl Pairs for Expanded {
    fn step(step: &Step<f64>, rows: &mut [f64]) {
        step_pairs::<DoubleDouble>(step, rows);
    }
}

/// Number of directions; what one changes (rows and amounts); rows that are read.
struct Rows<F> {
    count: usize,
    change: F,
    read: Vec<usize>,
}

impl<F: Fn(usize, usize) -> Vec<(usize, f64)> + Sync> Directions for Rows<F> {
    fn count(&self) -> usize {
        self.count
    }
    fn seed(&self, i: usize, k: usize, column: &mut DerivativeColumn) {
        (self.change)(i, k).into_iter().for_each(|(row, amount)| column.add(row, amount));
    }
    fn read(&self, k: usize, column: &DerivativeColumn, out: &mut [f64]) {
        let numbers = self.read.iter().flat_map(|row| [column.value(*row), column.derivative(*row)]);
        out.iter_mut().skip(2 * k * self.read.len()).zip(numbers).for_each(|(out, x)| *out = x);
    }
}

/// Instances of a scene in random states under all inputs that it takes, and the settings of their steps.
pub fn with_case(
    scene: &Scene,
    (instances, substeps): (usize, usize),
    (name, tolerance, isa): (&str, f64, Isa),
    check: impl FnOnce(&mut Blocks<f64>, &StepSettings, &CheckedInputs, &Layout),
) {
    let integrator = Integrator::named(name, &Gains { tolerance, ..Gains::DEFAULT }).unwrap();
    let compiled = compile(scene);
    let allocation = Allocation::new(&scene.vehicle).unwrap();
    let options = SimulatorOptions { instances, ..SimulatorOptions::default() };
    let all = RandomInputs::of_count(instances, scene, GENTLE);
    let inputs = all.inputs(scene);
    let thrust = inputs.thrust.unwrap();
    let inputs = CheckedInputs::new(&inputs, scene, &allocation, None, &options).unwrap();
    let flow = Flow::from(Vector3::new(0.1, -0.2, 0.05));
    let start = (&random_state(0, scene), &flow);
    let mut blocks = Blocks::<f64>::new(&compiled, None, instances, &integrator, isa, start, None).unwrap();
    for i in 0..instances {
        let mut state = random_state(i as u64, scene);
        thrust.iter().skip(i * allocation.count()).zip(&mut state.thrust).for_each(|(x, to)| *to = 0.7 * x);
        blocks.set_state(i, &state);
        let factors = std::array::from_fn(|k| 0.8 + 0.05 * (k + i) as f64);
        blocks.set_factors(i, &Factors::from_array(factors));
    }
    let (active, limits, h) = (inputs.active_loads(), None, 0.01);
    let (before, total, threads) = (0, substeps, 1);
    let settings = StepSettings { integrator, h, substeps, before, total, active, threads, limits };
    let (adaptive, counts) =
        (integrator, [compiled.links.len(), compiled.system.thrusters.len(), scene.vehicle.fins.len()]);
    check(&mut blocks, &settings, &inputs, &Layout::new::<f64>(counts, &adaptive));
}

pub fn production() -> impl Iterator<Item = &'static str> {
    Integrator::NAMES.into_iter().filter(|entry| entry.kind == IntegratorKind::Production).map(|entry| entry.name)
}

/// The shipped scenes, a tree, one with contact and fixtures, one with all terms of thrusters, one with prescribed joints, one with
/// springs and detents, and random ones, with all terms of joints.
pub fn scenes() -> Vec<Scene> {
    let mut scenes: Vec<_> = Scene::shipped_names().into_iter().map(|name| Scene::shipped(name).unwrap()).collect();
    // The columns of a saturated servo's target are below the errors of the differences.
    let tool = scenes.iter_mut().find(|scene| scene.name == "bluerov2-heavy-alpha5-tool").unwrap();
    tool.joints_mut().for_each(|joint| joint.effort = None);
    let mut dynamic = Scene::shipped("petasus-pum").unwrap();
    for (k, thruster) in dynamic.vehicle.thrusters.iter_mut().enumerate() {
        thruster.lag = (k != 1).then_some(0.15);
        thruster.ambient_flow = (k != 2).then_some(0.4);
        thruster.dead_band = (k != 3).then_some(2.0);
    }
    let mut prescribed = Scene::shipped("petasus-pum").unwrap();
    let joints = prescribed.arm.iter_mut().flat_map(|arm| &mut arm.links).map(|link| &mut link.joint);
    joints.for_each(|joint| joint.prescribed = true);
    scenes.extend([dynamic, prescribed, branched(), wrestling(), sprung()]);
    scenes.extend((0..6).map(|seed| random_scene(seed, Options::default())));
    scenes
}

#[test]
fn values_of_duals_are_those_of_steps() {
    for scene in scenes() {
        for name in production() {
            for isa in Isa::available().filter(|isa| *isa != Isa::Plain) {
                with_case(&scene, (9, 3), (name, Gains::DEFAULT.tolerance, isa), |blocks, settings, inputs, _| {
                    let rows = blocks.column_len();
                    let change = |i, k| {
                        let mut random = Random::new((3 * i + k) as u64);
                        (0..rows).map(|row| (row, random.between(-1.0, 1.0))).collect()
                    };
                    let directions = Rows { count: 3, change, read: (0..rows).collect() };
                    let pairs = blocks.differentiate::<Duals>(settings, inputs, &directions, true, 6 * rows);
                    blocks.step(settings, Some(inputs));
                    for (i, pairs) in pairs.chunks_exact(6 * rows).enumerate() {
                        let stepped: Vec<_> = blocks.column(i).into_iter().map(f64::to_bits).collect();
                        for pairs in pairs.chunks_exact(2 * rows) {
                            let values: Vec<_> = pairs.iter().step_by(2).map(|x| x.to_bits()).collect();
                            assert_eq!(values, stepped, "{} {name} {isa:?} instance {i}", scene.name);
                        }
                    }
                });
            }
        }
    }
}

/// By every number of state, inputs and parameters. Central differences over 1e-10 err by 1e-20. No tolerance divides the steps:
/// the parts would change with the numbers.
#[test]
fn val_slopes_of_duals_are_differences_with_106_bits() {
    const CHANGE: f64 = 1e-10;
    let mut errors = Vec::new();
    for scene in scenes() {
        for name in production() {
            with_case(&scene, (1, 2), (name, 1e3, Isa::Avx2), |blocks, settings, inputs, layout| {
                let n = layout.joints;
                let states = [
                    (layout.rotation, 9),
                    (layout.position, 6),
                    (layout.twist, 6),
                    (layout.q, n),
                    (layout.qd, n),
                    (layout.thrust, layout.thrusters),
                    (layout.current, 3),
                ];
                let inputs_and_parameters = [
                    (layout.acceleration, 3),
                    (layout.wrench, 6),
                    (layout.torque, n),
                    (layout.target, 4 * n),
                    (layout.factors, FACTORS),
                    (layout.command, layout.thrusters),
                    (layout.loss, layout.thrusters),
                    (layout.fin, layout.fins),
                    (layout.links, 6 * n),
                    (layout.station, 12),
                ];
                let rows = |parts: &[(usize, usize)]| -> Vec<usize> {
                    parts.iter().flat_map(|(row, count)| *row..row + count).collect()
                };
                let read = rows(&states);
                let changed = [read.clone(), rows(&inputs_and_parameters)].concat();
                let width = 2 * read.len() * changed.len();
                let (count, from) = (changed.len(), &changed);
                let change = |_, k: usize| vec![(from[k], 1.0)];
                let directions = Rows { count, change, read: read.clone() };
                let duals = blocks.differentiate::<Duals>(settings, inputs, &directions, true, width);
                let change = |_, k: usize| vec![(from[k / 2], if k.is_multiple_of(2) { CHANGE } else { -CHANGE })];
                let directions = Rows { count: 2 * count, change, read: read.clone() };
                let ends = blocks.differentiate::<Expanded>(settings, inputs, &directions, true, 2 * width);
                let pairs = duals.chunks_exact(2 * read.len()).zip(ends.chunks_exact(4 * read.len()));
                for ((duals, ends), row) in pairs.zip(&changed) {
                    let (up, down) = ends.split_at(2 * read.len());
                    let difference = |k: usize| ((up[k] - down[k]) + (up[k + 1] - down[k + 1])) / (2.0 * CHANGE);
                    let expected: Vec<_> = (0..read.len()).map(|k| difference(2 * k)).collect();
                    let scale = expected.iter().fold(f64::MIN_POSITIVE, |most, x| most.max(x.abs()));
                    for (k, expected) in expected.iter().enumerate() {
                        let error = (duals[2 * k + 1] - expected).abs() / scale;
                        errors.push((error, format!("{} {name}: row {} by row {row}", scene.name, read[k])));
                    }
                }
            });
        }
    }
    // NaN last.
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let quantile = |share: f64| &errors[((errors.len() - 1) as f64 * share) as usize];
    let report = [0.5, 0.99, 0.9999, 1.0].map(quantile);
    println!("{} derivatives, errors of a column at 50, 99, 99.99 and 100 %: {report:?}", errors.len());
    assert!(report[3].0 < 2e-11 && report[1].0 < 1e-14, "{report:?}");
}
