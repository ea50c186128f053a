//! Adjoint of fins; of the force in the plane of chord and normal by dual numbers.

use super::fin::{FINS, Fin, FinAxes};
use crate::lane::{Dual, Lane};
use crate::lie::{Vector3, Vector6};

impl<L: Lane> FinAxes<L> {
    /// Cotangent of the twist from that of [`FinAxes::wrench`]; adds those of chords and normals.
    #[inline(always)]
    pub fn wrench_adjoint(&self, fins: &[Fin<L>], twist: Vector6<L>, of: Vector6<L>, of_axes: &mut Self) -> Vector6<L> {
        let (zero, one) = (L::zero(), L::c(1.0));
        let mut of_twist = Vector6::zero();
        for (i, fin) in fins.iter().enumerate().take(FINS) {
            let [chord, normal] = self.0[i];
            let r = Vector3(fin.position);
            let v = twist.angular.cross_add(r, twist.linear);
            let (u, w) = (v.dot(chord), v.dot(normal));
            let of_force = of.angular.cross_add(r, of.linear);
            let (of_along, of_across) = (of_force.dot(chord), of_force.dot(normal));
            let by_u = fin.force(Dual::new(u, one), Dual::new(w, zero));
            let by_w = fin.force(Dual::new(u, zero), Dual::new(w, one));
            let of_u = by_u[0].slope.mul_add(of_along, by_u[1].slope * of_across);
            let of_w = by_w[0].slope.mul_add(of_along, by_w[1].slope * of_across);
            let [of_chord, of_normal] = &mut of_axes.0[i];
            *of_chord = of_force.scale_add(by_u[0].value, v.scale_add(of_u, *of_chord));
            *of_normal = of_force.scale_add(by_u[1].value, v.scale_add(of_w, *of_normal));
            let of_v = normal.scale_add(of_w, chord.scale(of_u));
            of_twist = Vector6 { linear: of_twist.linear + of_v, angular: r.cross_add(of_v, of_twist.angular) };
        }
        of_twist
    }

    /// Cotangents of the deflections from those of chords and normals.
    #[inline(always)]
    pub fn deflect_adjoint(&self, of_axes: &Self, count: usize) -> [L; FINS] {
        let mut of = [L::zero(); FINS];
        for i in 0..count.min(FINS) {
            let ([chord, normal], [of_chord, of_normal]) = (self.0[i], of_axes.0[i]);
            of[i] = of_normal.dot(chord) - of_chord.dot(normal);
        }
        of
    }
}
