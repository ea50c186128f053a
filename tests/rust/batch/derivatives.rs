//! Derivatives of steps: their values are those of the steps, bit for bit. (Their slopes: tests/python/test_gradients.py.)

use crate::random_scene::{Options, Random, random_scene, random_state};
use nalgebra::Vector3;
use uvms_gym::batch::stepping::blocks::{Blocks, Storage};
use uvms_gym::batch::stepping::chunk::StepSettings;
use uvms_gym::batch::stepping::derivative::{Directions, DualColumn};
use uvms_gym::batch::storage::inputs::CheckedInputs;
use uvms_gym::batch::{Inputs, SimulatorOptions};
use uvms_gym::control::Allocation;
use uvms_gym::description::Scene;
use uvms_gym::integrate::{Gains, Integrator, Kind};
use uvms_gym::lane::Isa;
use uvms_gym::system::{Flow, compile};

const INSTANCES: usize = 9;
const DIRECTIONS: usize = 3;

/// Random directions, of which the values are read.
struct Values {
    rows: usize,
}

impl Directions for Values {
    fn count(&self) -> usize {
        DIRECTIONS
    }
    fn payload(&self) -> bool {
        false
    }
    fn seed(&self, i: usize, k: usize, column: &mut DualColumn) {
        let mut random = Random::new((i * DIRECTIONS + k) as u64);
        (0..self.rows).for_each(|row| column.add_slope(row, random.between(-1.0, 1.0)));
    }
    fn read(&self, _: usize, k: usize, column: &DualColumn, out: &mut [f64]) {
        (0..self.rows).for_each(|row| out[k * self.rows + row] = column.value(row));
    }
}

fn compare(scene: &Scene, integrator: Integrator, isa: Isa) {
    let compiled = compile(scene);
    let (allocation, joints) = (Allocation::new(&scene.vehicle).unwrap(), compiled.links.len());
    let options = SimulatorOptions { instances: INSTANCES, ..SimulatorOptions::default() };
    let mut random = Random::new(3);
    let mut numbers =
        |count: usize, size: f64| (0..count * INSTANCES).map(|_| random.between(-size, size)).collect::<Vec<_>>();
    let (thrust, torque) = (numbers(allocation.count(), 60.0), numbers(joints, 1.0));
    let external = numbers(6 * (joints + 1), 1.0);
    let inputs =
        Inputs { thrust: Some(&thrust), joint_torque: Some(&torque), external: Some(&external), ..Inputs::default() };
    let inputs = CheckedInputs::new(&inputs, scene, &allocation, None, &options).unwrap();
    let flow = Flow::from(Vector3::new(0.1, -0.2, 0.05));
    let start = (&random_state(0, scene), &flow);
    let mut blocks = Blocks::<f64>::new(&compiled, None, INSTANCES, &integrator, isa, start, false).unwrap();
    (0..INSTANCES).for_each(|i| blocks.set_state(i, &random_state(i as u64, scene)));
    let (active, limits) = (inputs.active_loads(), None);
    let (h, substeps, halves) = (0.02, 3, false);
    let settings =
        StepSettings { integrator, h, substeps, before: 0, total: substeps, halves, active, threads: 1, limits };
    let rows = blocks.column_len();
    let values = blocks.differentiate(&settings, &inputs, &Values { rows }, DIRECTIONS * rows);
    blocks.step(&settings, Some(&inputs));
    for (i, values) in values.chunks_exact(DIRECTIONS * rows).enumerate() {
        let stepped: Vec<_> = blocks.column(i).into_iter().map(f64::to_bits).collect();
        for values in values.chunks_exact(rows) {
            let values: Vec<_> = values.iter().map(|x| x.to_bits()).collect();
            assert_eq!(values, stepped, "{} {integrator:?} {isa:?} instance {i}", scene.name);
        }
    }
}

#[test]
fn values_of_duals_are_those_of_steps() {
    let shipped = Scene::shipped_names().into_iter().map(|name| Scene::shipped(name).unwrap());
    let random = (0..6).map(|seed| random_scene(seed, Options::default()));
    for scene in shipped.chain(random) {
        for entry in Integrator::NAMES.into_iter().filter(|entry| entry.kind == Kind::Production) {
            let integrator = Integrator::named(entry.name, &Gains::DEFAULT).unwrap();
            Isa::available().filter(|isa| *isa != Isa::Plain).for_each(|isa| compare(&scene, integrator, isa));
        }
    }
}
