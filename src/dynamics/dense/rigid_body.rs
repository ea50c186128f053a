//! Rigid body in water: inertia, bias, damping and restoring wrenches.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::se3::{DensePose, ad, angular, blocks, force_at, linear, stack};
use crate::description::{Body, Water};

/// Constants of a body in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseBody {
    /// Rigid inertia A about the frame origin, kg, kg m, kg m2. `[HC eq. 5]`
    pub rigid: Matrix6<f64>,
    /// Added mass A_A at the body frame. `[HC eq. 22]`
    pub added: Matrix6<f64>,
    mass: f64,
    center_of_mass: Vector3<f64>,
    /// Mass of the displaced water, kg.
    displaced: f64,
    center_of_buoyancy: Vector3<f64>,
    pub(crate) hydrodynamic: DensePose,
    pub(crate) linear_damping: Matrix6<f64>,
    pub(crate) quadratic_damping: Matrix6<f64>,
}

impl DenseBody {
    /// Constants of `body` in `water`.
    pub fn new(body: &Body, water: &Water) -> Self {
        let c = body.center_of_mass.cross_matrix();
        let m = body.mass;
        let hydrodynamic = DensePose::from_frame(&body.hydrodynamic_frame);
        let to_hydrodynamic = hydrodynamic.adjoint_inverse();
        Self {
            rigid: blocks(Matrix3::identity() * m, c * -m, c * m, body.inertia_about_com() - c * c * m),
            added: to_hydrodynamic.tr_mul(&body.added_mass) * to_hydrodynamic,
            mass: m,
            center_of_mass: body.center_of_mass,
            displaced: water.density * body.displaced_volume(water),
            center_of_buoyancy: body.center_of_buoyancy,
            hydrodynamic,
            linear_damping: body.damping.linear,
            quadratic_damping: body.damping.quadratic,
        }
    }

    /// A + A_A. `[HC eq. 26]`
    pub fn inertia(&self) -> Matrix6<f64> {
        self.rigid + self.added
    }

    /// Bias wrench: `A V' + B V + A_A V_r' + B_A V_r` less `(A + A_A) V'`; `water` is the current in body axes, m/s.
    ///
    /// `B V = -ad_V^T A V` and `B_A V_r = -ad_V_r^T A_A V_r`. Under a current that is constant in the world,
    /// `V_r' = V' + [omega x R^T v_c; 0]`.
    pub fn bias(&self, twist: &Vector6<f64>, water: &Vector3<f64>) -> Vector6<f64> {
        let relative = relative_twist(twist, water);
        let turning = stack(&angular(twist).cross(water), &Vector3::zeros());
        self.added * turning - ad(twist).tr_mul(&(self.rigid * twist)) - ad(&relative).tr_mul(&(self.added * relative))
    }

    /// Damping wrench `-(D_L V_r + D_Q (V_r * |V_r|))` of the twist relative to the water, at the body frame. `[HC eq. 22]`
    ///
    /// The law holds in the frame of its coefficients: the twist is transformed to it, and the wrench back.
    pub fn damping(&self, relative: &Vector6<f64>) -> Vector6<f64> {
        let there = self.hydrodynamic.adjoint_inverse() * relative;
        let squared = there.component_mul(&there.abs());
        let resistance = self.linear_damping * there + self.quadratic_damping * squared;
        self.hydrodynamic.wrench_to_parent(&-resistance)
    }

    /// Weight at the centre of mass and buoyancy at the centre of buoyancy; `gravity` in body axes, m/s2. `[HC eq. 24]`
    pub fn restoring(&self, gravity: &Vector3<f64>) -> Vector6<f64> {
        force_at(&(gravity * self.mass), &self.center_of_mass)
            - force_at(&(gravity * self.displaced), &self.center_of_buoyancy)
    }

    /// Wrench of the water's acceleration: pressure gradient at the centre of buoyancy, and added mass; `acceleration` in body
    /// axes, m/s2.
    pub fn flow_acceleration(&self, acceleration: &Vector3<f64>) -> Vector6<f64> {
        force_at(&(acceleration * self.displaced), &self.center_of_buoyancy)
            + self.added * stack(acceleration, &Vector3::zeros())
    }

    /// Potential energy of weight and buoyancy, J, 0 at the world origin; `pose` and `gravity` in the world.
    pub fn potential(&self, pose: &DensePose, gravity: &Vector3<f64>) -> f64 {
        let at = |point: &Vector3<f64>| gravity.dot(&(pose.rotation * point + pose.position));
        self.displaced * at(&self.center_of_buoyancy) - self.mass * at(&self.center_of_mass)
    }
}

/// `V_r = V - [R^T v_c; 0]`; `water` is the current in body axes. `[HC eq. 23]`
pub fn relative_twist(twist: &Vector6<f64>, water: &Vector3<f64>) -> Vector6<f64> {
    stack(&(linear(twist) - water), &angular(twist))
}
