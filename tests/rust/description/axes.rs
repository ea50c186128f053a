//! Tables in Fossen's axes (`axes = "ned"`: x forward, y starboard, z down), converted on reading.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use toml::Value;
use uvms_gym::description::Scene;
use uvms_gym::lane::Shared;
use uvms_gym::lie;
use uvms_gym::system::compile;

/// BlueROV2 Heavy with z down, as published: y of the thrusters to starboard, centre of mass below the origin.
const BLUEROV2_HEAVY_NED: &str = r#"
name = "bluerov2-heavy"
[water]
density = 1000.0
gravity = [0.0, 0.0, -9.81]
[vehicle]
name = "BlueROV2 Heavy"
axes = "ned"
thrusters = [
    { name = "front-right", position = [0.14, 0.092, 0.0], axis = [1.0, -1.0, 0.0], limits = [-40.0, 51.4] },
    { name = "front-left", position = [0.14, -0.092, 0.0], axis = [1.0, 1.0, 0.0], limits = [-40.0, 51.4] },
    { name = "rear-right", position = [-0.15, 0.092, 0.0], axis = [1.0, 1.0, 0.0], limits = [-40.0, 51.4] },
    { name = "rear-left", position = [-0.15, -0.092, 0.0], axis = [1.0, -1.0, 0.0], limits = [-40.0, 51.4] },
    { name = "vertical-front-right", position = [0.118, 0.215, -0.064], axis = [0.0, 0.0, -1.0], limits = [-40.0, 51.4] },
    { name = "vertical-front-left", position = [0.118, -0.215, -0.064], axis = [0.0, 0.0, -1.0], limits = [-40.0, 51.4] },
    { name = "vertical-rear-right", position = [-0.118, 0.215, -0.064], axis = [0.0, 0.0, -1.0], limits = [-40.0, 51.4] },
    { name = "vertical-rear-left", position = [-0.118, -0.215, -0.064], axis = [0.0, 0.0, -1.0], limits = [-40.0, 51.4] },
]
[vehicle.body]
mass = 13.5
inertia = [0.26, 0.23, 0.37]
center_of_mass = [0.0, 0.0, 0.02]
volume = 0.013704
added_mass = [5.5, 12.7, 14.6, 0.12, 0.12, 0.12]
damping.linear = [4.03, 6.22, 5.18, 0.07, 0.07, 0.07]
damping.quadratic = [18.18, 21.66, 36.99, 1.55, 1.55, 1.55]
[vehicle.servo]
kp = [42.8, 58.9, 63.2, 3.47, 3.2, 4.41]
kd = [57.0, 78.6, 84.3, 2.31, 2.13, 2.94]
"#;

/// Every table that may be in NED axes, none of its numbers 0, in the project's axes and in NED.
fn asymmetric(ned: bool) -> String {
    let axes = if ned { "axes = \"ned\"" } else { "" };
    // Signs of a vector's entries; of those of a matrix with exactly one index along x.
    let s = if ned { "-" } else { "" };
    let t = if ned { "" } else { "-" };
    let body = format!(
        r#"
mass = 20.0
inertia = [[1.0, {s}0.1, {s}0.2], [{s}0.1, 1.2, 0.3], [{s}0.2, 0.3, 1.4]]
inertia_at = "origin"
center_of_mass = [0.01, {s}0.02, {s}0.03]
volume = 0.02
center_of_buoyancy = [0.04, {s}0.05, {s}0.06]
hydrodynamic_frame = {{ position = [0.1, {s}0.2, {s}0.3], rpy = [0.4, {s}0.5, {s}0.6] }}
added_mass = [
    [10.0, {s}1.0, {s}2.0, 0.1, {s}0.2, {s}0.3],
    [{s}1.0, 20.0, 3.0, {t}0.4, 0.5, 0.6],
    [{s}2.0, 3.0, 30.0, {t}0.7, 0.8, 0.9],
    [0.1, {t}0.4, {t}0.7, 4.0, {s}0.11, {s}0.12],
    [{s}0.2, 0.5, 0.8, {s}0.11, 5.0, 0.13],
    [{s}0.3, 0.6, 0.9, {s}0.12, 0.13, 6.0],
]
damping.linear = [
    [11.0, {s}1.1, {s}1.2, 0.13, {s}0.14, {s}0.15],
    [{s}1.3, 12.0, 1.4, {t}0.16, 0.17, 0.18],
    [{s}1.5, 1.6, 13.0, {t}0.19, 0.21, 0.22],
    [0.23, {t}0.24, {t}0.25, 4.1, {s}0.26, {s}0.27],
    [{s}0.28, 0.29, 0.31, {s}0.32, 4.2, 0.33],
    [{s}0.34, 0.35, 0.36, {s}0.37, 0.38, 4.3],
]
damping.quadratic = [
    [21.0, {s}2.1, {s}2.2, 0.23, {s}0.24, {s}0.25],
    [{s}2.3, 22.0, 2.4, {t}0.26, 0.27, 0.28],
    [{s}2.5, 2.6, 23.0, {t}0.29, 0.31, 0.32],
    [0.33, {t}0.34, {t}0.35, 5.1, {s}0.36, {s}0.37],
    [{s}0.38, 0.39, 0.41, {s}0.42, 5.2, 0.43],
    [{s}0.44, 0.45, 0.46, {s}0.47, 0.48, 5.3],
]
"#
    );
    format!(
        r#"
name = "asymmetric"
[water]
density = 1000.0
gravity = [0.0, 0.0, -9.81]
[vehicle]
name = "hull"
{axes}
[vehicle.body]
{body}
[[vehicle.thrusters]]
name = "main"
position = [0.1, {s}0.2, {s}0.3]
axis = [0.6, {s}0.8, {s}0.1]
limits = [-40.0, 50.0]
induced = [0.01, {s}0.02, {s}0.03, 0.04, {s}0.05, {s}0.06]
[[vehicle.fins]]
name = "rudder"
position = [0.4, {s}0.5, {s}0.6]
chord = [0.6, {s}0.8, {s}0.1]
axis = [0.8, {t}0.6, 0.0]
area = 0.01
lift_slope = 3.0
deflection = 0.1
limits = [-0.2, 0.3]
[vehicle.tether]
position = [0.7, {s}0.8, {s}0.9]
length = 10.0
diameter = 0.01
[vehicle.forward_damping]
position = [0.7, {s}0.8, {s}0.9]
matrix = [
    [8.0, {s}0.1, {s}0.2, 0.3, {s}0.4, {s}0.5],
    [{s}1.0, 162.0, 1.2, {s}1.3, 1.4, -150.0],
    [{s}2.0, 2.1, 108.0, {s}2.3, 100.0, 2.5],
    [3.0, {s}3.1, {s}3.2, 13.0, {s}3.4, {s}3.5],
    [{s}4.0, 4.1, -37.0, {s}4.3, 20.0, 4.5],
    [{s}5.0, 34.0, 5.2, {s}5.3, 5.4, 32.0],
]
[vehicle.shape]
kind = "box"
size = [0.5, 0.4, 0.3]
position = [0.01, {s}0.02, {s}0.03]
[arm]
name = "arm"
mount.frame = {{ position = [0.3, 0.1, -0.2], rpy = [0.1, 0.2, 0.3] }}
[arm.base]
{axes}
{body}
[[arm.links]]
name = "upper"
joint = {{ kind = "revolute", axis = [0.0, 1.0, 0.0] }}
[arm.links.body]
{axes}
{body}
[[arm.links]]
name = "fore"
joint = {{ kind = "revolute", axis = [0.0, 1.0, 0.0], frame = {{ position = [0.3, 0.0, 0.1] }} }}
body = {{ mass = 1.0, inertia = [0.1, 0.1, 0.1] }}
[payload.body]
{axes}
{body}
"#
    )
}

fn read(text: &str) -> Scene {
    Scene::from_toml_str(text, "my.toml").unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn a_published_ned_table_is_the_shipped_scene() {
    let (shipped, ned) = (Scene::shipped("bluerov2-heavy").unwrap(), read(BLUEROV2_HEAVY_NED));
    assert_eq!((&ned.vehicle.body, &ned.vehicle.thrusters), (&shipped.vehicle.body, &shipped.vehicle.thrusters));
    assert_eq!(compile(&ned).system, compile(&shipped).system);
}

#[test]
fn every_table_is_converted_bit_for_bit() {
    let (flu, ned) = (read(&asymmetric(false)), read(&asymmetric(true)));
    assert_eq!(flu, ned);
    assert_eq!(compile(&flu).system, compile(&ned).system);
    // Not by -0 for 0: the text of both is the same.
    assert_eq!(flu.to_toml_string(), ned.to_toml_string());
}

#[test]
fn dumped_scenes_are_in_the_projects_axes() {
    let ned = read(&asymmetric(true));
    let dumped = ned.to_toml_string();
    assert!(!dumped.contains("axes ="), "{dumped}");
    assert_eq!(read(&dumped), ned);
}

/// Paths of all numbers below a node.
fn numbers(node: &Value, path: Vec<String>, out: &mut Vec<Vec<String>>) {
    let deeper = |key: &str| [path.clone(), vec![key.to_owned()]].concat();
    match node {
        Value::Table(table) => table.iter().for_each(|(key, below)| numbers(below, deeper(key), out)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, e)| numbers(e, deeper(&i.to_string()), out)),
        Value::Float(x) if *x != 0.0 => out.push(path),
        _ => {}
    }
}

fn negate(root: &mut Value, path: &[String]) {
    let node = path.iter().fold(root, |node, step| match node {
        Value::Array(list) => &mut list[step.parse::<usize>().unwrap()],
        table => table.get_mut(step).unwrap(),
    });
    *node = Value::Float(-node.as_float().unwrap());
}

#[test]
fn a_wrong_sign_would_show() {
    let flu = read(&asymmetric(false));
    let tree: Value = asymmetric(true).parse::<toml::Table>().unwrap().into();
    let mut paths = Vec::new();
    numbers(&tree, Vec::new(), &mut paths);
    assert!(paths.len() > 450, "{}", paths.len());
    for path in paths {
        let mut wrong = tree.clone();
        negate(&mut wrong, &path);
        let read = Scene::from_value(wrong, "my.toml");
        assert!(read.is_err() || read.is_ok_and(|scene| scene != flu), "{}", path.join("."));
    }
}

/// The vehicle of the asymmetric scene by Fossen's formulas with the numbers of its NED tables, against the compiled system.
#[test]
fn val_fossens_matrices_in_ned_are_those_of_the_compiled_system() {
    let ned_text = asymmetric(true);
    let text = ned_text.split("[arm]").next().unwrap();
    let compiled = compile(&read(text));
    let vehicle = &compiled.system.vehicle;
    // The tables as they are stated: the same text without its key `axes` is read without conversion.
    let stated = read(&text.replace("axes = \"ned\"", "")).vehicle.body;
    let (m, r_g) = (stated.mass, stated.center_of_mass);
    let frame = &stated.hydrodynamic_frame;
    let (rotation, p) = (frame.rotation(), frame.position.cross_matrix());
    let mut to_frame = Matrix6::zeros();
    to_frame.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation.transpose());
    to_frame.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-rotation.transpose() * p));
    to_frame.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation.transpose());
    let mut mass_matrix = to_frame.transpose() * stated.added_mass * to_frame;
    let mut rigid = Matrix6::zeros();
    rigid.fixed_view_mut::<3, 3>(0, 0).copy_from(&(m * Matrix3::identity()));
    rigid.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-m * r_g.cross_matrix()));
    rigid.fixed_view_mut::<3, 3>(3, 0).copy_from(&(m * r_g.cross_matrix()));
    rigid.fixed_view_mut::<3, 3>(3, 3).copy_from(&stated.inertia);
    mass_matrix += rigid;

    let s = Matrix6::from_diagonal(&Vector6::new(1.0, -1.0, -1.0, 1.0, -1.0, -1.0));
    let expected = s * mass_matrix * s;
    let inertia = vehicle.inertia.map(|Shared(x)| x);
    for (i, k) in (0..6).flat_map(|i| (0..6).map(move |k| (i, k))) {
        assert!((inertia.entry(i, k) - expected[(i, k)]).abs() < 1e-12, "M[{i}][{k}]: {expected}");
    }

    let nu = Vector6::new(0.7, -0.4, 0.3, 0.2, -0.5, 0.6);
    let there = to_frame * nu;
    let force = -(stated.damping.linear * there + stated.damping.quadratic * there.component_mul(&there.abs()));
    let expected = s * to_frame.transpose() * force;
    let damping = vehicle.damping[0].map(|Shared(x)| x);
    let got = damping.wrench(lie::Vector6::from_array((s * nu).into())).to_array();
    assert!((Vector6::from(got) - expected).norm() < 1e-12 * expected.norm(), "{got:?}, {expected}");

    // g(eta) of Fossen: weight down is +z in NED.
    let down = Vector3::new(0.3, -0.2, 0.93).normalize() * 9.81;
    let displaced = 1000.0 * stated.volume.unwrap();
    let moment = m * r_g.cross(&down) - displaced * stated.center_of_buoyancy.cross(&down);
    let force = (m - displaced) * down;
    let expected = s * Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
    let gravity = lie::Vector3([down.x, -down.y, -down.z]);
    let got = vehicle.restoring.unwrap().map(|Shared(x)| x).wrench(gravity).to_array();
    assert!((Vector6::from(got) - expected).norm() < 1e-12 * expected.norm(), "{got:?}, {expected}");
}

#[test]
fn tables_of_the_vehicle_follow_it_unless_they_state_their_own_axes() {
    let one = read(&BLUEROV2_HEAVY_NED.replacen("position = [0.14,", "axes = \"flu\", position = [0.14,", 1));
    let ned = read(BLUEROV2_HEAVY_NED);
    assert_eq!(one.vehicle.thrusters[0].position, Vector3::new(0.14, 0.092, 0.0));
    assert_eq!((&one.vehicle.body, &one.vehicle.thrusters[1..]), (&ned.vehicle.body, &ned.vehicle.thrusters[1..]));
    let body = BLUEROV2_HEAVY_NED.replacen("axes = \"ned\"\n", "", 1);
    let body = read(&body.replacen("[vehicle.body]", "[vehicle.body]\naxes = \"ned\"", 1));
    assert_eq!(body.vehicle.body, ned.vehicle.body);
    assert_eq!(body.vehicle.thrusters[0].position, Vector3::new(0.14, 0.092, 0.0));
}

#[test]
fn unknown_axes_are_refused_by_key_and_value() {
    let message = |text: &str| Scene::from_toml_str(text, "my.toml").unwrap_err().to_string();
    let vehicle = |value: &str| message(&BLUEROV2_HEAVY_NED.replacen("\"ned\"", value, 1));
    assert_eq!(vehicle("\"xyz\""), "my.toml: vehicle.axes: is \"xyz\", but must be \"flu\" or \"ned\"");
    assert_eq!(vehicle("3"), "my.toml: vehicle.axes: is 3, but must be \"flu\" or \"ned\"");
    let thruster = BLUEROV2_HEAVY_NED.replacen("name = \"rear-right\"", "name = \"rear-right\", axes = \"NED\"", 1);
    let expected = "my.toml: vehicle.thrusters[2].axes (rear-right): is \"NED\", but must be \"flu\" or \"ned\"";
    assert_eq!(message(&thruster), expected);
    let arm = asymmetric(false).replacen("body = { mass", "body = { axes = \"enu\", mass", 1);
    assert_eq!(message(&arm), "my.toml: arm.links[1].body.axes (fore): is \"enu\", but must be \"flu\" or \"ned\"");
}
