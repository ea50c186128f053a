//! Validity of a robot's numbers, in any format.

use nalgebra::{Matrix3, Vector3};

use super::element::Result;
use super::{Inertial, Robot, RobotJoint, RobotJointKind};

/// Largest angle that is no sign of degrees, rad.
const TURN: f64 = 2.0 * std::f64::consts::PI;
/// Largest limit of a joint that is no sign of degrees, rad.
const TURNS: f64 = 4.0 * TURN;

impl Robot {
    /// Refuses numbers that no robot has. What depends on its use, such as moments of inertia, is checked there.
    pub(super) fn check(&self) -> Result<()> {
        if self.links.is_empty() {
            return self.refuse("has no links");
        }
        for link in &self.links {
            let place = format!("link \"{}\"", link.name);
            let fault = |problem: String| self.fault(link.line, &place, problem);
            if let Some(mass) = link.inertial.as_ref().map(|own| own.mass).filter(|mass| *mass < 0.0) {
                return fault(format!("mass is {mass}, but must be >= 0"));
            }
            for (i, shape) in link.shapes.iter().enumerate() {
                if let Some((key, problem)) = shape.faults() {
                    return fault(format!("shapes[{i}].{key} {problem}"));
                }
            }
        }
        self.joints.iter().try_for_each(|joint| self.check_joint(joint))?;
        for thruster in &self.thrusters {
            if thruster.link.is_some() == thruster.joint.is_some() {
                let place = format!("thruster \"{}\"", thruster.name);
                return self.fault(thruster.line, &place, "needs either a link or a joint");
            }
        }
        Ok(())
    }

    fn check_joint(&self, joint: &RobotJoint) -> Result<()> {
        let fault = |problem: String| self.fault(joint.line, &format!("joint \"{}\"", joint.name), problem);
        let turns = !matches!(joint.kind, RobotJointKind::Fixed | RobotJointKind::Floating);
        if turns && joint.axis.norm() < 1e-9 {
            return fault("axis must have a nonzero length".to_owned());
        }
        if let Some([lower, upper]) = joint.limits.filter(|[lower, upper]| lower > upper) {
            return fault(format!("lower limit is {lower}, but must be below the upper one, {upper}"));
        }
        let numbers = [
            ("damping", joint.damping),
            ("friction", joint.friction),
            ("armature", joint.armature),
            ("stiffness", joint.stiffness),
        ];
        for (key, x) in numbers {
            if x < 0.0 {
                return fault(format!("{key} is {x}, but must be >= 0"));
            }
        }
        Ok(())
    }

    /// Numbers that look like degrees in place of radians, one sentence each.
    pub(super) fn doubts(&self) -> Vec<String> {
        let far = |rpy: &Vector3<f64>| rpy.amax() > TURN * (1.0 + 1e-3);
        let turned = |name: &str, what: &str| format!("{name}: {what} turns by more than 2 pi rad: degrees?");
        let links = self.links.iter().filter_map(|link| {
            let inertial = link.inertial.iter().map(|own| own.rpy);
            let all = inertial.chain(link.shapes.iter().map(|s| s.rpy)).chain(link.meshes.iter().map(|m| m.rpy));
            all.into_iter().any(|rpy| far(&rpy)).then(|| turned(&link.name, "an origin"))
        });
        let joints = self.joints.iter().flat_map(|joint| {
            let frame = far(&joint.rpy).then(|| turned(&joint.name, "its origin"));
            let wide = joint.kind == RobotJointKind::Revolute
                && joint.limits.is_some_and(|limits| limits.iter().any(|x| x.abs() > TURNS));
            let limits = wide.then(|| format!("{}: its limits are several turns, rad: degrees?", joint.name));
            frame.into_iter().chain(limits)
        });
        links.chain(joints).collect()
    }
}

/// Moments of inertia that no body has: not positive, or the largest above the sum of the others.
pub enum Impossible {
    /// Principal moments in ascending order, of which one is not positive.
    Negative(String),
    /// Principal moments in ascending order, and the nearest ones that a body has: the smaller two grow by the factor by which the
    /// largest shrinks.
    Triangle(String, Matrix3<f64>),
}

/// Fault of moments of inertia that no body has.
pub fn impossible(inertia: &Matrix3<f64>) -> Option<Impossible> {
    let mut eigen = inertia.symmetric_eigen();
    let mut moments: Vec<f64> = eigen.eigenvalues.iter().copied().collect();
    moments.sort_by(f64::total_cmp);
    let text = || moments.iter().map(|x| format!("{x:.4e}")).collect::<Vec<_>>().join(", ");
    if moments[0] <= 0.0 {
        return Some(Impossible::Negative(text()));
    }
    let (largest, others) = (moments[2], moments[0] + moments[1]);
    if largest <= others * (1.0 + 1e-6) {
        return None;
    }
    let factor = (largest / others).sqrt();
    eigen.eigenvalues.apply(|x| *x = if *x == largest { largest / factor } else { *x * factor });
    let near = eigen.recompose();
    Some(Impossible::Triangle(text(), (near + near.transpose()) / 2.0))
}

impl Inertial {
    /// True if it has a mass without moments of inertia.
    pub(super) fn is_point(&self) -> bool {
        self.inertia == Matrix3::zeros()
    }
}
