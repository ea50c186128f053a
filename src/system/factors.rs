//! Parameters of single instances: factors on the scene's parameters, for domain randomisation.

use super::model::{BodyTerms, System};
use crate::hydro::{CoefficientMatrix, Damping, Restoring};
use crate::lane::{Lane, Param, Real, Shared, numbers, unroll};
use crate::lie::Vector3;
use crate::spatial::{BodyPoint, PointMass, SpatialInertia};
use crate::terms::Factors;

numbers! {
    /// Inertia in the central frame of a body.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct CentralInertia<P> {
        /// Diagonal.
        pub diagonal: [P; 6],
        /// Products of inertia: `[J_yz, J_xz, J_xy]`.
        pub products: [P; 3],
    }
}

numbers! {
    /// Parts of the terms of a moving body before [`Factors`] scale and sum them.
    #[derive(Debug, Clone, PartialEq)]
    pub struct UnscaledBodyTerms<P> {
        /// Rigid inertia.
        pub rigid: SpatialInertia<P>,
        /// Added inertia.
        pub added: SpatialInertia<P>,
        /// Rigid and added inertia in the central frame, if the body has one.
        pub central: Option<[CentralInertia<P>; 2]>,
        /// Mass and its moment.
        pub weight: Restoring<P>,
        /// Displaced mass and its moment.
        pub displaced: Restoring<P>,
        /// Damping: [`BodyTerms::damping`].
        pub damping: Vec<Damping<P>>,
        /// Diagonals of D_L and D_Q in the central frame, if the body has any there.
        pub central_damping: Option<[[P; 6]; 2]>,
    }
}

impl<T: Real> System<Shared<T>> {
    /// Memory for a system with numbers per instance, with every term that [`System::apply_factors`] may need: `unscaled` terms
    /// of the bodies (vehicle first), and the attachment of payloads in the frame of their body, if any.
    pub fn allocate_scaled<L: Lane<Real = T>>(
        &self,
        unscaled: &[UnscaledBodyTerms<Shared<T>>],
        payload_attachment: Option<[Shared<T>; 3]>,
    ) -> System<L> {
        let mut system = self.map(|Shared(x)| L::splat(x));
        let zero = Shared(T::from_f64(0.0));
        let weightless = Restoring { net_mass: zero, moment: [zero; 3] };
        let none = Restoring { net_mass: L::zero(), moment: [L::zero(); 3] };
        let joints = system.joints.iter_mut().map(|joint| &mut joint.body);
        for (body, parts) in std::iter::once(&mut system.vehicle).chain(joints).zip(unscaled) {
            if parts.weight != weightless || parts.displaced != weightless {
                body.restoring.get_or_insert(none);
            }
        }
        if let Some(attachment) = payload_attachment {
            // A sparse inertia has no products of inertia of y with x and z.
            let [off_x, off_y, off_z] = attachment.map(|entry| entry != zero);
            system.sparse &= !(off_y && (off_x || off_z));
            let position = BodyPoint::of(attachment.map(|Shared(x)| x.to_f64())).map(|x| L::splat(T::from_f64(x)));
            let payload = PointMass { mass: L::zero(), position };
            let body = system.payload_body_mut();
            body.restoring.get_or_insert(none);
            body.payload = Some(payload);
        }
        system
    }

    /// The system with the terms of its bodies scaled by `factors`, bit for bit as [`System::apply_factors`] does.
    pub fn with_factors(&self, unscaled: &[UnscaledBodyTerms<Shared<T>>], factors: &Factors<f64>) -> Self {
        let mut system = self.map(|Shared(x)| x);
        system.apply_factors(unscaled, &Factors::from_array(factors.to_array().map(T::from_f64)), true);
        system.map(Shared)
    }
}

impl<L: Lane> System<L> {
    /// Sets the terms of the bodies to these `unscaled` ones (vehicle first), scaled by `factors`, and scales the vehicle's terms.
    ///
    /// Without `body_frame_terms`, restoring and damping of bodies that have [`BodyTerms::central`] are left out: explicit
    /// methods read only the central form.
    #[inline(always)]
    pub fn apply_factors<P: Param<L>>(
        &mut self,
        unscaled: &[UnscaledBodyTerms<P>],
        factors: &Factors<L>,
        body_frame_terms: bool,
    ) {
        self.terms.set_factors(factors);
        let Some((vehicle, links)) = unscaled.split_first() else { return };
        scale_body(&mut self.vehicle, vehicle, factors, body_frame_terms);
        let joints = &mut self.joints[..];
        for i in 0..links.len().min(joints.len()) {
            scale_body(&mut joints[i].body, &links[i], factors, body_frame_terms);
        }
    }
}

#[inline(always)]
fn scale_body<L: Lane, P: Param<L>>(
    body: &mut BodyTerms<L>,
    parts: &UnscaledBodyTerms<P>,
    factors: &Factors<L>,
    body_frame_terms: bool,
) {
    let central_only = body.central.is_some() && !body_frame_terms;
    let (rigid, added) = (parts.rigid.get(), parts.added.get());
    body.inertia = rigid.scale_add(factors.mass, &added.scale(factors.added_mass));
    if let Some(payload) = &mut body.payload {
        payload.mass = factors.payload;
        body.inertia = body.inertia.plus(&payload.inertia());
    }
    if let (Some(restoring), false) = (&mut body.restoring, central_only) {
        restoring.net_mass = net(parts.weight.net_mass, parts.displaced.net_mass, factors);
        unroll!(k in 0 1 2 => {
            restoring.moment[k] = net(parts.weight.moment[k], parts.displaced.moment[k], factors);
        });
        if let Some(payload) = &body.payload {
            restoring.net_mass += payload.mass;
            let position = payload.position.coordinates::<L>();
            restoring.moment = position.scale_add(payload.mass, Vector3(restoring.moment)).0;
        }
    }
    if let (Some(central), Some([rigid, added])) = (&mut body.central, &parts.central) {
        central.net_mass = net(parts.weight.net_mass, parts.displaced.net_mass, factors);
        let mut inertia = [L::zero(); 6];
        unroll!(k in 0 1 2 3 4 5 => {
            let added = added.diagonal[k].get() * factors.added_mass;
            inertia[k] = rigid.diagonal[k].get().mul_add(factors.mass, added);
        });
        if let (Some([linear, quadratic]), Some(of)) = (&mut central.damping, &parts.central_damping) {
            unroll!(k in 0 1 2 3 4 5 => {
                linear[k] = of[0][k].get() * factors.linear_damping;
                quadratic[k] = of[1][k].get() * factors.quadratic_damping;
            });
        }
        let [masses @ .., x, y, z] = inertia;
        central.masses = masses;
        central.gyration = [z - y, x - z, y - x];
        if let Some(products) = &mut central.products {
            unroll!(k in 0 1 2 => {
                let added = added.products[k].get() * factors.added_mass;
                products[k] = rigid.products[k].get().mul_add(factors.mass, added);
            });
        }
    }
    let (dampings, of) = (&mut body.damping[..], &parts.damping[..]);
    for k in usize::from(central_only)..dampings.len().min(of.len()) {
        let (damping, of) = (&mut dampings[k], &of[k]);
        scale(&mut damping.linear, &of.linear, factors.linear_damping);
        scale(&mut damping.quadratic, &of.quadratic, factors.quadratic_damping);
        if let (Some(bound), Some(of)) = (&mut damping.linear_bound, &of.linear_bound) {
            *bound = of.get().scale(factors.linear_damping);
        }
    }
}

/// Mass less displaced mass, or their moments. (Not a closure: it would not inherit the caller's instruction set.)
#[inline(always)]
fn net<L: Lane, P: Param<L>>(weight: P, displaced: P, factors: &Factors<L>) -> L {
    displaced.get().neg_mul_add(factors.volume, weight.get() * factors.mass)
}

#[inline(always)]
fn scale<L: Lane, P: Param<L>>(to: &mut CoefficientMatrix<L>, of: &CoefficientMatrix<P>, factor: L) {
    match (to, of) {
        (CoefficientMatrix::Diagonal(to), CoefficientMatrix::Diagonal(of)) => {
            unroll!(k in 0 1 2 3 4 5 => {
                to[k] = of[k].get() * factor;
            });
        }
        (CoefficientMatrix::Full(to), CoefficientMatrix::Full(of)) => {
            unroll!(i in 0 1 2 3 4 5 => {
                unroll!(k in 0 1 2 3 4 5 => {
                    to[i][k] = of[i][k].get() * factor;
                });
            });
        }
        _ => {}
    }
}
