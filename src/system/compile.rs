//! From a scene to the constants of the kernel.

use nalgebra as na;

use super::appendages::{fins, tether};
use super::chain::{Line, inverse, joint_frames, shift, tidy};
use super::model::{Actuator, BodyTerms, Constant, Friction, JointTerms, Limits, Servo, System, VehicleServo};
use super::propulsion::thrusters;
use super::variation::{CentralInertia, Ingredients};
use crate::description::{Body, Frame, Joint, JointKind, LinearActuator, Scene, Vehicle, Water};
use crate::hydro::{Central, Coefficients, Drag, Placement, Restoring, Turn};
use crate::lane::Shared;
use crate::lie::{Matrix3, Pose, Vector3};
use crate::spatial::{Place, SpatialInertia};

/// A system, and the link frames of its scene in the joint frames that it computes in.
#[derive(Debug, Clone)]
pub struct Compiled {
    /// What the kernel reads.
    pub system: System<Shared<f64>>,
    /// Constant pose of each link's frame in its joint's frame.
    pub links: Vec<Pose<f64>>,
    /// Where payloads are held: the end effector's origin in the last moving body's frame.
    pub grip: [f64; 3],
    /// What the terms of each moving body are made of, vehicle first.
    pub ingredients: Vec<Ingredients<Shared<f64>>>,
}

/// Compiles a checked scene: joins what is fixed together, chooses joint frames, drops absent terms.
pub fn compile(scene: &Scene) -> Compiled {
    let water = &scene.water;
    let mut parts = vec![Part::of(&scene.vehicle.body, identity(), water)];
    let mut vehicle = parts.split_off(0);
    let mut moving: Vec<(&Joint, Vec<Part>)> = Vec::new();
    // Pose at q = 0, in the vehicle frame, of each moving link's frame; and of the frame that the next part hangs on.
    let mut zero_poses: Vec<Pose<f64>> = Vec::new();
    let mut hook = identity();
    let mut tip = identity();

    if let Some(arm) = &scene.arm {
        hook = pose(&arm.mount.frame);
        if let Some(joint) = &arm.mount.joint {
            hook = hook.times(&pose(&joint.frame));
            zero_poses.push(hook);
            let base = arm.base.iter().map(|body| Part::of(body, identity(), water)).collect();
            moving.push((joint, base));
        } else {
            vehicle.extend(arm.base.iter().map(|body| Part::of(body, hook, water)));
        }
        for link in &arm.links {
            hook = hook.times(&pose(&link.joint.frame));
            zero_poses.push(hook);
            moving.push((&link.joint, vec![Part::of(&link.body, identity(), water)]));
        }
        tip = pose(&arm.end_effector);
    }
    if let Some(payload) = &scene.payload {
        let grip = tip.times(&pose(&payload.frame));
        match moving.last_mut() {
            Some((_, last)) => last.push(Part::of(&payload.body, grip, water)),
            None => vehicle.push(Part::of(&payload.body, hook.times(&grip), water)),
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
    let mut ingredients = vec![of_vehicle.map(Shared)];
    let joints: Vec<JointTerms<f64>> = moving
        .iter()
        .zip(&frames)
        .zip(&links)
        .map(|(((joint, parts), frame), link)| {
            let prismatic = joint.kind == JointKind::Prismatic;
            let (body, of_body) = merged(parts, link);
            ingredients.push(of_body.map(Shared));
            JointTerms {
                stand: frame.stand,
                offset: if prismatic { frame.d } else { frame.theta },
                constant: if prismatic { turn(frame.theta) } else { Constant::Shift(shift(frame.d)) },
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
        ingredients.iter().all(|of| [&of.rigid, &of.added].iter().all(|part| part.map(|Shared(x)| x).is_sparse()));
    let system = System {
        sparse,
        upright: joints.iter().all(|joint| joint.body.is_upright()),
        gravity: water.gravity.into(),
        fixed: scene.vehicle.fixed,
        vehicle,
        joints,
        vehicle_servo: vehicle_servo(&scene.vehicle),
        thrusters: thrusters(&scene.vehicle),
        fins: fins(scene),
        tether: tether(scene),
    };
    let grip = tidy(&links.last().unwrap_or(&hook).times(&tip)).position.0;
    Compiled { system: system.map(Shared), links, grip, ingredients }
}

/// One body of the scene, fixed to a moving body at `at`; all else in its own frame.
struct Part {
    at: Pose<f64>,
    rigid: SpatialInertia<f64>,
    added: SpatialInertia<f64>,
    /// Mass and displaced mass that gravity acts on, each with its moment.
    weight: Restoring<f64>,
    displaced: Restoring<f64>,
    /// Frame of added mass and drag.
    hydrodynamic: Pose<f64>,
    drag: Option<Drag<f64>>,
}

impl Part {
    fn of(body: &Body, at: Pose<f64>, water: &Water) -> Self {
        let hydrodynamic = pose(&body.hydrodynamic_frame);
        let added = &body.added_mass;
        // Without gravity there is neither weight nor buoyancy.
        let heavy = if water.gravity.norm() == 0.0 { 0.0 } else { 1.0 };
        let pull = |mass: f64, at: &na::Vector3<f64>| Restoring { net_mass: mass, moment: (mass * at).into() };
        Self {
            at,
            rigid: rigid_inertia(body.mass, &body.center_of_mass, &body.inertia_about_com()),
            added: SpatialInertia::from_entries(|i, k| added[(i, k)]).to_parent(&hydrodynamic),
            weight: pull(heavy * body.mass, &body.center_of_mass),
            displaced: pull(heavy * water.density * body.displaced_volume(water), &body.center_of_buoyancy),
            drag: drag(body, &hydrodynamic),
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

fn drag(body: &Body, hydrodynamic: &Pose<f64>) -> Option<Drag<f64>> {
    let coefficients = |m: &na::Matrix6<f64>| {
        if m.iter().all(|&x| x == 0.0) {
            Coefficients::None
        } else if *m == na::Matrix6::from_diagonal(&m.diagonal()) {
            Coefficients::Diagonal(m.diagonal().into())
        } else {
            Coefficients::Full(Box::new([0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|k| m[(i, k)]))))
        }
    };
    let (linear, quadratic) = (coefficients(&body.damping.linear), coefficients(&body.damping.quadratic));
    if (&linear, &quadratic) == (&Coefficients::None, &Coefficients::None) {
        return None;
    }
    Some(placed(linear, quadratic, hydrodynamic))
}

/// Drag whose coefficients are given at `at`. As far as that frame's axes lie along the body's, the coefficients change
/// places and the frame needs no turning: `v |v|` is odd, so even its quadratic part allows that.
fn placed(linear: Coefficients<f64>, quadratic: Coefficients<f64>, at: &Pose<f64>) -> Drag<f64> {
    let Some((axes, [sin, cos])) = upright(&at.rotation) else {
        let linear_bound = linear_bound(&linear);
        return Drag { placement: Placement::At(at.rotation.0, at.position.0), linear, quadratic, linear_bound };
    };
    let placement = if sin != 0.0 {
        Placement::At([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]], at.position.0)
    } else if at.position.0 != [0.0; 3] {
        Placement::Shifted(at.position.0)
    } else {
        Placement::Here
    };
    let (linear, quadratic) = (relabelled(&linear, &axes), relabelled(&quadratic, &axes));
    let linear_bound = linear_bound(&linear);
    Drag { placement, linear, quadratic, linear_bound }
}

/// Greatest ratio of lift to the drag of the same motion that is bounded in full: a bound for more would hold back
/// motions that are not stiff at all.
const GREATEST_LIFT: f64 = 30.0;

/// `S + N^T S^-1 N` of a full D_L: see [`Drag::linear_bound`].
fn linear_bound(linear: &Coefficients<f64>) -> Option<SpatialInertia<f64>> {
    let Coefficients::Full(rows) = linear else { return None };
    let d = na::Matrix6::from_fn(|i, k| rows[i][k]);
    let (s, n) = ((d + d.transpose()) / 2.0, (d - d.transpose()) / 2.0);
    let bound = |s: na::Matrix6<f64>| {
        let factor = s.cholesky()?;
        let half = factor.l().solve_lower_triangular(&n)?;
        let ratio = factor.l().solve_lower_triangular(&half.transpose())?.norm();
        (ratio <= GREATEST_LIFT).then(|| half.tr_mul(&half))
    };
    // Where lift comes with too little drag some is made up, in the measure of each axis.
    let least = na::Matrix6::from_fn(|i, k| if i == k { n.row(i).abs().sum() / GREATEST_LIFT } else { 0.0 });
    let bound = s + bound(s).or_else(|| bound(s + 2.0 * least)).unwrap_or_else(na::Matrix6::zeros);
    Some(SpatialInertia::from_entries(|i, k| bound[(i, k)]))
}

/// For each axis of one frame, the axis of another along it and its sign.
type Axes = [(usize, f64); 3];

/// The axes of another frame along the body's once these are turned about z, if it has one along z; and sine and cosine of
/// that turn.
fn upright(rotation: &Matrix3<f64>) -> Option<(Axes, [f64; 2])> {
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

fn relabelled(coefficients: &Coefficients<f64>, axes: &Axes) -> Coefficients<f64> {
    let of = |i: usize| (axes[i % 3].0 + i / 3 * 3, axes[i % 3].1);
    let six = [0, 1, 2, 3, 4, 5];
    match coefficients {
        Coefficients::None => Coefficients::None,
        Coefficients::Diagonal(d) => Coefficients::Diagonal(six.map(|i| d[of(i).0])),
        Coefficients::Full(rows) => {
            let entry = |i: usize, k: usize| of(i).1 * of(k).1 * rows[of(i).0][of(k).0];
            Coefficients::Full(Box::new(six.map(|i| six.map(|k| entry(i, k)))))
        }
    }
}

/// The parts of a moving body together, in the frame that has the body's own frame at `link`: its terms, and what
/// they are made of.
fn merged(parts: &[Part], link: &Pose<f64>) -> (BodyTerms<f64>, Ingredients<f64>) {
    let none = Restoring { net_mass: 0.0, moment: [0.0; 3] };
    let (rigid, added) = (SpatialInertia::zero(), SpatialInertia::zero());
    let mut sum = Ingredients { rigid, added, central: None, weight: none, displaced: none };
    let mut drag = Vec::new();
    for part in parts {
        let at = link.times(&part.at);
        sum.rigid = sum.rigid.plus(&part.rigid.to_parent(&at));
        sum.added = sum.added.plus(&part.added.to_parent(&at));
        for (sum, part) in [(&mut sum.weight, &part.weight), (&mut sum.displaced, &part.displaced)] {
            let moment = at.rotation.apply(Vector3(part.moment)) + at.position.scale(part.net_mass);
            sum.net_mass += part.net_mass;
            sum.moment = (Vector3(sum.moment) + moment).0;
        }
        let at = |d: &Drag<f64>| at.times(&within(&d.placement));
        drag.extend(part.drag.iter().map(|d| placed(d.linear.clone(), d.quadratic.clone(), &at(d))));
    }
    (sum.rigid, sum.added) = (tidy_inertia(&sum.rigid), tidy_inertia(&sum.added));
    let moment = (Vector3(sum.weight.moment) - Vector3(sum.displaced.moment)).0;
    let restoring = Restoring { net_mass: sum.weight.net_mass - sum.displaced.net_mass, moment };
    let restoring = (restoring != none).then_some(restoring);
    let central = match drag.first() {
        Some(drag) => central(&sum, drag),
        None => central(&sum, &dragless(parts, link, &sum.rigid)),
    };
    let central = central.map(|(central, parts)| {
        sum.central = Some(parts);
        central
    });
    (BodyTerms { inertia: sum.rigid.plus(&sum.added), restoring, drag, central, load: None }, sum)
}

/// No drag where the centre of a body without any can but be: at that of its mass, along the axes of added mass.
fn dragless(parts: &[Part], link: &Pose<f64>, rigid: &SpatialInertia<f64>) -> Drag<f64> {
    let flooded = parts.iter().find(|part| (0..6).any(|k| part.added.entry(k, k) != 0.0));
    let rotation = flooded.map_or(Matrix3::identity(), |part| link.times(&part.at).times(&part.hydrodynamic).rotation);
    // [HC eq. 5]
    let (mass, moment) = (rigid.entry(0, 0), [rigid.entry(1, 5), rigid.entry(2, 3), rigid.entry(0, 4)]);
    let position = if mass == 0.0 { Vector3::zero() } else { Vector3(moment).scale(1.0 / mass) };
    placed(Coefficients::None, Coefficients::None, &Pose { rotation, position })
}

/// Entries of an inertia off its diagonal that are rounding, by the diagonal entries that they couple.
const OFF_DIAGONAL: f64 = 1e-14;

/// An inertia without the entries off its diagonal that are rounding. (Products of such numbers with each other are
/// subnormal in single precision, which a processor takes a hundred times as long for.)
fn tidy_inertia(inertia: &SpatialInertia<f64>) -> SpatialInertia<f64> {
    SpatialInertia::from_entries(|i, k| {
        let entry = inertia.entry(i, k);
        let size = (inertia.entry(i, i) * inertia.entry(k, k)).sqrt();
        if i != k && entry.abs() <= OFF_DIAGONAL * size { 0.0 } else { entry }
    })
}

/// A body in the frame of its drag (see [`dragless`] of one without any), if that is the centre of all and nothing but the
/// angular inertia has entries off its diagonal there; with what rigid and added inertia are there.
fn central(of: &Ingredients<f64>, drag: &Drag<f64>) -> Option<(Central<f64>, [CentralInertia<f64>; 2])> {
    let at = within(&drag.placement);
    let back = inverse(&at);
    let there = |inertia: &SpatialInertia<f64>| {
        // What is left of large terms that cancel on the way counts by the size of these.
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
    let coefficients = |c: &Coefficients<f64>| match c {
        Coefficients::None => Some([0.0; 6]),
        Coefficients::Diagonal(d) => Some(*d),
        Coefficients::Full(_) => None,
    };
    let along = [coefficients(&drag.linear)?, coefficients(&drag.quadratic)?];
    let [rigid, added] = &parts;
    let [masses @ .., x, y, z] = [0, 1, 2, 3, 4, 5].map(|k| rigid.diagonal[k] + added.diagonal[k]);
    let products = [0, 1, 2].map(|k| rigid.products[k] + added.products[k]);
    let central = Central {
        place: Place::of(at.position.0.map(|x| shift(x).unwrap_or(0.0))),
        turn: match drag.placement {
            Placement::At([[cos, ..], [sin, ..], [.., 1.0]], _) => Turn::Upright(sin, cos),
            Placement::At(rows, _) => Turn::Whole(rows),
            _ => Turn::None,
        },
        masses,
        gyration: [z - y, x - z, y - x],
        products: (rigid.products != [0.0; 3] || added.products != [0.0; 3]).then_some(products),
        drag: (along != [[0.0; 6]; 2]).then_some(along),
        net_mass: of.weight.net_mass - of.displaced.net_mass,
    };
    Some((central, parts))
}

fn within(placement: &Placement<f64>) -> Pose<f64> {
    match *placement {
        Placement::Here => identity(),
        Placement::Shifted(p) => Pose { rotation: Matrix3::identity(), position: Vector3(p) },
        Placement::At(r, p) => Pose { rotation: Matrix3(r), position: Vector3(p) },
    }
}

fn turn(theta: f64) -> Constant<f64> {
    let (sin, cos) = theta.sin_cos();
    Constant::Turn(sin, cos)
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

/// End stops, if they push at all.
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
