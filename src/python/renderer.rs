//! `uvms_gym.Renderer`.

use std::collections::HashMap;

use nalgebra::{Matrix3, Vector3};
use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

use super::arrays::{Array, Given, array, count, dict, matrix, read, rows, wrong_shape};
use super::computation::detached;
use super::errors::OrRaise;
use super::inputs::poses;
use super::scene;
use super::simulator::number;
use uvms_gym::description::Scene;
use uvms_gym::render::{
    self, BodySphere, Facet, Facets, RenderState, Settings, Spheres, Vector, hull::hull, mesh::Vertex, paint::display,
};

/// Draws pictures of one scene: vehicle, arm and thrusters where the physics has them.
///
/// A picture depends only on the scene and the arguments, byte for byte. World z is up. Poses that are not finite are not drawn.
///
/// Parameters
/// ----------
/// scene : str, os.PathLike or dict
///     Name of a shipped scene (see `scenes`), path of a TOML file, or a dict of the same form. `vehicle.shape` is
///     the shape of the vehicle; the default is a homogeneous box of the same mass and inertia. Mesh files (`meshes` of
///     vehicle, arm and links) are read here, by the extra `import`; a body whose files cannot all be read is drawn without
///     them, with a warning. Files of more than 20000 triangles are simplified.
/// width, height : int
///     Pixels, 1 to 4096.
/// azimuth, elevation : float
///     Direction from the point in the centre to the camera, rad: about the vertical from x, and above the horizontal. The
///     azimuth is -0.95 where None, or mirrored where shapes of contact near the vehicle would hide it.
/// distance : float or None
///     Distance of the camera, m; by the size of the scene where None.
/// floor : float or None
///     Height of the floor, m. Where None, the floor is the highest level plane of the scene's contact, which hides what is
///     below; without one it is below the scene at the origin.
///
/// Raises
/// ------
/// SceneError
///     The scene cannot be read, or no physical system can be like that.
/// ValueError, TypeError
///     Another argument is out of range or of the wrong type.
#[pyclass(module = "uvms_gym", name = "Renderer", frozen)]
pub struct Renderer {
    inner: render::Renderer,
    scene: Scene,
    settings: Settings,
    facets: Facets,
}

/// Position and rotation, from the arguments of a call.
type PositionAndRotation = (Vector3<f64>, Matrix3<f64>);

#[pymethods]
impl Renderer {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let name = PyString::new(py, &self.scene.name).repr()?;
        let [width, height] = self.inner.size();
        Ok(format!("Renderer({name}, width={width}, height={height}, distance={:.3})", self.inner.distance()))
    }

    #[new]
    #[pyo3(
        signature = (scene, *, width=None, height=None, azimuth=None, elevation=None, distance=None, floor=None),
        text_signature = "(scene, *, width=640, height=480, azimuth=None, elevation=0.32, distance=None, floor=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        width: Given,
        height: Given,
        azimuth: Given,
        elevation: Given,
        distance: Given,
        floor: Given,
    ) -> PyResult<Self> {
        let scene = scene::read(scene)?;
        let default = Settings::default();
        let settings = Settings {
            size: [
                width.map_or(Ok(default.size[0]), |n| count("width", n))?,
                height.map_or(Ok(default.size[1]), |n| count("height", n))?,
            ],
            azimuth: azimuth.map(|x| number("azimuth", Some(x), 0.0)).transpose()?,
            elevation: number("elevation", elevation, default.elevation)?,
            distance: distance.map(|x| number("distance", Some(x), 0.0)).transpose()?,
            floor: floor.map(|x| number("floor", Some(x), 0.0)).transpose()?,
        };
        let facets = facets(&scene, py)?;
        let inner = detached(py, || render::Renderer::new(&scene, &settings, &facets))?.or_raise()?;
        Ok(Self { inner, scene, settings, facets })
    }

    /// int: pixels along.
    #[getter]
    fn width(&self) -> usize {
        self.inner.size()[0]
    }

    /// int: pixels down.
    #[getter]
    fn height(&self) -> usize {
        self.inner.size()[1]
    }

    /// float: distance of the camera, m.
    #[getter]
    fn distance(&self) -> f64 {
        self.inner.distance()
    }

    /// float: azimuth of the camera, rad.
    #[getter]
    fn azimuth(&self) -> f64 {
        self.inner.azimuth()
    }

    /// float: height of the floor, m.
    #[getter]
    fn floor(&self) -> f64 {
        self.inner.floor()
    }

    /// float: width of the cells of the floor's grid, m.
    #[getter]
    fn cell(&self) -> f64 {
        self.inner.cell()
    }

    /// numpy.ndarray (2, 3): centre and edges, m, of the box about the vehicle's body, in the vehicle frame.
    #[getter]
    fn bounding_box<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let (envelope, ..) = hull(&self.scene, &self.facets);
        let size = envelope.half * 2.0;
        array(py, &[2, 3], envelope.middle.iter().chain(&size).copied().map(f64::from).collect())
    }

    /// list of tuple: spheres of contact on the robot, in the order of the scene: number of the moving body, 0 for the vehicle (see
    /// `Simulator.body_poses`), centre in its frame (x, y, z), m, and radius, m.
    #[getter]
    fn spheres(&self) -> Vec<(usize, [f64; 3], f64)> {
        let spheres = Spheres::new(&self.scene).in_bodies(&self.scene);
        spheres.into_iter().map(|BodySphere { body, center, radius }| (body, center.into(), radius)).collect()
    }

    /// Triangle meshes of the moving bodies, of the shapes in the world and of a dock, as `draw` draws them with joints at home.
    ///
    /// Returns
    /// -------
    /// dict of str to tuple
    ///     `vehicle` with its thrusters, `link 1` and so on, each in its body's frame (see `Simulator.body_poses`); `fixture 1` and
    ///     so on in the fixtures' frames, without vertices where no shape is on the fixture; `world`, if a shape other than the
    ///     floor is in the world; and `dock` in the frame of the docked vehicle. Each is a tuple of arrays: vertices, m, normals
    ///     and colours, red, green, blue, 0 to 1, (n, 3) each, float32, and triangles, (m, 3), uint32: numbers of vertices,
    ///     counterclockwise as seen from outside.
    fn meshes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let meshes = PyDict::new(py);
        for (name, mesh) in render::bodies(&self.scene, &self.facets, self.inner.cell()) {
            let rows = |row: fn(&Vertex) -> [f32; 3]| {
                matrix(py, mesh.vertices.iter().flat_map(row).collect(), mesh.vertices.len())
            };
            let (vertices, normals) = (rows(|v| v.position.into())?, rows(|v| v.normal.into())?);
            let colours = rows(|v| v.paint.colour.map(display))?;
            let triangles = matrix(py, mesh.triangles.concat(), mesh.triangles.len())?;
            meshes.set_item(name, (vertices, normals, colours, triangles))?;
        }
        Ok(meshes)
    }

    /// Draw the scene in a state.
    ///
    /// The camera points at the target, or at the vehicle without one, so that the vehicle stays in the picture. It moves
    /// back until `point`, `dock` and near shapes of contact are in the picture, unless the renderer has a `distance`. The GIL is released.
    ///
    /// Parameters
    /// ----------
    /// position : array_like (3,)
    ///     Vehicle origin in the world, m.
    /// rotation : array_like (3, 3)
    ///     Body to world.
    /// q : array_like (n,)
    ///     Coordinates of joints, then of fixtures, rad or m; home where None.
    /// thrust : array_like (m,)
    ///     Thrust per thruster, N: drawn as jets, whose length and colour go with the share of the limit.
    /// target : (array_like (3,), array_like (3, 3)) or array_like (4, 4)
    ///     Pose that the vehicle is to have: brackets.
    /// path : array_like (k, 3)
    ///     Points that the end effector is to pass, in the world, m.
    /// point : as target
    ///     Pose that the end effector is to have now: axes, x red, y green, z blue.
    /// dock : as target
    ///     Pose that the vehicle is to have in a dock, which is drawn about it.
    /// trail : array_like (k, 3)
    ///     Points where the end effector was, in the world, m.
    /// current : array_like (3,)
    ///     Velocity of the water in the world, m/s: drifting motes.
    /// payload : float
    ///     Mass at the end effector in addition to the scene's payload, kg.
    /// time : float
    ///     Time, s: motes and the light on the floor go by it.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (height, width, 3), uint8
    ///     Red, green, blue, by rows from the top; a fresh array.
    ///
    /// Raises
    /// ------
    /// ValueError, TypeError
    ///     An argument has another shape, or is no array of real numbers.
    #[pyo3(
        signature = (position, rotation, q=None, *, thrust=None, target=None, path=None, point=None, dock=None, trail=None, current=None, payload=None, time=None),
        text_signature = "($self, position, rotation, q=None, *, thrust=None, target=None, path=None, point=None, dock=None, trail=None, current=None, payload=0.0, time=0.0)"
    )]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn draw<'py>(
        &self,
        py: Python<'py>,
        position: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
        q: Given<'_, 'py>,
        thrust: Given<'_, 'py>,
        target: Given<'_, 'py>,
        path: Given<'_, 'py>,
        point: Given<'_, 'py>,
        dock: Given<'_, 'py>,
        trail: Given<'_, 'py>,
        current: Given<'_, 'py>,
        payload: Given<'_, 'py>,
        time: Given<'_, 'py>,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let optional = |name: &str, given: Given, width: usize| {
            given.map_or_else(|| Ok(Vec::new()), |given| rows(name, given, 1, &[width]))
        };
        let (position, rotation) = vehicle(position, rotation)?;
        let q = optional("q", q, self.inner.joints())?;
        let thrust = optional("thrust", thrust, self.inner.thrusters())?;
        let (path, trail) = (points("path", path)?, points("trail", trail)?);
        let current = current.map(|given| rows("current", given, 1, &[3])).transpose()?;
        let shot = RenderState {
            position,
            rotation,
            q: &q,
            thrust: &thrust,
            target: target.map(|given| pose("target", given)).transpose()?,
            path: &path,
            point: point.map(|given| pose("point", given)).transpose()?,
            dock: dock.map(|given| pose("dock", given)).transpose()?,
            trail: &trail,
            current: current.map_or_else(Vector3::zeros, |c| Vector3::from_column_slice(&c)),
            payload: number("payload", payload, 0.0)?,
            time: number("time", time, 0.0)?,
        };
        let picture = detached(py, || self.inner.draw(&shot))?;
        let picture = Array3::from_shape_vec((self.height(), self.width(), 3), picture);
        Ok(picture.map_err(|e| PyValueError::new_err(e.to_string()))?.into_pyarray(py))
    }

    /// Where points of the world are in the picture that `draw` makes of the same pose, target, reference and dock.
    ///
    /// Returns
    /// -------
    /// numpy.ndarray (k, 3)
    ///     Pixels from the left and from the top (the middle of the first is 0.5), and the distance ahead of the camera, m.
    ///     NaN for what is behind the camera.
    #[pyo3(signature = (points, position, rotation, *, target=None, point=None, dock=None))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn project<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = given_points)] points: Vec<Vector3<f64>>,
        position: &Bound<'py, PyAny>,
        rotation: &Bound<'py, PyAny>,
        target: Given<'_, 'py>,
        point: Given<'_, 'py>,
        dock: Given<'_, 'py>,
    ) -> PyResult<Array<'py>> {
        let (position, rotation) = vehicle(position, rotation)?;
        let given = |name: &str, given: Given<'_, 'py>| given.map(|given| pose(name, given)).transpose();
        let (target, point, dock) = (given("target", target)?, given("point", point)?, given("dock", dock)?);
        let shot = RenderState { position, rotation, target, point, dock, ..RenderState::default() };
        let pixels = points.iter().flat_map(|p| self.inner.project(&shot, p).unwrap_or([f64::NAN; 3]));
        array(py, &[points.len(), 3], pixels.collect())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((Bound<'py, PyAny>,), Bound<'py, PyDict>)> {
        let Settings { size: [width, height], azimuth, elevation, distance, floor } = self.settings;
        let options = dict! { py;
            "width": width, "height": height, "azimuth": azimuth,
            "elevation": elevation, "distance": distance, "floor": floor,
        };
        Ok(((scene::to_python(&self.scene, py)?,), options))
    }
}

/// Triangles of the scene's mesh files that can be read.
fn facets(scene: &Scene, py: Python<'_>) -> PyResult<Facets> {
    if scene.mesh_files().all(|(_, files)| files.is_empty()) {
        return Ok(Facets::new());
    }
    let reader = py.import("uvms_gym._importing.meshes")?;
    let read = reader.call_method1("facets", (scene::to_python(scene, py)?,))?;
    let facet = |row: &[f32]| {
        let corners = [0, 3, 6].map(|k| Vector::new(row[k], row[k + 1], row[k + 2]));
        Facet { corners, colour: (!row[9].is_nan()).then(|| [row[9], row[10], row[11]]) }
    };
    let list =
        |numbers: &PyReadonlyArray2<'_, f32>| numbers.as_slice().map(|n| n.chunks_exact(12).map(facet).collect());
    let read: HashMap<String, PyReadonlyArray2<'_, f32>> = read.extract()?;
    Ok(read
        .into_iter()
        .map(|(file, numbers)| Ok((file, list(&numbers)?)))
        .collect::<Result<_, numpy::AsSliceError>>()?)
}

fn vehicle(position: &Bound<'_, PyAny>, rotation: &Bound<'_, PyAny>) -> PyResult<PositionAndRotation> {
    let (position, rotation) = (rows("position", position, 1, &[3])?, rows("rotation", rotation, 1, &[3, 3])?);
    Ok((Vector3::from_column_slice(&position), Matrix3::from_row_slice(&rotation)))
}

fn pose(name: &str, given: &Bound<'_, PyAny>) -> PyResult<PositionAndRotation> {
    let numbers = poses(name, given, 1)?;
    Ok((Vector3::from_column_slice(&numbers[..3]), Matrix3::from_row_slice(&numbers[3..])))
}

fn points(name: &str, given: Given) -> PyResult<Vec<Vector3<f64>>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    let (shape, numbers) = read(name, given)?;
    if !matches!(shape[..], [_, 3]) {
        return Err(wrong_shape(name, &shape, "(k, 3)"));
    }
    Ok(numbers.chunks_exact(3).map(Vector3::from_column_slice).collect())
}

fn given_points(given: &Bound<'_, PyAny>) -> PyResult<Vec<Vector3<f64>>> {
    points("points", Some(given))
}
