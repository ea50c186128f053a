//! Fins and other lifting surfaces. `[HC eq. 21, F_PL]` `[F21]`
//!
//! Forces act in the plane of the chord c and the normal n. With the components u, w of the fin's velocity through the water, `V^2 = u^2 + w^2`, angle of attack `tan alpha = -w / u`,
//!
//! ```text
//! lift = q A C_L,  C_L = ((1 - s) a + s C_90) sin alpha cos alpha      across the flow, towards n for alpha > 0
//! drag = q A C_D,  C_D = C_D0 + (1 - s) k (a sin alpha cos alpha)^2 + s C_90 sin^2 alpha      against it
//! q = rho V^2 / 2,     s = x^4 / (1 + x^4),     x = sin^2 alpha / sin^2 alpha_stall
//! ```
//!
//! with the lift slope a at small angles and the stalled fraction s: one half at the stall angle, negligible well below it. Past
//! stall the fin is a flat plate, whose normal force has the coefficient `C_90 sin alpha`. The law is the same for motion
//! backward and forward, and smooth in the velocity.

use crate::lane::{Lane, Param, get_all, numbers, sin_cos};
use crate::lie::{Vector3, Vector6};

/// Maximum number of fins of a vehicle.
pub const FINS: usize = 8;

numbers! {
    /// A fin, in vehicle axes.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Fin<P> {
        /// Centre of pressure, m.
        pub position: [P; 3],
        /// Unit vector towards the leading edge at deflection 0.
        pub chord: [P; 3],
        /// Unit vector normal to chord and span at deflection 0.
        pub normal: [P; 3],
        /// Deflection without command, rad.
        pub deflection: P,
        /// Minimum and maximum deflection, rad.
        pub limits: [P; 2],
        /// `rho A a / 2`
        pub lift: P,
        /// `rho A C_D0 / 2`
        pub drag: Option<P>,
        /// `rho A k a^2 / 2`
        pub induced: Option<P>,
        /// `1 / sin^2 alpha_stall` and `rho A C_90 / 2`
        pub stall: Option<[P; 2]>,
    }
}

impl<P: Copy> Fin<P> {
    /// Components of the force along chord and normal, N, at the velocity components `u` and `w` through the water, m/s.
    #[inline(always)]
    pub(super) fn force<L: Lane>(&self, u: L, w: L) -> [L; 2]
    where
        P: Param<L>,
    {
        let square = u.mul_add(u, w.mul_add(w, L::c(MIN_SPEED_SQUARED)));
        let (speed, sin2) = (square.sqrt(), w * w / square);
        let (mut lift, mut drag) = (self.lift.get(), L::zero());
        if let Some(induced) = self.induced {
            drag = induced.get() * sin2 * (L::c(1.0) - sin2);
        }
        if let Some([sharpness, plate]) = self.stall {
            let x = sin2 * sharpness.get();
            let x4 = (x * x) * (x * x);
            let stalled = x4 / (x4 + L::c(1.0));
            let plate: L = plate.get();
            lift = stalled.mul_add(plate - lift, lift);
            drag = stalled.mul_add(plate * sin2 - drag, drag);
        }
        if let Some(parasitic) = self.drag {
            drag += parasitic.get();
        }
        let (across, against) = (lift * u * w / speed, drag * speed);
        [across.mul_add(w, -(against * u)), -across.mul_add(u, against * w)]
    }
}

/// Added to squared speeds, m2/s2, to keep quotients finite at rest.
pub(super) const MIN_SPEED_SQUARED: f64 = 1e-30;

/// Chords and normals of the deflected fins.
#[derive(Debug, Clone, Copy)]
pub struct FinAxes<L>(pub(super) [[Vector3<L>; 2]; FINS]);

impl<L: Lane> FinAxes<L> {
    /// Zeros, to be overwritten.
    #[inline(always)]
    pub fn blank() -> Self {
        Self([[Vector3::zero(); 2]; FINS])
    }

    /// Rotates each fin about its axis, which is normal to chord and normal.
    #[inline(always)]
    pub fn deflect<P: Param<L>>(&mut self, fins: &[Fin<P>], deflections: &[L; FINS]) {
        for (i, fin) in fins.iter().enumerate().take(FINS) {
            let (sin, cos) = sin_cos(deflections[i]);
            let (chord, normal) = (Vector3(get_all(&fin.chord)), Vector3(get_all(&fin.normal)));
            self.0[i] = [normal.scale_add(-sin, chord.scale(cos)), chord.scale_add(sin, normal.scale(cos))];
        }
    }

    /// Wrench on the vehicle by all fins, from the vehicle's twist relative to the water; vehicle frame.
    #[inline(always)]
    pub fn wrench<P: Param<L>>(&self, fins: &[Fin<P>], twist: Vector6<L>) -> Vector6<L> {
        let mut sum = Vector6::zero();
        for (i, fin) in fins.iter().enumerate().take(FINS) {
            let [chord, normal] = self.0[i];
            let r = Vector3(get_all(&fin.position));
            let v = twist.angular.cross_add(r, twist.linear);
            let [along, across] = fin.force(v.dot(chord), v.dot(normal));
            let force = normal.scale_add(across, chord.scale(along));
            sum = Vector6 { linear: sum.linear + force, angular: r.cross_add(force, sum.angular) };
        }
        sum
    }
}
