//! Damping by forward speed.
//!
//! `F = -u D V` with the twist V relative to the water at a point of the vehicle, its forward component u and a 6x6 matrix D: the
//! hydrodynamic derivatives X_uu, Y_uv, Y_ur, Z_uw, Z_uq, K_up, M_uw, M_uq, N_uv and N_ur with the opposite sign. Models of
//! torpedo-shaped vehicles publish no other damping of sway, heave, pitch and yaw `[P01]`; uuv_simulator has the same form
//! (`linear_damping_forward_speed`, with the signs of the derivatives). Astern, u and with it the wrench change sign, as in these models:
//! coefficients are measured ahead, and there only a damping takes energy.

use nalgebra as na;
use serde::{Deserialize, Serialize};

use super::{DenseInstant, Factors, Medium, Term, TermInstant, TermTable, dense_force_at};
use crate::keys::{Fault, flip, flip_matrix, numbers as forms};
use crate::lane::{Lane, Param, get_all, numbers};
use crate::lie::{Vector3, Vector6};

/// Damping by forward speed, `F = -u D V`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ForwardDamping {
    /// Point of the coefficients in the vehicle frame, m.
    #[serde(default, with = "forms::vector3")]
    pub position: na::Vector3<f64>,
    /// D: six diagonal numbers or six rows of six. N s2/m2, N s2/(m rad), N m s2/m2, N m s2/(m rad).
    #[serde(with = "forms::matrix6")]
    pub matrix: na::Matrix6<f64>,
}

/// Motions in one degree of freedom.
const PURE: [&str; 6] = ["surge", "sway", "heave", "roll", "pitch", "yaw"];
/// Negative eigenvalue of the symmetric part that counts as rounding, relative to its largest entry.
const ROUNDING: f64 = 1e-6;

impl TermTable for ForwardDamping {
    type Term = ForwardDampingTerm<f64>;
    const DAMPING: bool = true;

    fn check(_: &[Self], _: &str) -> Result<(), Fault> {
        Ok(())
    }

    fn warnings(&self, key: &str) -> Vec<(String, String)> {
        let key = format!("{key}.matrix");
        let pure: Vec<_> = (0..6).filter(|&i| self.matrix[(i, i)] < 0.0).map(|i| PURE[i]).collect();
        if !pure.is_empty() {
            let text = format!("adds energy ahead in pure {}: opposite sign?", pure.join(", "));
            return vec![(key, text)];
        }
        let symmetric = (self.matrix + self.matrix.transpose()) / 2.0;
        let minimum = symmetric.symmetric_eigenvalues().min();
        if minimum < -ROUNDING * symmetric.amax() {
            return vec![(
                key,
                format!("adds energy ahead in some motions: minimum eigenvalue {minimum:.4} of its symmetric part"),
            )];
        }
        Vec::new()
    }

    fn flip_axes(&mut self) {
        flip(&mut self.position);
        flip_matrix(&mut self.matrix);
    }

    fn scale_linear_damping(&mut self, factor: f64) {
        self.matrix *= factor;
    }

    fn compile(&self, _: &Medium) -> Option<Self::Term> {
        let six = [0, 1, 2, 3, 4, 5];
        let term = ForwardDampingTerm {
            position: self.position.into(),
            matrix: six.map(|i| six.map(|k| self.matrix[(i, k)])),
            factor: 1.0,
        };
        (self.matrix.amax() != 0.0).then_some(term)
    }

    fn dense_wrench(&self, _: usize, at: &DenseInstant) -> na::Vector6<f64> {
        let (velocity, angular) = (at.velocity(&self.position), at.relative.fixed_rows::<3>(3));
        let there = na::Vector6::from_iterator(velocity.iter().chain(angular.iter()).copied());
        let wrench = self.matrix * there * -velocity.x;
        let [fx, fy, fz, mx, my, mz] = wrench.into();
        dense_force_at(na::Vector3::new(fx, fy, fz), &self.position) + na::Vector6::new(0.0, 0.0, 0.0, mx, my, mz)
    }
}

numbers! {
    /// Compiled damping by forward speed.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct ForwardDampingTerm<P> {
        /// Point of the coefficients in the vehicle frame, m.
        pub position: [P; 3],
        /// D, by rows.
        pub matrix: [[P; 6]; 6],
        /// Factor on D: an instance's factor on linear damping.
        pub factor: P = unvisited,
    }
}

impl<P: Copy> ForwardDampingTerm<P> {
    /// Wrench `-u factor D V`, vehicle frame.
    #[inline(always)]
    fn scaled_wrench<L: Lane>(&self, factor: L, twist: Vector6<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let velocity = twist.angular.cross_add(r, twist.linear);
        let there = Vector6 { linear: velocity, ..twist }.to_array();
        let scale = -(velocity.0[0] * factor);
        let mut wrench = [L::zero(); 6];
        for i in 0..6 {
            let row: [L; 6] = get_all(&self.matrix[i]);
            for k in 0..6 {
                wrench[i] = row[k].mul_add(there[k], wrench[i]);
            }
            wrench[i] = wrench[i] * scale;
        }
        let Vector6 { linear, angular } = Vector6::from_array(wrench);
        Vector6 { linear, angular: r.cross_add(linear, angular) }
    }
}

impl<P: Copy> Term<P> for ForwardDampingTerm<P> {
    #[inline(always)]
    fn add_wrench<L: Lane>(&self, _: usize, at: &TermInstant<L>, sum: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        *sum = *sum + self.scaled_wrench(self.factor.get(), at.twist);
    }

    #[inline(always)]
    fn set_factors(&mut self, factors: &Factors<P>) {
        self.factor = factors.linear_damping;
    }

    #[inline(always)]
    fn add_factor_cotangents<L: Lane>(&self, at: &TermInstant<L>, of: Vector6<L>, sums: &mut Factors<L>)
    where
        P: Param<L>,
    {
        sums.linear_damping += of.dot(self.scaled_wrench(L::c(1.0), at.twist));
    }
}
