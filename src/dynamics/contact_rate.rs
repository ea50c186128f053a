//! Rate of contacts: sub-intervals in contact are chosen by it.

use super::aba::Scratch;
use super::contact::{ContactWrenches, link_places, moved, relative_motion, shape_at, sphere_at, step_at};
use crate::contact::{ContactTerms, Distance};
use crate::lane::{Lane, Param, Routine};

/// `h` times the frequency of all contacts that touch within a step of size `h` together, at most: 0 in lanes where nothing touches. The
/// rate at which friction and dissipation slow them counts with a share, as explicit methods are stable there for larger steps than
/// accurate ones of an oscillation. Spheres of a body act on the same motion: their stiffnesses and rates add up, but to no more than
/// if each had the maximum of them and all touched. Linearly implicit steps are stable at rest on shapes in the world at any size: there only
/// bounces count.
pub struct ContactRate<'a, L, P, B> {
    /// Place and motion at the start of the step.
    pub at: ContactWrenches<'a, L, P, B>,
    /// Step size, s.
    pub h: L,
    /// The result.
    pub rate: L,
}

/// Share with which rates of decay count.
const DECAY: f64 = 1.0 / 6.0;

/// Normal speed, m/s, of which linearly implicit steps may lose the bounce: they are stable at rest at any size.
const LOST_SPEED: f64 = 0.01;

/// Acceleration for which the reach of spheres within a step leaves room, m/s2.
const ACCELERATION: f64 = 10.0;

impl<L: Lane, P: Param<L>, B> Routine<L> for ContactRate<'_, L, P, B> {
    #[inline(always)]
    fn run(&mut self) {
        let ContactWrenches { system, implicit, pose, elapsed, twist, q, qd, scratch, .. } = &mut self.at;
        let Some(ContactTerms { spheres, shapes }) = &system.contact else { return };
        let Scratch { links, contact, water, .. } = &mut **scratch;
        let vehicle = &water.place(&moved(*pose), *elapsed, *twist);
        let n = system.chain().len();
        link_places(system, true, vehicle, (q, qd), &mut links[..n], &mut contact.places);
        let (h, zero) = (self.h, L::zero());
        // Of springs and of decay.
        let mut rates = [zero; 2];
        for shape in shapes {
            let shape_at = shape_at(shape, &contact.places);
            let (mut sum, mut most, mut of_shape) = ([zero; 2], [zero; 2], [zero; 2]);
            for sphere in spheres {
                let (motion, _) = relative_motion(&sphere_at(sphere, vehicle, &contact.places), &shape_at);
                let v = motion.twist.linear;
                let reach = (v.dot(v).sqrt() + L::c(0.5 * ACCELERATION) * h).mul_add(h, sphere.radius.get());
                let Distance { distance, normal } = shape.geometry.distance(motion.center);
                // Force and loss at the depth that the present rate reaches.
                let rate = -normal.dot(v);
                let depth = rate.max(zero).mul_add(h, sphere.radius.get() - distance);
                let force = shape.law.normal_force(depth, rate);
                let elastic = shape.law.stiffness.get() * shape.law.effective_depth(depth);
                let slip = shape.law.friction.get() * force / shape.law.slip_speed_squared.get().sqrt();
                let touches = L::select(distance.lt(reach), L::c(1.0), zero);
                let mut loads = [shape.law.stiffness.get(), shape.law.dissipation.get().mul_add(elastic, slip)];
                if step_at(shape, *implicit).is_some() {
                    let square = rate * rate;
                    loads = [loads[0] * (square / (square + L::c(LOST_SPEED * LOST_SPEED))), zero];
                }
                for k in 0..2 {
                    let load = touches * loads[k];
                    sum[k] = load.mul_add(sphere.mobility.get(), sum[k]);
                    most[k] = most[k].max(load * sphere.together.get());
                    of_shape[k] = load.mul_add(shape.mobility.get(), of_shape[k]);
                }
            }
            for k in 0..2 {
                rates[k] += sum[k].min(most[k]) + of_shape[k];
            }
        }
        let [square, decay] = rates;
        self.rate = h * square.sqrt().max(L::c(DECAY) * decay);
    }
}
