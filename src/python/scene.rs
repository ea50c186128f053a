//! Scenes from names, paths and dicts, and back to dicts.

use std::path::PathBuf;

use pyo3::exceptions::PyTypeError;
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml::Value;

use super::computation::detached;
use super::errors::{OrRaise, SceneError};
use uvms_gym::description::{Scene, SceneEditor, SceneWarning, file_value};
use uvms_gym::error::DescriptionError;

/// Source of a scene that comes as a dict, in errors.
const DICT: &str = "<dict>";
/// Dicts and lists within each other; a scene needs 6, and one that contains itself would have no end.
const DEPTH: usize = 32;

/// Names of the scenes that come with the package.
#[pyfunction]
pub fn scene_names() -> Vec<&'static str> {
    Scene::shipped_names()
}

/// Names of the shipped arms without vehicle: parts for `[arm] file` and `[[arms]]` of a scene.
#[pyfunction]
pub fn arm_names() -> Vec<&'static str> {
    Scene::shipped_arm_names()
}

/// Terms of a vehicle beyond its body and thrusters.
///
/// Returns
/// -------
/// list of (str, str)
///     Key in the vehicle's table, and a note for reports.
#[pyfunction]
pub fn vehicle_terms() -> Vec<(&'static str, &'static str)> {
    uvms_gym::terms::TERMS.to_vec()
}

/// Read and check a scene.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     Name of a shipped scene (see `scene_names`), path of a TOML file, or a dict of the same form. Vectors and matrices
///     in a dict may be NumPy arrays. Tables that state `axes = "ned"` are in Fossen's body axes (z down) and are converted.
///     Parts (`file` in `vehicle`, `arm` and `arms`) are replaced by their tables; files of parts are relative to the
///     scene's file, those in a dict to the working directory.
/// end_effector : str, optional
///     Name of the end effector to use in place of `arm.end_effector`, one of `[arm.end_effectors]`. The end effector of
///     before keeps a name, "default" if it has none, and a payload stays where it is.
///
/// Returns
/// -------
/// dict
///     The scene in SI units, axes forward-left-up, 6x6 matrices in the order [linear; angular], defaults filled in, axes
///     of unit length.
///
/// Raises
/// ------
/// SceneError
///     The scene cannot be read, or no physical system can be like that. The message names file, key and value.
#[pyfunction]
#[pyo3(signature = (scene, *, end_effector=None))]
pub fn load_scene<'py>(scene: &Bound<'py, PyAny>, end_effector: Option<&str>) -> PyResult<Bound<'py, PyAny>> {
    to_python(&read_with(scene, end_effector)?, scene.py())
}

/// The scene that an argument means, with the end effector of this name in use.
fn read_with(given: &Bound<'_, PyAny>, end_effector: Option<&str>) -> PyResult<Scene> {
    let scene = read(given)?;
    end_effector.map_or(Ok(scene.clone()), |name| scene.with_end_effector(name)).or_raise()
}

/// The scene that an argument means.
pub fn read(given: &Bound<'_, PyAny>) -> PyResult<Scene> {
    Ok(read_with_warnings(given)?.0)
}

/// The scene that an argument means, and warnings about the values as they are stated.
pub fn read_with_warnings(given: &Bound<'_, PyAny>) -> PyResult<(Scene, Vec<SceneWarning>)> {
    let of = |(value, source): (Value, String)| Scene::from_value_with_warnings(value, &source);
    if let Ok(name) = given.cast::<PyString>() {
        let name = text(name, "scene")?;
        return detached(given.py(), || Scene::load_value(name).and_then(of))?.or_raise();
    }
    if given.is_instance_of::<PyDict>() {
        return of((value(given, "", 0)?, DICT.to_owned())).or_raise();
    }
    if given.hasattr(intern!(given.py(), "__fspath__"))? {
        let path = given.extract::<PathBuf>()?;
        return detached(given.py(), || file_value(&path).and_then(of))?.or_raise();
    }
    Err(PyTypeError::new_err(format!("scene must be a name, a path or a dict, not {}", kind(given)?)))
}

/// The scene that an argument means for all instances, or those that a list means for each, with `parameters` by keys and
/// the end effector of this name in use.
pub fn read_each(
    given: &Bound<'_, PyAny>,
    instances: Option<usize>,
    parameters: Option<&Bound<'_, PyDict>>,
    end_effector: Option<&str>,
) -> PyResult<Vec<Scene>> {
    let each = |item: PyResult<Bound<'_, PyAny>>| {
        given.py().check_signals()?;
        read_with(&item?, end_effector)
    };
    let list = given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>();
    let scenes: Vec<Scene> = if list {
        given.try_iter()?.map(each).collect::<PyResult<_>>()?
    } else {
        vec![read_with(given, end_effector)?]
    };
    let Some(parameters) = parameters.filter(|parameters| !parameters.is_empty()) else { return Ok(scenes) };
    let mut columns = Vec::new();
    let mut count = if list { Some(scenes.len()) } else { instances };
    for (key, values) in parameters {
        let Ok(key) = key.cast::<PyString>() else {
            return Err(PyTypeError::new_err(format!("keys of parameters must be strings, not {}", kind(&key)?)));
        };
        let name = text(key, "parameters")?.to_owned();
        let (shape, numbers) = super::arrays::read(&format!("parameters['{name}']"), &values)?;
        let rows = shape.first().copied();
        if let (Some(rows), None) = (rows, count) {
            count = Some(rows);
        }
        if rows.is_some() && rows != count {
            let allowed = format!("() or ({}, ...)", count.unwrap_or(1));
            return Err(super::arrays::wrong_shape(&format!("parameters['{name}']"), &shape, &allowed));
        }
        columns.push((name, shape, numbers));
    }
    let keys: Vec<String> = columns.iter().map(|(name, ..)| name.clone()).collect();
    let editor = |scene: &Scene| SceneEditor::new(scene, keys.clone()).or_raise();
    let shared = if list { None } else { Some(editor(&scenes[0])?) };
    let edit = |i: usize| {
        given.py().check_signals()?;
        match &shared {
            Some(editor) => edited(editor, &columns, i).or_raise(),
            None => edited(&editor(&scenes[i])?, &columns, i).or_raise(),
        }
    };
    (0..count.unwrap_or(1)).map(edit).collect()
}

/// Name, shape and numbers of a parameter.
type Column = (String, Vec<usize>, Vec<f64>);

/// The scene of instance `i`.
fn edited(editor: &SceneEditor, columns: &[Column], i: usize) -> Result<Scene, DescriptionError> {
    let value = |(_, shape, numbers): &Column| match shape.split_first() {
        None => Value::Float(numbers[0]),
        Some((rows, row)) => nested(row, &numbers[i * (numbers.len() / rows)..]),
    };
    editor.edited(columns.iter().map(value), &format!("scene '{}', instance {i}", editor.name()))
}

/// A list of this shape of the first numbers.
fn nested(shape: &[usize], numbers: &[f64]) -> Value {
    match shape.split_first() {
        None => Value::Float(numbers[0]),
        Some((rows, row)) => {
            let size: usize = row.iter().product();
            Value::Array((0..*rows).map(|k| nested(row, &numbers[k * size..])).collect())
        }
    }
}

/// A scene as a dict.
pub fn to_python<'py>(scene: &Scene, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
    let tree = Value::try_from(scene).map_err(|e| SceneError::new_err(format!("{}: {e}", scene.name)))?;
    object(&tree, py)
}

/// A tree of plain values as Python objects.
pub fn object<'py>(value: &Value, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::String(text) => PyString::new(py, text).into_any(),
        Value::Integer(i) => PyInt::new(py, *i).into_any(),
        Value::Float(x) => PyFloat::new(py, *x).into_any(),
        Value::Boolean(b) => PyBool::new(py, *b).to_owned().into_any(),
        Value::Datetime(time) => PyString::new(py, &time.to_string()).into_any(),
        Value::Array(list) => {
            let list: Vec<_> = list.iter().map(|e| object(e, py)).collect::<PyResult<_>>()?;
            PyList::new(py, list)?.into_any()
        }
        Value::Table(table) => {
            let dict = PyDict::new(py);
            for (key, value) in table {
                dict.set_item(key, object(value, py)?)?;
            }
            dict.into_any()
        }
    })
}

/// A tree of plain values from a dict.
pub fn tree(given: &Bound<'_, PyDict>) -> PyResult<Value> {
    value(given, "", 0)
}

/// A tree of plain values from Python objects; `key` is the path to `given`.
fn value(given: &Bound<'_, PyAny>, key: &str, depth: usize) -> PyResult<Value> {
    if depth > DEPTH {
        return Err(fault(key, "nested too deeply"));
    }
    if let Ok(b) = given.cast::<PyBool>() {
        return Ok(Value::Boolean(b.is_true()));
    }
    if given.is_instance_of::<PyInt>() {
        let out_of_range = |_| fault(key, "an int must fit into 64 bits");
        return given.extract().map(Value::Integer).map_err(out_of_range);
    }
    if let Ok(x) = given.cast::<PyFloat>() {
        return Ok(Value::Float(x.value()));
    }
    if let Ok(string) = given.cast::<PyString>() {
        return Ok(Value::String(text(string, key)?.to_owned()));
    }
    if let Ok(dict) = given.cast::<PyDict>() {
        let mut table = toml::Table::new();
        // The items are a list of their own: the dict may change meanwhile.
        for item in dict.items() {
            let (name, item): (Bound<PyAny>, Bound<PyAny>) = item.extract()?;
            let Ok(name) = name.cast::<PyString>() else {
                return Err(fault(key, &format!("keys must be strings, not {}", kind(&name)?)));
            };
            let name = text(name, key)?;
            let path = if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
            table.insert(name.to_owned(), value(&item, &path, depth + 1)?);
        }
        return Ok(Value::Table(table));
    }
    if given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>() {
        let mut list = Vec::new();
        for (i, item) in given.try_iter()?.enumerate() {
            list.push(value(&item?, &format!("{key}[{i}]"), depth + 1)?);
        }
        return Ok(Value::Array(list));
    }
    let numpy = given.py().import(intern!(given.py(), "numpy"))?;
    for class in [intern!(given.py(), "ndarray"), intern!(given.py(), "generic")] {
        if given.is_instance(&numpy.getattr(class)?)? {
            return value(&given.call_method0(intern!(given.py(), "tolist"))?, key, depth + 1);
        }
    }
    Err(fault(key, &format!("a {} is none of dict, list, tuple, str, bool, int, float or NumPy array", kind(given)?)))
}

fn fault(key: &str, problem: &str) -> PyErr {
    SceneError::new_err(if key.is_empty() { format!("{DICT}: {problem}") } else { format!("{DICT}: {key}: {problem}") })
}

fn kind(object: &Bound<'_, PyAny>) -> PyResult<String> {
    Ok(object.get_type().name()?.to_string())
}

/// A string's text, unless it has surrogates.
pub fn text<'a>(string: &'a Bound<'_, PyString>, key: &str) -> PyResult<&'a str> {
    string.to_str().map_err(|_| fault(key, "text that is no valid Unicode"))
}
