//! `uvms_gym.Simulator`: contacts at the present states.

use nalgebra::Vector3;
use pyo3::prelude::*;

use super::arrays::Array;
use super::computation::shared;
use super::model::{Arrays, dict, pose_rows};
use super::simulator::Simulator;
use uvms_gym::dynamics::Contact;

#[pymethods]
impl Simulator {
    /// Contacts of every sphere with every shape (S spheres, H shapes), world axes.
    ///
    /// Returns
    /// -------
    /// dict of numpy.ndarray
    ///     depth (N, H, S): penetration, m, negative where they are apart; normal_force (N, H, S), N; slip (N, H, S): speed of
    ///     sliding, m/s; force (N, H, S, 3): on the sphere, N; point (N, H, S, 3): where it acts, m; normal (N, H, S, 3):
    ///     outward normal of the shape.
    fn contacts<'py>(slf: &Bound<'py, Self>) -> Arrays<'py> {
        let (this, py) = (shared(slf)?, slf.py());
        let contact = this.inner.scene().contact.as_ref();
        let (shapes, spheres) = contact.map_or((0, 0), |contact| (contact.shapes.len(), contact.spheres.len()));
        let (one, three): (&[usize], &[usize]) = (&[shapes, spheres], &[shapes, spheres, 3]);
        let names = ["depth", "normal_force", "slip", "force", "point", "normal"];
        let arrays = this.each(py, [one, one, one, three, three, three], |_, form| {
            let contacts = form.contacts();
            let numbers = |f: fn(&Contact) -> f64| contacts.iter().map(f).collect();
            let vectors =
                |f: fn(&Contact) -> Vector3<f64>| contacts.iter().flat_map(|c| <[f64; 3]>::from(f(c))).collect();
            let [depth, force, slip] = [numbers(|c| c.depth), numbers(|c| c.normal_force), numbers(|c| c.slip)];
            Ok([depth, force, slip, vectors(|c| c.force), vectors(|c| c.point), vectors(|c| c.normal)])
        })?;
        dict(py, names, arrays)
    }

    /// Poses of the fixtures in the world, in the order of the scene.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (N, F, 4, 4)
    ///     Homogeneous matrices, fixture to world, m; F is 0 in a scene without fixtures.
    fn fixture_poses<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        let this = shared(slf)?;
        let shape = [this.inner.scene().fixtures.len(), 4, 4];
        let poses =
            this.each(slf.py(), [&shape], |_, form| Ok([form.fixture_poses().iter().flat_map(pose_rows).collect()]))?;
        let [poses] = poses;
        Ok(poses)
    }
}
