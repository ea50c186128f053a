//! Serialisation of vectors and matrices in short forms.

use nalgebra::SMatrix;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Entry of a list that is either a diagonal (numbers) or a matrix (rows).
enum NumberOrRow {
    Number(f64),
    Row(Vec<f64>),
}

impl<'de> Deserialize<'de> for NumberOrRow {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct NumberOrRowVisitor;
        impl<'de> Visitor<'de> for NumberOrRowVisitor {
            type Value = NumberOrRow;

            fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
                f.write_str("a number or a row of numbers")
            }

            fn visit_f64<E: Error>(self, x: f64) -> Result<NumberOrRow, E> {
                Ok(NumberOrRow::Number(x))
            }

            fn visit_i64<E: Error>(self, x: i64) -> Result<NumberOrRow, E> {
                Ok(NumberOrRow::Number(x as f64))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<NumberOrRow, A::Error> {
                Deserialize::deserialize(SeqAccessDeserializer::new(seq)).map(NumberOrRow::Row)
            }
        }
        d.deserialize_any(NumberOrRowVisitor)
    }
}

/// All numbers of a list, if it holds no rows.
fn all_numbers(entries: &[NumberOrRow]) -> Option<Vec<f64>> {
    entries.iter().map(|e| if let NumberOrRow::Number(x) = e { Some(*x) } else { None }).collect()
}

/// The matrix of a list of N rows of N numbers.
fn all_rows<const N: usize>(entries: &[NumberOrRow]) -> Option<SMatrix<f64, N, N>> {
    let row = |entry: &NumberOrRow| match entry {
        NumberOrRow::Row(row) if row.len() == N => Some(row.clone()),
        _ => None,
    };
    let rows: Vec<Vec<f64>> = entries.iter().map(row).collect::<Option<_>>()?;
    (rows.len() == N).then(|| SMatrix::from_row_slice(&rows.concat()))
}

/// Description of a list of the wrong shape, for error messages.
fn shape(entries: &[NumberOrRow]) -> String {
    let lengths: Vec<_> = entries
        .iter()
        .filter_map(|e| if let NumberOrRow::Row(row) = e { Some(row.len().to_string()) } else { None })
        .collect();
    match (entries.len(), lengths.len()) {
        (n, 0) => format!("{n} numbers"),
        (n, rows) if n == rows => format!("rows of lengths {}", lengths.join(", ")),
        _ => "numbers and rows mixed".to_owned(),
    }
}

/// Writes a diagonal matrix as its diagonal, any other by rows.
pub fn write_square<S: Serializer, const N: usize>(m: &SMatrix<f64, N, N>, s: S) -> Result<S::Ok, S::Error> {
    let diagonal = SMatrix::<f64, N, N>::from_diagonal(&m.diagonal());
    if *m == diagonal {
        m.diagonal().as_slice().serialize(s)
    } else {
        m.row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>().serialize(s)
    }
}

/// Exactly N numbers.
pub fn array<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<[f64; N], D::Error> {
    <Vec<f64>>::deserialize(d)?
        .try_into()
        .map_err(|list: Vec<f64>| D::Error::custom(format!("expected {N} numbers, found {}", list.len())))
}

/// [`array()`] of a key that may be absent.
pub fn optional_array<'de, D: Deserializer<'de>, const N: usize>(d: D) -> Result<Option<[f64; N]>, D::Error> {
    array(d).map(Some)
}

/// One number per axis, or one for all.
pub fn axes<'de, D: Deserializer<'de>>(d: D) -> Result<[f64; 3], D::Error> {
    match NumberOrRow::deserialize(d)? {
        NumberOrRow::Number(x) => Ok([x; 3]),
        NumberOrRow::Row(row) => row
            .try_into()
            .map_err(|row: Vec<f64>| D::Error::custom(format!("expected 1 or 3 numbers, found {}", row.len()))),
    }
}

/// [`axes`] of a key that may be absent.
pub fn optional_axes<'de, D: Deserializer<'de>>(d: D) -> Result<Option<[f64; 3]>, D::Error> {
    axes(d).map(Some)
}

/// Three numbers, as a vector.
pub mod vector3 {
    use nalgebra::Vector3;

    use super::*;

    pub fn serialize<S: Serializer>(v: &Vector3<f64>, s: S) -> Result<S::Ok, S::Error> {
        v.as_slice().serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Vector3<f64>, D::Error> {
        array::<D, 3>(d).map(Vector3::from)
    }
}

/// A vector of a key that may be absent.
pub mod optional_vector3 {
    use nalgebra::Vector3;

    use super::*;

    pub fn serialize<S: Serializer>(v: &Option<Vector3<f64>>, s: S) -> Result<S::Ok, S::Error> {
        v.as_ref().map(|v| v.as_slice()).serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Option<Vector3<f64>>, D::Error> {
        vector3::deserialize(d).map(Some)
    }
}

/// Moments of inertia: `[xx, yy, zz]`, `[xx, xy, xz, yy, yz, zz]` or three rows of three.
pub mod inertia {
    use nalgebra::Matrix3;

    pub use super::write_square as serialize;
    use super::*;

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Matrix3<f64>, D::Error> {
        let entries = <Vec<NumberOrRow>>::deserialize(d)?;
        match all_numbers(&entries).as_deref() {
            Some(&[xx, yy, zz]) => Ok(Matrix3::from_diagonal(&[xx, yy, zz].into())),
            Some(&[xx, xy, xz, yy, yz, zz]) => Ok(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)),
            _ => all_rows(&entries).ok_or_else(|| {
                D::Error::custom(format!(
                    "expected 3 numbers (xx, yy, zz), 6 numbers (xx, xy, xz, yy, yz, zz) or 3 rows of 3, found {}",
                    shape(&entries)
                ))
            }),
        }
    }
}

/// A 6x6 matrix: six diagonal numbers or six rows of six.
pub mod matrix6 {
    use nalgebra::{Matrix6, Vector6};

    pub use super::write_square as serialize;
    use super::*;

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Matrix6<f64>, D::Error> {
        let entries = <Vec<NumberOrRow>>::deserialize(d)?;
        match all_numbers(&entries) {
            Some(diagonal) if diagonal.len() == 6 => Ok(Matrix6::from_diagonal(&Vector6::from_vec(diagonal))),
            _ => all_rows(&entries).ok_or_else(|| {
                D::Error::custom(format!("expected 6 diagonal numbers or 6 rows of 6, found {}", shape(&entries)))
            }),
        }
    }
}
