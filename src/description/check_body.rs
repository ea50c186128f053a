//! Physical validity of one body.

use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector6};

use super::warnings::implausible;
use super::{Body, Frame, SceneWarning, Water};
use crate::error::{Numbers, Problem};
use crate::keys::{Fault, range};

/// Maximum difference of the entries ij and ji of a symmetric matrix A that counts as rounding of published digits, relative to
/// `sqrt(A_ii A_jj)`, the maximum that the entry can have: their mean changes the motion by less.
const SYMMETRY: f64 = 1e-3;
/// Rounding in double precision, relative to the largest entry.
const ROUNDING: f64 = 1e-9;
/// Allowed violation of the triangle inequality by rounded tables, relative to the largest moment.
const TRIANGLE: f64 = 1e-6;
/// Minimum eigenvalue of a positive definite matrix, relative to the maximum.
const DEFINITE: f64 = 1e-12;
/// Allowed negative eigenvalue of rounded semi-definite tables, relative to the maximum.
const SEMI_DEFINITE: f64 = 1e-6;
/// Allowed difference of a stated weight from mass times gravity, %.
const WEIGHT_PERCENT: f64 = 0.5;

/// Faults and warnings of one body. A fixed vehicle never moves, so its inertia is not checked.
pub fn validate(
    body: &Body,
    key: &str,
    water: &Water,
    fixed: bool,
    warnings: &mut Vec<SceneWarning>,
) -> Result<(), Fault> {
    let key = |name: &str| format!("{key}.{name}");
    warnings.extend(symmetric(&body.inertia, || key("inertia"))?);
    warnings.extend(symmetric(&body.added_mass, || key("added_mass"))?);
    if fixed {
        range(body.mass >= 0.0, body.mass, ">= 0", || key("mass"))?;
    } else {
        range(body.mass > 0.0, body.mass, "> 0", || key("mass"))?;
        rigid_inertia(&body.inertia_about_com(), || key("inertia"))?;
    }
    weight(body, water, || key("weight"))?;
    buoyancy(body, water, key)?;

    let added = eigenvalues(&((body.added_mass + body.added_mass.transpose()) / 2.0));
    definite("added mass", &added, true, || key("added_mass"))?;
    if !fixed {
        let total = eigenvalues(&total_inertia(body));
        definite("rigid-body plus added mass", &total, false, || key("added_mass"))?;
    }
    linear_damping(&body.damping.linear, || key("damping.linear"))?;
    warnings.extend(quadratic_damping(&body.damping.quadratic, key("damping.quadratic"))?);
    Ok(())
}

/// Refuses a matrix that is not symmetric, and warns of one that is so but for rounding of published digits: it is made symmetric.
fn symmetric<const N: usize>(m: &SMatrix<f64, N, N>, key: impl Fn() -> String) -> Result<Option<SceneWarning>, Fault> {
    let mut most = (ROUNDING * m.amax(), None);
    let pairs = (0..N).flat_map(|row| (row + 1..N).map(move |column| (row, column)));
    for (row, column) in pairs {
        let (upper, lower) = (m[(row, column)], m[(column, row)]);
        let coupling = (m[(row, row)] * m[(column, column)]).max(0.0).sqrt();
        if (upper - lower).abs() > (SYMMETRY * coupling).max(ROUNDING * m.amax()) {
            return Err(Fault::new(key(), Problem::Asymmetric { row, column, upper, lower, tolerance: SYMMETRY }));
        }
        if (upper - lower).abs() > most.0 {
            most = ((upper - lower).abs(), Some((row, column, upper, lower)));
        }
    }
    Ok(most.1.map(|(row, column, upper, lower)| {
        let entries = format!("entries [{row}][{column}] and [{column}][{row}] are {upper:?} and {lower:?}");
        implausible(key(), format!("{entries}: the mean of both is used, as the matrix must be symmetric"))
    }))
}

/// Eigenvalues in ascending order of a symmetric matrix.
fn eigenvalues<const N: usize>(m: &SMatrix<f64, N, N>) -> Vec<f64> {
    let scale = m.amax();
    if scale == 0.0 {
        return vec![0.0; N];
    }
    let scaled = DMatrix::from_iterator(N, N, m.iter().map(|x| x / scale));
    let mut values: Vec<f64> = scaled.symmetric_eigenvalues().iter().map(|x| x * scale).collect();
    values.sort_by(f64::total_cmp);
    values
}

fn definite(what: &'static str, values: &[f64], semi: bool, key: impl FnOnce() -> String) -> Result<(), Fault> {
    let (minimum, maximum) = (values[0], values[values.len() - 1]);
    let ok = if semi { minimum >= -SEMI_DEFINITE * maximum.max(0.0) } else { minimum > DEFINITE * maximum };
    if ok {
        return Ok(());
    }
    let eigenvalues = Numbers(values.to_vec());
    Err(Fault::new(key(), Problem::Indefinite { what, semi, eigenvalue: minimum, eigenvalues }))
}

fn rigid_inertia(about_com: &Matrix3<f64>, key: impl Fn() -> String) -> Result<(), Fault> {
    let moments = eigenvalues(&((about_com + about_com.transpose()) / 2.0));
    definite("inertia about the centre of mass", &moments, false, &key)?;
    if moments[2] > moments[0] + moments[1] + TRIANGLE * moments[2] {
        return Err(Fault::new(key(), Problem::Triangle { moments: Numbers(moments) }));
    }
    Ok(())
}

/// M_RB + M_A about the centre of mass, in body axes.
fn total_inertia(body: &Body) -> Matrix6<f64> {
    let mut total = Matrix6::zeros();
    total.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(body.mass);
    total.fixed_view_mut::<3, 3>(3, 3).copy_from(&body.inertia_about_com());
    let Frame { position, rpy } = body.hydrodynamic_frame;
    let x = Frame { position: position - body.center_of_mass, rpy }.adjoint_inverse();
    total += x.transpose() * body.added_mass * x;
    (total + total.transpose()) / 2.0
}

fn weight(body: &Body, water: &Water, key: impl FnOnce() -> String) -> Result<(), Fault> {
    let Some(weight) = body.weight else { return Ok(()) };
    let (mass, gravity, percent) = (body.mass, water.gravity.norm(), WEIGHT_PERCENT);
    let expected = mass * gravity;
    if (weight - expected).abs() > percent / 100.0 * expected {
        return Err(Fault::new(key(), Problem::Weight { weight, mass, gravity, expected, percent }));
    }
    Ok(())
}

fn buoyancy(body: &Body, water: &Water, key: impl Fn(&str) -> String) -> Result<(), Fault> {
    if let Some(volume) = body.volume {
        range(volume >= 0.0, volume, ">= 0", || key("volume"))?;
    }
    let Some(buoyancy) = body.buoyancy else { return Ok(()) };
    range(buoyancy >= 0.0, buoyancy, ">= 0", || key("buoyancy"))?;
    if let Some(volume) = body.volume {
        return Err(Fault::new(key("buoyancy"), Problem::TwoBuoyancies { buoyancy, volume }));
    }
    let (density, gravity) = (water.density, water.gravity.norm());
    if density * gravity == 0.0 {
        return Err(Fault::new(key("buoyancy"), Problem::BuoyancyWithoutWater { buoyancy, density, gravity }));
    }
    Ok(())
}

fn diagonal_opposes(m: &Matrix6<f64>, key: impl FnOnce() -> String) -> Result<(), Fault> {
    match (0..6).find(|&i| m[(i, i)] < 0.0) {
        Some(index) => Err(Fault::new(key(), Problem::NegativeDiagonal { index, value: m[(index, index)] })),
        None => Ok(()),
    }
}

fn linear_damping(m: &Matrix6<f64>, key: impl Fn() -> String) -> Result<(), Fault> {
    diagonal_opposes(m, &key)?;
    // The skew part is lift, without power.
    definite("symmetric part of linear damping", &eigenvalues(&((m + m.transpose()) / 2.0)), true, key)
}

/// Samples the power `-V . D_Q (V * |V|)` over twists; a diagonal matrix without negative entries needs no sampling.
fn quadratic_damping(m: &Matrix6<f64>, key: String) -> Result<Option<SceneWarning>, Fault> {
    diagonal_opposes(m, || key.clone())?;
    if *m == Matrix6::from_diagonal(&m.diagonal()) {
        return Ok(None);
    }
    const LEVELS: [f64; 5] = [-1.0, -0.3, 0.0, 0.3, 1.0];
    let twists = (0..LEVELS.len().pow(6))
        .map(|n| Vector6::from_fn(|i, _| LEVELS[n / LEVELS.len().pow(i as u32) % LEVELS.len()]));
    let power = |v: &Vector6<f64>| -v.dot(&(m * v.component_mul(&v.abs())));
    let worst = twists.map(|v| (power(&v), v)).max_by(|a, b| a.0.total_cmp(&b.0));
    Ok(worst.filter(|(power, _)| *power > ROUNDING * m.amax()).map(|(power, v)| SceneWarning::DampingAddsEnergy {
        key,
        twist: v.into(),
        power,
    }))
}
