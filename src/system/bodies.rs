//! Compilation of bodies: terms of each moving body, and their central form.

use nalgebra as na;

use super::damping::{damping, damping_at};
use super::factors::{CentralInertia, UnscaledBodyTerms};
use super::joint_frames::{inverse, nonzero, pose, tidy};
use super::model::BodyTerms;
use crate::description::{Body, Water};
use crate::hydro::{CentralFrameTerms, CoefficientFrame, CoefficientMatrix, Damping, FrameRotation, Restoring};
use crate::lie::{Matrix3, Pose, Vector3};
use crate::spatial::{BodyPoint, SpatialInertia};

/// One body of the scene, fixed to a moving body at the pose `at`; other quantities are in its own frame.
pub(super) struct Part {
    at: Pose<f64>,
    rigid: SpatialInertia<f64>,
    added: SpatialInertia<f64>,
    /// Mass and displaced mass under gravity, each with its first moment.
    weight: Restoring<f64>,
    displaced: Restoring<f64>,
    /// Frame of added mass and damping.
    hydrodynamic: Pose<f64>,
    damping: Option<Damping<f64>>,
}

impl Part {
    pub(super) fn of(body: &Body, at: Pose<f64>, water: &Water) -> Self {
        let hydrodynamic = pose(&body.hydrodynamic_frame);
        let added = &body.added_mass;
        // Without gravity there is neither weight nor buoyancy.
        let gravity_factor = if water.gravity.norm() == 0.0 { 0.0 } else { 1.0 };
        let gravitational = |mass: f64, at: &na::Vector3<f64>| Restoring { net_mass: mass, moment: (mass * at).into() };
        Self {
            at,
            rigid: rigid_inertia(body.mass, &body.center_of_mass, &body.inertia_about_com()),
            added: SpatialInertia::from_entries(|i, k| added[(i, k)]).to_parent(&hydrodynamic),
            weight: gravitational(gravity_factor * body.mass, &body.center_of_mass),
            displaced: gravitational(
                gravity_factor * water.density * body.displaced_volume(water),
                &body.center_of_buoyancy,
            ),
            damping: damping(body, &hydrodynamic),
            hydrodynamic,
        }
    }
}

/// `[[m I, -m [c]], [m [c], I_c - m [c] [c]]]`, inertia about the frame origin. `[HC eq. 5]`
fn rigid_inertia(mass: f64, com: &na::Vector3<f64>, about_com: &na::Matrix3<f64>) -> SpatialInertia<f64> {
    let cross = com.cross_matrix();
    let about_origin = about_com - mass * cross * cross;
    SpatialInertia::from_entries(|i, k| match (i < 3, k < 3) {
        (true, true) if i == k => mass,
        (true, true) => 0.0,
        (true, false) => -mass * cross[(i, k - 3)],
        (false, true) => -mass * cross[(k, i - 3)],
        (false, false) => about_origin[(i - 3, k - 3)],
    })
}

/// Terms of a moving body and their parts, summed over `parts`, in the frame that has the body's own frame at `link`.
pub(super) fn merged(parts: &[Part], link: &Pose<f64>) -> (BodyTerms<f64>, UnscaledBodyTerms<f64>) {
    let none = Restoring { net_mass: 0.0, moment: [0.0; 3] };
    let (rigid, added) = (SpatialInertia::zero(), SpatialInertia::zero());
    let mut sum = UnscaledBodyTerms {
        rigid,
        added,
        central: None,
        weight: none,
        displaced: none,
        damping: Vec::new(),
        central_damping: None,
    };
    let mut damping = Vec::new();
    for part in parts {
        let at = link.times(&part.at);
        sum.rigid = sum.rigid.plus(&part.rigid.to_parent(&at));
        sum.added = sum.added.plus(&part.added.to_parent(&at));
        for (sum, part) in [(&mut sum.weight, &part.weight), (&mut sum.displaced, &part.displaced)] {
            let moment = at.rotation.apply(Vector3(part.moment)) + at.position.scale(part.net_mass);
            sum.net_mass += part.net_mass;
            sum.moment = (Vector3(sum.moment) + moment).0;
        }
        let at = |d: &Damping<f64>| at.times(&frame_pose(&d.frame));
        damping.extend(part.damping.iter().map(|d| damping_at(d.linear.clone(), d.quadratic.clone(), &tidy(&at(d)))));
    }
    (sum.rigid, sum.added) = (tidy_inertia(&sum.rigid), tidy_inertia(&sum.added));
    (sum.weight.moment, sum.displaced.moment) = (tidy_moment(sum.weight.moment), tidy_moment(sum.displaced.moment));
    let moment = (Vector3(sum.weight.moment) - Vector3(sum.displaced.moment)).0;
    let restoring = Restoring { net_mass: sum.weight.net_mass - sum.displaced.net_mass, moment };
    let restoring = (restoring != none).then_some(restoring);
    let central = match damping.first() {
        Some(damping) => central(&sum, damping),
        None => central(&sum, &undamped(parts, link, &sum.rigid)),
    };
    let central = central.map(|(central, parts)| {
        (sum.central, sum.central_damping) = (Some(parts), central.damping);
        central
    });
    sum.damping.clone_from(&damping);
    (BodyTerms { inertia: sum.rigid.plus(&sum.added), restoring, damping, central, payload: None }, sum)
}

/// Zero damping in the only frame that can be central for a body without damping: at its centre of mass, along the axes of
/// its added mass.
fn undamped(parts: &[Part], link: &Pose<f64>, rigid: &SpatialInertia<f64>) -> Damping<f64> {
    let flooded = parts.iter().find(|part| (0..6).any(|k| part.added.entry(k, k) != 0.0));
    let rotation = flooded.map_or(Matrix3::identity(), |part| link.times(&part.at).times(&part.hydrodynamic).rotation);
    // [HC eq. 5]
    let (mass, moment) = (rigid.entry(0, 0), [rigid.entry(1, 5), rigid.entry(2, 3), rigid.entry(0, 4)]);
    let position = if mass == 0.0 { Vector3::zero() } else { Vector3(moment).scale(1.0 / mass) };
    damping_at(CoefficientMatrix::None, CoefficientMatrix::None, &Pose { rotation, position })
}

/// Maximum entry of an inertia or a moment that counts as rounding, relative to its size.
const ROUNDING: f64 = 1e-14;

/// Size of an inertia's entries: geometric mean of the maximum masses or moments of inertia on the diagonal.
fn size(inertia: &SpatialInertia<f64>, i: usize, k: usize) -> f64 {
    let maximum = |k: usize| (k / 3 * 3..k / 3 * 3 + 3).map(|k| inertia.entry(k, k)).fold(0.0, f64::max);
    (maximum(i) * maximum(k)).sqrt()
}

/// The inertia with rounding replaced by zeros. (Products of such numbers with each other are subnormal in single
/// precision, on which a processor spends a hundred times as long.)
fn tidy_inertia(inertia: &SpatialInertia<f64>) -> SpatialInertia<f64> {
    SpatialInertia::from_entries(|i, k| {
        let entry = inertia.entry(i, k);
        if entry.abs() <= ROUNDING * size(inertia, i, k) { 0.0 } else { entry }
    })
}

/// The moment with rounding replaced by zeros.
fn tidy_moment(moment: [f64; 3]) -> [f64; 3] {
    let size = moment.iter().fold(0.0, |size: f64, x| size.max(x.abs()));
    moment.map(|x| if x.abs() <= ROUNDING * size { 0.0 } else { x })
}

/// Terms in the frame of the damping coefficients (of [`undamped`] where there are none), with rigid and added inertia there.
/// None unless the frame is central: both masses are centred in it, all matrices but the angular inertia diagonal.
fn central(
    of: &UnscaledBodyTerms<f64>,
    damping: &Damping<f64>,
) -> Option<(CentralFrameTerms<f64>, [CentralInertia<f64>; 2])> {
    let at = frame_pose(&damping.frame);
    let back = inverse(&at);
    let there = |inertia: &SpatialInertia<f64>| {
        // Remainders of large terms that cancel in the transform are judged by the size of these terms.
        let (here, there) = (inertia, inertia.to_parent(&back));
        let entry = |i: usize, k: usize| {
            let entry = there.entry(i, k);
            if entry.abs() > ROUNDING * size(here, i, k).max(size(&there, i, k)) { entry } else { 0.0 }
        };
        let clean = (0..6).all(|i| (0..i.min(3)).all(|k| entry(i, k) == 0.0));
        let diagonal = [0, 1, 2, 3, 4, 5].map(|k| entry(k, k));
        clean.then(|| CentralInertia { diagonal, products: [entry(4, 5), entry(3, 5), entry(3, 4)] })
    };
    let parts = [there(&of.rigid)?, there(&of.added)?];
    let centred = |mass: &Restoring<f64>| {
        let arm = at.position.scale(mass.net_mass);
        let size = arm.dot(arm).sqrt();
        let off = Vector3(mass.moment) - arm;
        off.dot(off).sqrt() <= ROUNDING * size
    };
    if !(centred(&of.weight) && centred(&of.displaced)) {
        return None;
    }
    let coefficients = |c: &CoefficientMatrix<f64>| match c {
        CoefficientMatrix::None => Some([0.0; 6]),
        CoefficientMatrix::Diagonal(d) => Some(*d),
        CoefficientMatrix::Full(_) => None,
    };
    let along = [coefficients(&damping.linear)?, coefficients(&damping.quadratic)?];
    let [rigid, added] = &parts;
    let [masses @ .., x, y, z] = [0, 1, 2, 3, 4, 5].map(|k| rigid.diagonal[k] + added.diagonal[k]);
    let products = [0, 1, 2].map(|k| rigid.products[k] + added.products[k]);
    let central = CentralFrameTerms {
        origin: BodyPoint::of(at.position.0.map(|x| nonzero(x).unwrap_or(0.0))),
        rotation: match damping.frame {
            CoefficientFrame::General([[cos, ..], [sin, ..], [.., 1.0]], _) => FrameRotation::AboutZ(sin, cos),
            CoefficientFrame::General(rows, _) => FrameRotation::General(rows),
            _ => FrameRotation::Aligned,
        },
        masses,
        gyration: [z - y, x - z, y - x],
        products: (rigid.products != [0.0; 3] || added.products != [0.0; 3]).then_some(products),
        damping: (along != [[0.0; 6]; 2]).then_some(along),
        net_mass: of.weight.net_mass - of.displaced.net_mass,
    };
    Some((central, parts))
}

/// Pose of the coefficients' frame in the body frame.
fn frame_pose(frame: &CoefficientFrame<f64>) -> Pose<f64> {
    match *frame {
        CoefficientFrame::Body => Pose::identity(),
        CoefficientFrame::Shifted(p) => Pose { rotation: Matrix3::identity(), position: Vector3(p) },
        CoefficientFrame::General(r, p) => Pose { rotation: Matrix3(r), position: Vector3(p) },
    }
}
