//! Bias wrench of a body in its central frame.

use proptest::prelude::*;
use uvms_gym::hydro::{CentralFrameTerms, CoefficientFrame, CoefficientMatrix, Damping, FrameRotation, Restoring};
use uvms_gym::lie::{Matrix3, Pose, Vector3, Vector6, exp_se3};
use uvms_gym::spatial::{BodyPoint, SpatialInertia};

/// Bias wrench of the same body by its full matrices.
fn general(body: &CentralFrameTerms<f64>, j: [f64; 3], twist: Vector6<f64>, gravity: Vector3<f64>) -> Vector6<f64> {
    let rotation = match body.rotation {
        FrameRotation::Aligned => Matrix3::identity(),
        FrameRotation::AboutZ(s, c) => Matrix3([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]),
        FrameRotation::General(rows) => Matrix3(rows),
    };
    let pose = Pose { rotation, position: body.origin.coordinates() };
    let [yz, xz, xy] = body.products.unwrap_or([0.0; 3]);
    let [mx, my, mz] = body.masses;
    let inertia =
        SpatialInertia { m: [mx, 0.0, 0.0, my, 0.0, mz], h: [[0.0; 3]; 3], j: [j[0], xy, xz, j[1], yz, j[2]] };
    let [linear, quadratic] = body.damping.unwrap_or_default().map(CoefficientMatrix::Diagonal);
    let frame = CoefficientFrame::General(pose.rotation.0, pose.position.0);
    let drag = Damping { frame, linear, quadratic, linear_bound: None };
    let moment = pose.position.scale(body.net_mass).0;
    let bias = inertia.to_parent(&pose).bias_wrench(twist);
    Restoring { net_mass: body.net_mass, moment }.subtract(gravity, bias - drag.wrench(twist))
}

proptest! {
    #[test]
    fn the_central_form_is_the_general_one(
        point in prop::array::uniform3(-2.0..2.0f64), turn in prop::array::uniform3(-2.0..2.0f64),
        v in prop::array::uniform3(-3.0..3.0f64), w in prop::array::uniform3(-3.0..3.0f64),
        g in prop::array::uniform3(-10.0..10.0f64), numbers in prop::array::uniform32(0.1..5.0f64),
    ) {
        let (twist, gravity) = (Vector6 { linear: Vector3(v), angular: Vector3(w) }, Vector3(g));
        let three = |k: usize| [numbers[k], numbers[k + 1], numbers[k + 2]];
        let six = |k: usize| [0, 1, 2, 3, 4, 5].map(|i| numbers[k + i]);
        let [x, y, z] = point;
        let (sin, cos) = turn[0].sin_cos();
        let whole = exp_se3(Vector6 { linear: Vector3([0.0; 3]), angular: Vector3(turn) }).rotation.0;
        let j = three(0);
        let gyration = [j[2] - j[1], j[0] - j[2], j[1] - j[0]];
        for point in [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z], point] {
            for turn in [FrameRotation::Aligned, FrameRotation::AboutZ(sin, cos), FrameRotation::General(whole)] {
                let products = [None, Some(three(3))];
                let drag = [None, Some([six(9), six(15)])];
                for (products, drag) in products.into_iter().flat_map(|p| drag.map(|d| (p, d))) {
                    let (origin, masses, net_mass) = (BodyPoint::of(point), three(6), numbers[21] - 2.5);
                    let body = CentralFrameTerms { origin, rotation: turn, masses, gyration, products, damping: drag, net_mass };
                    let mut bias = Vector6::zero();
                    body.bias(twist, gravity, &mut bias);
                    let expected = general(&body, j, twist, gravity).to_array();
                    for (got, expected) in bias.to_array().into_iter().zip(expected) {
                        prop_assert!((got - expected).abs() < 1e-11 * (1.0 + expected.abs()), "{body:?}: {got}, {expected}");
                    }
                }
            }
        }
    }
}
