//! Scenes of contact.

use uvms_gym::description::Scene;

/// Numbers of the law: stiffness N/m, dissipation s/m, ramp m, friction, slip speed m/s.
#[derive(Debug, Clone, Copy)]
pub struct Numbers {
    pub stiffness: f64,
    pub dissipation: f64,
    pub ramp: f64,
    pub friction: f64,
    pub slip_speed: f64,
}

/// A ball of this mass and radius 0.1 m in a vacuum over a floor at z = 0, under this gravity.
pub fn ball(mass: f64, gravity: [f64; 3], numbers: Numbers) -> Scene {
    let Numbers { stiffness, dissipation, ramp, friction, slip_speed } = numbers;
    let inertia = 0.4 * mass * 0.01;
    let text = format!(
        "name = 'ball'\nwater = {{ density = 0.0, gravity = {gravity:?} }}\n[vehicle]\nname = 'ball'\n\
         body = {{ mass = {mass}, inertia = [{inertia}, {inertia}, {inertia}] }}\n\
         [contact]\nstiffness = {stiffness:?}\ndissipation = {dissipation:?}\nramp = {ramp:?}\nfriction = {friction:?}\nslip_speed = {slip_speed:?}\n\
         spheres = [{{ name = 'ball', on = 'vehicle', position = [0.0, 0.0, 0.0], radius = 0.1 }}]\n\
         shapes = [{{ name = 'floor', kind = 'plane' }}]\n"
    );
    Scene::from_toml_str(&text, "ball").unwrap()
}

/// Two arms on a vehicle among a floor, a box, a valve wheel and a button, small beside the spheres that touch them from nearly every place;
/// with friction, end stops and thrusters.
pub fn wrestling() -> Scene {
    let scene = Scene::shipped("bluerov2-heavy-two-alpha5").unwrap();
    let text = "
        [contact]
        stiffness = 300.0
        dissipation = 0.8
        ramp = 0.1
        friction = 0.5
        slip_speed = 0.3
        spheres = [
            { name = 'hull', on = 'vehicle', position = [0.2, 0.1, -0.1], radius = 1.2 },
            { name = 'left', on = 'left-wrist', position = [0.05, 0.01, 0.1], radius = 1.0 },
        ]
        shapes = [
            { name = 'floor', kind = 'plane', frame = { position = [0.0, 0.0, -1.2], rpy = [0.1, 0.2, 0.3] } },
            { name = 'wall', kind = 'box', size = [0.1, 0.2, 0.15], frame = { position = [1.1, 0.2, 0.1], rpy = [0.2, -0.1, 0.4] } },
            { name = 'rim', on = 'valve', kind = 'torus', radius = 0.15, tube = 0.03 },
            { name = 'cap', on = 'button', kind = 'cylinder', radius = 0.1, length = 0.2, frame = { position = [0.0, 0.1, 0.05] } },
        ]
        [[fixtures]]
        name = 'valve'
        body = { mass = 2.0, inertia = [0.1, 0.1, 0.2], volume = 0.001, added_mass = [1.0, 1.0, 1.5, 0.1, 0.1, 0.1] }
        joint = { kind = 'revolute', axis = [0.0, 0.6, 0.8], frame = { position = [0.9, -0.6, -0.3], rpy = [0.3, 0.4, 0.5] }, rotor_inertia = 0.1, friction = { viscous = 0.4, coulomb = 0.1, coulomb_speed = 0.1 } }
        [[fixtures]]
        name = 'button'
        joint = { kind = 'prismatic', axis = [0.0, 0.0, 1.0], frame = { position = [-0.5, 0.9, 0.3], rpy = [-0.3, 0.1, 0.2] }, rotor_inertia = 1.5, friction = { viscous = 2.0 } }
    ";
    let mut scene = Scene { name: "wrestling".to_owned(), ..scene };
    // A saturated actuator hardly feels its target: derivatives by it would be smaller than the errors of differences.
    for link in scene.arm.iter_mut().flat_map(|arm| &mut arm.links) {
        (link.joint.effort, link.joint.actuator) = (None, None);
    }
    Scene::from_toml_str(&format!("{}\n{text}", scene.to_toml_string()), "wrestling").unwrap()
}
