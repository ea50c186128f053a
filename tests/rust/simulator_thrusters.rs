//! Thrusters and fins from the plugins of simulators: places, axes, limits and forces.

use nalgebra::Vector3;
use uvms_gym::dynamics::Loads;

use crate::simulator_blocks::{acceleration, gazebo, robot, scene};

/// A thruster of uuv_simulator.
pub fn thruster(dynamics: &str, conversion: &str, more: &str) -> String {
    gazebo(&format!(
        "<plugin name='t' filename='libuuv_thruster_ros_plugin.so'><linkName>propeller</linkName><jointName>shaft</jointName>\
         <thrusterID>3</thrusterID><dynamics>{dynamics}</dynamics>\n<conversion>{conversion}</conversion>{more}</plugin>"
    ))
}

#[test]
fn thrusters_push_along_the_joints_axis_at_its_origin_within_the_converted_limits() {
    let basic = "<type>Basic</type><rotorConstant>0.01</rotorConstant>";
    let first = "<type>FirstOrder</type><timeConstant>0.2</timeConstant>";
    let clamp = "<clampMin>-50</clampMin><clampMax>100</clampMax>";
    let bessa = "<type>Bessa</type><rotorConstantL>0.01</rotorConstantL><rotorConstantR>0.02</rotorConstantR>\
                 <deltaL>-100</deltaL><deltaR>100</deltaR>";
    let points = "<type>LinearInterp</type><inputValues>-100 0 100</inputValues><outputValues>-40 0 60</outputValues>";
    let yoerger = "<type>Yoerger</type><alpha>2</alpha><beta>8</beta>";
    let zero = "<type>ZeroOrder</type>";
    let cases = [
        (thruster(first, basic, clamp), Some([-25.0, 100.0]), Some(0.2)),
        (
            thruster(zero, basic, &format!("{clamp}<gain>2</gain><thrust_efficiency>0.5</thrust_efficiency>")),
            Some([-50.0, 200.0]),
            None,
        ),
        (
            thruster(zero, basic, &format!("{clamp}<thrustMin>-10</thrustMin><thrustMax>30</thrustMax>")),
            Some([-10.0, 30.0]),
            None,
        ),
        // k (s^2 - delta)
        (thruster(zero, bessa, clamp), Some([-24.0, 198.0]), None),
        (thruster(zero, points, clamp), Some([-20.0, 60.0]), None),
        // s |s| = beta / alpha c = 4 c, and the rate 2 alpha s at s = 20.
        (thruster(yoerger, basic, clamp), Some([-2.0, 4.0]), Some(1.0 / 80.0)),
        (thruster(first, basic, "<clampMin>100</clampMin><clampMax>-50</clampMax>"), None, Some(0.2)),
    ];
    for (text, limits, lag) in cases {
        let own = robot(&text).thrusters[0].clone();
        let rounded = own.limits.map(|limits| limits.map(|x| (x * 1e9).round() / 1e9));
        assert_eq!((rounded, own.joint.as_deref()), (limits, Some("shaft")), "{text}");
        assert!(own.lag.zip(lag).is_none_or(|(a, b)| (a - b).abs() < 1e-15) && own.lag.is_some() == lag.is_some());
    }
    let scene = scene(&thruster(first, basic, clamp));
    let own = &scene.vehicle.thrusters[0];
    assert!((own.position - Vector3::new(-1.0, 0.2, 0.0)).norm() < 1e-15 && (own.axis - Vector3::x()).norm() < 1e-15);
    assert!(scene.arm.is_none() && own.name == "thruster-3" && own.lag == Some(0.2));
}

#[test]
fn thrusters_of_gazebo_have_limits_of_thrust_or_of_speed() {
    let text = |more: &str| {
        gazebo(&format!(
            "<plugin name='ignition::gazebo::systems::Thruster' filename='libignition-gazebo-thruster-system.so'>\
             <joint_name>shaft</joint_name>{more}</plugin>"
        ))
    };
    let limits = |more: &str| robot(&text(more)).thrusters[0].limits;
    let commands = "<min_thrust_cmd>-20</min_thrust_cmd><max_thrust_cmd>30</max_thrust_cmd>";
    assert_eq!(limits(commands), Some([-20.0, 30.0]));
    assert_eq!(limits(""), None);
    // C rho D^4 omega |omega| of a left-handed propeller.
    let speed = "<use_angvel_cmd>true</use_angvel_cmd><thrust_coefficient>-0.01</thrust_coefficient>\
                 <propeller_diameter>0.1</propeller_diameter>";
    let [low, high] = limits(&format!("{commands}{speed}")).unwrap();
    assert!((low + 0.001 * 900.0).abs() < 1e-12 && (high - 0.001 * 400.0).abs() < 1e-12, "{low} {high}");
    // The autopilot's range of commands, 40 (x - 0.25) for x from 0 to 1, before or after the thruster.
    let pilot = "<plugin name='p' filename='libArduPilotPlugin.so'><control channel='0'><jointName>shaft</jointName>\
                 <cmd_topic>/model/m/joint/shaft/cmd_thrust</cmd_topic><multiplier>40</multiplier><offset>-0.25</offset>\
                 </control></plugin>";
    let both = text("").replace("<gazebo>", &format!("<gazebo>{pilot}"));
    assert_eq!(robot(&both).thrusters[0].limits, Some([-10.0, 30.0]));
    assert!(!robot(&both).notes.iter().any(|note| note.contains("not read")), "{:?}", robot(&both).notes);
    // A class by the library alone.
    let by_library = "<plugin filename='gz-sim-thruster-system' name='t'><joint_name>shaft</joint_name></plugin>";
    assert_eq!(robot(&gazebo(by_library)).thrusters.len(), 1);
}

#[test]
fn a_fin_lifts_towards_its_deflection_with_the_plugins_force() {
    let fin = |law: &str| {
        gazebo(&format!(
            "<plugin name='f' filename='libuuv_fin_ros_plugin.so'><link_name>fin</link_name><joint_name>hinge</joint_name>\
             <liftdrag>{law}</liftdrag></plugin>"
        ))
        .replace(
            "<gazebo>",
            "<link name='fin'/><joint name='hinge' type='revolute'><parent link='hull'/><child link='fin'/>\
             <origin xyz='-1 0 0'/><axis xyz='0 0 1'/><limit lower='-0.5' upper='0.5'/></joint><gazebo>",
        )
    };
    let quadratic = fin("<type>Quadratic</type><lift_constant>20</lift_constant><drag_constant>10</drag_constant>");
    let lines = fin("<type>TwoLines</type><area>0.04</area><fluid_density>1000</fluid_density><cla>1</cla>\
         <alpha_stall>0.3</alpha_stall><cda>0.15</cda>");
    for text in [quadratic, lines] {
        let mut scene = scene(&text);
        assert_eq!((scene.vehicle.fins.len(), scene.vehicle.fins[0].limits), (1, Some([-0.5, 0.5])));
        assert!(scene.numbers().iter().all(|(path, _, origin)| origin.is_some() || panic!("{path}")));
        (scene.water.gravity, scene.vehicle.forward_damping) = (Vector3::zeros(), None);
        scene.vehicle.body.damping = Default::default();
        let (speed, angle) = (2.0, 1e-3);
        let rates = |deflection: f64| {
            acceleration(&scene, [speed, 0.0, 0.0, 0.0, 0.0, 0.0], &Loads { fins: &[deflection], ..Loads::default() })
        };
        let force =
            (rates(angle)[1] - rates(0.0)[1]) * (scene.vehicle.body.mass + scene.vehicle.body.added_mass[(1, 1)]);
        assert!((force / (20.0 * angle * speed * speed) - 1.0).abs() < 1e-5, "{text}: {force}");
        assert!(force > 0.0 && rates(angle)[5] < 0.0, "a positive deflection at the stern turns the bow the other way");
    }
}
