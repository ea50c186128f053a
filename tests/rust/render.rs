//! Tests of the renderer.

use std::collections::HashMap;

use nalgebra::{Matrix3, Rotation3, Vector3};
use proptest::prelude::*;
use uvms_gym::description::{ContactGeometry, Scene, Shape, ShapeKind};
use uvms_gym::render::camera::Camera;
use uvms_gym::render::dock::dock;
use uvms_gym::render::hull::hull;
use uvms_gym::render::mesh::Mesh;
use uvms_gym::render::paint::{Paint, Water, decay};
use uvms_gym::render::raster::{Canvas, Corner};
use uvms_gym::render::surroundings::solid;
use uvms_gym::render::{Facets, RenderState, Renderer, Settings, Vector, marks};

const SIZE: [usize; 2] = [64, 48];

fn camera() -> Camera {
    Camera::new(0.0, 0.0, 1.0, SIZE)
}

/// A corner that is seen at a pixel, at a distance ahead.
fn corner([x, y]: [f32; 2], z: f32, colour: [f32; 4]) -> Corner {
    let camera = camera();
    let view = Vector::new((x - camera.centre[0]) / camera.focal * z, (camera.centre[1] - y) / camera.focal * z, z);
    Corner { view, colour }
}

fn cleared() -> Canvas {
    let mut canvas = Canvas::default();
    canvas.clear(SIZE);
    canvas
}

const WHITE: [f32; 4] = [1.0; 4];
/// What blends over black to 128, and once more to 191.
const VEIL: [f32; 4] = [1.0, 1.0, 1.0, 0.502];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn neighbours_leave_no_gap_and_share_no_sample(
        shifts in proptest::collection::vec((-2.4_f32..2.4, -1.9_f32..1.9), 49),
        diagonals in proptest::collection::vec(any::<bool>(), 64),
        distance in 0.5_f32..20.0,
    ) {
        // A net over the whole picture whose inner knots are about anywhere that leaves it a net.
        let knot = |i: usize, k: usize| {
            let inner = (1..8).contains(&i) && (1..8).contains(&k);
            let (dx, dy) = if inner { shifts[(i - 1) * 7 + k - 1] } else { (0.0, 0.0) };
            corner([-8.0 + 10.0 * i as f32 + dx, -8.0 + 8.0 * k as f32 + dy], distance, VEIL)
        };
        let mut canvas = cleared();
        for i in 0..8 {
            for k in 0..8 {
                let [a, b, c, d] = [knot(i, k), knot(i, k + 1), knot(i + 1, k + 1), knot(i + 1, k)];
                let halves = if diagonals[8 * i + k] { [[&a, &b, &c], [&a, &c, &d]] } else { [[&a, &b, &d], [&b, &c, &d]] };
                for half in halves {
                    canvas.triangle(&camera(), half);
                }
            }
        }
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                prop_assert_eq!(canvas.samples(x, y), [0x808080; 4], "pixel {} {}", x, y);
            }
        }
    }

    #[test]
    fn nothing_panics_whatever_the_corners(
        corners in proptest::collection::vec(
            (any::<f32>(), any::<f32>(), any::<f32>()).prop_map(|(x, y, z)| Vector::new(x, y, z)), 3),
        scale in -30_i32..30,
    ) {
        let corners = corners.iter().map(|v| Corner { view: v * (scale as f32).exp2(), colour: WHITE });
        let corners: Vec<Corner> = corners.collect();
        cleared().triangle(&camera(), [&corners[0], &corners[1], &corners[2]]);
    }

    #[test]
    fn nothing_panics_whatever_the_state(
        numbers in proptest::collection::vec(any::<f64>(), 40),
        small in proptest::collection::vec(-3.0_f64..3.0, 40),
        wild in any::<u64>(),
    ) {
        let scene = Scene::shipped("petasus-pum").unwrap();
        let renderer = Renderer::new(&scene, &Settings { size: SIZE, ..Settings::default() }, &Facets::new()).unwrap();
        let n: Vec<f64> = (0..40).map(|i| if wild >> i & 1 == 1 { numbers[i] } else { small[i] }).collect();
        let (vector, matrix) = (|k: usize| Vector3::new(n[k], n[k + 1], n[k + 2]), |k: usize| Matrix3::from_column_slice(&n[k..k + 9]));
        let path = [vector(0), vector(3), vector(24)];
        let shot = RenderState {
            position: vector(0),
            rotation: matrix(3),
            q: &n[12..17],
            thrust: &n[17..23],
            target: Some((vector(23), matrix(26))),
            path: &path,
            point: Some((vector(20), matrix(3))),
            dock: Some((vector(21), matrix(26))),
            trail: &path,
            current: vector(35),
            payload: n[38],
            time: n[39],
        };
        prop_assert_eq!(renderer.draw(&shot).len(), 3 * SIZE[0] * SIZE[1]);
    }
}

#[test]
fn the_nearer_hides_the_farther_in_either_order() {
    let triangle = |z: f32, colour| [[2.0, 2.0], [8.0, 60.0], [60.0, 20.0]].map(|at| corner(at, z, colour));
    let (red, blue) = (triangle(2.0, [1.0, 0.0, 0.0, 1.0]), triangle(3.0, [0.0, 0.0, 1.0, 1.0]));
    for order in [[&red, &blue], [&blue, &red]] {
        let mut canvas = cleared();
        for [a, b, c] in order {
            canvas.triangle(&camera(), [a, b, c]);
        }
        assert_eq!(canvas.samples(20, 20), [0x0000FF; 4]);
    }
}

#[test]
fn backs_are_not_drawn() {
    let [a, b, c] = [[2.0, 2.0], [8.0, 60.0], [60.0, 20.0]].map(|at| corner(at, 2.0, WHITE));
    let mut canvas = cleared();
    canvas.triangle(&camera(), [&a, &c, &b]);
    assert_eq!(canvas.coverage().iter().sum::<usize>(), 0);
    canvas.triangle(&camera(), [&a, &b, &c]);
    assert!(canvas.coverage().iter().sum::<usize>() > 1000);
}

#[test]
fn coverage_is_the_area() {
    let [a, b, c] = [[10.0, 5.0], [14.0, 41.0], [52.0, 23.0]].map(|at| corner(at, 2.0, WHITE));
    let mut canvas = cleared();
    canvas.triangle(&camera(), [&a, &b, &c]);
    let (covered, area) = (canvas.coverage().iter().sum::<usize>() as f32 / 4.0, (36.0 * 42.0 - 4.0 * 18.0) / 2.0);
    assert!((covered - area).abs() < 0.02 * area, "{covered} of {area} pixels");
}

#[test]
fn what_reaches_behind_the_camera_is_cut() {
    // A floor that runs under the camera from far ahead to far behind: it fills all below the horizon.
    let (wide, low) = (1e4_f32, -1.0_f32);
    let at = |x: f32, z: f32| Corner { view: Vector::new(x, low, z), colour: WHITE };
    let (a, b, c, d) = (at(-wide, -wide), at(wide, -wide), at(wide, wide), at(-wide, wide));
    let mut canvas = cleared();
    canvas.triangle(&camera(), [&a, &b, &c]);
    canvas.triangle(&camera(), [&a, &c, &d]);
    for (pixel, samples) in canvas.coverage().into_iter().enumerate() {
        let y = pixel / SIZE[0];
        let expected = if y < SIZE[1] / 2 { 0 } else { 4 };
        assert!(samples == expected || y == SIZE[1] / 2, "row {y}: {samples} samples");
    }
}

/// Closed, counterclockwise as seen from outside, and with normals that point there.
fn assert_solid(mesh: &Mesh, what: &str) {
    let key = |v: &Vector| [v.x, v.y, v.z].map(|x| (x * 1e4).round() as i64);
    let mut edges: HashMap<_, i32> = HashMap::new();
    let mut volume = 0.0;
    for triangle in &mesh.triangles {
        let corners = triangle.map(|k| mesh.vertices[k as usize]);
        let [a, b, c] = corners.map(|v| v.position);
        let cross = (b - a).cross(&(c - a));
        volume += a.dot(&b.cross(&c)) / 6.0;
        if cross.norm() > 1e-7 {
            let outward = corners.iter().map(|v| v.normal).sum::<Vector>();
            assert!(cross.normalize().dot(&outward) > 0.5, "{what}: normals {outward:?} of {a:?} {b:?} {c:?}");
        }
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let (p, q) = (key(&p), key(&q));
            if p < q {
                *edges.entry((p, q)).or_default() += 1;
            } else if q < p {
                *edges.entry((q, p)).or_default() -= 1;
            }
        }
    }
    assert!(volume > 0.0, "{what}: volume {volume}");
    let open = edges.values().filter(|count| **count != 0).count();
    assert_eq!(open, 0, "{what}: open edges");
}

#[test]
fn solids_are_closed_and_face_outward() {
    let paint = Paint::new(0x808080);
    let (a, b) = (Vector::new(0.1, 0.2, 0.3), Vector::new(0.7, -0.4, 1.1));
    type Solid = fn(&mut Mesh, Vector, Vector, Paint);
    let solids: [(&str, Solid); 12] = [
        ("cuboid", |m, a, _, p| m.cuboid(a, Vector::new(1.0, 2.0, 3.0), p)),
        ("chamfered", |m, a, _, p| m.chamfered(a, Vector::new(1.0, 2.0, 3.0), 0.2, p)),
        ("beam", |m, a, b, p| m.beam(a, b, 0.1, p)),
        ("cylinder", |m, a, b, p| m.cylinder(a, b, 0.2, 12, p)),
        ("capsule", |m, a, b, p| m.capsule(a, b, 0.2, 12, p)),
        ("ball", |m, a, _, p| m.capsule(a, a, 0.2, 12, p)),
        ("ellipsoid", |m, a, _, p| m.ellipsoid(a, Vector::new(1.0, 0.6, 0.4), 12, |_| p)),
        ("torus", |m, _, _, p| m.torus(0.5, 0.1, 24, p)),
        ("wall", |m, _, _, p| solid(m, &ContactGeometry::Box { size: Vector3::new(1.0, 9.0, 2.0) }, 0.2, [p, p])),
        ("pipe", |m, _, _, p| solid(m, &ContactGeometry::Cylinder { radius: 0.3, length: 9.0 }, 0.2, [p, p])),
        ("axes", |m, _, _, _| marks::axes(m, 1.0)),
        ("ring", |m, a, _, p| {
            let profile = [(-0.1, 0.8), (-0.1, 1.0), (0.1, 1.0), (0.1, 0.8), (-0.1, 0.8)];
            m.lathe(a, Vector::z(), &profile, 12, false, |_| p);
        }),
    ];
    for (what, make) in solids {
        let mut mesh = Mesh::default();
        make(&mut mesh, a, b, paint);
        assert_solid(&mesh, what);
    }
}

#[test]
fn every_vehicle_is_closed_and_faces_outward() {
    for name in Scene::shipped_names() {
        assert_solid(&hull(&Scene::shipped(name).unwrap(), &Facets::new()).1, name);
    }
    for kind in [ShapeKind::Box, ShapeKind::Ellipsoid, ShapeKind::Torpedo, ShapeKind::Frame, ShapeKind::Lattice] {
        let mut scene = Scene::shipped("bluerov2-heavy").unwrap();
        let size = Vector3::new(1.5, 0.4, 0.5);
        scene.vehicle.shape = Some(Shape { kind, size, ..Shape::default() });
        assert_solid(&hull(&scene, &Facets::new()).1, &format!("{kind:?}"));
    }
}

#[test]
fn without_a_shape_the_box_is_that_of_the_inertia() {
    let mut scene = Scene::shipped("petasus-pum").unwrap();
    scene.vehicle.shape = None;
    let (envelope, ..) = hull(&scene, &Facets::new());
    assert!((envelope.half - Vector::repeat(0.35)).norm() < 1e-4, "{:?}", envelope.half);
}

fn tilted() -> Matrix3<f64> {
    Rotation3::from_euler_angles(0.1, -0.2, 0.3).into_inner()
}

#[test]
fn a_picture_depends_on_the_shot_alone() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let settings = Settings { size: [160, 120], ..Settings::default() };
    let (one, other) = (
        Renderer::new(&scene, &settings, &Facets::new()).unwrap(),
        Renderer::new(&scene, &settings, &Facets::new()).unwrap(),
    );
    let thrust = [50.0, -80.0, 0.0, 20.0, 100.0, -100.0];
    let shot = RenderState {
        position: Vector3::new(0.1, 0.0, 0.05),
        rotation: tilted(),
        thrust: &thrust,
        target: Some((Vector3::zeros(), Matrix3::identity())),
        current: Vector3::new(0.2, 0.1, 0.0),
        time: 3.0,
        ..RenderState::default()
    };
    let first = one.draw(&shot);
    assert_ne!(one.draw(&RenderState { time: 4.0, ..shot }), first);
    assert_eq!(one.draw(&shot), first);
    assert_eq!(other.draw(&shot), first);
}

/// Pixels of the colour that the end effector alone has, as their middle.
fn tip(picture: &[u8], width: usize) -> Option<[f64; 2]> {
    let mut sum = [0.0; 3];
    for (i, pixel) in picture.chunks_exact(3).enumerate() {
        let [r, g, b] = [0, 1, 2].map(|k| f64::from(pixel[k]));
        if r > 1.8 * g && b > 1.6 * g && r > 120.0 {
            sum[0] += (i % width) as f64 + 0.5;
            sum[1] += (i / width) as f64 + 0.5;
            sum[2] += 1.0;
        }
    }
    (sum[2] > 0.0).then(|| [sum[0] / sum[2], sum[1] / sum[2]])
}

#[test]
fn the_end_effector_is_drawn_where_the_kinematics_has_it() {
    for name in ["petasus-pum", "bluerov2-heavy-alpha5"] {
        let scene = Scene::shipped(name).unwrap();
        let kinematics = uvms_gym::system::EndEffector::new(&scene);
        let renderer = Renderer::new(&scene, &Settings::default(), &Facets::new()).unwrap();
        for (step, azimuth) in [(0.0, 0.0), (0.15, 0.1), (-0.2, 0.0)] {
            let mut q = scene.home();
            q.iter_mut().take(renderer.joints()).for_each(|q| *q += step);
            let rotation = Rotation3::from_euler_angles(0.05, 0.1, azimuth).into_inner();
            let shot = RenderState {
                position: Vector3::new(0.02, 0.03, -0.01),
                rotation,
                q: &q[..renderer.joints()],
                ..RenderState::default()
            };
            let end = shot.position + rotation * kinematics.pose(&q).1;
            let [x, y, _] = renderer.project(&shot, &end).unwrap();
            let [u, v] = tip(&renderer.draw(&shot), renderer.size()[0]).expect("a pixel of the end effector's colour");
            assert!((x - u).hypot(y - v) < 3.0, "{name}: {x} {y}, but drawn at {u} {v}");
        }
    }
}

#[test]
fn what_is_farther_away_looks_more_like_the_water() {
    let water = Water::new(true, 4.0, Vector::new(0.0, 0.6, 0.8));
    let paint = Paint::new(0xFFC020);
    let to_eye = Vector::x();
    let off = |way: f32| {
        let (seen, water) = (water.shade(&paint, &Vector::z(), &to_eye, way), water.colour(0.0));
        (0..3).map(|k| (seen[k] - water[k]).abs()).sum::<f32>()
    };
    assert!(off(1.0) > off(4.0) && off(4.0) > off(20.0) && off(20.0) > off(100.0));
    assert!(off(400.0) < 1e-3);
    for x in [0.0_f32, 0.3, 1.0, 3.0] {
        assert!((decay(x) - (-x).exp()).abs() < 0.01, "exp(-{x})");
    }
}

#[test]
fn a_vehicle_casts_a_shadow_on_the_floor() {
    let scene = Scene::shipped("rexrov").unwrap();
    let renderer = Renderer::new(&scene, &Settings::default(), &Facets::new()).unwrap();
    let brightness = |away: f64, point: Vector3<f64>| {
        // Looked at from the same place.
        let shot = RenderState {
            position: Vector3::new(0.0, 0.0, away),
            rotation: Matrix3::identity() * if away == 0.0 { 1.0 } else { f64::NAN },
            target: None,
            ..RenderState::default()
        };
        let [x, y, _] = renderer.project(&RenderState::default(), &point).unwrap();
        let at = 3 * (y as usize * renderer.size()[0] + x as usize);
        renderer.draw(&shot)[at..at + 3].iter().map(|c| f64::from(*c)).sum::<f64>()
    };
    // In front of the vehicle's foot, where its shadow falls but it hides nothing.
    let places = (0..40).map(|k| Vector3::new(0.1 * f64::from(k), -0.1 * f64::from(k), renderer.floor()));
    let darker = places.filter(|p| renderer.project(&RenderState::default(), p).is_some_and(|[_, y, _]| y < 470.0));
    assert!(darker.into_iter().any(|p| brightness(0.0, p) < 0.8 * brightness(1.0, p)));
}

#[test]
fn settings_out_of_range_are_refused() {
    let scene = Scene::shipped("free-body").unwrap();
    let default = Settings::default();
    for settings in [
        Settings { size: [0, 48], ..default },
        Settings { size: [64, 5000], ..default },
        Settings { azimuth: Some(f64::NAN), ..default },
        Settings { elevation: 1.6, ..default },
        Settings { distance: Some(0.0), ..default },
        Settings { floor: Some(f64::INFINITY), ..default },
    ] {
        assert!(Renderer::new(&scene, &settings, &Facets::new()).is_err(), "{settings:?}");
    }
}

#[test]
fn a_vehicle_far_from_its_target_stays_in_the_picture() {
    let scene = Scene::shipped("petasus-pum").unwrap();
    let renderer = Renderer::new(&scene, &Settings::default(), &Facets::new()).unwrap();
    let target = Some((Vector3::zeros(), Matrix3::identity()));
    let place = |position| {
        let shot = RenderState { position, target, ..RenderState::default() };
        [position, Vector3::zeros()].map(|p| renderer.project(&shot, &p).expect("ahead of the camera"))
    };
    // Near the target the camera stays where it is.
    assert_eq!(place(Vector3::new(0.05, 0.0, 0.0))[1], place(Vector3::zeros())[1]);
    for away in [Vector3::new(9.0, 0.0, 0.0), Vector3::new(0.0, -9.0, 2.0), Vector3::new(0.0, 0.0, -9.0)] {
        let [[x, y, _], _] = place(away);
        assert!((0.0..640.0).contains(&x) && (0.0..480.0).contains(&y), "{away:?} at {x} {y}");
    }
}

#[test]
fn docks_are_closed_and_face_outward() {
    for name in Scene::shipped_names() {
        let mut mesh = Mesh::default();
        let envelope = hull(&Scene::shipped(name).unwrap(), &Facets::new()).0;
        dock(&mut mesh, &envelope);
        assert_solid(&mesh, name);
        // The vehicle has room.
        let outside = |v: &Vector| (v - envelope.middle).zip_map(&envelope.half, |x, half| x.abs() / half).max() > 1.0;
        assert!(mesh.vertices.iter().all(|v| outside(&v.position)), "{name}");
    }
}

#[test]
fn dock_and_reference_are_in_the_picture_of_a_vehicle_far_from_them() {
    let scene = Scene::shipped("bluerov2-heavy-alpha5").unwrap();
    let renderer = Renderer::new(&scene, &Settings::default(), &Facets::new()).unwrap();
    let near =
        Renderer::new(&scene, &Settings { distance: Some(renderer.distance()), ..Settings::default() }, &Facets::new())
            .unwrap();
    let inside = |renderer: &Renderer, shot: &RenderState<'_>, point| {
        let seen = renderer.project(shot, &point);
        seen.is_some_and(|[x, y, _]| (0.0..640.0).contains(&x) && (0.0..480.0).contains(&y))
    };
    for away in [Vector3::new(5.0, 0.0, 0.0), Vector3::new(0.0, -3.0, 1.0), Vector3::new(-1.0, 2.0, -3.0)] {
        let pose = Some((away, tilted()));
        let default = RenderState::default();
        for shot in [RenderState { dock: pose, ..default }, RenderState { point: pose, ..default }] {
            assert!(inside(&renderer, &shot, away) && inside(&renderer, &shot, Vector3::zeros()), "{away:?}");
            assert!(!inside(&near, &shot, away), "{away:?} from the distance that was asked for");
        }
    }
}
