//! Physical validity of a scene.

use toml::Value;

use super::{
    Arm, Friction, Integration, Joint, JointKind, LinearActuator, MAX_JOINTS, MAX_LINKS, Scene, SceneWarning,
    ThrustMap, Thruster, check_body, path, thrust_table::MAX_POINTS,
};
use crate::error::{DescriptionError, Problem};
use crate::keys::{Fault, check_axis, check_names, check_not_negative, none_of, normalise, range};

/// Maximum magnitude of any number, so that no arithmetic on a scene overflows.
const MAX_MAGNITUDE: f64 = 1e12;

/// Names of bodies outside the list of links.
pub const RESERVED: [&str; 2] = [super::VEHICLE, super::BASE];

/// A fault for a number that is not finite or exceeds [`MAX_MAGNITUDE`].
pub fn magnitudes(root: &Value) -> Result<(), Fault> {
    match path::numbers(root).into_iter().find(|(_, x)| x.is_nan() || x.abs() > MAX_MAGNITUDE) {
        Some((key, value)) => Err(Fault::new(key, Problem::NotFinite { value, max: MAX_MAGNITUDE })),
        None => Ok(()),
    }
}

/// A name that is none of the bodies before link `count`.
fn no_body(arm: &Arm, count: usize, value: &str, key: String) -> Fault {
    let links = arm.links[..count].iter().map(|link| link.name.as_str());
    none_of(value, "bodies before it", [super::VEHICLE, super::BASE].into_iter().chain(links), key)
}

fn thruster(thruster: &Thruster, key: &str) -> Result<(), Fault> {
    check_axis(&thruster.axis, || format!("{key}.axis"))?;
    let [lower, upper] = thruster.limits;
    if !(lower <= 0.0 && 0.0 <= upper && lower < upper) {
        let rule = "enclose 0, the lower below the upper";
        return Err(Fault::new(format!("{key}.limits"), Problem::Limits { lower, upper, rule }));
    }
    let optional = [("lag", thruster.lag), ("dead_band", thruster.dead_band), ("ambient_flow", thruster.ambient_flow)];
    check_not_negative(key, optional.map(|(name, value)| (name, value.unwrap_or(0.0))))?;
    let deduction = thruster.deduction.unwrap_or(0.0);
    range((0.0..1.0).contains(&deduction), deduction, "at least 0 and below 1", || format!("{key}.deduction"))?;
    match &thruster.map {
        Some(ThrustMap::Points(points)) => thrust_map(points, &format!("{key}.map")),
        _ => Ok(()),
    }
}

fn thrust_map(points: &[[f64; 2]], key: &str) -> Result<(), Fault> {
    let fault = |reason| Err(Fault::new(key, Problem::Invalid { reason }));
    if points.len() > MAX_POINTS {
        return Err(Fault::new(key, Problem::TooMany { found: points.len(), max: MAX_POINTS }));
    }
    if !points.contains(&[0.0, 0.0]) {
        return fault("must contain the pair [0, 0]");
    }
    if points.windows(2).any(|pair| pair[0][0] >= pair[1][0]) {
        return fault("commands must ascend");
    }
    if points.windows(2).any(|pair| pair[0][1] > pair[1][1]) {
        return fault("thrusts must not descend");
    }
    Ok(())
}

fn actuator(actuator: &LinearActuator, joint: &Joint, key: &str) -> Result<(), Fault> {
    if joint.kind != JointKind::Revolute || joint.effort.is_some() {
        let reason = "needs a revolute joint without effort: its force takes the place of effort";
        return Err(Fault::new(key, Problem::Invalid { reason }));
    }
    for (name, value) in [("base", actuator.base), ("lever", actuator.lever)] {
        range(value > 0.0, value, "> 0", || format!("{key}.{name}"))?;
    }
    check_not_negative(key, [("force", actuator.force)])?;
    // The lever arm is 0 where both points and the axis are collinear, and changes its sign there.
    let reach = joint.limits.as_ref().map_or([0.0; 2], |limits| [limits.lower, limits.upper]);
    for q in reach {
        let angle = actuator.angle + q;
        let ok = 0.0 < angle && angle < std::f64::consts::PI;
        range(ok, actuator.angle, "a value that keeps angle + q between 0 and pi within the limits", || {
            format!("{key}.angle")
        })?;
    }
    Ok(())
}

/// A fixed joint has a frame alone.
fn fixed_joint(joint: &Joint, key: &str) -> Result<(), Fault> {
    let given = [
        ("axis", joint.axis.iter().any(|x| !x.is_nan() && *x != 0.0)),
        ("rotor_inertia", joint.rotor_inertia != 0.0),
        ("prescribed", joint.prescribed),
        ("friction", joint.friction != Friction::default()),
        ("spring", joint.spring.is_some()),
        ("detent", joint.detent.is_some()),
        ("limits", joint.limits.is_some()),
        ("effort", joint.effort.is_some()),
        ("actuator", joint.actuator.is_some()),
        ("speed", joint.speed.is_some()),
        ("servo", joint.servo.is_some()),
        ("home", joint.home != 0.0),
    ];
    match given.iter().find(|(_, given)| *given) {
        Some((name, _)) => {
            let reason = "is given, but a fixed joint has only kind and frame";
            Err(Fault::new(format!("{key}.{name}"), Problem::Invalid { reason }))
        }
        None => Ok(()),
    }
}

/// Checks the numbers of a joint that moves.
pub fn joint(joint: &Joint, key: &str) -> Result<(), Fault> {
    if joint.axis.x.is_nan() {
        return Err(Fault::new(format!("{key}.axis"), Problem::Missing));
    }
    check_axis(&joint.axis, || format!("{key}.axis"))?;
    let above_zero = |name: &str, x: f64| range(x > 0.0, x, "> 0", || format!("{key}.{name}"));
    let friction = &joint.friction;
    let (rotor_inertia, effort) = (joint.rotor_inertia, joint.effort.unwrap_or(0.0));
    check_not_negative(key, [("friction.viscous", friction.viscous), ("friction.coulomb", friction.coulomb)])?;
    check_not_negative(key, [("rotor_inertia", rotor_inertia), ("effort", effort)])?;
    above_zero("friction.coulomb_speed", friction.coulomb_speed)?;
    match (friction.break_away, friction.stribeck_speed) {
        (Some(value), Some(speed)) => {
            range(value >= friction.coulomb, value, "at least coulomb", || format!("{key}.friction.static"))?;
            above_zero("friction.stribeck_speed", speed)?;
        }
        (Some(_), None) => return Err(Fault::new(format!("{key}.friction.stribeck_speed"), Problem::Missing)),
        (None, Some(_)) => return Err(Fault::new(format!("{key}.friction.static"), Problem::Missing)),
        (None, None) => {}
    }
    if let Some(spring) = &joint.spring {
        check_not_negative(key, [("spring.stiffness", spring.stiffness)])?;
    }
    if let Some(detent) = &joint.detent {
        check_not_negative(key, [("detent.torque", detent.torque)])?;
        above_zero("detent.period", detent.period)?;
    }
    if let Some(linear) = &joint.actuator {
        actuator(linear, joint, &format!("{key}.actuator"))?;
    }
    if let Some(speed) = joint.speed {
        above_zero("speed", speed)?;
    }
    if let Some(servo) = &joint.servo {
        check_not_negative(key, [("servo.kp", servo.kp), ("servo.kd", servo.kd)])?;
    }
    if let Some(limits) = &joint.limits {
        let (lower, upper, home) = (limits.lower, limits.upper, joint.home);
        if lower >= upper {
            let problem = Problem::Limits { lower, upper, rule: "ascend" };
            return Err(Fault::new(format!("{key}.limits"), problem));
        }
        check_not_negative(key, [("limits.stiffness", limits.stiffness), ("limits.damping", limits.damping)])?;
        if !(lower..=upper).contains(&home) {
            return Err(Fault::new(format!("{key}.home"), Problem::HomeOutside { home, lower, upper }));
        }
    }
    Ok(())
}

impl Scene {
    /// Checks the physical validity of the scene. Returns warnings about valid but suspicious values.
    ///
    /// # Errors
    /// [`DescriptionError::Value`] with the scene's name as its source.
    pub fn check(&self) -> Result<Vec<SceneWarning>, DescriptionError> {
        self.validate().map_err(|fault| fault.in_source(format!("scene '{}'", self.name), &self.to_tree()))
    }

    pub(super) fn validate(&self) -> Result<Vec<SceneWarning>, Fault> {
        let tree = self.to_tree();
        magnitudes(&tree)?;
        check_not_negative("water", [("density", self.water.density)])?;
        self.validate_vehicle()?;
        self.validate_arm()?;
        self.validate_fixtures()?;
        self.validate_contact()?;
        self.check_mesh_files()?;
        self.integration.iter().try_for_each(Integration::check)?;
        if let Some(on) = self.payload.as_ref().and_then(|payload| payload.on.as_ref()) {
            self.check_end_effector(on, "payload.on")?;
        }
        self.provenance.check(&tree)?;

        let mut warnings = Vec::new();
        for (key, body) in self.bodies() {
            let fixed = key == "vehicle.body" && self.vehicle.fixed;
            check_body::validate(body, &key, &self.water, fixed, &mut warnings)?;
        }
        Ok(warnings)
    }

    fn validate_vehicle(&self) -> Result<(), Fault> {
        check_names(self.vehicle.thrusters.iter().map(|t| t.name.as_str()), &[], "vehicle.thrusters")?;
        for (i, t) in self.vehicle.thrusters.iter().enumerate() {
            thruster(t, &format!("vehicle.thrusters[{i}]"))?;
        }
        let voltage = self.vehicle.supply_voltage();
        range(voltage > 0.0, voltage, "> 0", || "vehicle.voltage".to_owned())?;
        for table in self.vehicle.thrusters.iter().filter_map(|thruster| thruster.map.as_ref()?.table()) {
            let [lower, upper] = table.voltages();
            if !(lower <= voltage && voltage <= upper) {
                return Err(Fault::new("vehicle.voltage", Problem::Voltage { voltage, lower, upper }));
            }
        }
        check_not_negative("vehicle", [("thruster_lag", self.vehicle.thruster_lag.unwrap_or(0.0))])?;
        self.vehicle.check_terms()?;
        if let Some(servo) = &self.vehicle.servo {
            for (name, gains) in [("kp", servo.kp), ("kd", servo.kd)] {
                for (i, gain) in gains.into_iter().enumerate() {
                    range(gain >= 0.0, gain, ">= 0", || format!("vehicle.servo.{name}[{i}]"))?;
                }
            }
        }
        if let Some(shape) = &self.vehicle.shape {
            for (i, size) in shape.size.iter().enumerate() {
                range(*size > 0.0, *size, "> 0", || format!("vehicle.shape.size[{i}]"))?;
            }
            for (i, colour) in shape.colour.into_iter().enumerate() {
                range((0.0..=1.0).contains(&colour), colour, "0 to 1", || format!("vehicle.shape.colour[{i}]"))?;
            }
        }
        Ok(())
    }

    /// A fault for a name that is no body of the robot.
    pub(super) fn check_robot_body(&self, name: &str, key: &str) -> Result<(), Fault> {
        let links = self.arm.iter().flat_map(|arm| arm.links.iter().map(|link| link.name.as_str()));
        let names = std::iter::once(super::VEHICLE).chain(self.arm.iter().map(|_| super::BASE)).chain(links);
        if names.clone().any(|body| body == name) {
            return Ok(());
        }
        Err(none_of(name, "bodies of the robot", names, key))
    }

    fn validate_arm(&self) -> Result<(), Fault> {
        let Some(arm) = &self.arm else { return Ok(()) };
        if arm.links.len() > MAX_LINKS {
            return Err(Fault::new("arm.links", Problem::TooMany { found: arm.links.len(), max: MAX_LINKS }));
        }
        check_names(arm.links.iter().map(|link| link.name.as_str()), &RESERVED, "arm.links")?;
        if let Some(name) = arm.end_effectors.keys().find(|name| name.is_empty() || name.contains(['.', '[', ']'])) {
            let reason = "invalid: it must have a character, and dots and brackets are part of the syntax of keys";
            return Err(Fault::new("arm.end_effectors", Problem::Name { name: name.clone(), reason }));
        }
        if arm.mount.joint.is_some() && arm.base.is_none() {
            return Err(Fault::new("arm.base", Problem::MasslessBase));
        }
        if arm.mount.joint.as_ref().is_some_and(|joint| joint.kind == JointKind::Fixed) {
            let reason = "must be revolute or prismatic: without mount.joint the base is fixed";
            return Err(Fault::new("arm.mount.joint.kind", Problem::Invalid { reason }));
        }
        if self.joints().count() > MAX_JOINTS {
            return Err(Fault::new(
                "arm.links",
                Problem::TooManyJoints { found: self.joints().count(), max: MAX_JOINTS },
            ));
        }
        for (i, link) in arm.links.iter().enumerate() {
            if !link.moves() {
                fixed_joint(&link.joint, &format!("arm.links[{i}].joint"))?;
            } else if link.body.is_none() {
                return Err(Fault::new(format!("arm.links[{i}].body"), Problem::Missing));
            }
            if let (Some(parent), None) = (&link.parent, arm.parent(i)) {
                return Err(no_body(arm, i, parent, format!("arm.links[{i}].parent")));
            }
        }
        let named = arm.end_effectors.iter().map(|(name, of)| (format!("arm.end_effectors.{name}"), of));
        for (key, end_effector) in std::iter::once(("arm.end_effector".to_owned(), &arm.end_effector)).chain(named) {
            if let (Some(on), None) = (&end_effector.on, arm.carrier(end_effector)) {
                return Err(no_body(arm, arm.links.len(), on, format!("{key}.on")));
            }
        }
        self.joints().zip(self.joint_keys()).try_for_each(|(q, key)| joint(q, &key))
    }

    /// Normalises axes and makes symmetric matrices exactly symmetric. Idempotent.
    pub(super) fn make_canonical(&mut self) {
        self.vehicle.thrusters.iter_mut().for_each(|t| normalise(&mut t.axis));
        self.vehicle.normalise_terms();
        self.joints_mut().for_each(|joint| normalise(&mut joint.axis));
        self.fixtures.iter_mut().for_each(|fixture| normalise(&mut fixture.joint.axis));
        let links = self.arm.iter_mut().flat_map(|arm| &mut arm.links);
        links.filter(|link| !link.moves()).for_each(|link| link.joint.axis.fill(0.0));
        for body in self.bodies_mut() {
            body.inertia = (body.inertia + body.inertia.transpose()) / 2.0;
            body.added_mass = (body.added_mass + body.added_mass.transpose()) / 2.0;
        }
    }
}
