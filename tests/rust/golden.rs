//! Forward dynamics against outside truth: golden data in `tests/golden/`, beside the scripts that made them.

use std::path::{Path, PathBuf};

use nalgebra::{DMatrix, DVector, Matrix3, Matrix4, Vector3, Vector6};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use uvms_gym::batch::Inputs;
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::system::{JOINTS, Joints, State, rotation_vector};

use crate::cases::{run, simulator_at};

/// Bound on errors, relative to the maximum component.
const TOLERANCE: f64 = 1e-10;

type ForwardDynamics = fn(&Scene, &Case) -> DVector<f64>;

/// Every way to compute `[V'; q'']`.
const FORWARD_DYNAMICS: [(&str, ForwardDynamics); 2] =
    [("closed form", closed_form), ("articulated bodies", articulated_bodies)];

fn closed_form(scene: &Scene, case: &Case) -> DVector<f64> {
    let model = ClosedFormModel::new(scene).unwrap();
    let external = case.external_with_wrench();
    let loads = Loads { thrust: &[], external: &external, joint_command: &case.joint_torque, ..Loads::default() };
    model.at(&case.at.state(), Vector3::from(case.current)).accelerations(&loads).unwrap()
}

fn articulated_bodies(scene: &Scene, case: &Case) -> DVector<f64> {
    let mut scene = scene.clone();
    scene.water.current = case.current.into();
    let mut simulator = simulator_at(&scene, "mk4", 0.01, &case.at.state());
    let external: Vec<f64> = case.external_with_wrench().iter().flatten().copied().collect();
    let inputs = Inputs { joint_torque: Some(&case.joint_torque), external: Some(&external), ..Inputs::default() };
    simulator.forward_dynamics(&inputs).unwrap().into()
}

#[derive(Deserialize)]
struct Golden<T> {
    scenes: Vec<T>,
}

#[derive(Deserialize)]
struct SceneCases {
    scene: String,
    cases: Vec<Case>,
}

/// Where a system is and how it moves.
#[derive(Deserialize)]
struct Kinematics {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    twist: [f64; 6],
    q: Vec<f64>,
    qd: Vec<f64>,
}

/// A state, what is applied (vehicle wrench and external wrenches in body axes), and what comes of it.
#[derive(Deserialize)]
struct Case {
    #[serde(flatten)]
    at: Kinematics,
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

/// In the free coordinates: without the vehicle's six if it is fixed.
#[derive(Deserialize)]
struct Details {
    mass_matrix: Vec<Vec<f64>>,
    bias: Vec<f64>,
    end_effector: [[f64; 4]; 4],
    jacobian: Vec<Vec<f64>>,
}

/// A motion under constant joint torques from `start` to `end`.
#[derive(Deserialize)]
struct Motion {
    scene: String,
    time: f64,
    /// By how much their end changed when they last halved their step.
    step_effect: f64,
    joint_torque: Vec<f64>,
    start: Kinematics,
    end: Kinematics,
}

impl Kinematics {
    fn state(&self) -> State {
        State {
            position: self.position.into(),
            rotation: Matrix3::from(self.rotation).transpose(),
            twist: self.twist.into(),
            q: padded(&self.q),
            qd: padded(&self.qd),
            ..State::default()
        }
    }
}

impl Case {
    /// External wrench per moving body, that on the vehicle included.
    fn external_with_wrench(&self) -> Vec<Vector6<f64>> {
        let mut wrenches = vec![Vector6::zeros(); 1 + self.at.q.len()];
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

fn read<T: DeserializeOwned>(file: &str) -> Vec<T> {
    let text = std::fs::read_to_string(folder().join(file)).unwrap();
    serde_json::from_str::<Golden<T>>(&text).unwrap().scenes
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

pub fn scene(name: &str) -> Scene {
    Scene::from_file(folder().join(format!("scenes/{name}.toml"))).unwrap()
}

fn golden(file: &str) -> Vec<(Scene, SceneCases)> {
    read(file).into_iter().map(|cases: SceneCases| (scene(&cases.scene), cases)).collect()
}

/// Asserts that two lists agree; the error relative to the maximum entry.
fn assert_close<'a>(
    what: &str,
    ours: impl IntoIterator<Item = &'a f64>,
    theirs: impl IntoIterator<Item = &'a f64>,
) -> f64 {
    let (ours, theirs): (Vec<_>, Vec<_>) = (ours.into_iter().collect(), theirs.into_iter().collect());
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let scale = theirs.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let error = ours.iter().zip(&theirs).fold(0.0_f64, |most, (a, b)| most.max((*a - *b).abs()));
    assert!(error <= TOLERANCE * scale, "{what}: off by {error:e} of {scale:e}\nours   {ours:?}\ntheirs {theirs:?}");
    error / scale
}

/// By Pinocchio, by the Lagrangian form, by Fossen's equations of a vehicle and by MuJoCo.
#[test]
fn val_accelerations_equal_those_of_other_programs_and_forms() {
    for file in ["pinocchio_dry.json", "wet_reference.json", "fossen_vehicle.json", "mujoco_dry.json"] {
        for (scene, SceneCases { scene: name, cases }) in golden(file) {
            assert!(cases.len() >= 10, "{name}");
            let mut worst = 0.0_f64;
            for (i, case) in cases.iter().enumerate() {
                for (method, accelerations) in FORWARD_DYNAMICS {
                    let what = format!("{file}, {name}, case {i}, {method}");
                    worst = worst.max(assert_close(&what, &accelerations(&scene, case), &case.expected.acceleration));
                }
            }
            println!("{file}, {name}: {} states, off by at most {worst:.1e}", cases.len());
        }
    }
}

/// Where the joints of every second case of a parity are prescribed to have their accelerations, drives take their torques.
#[test]
fn val_prescribed_joints_equal_the_lagrangian_form() {
    let mut compared = 0;
    for file in ["wet_reference.json", "pinocchio_dry.json", "mujoco_dry.json"] {
        for (scene, SceneCases { scene: name, cases }) in golden(file) {
            for (i, case) in cases.iter().enumerate() {
                let (expected, n) = (&case.expected.acceleration, case.at.q.len());
                let mut scene = scene.clone();
                scene.water.current = case.current.into();
                scene.joints_mut().enumerate().for_each(|(k, joint)| joint.prescribed = (k + i) % 2 == 0 || i % 5 == 0);
                let free = case.joint_torque.iter().zip(scene.joints());
                let torque: Vec<f64> = free.map(|(t, joint)| if joint.prescribed { 0.0 } else { *t }).collect();
                if torque == case.joint_torque {
                    continue;
                }
                // Servos are off in these cases.
                scene.joints_mut().for_each(|joint| joint.servo = None);
                let target: Vec<f64> =
                    (0..n).flat_map(|k| [case.at.q[k], case.at.qd[k], expected[6 + k] / 2.0, 0.0]).collect();
                let external: Vec<f64> = case.external_with_wrench().iter().flatten().copied().collect();
                let inputs = Inputs {
                    joint_torque: Some(&torque),
                    joint_target: Some(&target),
                    external: Some(&external),
                    ..Inputs::default()
                };
                let mut simulator = simulator_at(&scene, "mk4", 0.01, &case.at.state());
                let what = |quantity: &str| format!("{name}, case {i}, {quantity}");
                assert_close(&what("articulated bodies"), &simulator.forward_dynamics(&inputs).unwrap(), expected);
                let loads = &simulator.applied_loads(&inputs).unwrap()[0];
                let closed = simulator.closed_form(0, |form| form.accelerations(&loads.loads())).unwrap();
                assert_close(&what("closed form"), &closed, expected);
                assert_close(&what("drives"), &loads.joint_command, &case.joint_torque);
                compared += 1;
            }
        }
    }
    assert!(compared > 50, "{compared}");
}

/// Bound on the difference of position, attitude (rotation vector), twist and joints at the end of a motion of 1 s.
const MOTION_TOLERANCE: f64 = 1e-11;

#[test]
fn val_dry_motions_end_where_mujocos_do() {
    let motions: Vec<Motion> = read("mujoco_motion.json");
    assert_eq!(motions.len(), 2);
    for motion in motions {
        assert!(motion.step_effect < MOTION_TOLERANCE / 10.0);
        let misses = [0.004, 0.002, 0.001].map(|dt| {
            let inputs = Inputs { joint_torque: Some(&motion.joint_torque), ..Inputs::default() };
            let steps = (motion.time / dt).round() as usize;
            miss(&run(&scene(&motion.scene), "mk4", dt, &motion.start.state(), &inputs, steps), &motion.end.state())
        });
        println!("{}: misses MuJoCo's end by {misses:?}", motion.scene);
        assert!(miss(&motion.start.state(), &motion.end.state()) > 0.1);
        assert!(misses[2] < MOTION_TOLERANCE && misses[1] < misses[0] / 14.0, "{}: {misses:?}", motion.scene);
    }
}

/// Maximum difference of two states.
fn miss(ours: &State, theirs: &State) -> f64 {
    let joints = ours.q.iter().chain(&ours.qd).zip(theirs.q.iter().chain(&theirs.qd)).map(|(a, b)| (a - b).abs());
    let turn = rotation_vector(&(theirs.rotation.transpose() * ours.rotation)).amax();
    let vehicle = [(ours.position - theirs.position).amax(), turn, (ours.twist - theirs.twist).amax()];
    let differences: Vec<f64> = joints.chain(vehicle).collect();
    assert!(differences.iter().all(|x| x.is_finite()));
    differences.into_iter().fold(0.0, f64::max)
}

#[test]
fn val_mass_matrix_bias_and_jacobian_equal_pinocchio() {
    let mut compared = 0;
    for (scene, SceneCases { scene: name, cases }) in golden("pinocchio_dry.json") {
        let model = ClosedFormModel::new(&scene).unwrap();
        for (i, case) in cases.iter().enumerate() {
            let Some(theirs) = &case.expected.details else { continue };
            let what = |quantity: &str| format!("{name}, case {i}, {quantity}");
            let form = model.at(&case.at.state(), Vector3::zeros());
            let first = if scene.vehicle.fixed { 6 } else { 0 };
            let free = 6 + case.at.q.len() - first;
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
