//! Robots from URDF: an arm against a shipped scene, and malformed files.

mod masses;
mod thrusters;
mod whole;

use nalgebra::Vector3;
use uvms_gym::description::{Frame, JointKind, MAX_JOINTS, Origin, Scene};
use uvms_gym::error::DescriptionError;
use uvms_gym::robot::{Assembly, Imported, Robot};

const ALPHA: &str = include_str!("../../golden/alpha5.urdf");

fn vehicle() -> Scene {
    Scene::shipped("bluerov2-heavy").unwrap()
}

fn import(text: &str, base: Option<&str>, tip: Option<&str>) -> Result<Imported, DescriptionError> {
    let mount = Frame { position: Vector3::new(0.19, 0.0, -0.12), rpy: Vector3::new(std::f64::consts::PI, 0.0, 0.0) };
    let tips: Vec<_> = tip.iter().map(|tip| (tip.to_string(), tip.to_string())).collect();
    let vehicle = vehicle();
    let settings = Assembly { vehicle: Some(&vehicle), mount, base, tips: &tips, ..Assembly::default() };
    settings.of(&Robot::from_text(text, "folder/arm.urdf")?)
}

fn accepted(text: &str) -> Imported {
    import(text, None, None).unwrap_or_else(|error| panic!("{error}"))
}

/// A link with a mass, and a joint between two links.
fn link(name: &str) -> String {
    format!(
        "<link name='{name}'><inertial><mass value='1'/>\
         <inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>\n"
    )
}

fn joint(name: &str, kind: &str, parent: &str, child: &str, more: &str) -> String {
    format!("<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>{more}</joint>\n")
}

fn robot(body: &str) -> String {
    format!("<robot name='r'>\n{body}</robot>")
}

#[test]
fn an_imported_alpha_5_has_the_frames_and_inertias_of_the_shipped_scene() {
    let Imported { scene, notes } = accepted(ALPHA);
    let shipped = Scene::shipped("bluerov2-heavy-alpha5").unwrap().arm.unwrap();
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!(arm.mount, shipped.mount);
    assert_eq!(arm.end_effector, shipped.end_effector);
    assert_eq!(arm.name, shipped.name);
    let bodies = |arm: &uvms_gym::description::Arm| {
        let links = arm.links.iter().map(|link| link.body.clone().unwrap());
        arm.base.clone().into_iter().chain(links).collect::<Vec<_>>()
    };
    for (ours, theirs) in bodies(arm).iter().zip(bodies(&shipped)) {
        assert_eq!((ours.mass, ours.center_of_mass), (theirs.mass, theirs.center_of_mass));
        assert!((ours.inertia - theirs.inertia).amax() < 1e-15);
        assert!(ours.volume.unwrap() > 0.0 && ours.added_mass.diagonal().min() >= 0.0);
    }
    assert_eq!(arm.links.len(), shipped.links.len());
    for (ours, theirs) in arm.links.iter().zip(&shipped.links) {
        assert_eq!(ours.name, theirs.name);
        let (a, b) = (&ours.joint, &theirs.joint);
        assert_eq!((a.kind, &a.frame, a.axis, a.effort, a.speed), (b.kind, &b.frame, b.axis, b.effort, b.speed));
        assert_eq!((a.friction.viscous, a.rotor_inertia), (b.friction.viscous, b.rotor_inertia));
        let ends = |joint: &uvms_gym::description::Joint| joint.limits.as_ref().map(|l| (l.lower, l.upper));
        assert_eq!(ends(a), ends(b));
        assert!(a.servo.as_ref().unwrap().kp > 0.0);
    }
    assert_eq!(scene.vehicle, vehicle().vehicle);
    for part in ["foot: merged into mount", "wrist: geometry is a mesh", "the arm weighs 1.4120 kg"] {
        assert!(notes.iter().any(|note| note.starts_with(part)), "{part}: {notes:?}");
    }
}

#[test]
fn every_number_of_an_imported_scene_has_provenance() {
    let scene = accepted(ALPHA).scene;
    for (path, value, origin) in scene.numbers() {
        assert!(origin.is_some(), "{path} = {value}");
    }
    let origin = |path| scene.provenance_of(path).unwrap();
    assert_eq!(origin("arm.links[wrist].body.mass"), (Origin::Cited, "arm.urdf"));
    assert_eq!(origin("arm.links[shoulder].body.added_mass").0, Origin::Derived);
    assert!(origin("arm.links[upper-arm].body.added_mass").1.contains("Lamb"));
    assert_eq!(Scene::from_toml_str(&scene.to_toml_string(), "back").unwrap(), scene);
    assert_eq!(scene.check().unwrap(), []);
}

#[test]
fn fixed_joints_merge_links_by_the_parallel_axis_rule() {
    let limit = "<limit lower='-1' upper='1' effort='5' velocity='1'/>";
    let text = robot(
        &(link("foot")
            + &link("arm")
            + &link("camera")
            + &link("hand")
            + "<link name='lamp'/>"
            + &joint("screws", "fixed", "arm", "lamp", "")
            + &joint("turn", "revolute", "foot", "arm", limit)
            + &joint("bracket", "fixed", "arm", "camera", "<origin xyz='0 2 0' rpy='0 0 1.5707963267948966'/>")
            + &joint(
                "slide",
                "prismatic",
                "camera",
                "hand",
                &format!("<origin xyz='1 0 0'/><axis xyz='0 0 3'/>{limit}<dynamics armature='0.5'/>"),
            )),
    );
    let arm = accepted(&text).scene.arm.unwrap();
    let body = arm.links[0].body.as_ref().unwrap();
    assert_eq!((body.mass, body.center_of_mass), (2.0, Vector3::new(0.0, 1.0, 0.0)));
    assert!((body.inertia.diagonal() - Vector3::new(4.0, 2.0, 4.0)).norm() < 1e-12);
    let slide = &arm.links[1].joint;
    assert_eq!((slide.kind, slide.axis, slide.rotor_inertia), (JointKind::Prismatic, Vector3::z(), 0.5));
    // The bracket's pose, then the slide's, which lies along the bracket's x: the arm's y.
    assert!((slide.frame.position - Vector3::new(0.0, 3.0, 0.0)).norm() < 1e-12);
    assert!((slide.frame.rpy.z - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn base_and_tip_choose_among_the_joints_of_a_tree() {
    let continuous = |name: &str, parent: &str, child: &str| joint(name, "continuous", parent, child, "");
    let text = robot(
        &(link("base")
            + &link("arm")
            + &link("left")
            + &link("right")
            + &continuous("a", "base", "arm")
            + &continuous("l", "arm", "left")
            + &continuous("r", "arm", "right")),
    );
    let arm = import(&text, None, Some("left")).unwrap().scene.arm.unwrap();
    let links: Vec<_> = arm.links.iter().map(|link| (link.name.as_str(), link.parent.as_deref())).collect();
    assert_eq!(links, [("arm", None), ("left", None), ("right", Some("arm"))]);
    assert_eq!(arm.end_effector.on.as_deref(), Some("left"));
    assert!(arm.links.iter().all(|link| link.joint.limits.is_none() && link.joint.effort.is_none()));
    // From the middle on, and a link without joints.
    assert_eq!(import(&text, Some("arm"), Some("right")).unwrap().scene.arm.unwrap().links.len(), 2);
    let tool = import(&text, Some("right"), Some("right")).unwrap().scene.arm.unwrap();
    assert!(tool.links.is_empty() && tool.base.unwrap().mass == 1.0);
}

#[test]
fn a_link_called_as_a_body_of_ours_gets_another_name() {
    let text = robot(&(link("foot") + &link("base") + &joint("a", "continuous", "foot", "base", "")));
    assert_eq!(accepted(&text).scene.arm.unwrap().links[0].name, "base-link");
}

#[test]
fn traits_that_do_not_matter_to_the_scene_are_noted() {
    let arm = link("foot") + &link("arm");
    let move_ = |more: &str| joint("j", "continuous", "foot", "arm", more);
    let cases = [
        (move_("<origin xyz='0 0 1'/><origin xyz='0 0 2'/>"), "joint \"j\" <origin>", "a second one is ignored"),
        (
            move_("") + "<link name='lamp'/>" + &joint("k", "revolute", "foot", "lamp", "<limit lower='1' upper='1'/>"),
            "k",
            "locked at 1",
        ),
        (move_("") + "<link name='lamp'/>" + &joint("k", "fixed", "foot", "lamp", "<axis xyz='0 0 0'/>"), "", ""),
    ];
    for (text, place, what) in cases {
        let Imported { scene, notes } = accepted(&robot(&(arm.clone() + &text)));
        assert_eq!(scene.arm.unwrap().links.len(), 1);
        assert!(
            what.is_empty() || notes.iter().any(|note| note.starts_with(place) && note.contains(what)),
            "{notes:?}"
        );
    }
}

#[test]
fn a_malformed_file_is_one_line_with_file_and_element() {
    let limit = "<limit lower='-1' upper='1' effort='5' velocity='1'/>";
    let two = link("foot") + &link("arm");
    let with = |kind: &str, more: &str| robot(&(two.clone() + &joint("j", kind, "foot", "arm", more)));
    let hull = |inner: &str| robot(&format!("<link name='hull'>{inner}</link>"));
    let geometry = |inner: &str| hull(&format!("<collision><geometry>{inner}</geometry></collision>"));
    let masses = |mass: &str, ixx: &str| {
        hull(&format!(
            "<inertial><mass {mass}/><inertia ixx='{ixx}' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
        ))
    };
    let cases: Vec<(String, &[&str])> = vec![
        ("<robot name='r'>\n<link</robot>".into(), &["line 2"]),
        ("\n".into(), &["line 1", "the file", "is empty"]),
        ("<scenario/>".into(), &["<scenario>", "a Stonefish scenario", "must be <robot>"]),
        ("<robot><a:b></robot>".into(), &["line 1"]),
        ("<!DOCTYPE r [<!ENTITY a 'a'>]>\n<robot/>".into(), &["line 1", "<!DOCTYPE>", "remove it"]),
        (robot(""), &["<robot>", "has no <link>"]),
        (robot("<link/>"), &["line 2", "<link>", "attribute name"]),
        (robot(&(link("a") + &link("a"))), &["line 3", "\"a\"", "taken"]),
        ("<robot xmlns:xacro='http://ros.org/xacro'><xacro:arm/></robot>".into(), &["<xacro:arm>", "run xacro"]),
        (with("spherical", ""), &["joint \"j\"", "spherical", "must be revolute"]),
        (with("revolute", ""), &["line 4", "joint \"j\"", "<limit> is missing"]),
        (with("revolute", "<limit lower='1' upper='-1'/>"), &["joint \"j\" <limit>", "lower is 1", "below upper, -1"]),
        (with("revolute", "<limit lower='a' upper='1'/>"), &["joint \"j\" <limit>", "lower=\"a\"", "finite number"]),
        (with("prismatic", "<limit lower='0' upper='1' effort='-2'/>"), &["<limit>", "effort is -2"]),
        (with("continuous", "<axis xyz='0 0 0'/>"), &["joint \"j\" <axis>", "nonzero length"]),
        (with("continuous", "<axis xyz='0 0'/>"), &["joint \"j\" <axis>", "xyz=\"0 0\"", "3 finite numbers"]),
        (with("continuous", "<axis/>"), &["joint \"j\" <axis>", "attribute xyz is missing"]),
        (with("continuous", "<origin xyz='0 0 inf'/>"), &["joint \"j\" <origin>", "xyz=\"0 0 inf\""]),
        (with("continuous", "<dynamics damping='-1'/>"), &["joint \"j\" <dynamics>", "damping is -1"]),
        (with("continuous", "<mimic/>"), &["joint \"j\" <mimic>", "attribute joint is missing"]),
        (
            robot(&(two.clone() + &joint("j", "fixed", "foot", "leg", ""))),
            &["joint \"j\" <child>", "unknown link \"leg\""],
        ),
        (robot(&(two.clone() + "<joint name='j' type='fixed'/>")), &["joint \"j\"", "<parent> is missing"]),
        (robot(&two), &["<robot>", "several links without parent (foot, arm)", "choose the base"]),
        (
            robot(&(two.clone() + &joint("j", "fixed", "foot", "arm", "") + &joint("k", "fixed", "foot", "arm", ""))),
            &["line 5", "\"arm\" is the child of joint \"j\" already"],
        ),
        (
            robot(&(two.clone() + &joint("j", "fixed", "foot", "arm", "") + &joint("k", "fixed", "arm", "foot", ""))),
            &["loop"],
        ),
        (
            robot(&(link("foot") + "<link name='arm'/>" + &joint("j", "revolute", "foot", "arm", limit))),
            &["link \"arm\"", "no mass"],
        ),
        (masses("", "1"), &["link \"hull\" <inertial> <mass>", "attribute value is missing"]),
        (masses("value='-3'", "1"), &["link \"hull\" <inertial> <mass>", "value is -3"]),
        (masses("value='1'", "-1"), &["link \"hull\" <inertial> <inertia>", "-1.0000e0"]),
        (masses("value='1'", "heavy"), &["<inertia>", "ixx=\"heavy\""]),
        (hull("<inertial><mass value='1'/></inertial>"), &["link \"hull\" <inertial>", "<inertia> is missing"]),
        (hull("<collision/>"), &["link \"hull\" <collision>", "<geometry> is missing"]),
        (geometry(""), &["link \"hull\" <collision> <geometry>", "is empty"]),
        (geometry("<cone/>"), &["<geometry> <cone>", "one of box"]),
        (geometry("<box size='1 0 1'/>"), &["<geometry> <box>", "edges must be > 0"]),
        (geometry("<sphere/>"), &["<geometry> <sphere>", "attribute radius is missing"]),
        (geometry("<cylinder radius='1' length='-2'/>"), &["<cylinder>", "length is -2"]),
    ];
    for (text, parts) in cases {
        let message = import(&text, None, None).map(|_| text.clone()).unwrap_err().to_string();
        for part in parts.iter().chain(&["folder/arm.urdf: "]) {
            assert!(message.contains(part), "{text}\n'{message}' has no '{part}'");
        }
        assert!(!message.contains('\n'), "{message}");
    }
    let message = import(ALPHA, Some("leg"), None).unwrap_err().to_string();
    assert!(message.contains("no link \"leg\" for the base") && message.contains("wrist"), "{message}");
    let message = import(ALPHA, Some("elbow"), Some("foot")).unwrap_err().to_string();
    assert!(message.contains("\"foot\": is not a descendant of the base link \"elbow\""), "{message}");
}

#[test]
fn more_joints_than_there_can_be_are_refused_by_their_names() {
    let names: Vec<_> = (0..MAX_JOINTS + 2).map(|i| format!("l{i}")).collect();
    let links: String = names.iter().map(|name| link(name)).collect();
    let count = MAX_JOINTS + 1;
    let joints: String =
        (0..count).map(|i| joint(&format!("j{i}"), "continuous", &names[i], &names[i + 1], "")).collect();
    let text = robot(&(links + &joints));
    let message = import(&text, None, None).unwrap_err().to_string();
    for part in
        [format!("{count} moving joints"), format!("at most {MAX_JOINTS}"), "j0, j1".to_owned(), "--lock".to_owned()]
    {
        assert!(message.contains(&part), "{message}");
    }
    assert_eq!(import(&text, Some("l1"), None).unwrap().scene.joints().count(), MAX_JOINTS);
}
