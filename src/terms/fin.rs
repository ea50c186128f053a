//! Fins and other lifting surfaces. `[HC eq. 21, F_PL]` `[F21]`
//!
//! Forces act in the plane of the chord c and the normal n. With the components u, w of the fin's velocity through the water,
//! `V^2 = u^2 + w^2`, angle of attack `tan alpha = -w / u`,
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

use nalgebra as na;
use serde::{Deserialize, Serialize};

use super::{DenseInstant, Medium, Term, TermCotangents, TermInstant, TermTable, VehicleTerms, dense_force_at};
use crate::error::Problem;
use crate::keys::{Fault, check_axis, check_names, check_not_negative, flip, normalise, numbers as forms, range};
use crate::lane::{Dual, Lane, Param, get_all, numbers, sin_cos};
use crate::lie::{Vector3, Vector6};

/// Maximum number of fins of a vehicle.
pub const FINS: usize = 8;
/// Maximum cosine of the angle between chord and axis that counts as 0.
const PERPENDICULAR: f64 = 1e-6;
/// Minimum stall angle, rad.
const MIN_STALL: f64 = 0.01;
/// Added to squared speeds, m2/s2, to keep quotients finite at rest.
pub(super) const MIN_SPEED_SQUARED: f64 = 1e-30;

/// A fin or another lifting surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fin {
    /// Name, by which keys select the fin: `vehicle.fins[NAME]`.
    pub name: String,
    /// Centre of pressure in the vehicle frame, m.
    #[serde(with = "forms::vector3")]
    pub position: na::Vector3<f64>,
    /// Direction of the leading edge at deflection 0, perpendicular to `axis`; normalised on reading.
    #[serde(with = "forms::vector3")]
    pub chord: na::Vector3<f64>,
    /// Direction of the span and axis of deflection; normalised on reading. Lift at a positive angle of attack points along
    /// `chord x axis`.
    #[serde(with = "forms::vector3")]
    pub axis: na::Vector3<f64>,
    /// Planform area A, m2.
    pub area: f64,
    /// Lift slope a at small angles, 1/rad.
    pub lift_slope: f64,
    /// Parasitic drag coefficient C_D0.
    #[serde(default)]
    pub drag: f64,
    /// Factor k of the induced drag `k C_L^2`.
    #[serde(default)]
    pub induced_drag: f64,
    /// Angle of attack at which half of the fin has stalled, rad. Without it the fin never stalls.
    pub stall: Option<f64>,
    /// Normal force coefficient C_90 of the stalled fin, a flat plate broadside to the flow.
    #[serde(default = "plate")]
    pub plate: f64,
    /// Deflection without command, rad.
    #[serde(default)]
    pub deflection: f64,
    /// Minimum and maximum deflection, rad. Without limits the fin is fixed.
    #[serde(default, deserialize_with = "forms::optional_array")]
    pub limits: Option<[f64; 2]>,
}

/// Normal force coefficient of a plate of small aspect ratio.
fn plate() -> f64 {
    1.2
}

impl Fin {
    /// Minimum and maximum deflection, rad.
    pub fn range(&self) -> [f64; 2] {
        self.limits.unwrap_or([self.deflection; 2])
    }

    /// Direction of lift at small positive angles of attack and deflection 0.
    pub fn normal(&self) -> na::Vector3<f64> {
        self.chord.cross(&self.axis)
    }

    fn check_numbers(&self, key: &str) -> Result<(), Fault> {
        check_axis(&self.axis, || format!("{key}.axis"))?;
        check_axis(&self.chord, || format!("{key}.chord"))?;
        let cosine = self.chord.normalize().dot(&self.axis.normalize());
        let rule = "0: the cosine of the angle between chord and axis";
        range(cosine.abs() <= PERPENDICULAR, cosine, rule, || format!("{key}.chord"))?;
        check_not_negative(key, [("area", self.area), ("lift_slope", self.lift_slope), ("drag", self.drag)])?;
        check_not_negative(key, [("induced_drag", self.induced_drag), ("plate", self.plate)])?;
        if let Some(stall) = self.stall {
            let ok = (MIN_STALL..=std::f64::consts::FRAC_PI_2).contains(&stall);
            range(ok, stall, "from 0.01 to pi/2 rad", || format!("{key}.stall"))?;
        }
        let [lower, upper] = self.range();
        if !(lower <= self.deflection && self.deflection <= upper) {
            let rule = "enclose the deflection, the lower below the upper";
            return Err(Fault::new(format!("{key}.limits"), Problem::Limits { lower, upper, rule }));
        }
        for limit in [lower, upper] {
            let name = if self.limits.is_some() { "limits" } else { "deflection" };
            range(limit.abs() <= std::f64::consts::PI, limit, "within -pi and pi", || format!("{key}.{name}"))?;
        }
        Ok(())
    }
}

impl TermTable for Fin {
    type Term = FinTerm<f64>;

    fn check(tables: &[Self], key: &str) -> Result<(), Fault> {
        if tables.len() > FINS {
            return Err(Fault::new(key, Problem::TooMany { found: tables.len(), max: FINS }));
        }
        check_names(tables.iter().map(|fin| fin.name.as_str()), &[], key)?;
        tables.iter().enumerate().try_for_each(|(i, fin)| fin.check_numbers(&format!("{key}[{i}]")))
    }

    fn flip_axes(&mut self) {
        [&mut self.position, &mut self.chord, &mut self.axis].into_iter().for_each(flip);
    }

    fn normalise(&mut self) {
        [&mut self.axis, &mut self.chord].into_iter().for_each(normalise);
    }

    fn compile(&self, medium: &Medium) -> Option<Self::Term> {
        let size = 0.5 * medium.density * self.area;
        let positive = |x: f64| (x > 0.0).then_some(x);
        let term = FinTerm {
            position: self.position.into(),
            chord: self.chord.into(),
            normal: self.normal().into(),
            deflection: self.deflection,
            limits: self.range(),
            lift: size * self.lift_slope,
            drag: positive(size * self.drag),
            induced: positive(size * self.induced_drag * self.lift_slope * self.lift_slope),
            stall: self.stall.map(|angle| [1.0 / angle.sin().powi(2), size * self.plate]),
        };
        (medium.density != 0.0).then_some(term)
    }

    fn dense_wrench(&self, index: usize, at: &DenseInstant) -> na::Vector6<f64> {
        let Some(&deflection) = at.deflections.get(index) else { return na::Vector6::zeros() };
        let axis = na::Unit::new_normalize(self.axis);
        let turned = na::Rotation3::from_axis_angle(&axis, deflection);
        let (chord, normal) = (turned * self.chord, turned * self.normal());
        let v = at.velocity(&self.position);
        let (u, w) = (v.dot(&chord), v.dot(&normal));
        let speed = u.hypot(w);
        if speed == 0.0 {
            return na::Vector6::zeros();
        }
        let alpha = (-w).atan2(u);
        let attached = self.lift_slope * alpha.sin() * alpha.cos();
        let stalled = self.stall.map_or(0.0, |stall| {
            let x = (alpha.sin() / stall.sin()).powi(8);
            x / (1.0 + x)
        });
        let lift = (1.0 - stalled) * attached + stalled * self.plate * alpha.sin() * alpha.cos();
        let drag = self.drag
            + (1.0 - stalled) * self.induced_drag * attached * attached
            + stalled * self.plate * alpha.sin().powi(2);
        let pressure = 0.5 * at.density * speed * speed * self.area;
        let ahead = (chord * u + normal * w) / speed;
        let across = (normal * u - chord * w) / speed;
        dense_force_at((across * lift - ahead * drag) * pressure, &self.position)
    }
}

numbers! {
    /// Compiled fin, in vehicle axes.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct FinTerm<P> {
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

impl<P: Copy> FinTerm<P> {
    /// Components of the force along chord and normal, N, at the velocity components `u` and `w` through the water, m/s.
    #[inline(always)]
    fn force<L: Lane>(&self, u: L, w: L) -> [L; 2]
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

/// Chords and normals of the deflected fins.
#[derive(Debug, Clone, Copy)]
pub struct FinAxes<L>([[Vector3<L>; 2]; FINS]);

impl<L: Lane> FinAxes<L> {
    /// Zeros, to be overwritten.
    #[inline(always)]
    pub fn blank() -> Self {
        Self([[Vector3::zero(); 2]; FINS])
    }

    /// Rotates each fin about its axis, which is normal to chord and normal.
    #[inline(always)]
    pub fn deflect<P: Param<L>>(&mut self, fins: &[FinTerm<P>], deflections: &[L; FINS]) {
        for (i, fin) in fins.iter().enumerate().take(FINS) {
            let (sin, cos) = sin_cos(deflections[i]);
            let (chord, normal) = (Vector3(get_all(&fin.chord)), Vector3(get_all(&fin.normal)));
            self.0[i] = [normal.scale_add(-sin, chord.scale(cos)), chord.scale_add(sin, normal.scale(cos))];
        }
    }

    /// Cotangents of the deflections from the cotangents of chords and normals.
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

impl<P: Copy> Term<P> for FinTerm<P> {
    #[inline(always)]
    fn add_wrench<L: Lane>(&self, index: usize, at: &TermInstant<L>, sum: &mut Vector6<L>)
    where
        P: Param<L>,
    {
        let Some(&[chord, normal]) = at.fins.0.get(index) else { return };
        let r = Vector3(get_all(&self.position));
        let v = at.twist.angular.cross_add(r, at.twist.linear);
        let [along, across] = self.force(v.dot(chord), v.dot(normal));
        let force = normal.scale_add(across, chord.scale(along));
        *sum = Vector6 { linear: sum.linear + force, angular: r.cross_add(force, sum.angular) };
    }

    /// Cotangents of twist, chords and normals; dual numbers only for the force in the plane of chord and normal.
    #[inline(always)]
    fn add_cotangents<L: Lane>(&self, index: usize, at: &TermInstant<L>, of: Vector6<L>, sums: &mut TermCotangents<L>)
    where
        P: Param<L> + Param<Dual<L>>,
    {
        let Some(&[chord, normal]) = at.fins.0.get(index) else { return };
        let (zero, one) = (L::zero(), L::c(1.0));
        let r: Vector3<L> = Vector3(get_all(&self.position));
        let v = at.twist.angular.cross_add(r, at.twist.linear);
        let (u, w) = (v.dot(chord), v.dot(normal));
        let of_force = of.angular.cross_add(r, of.linear);
        let (of_along, of_across) = (of_force.dot(chord), of_force.dot(normal));
        let by_u = self.force(Dual::new(u, one), Dual::new(w, zero));
        let by_w = self.force(Dual::new(u, zero), Dual::new(w, one));
        let of_u = by_u[0].slope.mul_add(of_along, by_u[1].slope * of_across);
        let of_w = by_w[0].slope.mul_add(of_along, by_w[1].slope * of_across);
        let [of_chord, of_normal] = &mut sums.fins.0[index];
        *of_chord = of_force.scale_add(by_u[0].value, v.scale_add(of_u, *of_chord));
        *of_normal = of_force.scale_add(by_u[1].value, v.scale_add(of_w, *of_normal));
        let of_v = normal.scale_add(of_w, chord.scale(of_u));
        sums.twist = Vector6 { linear: sums.twist.linear + of_v, angular: r.cross_add(of_v, sums.twist.angular) };
    }
}

impl<P: Copy> VehicleTerms<P> {
    /// Deflections of the fins without command, rad.
    pub fn deflections<L: Lane>(&self) -> [L; FINS]
    where
        P: Param<L>,
    {
        let mut deflections = [L::zero(); FINS];
        for (deflection, fin) in deflections.iter_mut().zip(&self.fins) {
            *deflection = fin.deflection.get();
        }
        deflections
    }
}
