//! The joint frames that `compile` chooses, against direct forward kinematics of the scene.

use std::cell::Cell;
use std::f64::consts::{FRAC_PI_2, PI};

use crate::random_scene::{Options, Random, random_scene};
use nalgebra as na;
use uvms_gym::description::{Frame, Joint, JointKind, Parent, Scene};
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::hydro::FrameRotation;
use uvms_gym::lane::Shared;
use uvms_gym::lie::{Matrix3, Pose, Vector3};
use uvms_gym::spatial::{BodyPoint, LinkTwist};
use uvms_gym::system::{Before, JointPlacement, JointScrew, State, compile};

type Dense = na::Isometry3<f64>;

/// Rotation about (and shift along) x or z.
fn screw(axis: na::Vector3<f64>, angle: f64, shift: f64) -> na::Matrix4<f64> {
    na::Rotation3::new(axis * angle).to_homogeneous().append_translation(&(axis * shift))
}

fn angle(bend: LinkTwist<Shared<f64>>) -> f64 {
    match bend {
        LinkTwist::Deg0 => 0.0,
        LinkTwist::Deg90 => FRAC_PI_2,
        LinkTwist::Deg180 => PI,
        LinkTwist::General(Shared(sin), Shared(cos)) => sin.atan2(cos),
    }
}

fn homogeneous(rotation: &[[f64; 3]; 3], position: &[f64; 3]) -> na::Matrix4<f64> {
    let mut t = na::Matrix4::identity();
    t.fixed_view_mut::<3, 3>(0, 0).copy_from(&na::Matrix3::from_fn(|i, k| rotation[i][k]));
    t.fixed_view_mut::<3, 1>(0, 3).copy_from(&na::Vector3::from(*position));
    t
}

/// Link poses in the vehicle frame through the compiled joint frames.
fn compiled(scene: &Scene, q: &[f64]) -> Vec<na::Matrix4<f64>> {
    let compiled = compile(scene);
    let (mut frames, mut links) = (vec![na::Matrix4::<f64>::identity()], Vec::new());
    let length = |shift: Option<Shared<f64>>| shift.map_or(0.0, |Shared(x)| x);
    for (i, (joint, link)) in compiled.system.joints.iter().zip(&compiled.links).enumerate() {
        let JointPlacement { before, twist, a } = joint.placement;
        let before = match before {
            Some(Before::Pose(r, p)) => homogeneous(&r.map(|row| row.map(|Shared(x)| x)), &p.map(|Shared(x)| x)),
            Some(Before::Screw(turn, d)) => screw(na::Vector3::z(), angle(turn), length(d)),
            None => na::Matrix4::identity(),
        };
        let placement = before * screw(na::Vector3::x(), angle(twist), length(a));
        let coordinate = joint.offset.0 + q[i];
        let (theta, d) = match joint.screw.theta {
            None => (coordinate, length(joint.screw.d)),
            Some([Shared(sin), Shared(cos)]) => (sin.atan2(cos), coordinate),
        };
        let here = frames[joint.carrier(i)] * placement * screw(na::Vector3::z(), theta, d);
        frames.push(here);
        let Pose { rotation: Matrix3(rotation), position: Vector3(position) } = link;
        links.push(here * homogeneous(rotation, position));
    }
    links
}

/// Link poses in the vehicle frame as the scene states them.
fn direct(scene: &Scene, q: &[f64]) -> Vec<na::Matrix4<f64>> {
    let of = |frame: &Frame| {
        let [x, y, z] = frame.rpy.into();
        Dense::from_parts(frame.position.into(), na::UnitQuaternion::from_euler_angles(x, y, z))
    };
    let arm = scene.arm.as_ref().unwrap();
    let moved = |joint: &Joint, q: f64| {
        let along = joint.axis * q;
        let motion = match joint.kind {
            JointKind::Revolute => Dense::rotation(along),
            JointKind::Prismatic => Dense::translation(along.x, along.y, along.z),
            JointKind::Fixed => Dense::identity(),
        };
        of(&joint.frame) * motion
    };
    let mut coordinates = q[arm.mount.joint.iter().count()..].iter();
    let base = arm.mount.joint.iter().fold(of(&arm.mount.frame), |base, joint| base * moved(joint, q[0]));
    let mut links = Vec::new();
    for (i, link) in arm.links.iter().enumerate() {
        let parent = match arm.parent(i).unwrap() {
            Parent::Vehicle => Dense::identity(),
            Parent::Base => base,
            Parent::Link(k) => links[k],
        };
        let q = if link.moves() { *coordinates.next().unwrap() } else { 0.0 };
        links.push(parent * moved(&link.joint, q));
    }
    let moving = arm.links.iter().zip(links).filter(|(link, _)| link.moves()).map(|(_, pose)| pose);
    arm.mount.joint.iter().map(|_| base).chain(moving).map(|pose| pose.to_homogeneous()).collect()
}

fn worst(scene: &Scene, seed: u64) -> f64 {
    let mut random = Random::new(seed);
    let mut worst = 0.0_f64;
    for _ in 0..3 {
        let q: Vec<f64> = scene.joints().map(|_| random.between(-3.0, 3.0)).collect();
        let (a, b) = (compiled(scene, &q), direct(scene, &q));
        assert_eq!(a.len(), b.len());
        worst = a.iter().zip(&b).fold(worst, |w, (a, b)| w.max((a - b).amax()));
    }
    worst
}

/// How an axis lies to the one before it.
#[derive(Debug, Clone, Copy)]
enum Lie {
    Parallel,
    Coincident,
    Antiparallel,
    /// Turned by this much about a random direction.
    Turned(f64),
    /// At a right angle, and crossing.
    Crossing,
    General,
}

/// A random chain whose axes lie to each other as asked.
fn chain(seed: u64, lies: &[Lie]) -> Scene {
    let mut random = Random::new(seed ^ 0xC4A1);
    let options = Options {
        links: Some(1 + lies.len()),
        branching: Some(false),
        joint_loading: Some(false),
        fixed: Some(false),
        ..Options::default()
    };
    let mut scene = random_scene(seed, options);
    let arm = scene.arm.as_mut().unwrap();
    for (i, &lie) in lies.iter().enumerate() {
        let before = arm.links[i].joint.axis;
        let joint = &mut arm.links[i + 1].joint;
        let aligned = Frame { position: random.vector(0.4), rpy: na::Vector3::zeros() };
        let across = before.cross(&random.direction()).normalize();
        match lie {
            Lie::General => {}
            Lie::Parallel => (joint.frame, joint.axis) = (aligned, before),
            Lie::Coincident => {
                (joint.frame, joint.axis) = (Frame { position: before * random.between(-0.4, 0.4), ..aligned }, before);
            }
            Lie::Antiparallel => (joint.frame, joint.axis) = (aligned, -before),
            Lie::Turned(angle) => (joint.frame, joint.axis) = (aligned, na::Rotation3::new(across * angle) * before),
            Lie::Crossing => (joint.frame, joint.axis) = (Frame::default(), across),
        }
    }
    scene
}

#[test]
fn chains_in_general_position_move_as_described() {
    for seed in 0..100 {
        let scene = random_scene(seed, Options { links: Some(8), ..Options::default() });
        let error = worst(&scene, seed);
        assert!(error < 1e-12, "seed {seed}: {error:e}");
    }
}

#[test]
fn chains_of_special_axes_move_as_described() {
    let lies = [Lie::Parallel, Lie::Coincident, Lie::Antiparallel, Lie::Crossing, Lie::General];
    for seed in 0..200_u64 {
        let pick = |k: u64| lies[((seed + 1).wrapping_mul(0x9E37_79B9) >> (3 * k)) as usize % lies.len()];
        let picked: Vec<Lie> = (0..6).map(pick).collect();
        let scene = chain(seed, &picked);
        let error = worst(&scene, seed);
        assert!(error < 2e-13, "seed {seed} {picked:?}: {error:e}");
    }
}

#[test]
fn nearly_parallel_axes_keep_their_digits() {
    let mut maximum = 0.0_f64;
    for exponent in 0..30 {
        let angle = 10.0_f64.powf(-16.0 + 0.5 * f64::from(exponent));
        for seed in 0..3 {
            for angle in [angle, PI - angle] {
                let scene = chain(seed, &[Lie::Turned(angle), Lie::General, Lie::Turned(angle), Lie::Turned(-angle)]);
                let error = worst(&scene, seed);
                maximum = maximum.max(error);
                assert!(error < 1e-12, "angle {angle:e}, seed {seed}: {error:e}");
            }
        }
    }
    println!("nearly parallel axes: maximum error {maximum:e}");
}

#[test]
fn ordinary_arms_compute_in_the_cheap_frames() {
    let stands = |scene: &Scene| -> Vec<JointPlacement<Shared<f64>>> {
        compile(scene).system.joints.iter().map(|joint| joint.placement).skip(1).collect()
    };
    let petasus = stands(&Scene::shipped("petasus-pum").unwrap());
    let flat = petasus.iter().filter(|s| matches!(s.twist, LinkTwist::Deg0)).count();
    let quarter = petasus.iter().filter(|s| matches!(s.twist, LinkTwist::Deg90)).count();
    assert_eq!((petasus.len(), flat, quarter), (4, 2, 2), "{petasus:?}");
    let lies = [Lie::Parallel, Lie::Coincident, Lie::Antiparallel, Lie::Crossing, Lie::General];
    for (stand, lie) in stands(&chain(4, &lies)).iter().zip(lies) {
        let expected = match lie {
            Lie::Parallel | Lie::Coincident => matches!(stand.twist, LinkTwist::Deg0),
            Lie::Crossing => matches!(stand.twist, LinkTwist::Deg90),
            Lie::Antiparallel => matches!(stand.twist, LinkTwist::Deg180),
            _ => matches!(stand.twist, LinkTwist::General(..)),
        };
        assert!(expected && stand.before.is_none(), "{lie:?}: {stand:?}");
    }
    assert!(matches!(stands(&chain(4, &[Lie::Turned(1e-3)]))[0].before, Some(Before::Pose(..))));
}

#[test]
fn shipped_arms_leave_out_what_their_frames_can_spare() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        let system = compile(&Scene::shipped(name).unwrap()).system;
        let last = system.joints.last().unwrap().screw;
        assert!(matches!(last, JointScrew { d: None, theta: None }), "{name}: {last:?}");
    }
    // Drag in turned frames: of no link, or of one whose axes lie neither along its joint's axis nor along the normal to the next.
    let mut alpha5 = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    for turned in [false, true] {
        if turned {
            alpha5.arm.as_mut().unwrap().links[1].body.as_mut().unwrap().hydrodynamic_frame.rpy.fill(0.0);
        }
        let system = compile(&alpha5).system;
        let turns: Vec<_> = system.joints.iter().map(|joint| joint.body.central.unwrap().rotation).collect();
        for (k, turn) in turns.iter().enumerate() {
            let fits = match turn {
                FrameRotation::AboutZ(..) => turned && k == 1,
                turn => !(turned && k == 1) && matches!(turn, FrameRotation::Aligned),
            };
            assert!(fits, "{turns:?}");
        }
        assert!(system.z_aligned);
    }
    for joint in compile(&Scene::shipped("petasus-pum").unwrap()).system.joints {
        let origin = joint.body.central.unwrap().origin;
        assert!(!matches!(origin, BodyPoint::General(_)), "{origin:?}");
    }
}

/// Without drag to say where, what the water holds of them lies where it did.
#[test]
fn shipped_bodies_without_drag_keep_their_centres() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        let mut scene = Scene::shipped(name).unwrap();
        let system = compile(&scene).system;
        let arm = scene.arm.as_mut().unwrap();
        let bodies = arm.base.iter_mut().chain(arm.links.iter_mut().flat_map(|link| &mut link.body));
        for body in bodies.chain([&mut scene.vehicle.body]) {
            body.damping.linear.fill(0.0);
            body.damping.quadratic.fill(0.0);
        }
        let dragless = compile(&scene).system;
        assert!(dragless.z_aligned, "{name}");
        for (with, without) in system.joints.iter().zip(&dragless.joints) {
            let (with, without) = (with.body.central.unwrap(), without.body.central.unwrap());
            assert!(with.damping.is_some() && without.damping.is_none(), "{name}");
            assert!(with.origin.map(near) == without.origin.map(near), "{name}: {with:?}, {without:?}");
            assert!(with.rotation.map(near) == without.rotation.map(near), "{name}: {with:?}, {without:?}");
        }
    }
}

/// To twelve digits.
fn near(Shared(x): Shared<f64>) -> f64 {
    (x * 1e12).round()
}

/// Products of what rounding leaves of quarter turns (1e-17, 1e-34) are subnormal in single precision, which a processor
/// takes a hundred times as long for.
#[test]
fn constants_are_no_rounding() {
    for name in Scene::shipped_names() {
        let compiled = compile(&Scene::shipped(name).unwrap());
        let minimum = Cell::new(f64::INFINITY);
        let note = |Shared(x): Shared<f64>| {
            if x != 0.0 {
                minimum.set(minimum.get().min(x.abs()))
            }
        };
        compiled.system.map(note);
        for parts in &compiled.unscaled {
            parts.map(note);
        }
        assert!(minimum.get() > 1e-9, "{name}: {:e}", minimum.get());
    }
}

#[test]
fn body_poses_of_the_balance_are_those_of_the_scene() {
    for seed in 0..30 {
        let scene =
            random_scene(seed, Options { links: Some(5), joint_loading: Some(seed % 2 == 0), ..Options::default() });
        let mut state = State::default();
        let mut random = Random::new(seed);
        scene.joints().enumerate().for_each(|(i, _)| state.q[i] = random.between(-3.0, 3.0));
        let model = ClosedFormModel::new(&scene).unwrap();
        let poses = model.at(&state, na::Vector3::zeros()).body_poses();
        for (pose, expected) in poses[1..].iter().zip(direct(&scene, &state.q)) {
            let rotation = pose.rotation - expected.fixed_view::<3, 3>(0, 0);
            let position = pose.position - expected.fixed_view::<3, 1>(0, 3);
            assert!(rotation.amax() < 1e-13 && position.amax() < 1e-13);
        }
    }
}
