//! Contact by its law as it is stated: nearest points, penetration, and the forces.

use nalgebra::{Vector2, Vector3};

use super::se3::DensePose;
use crate::description::{ContactGeometry, ContactLaw};

/// A sphere, or a shape, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingFrame {
    /// Pose of the sphere's centre or of the shape.
    pub pose: DensePose,
    /// Absolute velocity of its origin, world axes, m/s.
    pub velocity: Vector3<f64>,
    /// Spin, world axes, rad/s.
    pub spin: Vector3<f64>,
}

/// Contact of a sphere with a shape, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseContact {
    /// Penetration, m; negative where they are apart.
    pub depth: f64,
    /// Outward normal of the shape.
    pub normal: Vector3<f64>,
    /// Point of action, m.
    pub point: Vector3<f64>,
    /// Force on the sphere, N.
    pub force: Vector3<f64>,
    /// Normal force, N.
    pub normal_force: f64,
    /// Speed of sliding, m/s.
    pub slip: f64,
    /// Elastic energy, J.
    pub energy: f64,
    /// Power that dissipation and friction put into sphere and shape together, W.
    pub power: f64,
}

/// Outward normal of a solid `|x_k| <= half_k` in each of the coordinates, at the point of its surface nearest to x.
fn of_intervals<const K: usize>(x: [f64; K], half: [f64; K]) -> [f64; K] {
    let offset: [f64; K] = std::array::from_fn(|k| x[k] - x[k].clamp(-half[k], half[k]));
    let distance = offset.iter().map(|d| d * d).sum::<f64>().sqrt();
    if distance > 0.0 {
        return offset.map(|d| d / distance);
    }
    let nearest = (0..K).fold(0, |best, k| if x[k].abs() - half[k] > x[best].abs() - half[best] { k } else { best });
    std::array::from_fn(|k| if k == nearest { 1f64.copysign(x[k]) } else { 0.0 })
}

/// Outward normal at the point of the surface nearest to a point in the shape's frame.
fn normal(geometry: &ContactGeometry, point: &Vector3<f64>) -> Vector3<f64> {
    let radial = Vector2::new(point.x, point.y);
    let rho = radial.norm();
    let outward = if rho > 0.0 { radial / rho } else { Vector2::zeros() };
    let turned = |[across, along]: [f64; 2]| Vector3::new(outward.x * across, outward.y * across, along);
    match *geometry {
        ContactGeometry::Plane => Vector3::z(),
        ContactGeometry::Box { size } => of_intervals((*point).into(), (size / 2.0).into()).into(),
        ContactGeometry::Cylinder { radius, length } => turned(of_intervals([rho, point.z], [radius, length / 2.0])),
        ContactGeometry::Torus { radius, .. } => turned(Vector2::new(rho - radius, point.z).normalize().into()),
    }
}

impl DenseContact {
    /// Contact of a sphere of this radius with a shape.
    pub fn new(
        sphere: &MovingFrame,
        radius: f64,
        shape: &MovingFrame,
        geometry: &ContactGeometry,
        law: &ContactLaw,
    ) -> Self {
        let center = sphere.pose.position;
        let in_shape = shape.pose.rotation.tr_mul(&(center - shape.pose.position));
        let normal = shape.pose.rotation * normal(geometry, &in_shape);
        let depth = radius - geometry.distance(&in_shape);
        let point = center - normal * (radius - depth / 2.0);
        let of_point = |body: &MovingFrame| body.velocity + body.spin.cross(&(point - body.pose.position));
        let velocity = of_point(sphere) - of_point(shape);
        let rate = -normal.dot(&velocity);
        let slip = velocity + normal * rate;
        let elastic = law.stiffness * effective_depth(depth, law.ramp);
        let normal_force = elastic * (1.0 + law.dissipation * rate).max(0.0);
        let friction = match slip.norm() {
            0.0 => Vector3::zeros(),
            speed => slip * (-law.friction * normal_force / speed.hypot(law.slip_speed)),
        };
        Self {
            depth,
            normal,
            point,
            force: normal * normal_force + friction,
            normal_force,
            slip: slip.norm(),
            energy: law.stiffness * depth_integral(depth, law.ramp),
            power: friction.dot(&slip) - (normal_force - elastic) * rate,
        }
    }
}

/// s of the law, m.
fn effective_depth(depth: f64, ramp: f64) -> f64 {
    if depth <= 0.0 {
        0.0
    } else if depth < ramp {
        depth.powi(3) / ramp.powi(2) * (1.0 - depth / (2.0 * ramp))
    } else {
        depth - ramp / 2.0
    }
}

/// Integral of s over the depth, m2.
fn depth_integral(depth: f64, ramp: f64) -> f64 {
    if depth <= 0.0 {
        0.0
    } else if depth < ramp {
        depth.powi(4) / ramp.powi(2) * (0.25 - depth / (10.0 * ramp))
    } else {
        // 3/20 e^2 on the ramp, and x^2/2 - e x/2 from there on.
        0.15 * ramp * ramp + 0.5 * (depth * depth - ramp * depth)
    }
}
