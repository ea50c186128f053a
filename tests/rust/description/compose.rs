//! Scenes composed of parts.

use std::path::PathBuf;

use nalgebra::Vector3;
use toml::Value;
use uvms_gym::description::{Frame, Parent, Scene};
use uvms_gym::system::compile;

use super::shipped;

/// Two arms of five joints side by side below the front of PETASUS.
const TWO_ARMS: &str = r#"
    name = "two-arms"
    [vehicle]
    file = "petasus"
    [[arms]]
    file = "pum"
    name = "left"
    mount.frame = { position = [0.25, 0.2, -0.35], rpy = [3.141592653589793, 0.0, 0.0] }
    [[arms]]
    file = "pum"
    name = "right"
    mount.frame = { position = [0.25, -0.2, -0.35], rpy = [3.141592653589793, 0.0, 0.0] }
"#;

fn read(text: &str) -> Scene {
    Scene::from_toml_str(text, "scene.toml").unwrap_or_else(|error| panic!("{error}"))
}

/// A folder of files for one test.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(test: &str, files: &[(&str, &str)]) -> Self {
        let folder = std::env::temp_dir().join(format!("uvms-gym-compose-{test}-{}", std::process::id()));
        for (name, text) in files {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        Self(folder)
    }

    pub fn scene(&self, name: &str) -> Result<Scene, String> {
        // Without the folder, whose name differs from run to run.
        let short = |text: String| text.replace(&format!("{}/", self.0.display()), "");
        Scene::from_file(self.0.join(name)).map_err(|error| short(error.to_string()))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.0));
    }
}

#[test]
fn a_shipped_composition_has_the_numbers_of_its_frozen_copy() {
    let (composed, frozen) = (shipped("petasus-pum"), crate::golden::scene("petasus-pum-frozen"));
    let (arm, frozen_arm) = (composed.arm.as_ref().unwrap(), frozen.arm.as_ref().unwrap());
    assert_eq!(composed.water, frozen.water);
    assert_eq!(composed.vehicle.body, frozen.vehicle.body);
    assert_eq!(
        (&arm.base, &arm.mount, &arm.end_effector),
        (&frozen_arm.base, &frozen_arm.mount, &frozen_arm.end_effector)
    );
    for (link, frozen) in arm.links.iter().zip(&frozen_arm.links) {
        assert_eq!(
            (&link.body, &link.joint.frame, link.joint.axis),
            (&frozen.body, &frozen.joint.frame, frozen.joint.axis)
        );
    }
}

/// The scene of two arms with all links written out.
fn written_out() -> Scene {
    let (mut scene, single) = (shipped("petasus"), shipped("petasus-pum").arm.unwrap());
    let mut arm = single.clone();
    arm.mount.frame = Frame::default();
    arm.links.clear();
    for (side, y) in [("left", 0.2), ("right", -0.2)] {
        let mount = Frame { position: Vector3::new(0.25, y, -0.35), rpy: single.mount.frame.rpy };
        for (i, link) in single.links.iter().enumerate() {
            let mut link = link.clone();
            link.parent =
                Some(if i == 0 { "vehicle".to_owned() } else { format!("{side}-{}", single.links[i - 1].name) });
            link.name = format!("{side}-{}", link.name);
            if i == 0 {
                link.joint.frame = mount.then(&link.joint.frame);
            }
            arm.links.push(link);
        }
    }
    arm.end_effector.on = Some("left-gripper".to_owned());
    scene.arm = Some(arm);
    scene
}

#[test]
fn a_composed_scene_compiles_to_the_bits_of_one_that_is_written_out() {
    let composed = read(TWO_ARMS);
    assert_eq!(format!("{:?}", compile(&composed).system), format!("{:?}", compile(&written_out()).system));
    assert_eq!(composed.joint_names().len(), 10);
    assert_eq!(composed.joint_names()[5], "right-yaw");
    assert_eq!(composed.arm.as_ref().unwrap().name, "PUM (left), PUM (right)");
}

#[test]
fn each_arm_has_its_end_effector_and_the_first_ones_is_the_scenes() {
    let scene = read(TWO_ARMS);
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!(scene.end_effector_names(), ["left", "right"]);
    assert_eq!(arm.end_effector, arm.end_effectors["left"]);
    assert_eq!(arm.end_effectors["right"].on.as_deref(), Some("right-gripper"));
    assert_eq!(arm.end_effectors["right"].position, Vector3::new(0.2, 0.0, 0.0));
    // An arm of the scene itself comes first, with its end effector.
    let scene = read(
        r#"
        name = "beside"
        [vehicle]
        file = "petasus"
        [arm]
        file = "pum"
        [[arms]]
        file = "pum"
        name = "right"
        "#,
    );
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!(arm.end_effector.on.as_deref(), Some("gripper"));
    assert_eq!((arm.name.as_str(), arm.links.len()), ("PUM", 11));
}

#[test]
fn a_composed_scene_is_written_with_everything_in_it() {
    let scene = read(TWO_ARMS);
    let text = scene.to_toml_string();
    assert!(!text.contains("file"), "{text}");
    assert_eq!(read(&text), scene);
    assert_eq!(scene.check().unwrap().len(), 0);
}

#[test]
fn every_number_of_a_composed_scene_has_the_provenance_of_its_part() {
    let scene = read(TWO_ARMS);
    for (path, value, origin) in scene.numbers() {
        assert!(origin.is_some(), "{path} = {value}");
    }
    let text = |path| scene.provenance_of(path).unwrap().1;
    assert!(text("arm.links[right-wrist].joint.servo.kp").starts_with("20 rad/s"));
    assert!(text("arm.links[right-wrist].body.mass").starts_with("1.02 times"));
    assert!(text("arm.end_effectors.right.position").starts_with("total length"));
    assert!(text("vehicle.body.volume").contains("30 %"));
    assert!(text("water.current").contains("still water"));
    assert_eq!(text("arm.links[left-base].joint.frame.position"), "stated in place of the part's");
}

#[test]
fn every_shipped_arm_goes_onto_every_shipped_vehicle() {
    for arm in Scene::shipped_arm_names() {
        for vehicle in ["rexrov", "bluerov2-heavy", "free-body"] {
            let scene = read(&format!(
                "name = \"s\"\n[vehicle]\nfile = \"{vehicle}\"\n[[arms]]\nname = \"a\"\nfile = \"{arm}\"\n"
            ));
            assert!(scene.joints().count() >= 2, "{arm}");
            for (path, value, origin) in scene.numbers() {
                assert!(origin.is_some(), "{arm} on {vehicle}: {path} = {value}");
            }
        }
    }
}

#[test]
fn other_keys_take_the_place_of_a_parts_table_by_table() {
    let scene = read(
        r#"
        name = "changed"
        [water]
        density = 1025.0
        [vehicle]
        file = "bluerov2-heavy"
        body.mass = 14.0
        body.buoyancy = 140.0
        thrusters.front-left.limits = [-20.0, 30.0]
        thruster_lag = 0.1
        [[arms]]
        file = "reach-alpha5"
        name = "front"
        end_effector.position = [0.0, 0.0, 0.2]
        links.elbow.joint.home = 1.0
        [provenance]
        "vehicle.body" = "measured: on a scale"
        "arms[front].mount" = "measured: with a ruler"
        "#,
    );
    let part = shipped("bluerov2-heavy");
    let body = &scene.vehicle.body;
    assert_eq!((body.mass, body.volume, body.buoyancy), (14.0, None, Some(140.0)));
    assert_eq!((body.inertia, &body.damping), (part.vehicle.body.inertia, &part.vehicle.body.damping));
    assert_eq!((scene.water.density, scene.water.gravity), (1025.0, part.water.gravity));
    for (ours, theirs) in scene.vehicle.thrusters.iter().zip(&part.vehicle.thrusters) {
        let limits = if ours.name == "front-left" { [-20.0, 30.0] } else { theirs.limits };
        assert_eq!((ours.limits, ours.position), (limits, theirs.position));
    }
    let arm = scene.arm.as_ref().unwrap();
    assert_eq!(arm.end_effector.position, Vector3::new(0.0, 0.0, 0.2));
    assert_eq!(
        arm.links.iter().map(|link| link.joint.home).collect::<Vec<_>>()[1..],
        [std::f64::consts::PI, 2.2, 1.0, 3.0]
    );

    let text = |path| scene.provenance_of(path).unwrap().1.to_owned();
    assert_eq!(text("vehicle.body.mass"), "on a scale");
    assert_eq!(text("vehicle.body.inertia"), "on a scale");
    assert_eq!(text("arm.links[front-base].joint.frame"), "with a ruler");
    for changed in [
        "vehicle.thrusters[front-left].limits",
        "vehicle.thruster_lag",
        "water.density",
        "arm.links[front-elbow].joint.home",
    ] {
        assert_eq!(text(changed), "stated in place of the part's", "{changed}");
    }
    assert!(text("arm.links[front-wrist].joint.home").contains("bent arm"));
}

#[test]
fn a_part_keeps_its_axes_and_its_volume() {
    let part = r#"
        [water]
        density = 1000.0
        gravity = [0.0, 0.0, -10.0]
        [vehicle]
        name = "ned"
        axes = "ned"
        body = { mass = 10.0, weight = 100.0, buoyancy = 100.0, center_of_mass = [0.0, 0.1, 0.2], inertia = [1.0, 1.0, 1.0] }
    "#;
    let scene = r#"
        name = "sea"
        [water]
        density = 1025.0
        gravity = [0.0, 0.0, -9.81]
        [vehicle]
        file = "parts/ned.toml"
    "#;
    let folder = Folder::new("axes", &[("parts/ned.toml", part), ("sea.toml", scene)]);
    let body = folder.scene("sea.toml").unwrap().vehicle.body;
    assert_eq!(body.center_of_mass, Vector3::new(0.0, -0.1, -0.2));
    assert_eq!((body.volume, body.buoyancy), (Some(0.01), None));
}

#[test]
fn the_part_that_needs_the_smallest_step_decides() {
    let arm = |step: &str| format!("[integration]\nintegrator = \"ros2\"\nstep = {step}\n[arm]\nname = \"stick\"\n");
    let arms = "[[arms]]\nname = \"a\"\nfile = \"slow.toml\"\n[[arms]]\nname = \"b\"\nfile = \"fast.toml\"\n";
    let scene = format!("name = \"s\"\n[vehicle]\nfile = \"petasus\"\n{arms}");
    let stated = format!("{scene}[integration]\nintegrator = \"mk4\"\nstep = 0.004\n");
    let files =
        [("slow.toml", arm("0.01")), ("fast.toml", arm("0.002")), ("scene.toml", scene), ("stated.toml", stated)];
    let folder = Folder::new("steps", &files.each_ref().map(|(name, text)| (*name, text.as_str())));
    let integration = |name| folder.scene(name).unwrap().integration();
    assert_eq!((integration("scene.toml").integrator.as_str(), integration("scene.toml").step), ("ros2", 0.002));
    assert_eq!((integration("stated.toml").integrator.as_str(), integration("stated.toml").step), ("mk4", 0.004));
}

#[test]
fn parts_of_parts_move_together() {
    let rig = r#"
        [[arms]]
        file = "pum"
        name = "left"
        mount.frame.position = [0.0, 0.2, 0.0]
        [[arms]]
        file = "pum"
        name = "right"
        mount.frame.position = [0.0, -0.2, 0.0]
    "#;
    let scene = r#"
        name = "rigged"
        [vehicle]
        file = "petasus"
        [[arms]]
        file = "rig.toml"
        name = "rig"
        mount.frame.position = [0.3, 0.0, 0.0]
        [[arms]]
        file = "pum"
        name = "finger"
        on = "rig-left-gripper"
    "#;
    let folder = Folder::new("nested", &[("rig.toml", rig), ("scene.toml", scene)]);
    let scene = folder.scene("scene.toml").unwrap();
    let arm = scene.arm.as_ref().unwrap();
    let index = |name: &str| arm.links.iter().position(|link| link.name == name).unwrap();
    let parent = |name: &str| arm.parent(index(name)).unwrap();
    assert_eq!(parent("rig-base"), Parent::Vehicle);
    assert_eq!(parent("rig-left-base"), Parent::Link(index("rig-base")));
    assert_eq!(parent("rig-right-base"), Parent::Link(index("rig-base")));
    assert_eq!(parent("finger-base"), Parent::Link(index("rig-left-gripper")));
    assert_eq!(scene.end_effector_names(), ["finger", "rig", "rig-left", "rig-right"]);
    assert_eq!(arm.end_effector.on.as_deref(), Some("rig-left-gripper"));
    assert_eq!(arm.links[index("rig-base")].joint.frame.position, Vector3::new(0.3, 0.0, 0.0));
}

#[test]
fn an_arm_may_be_loaded_by_a_joint() {
    let scene = read(
        r#"
        name = "turret"
        [vehicle]
        file = "bluerov2-heavy"
        [[arms]]
        file = "reach-alpha5"
        name = "turret"
        mount.frame = { position = [0.1, 0.0, 0.0], rpy = [3.141592653589793, 0.0, 0.0] }
        mount.joint = { kind = "revolute", axis = [0.0, 0.0, 2.0], frame.position = [0.0, 0.0, 0.05] }
        "#,
    );
    let base = &scene.arm.as_ref().unwrap().links[0];
    assert_eq!(scene.joint_names()[0], "turret-base");
    assert_eq!(base.joint.axis, Vector3::z());
    assert!((base.joint.frame.position - Vector3::new(0.1, 0.0, -0.05)).norm() < 1e-17);
}

#[test]
fn dicts_compose_as_files_do() {
    let tree: Value = TWO_ARMS.parse::<toml::Table>().unwrap().into();
    assert_eq!(Scene::from_value(tree, "<dict>").unwrap(), read(TWO_ARMS));
}
