//! Arguments in, fresh arrays out.

use numpy::ndarray::{Array2, ArrayD, Dimension, IxDyn};
use numpy::{
    Element, IntoPyArray, PyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::errors::OrRaise;
use uvms_gym::limits::memory;

/// A dict of values by name.
macro_rules! dict {
    ($py:expr; $($name:literal: $value:expr),+ $(,)?) => {{
        let dict = pyo3::types::PyDict::new($py);
        $(dict.set_item($name, $value)?;)+
        dict
    }};
}

pub(super) use dict;

/// An optional argument.
pub type Given<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// A fresh array.
pub type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// A one-dimensional array.
pub type Row<'py, T> = Bound<'py, PyArray1<T>>;

/// A two-dimensional array.
pub type Rows<'py, T> = Bound<'py, PyArray2<T>>;

/// An array of `shape` from its numbers by rows.
pub fn array<'py>(py: Python<'py>, shape: &[usize], numbers: Vec<f64>) -> PyResult<Array<'py>> {
    let array = ArrayD::from_shape_vec(IxDyn(shape), numbers).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(array.into_pyarray(py))
}

/// A fresh (count, .) array from its entries by rows.
pub fn matrix<'py, T: Element>(py: Python<'py>, flat: Vec<T>, count: usize) -> PyResult<Rows<'py, T>> {
    let width = flat.len() / count.max(1);
    match Array2::from_shape_vec((count, width), flat) {
        Ok(array) => Ok(array.into_pyarray(py)),
        Err(error) => Err(PyValueError::new_err(error.to_string())),
    }
}

/// Shape and numbers by rows of anything that NumPy takes for an array of real numbers.
pub fn read(name: &str, given: &Bound<'_, PyAny>) -> PyResult<(Vec<usize>, Vec<f64>)> {
    let py = given.py();
    // Subclasses may have masks.
    let plain = given.get_type().is(py.get_type::<PyUntypedArray>());
    if plain
        && let Ok(array) = given.cast::<PyArrayDyn<f64>>()
        && array.is_c_contiguous()
        && array.data().is_aligned()
    {
        return numbers(array);
    }
    let numpy = py.import(intern!(py, "numpy"))?;
    if !plain && numpy.getattr(intern!(py, "ma"))?.call_method1(intern!(py, "is_masked"), (given,))?.is_truthy()? {
        return Err(PyValueError::new_err(format!("{name} has masked entries: fill them, or leave them out")));
    }
    let array = numpy.call_method1(intern!(py, "asarray"), (given,))?;
    let dtype = array.getattr(intern!(py, "dtype"))?;
    let kind: String = dtype.getattr(intern!(py, "kind"))?.extract()?;
    if !["f", "i", "u"].contains(&kind.as_str()) {
        return Err(PyTypeError::new_err(format!("{name} must be an array of real numbers, not of {}", dtype.str()?)));
    }
    let options = PyDict::new(py);
    options.set_item(intern!(py, "order"), "C")?;
    let array = numpy.call_method(intern!(py, "array"), (array, intern!(py, "float64")), Some(&options))?;
    numbers(&array.extract()?)
}

/// Shape and numbers of an array that has them in one piece, by rows. A copy: nobody else can change it while the GIL is
/// released.
fn numbers(array: &Array<'_>) -> PyResult<(Vec<usize>, Vec<f64>)> {
    let numbers = array.try_readonly().map_err(|e| PyValueError::new_err(e.to_string()))?.as_slice()?.to_vec();
    Ok((array.shape().to_vec(), numbers))
}

/// Numbers by rows. A copy: the caller's array may change while other Python threads run.
pub fn copied<T: Element, D: Dimension>(array: &Bound<'_, PyArray<T, D>>) -> PyResult<Vec<T>> {
    if array.is_c_contiguous() && array.data().is_aligned() {
        return Ok(array.to_vec()?);
    }
    let by_rows = array.call_method1(intern!(array.py(), "copy"), ("C",))?;
    Ok(by_rows.cast::<PyArray<T, D>>()?.to_vec()?)
}

/// Rows of shape `row`, one per instance: as given, or one row for all instances.
pub fn rows(name: &str, given: &Bound<'_, PyAny>, instances: usize, row: &[usize]) -> PyResult<Vec<f64>> {
    let (shape, numbers) = read(name, given)?;
    if shape == row && instances == 1 {
        Ok(numbers)
    } else if shape == row {
        memory::check("the input", &[instances, numbers.len(), size_of::<f64>()]).or_raise()?;
        Ok(numbers.repeat(instances))
    } else if shape.split_first().is_some_and(|(first, rest)| *first == instances && rest == row) {
        Ok(numbers)
    } else {
        let all = [&[instances], row].concat();
        Err(wrong_shape(name, &shape, &format!("{} or {}", shape_text(row), shape_text(&all))))
    }
}

/// [`rows`] of an optional argument.
pub fn optional_rows(name: &str, given: Given, instances: usize, row: &[usize]) -> PyResult<Option<Vec<f64>>> {
    given.map(|given| rows(name, given, instances, row)).transpose()
}

/// The error of an array of another shape.
pub fn wrong_shape(name: &str, shape: &[usize], allowed: &str) -> PyErr {
    PyValueError::new_err(format!("{name} has shape {}, but must have {allowed}", shape_text(shape)))
}

/// A shape as Python writes it.
fn shape_text(shape: &[usize]) -> String {
    match shape {
        [only] => format!("({only},)"),
        _ => format!("({})", shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// An integer of at least 1.
pub fn count(name: &str, given: &Bound<'_, PyAny>) -> PyResult<usize> {
    let py = given.py();
    match given.extract::<i64>() {
        Ok(count) if count >= 1 => Ok(count as usize),
        Ok(count) => Err(PyValueError::new_err(format!("{name} must be at least 1, not {count}"))),
        Err(error) if error.is_instance_of::<PyOverflowError>(py) => {
            Err(PyValueError::new_err(format!("{name} is out of range: {}", given.str()?)))
        }
        Err(_) => Err(PyTypeError::new_err(format!("{name} must be an int, not {}", given.get_type().name()?))),
    }
}

/// The value that `name` stands for.
pub fn one_of<T, const K: usize>(argument: &str, name: &str, choices: [(&str, T); K]) -> PyResult<T> {
    let known = choices.each_ref().map(|(name, _)| format!("'{name}'")).join(", ");
    let found = choices.into_iter().find(|(choice, _)| *choice == name);
    found
        .map(|(_, value)| value)
        .ok_or_else(|| PyValueError::new_err(format!("{argument} is '{name}', but must be one of {known}")))
}

/// The name of `value`.
pub fn name_of<T: PartialEq, const K: usize>(value: T, choices: [(&'static str, T); K]) -> &'static str {
    choices.into_iter().find(|(_, choice)| *choice == value).expect("every value has a name").0
}
