//! Bench tables of thrusters: thrust of a pulse width, and pulse width of a thrust.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use toml::Value;

use super::arrays::{Array, Given, array, read, wrong_shape};
use super::scene::{text, tree};
use uvms_gym::description::{ThrustMap, ThrustTable, VOLTAGE};

/// Range of pulses beyond the table's, at which the thruster gives what it gives at the table's end, us.
const BEYOND: f64 = 100.0;

/// Steady thrust of pulse widths on the bench table of a thruster, in still water.
///
/// The table is interpolated linearly in pulse width and voltage: exact at its rows, continuous, 0 within the dead band and
/// never less for a longer pulse. Pulses of 0, no signal, give 0 N. Other pulses beyond the table's give the thrust at its end.
///
/// Parameters
/// ----------
/// pulse : array_like (...)
///     Pulse widths, us: 0, or at most 100 us beyond the table's (1100 to 1900 us of the T200).
/// map : str or dict
///     "t200" (default), the table of Blue Robotics' T200 by its maker at 10, 12, 14, 16, 18 and 20 V, or a table of the same form:
///     pulses (n,), us, and voltages (m,), V, both ascending, and thrusts (n, m), N, which never descend with the pulse and
///     are 0 for all voltages at a pulse.
/// voltage : float or array_like (...)
///     Supply voltage, V, within the table's; one for all, or one per pulse. Default 16.
///
/// Returns
/// -------
/// ndarray (...)
///     Thrusts, N.
///
/// Raises
/// ------
/// ValueError
///     Unknown map, or a table of another form; a pulse or a voltage out of range.
#[pyfunction]
#[pyo3(signature = (pulse, map=None, voltage=None))]
pub fn thrust_of<'py>(pulse: &Bound<'py, PyAny>, map: Given<'_, 'py>, voltage: Given<'_, 'py>) -> PyResult<Array<'py>> {
    each(("pulse", pulse), map, voltage, |table, pulse, voltage| {
        let [first, last] = table.pulses();
        if pulse == 0.0 {
            Ok(0.0)
        } else if (first - BEYOND..=last + BEYOND).contains(&pulse) {
            Ok(table.thrust(pulse, voltage))
        } else {
            Err(format!("must be 0 or {:?} to {:?} us", first - BEYOND, last + BEYOND))
        }
    })
}

/// Pulse widths that give thrusts on the bench table of a thruster, in still water: the inverse of `thrust_of`.
///
/// Parameters
/// ----------
/// thrust : array_like (...)
///     Thrusts, N. The pulse for 0 N is the neutral one, in the middle of the dead band. Thrusts beyond the table's at this
///     voltage give its first or last pulse.
/// map : str or dict
///     As for `thrust_of`.
/// voltage : float or array_like (...)
///     As for `thrust_of`; one for all, or one per thrust.
///
/// Returns
/// -------
/// ndarray (...)
///     Pulse widths, us.
///
/// Raises
/// ------
/// ValueError
///     Unknown map, or a table of another form; a thrust that is not finite; a voltage out of range.
#[pyfunction]
#[pyo3(signature = (thrust, map=None, voltage=None))]
pub fn pulse_of<'py>(thrust: &Bound<'py, PyAny>, map: Given<'_, 'py>, voltage: Given<'_, 'py>) -> PyResult<Array<'py>> {
    each(("thrust", thrust), map, voltage, |table, thrust, voltage| match thrust.is_finite() {
        true => Ok(table.pulse(thrust, voltage)),
        false => Err("must be finite".to_owned()),
    })
}

/// Map that an argument means.
fn read_map(given: Given) -> PyResult<ThrustMap> {
    let Some(given) = given else { return Ok(ThrustMap::T200) };
    let value = if let Ok(name) = given.cast::<PyString>() {
        Value::String(text(name, "map")?.to_owned())
    } else if let Ok(table) = given.cast::<PyDict>() {
        tree(table)?
    } else {
        let kind = given.get_type().name()?;
        return Err(PyTypeError::new_err(format!("map must be a name or a dict of a table, not {kind}")));
    };
    value.try_into().map_err(|error: toml::de::Error| PyValueError::new_err(format!("map: {}", error.message())))
}

/// Values of a table at numbers, each with the voltage that belongs to it.
fn each<'py>(
    (name, given): (&str, &Bound<'py, PyAny>),
    map: Given<'_, 'py>,
    voltage: Given<'_, 'py>,
    value: impl Fn(&ThrustTable, f64, f64) -> Result<f64, String>,
) -> PyResult<Array<'py>> {
    let map = read_map(map)?;
    let Some(table) = map.table() else {
        return Err(PyValueError::new_err("map: must be a table: pairs are no thrusts of pulses"));
    };
    let (shape, mut numbers) = read(name, given)?;
    let (of_voltages, voltages) = voltage.map_or(Ok((Vec::new(), vec![VOLTAGE])), |given| read("voltage", given))?;
    if !of_voltages.is_empty() && of_voltages != shape {
        return Err(wrong_shape("voltage", &of_voltages, &format!("() or the shape of {name}")));
    }
    let single = of_voltages.is_empty();
    let place = |name: &str, k: usize, single: bool| if single { name.to_owned() } else { format!("{name}[{k}]") };
    let refuse = |place: String, is: f64, rule: String| PyValueError::new_err(format!("{place} is {is:?}, but {rule}"));
    let [lower, upper] = table.voltages();
    if let Some(k) = voltages.iter().position(|voltage| !(lower <= *voltage && *voltage <= upper)) {
        let rule = format!("the table has {lower:?} to {upper:?} V");
        return Err(refuse(place("voltage", k, single), voltages[k], rule));
    }
    for (k, number) in numbers.iter_mut().enumerate() {
        let voltage = voltages[if single { 0 } else { k }];
        *number =
            value(table, *number, voltage).map_err(|rule| refuse(place(name, k, shape.is_empty()), *number, rule))?;
    }
    array(given.py(), &shape, numbers)
}
