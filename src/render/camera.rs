//! Camera.

use super::Vector;
use crate::lane::sin_cos;

/// Tangent of half of the vertical field of view.
const SPREAD: f64 = 0.34;

/// A camera with a level horizon, at a distance from the origin and directed at it.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Position.
    pub eye: Vector,
    /// Unit vectors to the right, up and ahead.
    pub axes: [Vector; 3],
    /// Pixels per unit of slope.
    pub focal: f32,
    /// Centre of the picture, pixels.
    pub centre: [f32; 2],
    /// Minimum depth that is drawn, m.
    pub near: f32,
}

impl Camera {
    /// From azimuth and elevation of the camera relative to the origin, rad.
    pub fn new(azimuth: f64, elevation: f64, distance: f64, [width, height]: [usize; 2]) -> Self {
        let ((sa, ca), (se, ce)) = (sin_cos(azimuth), sin_cos(elevation));
        let vector = |x: f64, y: f64, z: f64| Vector::new(x as f32, y as f32, z as f32);
        Self {
            eye: vector(distance * ce * ca, distance * ce * sa, distance * se),
            axes: [vector(-sa, ca, 0.0), vector(-se * ca, -se * sa, ce), vector(-ce * ca, -ce * sa, -se)],
            focal: (height.min(width) as f64 / (2.0 * SPREAD)) as f32,
            centre: [0.5 * width as f32, 0.5 * height as f32],
            near: 0.02 * distance as f32,
        }
    }

    /// Distance at which a ball of this radius fills the picture.
    pub fn distance_of(radius: f64) -> f64 {
        radius * (1.0 + 1.0 / (SPREAD * SPREAD)).sqrt()
    }

    /// Camera coordinates of a point: right, up and depth, m.
    pub fn view(&self, point: &Vector) -> Vector {
        let d = point - self.eye;
        Vector::new(d.dot(&self.axes[0]), d.dot(&self.axes[1]), d.dot(&self.axes[2]))
    }

    /// Pixel of a point of positive depth.
    pub fn project(&self, view: &Vector) -> [f32; 2] {
        let scale = self.focal / view.z;
        [self.centre[0] + scale * view.x, self.centre[1] - scale * view.y]
    }
}
