//! Reference paths of an end effector: position and attitude.

use std::f64::consts::PI;

use nalgebra::Vector3;
use uvms_gym::lane::Rows;
use uvms_gym::lie::{self};
use uvms_gym::task::path::*;
use uvms_gym::task::{EETrack, EpisodeKey, Pose, Purpose, Stream};

const KINDS: [PathKind; 6] =
    [PathKind::Point, PathKind::Line, PathKind::Circle, PathKind::FigureEight, PathKind::Spline, PathKind::Mixed];

fn task(reference: PathKind) -> EETrack {
    EETrack { reference, reference_size: 0.4, reference_speed: 0.2, reference_rotation: 0.4, ..EETrack::default() }
}

fn start() -> Pose {
    let rotation = nalgebra::Rotation3::from_euler_angles(0.3, -0.2, 1.0).into_inner();
    Pose { position: Vector3::new(1.0, -2.0, 0.5), rotation }
}

fn drawn(reference: PathKind, seed: u64, period: f64) -> [f64; PATH] {
    let stream = Stream::new(EpisodeKey { seed, episode: 0 }, Purpose::REFERENCE);
    draw_path(&task(reference), &start(), &Vector3::z(), 1.0, period, &stream)
}

fn at(path: &[f64; PATH], ahead: f64) -> PathPoint<f64> {
    path_point(&Rows::of_one(&mut path.clone()), 0, ahead, 1.0)
}

fn vector(v: lie::Vector3<f64>) -> Vector3<f64> {
    v.0.into()
}

fn matrix(pose: &lie::Pose<f64>) -> nalgebra::Matrix3<f64> {
    nalgebra::Matrix3::from_fn(|i, k| pose.rotation.0[i][k])
}

#[test]
fn paths_start_at_rest_where_they_are_to() {
    for (kind, seed) in KINDS.into_iter().flat_map(|kind| (0..20).map(move |seed| (kind, seed))) {
        let point = at(&drawn(kind, seed, 1.0), 0.0);
        assert!((vector(point.pose.position) - start().position).norm() < 1e-14);
        assert!((matrix(&point.pose) - start().rotation).norm() < 1e-14);
        assert_eq!((point.velocity, point.turning), (lie::Vector3::zero(), lie::Vector3::zero()));
    }
}

#[test]
fn the_derivative_of_a_path_is_its_rate() {
    let h = 1e-4;
    for (kind, seed) in KINDS.into_iter().flat_map(|kind| (0..6).map(move |seed| (kind, seed))) {
        let path = drawn(kind, seed, 1.0);
        for k in 1..40 {
            let t = 0.7 * f64::from(k);
            let [before, now, after] = [t - h, t, t + h].map(|t| at(&path, t));
            let velocity = (vector(after.pose.position) - vector(before.pose.position)) / (2.0 * h);
            assert!((velocity - vector(now.velocity)).norm() < 1e-7, "{kind:?} {seed} {t}");
            let skew = (matrix(&after.pose) - matrix(&before.pose)) / (2.0 * h) * matrix(&now.pose).transpose();
            let turning = Vector3::new(skew[(2, 1)], skew[(0, 2)], skew[(1, 0)]);
            assert!((turning - vector(now.turning)).norm() < 1e-7, "{kind:?} {seed} {t}");
        }
    }
}

#[test]
fn paths_stay_within_their_size_and_speed_and_all_but_points_move() {
    for (kind, seed) in KINDS.into_iter().flat_map(|kind| (0..20).map(move |seed| (kind, seed))) {
        let (path, task) = (drawn(kind, seed, 1.0), task(kind));
        // Of two points of a spline within the convex hull of its control points.
        let distance = 2.0 * KNOT_RADIUS * task.reference_size;
        let (mut fastest, mut before) = (0.0f64, at(&path, 0.0));
        for k in 0..800 {
            let point = at(&path, 0.05 * f64::from(k));
            fastest = fastest.max(vector(point.velocity).norm());
            assert!((vector(point.pose.position) - start().position).norm() < distance);
            assert!(vector(point.turning).norm() < 1.5 * TURN_SPEED, "{kind:?}");
            // The rate does not jump: less than 0.5 m/s^2.
            assert!(vector(point.velocity - before.velocity).norm() < 0.025, "{kind:?} {seed} {k}");
            before = point;
        }
        assert!(fastest <= task.reference_speed * 1.001, "{kind:?} {seed}: {fastest}");
        if !matches!(kind, PathKind::Point | PathKind::Mixed) {
            assert!(fastest > 0.15 * task.reference_speed, "{kind:?} {seed}: {fastest}");
        }
    }
}

#[test]
fn period_by_period_a_path_is_the_same_as_from_afar() {
    let from_afar = drawn(PathKind::Spline, 3, 0.05);
    let mut path = from_afar;
    for k in 0..3000 {
        let (near, far) = (at(&path, 1.0), at(&from_afar, f64::from(k + 1)));
        assert!(vector(near.pose.position - far.pose.position).norm() < 1e-11, "{k}");
        assert!((matrix(&near.pose) - matrix(&far.pose)).norm() < 1e-11, "{k}");
        path_advance::<f64>(&mut Rows::of_one(&mut path), 0);
    }
    assert!(path[PHASE].abs() <= PI + 1e-12 && path[PROGRESS] == 1.0);
}

#[test]
fn a_circle_is_one() {
    let path = drawn(PathKind::Circle, 5, 1.0);
    let points: Vec<_> = (0..200).map(|k| vector(at(&path, f64::from(k)).pose.position)).collect();
    // The widest chord through the first point crosses the centre when the lap is fine enough.
    let waves = |at: usize| Vector3::from_column_slice(&path[WAVES + at..][..3]);
    let centre = Vector3::from_column_slice(&path[SHIFT..][..3]);
    let radius = waves(0).norm();
    assert!(points.iter().all(|x| ((x - centre).norm() - radius).abs() < 1e-12));
    assert!(waves(0).dot(&waves(6)).abs() < 1e-12);
}
