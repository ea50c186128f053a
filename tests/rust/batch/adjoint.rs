//! Adjoint of steps: gradients are the cotangent times the Jacobian by dual numbers.

use crate::batch::derivatives::{production, scenes, with_case};
use crate::batch::inputs::{GENTLE, RandomInputs, Sizes};
use crate::random_scene::{Random, random_state};
use nalgebra::Vector3;
use uvms_gym::batch::insides::{Cotangents, DerivativeColumn, Storage};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::integrate::Gains;
use uvms_gym::lane::Isa;
use uvms_gym::system::{FACTORS, Factors, Flow};

/// Simulator of a scene in random states, and its inputs.
struct Case {
    simulator: Simulator,
    inputs: RandomInputs,
}

impl Case {
    fn new(scene: &Scene, instances: usize, integrator: &str, threads: usize) -> Self {
        let options = SimulatorOptions { instances, threads: Some(threads), ..Default::default() };
        Self::with_options(scene, SimulatorOptions { integrator: integrator.into(), ..options })
    }

    fn with_options(scene: &Scene, options: SimulatorOptions) -> Self {
        let instances = options.instances;
        let mut simulator = Simulator::new(scene.clone(), options).unwrap();
        let (joints, mut factors) = (scene.coordinates().count(), Vec::new());
        let flow = Flow { velocity: Vector3::new(0.1, -0.2, 0.05), acceleration: Vector3::new(0.02, 0.01, -0.03) };
        for i in 0..instances {
            let mut state = random_state(i as u64, scene);
            state.thrust.iter_mut().take(simulator.state_size() - 12 - 2 * joints).for_each(|x| *x = 1.5);
            simulator.set_state(i, &state);
            simulator.set_flow(i, flow);
            factors.push(Factors::from_array(std::array::from_fn(|k| 0.8 + 0.05 * (k + i % 3) as f64)));
        }
        simulator.set_factors(&factors).unwrap();
        let inputs = RandomInputs::of_count(instances, scene, Sizes { thrust: 1.2, torque: 3.0, ..GENTLE });
        Self { simulator, inputs }
    }

    /// Gradients of all instances, and the cotangents times their Jacobians with the sums of magnitudes.
    fn gradients(&mut self, substeps: usize, jacobians: bool) -> (Vec<f64>, Vec<(f64, f64)>) {
        let inputs = self.inputs.inputs(self.simulator.scene());
        let (size, parameters): (_, Vec<usize>) = (self.simulator.state_size(), (0..FACTORS).collect());
        let row = |i: u64| {
            let mut random = Random::new(i);
            (0..size).map(move |_| random.between(-1.0, 1.0))
        };
        let of: Vec<f64> = (0..self.simulator.instances() as u64).flat_map(row).collect();
        let gradients = self.simulator.step_vjp(&inputs, substeps, &parameters, &of).unwrap();
        let mut expected = Vec::new();
        if jacobians {
            let all = self.simulator.step_jacobians(&inputs, substeps, &parameters).unwrap();
            let width: usize = all.arguments.iter().map(|(_, width)| width).sum();
            for (of, jacobian) in of.chunks_exact(size).zip(all.numbers.chunks_exact(size * width)) {
                for k in 0..width {
                    let terms = (0..size).map(|row| of[row] * jacobian[row * width + k]);
                    expected.push(terms.fold((0.0, 0.0), |(sum, size), x| (sum + x, size + f64::abs(x))));
                }
            }
        }
        (gradients, expected)
    }

    /// Asserts that the gradients are the cotangents times the Jacobians; returns them.
    fn assert_products(&mut self, substeps: usize) -> Vec<f64> {
        let (gradients, expected) = self.gradients(substeps, true);
        for (k, (got, (sum, size))) in gradients.iter().zip(&expected).enumerate() {
            let error = (got - sum).abs() / size.max(1e-6);
            let (scene, name) = (&self.simulator.scene().name, &self.simulator.options().integrator);
            assert!(error < 1e-10 || got.is_nan() && sum.is_nan(), "{scene} {name} entry {k}: {got} {sum} {size}",);
        }
        gradients
    }
}

fn bits_of(numbers: &[f64]) -> Vec<u64> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

#[test]
fn gradients_are_cotangents_times_jacobians() {
    for scene in scenes() {
        for name in production() {
            Case::new(&scene, 3, name, 1).assert_products(3);
        }
    }
}

/// Instances that divide their steps differently, in the same lanes: in free motion; spinning; in drag of a rate of 500 1/s and more;
/// so fast that the state becomes NaN; and at rest.
fn case_of_divided_steps(name: &str, dt: f64, instances: usize, threads: usize) -> Case {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    for thruster in &mut scene.vehicle.thrusters {
        (thruster.lag, thruster.ambient_flow) = (Some(0.15), Some(0.3));
    }
    let options = SimulatorOptions { instances, dt, tolerance: 1e-9, threads: Some(threads), ..Default::default() };
    let mut case = Case::with_options(&scene, SimulatorOptions { integrator: name.into(), ..options });
    let twists = [[0.3, -0.2, 0.1, 20.0, -60.0, 90.0], [60.0, -40.0, 50.0, 2.0, 1.0, 3.0], [1e170; 6], [0.0; 6]];
    for i in 0..instances {
        let mut state = case.simulator.state(i);
        if let Some(twist) = (i % 5).checked_sub(1) {
            state.twist = twists[twist].into();
        }
        case.simulator.set_state(i, &state);
    }
    case
}

#[test]
fn gradients_of_divided_steps_are_cotangents_times_jacobians() {
    for name in ["mk4", "mk54", "ros2"] {
        for dt in [0.01, 0.05] {
            let mut case = case_of_divided_steps(name, dt, 5, 1);
            for substeps in [1, 3] {
                let gradients = case.assert_products(substeps);
                for (i, gradient) in gradients.chunks_exact(gradients.len() / 5).enumerate() {
                    // Explicit steps of a fixed size become NaN in much drag, too.
                    let lost = gradient[6].is_nan();
                    assert!(lost == (i == 3) || lost && name == "mk4", "{name} {dt} instance {i}");
                }
                // Adaptive methods go on with the sub-interval planned last.
                case.simulator.step(&Inputs::default(), 1).unwrap();
            }
            let [one, five, most] = [(1, 1), (5, 1), (17, 2)].map(|(instances, threads)| {
                bits_of(&case_of_divided_steps(name, dt, instances, threads).gradients(2, false).0)
            });
            assert_eq!(one, five[..one.len()], "{name} {dt}");
            assert_eq!(five, most[..five.len()], "{name} {dt}");
        }
    }
}

#[test]
fn gradients_have_the_same_bits_for_any_number_of_instances_and_threads() {
    for scene in scenes() {
        for name in ["mk4", "ros2", "mk54"] {
            let [one, more, most] = [(1, 1), (3, 1), (65, 2)].map(|(instances, threads)| {
                bits_of(&Case::new(&scene, instances, name, threads).gradients(2, false).0)
            });
            assert_eq!(one, more[..one.len()], "{} {name}", scene.name);
            assert_eq!(more, most[..more.len()], "{} {name}", scene.name);
        }
    }
}

/// Cotangents by random numbers; all rows are read.
struct RandomCotangents;

impl Cotangents for RandomCotangents {
    fn seed(&self, i: usize, column: &mut DerivativeColumn) {
        let (table, mut random) = (column.start.table, Random::new(i as u64));
        let layout = &table.layout;
        let parts = [
            (layout.position, 3),
            (layout.rotation, 3),
            (layout.q, layout.joints),
            (layout.twist, 6),
            (layout.qd, layout.joints),
            (layout.thrust, layout.thrusters),
        ];
        for row in parts.into_iter().flat_map(|(row, count)| row..row + count) {
            column.set(row, random.between(-1.0, 1.0));
        }
    }
    fn read(&self, _: usize, column: &DerivativeColumn, out: &mut [f64]) {
        out.iter_mut().enumerate().for_each(|(row, out)| *out = column.derivative(row));
    }
}

/// The rows after the steps that the adjoint has recorded.
struct Ends;

impl Cotangents for Ends {
    fn seed(&self, _: usize, _: &mut DerivativeColumn) {}
    fn read(&self, _: usize, column: &DerivativeColumn, out: &mut [f64]) {
        out.iter_mut().enumerate().for_each(|(row, out)| *out = column.value(row));
    }
}

#[test]
fn recorded_steps_are_those_of_the_simulator() {
    for scene in scenes() {
        for name in production() {
            with_case(&scene, (9, 3), (name, 1e-9, Isa::Avx2), |blocks, settings, inputs, _| {
                let recorded = blocks.pull_back(settings, inputs, &Ends, [true; 2], blocks.column_len()).unwrap();
                blocks.step(settings, Some(inputs));
                let stepped: Vec<_> = (0..9).flat_map(|i| blocks.column(i)).collect();
                assert_eq!(bits_of(&recorded), bits_of(&stepped), "{} {name}", scene.name);
            });
        }
    }
}

#[test]
fn gradients_have_the_same_bits_in_all_lanes() {
    for scene in scenes() {
        for name in production() {
            let [fma, others @ ..] = [Isa::Fma, Isa::Avx2, Isa::Avx512].map(|isa| {
                let mut bits = Vec::new();
                with_case(&scene, (9, 2), (name, Gains::DEFAULT.tolerance, isa), |blocks, settings, inputs, _| {
                    let (of, width) = (&RandomCotangents, blocks.column_len());
                    let gradients = blocks.pull_back(settings, inputs, of, [true; 2], width).unwrap();
                    bits = bits_of(&gradients);
                });
                bits
            });
            for other in others {
                assert_eq!(fma, other, "{} {name}", scene.name);
            }
        }
    }
}
