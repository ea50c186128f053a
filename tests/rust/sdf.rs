//! Robots from SDF files: poses, axes, joints, worlds.

use nalgebra::Vector3;
use uvms_gym::description::{Frame, JointSpring, Scene};
use uvms_gym::dynamics::ClosedFormModel;
use uvms_gym::robot::{Assembly, Robot, RobotJoint, RobotJointKind};
use uvms_gym::system::State;

const HALF_PI: &str = "1.5707963267948966";

fn link(name: &str, pose: &str, more: &str) -> String {
    format!(
        "<link name='{name}'><pose {pose}</pose><inertial><mass>2</mass><pose>0 0 0.1 0 0 0</pose>\
         <inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia></inertial>{more}</link>\n"
    )
}

fn joint(name: &str, kind: &str, ends: [&str; 2], more: &str) -> String {
    let [parent, child] = ends;
    format!("<joint name='{name}' type='{kind}'><parent>{parent}</parent><child>{child}</child>{more}</joint>\n")
}

fn model(version: &str, body: &str) -> String {
    format!("<sdf version='{version}'>\n<model name='m'>\n{body}</model></sdf>")
}

fn read(text: &str) -> Robot {
    Robot::from_text(text, "folder/m.sdf").unwrap_or_else(|error| panic!("{error}"))
}

fn only(text: &str) -> RobotJoint {
    read(text).joints.remove(0)
}

fn close(a: Vector3<f64>, b: [f64; 3]) -> bool {
    (a - Vector3::from(b)).norm() < 1e-14
}

#[test]
fn link_poses_are_the_models_and_joint_frames_their_difference() {
    let links = link("a", &format!(">1 0 0 0 0 {HALF_PI}"), "") + &link("b", &format!(">1 2 0 0 0 {HALF_PI}"), "");
    let own = only(&model("1.6", &(links + &joint("j", "revolute", ["a", "b"], ""))));
    // Two metres along y of the model are along x of a link turned by 90 degrees.
    assert!(close(own.position, [2.0, 0.0, 0.0]) && own.rpy == Vector3::zeros(), "{own:?}");
    assert_eq!((own.kind, own.axis, own.limits), (RobotJointKind::Continuous, Vector3::z(), None));
    // The same by relative_to, a named frame, degrees and a quaternion.
    for pose in [
        " relative_to='a'>2 0 0 0 0 0".to_owned(),
        " relative_to='f'>0 0 0 0 0 0".to_owned(),
        " degrees='true'>1 2 0 0 0 90".to_owned(),
        " rotation_format='quat_xyzw'>1 2 0  0 0 0.7071067811865476 0.7071067811865476".to_owned(),
    ] {
        let frame = "<frame name='f' attached_to='a'><pose>2 0 0 0 0 0</pose></frame>\n";
        let links = link("a", &format!(">1 0 0 0 0 {HALF_PI}"), "") + &link("b", &pose, "");
        let own = only(&model("1.9", &(frame.to_owned() + &links + &joint("j", "revolute", ["a", "b"], ""))));
        assert!(close(own.position, [2.0, 0.0, 0.0]) && own.rpy.norm() < 1e-14, "{pose}: {own:?}");
    }
}

#[test]
fn axes_are_the_joints_but_the_models_in_old_files() {
    let links = link("a", ">0 0 0 0 0 0", "") + &link("b", &format!(">0 0 0 0 0 {HALF_PI}"), "");
    let axis = |version: &str, more: &str, attribute: &str| {
        let axis = format!("<axis><xyz{attribute}>1 0 0</xyz>{more}</axis>");
        only(&model(version, &(links.clone() + &joint("j", "revolute", ["a", "b"], &axis)))).axis
    };
    assert_eq!(axis("1.6", "", ""), Vector3::x());
    for turned in [
        axis("1.4", "", ""),
        axis("1.6", "<use_parent_model_frame>1</use_parent_model_frame>", ""),
        axis("1.9", "", " expressed_in='__model__'"),
        axis("1.9", "", " expressed_in='a'"),
    ] {
        assert!(close(turned, [0.0, -1.0, 0.0]), "{turned}");
    }
}

#[test]
fn a_pose_of_the_joint_moves_the_link_and_leaves_its_body() {
    let visual =
        "<collision name='c'><pose>0 0 0.5 0 0 0</pose><geometry><box><size>1 1 1</size></box></geometry></collision>";
    let text = |pose: &str| {
        let links = link("a", ">0 0 0 0 0 0", "") + &link("b", ">0 0 3 0 0 0", visual);
        let axis = "<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>2</upper><effort>-1</effort></limit></axis>";
        model("1.6", &(links + &joint("j", "revolute", ["a", "b"], &format!("{pose}{axis}"))))
    };
    let (plain, moved) = (read(&text("")), read(&text("<pose>0 0 -1 0 0 0</pose>")));
    assert_eq!((plain.joints[0].position.z, moved.joints[0].position.z), (3.0, 2.0));
    let place =
        |robot: &Robot| (robot.links[1].inertial.as_ref().unwrap().position.z, robot.links[1].shapes[0].position.z);
    assert_eq!((place(&plain), place(&moved)), ((0.1, 0.5), (1.1, 1.5)));
    assert_eq!((moved.joints[0].limits, moved.joints[0].effort), (Some([-1.0, 2.0]), None));
}

#[test]
fn a_spring_of_an_axis_becomes_the_joints() {
    let links = link("a", ">0 0 0 0 0 0", "") + &link("b", ">0 0 1 0 0 0", "");
    let of = |dynamics: &str| {
        let axis = format!("<axis><xyz>0 0 1</xyz><dynamics>{dynamics}</dynamics></axis>");
        model("1.6", &(links.clone() + &joint("j", "revolute", ["a", "b"], &axis)))
    };
    let spring = "<spring_reference>0.3</spring_reference><spring_stiffness>2.5</spring_stiffness>";
    let robot = read(&of(spring));
    assert!(robot.notes.is_empty(), "{:?}", robot.notes);
    assert_eq!((robot.joints[0].stiffness, robot.joints[0].spring_rest), (2.5, 0.3));
    let scene: Scene = Assembly::default().of(&robot).unwrap().scene;
    let expected = JointSpring { stiffness: 2.5, rest: 0.3 };
    assert_eq!(scene.arm.unwrap().links[0].joint.spring, Some(expected));
    let error = Robot::from_text(&of("<spring_stiffness>-1</spring_stiffness>"), "m.sdf").unwrap_err().to_string();
    assert!(error.contains("spring_stiffness") && error.contains("-1"), "{error}");
}

#[test]
fn a_vehicle_with_a_thruster_and_hydrodynamics_becomes_a_scene() {
    let added = "<inertial><mass>2</mass><fluid_added_mass><xx>3</xx><yy>4</yy><zz>5</zz><rr>1</rr><yr>0.25</yr></fluid_added_mass></inertial>";
    let hull = "<collision name='c'><geometry><ellipsoid><radii>0.4 0.2 0.1</radii></ellipsoid></geometry></collision>";
    let plugins = "<plugin name='gz::sim::systems::Hydrodynamics' filename='h'><link_name>hull</link_name><xUabsU>-9</xUabsU></plugin>\
         <plugin name='gz::sim::systems::Thruster' filename='t'><joint_name>shaft</joint_name><max_thrust_cmd>7</max_thrust_cmd></plugin>";
    let world = "<plugin name='gz::sim::systems::Buoyancy' filename='b'><uniform_fluid_density>1020</uniform_fluid_density></plugin>\
         <model name='floor'><static>true</static><link name='l'/></model><include><uri>model://sun</uri></include>";
    let text = format!(
        "<sdf version='1.10'><world name='w'>{world}<model name='m'><pose>0 0 -5 0 0 0</pose>\n{}{}{}{plugins}</model></world></sdf>",
        link("hull", ">0 0 0 0 0 0", hull).replacen(
            "<inertial><mass>2</mass>",
            added.strip_suffix("</inertial>").unwrap(),
            1
        ),
        link("propeller", &format!(">-0.5 0 0 0 {HALF_PI} 0"), ""),
        joint("shaft", "revolute", ["hull", "propeller"], "<axis><xyz>0 0 1</xyz></axis>"),
    );
    let robot = read(&text);
    let own = robot.links[0].water.as_ref().unwrap();
    assert_eq!((own.added_mass[(2, 2)], own.added_mass[(5, 1)], own.quadratic[(0, 0)]), (5.0, 0.25, 9.0));
    assert_eq!((robot.fluid_density, robot.joints.len()), (Some(1020.0), 1));
    let volume = 4.0 / 3.0 * std::f64::consts::PI * 0.4 * 0.2 * 0.1;
    assert!((own.volume.unwrap() - volume).abs() < 1e-15);
    for part in ["model://sun", "\"floor\" is static"] {
        assert!(robot.notes.iter().any(|note| note.contains(part)), "{part}: {:?}", robot.notes);
    }
    let scene: Scene = Assembly::default().of(&robot).unwrap().scene;
    assert_eq!((scene.water.density, scene.vehicle.thrusters.len(), &scene.arm), (1020.0, 1, &None));
    let thruster = &scene.vehicle.thrusters[0];
    assert!(close(thruster.position, [-0.5, 0.0, 0.0]) && close(thruster.axis, [1.0, 0.0, 0.0]), "{thruster:?}");
}

#[test]
fn an_arm_is_the_same_from_sdf_and_from_urdf() {
    let urdf = |name: &str| {
        format!(
            "<link name='{name}'><inertial><mass value='2'/><origin xyz='0 0 0.1'/>\
             <inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>"
        )
    };
    let turn = |name: &str, parent: &str, child: &str, z: &str| {
        format!(
            "<joint name='{name}' type='revolute'><parent link='{parent}'/><child link='{child}'/><origin xyz='0 0 {z}' rpy='0.3 0 0'/>\
             <axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='5' velocity='1'/></joint>"
        )
    };
    let urdf = format!(
        "<robot name='m'>{}{}{}{}{}</robot>",
        urdf("a"),
        urdf("b"),
        urdf("c"),
        turn("j", "a", "b", "0.5"),
        turn("k", "b", "c", "0.4")
    );
    let axis = "<axis><xyz>0 1 0</xyz><limit><lower>-1</lower><upper>1</upper><effort>5</effort><velocity>1</velocity></limit></axis>";
    let sdf = link("a", ">0 0 0 0 0 0", "")
        + &link("b", " relative_to='a'>0 0 0.5 0.3 0 0", "")
        + &link("c", " relative_to='b'>0 0 0.4 0.3 0 0", "")
        + &joint("j", "revolute", ["a", "b"], axis)
        + &joint("k", "revolute", ["b", "c"], axis);
    let scenes = [&urdf, &model("1.9", &sdf)]
        .map(|text| Assembly::default().of(&Robot::from_text(text, "m").unwrap()).unwrap().scene);
    let mut state = State::default();
    (state.q[0], state.q[1]) = (0.4, -0.7);
    let mass = scenes.map(|scene| {
        let model = ClosedFormModel::new(&scene).unwrap();
        let form = model.at(&state, scene.water.current);
        (form.mass_matrix().clone(), form.end_effector_pose().position)
    });
    assert!((&mass[0].0 - &mass[1].0).amax() < 1e-13 && (mass[0].1 - mass[1].1).norm() < 1e-14);
}

#[test]
fn joints_without_a_counterpart_are_locked_and_noted() {
    let links = link("a", ">0 0 0 0 0 0", "") + &link("b", ">0 0 1 0 0 0", "");
    for kind in ["ball", "universal", "screw", "revolute2"] {
        let robot = read(&model("1.6", &(links.clone() + &joint("j", kind, ["a", "b"], ""))));
        assert_eq!(robot.joints[0].kind, RobotJointKind::Fixed);
        assert!(robot.notes.iter().any(|note| note.contains(&format!("a {kind} joint"))), "{:?}", robot.notes);
    }
    let fixed = read(&model("1.6", &(links.clone() + &joint("j", "fixed", ["world", "a"], ""))));
    assert_eq!((fixed.joints[0].parent.as_str(), fixed.joints[0].frame()), ("world", Frame::default()));
    let bare = read(&model("1.6", "<link name='a'/>"));
    assert!(bare.links[0].inertial.is_none() && bare.notes[0].contains("a frame without mass"), "{:?}", bare.notes);
    let mimic =
        "<axis><mimic joint='j'><multiplier>2</multiplier><offset>1</offset><reference>0.25</reference></mimic></axis>";
    let own = only(&model("1.11", &(links + &joint("k", "prismatic", ["a", "b"], mimic)))).mimic.unwrap();
    assert_eq!((own.joint.as_str(), own.multiplier, own.offset), ("j", 2.0, 0.5));
}

#[test]
fn prefixes_need_no_declaration() {
    let text = model("1.9", &link("a", " gz:expressed_in='x'>0 0 0 0 0 0", "<other:element/>"));
    assert_eq!(read(&text).links.len(), 1);
}

#[test]
fn a_malformed_file_is_one_line_with_file_and_element() {
    let a = link("a", ">0 0 0 0 0 0", "");
    let two = a.clone() + &link("b", ">0 0 0 0 0 0", "");
    let with = |version: &str, more: &str| model(version, &(two.clone() + more));
    let shape = |inner: &str| {
        model(
            "1.6",
            &link("a", ">0 0 0 0 0 0", &format!("<collision name='c'><geometry>{inner}</geometry></collision>")),
        )
    };
    let cases: Vec<(String, &[&str])> = vec![
        ("<sdf version='1.6'/>".into(), &["<sdf>", "has no <model>"]),
        (model("1.6", ""), &["line 2", "model \"m\"", "has no <link>"]),
        (
            format!("<sdf version='1.6'><model name='p'>{a}</model><model name='q'>{a}</model></sdf>"),
            &["several models (p, q)", "remove the others"],
        ),
        (
            "<sdf version='1.6'><world name='w'><include><uri>model://rov</uri></include></world></sdf>".into(),
            &["includes model://rov", "import the file"],
        ),
        (with("1.6", "<include><uri>model://arm</uri></include>"), &["<include>", "model://arm", "gz sdf -p"]),
        (with("1.6", "<model name='n'/>"), &["<model>", "models in models"]),
        (model("1.6", &(a.clone() + &a)), &["line 4", "\"a\" is taken"]),
        (with("1.6", &joint("j", "wheel", ["a", "b"], "")), &["line 5", "joint \"j\"", "\"wheel\"", "revolute"]),
        (with("1.6", &joint("j", "fixed", ["a", "c"], "")), &["joint \"j\" <child>", "unknown link \"c\""]),
        (
            with("1.6", &joint("j", "revolute", ["a", "b"], "<axis><xyz>0 0 0</xyz></axis>")),
            &["<axis> <xyz>", "nonzero length"],
        ),
        (
            with(
                "1.6",
                &joint("j", "revolute", ["a", "b"], "<axis><limit><lower>2</lower><upper>1</upper></limit></axis>"),
            ),
            &["<limit>", "lower is 2", "below upper, 1"],
        ),
        (model("1.9", &link("a", " relative_to='x'>0 0 0 0 0 0", "")), &["\"x\""]),
        (
            model(
                "1.9",
                &(link("a", " relative_to='b'>0 0 0 0 0 0", "") + &link("b", " relative_to='a'>0 0 0 0 0 0", "")),
            ),
            &["relative to itself"],
        ),
        (model("1.6", &link("a", ">0 0 0 0", "")), &["<pose>", "has 4 numbers", "6"]),
        (shape("<box><size>1 0 1</size></box>"), &["<box> <size>", "lengths must be > 0"]),
        (shape("<sphere/>"), &["<sphere>", "<radius> is missing"]),
        (shape(""), &["<geometry>", "is empty"]),
    ];
    for (text, parts) in cases {
        let message = Robot::from_text(&text, "folder/m.sdf").map(|_| text.clone()).unwrap_err().to_string();
        for part in parts.iter().chain(&["folder/m.sdf: "]) {
            assert!(message.contains(part), "{text}\n'{message}' has no '{part}'");
        }
        assert!(!message.contains('\n'), "{message}");
    }
}
