//! Random valid scenes and states, for tests that compare two computations of one thing.

use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use uvms_gym::description::{
    Arm, Body, Damping, Detent, EndEffectorFrame, ForwardDamping, Frame, Friction, InertiaPoint, Joint, JointKind,
    JointLimits, JointServo, JointSpring, Link, Mount, Payload, Provenance, Scene, Thruster, Vehicle, VehicleServo,
    Water,
};
use uvms_gym::system::State;

/// What the seed must not decide. The default leaves everything to it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options {
    /// Number of links; with `Some(0)` there may still be an arm base.
    pub links: Option<usize>,
    /// Whether the vehicle is fixed in the world.
    pub fixed: Option<bool>,
    /// Whether a joint q0 carries the arm base.
    pub joint_loading: Option<bool>,
    /// Whether links branch off any earlier body.
    pub branching: Option<bool>,
    /// Whether there is a payload.
    pub payload: Option<bool>,
    /// Whether the water moves.
    pub current: Option<bool>,
    /// Whether joints have friction, servos and end stops.
    pub joint_forces: Option<bool>,
    /// Rigid bodies under gravity in a vacuum: no buoyancy, added mass or drag.
    pub dry: bool,
}

/// The generator splitmix64.
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn coin(&mut self) -> bool {
        self.bits() >> 63 == 1
    }

    /// Uniform in a cube.
    pub fn vector(&mut self, size: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.between(-size, size))
    }

    /// A unit vector.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            let v = self.vector(1.0);
            if (0.1..1.0).contains(&v.norm()) {
                return v.normalize();
            }
        }
    }

    pub fn rotation(&mut self) -> Matrix3<f64> {
        let angle = self.between(0.0, std::f64::consts::PI);
        UnitQuaternion::from_axis_angle(&nalgebra::Unit::new_normalize(self.direction()), angle)
            .to_rotation_matrix()
            .into_inner()
    }

    fn matrix6(&mut self) -> Matrix6<f64> {
        Matrix6::from_fn(|_, _| self.between(-1.0, 1.0))
    }

    fn frame(&mut self, size: f64) -> Frame {
        Frame { position: self.vector(size), rpy: self.vector(1.5) }
    }

    /// Symmetric positive definite; `size` is about its translational part, `length` scales turning.
    fn definite(&mut self, size: f64, length: f64) -> Matrix6<f64> {
        let g = self.matrix6();
        let scale = Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, length, length, length));
        let m = scale * (g * g.transpose() / 4.0 + Matrix6::identity() * 0.4) * scale * size;
        (m + m.transpose()) / 2.0
    }

    fn body(&mut self, mass: f64, length: f64, dry: bool) -> Body {
        let mass = mass * self.between(0.7, 1.4);
        let center_of_mass = self.vector(0.3 * length);
        // Second moments of a real mass distribution, which keep the triangle inequality.
        let r = self.rotation();
        let spread = Vector3::from_fn(|_, _| mass * (length * self.between(0.2, 0.5)).powi(2));
        let second = r * Matrix3::from_diagonal(&spread) * r.transpose();
        let about_com = Matrix3::identity() * second.trace() - second;
        let inertia_at = if self.coin() { InertiaPoint::Com } else { InertiaPoint::Origin };
        let c = center_of_mass.cross_matrix();
        let inertia = if inertia_at == InertiaPoint::Com { about_com } else { about_com - mass * c * c };
        let mut body = Body {
            mass,
            center_of_mass,
            inertia: (inertia + inertia.transpose()) / 2.0,
            inertia_at,
            weight: None,
            volume: None,
            buoyancy: None,
            center_of_buoyancy: Vector3::zeros(),
            hydrodynamic_frame: Frame::default(),
            added_mass: Matrix6::zeros(),
            damping: Damping::default(),
        };
        if !dry {
            let amount = self.between(0.7, 1.2) * mass;
            if self.coin() {
                body.volume = Some(amount / 1000.0)
            } else {
                body.buoyancy = Some(amount * 9.8)
            }
            body.center_of_buoyancy = self.vector(0.3 * length);
            body.hydrodynamic_frame = self.frame(0.3 * length);
            body.added_mass = self.definite(mass, length);
            let lift = self.matrix6();
            body.damping.linear = self.definite(mass, length) + (lift - lift.transpose()) * 0.2 * mass * length;
            let quadratic = self.definite(2.0 * mass, length);
            body.damping.quadratic = quadratic.map_with_location(|i, j, x| if i == j { x } else { 0.1 * x });
        }
        body
    }

    fn forward_damping(&mut self) -> ForwardDamping {
        let lift = self.matrix6();
        ForwardDamping {
            position: self.vector(0.3),
            matrix: self.definite(15.0, 0.6) + (lift - lift.transpose()) * 2.0,
        }
    }

    fn joint(&mut self, reach: f64, forces: bool) -> Joint {
        let home = self.between(-0.5, 0.5);
        let mut joint = Joint {
            kind: if self.bits().is_multiple_of(3) { JointKind::Prismatic } else { JointKind::Revolute },
            frame: self.frame(reach),
            axis: self.direction(),
            rotor_inertia: 0.0,
            prescribed: false,
            friction: Friction::default(),
            limits: None,
            effort: None,
            actuator: None,
            spring: None,
            detent: None,
            speed: Some(0.5),
            servo: None,
            home,
        };
        if forces {
            joint.rotor_inertia = 0.2 * home.max(0.0);
            joint.friction.viscous = self.between(0.1, 1.0);
            joint.friction.coulomb = self.between(0.0, 0.3);
            joint.friction.coulomb_speed = 0.1;
            if home < -0.2 {
                joint.friction.break_away = Some(joint.friction.coulomb - 0.1 * home);
                joint.friction.stribeck_speed = Some(0.3);
            }
            joint.spring = (home < 0.1).then_some(JointSpring { stiffness: 3.0 + home, rest: -home });
            joint.detent = (home > -0.1).then_some(Detent { torque: 0.5 + home, period: 0.8, offset: 0.2 * home });
            let (lower, upper) = (home - self.between(0.3, 1.0), home + self.between(0.3, 1.0));
            joint.limits = Some(JointLimits { lower, upper, stiffness: self.between(5.0, 20.0), damping: 5.0 });
            joint.effort = Some(self.between(1.0, 20.0));
            joint.servo = Some(JointServo { kp: self.between(1.0, 10.0), kd: self.between(0.5, 2.0) });
        }
        joint
    }
}

/// A valid scene, the same for the same seed and options. Masses are of one order, so that the mass matrix is well
/// conditioned (condition number of a few hundred).
pub fn random_scene(seed: u64, options: Options) -> Scene {
    let mut random = Random::new(seed);
    let dry = options.dry;
    // Drawn always, so that fixing an option leaves the rest of the scene alike.
    let mut choose = |option: Option<bool>| {
        let coin = random.coin();
        option.unwrap_or(coin)
    };
    let (fixed, q0, payload) = (choose(options.fixed), choose(options.joint_loading), choose(options.payload));
    let (moving_water, forces) = (choose(options.current), choose(options.joint_forces));
    let links = (random.bits() % 9) as usize;
    let links = options.links.unwrap_or(links);

    let water = Water {
        density: if dry { 0.0 } else { 1000.0 },
        gravity: random.direction() * 9.8,
        current: if moving_water { random.vector(0.5) } else { Vector3::zeros() },
    };
    let thrusters = (0..6).map(|i| {
        let (position, axis) = (random.vector(0.4), random.direction());
        let limits = [-random.between(20.0, 40.0), random.between(20.0, 40.0)];
        Thruster::new(format!("thruster-{i}"), position, axis, limits)
    });
    let vehicle = Vehicle {
        name: "random vehicle".into(),
        fixed,
        thrusters: thrusters.collect(),
        thruster_lag: None,
        voltage: None,
        fins: Vec::new(),
        tether: None,
        forward_damping: (!dry && !seed.is_multiple_of(2)).then(|| Random::new(seed ^ 0xF0).forward_damping()),
        servo: Some(VehicleServo { kp: [40.0, 40.0, 40.0, 5.0, 5.0, 5.0], kd: [60.0, 60.0, 60.0, 8.0, 8.0, 8.0] }),
        body: random.body(30.0, 0.6, dry),
        shape: None,
        meshes: Vec::new(),
    };
    let has_base = random.coin() || q0;
    let mut places = Random::new(seed ^ 0x7EEE);
    let branching = options.branching.unwrap_or(places.coin());
    // A body among vehicle, base and the first links.
    let mut body = |count: usize| match places.bits() as usize % (count + 2) {
        _ if !branching => None,
        0 => Some("vehicle".to_owned()),
        1 => Some("base".to_owned()),
        k => Some(format!("link-{}", k - 2)),
    };
    let parents: Vec<_> = (0..links).map(&mut body).collect();
    let on = body(links);
    let carriers: Vec<_> = ["left", "right"].into_iter().map(|name| (name, body(links))).collect();
    let mut frames = Random::new(seed ^ 0xEEF);
    let mut named = |on| EndEffectorFrame { on, ..frames.frame(0.3).into() };
    let mut arm = Arm {
        name: "random arm".into(),
        mount: Mount { frame: random.frame(0.4), joint: q0.then(|| random.joint(0.1, forces)) },
        base: has_base.then(|| random.body(4.0, 0.4, dry)),
        links: (0..links)
            .map(|i| Link {
                name: format!("link-{i}"),
                parent: parents[i].clone(),
                joint: random.joint(0.3, forces),
                body: Some(random.body(4.0, 0.4, dry)),
                meshes: Vec::new(),
            })
            .collect(),
        meshes: Vec::new(),
        end_effector: EndEffectorFrame { on, ..random.frame(0.3).into() },
        end_effectors: carriers.into_iter().map(|(name, on)| (name.to_owned(), named(on))).collect(),
    };
    // Fixed links, on which links may start.
    for k in 0..if branching { places.bits() % 3 } else { 0 } {
        let at = places.bits() as usize % (arm.links.len() + 1);
        let parent = ["vehicle", "base"].into_iter().chain(arm.links[..at].iter().map(|link| link.name.as_str()));
        let parent = parent.last().filter(|_| places.coin()).unwrap_or("vehicle").to_owned();
        let body = places.coin().then(|| places.body(4.0, 0.4, dry));
        let joint = Joint::fixed(places.frame(0.3));
        arm.links
            .insert(at, Link { name: format!("fixed-{k}"), parent: Some(parent), joint, body, meshes: Vec::new() });
    }
    let has_arm = links > 0 || has_base;
    let grip = [None, Some("left"), Some("right")][if branching && has_arm { places.bits() as usize % 3 } else { 0 }];
    let scene = Scene {
        name: format!("random-{seed}"),
        summary: String::new(),
        water,
        vehicle,
        arm: has_arm.then_some(arm),
        payload: payload.then(|| Payload {
            on: grip.map(str::to_owned),
            frame: random.frame(0.1),
            body: random.body(2.0, 0.3, dry),
        }),
        contact: None,
        fixtures: Vec::new(),
        integration: None,
        provenance: Provenance::default(),
    };
    if let Err(error) = scene.check() {
        panic!("seed {seed}: {error}");
    }
    scene
}

/// A state in general position: any attitude, speeds up to 0.5 (rest for a fixed vehicle), joints about home.
pub fn random_state(seed: u64, scene: &Scene) -> State {
    let mut random = Random::new(seed ^ 0x5EED);
    let mut state = State { position: random.vector(2.0), rotation: random.rotation(), ..State::default() };
    let twist = Vector6::from_fn(|_, _| random.between(-0.5, 0.5));
    if !scene.vehicle.fixed {
        state.twist = twist;
    }
    for (i, joint) in scene.coordinates().enumerate() {
        state.q[i] = joint.home + random.between(-1.0, 1.0);
        state.qd[i] = random.between(-0.5, 0.5);
    }
    state
}
