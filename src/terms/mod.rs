//! Forces on the vehicle, one file each: table of the scene with its checks, compiled numbers, law, adjoint and dense twin.
//!
//! A term is two types: its table ([`TermTable`]), a field of [`crate::description::Vehicle`], and its compiled form ([`Term`]), a
//! field of [`VehicleTerms`]. The list [`vehicle_terms!`] names both; compilation, kernels, adjoints, twin, energy, numbers of
//! instances and reports go through the list.

mod factors;
mod fin;
mod forward_damping;
mod tether;

use std::marker::PhantomData;

use nalgebra as na;

use crate::keys::Fault;
use crate::lane::{Dual, Lane, Param, Routine, numbers};
use crate::lie::{Vector3, Vector6};
pub use factors::{FACTORS, Factors};
pub use fin::{FINS, FinAxes, FinTerm};
pub use forward_damping::ForwardDampingTerm;
pub use tether::TetherTerm;

/// Tables of the terms in a scene.
pub mod tables {
    pub use super::fin::Fin;
    pub use super::forward_damping::ForwardDamping;
    pub use super::tether::Tether;
}

/// Calls a macro with all terms: field of the vehicle's table and of [`VehicleTerms`], compiled type, and note of reports.
macro_rules! vehicle_terms {
    ($with:ident! $($context:tt)*) => {
        $with! {
            ($($context)*)
            /// Fins.
            fins: FinTerm, "at the scene's deflections";
            /// Tether.
            tether: TetherTerm, "its weight and its damping";
            /// Damping by forward speed.
            forward_damping: ForwardDampingTerm, "damping proportional to the forward speed";
        }
    };
}
pub(crate) use vehicle_terms;

/// Water and gravity of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Density, kg/m3; 0 in a vacuum.
    pub density: f64,
    /// Gravity in world axes, m/s2.
    pub gravity: na::Vector3<f64>,
}

/// Table of a term in a scene.
pub trait TermTable: Sized {
    /// Compiled form.
    type Term;
    /// True for a damping, which Fossen's matrix D contains.
    const DAMPING: bool = false;

    /// Checks the scene's tables of this term, one or a list; `key` is their path.
    ///
    /// # Errors
    /// The first number that is not allowed.
    fn check(tables: &[Self], key: &str) -> Result<(), Fault>;

    /// Warnings about valid but implausible numbers: path and text.
    fn warnings(&self, _key: &str) -> Vec<(String, String)> {
        Vec::new()
    }

    /// Converts from Fossen's axes to the project's, or back.
    fn flip_axes(&mut self);

    /// Normalises directions.
    fn normalise(&mut self) {}

    /// Multiplies linear damping by a factor.
    fn scale_linear_damping(&mut self, _factor: f64) {}

    /// Compiled form; none if the wrench is always 0.
    fn compile(&self, medium: &Medium) -> Option<Self::Term>;

    /// Dense twin: wrench on the vehicle of entry `index`, vehicle frame, N and N m, by the law as it is stated.
    fn dense_wrench(&self, index: usize, at: &DenseInstant) -> na::Vector6<f64>;
}

/// Motion of the vehicle as dense twins read it, vehicle axes.
#[derive(Debug, Clone, Copy)]
pub struct DenseInstant<'a> {
    /// Water.
    pub density: f64,
    /// Gravity, m/s2.
    pub gravity: na::Vector3<f64>,
    /// Twist relative to the water, m/s and rad/s.
    pub relative: na::Vector6<f64>,
    /// Deflections of the fins, rad.
    pub deflections: &'a [f64],
}

impl DenseInstant<'_> {
    /// Velocity of a point of the vehicle through the water, m/s.
    fn velocity(&self, point: &na::Vector3<f64>) -> na::Vector3<f64> {
        let (linear, angular) = (self.relative.fixed_rows::<3>(0), self.relative.fixed_rows::<3>(3));
        linear + angular.cross(point)
    }
}

/// Wrench at the vehicle's origin of a force at a point.
fn dense_force_at(force: na::Vector3<f64>, point: &na::Vector3<f64>) -> na::Vector6<f64> {
    let moment = point.cross(&force);
    na::Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z)
}

/// Motion of the vehicle as terms read it, one instance per lane.
#[derive(Debug, Clone, Copy)]
pub struct TermInstant<'a, L> {
    /// Twist relative to the water, vehicle axes, m/s and rad/s.
    pub twist: Vector6<L>,
    /// Gravity in vehicle axes, m/s2; of a world at rest, as the acceleration of the water is left out.
    pub gravity: Vector3<L>,
    /// Chords and normals of the fins.
    pub fins: &'a FinAxes<L>,
}

/// Cotangents of a [`TermInstant`].
#[derive(Debug)]
pub struct TermCotangents<'a, L> {
    /// Cotangent of the twist.
    pub twist: Vector6<L>,
    /// Cotangent of gravity.
    pub gravity: Vector3<L>,
    /// Cotangents of chords and normals of the fins.
    pub fins: &'a mut FinAxes<L>,
}

/// Compiled term: a force on the vehicle.
pub trait Term<P: Copy> {
    /// Adds the wrench of entry `index` on the vehicle, vehicle frame, N and N m.
    fn add_wrench<L: Lane>(&self, index: usize, at: &TermInstant<L>, sum: &mut Vector6<L>)
    where
        P: Param<L>;

    /// Adds the cotangents of the instant from the wrench's: here by dual numbers.
    #[inline(always)]
    fn add_cotangents<L: Lane>(&self, index: usize, at: &TermInstant<L>, of: Vector6<L>, sums: &mut TermCotangents<L>)
    where
        Self: Sized,
        P: Param<L> + Param<Dual<L>>,
    {
        let (twist, gravity, parameters) = (Vector6::zero(), Vector3::zero(), PhantomData);
        let mut adjoint = DualAdjoint { term: self, index, at, of, twist, gravity, parameters };
        L::call(&mut adjoint);
        sums.twist = sums.twist + adjoint.twist;
        sums.gravity = sums.gravity + adjoint.gravity;
    }

    /// Sets the numbers that factors scale.
    #[inline(always)]
    fn set_factors(&mut self, _factors: &Factors<P>) {}

    /// Adds the cotangents of the factors from the wrench's.
    #[inline(always)]
    fn add_factor_cotangents<L: Lane>(&self, _at: &TermInstant<L>, _of: Vector6<L>, _sums: &mut Factors<L>)
    where
        P: Param<L>,
    {
    }
}

/// Adjoint of a term by dual numbers, one evaluation for each number of twist and gravity; a routine of its own, so that hot
/// terms beside it keep their registers.
struct DualAdjoint<'a, P, L, T> {
    term: &'a T,
    index: usize,
    at: &'a TermInstant<'a, L>,
    of: Vector6<L>,
    twist: Vector6<L>,
    gravity: Vector3<L>,
    parameters: PhantomData<P>,
}

impl<P: Param<L> + Param<Dual<L>>, L: Lane, T: Term<P>> Routine<L> for DualAdjoint<'_, P, L, T> {
    #[inline(always)]
    fn run(&mut self) {
        let ([u, v, w, p, q, r], [x, y, z], fins) = (self.at.twist.to_array(), self.at.gravity.0, &FinAxes::blank());
        let values = [u, v, w, p, q, r, x, y, z];
        let (of, mut slopes) = (self.of.to_array(), [L::zero(); 9]);
        let mut numbers = [Dual::new(L::zero(), L::zero()); 9];
        for k in 0..9 {
            numbers[k].value = values[k];
        }
        for k in 0..9 {
            numbers[k].slope = L::c(1.0);
            let [u, v, w, p, q, r, x, y, z] = numbers;
            let (twist, gravity) = (Vector6::from_array([u, v, w, p, q, r]), Vector3([x, y, z]));
            let mut wrench = Vector6::zero();
            self.term.add_wrench(self.index, &TermInstant { twist, gravity, fins }, &mut wrench);
            numbers[k].slope = L::zero();
            let wrench = wrench.to_array();
            for i in 0..6 {
                slopes[k] = of[i].mul_add(wrench[i].slope, slopes[k]);
            }
        }
        let [u, v, w, p, q, r, x, y, z] = slopes;
        (self.twist, self.gravity) = (Vector6::from_array([u, v, w, p, q, r]), Vector3([x, y, z]));
    }
}

/// Compiled terms of a vehicle from the list.
macro_rules! compiled_terms {
    (() $($(#[$about:meta])* $field:ident: $term:ident, $note:literal;)*) => {
        numbers! {
            /// Compiled terms of a vehicle.
            #[derive(Debug, Clone, PartialEq)]
            pub struct VehicleTerms<P> {
                $($(#[$about])* pub $field: Vec<$term<P>>,)*
            }
        }

        /// Names of the terms: keys of the vehicle's table, each with the note of reports.
        pub const TERMS: [(&str, &str); [$($note),*].len()] = [$((stringify!($field), $note)),*];

        /// A value for each term.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct PerTerm<T> {
            $($(#[$about])* pub $field: T,)*
        }

        impl<T> PerTerm<T> {
            /// Values in the order of [`TERMS`].
            pub fn into_array(self) -> [T; TERMS.len()] {
                [$(self.$field),*]
            }

            /// A function of each value.
            pub fn map<U>(self, f: impl Fn(T) -> U) -> PerTerm<U> {
                PerTerm { $($field: f(self.$field)),* }
            }
        }

        impl<P: Copy> VehicleTerms<P> {
            /// True if the scene has any term.
            #[inline(always)]
            pub fn any(&self) -> bool {
                $(!self.$field.is_empty())||*
            }

            /// Wrench of all terms on the vehicle, vehicle frame, N and N m.
            #[inline(always)]
            pub fn wrench<L: Lane>(&self, at: &TermInstant<L>) -> Vector6<L>
            where
                P: Param<L>,
            {
                let mut sum = Vector6::zero();
                $(for (i, term) in self.$field.iter().enumerate() {
                    term.add_wrench(i, at, &mut sum);
                })*
                sum
            }

            /// Wrench of all terms with the fins at the scene's deflections.
            #[inline(always)]
            pub fn passive_wrench<L: Lane>(&self, twist: Vector6<L>, gravity: Vector3<L>) -> Vector6<L>
            where
                P: Param<L>,
            {
                let (mut deflections, mut fins) = ([L::zero(); FINS], FinAxes::blank());
                for i in 0..self.fins.len().min(FINS) {
                    deflections[i] = self.fins[i].deflection.get();
                }
                fins.deflect(&self.fins, &deflections);
                self.wrench(&TermInstant { twist, gravity, fins: &fins })
            }

            /// Sets the numbers that factors scale.
            #[inline(always)]
            pub fn set_factors(&mut self, factors: &Factors<P>) {
                $(for term in &mut self.$field {
                    term.set_factors(factors);
                })*
            }
        }

        impl<L: Lane> VehicleTerms<L> {
            /// Adds the cotangents of the instant from the wrench's.
            #[inline(always)]
            pub fn add_cotangents(&self, at: &TermInstant<L>, of: Vector6<L>, sums: &mut TermCotangents<L>) {
                $(for (i, term) in self.$field.iter().enumerate() {
                    term.add_cotangents(i, at, of, sums);
                })*
            }

            /// Adds the cotangents of the factors from the wrench's.
            #[inline(always)]
            pub fn add_factor_cotangents(&self, at: &TermInstant<L>, of: Vector6<L>, sums: &mut Factors<L>) {
                $(for term in &self.$field {
                    term.add_factor_cotangents(at, of, sums);
                })*
            }
        }

        impl VehicleTerms<()> {
            /// Names of the terms, and whether two structures differ in them.
            pub fn differences(&self, other: &Self) -> [(&'static str, bool); TERMS.len()] {
                [$((concat!("vehicle.", stringify!($field)), self.$field != other.$field)),*]
            }
        }
    };
}
vehicle_terms! { compiled_terms! }
