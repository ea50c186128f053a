//! Compilation of a scene to the constants of the kernel.

use nalgebra as na;

use super::factors::{CentralInertia, UnscaledBodyTerms};
use super::fins_and_tether::{fins, tether};
use super::joint_frames::{Line, inverse, joint_frames, nonzero, tidy};
use super::model::{Actuator, BodyTerms, Friction, JointScrew, JointTerms, Limits, Servo, System, VehicleServo};
use super::propulsion::thrusters;
use crate::description::{Body, Frame, Joint, JointKind, LinearActuator, Scene, Vehicle, Water};
use crate::hydro::{CentralFrameTerms, CoefficientFrame, CoefficientMatrix, Damping, FrameRotation, Restoring};
use crate::lane::Shared;
use crate::lie::{Matrix3, Pose, Vector3};
use crate::spatial::{BodyPoint, SpatialInertia};

/// A compiled scene: the system, and the link frames of the scene in the joint frames of the system.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// Constants of the kernel.
    pub system: System<Shared<f64>>,
    /// Constant pose of each link's frame in its joint's frame.
    pub links: Vec<Pose<f64>>,
    /// Point at which payloads are held: the end effector's origin in the last moving body's frame, m.
    pub payload_attachment: [f64; 3],
    /// Parts of the terms of each moving body, vehicle first.
    pub unscaled: Vec<UnscaledBodyTerms<Shared<f64>>>,
}

/// Compiles a checked scene: merges bodies that are fixed together, chooses joint frames, drops absent terms.
pub fn compile(scene: &Scene) -> Compiled {
    let water = &scene.water;
    let mut parts = vec![Part::of(&scene.vehicle.body, identity(), water)];
    let mut vehicle = parts.split_off(0);
    let mut moving: Vec<(&Joint, Vec<Part>)> = Vec::new();
    // Poses at q = 0, in the vehicle frame, of the moving links' frames, and of the frame that carries the next part.
    let mut zero_poses: Vec<Pose<f64>> = Vec::new();
    let mut parent = identity();
    let mut tip = identity();

    if let Some(arm) = &scene.arm {
        parent = pose(&arm.mount.frame);
        if let Some(joint) = &arm.mount.joint {
            parent = parent.times(&pose(&joint.frame));
            zero_poses.push(parent);
            let base = arm.base.iter().map(|body| Part::of(body, identity(), water)).collect();
            moving.push((joint, base));
        } else {
            vehicle.extend(arm.base.iter().map(|body| Part::of(body, parent, water)));
        }
        for link in &arm.links {
            parent = parent.times(&pose(&link.joint.frame));
            zero_poses.push(parent);
            moving.push((&link.joint, vec![Part::of(&link.body, identity(), water)]));
        }
        tip = pose(&arm.end_effector);
    }
    if let Some(payload) = &scene.payload {
        let at = tip.times(&pose(&payload.frame));
        match moving.last_mut() {
            Some((_, last)) => last.push(Part::of(&payload.body, at, water)),
            None => vehicle.push(Part::of(&payload.body, parent.times(&at), water)),
        }
    }

    let lines: Vec<Line> = moving
        .iter()
        .zip(&zero_poses)
        .map(|((joint, _), link)| Line {
            point: link.position,
            direction: link.rotation.apply(vector(&joint.axis)),
            axes: link.rotation,
        })
        .collect();
    let frames = joint_frames(&lines);
    let links: Vec<Pose<f64>> =
        frames.iter().zip(&zero_poses).map(|(frame, link)| tidy(&inverse(&frame.pose).times(link))).collect();

    let (vehicle, of_vehicle) = merged(&vehicle, &identity());
    let mut unscaled = vec![of_vehicle.map(Shared)];
    let joints: Vec<JointTerms<f64>> = moving
        .iter()
        .zip(&frames)
        .zip(&links)
        .map(|(((joint, parts), frame), link)| {
            let prismatic = joint.kind == JointKind::Prismatic;
            let (body, of_body) = merged(parts, link);
            unscaled.push(of_body.map(Shared));
            JointTerms {
                placement: frame.placement,
                offset: if prismatic { frame.d } else { frame.theta },
                screw: if prismatic {
                    let (sin, cos) = frame.theta.sin_cos();
                    JointScrew::Prismatic { sin, cos }
                } else {
                    JointScrew::Revolute { d: nonzero(frame.d) }
                },
                body,
                friction: friction(joint),
                limits: limits(joint),
                servo: servo(joint),
                effort: joint.effort,
                actuator: joint.actuator.as_ref().map(actuator),
            }
        })
        .collect();
    let sparse =
        unscaled.iter().all(|of| [&of.rigid, &of.added].iter().all(|part| part.map(|Shared(x)| x).is_sparse()));
    let system = System {
        sparse,
        z_aligned: joints.iter().all(|joint| joint.body.is_z_aligned()),
        gravity: water.gravity.into(),
        fixed: scene.vehicle.fixed,
        vehicle,
        joints,
        vehicle_servo: vehicle_servo(&scene.vehicle),
        thrusters: thrusters(&scene.vehicle),
        fins: fins(scene),
        tether: tether(scene),
    };
    let payload_attachment = tidy(&links.last().unwrap_or(&parent).times(&tip)).position.0;
    Compiled { system: system.map(Shared), links, payload_attachment, unscaled }
}

/// One body of the scene, fixed to a moving body at the pose `at`; other quantities are in its own frame.
struct Part {
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
    fn of(body: &Body, at: Pose<f64>, water: &Water) -> Self {
        let hydrodynamic = pose(&body.hydrodynamic_frame);
        let added = &body.added_mass;
        // Without gravity there is neither weight nor buoyancy.
        let heavy = if water.gravity.norm() == 0.0 { 0.0 } else { 1.0 };
        let gravitational = |mass: f64, at: &na::Vector3<f64>| Restoring { net_mass: mass, moment: (mass * at).into() };
        Self {
            at,
            rigid: rigid_inertia(body.mass, &body.center_of_mass, &body.inertia_about_com()),
            added: SpatialInertia::from_entries(|i, k| added[(i, k)]).to_parent(&hydrodynamic),
            weight: gravitational(heavy * body.mass, &body.center_of_mass),
            displaced: gravitational(heavy * water.density * body.displaced_volume(water), &body.center_of_buoyancy),
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
        (true, true) => {
            if i == k {
                mass
            } else {
                0.0
            }
        }
        (true, false) => -mass * cross[(i, k - 3)],
        (false, true) => -mass * cross[(k, i - 3)],
        (false, false) => about_origin[(i - 3, k - 3)],
    })
}

/// Damping of a body, if any coefficient differs from 0.
fn damping(body: &Body, hydrodynamic: &Pose<f64>) -> Option<Damping<f64>> {
    let coefficients = |m: &na::Matrix6<f64>| {
        if m.iter().all(|&x| x == 0.0) {
            CoefficientMatrix::None
        } else if *m == na::Matrix6::from_diagonal(&m.diagonal()) {
            CoefficientMatrix::Diagonal(m.diagonal().into())
        } else {
            CoefficientMatrix::Full(Box::new([0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|k| m[(i, k)]))))
        }
    };
    let (linear, quadratic) = (coefficients(&body.damping.linear), coefficients(&body.damping.quadratic));
    if (&linear, &quadratic) == (&CoefficientMatrix::None, &CoefficientMatrix::None) {
        return None;
    }
    Some(damping_at(linear, quadratic, hydrodynamic))
}

/// Damping with coefficients in the frame at `at`. Where its axes lie along the body's, the coefficients are permuted instead
/// of rotating the twist: `v |v|` is odd, so the quadratic part allows this as well.
fn damping_at(linear: CoefficientMatrix<f64>, quadratic: CoefficientMatrix<f64>, at: &Pose<f64>) -> Damping<f64> {
    let Some((axes, [sin, cos])) = z_aligned(&at.rotation) else {
        let linear_bound = linear_bound(&linear);
        let frame = CoefficientFrame::General(at.rotation.0, at.position.0);
        return Damping { frame, linear, quadratic, linear_bound };
    };
    let frame = if sin != 0.0 {
        CoefficientFrame::General([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], at.position.0)
    } else if at.position.0 != [0.0; 3] {
        CoefficientFrame::Shifted(at.position.0)
    } else {
        CoefficientFrame::Body
    };
    let (linear, quadratic) = (permuted(&linear, &axes), permuted(&quadratic, &axes));
    let linear_bound = linear_bound(&linear);
    Damping { frame, linear, quadratic, linear_bound }
}

/// Greatest ratio of lift to the damping of the same motion that is bounded in full: a bound for more would slow down
/// motions that are not stiff.
const GREATEST_LIFT: f64 = 30.0;

/// `S + N^T S^-1 N` of a full D_L: see [`Damping::linear_bound`].
fn linear_bound(linear: &CoefficientMatrix<f64>) -> Option<SpatialInertia<f64>> {
    let CoefficientMatrix::Full(rows) = linear else { return None };
    let d = na::Matrix6::from_fn(|i, k| rows[i][k]);
    let (s, n) = ((d + d.transpose()) / 2.0, (d - d.transpose()) / 2.0);
    let bound = |s: na::Matrix6<f64>| {
        let factor = s.cholesky()?;
        let half = factor.l().solve_lower_triangular(&n)?;
        let ratio = factor.l().solve_lower_triangular(&half.transpose())?.norm();
        (ratio <= GREATEST_LIFT).then(|| half.tr_mul(&half))
    };
    // Where lift comes with too little damping, S is increased in proportion to the lift of each axis.
    let least = na::Matrix6::from_fn(|i, k| if i == k { n.row(i).abs().sum() / GREATEST_LIFT } else { 0.0 });
    let bound = s + bound(s).or_else(|| bound(s + 2.0 * least)).unwrap_or_else(na::Matrix6::zeros);
    Some(SpatialInertia::from_entries(|i, k| bound[(i, k)]))
}

/// Signed permutation: for each axis of one frame, the parallel axis of another and its sign.
type Axes = [(usize, f64); 3];

/// Decomposition of a rotation into a signed permutation of axes and a rotation about z, given by its sine and cosine; none
/// unless one of the axes is parallel to z.
fn z_aligned(rotation: &Matrix3<f64>) -> Option<(Axes, [f64; 2])> {
    let rows = &rotation.0;
    let along = |row: usize| (0..3).max_by(|&i, &k| rows[row][i].abs().total_cmp(&rows[row][k].abs()));
    let (x, z) = (along(0)?, along(2)?);
    if (0..3).any(|k| k != z && rows[2][k].abs() > 1e-14) {
        return None;
    }
    let y = 3 - x - z;
    let axes = [(x, rows[0][x].signum()), (y, rows[1][y].signum()), (z, rows[2][z].signum())];
    let [sin, cos] = [rows[1][x], rows[0][x]].map(|entry| entry * axes[0].1);
    Some((axes, if sin.abs() > 1e-14 { [sin, cos] } else { [0.0, 1.0] }))
}

/// Coefficients after a signed permutation of the axes.
fn permuted(coefficients: &CoefficientMatrix<f64>, axes: &Axes) -> CoefficientMatrix<f64> {
    let of = |i: usize| (axes[i % 3].0 + i / 3 * 3, axes[i % 3].1);
    let six = [0, 1, 2, 3, 4, 5];
    match coefficients {
        CoefficientMatrix::None => CoefficientMatrix::None,
        CoefficientMatrix::Diagonal(d) => CoefficientMatrix::Diagonal(six.map(|i| d[of(i).0])),
        CoefficientMatrix::Full(rows) => {
            let entry = |i: usize, k: usize| of(i).1 * of(k).1 * rows[of(i).0][of(k).0];
            CoefficientMatrix::Full(Box::new(six.map(|i| six.map(|k| entry(i, k)))))
        }
    }
}

/// Terms of a moving body and their parts, summed over `parts`, in the frame that has the body's own frame at `link`.
fn merged(parts: &[Part], link: &Pose<f64>) -> (BodyTerms<f64>, UnscaledBodyTerms<f64>) {
    let none = Restoring { net_mass: 0.0, moment: [0.0; 3] };
    let (rigid, added) = (SpatialInertia::zero(), SpatialInertia::zero());
    let mut sum = UnscaledBodyTerms { rigid, added, central: None, weight: none, displaced: none };
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
        damping.extend(part.damping.iter().map(|d| damping_at(d.linear.clone(), d.quadratic.clone(), &at(d))));
    }
    (sum.rigid, sum.added) = (tidy_inertia(&sum.rigid), tidy_inertia(&sum.added));
    let moment = (Vector3(sum.weight.moment) - Vector3(sum.displaced.moment)).0;
    let restoring = Restoring { net_mass: sum.weight.net_mass - sum.displaced.net_mass, moment };
    let restoring = (restoring != none).then_some(restoring);
    let central = match damping.first() {
        Some(damping) => central(&sum, damping),
        None => central(&sum, &undamped(parts, link, &sum.rigid)),
    };
    let central = central.map(|(central, parts)| {
        sum.central = Some(parts);
        central
    });
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

/// Greatest off-diagonal entry of an inertia that counts as rounding, relative to the diagonal entries that it couples.
const OFF_DIAGONAL: f64 = 1e-14;

/// The inertia with off-diagonal rounding replaced by zeros. (Products of such numbers with each other are subnormal in
/// single precision, on which a processor spends a hundred times as long.)
fn tidy_inertia(inertia: &SpatialInertia<f64>) -> SpatialInertia<f64> {
    SpatialInertia::from_entries(|i, k| {
        let entry = inertia.entry(i, k);
        let size = (inertia.entry(i, i) * inertia.entry(k, k)).sqrt();
        if i != k && entry.abs() <= OFF_DIAGONAL * size { 0.0 } else { entry }
    })
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
        let size = |k: usize| here.entry(k, k).max(there.entry(k, k));
        let entry = |i: usize, k: usize| {
            let entry = there.entry(i, k);
            if entry.abs() > OFF_DIAGONAL * (size(i) * size(k)).sqrt() { entry } else { 0.0 }
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
        off.dot(off).sqrt() <= OFF_DIAGONAL * size
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
        CoefficientFrame::Body => identity(),
        CoefficientFrame::Shifted(p) => Pose { rotation: Matrix3::identity(), position: Vector3(p) },
        CoefficientFrame::General(r, p) => Pose { rotation: Matrix3(r), position: Vector3(p) },
    }
}

fn friction(joint: &Joint) -> Option<Friction<f64>> {
    let f = &joint.friction;
    let coulomb = (f.coulomb != 0.0).then_some([f.coulomb, f.coulomb_speed * f.coulomb_speed]);
    (f.viscous != 0.0 || coulomb.is_some()).then_some(Friction { viscous: f.viscous, coulomb })
}

fn servo(joint: &Joint) -> Option<Servo<f64>> {
    let gains = joint.servo.as_ref().filter(|s| s.kp != 0.0 || s.kd != 0.0)?;
    Some(Servo { kp: gains.kp, kd: gains.kd })
}

fn actuator(given: &LinearActuator) -> Actuator<f64> {
    let (a, b) = (given.base, given.lever);
    Actuator { angle: given.angle, stroke: [a * a + b * b, 2.0 * a * b], force: given.force * a * b }
}

fn vehicle_servo(vehicle: &Vehicle) -> Option<VehicleServo<f64>> {
    let gains = vehicle.servo.as_ref().filter(|s| s.kp.iter().chain(&s.kd).any(|&gain| gain != 0.0))?;
    Some(VehicleServo { kp: gains.kp, kd: gains.kd })
}

/// End stops, unless stiffness and damping are 0.
fn limits(joint: &Joint) -> Option<Limits<f64>> {
    let limits = joint.limits.as_ref().filter(|l| l.stiffness != 0.0 || l.damping != 0.0)?;
    Some(Limits { range: [limits.lower, limits.upper], stop: [limits.stiffness, limits.damping] })
}

fn identity() -> Pose<f64> {
    Pose { rotation: Matrix3::identity(), position: Vector3::zero() }
}

fn vector(v: &na::Vector3<f64>) -> Vector3<f64> {
    Vector3([v.x, v.y, v.z])
}

fn pose(frame: &Frame) -> Pose<f64> {
    let r = frame.rotation();
    let rotation = Matrix3([0, 1, 2].map(|i| [0, 1, 2].map(|k| r[(i, k)])));
    tidy(&Pose { rotation, position: vector(&frame.position) })
}
