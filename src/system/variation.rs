//! Parameters of single instances: factors on what the scene states, for domain randomisation.

use super::model::{BodyTerms, System};
use crate::hydro::{Coefficients, Restoring};
use crate::lane::{Lane, Param, Real, Shared};
use crate::lie::Vector3;
use crate::spatial::{Place, PointMass, SpatialInertia};

/// Number of factors.
pub const FACTORS: usize = 8;

/// Factors on the parameters of every body of one instance; all 1 for the scene as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors<L> {
    /// Mass, and with it inertia and weight.
    pub mass: L,
    /// Added mass.
    pub added_mass: L,
    /// Linear drag.
    pub linear_drag: L,
    /// Quadratic drag.
    pub quadratic_drag: L,
    /// Displaced volume, and with it buoyancy.
    pub volume: L,
    /// No factor, but a point mass at the end effector, kg.
    pub payload: L,
    /// Thrust.
    pub thrust: L,
    /// Time constants of thrusters.
    pub thruster_lag: L,
}

impl Factors<f64> {
    /// The scene as it is.
    pub const ONE: Self = Self {
        mass: 1.0,
        added_mass: 1.0,
        linear_drag: 1.0,
        quadratic_drag: 1.0,
        volume: 1.0,
        payload: 0.0,
        thrust: 1.0,
        thruster_lag: 1.0,
    };
    /// The scene without added mass.
    pub const RIGID: Self = Self { added_mass: 0.0, ..Self::ONE };
}

impl Factors<f64> {
    /// Those of bodies: all but those of thrusters.
    pub fn of_bodies(&self) -> [f64; FACTORS - 2] {
        let [bodies @ .., _, _] = self.to_array();
        bodies
    }
}

impl<L: Copy> Factors<L> {
    /// Names, in the order of [`Self::to_array`].
    pub const NAMES: [&'static str; FACTORS] =
        ["mass", "added_mass", "linear_drag", "quadratic_drag", "volume", "payload", "thrust", "thruster_lag"];

    /// From their numbers.
    #[inline(always)]
    pub fn from_array(numbers: [L; FACTORS]) -> Self {
        let [mass, added_mass, linear_drag, quadratic_drag, volume, payload, thrust, thruster_lag] = numbers;
        Self { mass, added_mass, linear_drag, quadratic_drag, volume, payload, thrust, thruster_lag }
    }

    /// As numbers.
    pub fn to_array(&self) -> [L; FACTORS] {
        let Self { mass, added_mass, linear_drag, quadratic_drag, volume, payload, thrust, thruster_lag } = *self;
        [mass, added_mass, linear_drag, quadratic_drag, volume, payload, thrust, thruster_lag]
    }
}

/// An inertia in the frame of its body's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CentralInertia<P> {
    /// Its diagonal.
    pub diagonal: [P; 6],
    /// What the angular block has besides: `[J_yz, J_xz, J_xy]`.
    pub products: [P; 3],
}

impl<P> CentralInertia<P> {
    fn map<Q>(self, change: &impl Fn(P) -> Q) -> CentralInertia<Q> {
        CentralInertia { diagonal: self.diagonal.map(change), products: self.products.map(change) }
    }
}

/// What the terms of a moving body are made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingredients<P> {
    /// Rigid inertia.
    pub rigid: SpatialInertia<P>,
    /// Added inertia.
    pub added: SpatialInertia<P>,
    /// Both in the frame of the body's centre, if it has one.
    pub central: Option<[CentralInertia<P>; 2]>,
    /// Mass and its moment.
    pub weight: Restoring<P>,
    /// Displaced mass and its moment.
    pub displaced: Restoring<P>,
}

impl<P: Copy> Ingredients<P> {
    /// The same with each number changed.
    pub fn map<Q>(&self, change: impl Fn(P) -> Q) -> Ingredients<Q> {
        Ingredients {
            rigid: self.rigid.map(&change),
            added: self.added.map(&change),
            central: self.central.map(|parts| parts.map(|inertia| inertia.map(&change))),
            weight: self.weight.map(&change),
            displaced: self.displaced.map(&change),
        }
    }
}

/// A system with bodies that instances have of their own.
pub type VariedSystem<L> = System<Shared<<L as Lane>::Real>, L>;

impl<T: Real> System<Shared<T>> {
    /// Memory for a system of single instances of bodies of these `ingredients`, with every term that
    /// [`System::vary`] may bring about: payloads if they are held somewhere, in the last body's frame.
    pub fn variable<L: Lane<Real = T>>(
        &self,
        ingredients: &[Ingredients<Shared<T>>],
        grip: Option<[Shared<T>; 3]>,
    ) -> VariedSystem<L> {
        let mut system = self.map_bodies(|Shared(x)| L::splat(x));
        let zero = Shared(T::from_f64(0.0));
        let weightless = Restoring { net_mass: zero, moment: [zero; 3] };
        let none = Restoring { net_mass: L::zero(), moment: [L::zero(); 3] };
        let joints = system.joints.iter_mut().map(|joint| &mut joint.body);
        for (body, parts) in std::iter::once(&mut system.vehicle).chain(joints).zip(ingredients) {
            if parts.weight != weightless || parts.displaced != weightless {
                body.restoring.get_or_insert(none);
            }
        }
        if let Some(grip) = grip {
            // A point mass has products of inertia: those of y with x and z are to be zero.
            let [off_x, off_y, off_z] = grip.map(|entry| entry != zero);
            system.sparse &= !(off_y && (off_x || off_z));
            let at = Place::of(grip.map(|Shared(x)| x.to_f64())).map(|x| L::splat(T::from_f64(x)));
            let load = PointMass { mass: L::zero(), at };
            let last = system.joints.last_mut().map_or(&mut system.vehicle, |joint| &mut joint.body);
            last.restoring.get_or_insert(none);
            last.load = Some(load);
        }
        system
    }

    /// The system with terms put together from `ingredients` by `factors` as [`System::vary`] does: to the same bits.
    pub fn put_together(&self, ingredients: &[Ingredients<Shared<T>>], factors: &Factors<f64>) -> Self {
        let mut system = self.map_bodies(|Shared(x)| x);
        system.vary(self, ingredients, &Factors::from_array(factors.to_array().map(T::from_f64)), true);
        system.map_bodies(Shared)
    }
}

impl<L: Lane> VariedSystem<L> {
    /// Makes this the system `of`, of bodies of these `ingredients` (vehicle first), with these factors; `twice` what bodies
    /// with a [`BodyTerms::central`] frame have besides it, too.
    #[inline(always)]
    pub fn vary(
        &mut self,
        of: &System<Shared<L::Real>>,
        ingredients: &[Ingredients<Shared<L::Real>>],
        factors: &Factors<L>,
        twice: bool,
    ) {
        let Some((vehicle, links)) = ingredients.split_first() else { return };
        vary_body(&mut self.vehicle, &of.vehicle, vehicle, factors, twice);
        for ((joint, of), parts) in self.joints.iter_mut().zip(&of.joints).zip(links) {
            vary_body(&mut joint.body, &of.body, parts, factors, twice);
        }
    }
}

#[inline(always)]
fn vary_body<L: Lane, P: Param<L>>(
    body: &mut BodyTerms<L>,
    of: &BodyTerms<P>,
    parts: &Ingredients<P>,
    factors: &Factors<L>,
    twice: bool,
) {
    let once = body.central.is_some() && !twice;
    let (rigid, added) = (parts.rigid.get(), parts.added.get());
    body.inertia = rigid.scale_add(factors.mass, &added.scale(factors.added_mass));
    if let Some(load) = &mut body.load {
        load.mass = factors.payload;
        body.inertia = body.inertia.plus(&load.inertia());
    }
    if let (Some(restoring), false) = (&mut body.restoring, once) {
        let net = |weight: P, displaced: P| displaced.get().neg_mul_add(factors.volume, weight.get() * factors.mass);
        restoring.net_mass = net(parts.weight.net_mass, parts.displaced.net_mass);
        for k in 0..3 {
            restoring.moment[k] = net(parts.weight.moment[k], parts.displaced.moment[k]);
        }
        if let Some(load) = &body.load {
            restoring.net_mass += load.mass;
            let at = load.at.point::<L>();
            restoring.moment = at.scale_add(load.mass, Vector3(restoring.moment)).0;
        }
    }
    if let (Some(central), Some(of), Some([rigid, added])) = (&mut body.central, &of.central, &parts.central) {
        let displaced = parts.displaced.net_mass.get();
        central.net_mass = displaced.neg_mul_add(factors.volume, parts.weight.net_mass.get() * factors.mass);
        let mut inertia = [L::zero(); 6];
        for k in 0..6 {
            let added = added.diagonal[k].get() * factors.added_mass;
            inertia[k] = rigid.diagonal[k].get().mul_add(factors.mass, added);
        }
        if let (Some([linear, quadratic]), Some(of)) = (&mut central.drag, &of.drag) {
            for k in 0..6 {
                linear[k] = of[0][k].get() * factors.linear_drag;
                quadratic[k] = of[1][k].get() * factors.quadratic_drag;
            }
        }
        let [masses @ .., x, y, z] = inertia;
        central.masses = masses;
        central.gyration = [z - y, x - z, y - x];
        if let Some(products) = &mut central.products {
            for k in 0..3 {
                let added = added.products[k].get() * factors.added_mass;
                products[k] = rigid.products[k].get().mul_add(factors.mass, added);
            }
        }
    }
    for (k, (drag, of)) in body.drag.iter_mut().zip(&of.drag).enumerate() {
        if once && k == 0 {
            continue;
        }
        scale(&mut drag.linear, &of.linear, factors.linear_drag);
        scale(&mut drag.quadratic, &of.quadratic, factors.quadratic_drag);
        if let (Some(bound), Some(of)) = (&mut drag.linear_bound, &of.linear_bound) {
            *bound = of.get().scale(factors.linear_drag);
        }
    }
}

#[inline(always)]
fn scale<L: Lane, P: Param<L>>(to: &mut Coefficients<L>, of: &Coefficients<P>, factor: L) {
    match (to, of) {
        (Coefficients::Diagonal(to), Coefficients::Diagonal(of)) => {
            for k in 0..6 {
                to[k] = of[k].get() * factor;
            }
        }
        (Coefficients::Full(to), Coefficients::Full(of)) => {
            for i in 0..6 {
                for k in 0..6 {
                    to[i][k] = of[i][k].get() * factor;
                }
            }
        }
        _ => {}
    }
}
