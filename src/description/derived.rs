//! Quantities derived from a scene without dynamics: names, volumes, inertia about the centre of mass.

use nalgebra::{Matrix3, Matrix6};

use super::{Body, Frame, InertiaPoint, Joint, Scene, Water};

/// Maximum number of moving joints of a scene, those of fixtures included.
pub const MAX_JOINTS: usize = 16;
/// Maximum number of links of an arm, those on fixed joints included.
pub const MAX_LINKS: usize = 64;
/// Name of the vehicle among the moving bodies.
pub const VEHICLE: &str = "vehicle";
/// Name of the world, which carries shapes.
pub const WORLD: &str = "world";
/// Name of the joint-loaded arm base among the moving bodies, and of its joint q0.
pub const BASE: &str = "base";

impl Frame {
    /// `Ad^-1 = [[R^T, -R^T [r]], [0, R^T]]`: takes twists of the parent frame to this one. `[HC eq. 7]`
    pub(crate) fn adjoint_inverse(&self) -> Matrix6<f64> {
        let r_t = self.rotation().transpose();
        let mut adjoint = Matrix6::zeros();
        adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&r_t);
        adjoint.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-r_t * self.position.cross_matrix()));
        adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&r_t);
        adjoint
    }
}

impl Body {
    /// Inertia about the centre of mass, body axes, kg m2: `I_c = I_o + m [c][c]` if it is stated about the origin.
    pub fn inertia_about_com(&self) -> Matrix3<f64> {
        match self.inertia_at {
            InertiaPoint::Com => self.inertia,
            InertiaPoint::Origin => {
                let c = self.center_of_mass.cross_matrix();
                self.inertia + self.mass * c * c
            }
        }
    }

    /// Displaced volume, m3: as stated, from the buoyancy, or 0.
    pub fn displaced_volume(&self, water: &Water) -> f64 {
        match (self.volume, self.buoyancy) {
            (Some(volume), _) => volume,
            (None, Some(buoyancy)) => buoyancy / (water.density * water.gravity.norm()),
            (None, None) => 0.0,
        }
    }
}

impl Scene {
    /// The scene without arm, payload and the spheres on them.
    pub fn bare_vehicle(&self) -> Self {
        let mut scene = Self { arm: None, payload: None, ..self.clone() };
        scene.contact.iter_mut().for_each(|contact| contact.spheres.retain(|sphere| sphere.on == VEHICLE));
        scene.provenance.prune(&scene.to_tree());
        scene
    }

    /// Joints in the order of every joint array: q0 of joint loading first.
    pub fn joints(&self) -> impl Iterator<Item = &Joint> {
        self.arm.iter().flat_map(|arm| {
            arm.mount.joint.iter().chain(arm.links.iter().filter(|link| link.moves()).map(|link| &link.joint))
        })
    }

    /// The joints, mutable, in the same order.
    pub fn joints_mut(&mut self) -> impl Iterator<Item = &mut Joint> {
        let arm = self.arm.iter_mut();
        arm.flat_map(|arm| {
            let links = arm.links.iter_mut().filter(|link| link.moves());
            arm.mount.joint.iter_mut().chain(links.map(|link| &mut link.joint))
        })
    }

    /// Names of the joints, equal to the names of the bodies that they carry: `base` for q0, else the link's.
    pub fn joint_names(&self) -> Vec<String> {
        self.arm
            .iter()
            .flat_map(|arm| {
                let base = arm.mount.joint.iter().map(|_| BASE.to_owned());
                base.chain(arm.links.iter().filter(|link| link.moves()).map(|link| link.name.clone()))
            })
            .collect()
    }

    /// Names of the moving bodies: `vehicle`, then one per joint. A fixed-loaded arm base and links on fixed joints are parts of
    /// the body that carries them, the payload of the body that carries the end effector.
    pub fn body_names(&self) -> Vec<String> {
        std::iter::once(VEHICLE.to_owned()).chain(self.joint_names()).collect()
    }

    /// Names of the thrusters.
    pub fn thruster_names(&self) -> Vec<String> {
        self.vehicle.thrusters.iter().map(|thruster| thruster.name.clone()).collect()
    }

    /// Names of the fins.
    pub fn fin_names(&self) -> Vec<String> {
        self.vehicle.fins.iter().map(|fin| fin.name.clone()).collect()
    }

    /// Coordinates at the start of a run, rad or m, in the order of [`Scene::coordinates`]; 0 past the last.
    pub fn home(&self) -> [f64; MAX_JOINTS] {
        let mut home = [0.0; MAX_JOINTS];
        home.iter_mut().zip(self.coordinates()).for_each(|(home, joint)| *home = joint.home);
        home
    }

    /// Keys of the joints: `arm.mount.joint` if there is one, `arm.links[0].joint`, ...
    pub fn joint_keys(&self) -> Vec<String> {
        let mount = self.arm.iter().filter(|arm| arm.mount.joint.is_some()).map(|_| "arm.mount.joint".to_owned());
        let links = self.arm.iter().flat_map(|arm| arm.links.iter().enumerate().filter(|(_, link)| link.moves()));
        let links = links.map(|(i, _)| format!("arm.links[{i}].joint"));
        mount.chain(links).collect()
    }

    /// All bodies of the scene with their paths.
    pub(super) fn bodies(&self) -> impl Iterator<Item = (String, &Body)> {
        let base = self.arm.iter().flat_map(|arm| &arm.base).map(|body| ("arm.base".to_owned(), body));
        let links = self.arm.iter().flat_map(|arm| arm.links.iter().enumerate());
        let links = links.filter_map(|(i, link)| Some((format!("arm.links[{i}].body"), link.body.as_ref()?)));
        let payload = self.payload.iter().map(|payload| ("payload.body".to_owned(), &payload.body));
        let fixtures = self.fixtures.iter().enumerate();
        let fixtures =
            fixtures.filter_map(|(i, fixture)| Some((format!("fixtures[{i}].body"), fixture.body.as_ref()?)));
        let vehicle = std::iter::once(("vehicle.body".to_owned(), &self.vehicle.body));
        vehicle.chain(base).chain(links).chain(payload).chain(fixtures)
    }

    /// All bodies of the scene.
    pub(super) fn bodies_mut(&mut self) -> impl Iterator<Item = &mut Body> {
        let arm = self.arm.iter_mut();
        let arm = arm.flat_map(|arm| arm.base.iter_mut().chain(arm.links.iter_mut().flat_map(|link| &mut link.body)));
        let payload = self.payload.iter_mut().map(|payload| &mut payload.body);
        let fixtures = self.fixtures.iter_mut().flat_map(|fixture| &mut fixture.body);
        std::iter::once(&mut self.vehicle.body).chain(arm).chain(payload).chain(fixtures)
    }
}
