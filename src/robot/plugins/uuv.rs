//! Plugins of uuv_simulator and Plankton: hydrodynamics by link and thrusters.
//!
//! Sources: uuv_simulator, uuv_gazebo_plugins/src: HydrodynamicModel.cc (`HMFossen`, `HMSphere`, `HMCylinder`, `HMBox`),
//! BuoyantObject.cc, ThrusterPlugin.cc, ThrusterConversionFcn.cc, Dynamics.cc. Plankton has the same elements.
//!
//! Coefficients are in axes with y right and z down: the plugin turns the link's velocity by `diag(1, -1, -1)` first, and the
//! wrench back. Added mass is positive. Damping is negative:
//!
//! ```text
//! F = (D_L + u D_F + diag(D_Q |V|)) V
//! ```
//!
//! with the forward speed u, so that ahead all three take energy. Of a full quadratic matrix the plugin uses the diagonal.
//! Wrench and buoyancy act relative to the centre of mass, as all relative forces of Gazebo classic do.

use nalgebra::{Matrix6, Vector3, Vector6};

use super::{dissipative, link, positive, symmetric, water};
use crate::estimate::Shape;
use crate::keys::flip_matrix;
use crate::robot::element::{Element, Result};
use crate::robot::parts::{Robot, RobotThruster};

/// Density without `<fluid_density>`, kg/m3. `[BuoyantObject.cc]`
const DENSITY: f64 = 1028.0;

/// Reads a plugin of the kind `UnderwaterObject`.
pub fn object(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let density = plugin.positive_value("fluid_density")?.unwrap_or(DENSITY);
    robot.fluid_density = Some(density);
    for element in plugin.children("link") {
        let name = element.text("name")?;
        let element = Element { path: format!("{} <link name=\"{name}\">", plugin.path), ..element };
        if let Some(index) = link(&element, name, robot) {
            body(&element, index, density, robot)?;
        }
    }
    Ok(())
}

fn body(element: &Element, index: usize, density: f64, robot: &mut Robot) -> Result<()> {
    let model = element.needed("hydrodynamic_model")?;
    let kind = model.needed("type")?.content();
    let com = robot.links[index].inertial.as_ref().map_or_else(Vector3::zeros, |inertial| inertial.position);
    if com != Vector3::zeros() {
        element
            .note("coefficients and centre of buoyancy are relative to the centre of mass, where Gazebo applies them");
    }
    if element.child("metacentric_width")?.is_some() {
        element.note("the model of a surface vessel is not read: the link is under water");
    }
    let state = water(robot, index);
    state.neutral = element.flag("neutrally_buoyant")?.unwrap_or(false);
    state.volume = element.at_least_zero_value("volume")?.filter(|_| !state.neutral);
    state.center_of_buoyancy = com + Vector3::from(element.values::<3>("center_of_buoyancy")?.unwrap_or_default());
    state.frame.position = com;

    let table = |tag, what| -> Result<Matrix6<f64>> {
        let Some(element) = model.child(tag)? else { return Ok(Matrix6::zeros()) };
        let mut matrix = coefficients(&element)?;
        flip_matrix(&mut matrix);
        positive(&matrix, -1.0, &element, what)
    };
    state.linear = dissipative(table("linear_damping", "linear damping")?, &model);
    state.linear_forward_speed = table("linear_damping_forward_speed", "damping by forward speed")?;
    state.quadratic = table("quadratic_damping", "quadratic damping")?;
    let diagonal = Matrix6::from_diagonal(&state.quadratic.diagonal());
    if state.quadratic != diagonal {
        model.note("quadratic damping: the plugin uses the diagonal alone, and so is it read");
        state.quadratic = diagonal;
    }
    if let Some(element) = model.child("added_mass")? {
        let mut matrix = full(&element.listed(36)?);
        flip_matrix(&mut matrix);
        state.added_mass = symmetric(positive(&matrix, 1.0, &element, "added mass")?, &element)?;
    }
    let mut replace = |mass: [Option<f64>; 6], damping: [Option<f64>; 6]| {
        for i in 0..6 {
            mass[i].into_iter().for_each(|x| state.added_mass[(i, i)] = x);
            damping[i].into_iter().for_each(|x| state.quadratic[(i, i)] = x);
        }
    };
    match kind {
        "fossen" => {}
        "sphere" | "cylinder" if model.child("radius")?.is_none() => {
            model.note("no <radius>: hydrodynamics are estimated from the geometry");
            outline(element, index, robot)?;
        }
        "sphere" => {
            let (mass, damping) = sphere(density, model.needed_positive_value("radius")?);
            replace(translation([mass; 3]), translation([damping; 3]));
        }
        "cylinder" => {
            let (radius, length) = (model.needed_positive_value("radius")?, model.needed_positive_value("length")?);
            let axis = match model.needed("axis")?.content() {
                "i" => 0,
                "j" => 1,
                "k" => 2,
                other => return model.fault(format!("<axis> is \"{other}\", but must be i, j or k")),
            };
            let (mass, damping) = cylinder(density, radius, length, axis);
            replace(mass, damping);
        }
        "box" => {
            let [length, width, height] = size(&model)?;
            let cd = model.at_least_zero_value("cd")?.unwrap_or(1.0);
            let areas = [width * height, length * height, width * length];
            replace([None; 6], translation(areas.map(|area| 0.5 * density * cd * area)));
        }
        "spheroid" => {
            model.note("the plugin's spheroid is unfinished: hydrodynamics are estimated from the geometry");
            outline(element, index, robot)?;
        }
        other => {
            let rule = "but must be fossen, sphere, cylinder, box or spheroid";
            return model.needed("type")?.fault(format!("is \"{other}\", {rule}"));
        }
    }
    Ok(())
}

/// Length, width and height of a box, m.
fn size(element: &Element) -> Result<[f64; 3]> {
    let edge = |tag| element.needed_positive_value(tag);
    Ok([edge("length")?, edge("width")?, edge("height")?])
}

/// Gives a link without geometry the box that the plugin knows: along x its `<width>`, along y its `<length>`.
/// `[HydrodynamicModel.cc]`
fn outline(element: &Element, index: usize, robot: &mut Robot) -> Result<()> {
    let link = &mut robot.links[index];
    if let Some(element) = element.child("box")?.filter(|_| link.shapes.is_empty() && link.meshes.is_empty()) {
        let [length, width, height] = size(&element)?;
        link.shapes.push(Shape { cuboid: Some(Vector3::new(width, length, height)), ..Shape::default() });
    }
    Ok(())
}

fn translation(x: [f64; 3]) -> [Option<f64>; 6] {
    [Some(x[0]), Some(x[1]), Some(x[2]), None, None, None]
}

/// Added mass, kg, and quadratic damping, N s2/m2, of a sphere: `2/3 pi rho r^3` and `1/2 rho C_D pi r^2` with C_D = 0.5.
/// `[HydrodynamicModel.cc, HMSphere]`
fn sphere(density: f64, radius: f64) -> (f64, f64) {
    let pi = std::f64::consts::PI;
    (2.0 / 3.0 * density * pi * radius.powi(3), 0.5 * density * 0.5 * pi * radius.powi(2))
}

/// Added mass and quadratic damping of a cylinder along an axis. `[HydrodynamicModel.cc, HMCylinder]`
///
/// Across: `rho pi r^2 L` and `1/2 rho C_L r L`; along: `rho pi r^2` and `1/2 rho C_c pi r^2`; turning across: added moment
/// `1/12 rho pi r^2 L^3`. C_L and C_c are the plugin's tables by `L / 2r`.
fn cylinder(density: f64, radius: f64, length: f64, axis: usize) -> ([Option<f64>; 6], [Option<f64>; 6]) {
    let ratio = length / (2.0 * radius);
    let table = |rows: &[(f64, f64)]| {
        let row = rows.iter().find(|(end, _)| ratio <= *end);
        row.unwrap_or(&rows[rows.len() - 1]).1
    };
    let circle = table(&[(1.0, 0.91), (2.0, 0.85), (4.0, 0.87), (7.0, 0.99)]);
    let side = table(&[(1.0, 0.63), (2.0, 0.68), (5.0, 0.74), (10.0, 0.82), (40.0, 0.98)]);
    let disc = std::f64::consts::PI * radius.powi(2);
    let (mut mass, mut damping) = ([None; 6], [None; 6]);
    for i in 0..3 {
        let along = i == axis;
        mass[i] = Some(density * disc * if along { 1.0 } else { length });
        damping[i] = Some(0.5 * density * if along { circle * disc } else { side * radius * length });
        if !along {
            mass[3 + i] = Some(density * disc * length.powi(3) / 12.0);
        }
    }
    (mass, damping)
}

/// A 6x6 matrix by rows.
fn full(list: &[f64]) -> Matrix6<f64> {
    Matrix6::from_row_slice(list)
}

/// Six numbers of a diagonal, or 36 of a matrix by rows.
fn coefficients(element: &Element) -> Result<Matrix6<f64>> {
    let list = element.list()?;
    match list.len() {
        6 => Ok(Matrix6::from_diagonal(&Vector6::from_row_slice(&list))),
        36 => Ok(full(&list)),
        found => element.fault(format!("has {found} numbers, but must have 6 or 36")),
    }
}

/// Reads a plugin of the kind `Thruster`.
///
/// The plugin's input is clamped and multiplied by `<gain>`, passes the rotor's dynamics and is converted to thrust. Commands
/// of a scene are thrusts, so the conversion gives the limits of thrust alone. The force acts on the link `<linkName>` along
/// the axis of the joint `<jointName>`.
pub fn thruster(plugin: &Element, robot: &mut Robot) -> Result<()> {
    let name = plugin.needed("linkName")?.content();
    let Some(index) = link(plugin, name, robot) else { return Ok(()) };
    let number = |tag, default| Ok(plugin.value(tag)?.unwrap_or(default));
    let range = |lower, upper| -> Result<[f64; 2]> {
        let [low, high] = [number(lower, f64::NEG_INFINITY)?, number(upper, f64::INFINITY)?];
        // The plugin's rule for limits in the wrong order.
        Ok(if low < high { [low, high] } else { [f64::NEG_INFINITY, f64::INFINITY] })
    };
    // The plugin's rule for efficiencies that are none.
    let efficiency = |tag| number(tag, 1.0).map(|x: f64| if (0.0..=1.0).contains(&x) { x } else { 1.0 });
    let (gain, of_thrust, of_propeller) =
        (number("gain", 1.0)?, efficiency("thrust_efficiency")?, efficiency("propeller_efficiency")?);
    let rotor = Rotor::read(&plugin.needed("dynamics")?)?;
    let conversion = Conversion::read(&plugin.needed("conversion")?)?;
    let speeds = range("clampMin", "clampMax")?.map(|input| of_propeller * rotor.steady(gain * input));
    let thrusts = speeds.map(|speed| of_thrust * conversion.thrust(speed));
    let [low, high] = range("thrustMin", "thrustMax")?;
    let thrusts = thrusts.map(|thrust| thrust.clamp(low, high));
    let limits = [thrusts[0].min(thrusts[1]).min(0.0), thrusts[0].max(thrusts[1]).max(0.0)];
    let joint = plugin.word("jointName")?.filter(|joint| {
        let found = robot.joints.iter().any(|other| other.name == *joint && other.child == name);
        if !found {
            plugin
                .note(&format!("no joint \"{joint}\" has the child \"{name}\": the thrust acts along x of that link"));
        }
        found
    });
    let id = plugin.word("thrusterID")?.map_or_else(|| robot.thrusters.len().to_string(), str::to_owned);
    let lag = rotor.lag(speeds.map(f64::abs).into_iter().fold(0.0, f64::max));
    if lag.is_some() && !matches!(rotor, Rotor::FirstOrder { .. }) {
        plugin.note("the rotor's dynamics are read as a first-order lag, with their rate at full speed");
    }
    robot.thrusters.push(RobotThruster {
        name: format!("thruster-{id}"),
        line: plugin.line(),
        link: joint.is_none().then(|| robot.links[index].name.clone()),
        joint: joint.map(str::to_owned),
        axis: if joint.is_some() { Vector3::zeros() } else { Vector3::x() },
        limits: Some(limits).filter(|limits| limits.iter().all(|limit| limit.is_finite())),
        lag,
        ..RobotThruster::default()
    });
    Ok(())
}

/// Dynamics of the rotor speed s at the input c. `[Dynamics.cc]`
enum Rotor {
    /// s = c
    ZeroOrder,
    /// tau s' = c - s
    FirstOrder { tau: f64 },
    /// s' = beta c - alpha s |s|
    Yoerger { alpha: f64, beta: f64 },
    /// J s' = c K_t / R_m - K_v1 s - K_v2 s |s|
    Bessa { inertia: f64, linear: f64, quadratic: f64, gain: f64 },
}

impl Rotor {
    fn read(element: &Element) -> Result<Self> {
        let number = |tag| element.needed_positive_value(tag);
        Ok(match element.needed("type")?.content() {
            "ZeroOrder" => Self::ZeroOrder,
            "FirstOrder" => Self::FirstOrder { tau: number("timeConstant")? },
            "Yoerger" => Self::Yoerger { alpha: number("alpha")?, beta: number("beta")? },
            "Bessa" => Self::Bessa {
                inertia: number("Jmsp")?,
                linear: number("Kv1")?,
                quadratic: number("Kv2")?,
                gain: number("Kt")? / number("Rm")?,
            },
            other => {
                let rule = "but must be ZeroOrder, FirstOrder, Yoerger or Bessa";
                return element.needed("type")?.fault(format!("is \"{other}\", {rule}"));
            }
        })
    }

    /// Speed at a constant input.
    fn steady(&self, c: f64) -> f64 {
        match self {
            Self::ZeroOrder | Self::FirstOrder { .. } => c,
            Self::Yoerger { alpha, beta } => (beta * c.abs() / alpha).sqrt().copysign(c),
            Self::Bessa { linear, quadratic, gain, .. } => {
                let root = (linear * linear + 4.0 * quadratic * gain * c.abs()).sqrt();
                ((root - linear) / (2.0 * quadratic)).copysign(c)
            }
        }
    }

    /// Time constant of small changes about the speed s. Thrust, a function of s, has the same one.
    fn lag(&self, s: f64) -> Option<f64> {
        let lag = match self {
            Self::ZeroOrder => return None,
            Self::FirstOrder { tau } => *tau,
            Self::Yoerger { alpha, .. } => 1.0 / (2.0 * alpha * s),
            Self::Bessa { inertia, linear, quadratic, .. } => inertia / (linear + 2.0 * quadratic * s),
        };
        (lag.is_finite() && lag > 0.0).then_some(lag)
    }
}

/// Thrust at the rotor speed s. `[ThrusterConversionFcn.cc]`
enum Conversion {
    /// k s |s|
    Basic { k: f64 },
    /// `k (s |s| - delta)` beyond the dead band from `delta[0]` to `delta[1]`.
    Bessa { k: [f64; 2], delta: [f64; 2] },
    /// Linear between points, constant beyond.
    Points(Vec<[f64; 2]>),
}

impl Conversion {
    fn read(element: &Element) -> Result<Self> {
        let number = |tag| element.needed_value(tag);
        Ok(match element.needed("type")?.content() {
            "Basic" => Self::Basic { k: number("rotorConstant")? },
            "Bessa" => Self::Bessa {
                k: [number("rotorConstantL")?, number("rotorConstantR")?],
                delta: [number("deltaL")?, number("deltaR")?],
            },
            "LinearInterp" => {
                let (inputs, outputs) = (element.needed("inputValues")?, element.needed("outputValues")?);
                let (x, y) = (inputs.list()?, outputs.list()?);
                if x.is_empty() || x.len() != y.len() {
                    return outputs.fault(format!("has {} numbers, but <inputValues> has {}", y.len(), x.len()));
                }
                let mut points: Vec<[f64; 2]> = x.into_iter().zip(y).map(|(x, y)| [x, y]).collect();
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                Self::Points(points)
            }
            other => {
                let rule = "but must be Basic, Bessa or LinearInterp";
                return element.needed("type")?.fault(format!("is \"{other}\", {rule}"));
            }
        })
    }

    fn thrust(&self, s: f64) -> f64 {
        let square = s * s.abs();
        match self {
            Self::Basic { k } => k * square,
            Self::Bessa { k, delta } if square <= delta[0] => k[0] * (square - delta[0]),
            Self::Bessa { k, delta } if square >= delta[1] => k[1] * (square - delta[1]),
            Self::Bessa { .. } => 0.0,
            Self::Points(points) => {
                let above = points.partition_point(|[x, _]| *x < s);
                match (above.checked_sub(1).map(|below| points[below]), points.get(above).copied()) {
                    (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (s - x0) / (x1 - x0),
                    (None, Some([_, y])) | (Some([_, y]), None) => y,
                    (None, None) => 0.0,
                }
            }
        }
    }
}
