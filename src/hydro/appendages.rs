//! Fins and other lifting surfaces. `[HC eq. 21, F_PL]` `[F21]`
//!
//! A fin feels the water in the plane of its chord c and its normal n: with the components u, w of its velocity through the
//! water, `V^2 = u^2 + w^2`, angle of attack `tan alpha = -w / u`,
//!
//! ```text
//! lift = q A C_L,  C_L = ((1 - s) a + s C_90) sin alpha cos alpha      across the flow, towards n for alpha > 0
//! drag = q A C_D,  C_D = C_D0 + (1 - s) k (a sin alpha cos alpha)^2 + s C_90 sin^2 alpha      against it
//! q = rho V^2 / 2,     s = x^4 / (1 + x^4),     x = sin^2 alpha / sin^2 alpha_stall
//! ```
//!
//! the lift slope a being that of small angles, and s the share that has stalled: half of it at the stall angle, and so little
//! well below that the slope is untouched. Past stall the fin is a flat plate, whose normal force has the coefficient `C_90 sin
//! alpha`. Moving backward it is as good as forward. Everything is smooth in the velocity.

use crate::lane::{Lane, Param, get_all, sin_cos};
use crate::lie::{Vector3, Vector6};

/// Greatest number of fins.
pub const FINS: usize = 8;

/// A fin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fin<P> {
    /// Centre of pressure in the vehicle frame.
    pub position: [P; 3],
    /// Towards the leading edge, at deflection 0.
    pub chord: [P; 3],
    /// Across chord and span, at deflection 0.
    pub normal: [P; 3],
    /// Deflection without command, rad.
    pub deflection: P,
    /// Least and greatest deflection, rad.
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

impl<P: Copy> Fin<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Fin<Q> {
        let c = &change;
        Fin {
            position: self.position.map(c),
            chord: self.chord.map(c),
            normal: self.normal.map(c),
            deflection: c(self.deflection),
            limits: self.limits.map(c),
            lift: c(self.lift),
            drag: self.drag.map(c),
            induced: self.induced.map(c),
            stall: self.stall.map(|stall| stall.map(c)),
        }
    }

    /// Force of the water in the direction of chord and normal, on a fin that moves through it at `u` and `w` along these.
    #[inline(always)]
    fn force<L: Lane>(&self, u: L, w: L) -> [L; 2]
    where
        P: Param<L>,
    {
        let square = u.mul_add(u, w.mul_add(w, L::c(STILL)));
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
        if let Some(own) = self.drag {
            drag += own.get();
        }
        let (across, against) = (lift * u * w / speed, drag * speed);
        [across.mul_add(w, -(against * u)), -across.mul_add(u, against * w)]
    }
}

/// Square of a speed that is no speed at all, m2/s2: keeps quotients finite.
const STILL: f64 = 1e-30;

/// Chords and normals of deflected fins.
#[derive(Debug, Clone, Copy)]
pub struct Surfaces<L>([[Vector3<L>; 2]; FINS]);

impl<L: Lane> Surfaces<L> {
    /// Memory to load into.
    #[inline(always)]
    pub fn blank() -> Self {
        Self([[Vector3::zero(); 2]; FINS])
    }

    /// Deflects the fins: each turns about its axis, which is across normal and chord.
    #[inline(always)]
    pub fn deflect<P: Param<L>>(&mut self, fins: &[Fin<P>], deflections: &[L; FINS]) {
        for (i, fin) in fins.iter().enumerate().take(FINS) {
            let (sin, cos) = sin_cos(deflections[i]);
            let (chord, normal) = (Vector3(get_all(&fin.chord)), Vector3(get_all(&fin.normal)));
            self.0[i] = [normal.scale_add(-sin, chord.scale(cos)), chord.scale_add(sin, normal.scale(cos))];
        }
    }

    /// Wrench of the water on all fins, at the vehicle's twist through it; vehicle frame.
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

/// A cable that pulls at the vehicle, quasi-statically: weight in water and drag of the half of it that hangs on the vehicle.
/// `[HC eq. 21, F_EXT]`
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tether<P> {
    /// Where it is attached, in the vehicle frame.
    pub position: [P; 3],
    /// Mass less displaced mass of that half, kg.
    pub net_mass: P,
    /// `rho C_D d l / 2` of that half of length l, N s2/m2.
    pub drag: P,
}

impl<P: Copy> Tether<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Tether<Q> {
        Tether { position: self.position.map(&change), net_mass: change(self.net_mass), drag: change(self.drag) }
    }

    /// Wrench on the vehicle at its twist through the water, under gravity in vehicle axes.
    #[inline(always)]
    pub fn wrench<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
    where
        P: Param<L>,
    {
        let r = Vector3(get_all(&self.position));
        let v = twist.angular.cross_add(r, twist.linear);
        let speed = (v.dot(v) + L::c(STILL)).sqrt();
        let force = v.scale_add(-(self.drag.get() * speed), gravity.scale(self.net_mass.get()));
        Vector6 { linear: force, angular: r.cross(force) }
    }
}
