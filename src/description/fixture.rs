//! Fixtures: mechanisms in the world with one joint, such as valves, buttons and drawers.

use serde::{Deserialize, Serialize};

use super::{Body, Joint, JointKind, MAX_JOINTS, Scene, WORLD, check};
use crate::error::Problem;
use crate::keys::{Fault, check_names, range};

/// A mechanism with one joint in the world. Its frame lies at the joint and moves with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fixture {
    /// Name, by which shapes and keys select the fixture.
    pub name: String,
    /// Joint between the world and the fixture; its `frame` is in the world.
    pub joint: Joint,
    /// Rigid body and hydrodynamics in the fixture's frame. Without it the joint needs `rotor_inertia`.
    pub body: Option<Body>,
}

impl Scene {
    /// Joints of all coordinates: those of the arm, as [`Scene::joints`], then the fixtures'.
    pub fn coordinates(&self) -> impl Iterator<Item = &Joint> {
        self.joints().chain(self.fixtures.iter().map(|fixture| &fixture.joint))
    }

    /// Names of the coordinates, in the order of [`Scene::coordinates`].
    pub fn coordinate_names(&self) -> Vec<String> {
        let fixtures = self.fixtures.iter().map(|fixture| fixture.name.clone());
        self.joint_names().into_iter().chain(fixtures).collect()
    }

    /// Keys of the coordinates' joints: those of the arm, then `fixtures[0].joint`, ...
    pub fn coordinate_keys(&self) -> Vec<String> {
        let fixtures = (0..self.fixtures.len()).map(|i| format!("fixtures[{i}].joint"));
        self.joint_keys().into_iter().chain(fixtures).collect()
    }

    /// The scene without contact and fixtures: the part that controllers, planners and estimators model.
    pub fn robot(&self) -> Self {
        let mut robot = Self { contact: None, fixtures: Vec::new(), ..self.clone() };
        robot.provenance.prune(&robot.to_tree());
        robot
    }

    /// Checks names, joints and inertia of the fixtures.
    pub(super) fn validate_fixtures(&self) -> Result<(), Fault> {
        let names = || self.fixtures.iter().map(|fixture| fixture.name.as_str());
        let [vehicle, base] = check::RESERVED;
        check_names(names(), &[vehicle, base, WORLD], "fixtures")?;
        let links = self.arm.iter().flat_map(|arm| &arm.links);
        for link in links {
            if let Some(i) = names().position(|name| name == link.name) {
                let problem = Problem::Name { name: link.name.clone(), reason: "taken by a link" };
                return Err(Fault::new(format!("fixtures[{i}].name"), problem));
            }
        }
        let found = self.coordinates().count();
        if !self.fixtures.is_empty() && found > MAX_JOINTS {
            return Err(Fault::new("fixtures", Problem::TooManyJoints { found, max: MAX_JOINTS }));
        }
        for (i, Fixture { joint, body, .. }) in self.fixtures.iter().enumerate() {
            let key = format!("fixtures[{i}].joint");
            if joint.kind == JointKind::Fixed {
                let reason = "must be revolute or prismatic: state what does not move as a shape on the world";
                return Err(Fault::new(format!("{key}.kind"), Problem::Invalid { reason }));
            }
            check::joint(joint, &key)?;
            let inertia = joint.rotor_inertia;
            let rule = "> 0 where the fixture has no body";
            range(body.is_some() || inertia > 0.0, inertia, rule, || format!("{key}.rotor_inertia"))?;
        }
        Ok(())
    }
}
