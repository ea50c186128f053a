//! Camera of a picture, by what is in it.

use nalgebra::{Matrix3, Vector3};

use super::camera::Camera;
use super::hull::single;
use super::renderer::{FAR, RenderState, Renderer, Settings};

/// Maximum ratio of the radius of what the picture shows to the scene's radius.
const WIDEST: f64 = 24.0;

impl Renderer {
    /// Focus of the camera: the target if there is one, else the vehicle; limited to a distance that keeps the vehicle in the
    /// picture.
    fn focus(&self, state: &RenderState<'_>) -> Vector3<f64> {
        let place = |(p, r): (Vector3<f64>, Matrix3<f64>)| {
            let at = p + r * self.middle.map(f64::from);
            (at.iter().all(|x| x.abs() < FAR)).then_some(at)
        };
        let vehicle = place((state.position, state.rotation));
        match (state.target.and_then(place), vehicle) {
            (Some(target), Some(vehicle)) => {
                let (distance, most) = ((vehicle - target).norm(), 0.5 * f64::from(self.reach));
                if distance > most { vehicle + (target - vehicle) * (most / distance) } else { target }
            }
            (Some(at), None) | (None, Some(at)) => at,
            (None, None) => Vector3::zeros(),
        }
    }

    /// Camera, its focus, and the ratio of the radius of what it shows to the radius of the scene: vehicle, end effector's reference,
    /// dock and near shapes.
    pub(super) fn view(&self, state: &RenderState<'_>) -> (Camera, Vector3<f64>, f64) {
        let reach = f64::from(self.reach);
        let (mut focus, mut radius) = (self.focus(state), reach);
        let shapes = self.surroundings.near(&focus, reach);
        let mut include = |at: Vector3<f64>, own: f64| {
            let distance = (at - focus).norm();
            // Of two balls, the smallest one about both.
            let both = (0.5 * (radius + own + distance)).max(own).min(WIDEST * reach);
            if self.settings.distance.is_none() && both > radius {
                focus += (at - focus) * ((both - radius) / distance.max(1e-9)).min(1.0);
                radius = both;
            }
        };
        if let Some((at, _)) = state.point.filter(|(p, _)| p.iter().all(|x| x.abs() < FAR)) {
            include(at, 0.2 * reach);
        }
        if let Some((p, r)) = state.dock.filter(|(p, r)| p.iter().chain(r.iter()).all(|x| x.abs() < FAR)) {
            include(p + r * self.envelope.middle.map(f64::from), self.dock_reach);
        }
        shapes.into_iter().for_each(|(at, own)| include(at, own));
        let zoom = radius / reach;
        let Settings { elevation, size, .. } = self.settings;
        (Camera::new(self.azimuth, elevation, self.distance * zoom, size), focus, zoom)
    }

    /// Pixel (along, down) and depth, m, of a point of the world in the picture of `state`; None behind the camera.
    pub fn project(&self, state: &RenderState<'_>, point: &Vector3<f64>) -> Option<[f64; 3]> {
        let (camera, focus, _) = self.view(state);
        let view = camera.view(&single(&(point - focus)));
        let [x, y] = camera.project(&view);
        (view.z >= camera.near).then(|| [x, y, view.z].map(f64::from))
    }
}
