//! Masses and moments of imported robots: from densities, meshes and outlines, and impossible ones.

use nalgebra::{Matrix3, Vector3};
use uvms_gym::robot::{Assembly, Imported, Mesh, MeshInertia, Robot};

use super::whole::{accepted, assembled, says};
use super::{joint, link, robot};

#[test]
fn masses_follow_from_densities_and_moments_from_outlines() {
    let box_ = "<collision><geometry><box size='0.1 0.2 0.3'/></geometry></collision>";
    let bare = |name: &str| format!("<link name='{name}'>{box_}</link>\n");
    let text = robot(&(bare("foot") + &bare("arm") + &joint("j", "continuous", "foot", "arm", "")));
    let message = assembled(&text, &Assembly::default()).unwrap_err().to_string();
    assert!(message.contains("no link has a mass (foot, arm)") && message.contains("--density"), "{message}");
    let density = [(None, 500.0), (Some("arm".to_owned()), 2000.0)];
    let Imported { scene, notes } = assembled(&text, &Assembly { density: &density, ..Assembly::default() }).unwrap();
    let arm = scene.arm.unwrap();
    assert!(
        (arm.base.unwrap().mass - 3.0).abs() < 1e-6 && (arm.links[0].body.as_ref().unwrap().mass - 12.0).abs() < 1e-6
    );
    assert!((arm.links[0].body.as_ref().unwrap().inertia[(0, 0)] - 12.0 * 0.13 / 12.0).abs() < 1e-6);
    assert!(says(&notes, "arm: 12.0000 kg", "2000 kg/m3"), "{notes:?}");
    for (wrong, problem) in [((Some("leg".to_owned()), 1.0), "no link \"leg\""), ((None, -1.0), "must be > 0")] {
        let message = assembled(&text, &Assembly { density: &[wrong], ..Assembly::default() }).unwrap_err().to_string();
        assert!(message.contains(problem), "{message}");
    }
    // A measured mesh stands for a shape: a box of its volume and proportions.
    let mut robot = Robot::from_text(&text, "robot.urdf").unwrap();
    robot.links[1].shapes.clear();
    let corner = Some(Vector3::new(0.1, 0.2, 0.3));
    let mesh = Mesh { volume: Some(0.003), lower: Some(Vector3::zeros()), upper: corner, ..Mesh::default() };
    robot.links[1].meshes.push(mesh);
    let body = Assembly { density: &density, ..Assembly::default() }.of(&robot).unwrap().scene.arm.unwrap().links[0]
        .body
        .clone()
        .unwrap();
    assert!((body.mass - 6.0).abs() < 1e-6 && (body.volume.unwrap() - 0.003).abs() < 1e-9);
    // Two halves of a box, one of them in turned axes, have the moments of the box.
    let half = |size: Vector3<f64>, x: f64, turn: f64| {
        let square = size.component_mul(&size) * size.product() / 12.0;
        Mesh {
            position: Vector3::new(x, 0.1, 0.0),
            rpy: Vector3::new(0.0, 0.0, turn),
            volume: Some(size.product()),
            center: Some(Vector3::zeros()),
            inertia: Some(MeshInertia(Matrix3::from_diagonal(&square.map(|s| square.sum() - s)))),
            lower: Some(-size / 2.0),
            upper: Some(size / 2.0),
            ..Mesh::default()
        }
    };
    let (near, far) = (Vector3::new(0.25, 0.2, 0.3), Vector3::new(0.2, 0.25, 0.3));
    robot.links[1].meshes = vec![half(near, 0.0, 0.0), half(far, 0.25, std::f64::consts::FRAC_PI_2)];
    let body = Assembly { density: &density, ..Assembly::default() }.of(&robot).unwrap().scene.arm.unwrap().links[0]
        .body
        .clone()
        .unwrap();
    let square = Vector3::new(0.25, 0.04, 0.09) * 60.0 / 12.0;
    let moments = Matrix3::from_diagonal(&square.map(|s| square.sum() - s));
    assert!((body.inertia - moments).amax() < 1e-12 && (body.mass - 60.0).abs() < 1e-12);
    assert!((body.center_of_mass - Vector3::new(0.125, 0.1, 0.0)).amax() < 1e-12);
}

#[test]
fn moments_that_no_body_has_are_replaced_or_merged_with_a_note() {
    let with = |moments: [f64; 3]| {
        let [x, y, z] = moments;
        let inertia = format!("<inertia ixx='{x}' ixy='0' ixz='0' iyy='{y}' iyz='0' izz='{z}'/>");
        format!("<link name='hull'><inertial><mass value='10'/>{inertia}</inertial></link>")
    };
    let Imported { scene, notes } = accepted(&robot(&with([5.0, 1.0, 1.0])));
    let inertia = scene.vehicle.body.inertia;
    let factor = 2.5f64.sqrt();
    assert!(
        (inertia - Matrix3::from_diagonal(&Vector3::new(5.0 / factor, factor, factor))).amax() < 1e-12,
        "{inertia}"
    );
    assert!(says(&notes, "hull (line 2)", "1.0000e0, 1.0000e0, 5.0000e0"), "{notes:?}");
    // Fixed to a body, it is a part of a body's moments.
    let frame = with([5.0, 1.0, 1.0]).replace("hull", "frame") + &link("hull").replace("'1'", "'20'");
    let Imported { scene, notes } = accepted(&robot(&(frame + &joint("f", "fixed", "hull", "frame", ""))));
    assert!((scene.vehicle.body.inertia[(0, 0)] - 25.0).abs() < 1e-12);
    assert!(says(&notes, "frame", "with the links fixed to it they are"), "{notes:?}");
}

#[test]
fn meshes_far_too_large_for_their_mass_are_left_out() {
    let text = robot(&(link("foot") + &link("arm") + &joint("j", "continuous", "foot", "arm", "")));
    let mut robot = Robot::from_text(&text, "robot.urdf").unwrap();
    let edge = Vector3::repeat(1.0);
    let mesh = Mesh { volume: Some(0.009), lower: Some(-edge), upper: Some(edge), ..Mesh::default() };
    let mut of = |volume: f64| {
        robot.links[1].meshes = vec![Mesh { volume: Some(volume), ..mesh.clone() }];
        let Imported { scene, notes } = Assembly::default().of(&robot).unwrap();
        (scene.arm.unwrap().links[0].body.as_ref().unwrap().volume.unwrap_or(0.0), notes)
    };
    // The link has 1 kg: 111, 91 and 1e-6 kg/m3.
    let (volume, notes) = of(0.009);
    assert!((volume - 0.009).abs() < 1e-12 && !says(&notes, "arm", "left out"), "{notes:?}");
    for (large, cause) in [(0.011, "not closed"), (1e6, "in millimetres, scale 0.001?")] {
        let (volume, notes) = of(large);
        assert!(volume < 0.009, "{volume}");
        assert!(says(&notes, "arm: ", cause), "{notes:?}");
    }
}
