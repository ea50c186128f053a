//! Forward dynamics against outside truth: golden data in `tests/golden/`, beside the scripts that made them.

use std::path::Path;

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Vector3, Vector6};
use serde::Deserialize;
use uvms_gym::balance::{Balance, Loads};
use uvms_gym::batch::{Inputs, Simulator, SimulatorOptions};
use uvms_gym::description::Scene;
use uvms_gym::system::{JOINTS, Joints, State};

/// Bound on errors, relative to the greatest component.
const TOLERANCE: f64 = 1e-10;

type ForwardDynamics = fn(&Scene, &Case) -> DVector<f64>;

/// Every way to compute `[V'; q'']`.
const FORWARD_DYNAMICS: [(&str, ForwardDynamics); 2] =
    [("closed form", closed_form), ("articulated bodies", articulated_bodies)];

fn closed_form(scene: &Scene, case: &Case) -> DVector<f64> {
    let balance = Balance::new(scene).unwrap();
    let external = case.external_with_wrench();
    let loads = Loads { thrust: &[], external: &external, joint_command: &case.joint_torque };
    balance.at(&case.state(), Vector3::from(case.current)).accelerations(&loads).unwrap()
}

fn articulated_bodies(scene: &Scene, case: &Case) -> DVector<f64> {
    let mut scene = scene.clone();
    scene.water.current = case.current.into();
    let mut simulator = Simulator::new(scene, SimulatorOptions::default()).unwrap();
    simulator.set_state(0, &case.state());
    let external: Vec<f64> = case.external_with_wrench().iter().flatten().copied().collect();
    let inputs = Inputs { joint_torque: Some(&case.joint_torque), external: Some(&external), ..Inputs::default() };
    simulator.forward_dynamics(&inputs).unwrap().into()
}

#[derive(Deserialize)]
struct Golden {
    scenes: Vec<SceneCases>,
}

#[derive(Deserialize)]
struct SceneCases {
    scene: String,
    cases: Vec<Case>,
}

/// A state, what is applied (vehicle wrench and external wrenches in body axes), and what comes of it.
#[derive(Deserialize)]
struct Case {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    twist: [f64; 6],
    q: Vec<f64>,
    qd: Vec<f64>,
    joint_torque: Vec<f64>,
    wrench: [f64; 6],
    #[serde(default)]
    external: Vec<[f64; 6]>,
    #[serde(default)]
    current: [f64; 3],
    expected: Expected,
}

#[derive(Deserialize)]
struct Expected {
    acceleration: Vec<f64>,
    #[serde(flatten)]
    details: Option<Details>,
}

/// In the coordinates that are free: without the vehicle's six where it is held.
#[derive(Deserialize)]
struct Details {
    mass_matrix: Vec<Vec<f64>>,
    bias: Vec<f64>,
    end_effector: [[f64; 4]; 4],
    jacobian: Vec<Vec<f64>>,
}

impl Case {
    fn state(&self) -> State {
        State {
            position: self.position.into(),
            rotation: Matrix3::from(self.rotation).transpose(),
            twist: self.twist.into(),
            q: padded(&self.q),
            qd: padded(&self.qd),
            time: 0.0,
        }
    }

    /// External wrench per moving body, that on the vehicle included.
    fn external_with_wrench(&self) -> Vec<Vector6<f64>> {
        let mut wrenches = vec![Vector6::zeros(); 1 + self.q.len()];
        for (sum, external) in wrenches.iter_mut().zip(&self.external) {
            *sum += Vector6::from(*external);
        }
        wrenches[0] += Vector6::from(self.wrench);
        wrenches
    }
}

fn padded(values: &[f64]) -> Joints {
    let mut joints = [0.0; JOINTS];
    joints[..values.len()].copy_from_slice(values);
    joints
}

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

fn golden(file: &str) -> Vec<(Scene, SceneCases)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden");
    let text = std::fs::read_to_string(folder.join(file)).unwrap();
    let golden: Golden = serde_json::from_str(&text).unwrap();
    let scene = |name: &str| Scene::from_file(folder.join(format!("scenes/{name}.toml"))).unwrap();
    golden.scenes.into_iter().map(|cases| (scene(&cases.scene), cases)).collect()
}

fn assert_close<'a>(what: &str, ours: impl IntoIterator<Item = &'a f64>, theirs: impl IntoIterator<Item = &'a f64>) {
    let (ours, theirs): (Vec<_>, Vec<_>) = (ours.into_iter().collect(), theirs.into_iter().collect());
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let error = ours.iter().zip(&theirs).fold(0.0_f64, |most, (a, b)| most.max((*a - *b).abs()));
    assert!(error <= TOLERANCE * scale, "{what}: off by {error:e} of {scale:e}\nours   {ours:?}\ntheirs {theirs:?}");
}

fn check_accelerations(file: &str) {
    for (scene, SceneCases { scene: name, cases }) in golden(file) {
        assert!(cases.len() >= 10, "{name}");
        for (i, case) in cases.iter().enumerate() {
            for (method, accelerations) in FORWARD_DYNAMICS {
                let what = format!("{name}, case {i}, {method}");
                assert_close(&what, &accelerations(&scene, case), &case.expected.acceleration);
            }
        }
    }
}

#[test]
fn val_dry_accelerations_equal_pinocchio() {
    check_accelerations("pinocchio_dry.json");
}

#[test]
fn val_wet_accelerations_equal_the_lagrangian_form() {
    check_accelerations("wet_reference.json");
}

#[test]
fn val_vehicle_alone_equals_fossen() {
    check_accelerations("fossen_vehicle.json");
}

#[test]
fn val_mass_matrix_bias_and_jacobian_equal_pinocchio() {
    let mut compared = 0;
    for (scene, SceneCases { scene: name, cases }) in golden("pinocchio_dry.json") {
        let balance = Balance::new(&scene).unwrap();
        for (i, case) in cases.iter().enumerate() {
            let Some(theirs) = &case.expected.details else { continue };
            let what = |quantity: &str| format!("{name}, case {i}, {quantity}");
            let form = balance.at(&case.state(), Vector3::zeros());
            let first = if scene.vehicle.fixed { 6 } else { 0 };
            let free = 6 + case.q.len() - first;
            let mass_matrix = form.mass_matrix().view((first, first), (free, free)).into_owned();
            assert_close(&what("mass matrix"), &mass_matrix, &matrix(&theirs.mass_matrix));
            // Pinocchio counts gravity among the bias.
            let bias = form.bias() - form.generalized_force(&Loads::default()).unwrap();
            assert_close(&what("bias"), &bias.rows(first, free).into_owned(), &theirs.bias);
            let end_effector = form.end_effector_pose();
            let mut pose = Matrix4::identity();
            pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&end_effector.rotation);
            pose.fixed_view_mut::<3, 1>(0, 3).copy_from(&end_effector.position);
            assert_close(&what("end effector"), &pose, &Matrix4::from(theirs.end_effector).transpose());
            let jacobian = form.jacobian().columns(first, free).into_owned();
            assert_close(&what("Jacobian"), &jacobian, &matrix(&theirs.jacobian));
            compared += 1;
        }
    }
    assert!(compared >= 20);
}
