//! What is behind everything: the water and the floor with its grid.

use super::camera::Camera;
use super::paint::{Water, display};
use super::raster::{Canvas, pack};
use super::shadow::Shadow;
use crate::lane::sin_cos;

/// Texels along each side of the pattern of light.
const SIDE: usize = 64;
/// Half the width of the grid's lines, in cells.
const LINE: f32 = 0.012;

/// The pattern that waves throw on the floor: a tile of relative brightness, mean 0.
#[derive(Debug)]
pub struct Caustics(Vec<f32>);

impl Caustics {
    /// The pattern.
    pub fn new() -> Self {
        let wave = |turns: f64| sin_cos(std::f64::consts::TAU * turns).0;
        let web = |u: f64, v: f64| {
            let (x, y) =
                (u + 0.11 * wave(v + 0.3) + 0.04 * wave(2.0 * v - u), v + 0.12 * wave(u) + 0.04 * wave(u + 2.0 * v));
            let ridge = |turns: f64| 1.0 - wave(turns).abs();
            let a = ridge(x + 0.5 * wave(y) * 0.2);
            let b = ridge(y + 0.15 * wave(x + y));
            let c = ridge(x - y + 0.1 * wave(2.0 * x));
            (a * b).max(b * c).max(a * c)
        };
        let at = |i: usize| i as f64 / SIDE as f64;
        let tile: Vec<f64> = (0..SIDE * SIDE).map(|k| web(at(k % SIDE), at(k / SIDE))).collect();
        let mean = tile.iter().sum::<f64>() / tile.len() as f64;
        Self(tile.iter().map(|x| (x - mean) as f32).collect())
    }

    fn at(&self, u: f32, v: f32) -> f32 {
        // Positive, so that cutting off is rounding down.
        let (x, y) = ((u + 512.0) * SIDE as f32, (v + 512.0) * SIDE as f32);
        let (i, k) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - k as f32);
        let row = |k: usize| {
            let line = &self.0[k % SIDE * SIDE..][..SIDE];
            let (a, b) = (line[i % SIDE], line[(i + 1) % SIDE]);
            a + (b - a) * fx
        };
        let (near, far) = (row(k), row(k + 1));
        near + (far - near) * fy
    }
}

/// The floor, in coordinates about what the camera looks at.
#[derive(Debug)]
pub struct Floor<'a> {
    /// Its height.
    pub height: f32,
    /// Where its grid has a crossing, x and y.
    pub origin: [f32; 2],
    /// Width of the grid's cells, m.
    pub cell: f32,
    /// The shadow on it.
    pub shadow: &'a Shadow,
    /// The light on it.
    pub caustics: &'a Caustics,
    /// How far that has moved, in tiles.
    pub drift: f32,
}

/// Nearest integer, for less than four million.
fn round(x: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    (x + SHIFT) - SHIFT
}

/// Paints every pixel.
pub fn paint(canvas: &mut Canvas, [width, height]: [usize; 2], camera: &Camera, water: &Water, floor: &Floor<'_>) {
    let [right, up, ahead] = &camera.axes;
    let above = camera.eye.z - floor.height;
    // The horizon is level: all pixels of a row look down as steeply.
    let slope = |y: f32| ahead.z + up.z * (camera.centre[1] - y) / camera.focal;
    for row in 0..height {
        let y = row as f32 + 0.5;
        let down = -slope(y);
        let stretch = (1.0 + ((camera.centre[1] - y) / camera.focal).powi(2)).sqrt();
        let behind = water.colour(-down / stretch);
        let pixels = canvas.row(row);
        let away = above / down;
        let through = if down > 1e-4 && above > 0.0 { water.transmission(away * stretch) } else { [0.0; 3] };
        if through.iter().all(|t| *t < 2e-3) {
            pixels.fill([pack(behind.map(display)); 4]);
            continue;
        }
        let next = above / (-slope(y - 1.0)).max(1e-4);
        let scale = 1.0 / floor.cell;
        let ray = |axis: usize, x: f32| {
            let aside = (x - camera.centre[0]) / camera.focal;
            ahead[axis] + up[axis] * (camera.centre[1] - y) / camera.focal + right[axis] * aside
        };
        let light = water.light(&super::Vector::z());
        let unlit: [f32; 3] = std::array::from_fn(|k| water.floor[k] * through[k]);
        for (x, pixel) in pixels.iter_mut().enumerate().take(width) {
            let x = x as f32 + 0.5;
            let mut line = 0.0_f32;
            let mut blur = 0.0_f32;
            let mut place = [0.0; 2];
            for axis in 0..2 {
                let direction = ray(axis, x);
                place[axis] = camera.eye[axis] + away * direction;
                let u = (place[axis] - floor.origin[axis]) * scale;
                // Width of the pixel on the floor, in cells.
                let across = away * right[axis] / camera.focal;
                let along = (next - away) * direction;
                let wide = (across.abs() + along.abs()) * scale;
                let off = (u - round(u)).abs();
                let inside = ((LINE + 0.5 * wide - off) / wide.max(2.0 * LINE)).clamp(0.0, 1.0);
                line = line.max(inside);
                blur = blur.max(wide);
            }
            let dark = 1.0 - 0.85 * floor.shadow.at(place);
            let pattern = if water.caustics > 0.0 {
                let tile = 0.55 * scale;
                let u = (place[0] - floor.origin[0]) * tile + floor.drift;
                let v = (place[1] - floor.origin[1]) * tile - 0.7 * floor.drift;
                let sharp = (1.0 - 2.0 * blur).max(0.0);
                1.0 + water.caustics * sharp * floor.caustics.at(u, v)
            } else {
                1.0
            };
            let lines = 1.0 - 0.42 * line;
            let colour: [f32; 3] = std::array::from_fn(|k| {
                let lit = unlit[k] * lines * (light[k] * dark * pattern);
                display(lit + behind[k] * (1.0 - through[k]))
            });
            *pixel = [pack(colour); 4];
        }
    }
}
