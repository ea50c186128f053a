//! Motions of trees with a known outcome: a gripper that closes, two arms that mirror each other.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use uvms_gym::batch::Inputs;
use uvms_gym::description::{Body, Frame, InertiaPoint, JointKind, Link, Scene};
use uvms_gym::system::State;

use crate::cases::simulator_at;
use crate::random_scene::{Options, random_scene};

/// A vehicle with a wrist and two jaws of unlike mass on it that slide towards each other along x at wrist angle 0, at rest,
/// without drag and gravity.
fn gripper(density: f64) -> Scene {
    let body = |mass: f64, added: f64| {
        let added_mass = if density > 0.0 { [added, 2.0 * added, 3.0 * added, 0.0, 0.1, 0.1] } else { [0.0; 6] };
        let inertia = [0.1 * mass, 0.2 * mass, 0.2 * mass];
        format!("{{ mass = {mass:?}, inertia = {inertia:?}, added_mass = {added_mass:?} }}")
    };
    let jaw = |name: &str, at: f64, direction: f64, mass: f64, added: f64| {
        let body = body(mass, added);
        format!(
            "[[arm.links]]\nname = '{name}'\nparent = 'wrist'\nbody = {body}\n[arm.links.joint]\nkind = 'prismatic'\n\
             frame.position = [{at:?}, 0.0, 0.0]\naxis = [{direction:?}, 0.0, 0.0]\nservo = {{ kp = 80.0, kd = 25.0 }}\n"
        )
    };
    let text = format!(
        "name = 'gripper'\nwater = {{ density = {density:?}, gravity = [0.0, 0.0, 0.0] }}\n\
         [vehicle]\nname = 'vehicle'\nbody = {}\n[arm]\nname = 'arm'\nmount.frame.position = [0.4, 0.0, 0.0]\n\
         [[arm.links]]\nname = 'wrist'\nbody = {}\njoint = {{ kind = 'revolute', axis = [0.0, 0.0, 1.0] }}\n{}{}",
        body(30.0, 20.0),
        body(2.0, 1.0),
        jaw("near", 0.1, 1.0, 0.6, 0.3),
        jaw("far", 0.4, -1.0, 1.7, 0.8),
    );
    Scene::from_toml_str(&text, "gripper").unwrap()
}

/// The gripper closes from rest in 2 s: the state after every tenth of a second.
fn closing(scene: &Scene, wrist: f64) -> Vec<(State, Vector6<f64>)> {
    let mut start = State::default();
    start.q[0] = wrist;
    let mut simulator = simulator_at(scene, "mk4", 0.0025, &start);
    let target = [wrist, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.12, 0.0, 0.0, 0.0];
    let inputs = Inputs { joint_target: Some(&target), ..Inputs::default() };
    let motion = (0..20).map(|_| {
        simulator.step(&inputs, 40).unwrap();
        (simulator.state(0), simulator.closed_form(0, |form| form.momentum()).total())
    });
    motion.collect()
}

#[test]
fn a_gripper_that_closes_on_nothing_moves_the_vehicle_as_momentum_says() {
    for (density, [vehicle, wrist, near, far]) in [(0.0, [30.0, 2.0, 0.6, 1.7]), (1000.0, [50.0, 3.0, 0.9, 2.5])] {
        let motion = closing(&gripper(density), 0.0);
        for (state, _) in &motion {
            let expected = -(near * state.q[1] - far * state.q[2]) / (vehicle + wrist + near + far);
            assert!((state.position.x - expected).abs() < 1e-15, "{} and {expected}", state.position.x);
            assert!(state.position.yz().norm() < 1e-15 && (state.rotation - Matrix3::identity()).norm() < 1e-15);
        }
        let (end, _) = motion.last().unwrap();
        assert!((end.q[1] - 0.1).abs() < 1e-2 && (end.q[2] - 0.12).abs() < 1e-2 && end.position.x > 3e-3);
    }
}

/// With the wrist turned, the hull yaws, and so does the wrist.
#[test]
fn a_gripper_that_closes_aside_gives_no_momentum() {
    for density in [0.0, 1000.0] {
        let motion = closing(&gripper(density), 1.2);
        for (_, momentum) in &motion {
            assert!(momentum.norm() < 1e-10, "{momentum}");
        }
        let (end, _) = motion.last().unwrap();
        assert!(end.position.y.abs() > 1e-3 && end.rotation[(1, 0)].abs() > 1e-3 && (end.q[0] - 1.2).abs() > 1e-3);
    }
}

/// Reflection in the x-z plane of vectors, of 6-vectors, and of what they meet.
fn side() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0))
}

fn sides() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(1.0, -1.0, 1.0, -1.0, 1.0, -1.0))
}

fn mirrored_frame(frame: &Frame) -> Frame {
    Frame { position: side() * frame.position, rpy: -(side() * frame.rpy) }
}

fn mirrored_body(body: &Body) -> Body {
    let mut image = body.clone();
    image.center_of_mass = side() * body.center_of_mass;
    image.center_of_buoyancy = side() * body.center_of_buoyancy;
    image.inertia = side() * body.inertia * side();
    image.hydrodynamic_frame = mirrored_frame(&body.hydrodynamic_frame);
    for matrix in [&mut image.added_mass, &mut image.damping.linear, &mut image.damping.quadratic] {
        *matrix = sides() * *matrix * sides();
    }
    image
}

/// Image of a link: its joint turns the other way about the mirrored axis, and slides along it.
fn mirrored(link: &Link) -> Link {
    let mut image = link.clone();
    let name = |name: &str| format!("{name}-image");
    image.name = name(&link.name);
    image.parent = link.parent.as_ref().map(|parent| if parent == "vehicle" { parent.clone() } else { name(parent) });
    image.joint.frame = mirrored_frame(&link.joint.frame);
    image.joint.axis = side() * link.joint.axis;
    if link.joint.kind == JointKind::Revolute {
        image.joint.axis = -image.joint.axis;
    }
    image.body = link.body.as_ref().map(mirrored_body);
    image
}

/// A vehicle that is its own image, with four random links and their images, which branch likewise.
fn two_arms(seed: u64) -> Scene {
    let options = Options {
        links: Some(4),
        fixed: Some(false),
        branching: Some(false),
        joint_loading: Some(false),
        payload: Some(false),
        current: Some(false),
        joint_forces: Some(true),
        ..Options::default()
    };
    let mut scene = random_scene(seed, options);
    scene.water.gravity = Vector3::new(0.3, 0.0, -9.7);
    scene.vehicle.forward_damping = None;
    let own = scene.vehicle.body.clone();
    let (body, image) = (&mut scene.vehicle.body, mirrored_body(&own));
    body.inertia_at = InertiaPoint::Com;
    body.inertia = (own.inertia_about_com() + side() * own.inertia_about_com() * side()) / 2.0;
    body.center_of_mass.y = 0.0;
    body.center_of_buoyancy.y = 0.0;
    body.hydrodynamic_frame = Frame::default();
    body.added_mass = (own.added_mass + image.added_mass) / 2.0;
    body.damping.linear = (own.damping.linear + image.damping.linear) / 2.0;
    body.damping.quadratic = (own.damping.quadratic + image.damping.quadratic) / 2.0;
    let arm = scene.arm.as_mut().unwrap();
    arm.base = None;
    // The third link branches off the first.
    for (link, parent) in arm.links.iter_mut().zip(["vehicle", "link-0", "link-0", "link-2"]) {
        link.parent = Some(parent.to_owned());
    }
    let images: Vec<_> = arm.links.iter().map(mirrored).collect();
    arm.links.extend(images);
    scene.check().unwrap();
    scene
}

/// Maximum of sway, roll and yaw, of positions and speeds, over 2 s in which both arms swing; and maximum joint rate.
fn asymmetry(scene: &Scene) -> (f64, f64) {
    let mut start = State { twist: Vector6::new(0.3, 0.0, -0.2, 0.0, 0.4, 0.0), q: scene.home(), ..State::default() };
    let joints = scene.joints().count();
    for k in 0..joints {
        start.qd[k] = 0.4 - 0.3 * (k % 4) as f64;
    }
    let mut simulator = simulator_at(scene, "mk4", 0.005, &start);
    let target: Vec<f64> = (0..joints).flat_map(|k| [start.q[k], 0.2 * (k % 4) as f64, 0.1, 0.0]).collect();
    let (mut maximum, mut rate) = (0.0_f64, 0.0_f64);
    for _ in 0..40 {
        simulator.step(&Inputs { joint_target: Some(&target), ..Inputs::default() }, 10).unwrap();
        let State { position, rotation, twist, qd, .. } = simulator.state(0);
        let aside = [position.y, rotation[(1, 0)], rotation[(1, 2)], twist[1], twist[3], twist[5]];
        maximum = aside.into_iter().fold(maximum, |maximum, x| maximum.max(x.abs()));
        rate = qd.iter().fold(rate, |rate, x| rate.max(x.abs()));
    }
    (maximum, rate)
}

#[test]
fn arms_that_mirror_each_other_leave_the_hull_in_its_plane() {
    for seed in 0..20 {
        let mut scene = two_arms(seed);
        let (aside, rate) = asymmetry(&scene);
        println!("seed {seed}: {aside:.1e}, joint rates up to {rate:.2}");
        assert!(aside < 1e-15 && rate > 0.1, "seed {seed}: {aside:e}, {rate}");
        // One arm that is lighter is felt.
        scene.arm.as_mut().unwrap().links[7].body.as_mut().unwrap().mass *= 0.99;
        assert!(asymmetry(&scene).0 > 1e-7, "seed {seed}");
    }
}
