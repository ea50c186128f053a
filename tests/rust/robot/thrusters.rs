//! Thrusters of vehicles in robots' files: stated, called so, or assumed.

use nalgebra::Vector3;
use uvms_gym::control::Allocation;
use uvms_gym::description::Scene;
use uvms_gym::robot::{Assembly, Imported, InWater, Robot, RobotThruster, ThrusterSource};

use super::whole::{DATA, accepted, case, says};
use super::{joint, link, robot};

#[test]
fn frames_called_thruster_are_thrusters_along_their_x_axes() {
    let frame = |i: usize, rpy: &str| {
        let name = format!("Thruster{i}_left");
        let place = format!("<origin xyz='0.{i} 0 0' rpy='{rpy}'/>");
        format!("<link name='{name}'/>") + &joint(&format!("j{i}"), "fixed", "body", &name, &place)
    };
    let world = "<link name='world'/><link name='map'/>".to_owned() + &joint("m", "fixed", "world", "map", "");
    let hull = world + &link("body") + &joint("w", "fixed", "world", "body", "<origin xyz='0 0 -95'/>");
    let text = robot(&(hull + &frame(1, "0 0 0") + &frame(2, "0 -1.5707963267948966 0")));
    let Imported { scene, notes } = accepted(&text);
    let vehicle = &scene.vehicle;
    assert_eq!((scene.arm.is_none(), vehicle.body.center_of_mass), (true, Vector3::zeros()));
    let [one, two] = &vehicle.thrusters[..] else { panic!("{:?}", vehicle.thrusters) };
    assert!((one.axis - Vector3::x()).norm() < 1e-15 && (two.axis - Vector3::z()).norm() < 1e-15);
    assert_eq!((one.position, one.limits), (Vector3::new(0.1, 0.0, 0.0), [-4.9, 4.9]));
    assert!(says(&notes, "Thruster1_left: a thruster along its x axis", "4.9 N either way"), "{notes:?}");
    assert_eq!(notes.iter().filter(|note| note.starts_with("Thruster1_left: ")).count(), 1);
}

#[test]
fn a_vehicle_without_thrusters_gets_assumed_ones() {
    let Imported { scene, notes } = case("vehicle-one-link");
    assert!(says(&notes, "base_link: the hull", "eight thrusters are ASSUMED"), "{notes:?}");
    assert!(scene.provenance.0["vehicle.thrusters"].starts_with("assumed: ") && scene.summary.contains("ASSUMED"));
    let allocation = Allocation::new(&scene.vehicle).unwrap();
    assert_eq!((allocation.count(), allocation.unactuated()), (8, vec![]));
    // Together as much as the robot weighs, and twice the weight that buoyancy does not bear.
    let weight = scene.vehicle.body.mass * 9.80665;
    assert!((8.0 * allocation.range(0) / weight - 1.0).abs() < 0.05, "{}", allocation.range(0));
    let text = std::fs::read_to_string(format!("{DATA}/vehicle-one-link.urdf")).unwrap();
    let mut robot = Robot::from_text(&text, "robot.urdf").unwrap();
    let volume = Some(10.0 * scene.vehicle.body.mass / 1000.0);
    robot.links[0].water = Some(InWater { volume, ..InWater::default() });
    let light = Assembly::default().of(&robot).unwrap().scene.vehicle;
    assert!(Allocation::new(&light).unwrap().wrench_limits()[2] > 1.9 * 9.0 * weight);
    // Others, or none, as chosen; they take the place of the file's where this is asked.
    let other = Scene::shipped("bluerov2-heavy").unwrap();
    let of = |thrusters| Assembly { thrusters, ..Assembly::default() }.of(&robot).unwrap().scene;
    assert_eq!(of(ThrusterSource::File).vehicle.thrusters, []);
    assert_eq!(of(ThrusterSource::Scene(&other)).vehicle.thrusters, other.vehicle.thrusters);
    let thruster = RobotThruster { name: "own".to_owned(), link: Some("base_link".to_owned()), ..Default::default() };
    robot.thrusters.push(RobotThruster { axis: Vector3::x(), ..thruster });
    let of = |thrusters| Assembly { thrusters, ..Assembly::default() }.of(&robot).unwrap().scene;
    let names = |scene: &Scene| scene.thruster_names().len();
    assert_eq!((names(&of(ThrusterSource::default())), names(&of(ThrusterSource::Assumed))), (1, 8));
    // A vehicle that takes the hull's place has its own.
    let settings = Assembly { vehicle: Some(&other), thrusters: ThrusterSource::Assumed, ..Assembly::default() };
    let message = settings.of(&robot).unwrap_err().to_string();
    assert!(message.contains("--thrusters has no use"), "{message}");
}

#[test]
fn a_volume_that_no_vehicle_has_is_left_out() {
    let text = std::fs::read_to_string(format!("{DATA}/vehicle-one-link.urdf")).unwrap();
    let mut robot = Robot::from_text(&text, "robot.urdf").unwrap();
    let of = |robot: &Robot| Assembly::default().of(robot).unwrap();
    let mass = of(&robot).scene.vehicle.body.mass;
    for (density, used) in [(101.0, true), (99.0, false)] {
        robot.links[0].water = Some(InWater { volume: Some(mass / density), ..InWater::default() });
        let Imported { scene, notes } = of(&robot);
        let volume = scene.vehicle.body.volume.unwrap();
        let expected = mass / if used { density } else { scene.water.density };
        assert!((volume / expected - 1.0).abs() < 1e-12, "{volume}");
        assert_eq!(says(&notes, "base_link: ", "is left out: no vehicle has 99 kg/m3"), !used, "{notes:?}");
        assert_eq!(scene.provenance.0["vehicle.body.volume"].starts_with("assumed: "), !used);
    }
}

#[test]
fn several_light_ends_that_turn_freely_on_a_hull_are_its_propellers() {
    let hull = link("hull").replace("'1'", "'40'");
    let end = |i: usize| {
        let place = format!("<origin xyz='0.{i} 0 0'/><axis xyz='0 0 1'/>");
        link(&format!("e{i}")) + &joint(&format!("j{i}"), "continuous", "hull", &format!("e{i}"), &place)
    };
    let of = |count: usize| accepted(&robot(&(hull.clone() + &(1..=count).map(end).collect::<String>())));
    let Imported { scene, notes } = of(4);
    let axes: Vec<_> = scene.vehicle.thrusters.iter().map(|thruster| (thruster.name.as_str(), thruster.axis)).collect();
    assert_eq!(axes, ["j1", "j2", "j3", "j4"].map(|name| (name, Vector3::z())));
    assert!(says(&notes, "j1: taken for a propeller", "turn freely"), "{notes:?}");
    assert!(says(&of(3).notes, "hull", "ASSUMED"));
}

#[test]
fn a_file_with_thrusters_or_with_a_vehicles_name_is_no_arm() {
    let limit = "<limit lower='-1' upper='1' effort='1' velocity='1'/>";
    let float = link("float").replace("'1'", "'6'");
    let text = robot(&(float + &link("sub").replace("'1'", "'5'") + &joint("line", "revolute", "float", "sub", limit)));
    let vehicle = |text: &str| accepted(text).scene.vehicle.body.mass == 6.0;
    assert!(!vehicle(&text));
    for (name, is) in [("wave_glider", true), ("MyROV", false), ("my_rov", true), ("rov_arm", false)] {
        assert_eq!(vehicle(&text.replacen("name='r'", &format!("name='{name}'"), 1)), is, "{name}");
    }
    let mut robot = Robot::from_text(&text, "robot.urdf").unwrap();
    let thruster = RobotThruster { name: "t".to_owned(), link: Some("sub".to_owned()), ..Default::default() };
    robot.thrusters.push(thruster);
    let Imported { scene, notes } = Assembly::default().of(&robot).unwrap();
    assert_eq!((scene.vehicle.body.mass, scene.arm.unwrap().links.len()), (6.0, 1));
    assert!(says(&notes, "float: the hull", "links on it carry thrusters"), "{notes:?}");
}

#[test]
fn thrust_of_hippo_simulation_is_of_the_speed_in_turns_per_second() {
    let plugin = "<gazebo><plugin filename='thruster' name='hippo_gz_plugins::thruster'><link>p</link><joint>t</joint>\
                  <maximum_rpm>3000</maximum_rpm><linear_coeff>0.1</linear_coeff><constant_coeff>-1</constant_coeff>\
                  <quadratic_coeff>0.004</quadratic_coeff></plugin></gazebo>";
    let text = robot(&(link("hull") + &link("p") + &joint("t", "continuous", "hull", "p", "") + plugin));
    // At 50 turns a second: 0.004 * 2500 + 0.1 * 50 - 1.
    let limits = accepted(&text).scene.vehicle.thrusters[0].limits;
    assert!((limits[1] - 14.0).abs() < 1e-12 && limits[0] == -limits[1], "{limits:?}");
}
