//! Cradle in which a vehicle docks: a plank under each lower edge of the hull, opened at the entrance, and a post at the end.

use nalgebra::{Matrix3, Vector3};

use crate::description::{Contact, ContactGeometry, ContactShape, DOCK, Frame, Scene, Sphere, VEHICLE, WORLD};
use crate::error::TaskError;

/// Minimum number of spheres of a vehicle that has its own.
const SPHERES: usize = 4;
/// Radius of the spheres at the corners of a hull that has none. This and the lengths below are relative to its size, the cube root of
/// the product of its half edges.
const RADIUS: f64 = 0.08;
/// Thickness of the planks, and their widths from the hull's edge to the middle and outward.
const PLANK: [f64; 3] = [0.12, 0.5, 0.8];
/// Tilt of the planks to the middle, rad.
const TILT: f64 = 0.6;
/// Length of the opened planks at the entrance, and their angle to the others, rad.
const FLARE: [f64; 2] = [1.2, 0.5];
/// Thickness of the posts, and their lengths beyond the hull: to the side, upward and downward, where they are the feet.
const POST: [f64; 4] = [0.25, 0.6, 0.4, 3.0];
/// Distance of a post from the middle, relative to the hull's half width: the middle is open for an arm.
const OPEN: f64 = 0.4;
/// Distance of the hull from the entrance at the start.
const ROOM: f64 = 0.2;
/// Square of the frequency of the vehicle, in translation, on one of its spheres, 1/s2: on four corners it would be 2 to 4 mm deep under
/// its weight in air.
const FREQUENCY_SQUARED: f64 = 900.0;
/// Dissipation, s/m: a restitution of 0.4 at 0.2 m/s, and 0.2 at 0.5 m/s.
const DISSIPATION: f64 = 10.0;
/// Ramp, m; coefficient of friction, of wet plastic; slip speed, m/s: a compromise between creep and step size.
const RAMP: f64 = 0.001;
const FRICTION: f64 = 0.2;
const SLIP_SPEED: f64 = 0.01;
/// Colours of planks and of the entrance: red, green and blue.
const YELLOW: [f64; 3] = [0.95, 0.71, 0.11];
const ORANGE: [f64; 3] = [0.93, 0.42, 0.1];

/// A box of the cradle: name, frame, size and colour.
type Part = (String, Frame, Vector3<f64>, Option<[f64; 3]>);

/// Spheres of a vehicle, and the box about them in the frame of the docked vehicle, which is the world's.
pub(super) struct Hull {
    spheres: Vec<(Vector3<f64>, f64)>,
    lower: Vector3<f64>,
    upper: Vector3<f64>,
}

impl Hull {
    /// Hull of the spheres that a scene has on its vehicle.
    fn of(scene: &Scene) -> Self {
        let all = scene.contact.iter().flat_map(|contact| &contact.spheres);
        let own = all.filter(|sphere| sphere.on == VEHICLE);
        let spheres: Vec<_> = own.map(|sphere| (sphere.position, sphere.radius)).collect();
        let [mut lower, mut upper] = [Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)];
        for (center, radius) in &spheres {
            (lower, upper) = (lower.inf(&center.add_scalar(-radius)), upper.sup(&center.add_scalar(*radius)));
        }
        Self { spheres, lower, upper }
    }

    fn size(&self) -> f64 {
        ((self.upper - self.lower) / 2.0).product().cbrt()
    }

    /// Maximum x of a vehicle that is in front of the entrance, m.
    pub fn start(scene: &Scene) -> f64 {
        let hull = Self::of(scene);
        hull.lower.x - hull.upper.x - hull.size() * (FLARE[0] * FLARE[1].cos() + ROOM)
    }

    /// First point of the hull that a plane with this normal touches from below.
    fn lowest(&self, normal: &Vector3<f64>) -> Vector3<f64> {
        let touched = self.spheres.iter().map(|(center, radius)| center - normal * *radius);
        touched.min_by(|a, b| normal.dot(a).total_cmp(&normal.dot(b))).unwrap_or_default()
    }

    /// Boxes of the side at +y or -y.
    fn side(&self, name: &str, side: f64) -> [Part; 3] {
        let (s, x) = (self.size(), Vector3::x());
        let (sin, cos) = TILT.sin_cos();
        let (normal, outward) = (Vector3::new(0.0, -side * sin, cos), Vector3::new(0.0, side * cos, sin));
        let [thickness, inner, outer] = PLANK.map(|length| length * s);
        let width = inner + outer;
        let touched = self.lowest(&normal);
        let middle = (self.lower + self.upper) / 2.0;
        // Middle of the plank's upper face at its end towards the entrance.
        let edge = Vector3::new(self.lower.x, touched.y, touched.z) + outward * ((outer - inner) / 2.0);
        let plank = |along: Vector3<f64>, from: f64, length: f64| {
            let up = x.cross(&normal).cross(&along).normalize();
            let frame = edge + along * (from + length / 2.0) - up * (thickness / 2.0);
            let axes = Matrix3::from_columns(&[along, up.cross(&along), up]);
            (Frame::new(frame, &axes), Vector3::new(length, width, thickness))
        };
        let (straight, size) = plank(x, 0.0, self.upper.x - self.lower.x);
        let length = FLARE[0] * s;
        let (flare, flare_size) = plank(x * FLARE[1].cos() + normal * FLARE[1].sin(), -length, length);

        let [post, beside, above, below] = POST.map(|length| length * s);
        let half = (self.upper.y - self.lower.y) / 2.0;
        let (near, far) = (OPEN * half, half + beside);
        let (bottom, top) = (self.lower.z - below, self.upper.z + above);
        let place = Vector3::new(self.upper.x + post / 2.0, middle.y + side * (near + far) / 2.0, (bottom + top) / 2.0);
        [
            (format!("{DOCK}-{name}"), straight, size, Some(YELLOW)),
            (format!("{DOCK}-{name}-entrance"), flare, flare_size, Some(ORANGE)),
            (
                format!("{DOCK}-{name}-post"),
                Frame::new(place, &Matrix3::identity()),
                Vector3::new(post, far - near, top - bottom),
                None,
            ),
        ]
    }
}

/// Adds spheres at the corners of the outline to a vehicle without spheres.
fn add_corners(scene: &mut Scene) {
    let outline = scene.vehicle.outline(&scene.water);
    let half = outline.size / 2.0;
    let radius = RADIUS * half.product().cbrt();
    let contact = scene.contact.get_or_insert_with(Contact::default);
    for k in 0..8 {
        let sign = |bit: usize| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let corner = Vector3::new(sign(0), sign(1), sign(2)).component_mul(&half.add_scalar(-radius));
        contact.spheres.push(Sphere {
            name: format!("hull-{}", k + 1),
            on: VEHICLE.to_owned(),
            position: outline.position + corner,
            radius,
        });
    }
}

/// Adds a cradle in which the vehicle rests at the world's origin.
///
/// # Errors
/// `TaskError::Scene` for a vehicle with fewer than four spheres of its own, and a scene with shapes of the same names.
pub(super) fn place(mut scene: Scene) -> Result<Scene, TaskError> {
    let own = Hull::of(&scene).spheres.len();
    let refuse = |name: &str, reason: String| Err(TaskError::Scene { scene: name.to_owned(), reason });
    if own == 0 {
        add_corners(&mut scene);
    } else if own < SPHERES {
        let reason = format!("its vehicle has {own} contact spheres, but at least {SPHERES} have to rest in the dock");
        return refuse(&scene.name, reason);
    }
    let hull = Hull::of(&scene);
    let body = &scene.vehicle.body;
    let mass = body.mass + (0..3).map(|k| body.added_mass[(k, k)]).sum::<f64>() / 3.0;
    let contact = scene.contact.get_or_insert_with(Contact::default);
    for (name, frame, size, colour) in hull.side("port", 1.0).into_iter().chain(hull.side("starboard", -1.0)) {
        contact.shapes.push(ContactShape {
            name,
            on: WORLD.to_owned(),
            frame,
            geometry: ContactGeometry::Box { size },
            stiffness: Some(mass * FREQUENCY_SQUARED),
            dissipation: Some(DISSIPATION),
            ramp: Some(RAMP),
            friction: Some(FRICTION),
            slip_speed: Some(SLIP_SPEED),
            colour,
        });
    }
    match scene.check() {
        Ok(_) => Ok(scene),
        Err(error) => refuse(&scene.name, error.to_string()),
    }
}
