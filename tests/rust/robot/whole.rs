//! Whole robots: files with one trait each, trees, hulls, propellers, grippers, densities.

use nalgebra::{Matrix3, Vector3};
use uvms_gym::description::{Arm, Frame, MAX_JOINTS, Scene};
use uvms_gym::error::DescriptionError;
use uvms_gym::robot::{
    Assembly, Imported, Inertial, Robot, RobotJoint, RobotJointKind, RobotLink, RobotThruster, ThrusterSource,
};

use super::{joint, link, robot};

pub const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/robots");

pub fn case(name: &str) -> Imported {
    let robot = Robot::from_file(format!("{DATA}/{name}.urdf")).unwrap_or_else(|error| panic!("{error}"));
    Assembly::default().of(&robot).unwrap_or_else(|error| panic!("{error}"))
}

pub fn assembled(text: &str, settings: &Assembly) -> Result<Imported, DescriptionError> {
    settings.of(&Robot::from_text(text, "folder/robot.urdf")?)
}

pub fn accepted(text: &str) -> Imported {
    assembled(text, &Assembly::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn names(arm: &Arm) -> Vec<&str> {
    arm.links.iter().map(|link| link.name.as_str()).collect()
}

pub fn says(notes: &[String], start: &str, part: &str) -> bool {
    notes.iter().any(|note| note.starts_with(start) && note.contains(part))
}

#[test]
fn an_arm_alone_goes_onto_the_default_vehicle() {
    for (name, place, what) in [
        ("fixed-joint-zero-axis", "tip", "the end effector"),
        ("two-origins", "joint \"tool\" <origin>", "a second one is ignored"),
        ("dummy-frame", "tip", "no outline"),
        ("joint-friction", "base", "the base of an arm"),
    ] {
        let Imported { scene, notes } = case(name);
        let arm = scene.arm.as_ref().unwrap();
        assert_eq!((arm.links.len(), scene.vehicle.thrusters.len()), (2, 8), "{name}");
        assert!(says(&notes, place, what), "{name}: {notes:?}");
        let (mass, water) = scene.masses();
        assert!((mass - water).abs() < 5.0, "{name}: {mass} kg in {water} kg of water");
        assert!(says(&notes, "base", "mounted on bluerov2-heavy"), "{notes:?}");
    }
    let wrist = case("joint-friction").scene.arm.unwrap().links[1].joint.friction.clone();
    assert_eq!((wrist.viscous, wrist.coulomb), (1.0, 1.0));
}

#[test]
fn a_hull_in_the_file_becomes_the_vehicle_with_all_that_is_fixed_to_it() {
    for (name, mass, why) in [
        ("vehicle-and-arm", 101.0, "outweighs all that moves on it"),
        ("floating-base-off-the-arm", 101.0, "on a floating joint"),
        ("locked-joint-off-the-arm", 101.01, "outweighs all that moves on it"),
        ("zero-inertia-off-the-arm", 101.001, "it carries propellers"),
    ] {
        let Imported { scene, notes } = case(name);
        let arm = scene.arm.as_ref().unwrap();
        assert_eq!((names(arm), arm.base.is_none()), (vec!["upper", "fore"], true), "{name}");
        assert_eq!(arm.links[0].parent.as_deref(), Some("vehicle"));
        assert!((arm.links[0].joint.frame.position - Vector3::new(0.0, 0.0, 0.6)).norm() < 1e-15, "{name}");
        assert!((scene.vehicle.body.mass - mass).abs() < 1e-12, "{name}: {}", scene.vehicle.body.mass);
        assert!(says(&notes, "vehicle: the hull of a vehicle", why), "{name}: {notes:?}");
        assert!(says(&notes, "base: merged into vehicle", ""), "{name}: {notes:?}");
        let (mass, water) = scene.masses();
        assert!((mass - water).abs() < 1e-9 * mass, "{name}: {mass} kg in {water} kg of water");
        assert!(scene.vehicle.servo.as_ref().unwrap().kp.iter().all(|kp| *kp > 0.0));
        assert_eq!(Scene::from_toml_str(&scene.to_toml_string(), "back").unwrap(), scene);
        for (path, value, origin) in scene.numbers() {
            assert!(origin.is_some(), "{name}: {path} = {value}");
        }
    }
    assert!(says(&case("locked-joint-off-the-arm").notes, "imu_joint", "limits are equal: locked at 0"));
    assert!(says(&case("zero-inertia-off-the-arm").notes, "propeller", "a thruster along its axis"));
}

#[test]
fn a_vehicle_alone_has_no_arm() {
    let Imported { scene, notes } = case("vehicle-one-link");
    assert!(scene.arm.is_none());
    assert!(says(&notes, "base_link: the hull", "nothing moves on it"), "{notes:?}");
    // Two propellers without names and without a block of a plugin are no joints of an arm, and no thrusters either.
    let file = Assembly { thrusters: ThrusterSource::File, ..Assembly::default() };
    let Imported { scene, notes } =
        file.of(&Robot::from_file(format!("{DATA}/vehicle-with-propellers.urdf")).unwrap()).unwrap();
    assert!(scene.arm.is_none() && scene.vehicle.thrusters.is_empty());
    assert!(says(&notes, "", "no thrusters in the file"), "{notes:?}");
    assert!((scene.vehicle.body.mass - 11.7).abs() < 1e-12);
    assert!(says(&notes, "p1: taken for a propeller", "locked at 0"), "{notes:?}");
    // Where the file states thrusters, these are the vehicle's.
    let mut robot = Robot::from_file(format!("{DATA}/vehicle-with-propellers.urdf")).unwrap();
    robot.joints[0].position = Vector3::new(0.1, 0.2, 0.0);
    robot.joints[0].rpy.z = std::f64::consts::FRAC_PI_2;
    for (joint, limits) in [("p1", Some([-3.0, 4.0])), ("p2", None)] {
        let thruster =
            RobotThruster { name: format!("of-{joint}"), joint: Some(joint.to_owned()), limits, ..Default::default() };
        robot.thrusters.push(thruster);
    }
    let Imported { scene, notes } = Assembly::default().of(&robot).unwrap();
    let [first, second] = &scene.vehicle.thrusters[..] else { panic!("{:?}", scene.vehicle.thrusters) };
    assert_eq!((first.name.as_str(), first.limits), ("of-p1", [-3.0, 4.0]));
    assert!(
        (first.position - Vector3::new(0.1, 0.2, 0.0)).norm() < 1e-15 && (first.axis - Vector3::y()).norm() < 1e-15
    );
    assert!(second.limits[1] > 0.0 && says(&notes, "of-p2", "no limits of thrust"), "{notes:?}");
}

#[test]
fn a_stated_vehicle_takes_the_place_of_the_hull_or_carries_the_robot() {
    let vehicle = Scene::shipped("rexrov").unwrap();
    let mount = Frame { position: Vector3::new(0.5, 0.0, 0.0), ..Frame::default() };
    let settings = Assembly { vehicle: Some(&vehicle), mount: mount.clone(), ..Assembly::default() };
    let of = |name: &str| settings.of(&Robot::from_file(format!("{DATA}/{name}.urdf")).unwrap()).unwrap();
    let Imported { scene, notes } = of("vehicle-and-arm");
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!((scene.vehicle == vehicle.vehicle, names(arm)), (true, vec!["upper", "fore"]));
    assert_eq!((arm.mount.frame.clone(), arm.base.clone()), (mount, None));
    assert!(says(&notes, "vehicle: the hull", "takes its place"), "{notes:?}");
    let arm = of("vehicle-one-link").scene.arm.unwrap();
    assert_eq!((arm.links.len(), arm.base.unwrap().mass), (0, 11.5));
    // A first link that is named goes along, however heavy it is.
    let text = std::fs::read_to_string(format!("{DATA}/vehicle-and-arm.urdf")).unwrap();
    let based = Assembly { base: Some("vehicle"), ..settings.clone() };
    assert_eq!(assembled(&text, &based).unwrap().scene.arm.unwrap().base.unwrap().mass, 101.0);
    // Without such a vehicle there is nothing to mount on.
    let mounted = Assembly { vehicle: None, ..settings };
    let message = assembled(&text, &mounted).unwrap_err().to_string();
    assert!(message.contains("needs a --vehicle"), "{message}");
}

/// A base, an upper arm, a hand with two fingers, the second of which follows the first.
fn gripper() -> String {
    let limit = "<limit lower='0' upper='0.04' effort='5' velocity='1'/>";
    robot(
        &(link("base")
            + &link("arm")
            + &link("hand")
            + &link("left")
            + &link("right")
            + "<link name='grasp'/>"
            + &joint("shoulder", "continuous", "base", "arm", "")
            + &joint("wrist", "continuous", "arm", "hand", "<origin xyz='1 0 0'/>")
            + &joint("open", "prismatic", "hand", "left", limit)
            + &joint(
                "follow",
                "prismatic",
                "hand",
                "right",
                &format!("{limit}<mimic joint='open' multiplier='-1' offset='0.03'/>"),
            )
            + &joint("between", "fixed", "hand", "grasp", "<origin xyz='0.1 0 0'/>")),
    )
}

#[test]
fn fingers_are_joints_and_the_hand_carries_the_end_effector() {
    let Imported { scene, notes } = accepted(&gripper());
    let arm = scene.arm.unwrap();
    assert_eq!(names(&arm), ["arm", "hand", "left", "right"]);
    assert_eq!(arm.links[3].parent.as_deref(), Some("hand"));
    assert_eq!((arm.end_effector.on.as_deref(), arm.end_effector.position.x), (Some("hand"), 0.1));
    assert!(says(&notes, "follow: follows -1 times open plus 0.03", "command both"), "{notes:?}");
    assert_eq!(arm.links[2].joint.home, 0.02);
    assert!((arm.links[3].joint.home - 0.01).abs() < 1e-15);
    // A locked joint locks its follower, where the law puts it.
    let (lock, keep) = ([String::from("open")], [String::from("wrist")]);
    let Imported { scene, notes } = assembled(&gripper(), &Assembly { lock: &lock, ..Assembly::default() }).unwrap();
    let arm = scene.arm.unwrap();
    assert_eq!(names(&arm), ["arm", "hand"]);
    assert_eq!(arm.links[1].body.as_ref().unwrap().mass, 3.0);
    assert!(says(&notes, "follow: follows open, which does not move", "locked at 0.03"), "{notes:?}");
    let Imported { scene, .. } = assembled(&gripper(), &Assembly { keep: &keep, ..Assembly::default() }).unwrap();
    assert_eq!(names(&scene.arm.unwrap()), ["hand"]);
    let wrong = [String::from("elbow")];
    let message = assembled(&gripper(), &Assembly { lock: &wrong, ..Assembly::default() }).unwrap_err().to_string();
    assert!(message.contains("no joint \"elbow\"") && message.contains("shoulder, wrist"), "{message}");
}

#[test]
fn two_arms_are_branches_of_one_tree() {
    let arm = |side: &str, y: f64| {
        let name = |part: &str| format!("{side}-{part}");
        link(&name("upper"))
            + &link(&name("fore"))
            + &joint(&name("shoulder"), "continuous", "hull", &name("upper"), &format!("<origin xyz='0 {y} 0'/>"))
            + &joint(&name("elbow"), "continuous", &name("upper"), &name("fore"), "<origin xyz='1 0 0'/>")
    };
    let hull = link("hull").replace("value='1'", "value='50'");
    let text = robot(&(hull + &arm("left", 1.0) + &arm("right", -1.0)));
    let Imported { scene, notes } = accepted(&text);
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!(names(arm), ["left-upper", "left-fore", "right-upper", "right-fore"]);
    assert_eq!(arm.links[2].parent.as_deref(), Some("vehicle"));
    assert_eq!(arm.end_effectors.keys().collect::<Vec<_>>(), ["left-fore", "right-fore"]);
    assert_eq!(arm.end_effector, arm.end_effectors["left-fore"]);
    assert!(says(&notes, "left-fore: ", "the end effector") && says(&notes, "right-fore: ", "a further end effector"));
    let servo = |i: usize| arm.links[i].joint.servo.clone();
    assert_eq!((servo(0), servo(1)), (servo(2), servo(3)));
    let kp = |i: usize| arm.links[i].joint.servo.as_ref().unwrap().kp;
    assert!(kp(0) > kp(1));
}

#[test]
fn fingers_give_way_where_too_many_joints_move() {
    let chain: Vec<_> = (0..=MAX_JOINTS - 1).map(|i| format!("l{i}")).collect();
    let mut text: String = chain.iter().map(|name| link(name)).collect();
    for pair in chain.windows(2) {
        text += &joint(&format!("to-{}", pair[1]), "continuous", &pair[0], &pair[1], "");
    }
    for finger in ["thumb", "index"] {
        text += &(link(finger) + &joint(finger, "continuous", chain.last().unwrap(), finger, ""));
    }
    let Imported { scene, notes } = accepted(&robot(&text));
    assert_eq!(names(scene.arm.as_ref().unwrap()), chain[1..].iter().map(String::as_str).collect::<Vec<_>>());
    assert!(says(&notes, "thumb: a finger's joint, locked at 0", ""), "{notes:?}");
}

#[test]
fn merged_poses_are_accurate_at_every_pitch() {
    use std::f64::consts::FRAC_PI_2;
    for pitch in [FRAC_PI_2, -FRAC_PI_2, FRAC_PI_2 - 1e-9, FRAC_PI_2 - 1e-6, FRAC_PI_2 + 1e-8, 1.2] {
        let frames = [Vector3::new(0.4, pitch - 0.3, 0.0), Vector3::new(0.0, 0.3, 0.0), Vector3::new(-0.2, 0.1, 0.7)];
        let fixed = |name: &str, parent: &str, child: &str, i: usize| {
            let [r, p, y] = frames[i].into();
            joint(
                name,
                if i == 2 { "continuous" } else { "fixed" },
                parent,
                child,
                &format!("<origin rpy='{r} {p} {y}'/>"),
            )
        };
        let body = link("hull") + "<link name='a'/><link name='b'/>" + &link("arm");
        let text = body + &fixed("x", "hull", "a", 0) + &fixed("y", "a", "b", 1) + &fixed("z", "b", "arm", 2);
        let arm = accepted(&robot(&text)).scene.arm.unwrap();
        let of = |rpy: Vector3<f64>| Frame { position: Vector3::zeros(), rpy }.rotation();
        let expected = of(frames[0]) * of(frames[1]) * of(frames[2]);
        assert!((of(arm.links[0].joint.frame.rpy) - expected).amax() < 1e-14, "{pitch}");
    }
}

#[test]
fn a_robot_reads_back_from_plain_data_and_is_checked_there() {
    let robot = Robot::from_text(&gripper(), "robot.urdf").unwrap();
    let value = toml::Value::try_from(&robot).unwrap();
    assert_eq!(Robot::from_value(value, "robot.urdf").unwrap(), robot);
    let inertial = |mass: f64| Some(Inertial { mass, inertia: Matrix3::identity(), ..Inertial::default() });
    let links = |mass: f64| {
        ["hull", "arm"]
            .map(|name| RobotLink { name: name.to_owned(), inertial: inertial(mass), ..RobotLink::default() })
            .to_vec()
    };
    let moving = |axis: Vector3<f64>, limits: Option<[f64; 2]>| RobotJoint {
        name: "j".into(),
        kind: RobotJointKind::Revolute,
        parent: "hull".into(),
        child: "arm".into(),
        axis,
        limits,
        ..RobotJoint::default()
    };
    let made = |mass: f64, joint: RobotJoint| Robot {
        links: links(mass),
        joints: vec![joint],
        source: "r.xml".into(),
        ..Robot::default()
    };
    for (robot, problem) in [
        (Robot { source: "r.xml".into(), ..Robot::default() }, "the robot: has no links"),
        (made(-1.0, moving(Vector3::x(), None)), "link \"hull\": mass is -1"),
        (made(1.0, moving(Vector3::zeros(), None)), "joint \"j\": axis must have a nonzero length"),
        (made(1.0, moving(Vector3::x(), Some([1.0, -1.0]))), "joint \"j\": lower limit is 1"),
    ] {
        let message = Assembly::default().of(&robot).unwrap_err().to_string();
        assert_eq!(&message[..7 + problem.len()], format!("r.xml: {problem}"), "{message}");
    }
}

#[test]
fn degrees_in_place_of_radians_are_doubted() {
    let limit = "<limit lower='-90' upper='90' effort='5' velocity='1'/><origin rpy='0 0 90'/>";
    let text = robot(&(link("foot") + &link("arm") + &joint("j", "revolute", "foot", "arm", limit)));
    let notes = accepted(&text).notes;
    assert!(
        says(&notes, "j: its origin turns", "degrees?")
            && says(&notes, "j: ", "its limits are several turns, rad: degrees?"),
        "{notes:?}"
    );
}

#[test]
fn limits_beyond_all_bounds_are_none() {
    for (limit, limits) in [
        ("lower='-1e+16' upper='1e+16' effort='inf' velocity='1e300'", None),
        ("lower='-3' upper='1e+16'", None),
        ("upper='2'", Some((0.0, 2.0))),
    ] {
        let more = format!("<limit {limit}/>");
        let text = robot(&(link("foot") + &link("arm") + &joint("j", "revolute", "foot", "arm", &more)));
        let joint = accepted(&text).scene.arm.unwrap().links[0].joint.clone();
        assert_eq!(joint.limits.map(|limits| (limits.lower, limits.upper)), limits, "{limit}");
        assert_eq!((joint.effort, joint.speed), (None, None));
    }
}
