//! Users' own robots: template, plausibility warnings, estimates from shapes, robots from files.

use std::path::PathBuf;

use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyString};

use super::arrays::{Given, dict, read as numbers};
use super::computation::detached;
use super::errors::{OrRaise, SceneError};
use super::scene::{object, read, read_with_warnings, text, to_python, tree};
use uvms_gym::batch::assess;
use uvms_gym::description::{Frame, Scene};
use uvms_gym::estimate::Outline;
use uvms_gym::robot::{Assembly, Imported, Robot, ThrusterSource};

/// TOML text of a scene with every key that there is, its unit and default in comments.
#[pyfunction]
pub fn scene_template() -> &'static str {
    Scene::TEMPLATE
}

/// A scene as TOML text, which reads back as an equal scene.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     As for `load_scene`.
///
/// Raises
/// ------
/// SceneError
///     As `load_scene`.
#[pyfunction]
pub fn dump_scene(scene: &Bound<'_, PyAny>) -> PyResult<String> {
    Ok(read(scene)?.to_toml_string())
}

/// Warnings about implausible values of a valid scene: out of trim, buoyancy below weight, no added mass, axes without
/// thruster, damping that adds energy.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     As for `load_scene`.
///
/// Returns
/// -------
/// list of str
///     One line per warning: key, reason and numbers.
///
/// Raises
/// ------
/// SceneError
///     As `load_scene`.
#[pyfunction]
pub fn lint_scene(scene: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    let (scene, stated) = read_with_warnings(scene)?;
    let assessment = assess(&scene).or_raise()?;
    Ok(stated.iter().chain(&scene.lint()).chain(&assessment.doubts).map(ToString::to_string).collect())
}

/// Estimate a body's mass, inertia, buoyancy, added mass and drag from boxes, cylinders, capsules and ellipsoids.
///
/// Added mass: potential flow for ellipsoids and capsules (Lamb 1932), strip theory and the tables of DNV-RP-H103 for boxes
/// and cylinders. Quadratic drag: projected areas and published coefficients (Hoerner, White, DNV-RP-C205). Linear drag:
/// equal to the quadratic drag at `speed`. Shapes do not shield each other. Expect errors of tens of percent, and several
/// times more for open frames.
///
/// Parameters
/// ----------
/// outline : dict, str or os.PathLike
///     {"density": 1000.0 kg/m3, "speed": [0.1 m/s, 0.3 rad/s], "shapes": [...]}, or path of a TOML file of that form. Each
///     shape has one of box ([x, y, z] edges, m), cylinder or capsule ({"radius", "length", "axis": "x"}; a capsule's
///     length without its ends) and ellipsoid ([a, b, c] semi-axes, m), and may have name, position (m) and rpy (rad) in
///     the body frame, ends ("free", or "joined" to the next part of an arm), perforation (open part of the faces, 0 to
///     0.5, for all axes or each), solidity (drag over drag of the closed shape, for all axes or each), displaced
///     (part of the envelope that displaces water), mass (kg) or relative_density (1: neutral).
/// table : str
///     Key of the table in the TOML text.
///
/// Returns
/// -------
/// dict
///     body (as in a scene), formulas (by the body's keys) and toml (text to paste, with formulas in comments and as
///     provenance). With one shape, its hydrodynamics are given in its own frame, else at the body's origin.
///
/// Raises
/// ------
/// SceneError
///     The message names file, key and value.
#[pyfunction]
#[pyo3(signature = (outline, *, table="vehicle.body"))]
pub fn estimate<'py>(outline: &Bound<'py, PyAny>, table: &str) -> PyResult<Bound<'py, PyDict>> {
    let py = outline.py();
    let outline = match outline.cast::<PyDict>() {
        Ok(dict) => Outline::from_value(tree(dict)?, "<dict>").or_raise()?,
        Err(_) => {
            let path = outline.extract::<PathBuf>()?;
            detached(py, || Outline::from_file(path))?.or_raise()?
        }
    };
    let estimate = outline.estimate();
    let body = toml::Value::try_from(&estimate.body).map_err(|e| SceneError::new_err(e.to_string()))?;
    let (body, toml) = (object(&body, py)?, estimate.to_toml(table));
    Ok(dict! { py; "body": body, "toml": toml, "formulas": estimate.formulas.into_py_dict(py)? })
}

/// A robot's file as plain data: name, source, format, notes, links, joints and thrusters; `uvms_gym.import_robot` documents the
/// formats.
#[pyfunction]
pub fn read_robot(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let robot = detached(py, || Robot::from_file(path))?.or_raise()?;
    let value = toml::Value::try_from(&robot).map_err(|e| SceneError::new_err(e.to_string()))?;
    object(&value, py)
}

/// The scene of a robot of the form of `read_robot`, and what should be known about it; `uvms_gym.import_robot` documents the
/// arguments.
#[pyfunction]
#[pyo3(signature = (robot, *, vehicle=None, thrusters=None, position=None, rpy=None, base=None, tips=None, lock=None, keep=None, density=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of a Python function")]
pub fn assemble_robot<'py>(
    py: Python<'py>,
    robot: &Bound<'py, PyDict>,
    vehicle: Option<&Bound<'py, PyAny>>,
    thrusters: Option<&Bound<'py, PyAny>>,
    position: Given,
    rpy: Given,
    base: Option<Bound<'py, PyString>>,
    tips: Option<Vec<(String, String)>>,
    lock: Option<Vec<String>>,
    keep: Option<Vec<String>>,
    density: Option<Vec<(Option<String>, f64)>>,
) -> PyResult<(Bound<'py, PyAny>, Vec<String>)> {
    let source = robot.get_item("source")?.and_then(|source| source.extract::<String>().ok());
    let robot = Robot::from_value(tree(robot)?, source.as_deref().unwrap_or("<dict>")).or_raise()?;
    let vehicle = vehicle.map(read).transpose()?;
    let vector = |name, given: Given| -> PyResult<Vector3<f64>> {
        let Some(given) = given else { return Ok(Vector3::zeros()) };
        let (shape, numbers) = numbers(name, given)?;
        let finite = numbers.iter().all(|x| x.abs() <= 1e12);
        match numbers[..] {
            [x, y, z] if shape == [3] && finite => Ok(Vector3::new(x, y, z)),
            _ => Err(SceneError::new_err(format!("{name} must be three finite numbers, but is {numbers:?}"))),
        }
    };
    let mount = Frame { position: vector("position", position)?, rpy: vector("rpy", rpy)? };
    let base = base.as_ref().map(|base| text(base, "base")).transpose()?;
    let (tips, density) = (tips.unwrap_or_default(), density.unwrap_or_default());
    let (lock, keep) = (lock.unwrap_or_default(), keep.unwrap_or_default());
    let vehicle = vehicle.as_ref();
    let word = thrusters.and_then(|given| given.extract::<String>().ok());
    let other = match word.as_deref() {
        Some("file" | "assumed") => None,
        _ => thrusters.map(read).transpose()?,
    };
    let thrusters = match (&other, word.as_deref()) {
        (Some(scene), _) => ThrusterSource::Scene(scene),
        (None, Some("file")) => ThrusterSource::File,
        (None, Some(_)) => ThrusterSource::Assumed,
        (None, None) => ThrusterSource::FileOrAssumed,
    };
    let (tips, lock, keep, density) = (&tips, &lock, &keep, &density);
    let assembly = Assembly { vehicle, thrusters, mount, base, tips, lock, keep, density };
    let Imported { scene, notes } = detached(py, || assembly.of(&robot))?.or_raise()?;
    Ok((to_python(&scene, py)?, notes))
}
