//! Reading vectors and matrices from the short forms that people write.

use nalgebra::Matrix6;

/// All zeros.
pub fn zero6() -> Matrix6<f64> {
    Matrix6::zeros()
}

/// Three numbers.
pub mod vector3 {
    use nalgebra::Vector3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(v: &Vector3<f64>, s: S) -> Result<S::Ok, S::Error> {
        [v.x, v.y, v.z].serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Vector3<f64>, D::Error> {
        <[f64; 3]>::deserialize(d).map(Vector3::from)
    }
}

/// Moments of inertia.
pub mod inertia {
    use nalgebra::Matrix3;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(m: &Matrix3<f64>, s: S) -> Result<S::Ok, S::Error> {
        <[[f64; 3]; 3]>::from(m.transpose()).serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Matrix3<f64>, D::Error> {
        <[[f64; 3]; 3]>::deserialize(d).map(|rows| Matrix3::from(rows).transpose())
    }
}

/// A 6x6 matrix.
pub mod matrix6 {
    use nalgebra::Matrix6;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(m: &Matrix6<f64>, s: S) -> Result<S::Ok, S::Error> {
        <[[f64; 6]; 6]>::from(m.transpose()).serialize(s)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<Matrix6<f64>, D::Error> {
        <[[f64; 6]; 6]>::deserialize(d).map(|rows| Matrix6::from(rows).transpose())
    }
}
