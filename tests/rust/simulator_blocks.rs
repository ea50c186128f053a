//! Hydrodynamics from the plugins of simulators: signs, axes and forces as the plugins compute them.

use nalgebra::{Matrix6, Vector3, Vector6};
use uvms_gym::description::Scene;
use uvms_gym::dynamics::{ClosedFormModel, Loads};
use uvms_gym::robot::{Assembly, InWater, Robot};
use uvms_gym::system::State;

use crate::simulator_thrusters::thruster;

/// A file with a hull of 10 kg, and a propeller at (-1, 0.2, 0) whose joint turns about y of its own frame: x of the hull.
pub fn urdf(more: &str) -> String {
    let hull = "<inertial><mass value='10'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>\
                <collision><geometry><box size='1 0.4 0.2'/></geometry></collision>";
    let propeller =
        "<inertial><mass value='1e-12'/><inertia ixx='0' ixy='0' ixz='0' iyy='0' iyz='0' izz='0'/></inertial>";
    format!(
        "<robot name='r'>\n<link name='hull'>{hull}</link>\n<link name='propeller'>{propeller}</link>\n\
         <joint name='shaft' type='continuous'><parent link='hull'/><child link='propeller'/>\
         <origin xyz='-1 0.2 0' rpy='0 0 -1.5707963267948966'/><axis xyz='0 1 0'/></joint>\n{more}</robot>"
    )
}

pub fn gazebo(plugin: &str) -> String {
    urdf(&format!("<gazebo>{plugin}</gazebo>\n"))
}

/// A block of uuv_simulator on the hull.
fn uuv(model: &str) -> String {
    gazebo(&format!(
        "<plugin name='uuv' filename='libuuv_underwater_object_ros_plugin.so'><fluid_density>1000</fluid_density>\n\
         <link name='hull'>{model}</link></plugin>"
    ))
}

/// A block of Gazebo on the hull.
fn gz(more: &str) -> String {
    gazebo(&format!(
        "<plugin name='gz::sim::systems::Hydrodynamics' filename='gz-sim-hydrodynamics-system'>\
         <link_name>hull</link_name>{more}</plugin>"
    ))
}

pub fn robot(text: &str) -> Robot {
    Robot::from_text(text, "folder/r.urdf").unwrap_or_else(|error| panic!("{error}"))
}

pub fn scene(text: &str) -> Scene {
    Assembly::default().of(&robot(text)).unwrap_or_else(|error| panic!("{error}")).scene
}

fn water(text: &str) -> InWater {
    robot(text).links[0].water.clone().expect("the file has a block")
}

/// Rates of the vehicle's twist.
pub fn acceleration(scene: &Scene, twist: [f64; 6], loads: &Loads) -> Vector6<f64> {
    let model = ClosedFormModel::new(scene).unwrap();
    let form = model.at(&State { twist: twist.into(), ..State::default() }, scene.water.current);
    Vector6::from_iterator(form.accelerations(loads).unwrap().iter().copied())
}

#[test]
fn uuv_simulators_matrices_turn_from_z_down_to_z_up_and_damping_changes_its_sign() {
    let rows = "4 0 0 0 0 0  0 5 0 0 0 1  0 0 6 0 2 0  0 0 0 7 0 0  0 0 2 0 8 0  0 1 0 0 0 9";
    let ahead = "-1 0 6 0 0 0  0 -2 0 0 0 3  0 0 -2 0 0 0  0 0 0 0 0 0  0 0 0 0 0 0  0 -4 0 0 0 -5";
    let text = uuv(&format!(
        "<volume>0.0125</volume><center_of_buoyancy>0 0 0.1</center_of_buoyancy><hydrodynamic_model>\
         <type>fossen</type><added_mass>{rows}</added_mass><linear_damping>-1 -2 -3 -4 -5 -6</linear_damping>\
         <linear_damping_forward_speed>{ahead}</linear_damping_forward_speed>\
         <quadratic_damping>-10 -20 -30 -40 -50 -60</quadratic_damping></hydrodynamic_model>"
    ));
    let own = water(&text);
    assert_eq!(own.linear, Matrix6::from_diagonal(&Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)));
    assert_eq!(own.quadratic, own.linear * 10.0);
    // y and z change their signs, so do products of one of them with x; the products of these two stay.
    assert_eq!((own.added_mass[(1, 5)], own.added_mass[(2, 4)]), (1.0, 2.0));
    assert_eq!((own.linear_forward_speed[(1, 5)], own.linear_forward_speed[(5, 1)]), (-3.0, 4.0));
    assert_eq!(own.linear_forward_speed[(0, 2)], 6.0);
    assert_eq!((own.volume, own.center_of_buoyancy), (Some(0.0125), Vector3::new(0.0, 0.0, 0.1)));
    let turned = uuv("<hydrodynamic_model><type>fossen</type><added_mass>4 0 1 0 0 0  0 5 0 0 0 0  1 0 6 0 0 0  \
                      0 0 0 7 0 0  0 0 0 0 8 0  0 0 0 0 0 9</added_mass></hydrodynamic_model>");
    assert_eq!(water(&turned).added_mass[(0, 2)], -1.0);
    let scene = scene(&text);
    assert_eq!(scene.water.density, 1000.0);
    assert_eq!(scene.vehicle.body.added_mass, own.added_mass);
    assert_eq!(scene.vehicle.forward_damping.as_ref().unwrap().matrix, own.linear_forward_speed);
    assert_eq!(scene.provenance_of("vehicle.body.added_mass").unwrap().1, "r.urdf");
    // F = (D_L + u D_F + D_Q |V|) V with the file's numbers, negative.
    let (u, mut still) = (2.0, scene);
    still.water.gravity = Vector3::zeros();
    let rate = acceleration(&still, [u, 0.0, 0.0, 0.0, 0.0, 0.0], &Loads::default());
    let expected = (-1.0 - u - 10.0 * u) * u / (still.vehicle.body.mass + 4.0);
    assert!((rate[0] - expected).abs() < 1e-12 * expected.abs(), "{rate} {expected}");
}

#[test]
fn a_hull_sinks_at_the_speed_where_the_files_damping_carries_its_weight() {
    let block = |damping: &str| {
        uuv(&format!(
            "<volume>0.009</volume><hydrodynamic_model><type>fossen</type><added_mass>{}</added_mass>{damping}\
             </hydrodynamic_model>",
            "5 0 0 0 0 0  0 5 0 0 0 0  0 0 5 0 0 0  0 0 0 1 0 0  0 0 0 0 1 0  0 0 0 0 0 1"
        ))
    };
    let derivatives = "<zDotW>-5</zDotW><xDotU>-5</xDotU><yDotV>-5</yDotV>";
    let cases = [
        (block("<quadratic_damping>-40 -40 -40 -1 -1 -1</quadratic_damping>"), 40.0, 0.0),
        (block("<linear_damping>-8 -8 -8 -1 -1 -1</linear_damping>"), 0.0, 8.0),
        (
            gz(&format!("{derivatives}<xUabsU>-40</xUabsU><yVabsV>-40</yVabsV><zWabsW>-40</zWabsW><zW>-8</zW>")),
            40.0,
            8.0,
        ),
    ];
    for (text, quadratic, linear) in cases {
        let mut scene = scene(&text);
        let body = &mut scene.vehicle.body;
        if body.volume != Some(0.009) {
            body.volume = Some(0.009);
        }
        let weight = (body.mass - 0.009 * scene.water.density) * scene.water.gravity.norm();
        // 0 = weight - linear w - quadratic w^2
        let speed = if quadratic > 0.0 {
            (-linear + f64::sqrt(linear * linear + 4.0 * quadratic * weight)) / (2.0 * quadratic)
        } else {
            weight / linear
        };
        let rates = |w: f64| acceleration(&scene, [0.0, 0.0, w, 0.0, 0.0, 0.0], &Loads::default())[2];
        assert!(rates(-speed).abs() < 1e-13 * scene.water.gravity.norm(), "{text}: {}", rates(-speed));
        // Slower it accelerates downwards, faster it brakes.
        assert!(rates(-0.9 * speed) < 0.0 && rates(-1.1 * speed) > 0.0, "{text}");
        // Without weight the speed decays at (D_L + D_Q |w|) / (m + A).
        scene.water.gravity = Vector3::zeros();
        let rate = acceleration(&scene, [0.0, 0.0, 0.5, 0.0, 0.0, 0.0], &Loads::default())[2];
        let expected = -(linear + quadratic * 0.5) * 0.5 / (scene.vehicle.body.mass + 5.0);
        assert!((rate - expected).abs() < 1e-12 * expected.abs(), "{text}: {rate} {expected}");
    }
}

#[test]
fn simple_bodies_of_uuv_simulator_have_the_plugins_numbers() {
    let pi = std::f64::consts::PI;
    let sphere = water(&uuv("<hydrodynamic_model><type>sphere</type><radius>0.3</radius></hydrodynamic_model>"));
    for i in 0..3 {
        assert!((sphere.added_mass[(i, i)] - 2.0 / 3.0 * pi * 27.0).abs() < 1e-11);
        assert!((sphere.quadratic[(i, i)] - 0.25 * 1000.0 * pi * 0.09).abs() < 1e-11);
        assert_eq!(sphere.added_mass[(3 + i, 3 + i)], 0.0);
    }
    let cylinder = "<hydrodynamic_model><type>cylinder</type><radius>0.1</radius><length>0.6</length><axis>j</axis>";
    let cylinder = water(&uuv(&format!("{cylinder}</hydrodynamic_model>")));
    let across = 1000.0 * pi * 0.01 * 0.6;
    assert!(
        (cylinder.added_mass[(0, 0)] - across).abs() < 1e-11
            && cylinder.added_mass[(0, 0)] == cylinder.added_mass[(2, 2)]
    );
    assert!((cylinder.added_mass[(3, 3)] - across * 0.36 / 12.0).abs() < 1e-11 && cylinder.added_mass[(4, 4)] == 0.0);
    // L / 2r = 3: C_L = 0.74 across, C_c = 0.87 along.
    assert!((cylinder.quadratic[(2, 2)] - 0.5 * 0.74 * 0.1 * 0.6 * 1000.0).abs() < 1e-11);
    assert!((cylinder.quadratic[(1, 1)] - 0.5 * 0.87 * pi * 0.01 * 1000.0).abs() < 1e-11);
    let edges = "<length>2</length><width>1</width><height>0.5</height>";
    let cuboid = water(&uuv(&format!("<hydrodynamic_model><type>box</type><cd>0.8</cd>{edges}</hydrodynamic_model>")));
    assert_eq!(cuboid.quadratic.diagonal().as_slice()[..3], [200.0, 400.0, 800.0]);
}

#[test]
fn gazebos_derivatives_oppose_the_motion_and_mixed_ones_go_to_their_terms() {
    let text = gz("<xDotU>-4</xDotU><yDotV>-5</yDotV><nDotR>-6</nDotR><yDotR>0.5</yDotR><nDotV>0.5</nDotV>\
         <xU>-1</xU><yV>-3</yV><nR>-4</nR><xUabsU>-2</xUabsU><yRabsR>0.25</yRabsR><zWW>-7</zWW><yUV>-8</yUV><mWabsQ>1</mWabsQ>\
         <default_current>1 0 0</default_current><speed>3</speed>");
    let own = water(&text);
    assert_eq!((own.added_mass[(0, 0)], own.added_mass[(1, 5)], own.added_mass[(5, 1)]), (4.0, -0.5, -0.5));
    assert_eq!((own.linear[(1, 1)], own.quadratic[(0, 0)], own.quadratic[(1, 5)]), (3.0, 2.0, -0.25));
    assert_eq!((own.quadratic[(2, 2)], own.linear_forward_speed[(1, 1)]), (7.0, 8.0));
    let notes = robot(&text).notes;
    for part in ["<zWW> (line 5): is read as zWabsW", "<mWabsQ>", "<default_current>", "<speed>"] {
        assert!(notes.iter().any(|note| note.contains(part)), "{part}: {notes:?}");
    }
    assert_eq!(
        water(&gz("<xDotU>-4</xDotU><disable_added_mass>true</disable_added_mass>")).added_mass,
        Matrix6::zeros()
    );
}

#[test]
fn matrices_of_the_other_sign_are_read_with_it_and_of_both_signs_refused() {
    let fossen = |tag: &str, six: &str| {
        uuv(&format!("<hydrodynamic_model><type>fossen</type><{tag}>{six}</{tag}></hydrodynamic_model>"))
    };
    for (text, part) in [
        (fossen("linear_damping", "1 2 3 4 5 6"), "<linear_damping> (line 6): its signs"),
        (gz("<xDotU>4</xDotU>"), "added mass"),
        (gz("<xU>4</xU>"), "linear damping"),
    ] {
        let own = water(&text);
        assert!(
            own.linear.diagonal().min() >= 0.0 && own.added_mass.diagonal().min() >= 0.0 && own != InWater::default()
        );
        assert!(robot(&text).notes.iter().any(|note| note.contains(part)), "{:?}", robot(&text).notes);
    }
    let mixed = Robot::from_text(&fossen("quadratic_damping", "-1 2 -3 0 0 0"), "r.urdf").unwrap_err().to_string();
    assert!(mixed.contains("line 6") && mixed.contains("<quadratic_damping>: its diagonal has both signs"), "{mixed}");
}

#[test]
fn rounded_added_mass_becomes_symmetric_and_other_asymmetry_is_refused() {
    let rows = |last: &str| {
        uuv(&format!(
            "<hydrodynamic_model><type>fossen</type><added_mass>700 0 0 0 0 0  0 900 0 0 0 10.774  0 0 900 0 0 0  \
             0 0 0 100 0 0  0 0 0 0 100 0  0 {last} 0 0 0 200</added_mass></hydrodynamic_model>"
        ))
    };
    let own = water(&rows("10.775"));
    assert_eq!(own.added_mass, own.added_mass.transpose());
    assert!((own.added_mass[(1, 5)] - 10.7745).abs() < 1e-12);
    assert!(robot(&rows("10.775")).notes.iter().any(|note| note.contains("made symmetric")));
    let message = Robot::from_text(&rows("11.775"), "r.urdf").unwrap_err().to_string();
    assert!(message.contains("row 2, column 6 is 10.774 and row 6, column 2 is 11.775"), "{message}");
}

#[test]
fn cross_terms_that_would_add_energy_lose_their_symmetric_part() {
    let text = gz("<yV>-1</yV><yR>9</yR><nV>-1</nV><nR>-1</nR><xU>-1</xU>");
    let own = water(&text);
    // D = [[1, -9], [1, 1]]: the symmetric part of the cross terms is -4, the skew part 5.
    assert_eq!((own.linear[(1, 5)], own.linear[(5, 1)]), (-5.0, 5.0));
    assert!(robot(&text).notes.iter().any(|note| note.contains("add energy")));
}

#[test]
fn buoyancy_of_freefloating_gazebo_is_a_part_of_the_weight_and_its_damping_positive() {
    let inside = "<buoyancy><compensation>1.02</compensation><origin xyz='0 0 0.05'/><damping xyz='1 2 3' rpy='4 5 6'/>\
                  <damping type='linear' xyz='7 8 9'/></buoyancy></link>\n<link name='propeller'>";
    let text = urdf("").replacen("</link>\n<link name='propeller'>", inside, 1);
    let own = water(&text);
    assert!((own.buoyancy.unwrap() - 9.81 * 10.0 * 1.02).abs() < 1e-12);
    assert_eq!(own.quadratic.diagonal(), Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0));
    assert_eq!(own.linear.diagonal(), Vector6::new(7.0, 8.0, 9.0, 0.0, 0.0, 0.0));
    assert_eq!((own.frame.position.z, own.center_of_buoyancy.z), (0.05, 0.05));
    // A map is the wrench per newton: force 2 along z at x = 0.5.
    let control = "<plugin name='freefloating_gazebo_control'><thruster><map>0 0 2 0 -1 0</map><effort>30</effort></thruster>\
                   <thruster><name>propeller</name></thruster></plugin>";
    let thrusters = robot(&gazebo(control)).thrusters;
    assert_eq!((thrusters[0].position, thrusters[0].axis), (Vector3::new(0.5, 0.0, 0.0), Vector3::z()));
    assert_eq!((thrusters[0].limits, thrusters[1].axis), (Some([-60.0, 60.0]), -Vector3::z()));
}

#[test]
fn neutrally_buoyant_links_carry_what_is_fixed_to_them() {
    let scene = scene(&uuv("<neutrally_buoyant>1</neutrally_buoyant><volume>7</volume><hydrodynamic_model>\
         <type>fossen</type></hydrodynamic_model>"));
    let body = &scene.vehicle.body;
    assert!((body.volume.unwrap() * scene.water.density - body.mass).abs() < 1e-12, "{:?} {}", body.volume, body.mass);
    // Of which nothing is stated, is estimated.
    assert!(body.added_mass.diagonal().min() > 0.0 && body.damping.quadratic.diagonal().min() > 0.0);
}

#[test]
fn plugins_that_are_not_read_are_named() {
    let other = "<plugin name='a' filename='libsurface_waves.so'/><plugin name='b' filename='libArduPilotPlugin.so'/>";
    let notes = robot(&gazebo(other)).notes;
    assert!(notes.iter().any(|note| note.contains("libsurface_waves.so (line 5), libArduPilotPlugin.so")), "{notes:?}");
    let missing = uuv("<hydrodynamic_model><type>fossen</type></hydrodynamic_model>")
        .replace("<link name='hull'><hydro", "<link name='keel'><hydro");
    assert!(robot(&missing).notes.iter().any(|note| note.contains("no link \"keel\"")), "{:?}", robot(&missing).notes);
    let thruster =
        "<plugin name='t' filename='libmy_thruster.so'><linkName>propeller</linkName><maxThrust>5</maxThrust></plugin>";
    let own = robot(&gazebo(thruster)).thrusters[0].clone();
    assert_eq!((own.joint.as_deref(), own.limits), (Some("shaft"), Some([-5.0, 5.0])));
}

#[test]
fn a_malformed_block_is_one_line_with_file_line_and_element() {
    let fossen = |inner: &str| uuv(&format!("<hydrodynamic_model>{inner}</hydrodynamic_model>"));
    let basic = "<type>Basic</type><rotorConstant>1</rotorConstant>";
    let cases: Vec<(String, &[&str])> = vec![
        (uuv(""), &["line 6: plugin \"uuv\" <link name=\"hull\">", "<hydrodynamic_model> is missing"]),
        (fossen(""), &["<type> is missing"]),
        (fossen("<type>torus</type>"), &["<type>", "\"torus\"", "fossen, sphere"]),
        (fossen("<type>fossen</type><added_mass>1 2</added_mass>"), &["<added_mass>", "has 2 numbers", "36"]),
        (fossen("<type>fossen</type><linear_damping>1 2</linear_damping>"), &["<linear_damping>", "6 or 36"]),
        (fossen("<type>fossen</type><linear_damping>1 2 3 4 5 x</linear_damping>"), &["\"x\" is not a finite number"]),
        (
            uuv("<volume>-1</volume><hydrodynamic_model><type>fossen</type></hydrodynamic_model>"),
            &["<volume>", "-1", ">= 0"],
        ),
        (gz("<xU>nan</xU>"), &["<xU>", "\"nan\" is not a finite number"]),
        (gz("<xU>1 2</xU>"), &["<xU>", "has 2 numbers"]),
        (gazebo("<plugin name='gz::sim::systems::Hydrodynamics'/>"), &["line 5", "<link_name> is missing"]),
        (thruster("<type>Third</type>", basic, ""), &["<dynamics> <type>", "\"Third\"", "ZeroOrder"]),
        (thruster("<type>ZeroOrder</type>", "<type>Basic</type>", ""), &["<conversion>", "<rotorConstant> is missing"]),
        (thruster("<type>FirstOrder</type><timeConstant>0</timeConstant>", basic, ""), &["<timeConstant>", "0", "> 0"]),
    ];
    for (text, parts) in cases {
        let message = Robot::from_text(&text, "folder/r.urdf").map(|_| text.clone()).unwrap_err().to_string();
        for part in parts.iter().chain(&["folder/r.urdf: line "]) {
            assert!(message.contains(part), "{text}\n'{message}' has no '{part}'");
        }
        assert!(!message.contains('\n'), "{message}");
    }
}
