//! Background: the water and the floor with its grid.

use super::camera::Camera;
use super::paint::{Water, display};
use super::raster::{Canvas, byte, pack};
use super::shadow::Shadow;
use crate::lane::sin_cos;

/// Texels per side of the caustics.
const SIDE: usize = 64;
/// Half the width of the grid's lines, in cells.
const LINE: f32 = 0.012;

/// Caustics on the floor: a tile of relative brightness, of mean 0.
#[derive(Debug)]
pub struct Caustics(Box<[f32; SIDE * SIDE]>);

impl Caustics {
    /// Computes the tile.
    pub fn new() -> Self {
        let wave = |turns: f64| sin_cos(std::f64::consts::TAU * turns).0;
        let web = |u: f64, v: f64| {
            let x = u + 0.11 * wave(v + 0.3) + 0.04 * wave(2.0 * v - u);
            let y = v + 0.12 * wave(u) + 0.04 * wave(u + 2.0 * v);
            let ridge = |turns: f64| 1.0 - wave(turns).abs();
            let (a, b, c) =
                (ridge(x + 0.1 * wave(y)), ridge(y + 0.15 * wave(x + y)), ridge(x - y + 0.1 * wave(2.0 * x)));
            (a * b).max(b * c).max(a * c)
        };
        let at = |i: usize| i as f64 / SIDE as f64;
        let mut tile = Box::new([0.0; SIDE * SIDE]);
        for (k, texel) in tile.iter_mut().enumerate() {
            *texel = web(at(k % SIDE), at(k / SIDE)) as f32;
        }
        let mean = tile.iter().sum::<f32>() / tile.len() as f32;
        tile.iter_mut().for_each(|texel| *texel -= mean);
        Self(tile)
    }

    /// Brightness at a position in units of tiles, below 512.
    #[inline]
    fn at(&self, u: f32, v: f32) -> f32 {
        // Positive, so that truncation rounds down.
        let (x, y) = ((u + 512.0) * SIDE as f32, (v + 512.0) * SIDE as f32);
        let (i, k) = (x as i32, y as i32);
        let (fx, fy) = (x - i as f32, y - k as f32);
        let texel = |i: i32, k: i32| self.0[(k as usize % SIDE) * SIDE + i as usize % SIDE];
        let row = |k: i32| {
            let (a, b) = (texel(i, k), texel(i.wrapping_add(1), k));
            a + (b - a) * fx
        };
        let (near, far) = (row(k), row(k.wrapping_add(1)));
        near + (far - near) * fy
    }
}

/// The floor, in coordinates about the focus of the camera.
#[derive(Debug)]
pub struct Floor<'a> {
    /// Height, m.
    pub height: f32,
    /// True if it hides what is below.
    pub solid: bool,
    /// Position of a crossing of the grid, x and y, m.
    pub origin: [f32; 2],
    /// Cell width of the grid, m.
    pub cell: f32,
    /// Shadow of the robot on the floor.
    pub shadow: &'a Shadow,
    /// Pattern of refracted light on the floor.
    pub caustics: &'a Caustics,
    /// Displacement of the caustics, tiles.
    pub drift: f32,
}

/// Nearest integer, for magnitudes below four million.
fn round(x: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    (x + SHIFT) - SHIFT
}

/// Pixels per run; each operation is done for all of them.
const RUN: usize = 32;

/// A row of pixels on the floor.
struct Row {
    /// Ray of the pixel at `x = 0`, and its change along the row: x and y per unit of depth.
    ray: [[f32; 2]; 2],
    /// Depth of the floor in this row, and midway to the next row above.
    away: f32,
    deeper: f32,
    /// Transmitted light of the floor, and light of the water in front of it; linear.
    floor: [f32; 3],
    water: [f32; 3],
}

/// Paints every pixel.
pub fn paint(canvas: &mut Canvas, [width, height]: [usize; 2], camera: &Camera, water: &Water, floor: &Floor<'_>) {
    let [right, up, ahead] = &camera.axes;
    let above = camera.eye.z - floor.height;
    let light = water.light(&super::Vector::z());
    for y in 0..height {
        let rise = (camera.centre[1] - y as f32 - 0.5) / camera.focal;
        // The horizon is level: all pixels of a row have the same elevation.
        let down = |rise: f32| -(ahead.z + up.z * rise);
        let stretch = (1.0 + rise * rise).sqrt();
        let behind = water.colour(-down(rise) / stretch);
        let away = above / down(rise);
        let sees = down(rise) > 1e-4 && above > 0.0;
        let through = if sees { water.transmission(away * stretch) } else { [0.0; 3] };
        if sees && floor.solid {
            canvas.set_nearness(y, |y| down((camera.centre[1] - y) / camera.focal).max(0.0) / above);
        }
        let pixels = &mut canvas.row(y)[..width];
        if through.iter().all(|t| *t < 2e-3) {
            pixels.fill([pack(behind.map(display)); 4]);
            continue;
        }
        let start = -camera.centre[0] / camera.focal;
        let row = Row {
            ray: [0, 1].map(|k| [ahead[k] + up[k] * rise + right[k] * start, right[k] / camera.focal]),
            away,
            deeper: above / down(rise + 1.0 / camera.focal).max(1e-4) - away,
            floor: std::array::from_fn(|k| water.floor[k] * light[k] * through[k]),
            water: std::array::from_fn(|k| behind[k] * (1.0 - through[k])),
        };
        for (run, pixels) in pixels.chunks_mut(RUN).enumerate() {
            row.paint(camera, water.caustics, floor, run * RUN, pixels);
        }
    }
}

impl Row {
    /// Paints the pixels starting at `first`.
    fn paint(&self, camera: &Camera, strength: f32, floor: &Floor<'_>, first: usize, pixels: &mut [[u32; 4]]) {
        let scale = 1.0 / floor.cell;
        let (mut line, mut blur, mut place) = ([0.0_f32; RUN], [0.0_f32; RUN], [[0.0_f32; RUN]; 2]);
        for axis in 0..2 {
            let [start, step] = self.ray[axis];
            let (eye, origin) = (camera.eye[axis], floor.origin[axis]);
            let across = (self.away * step).abs();
            for i in 0..RUN {
                let ray = start + step * (0.5 + (first + i) as f32);
                let at = eye + self.away * ray;
                let u = (at - origin) * scale;
                // Width of the pixel on the floor, in cells.
                let wide = (across + (self.deeper * ray).abs()) * scale;
                let off = (u - round(u)).abs();
                let inside = ((LINE + 0.5 * wide - off) / wide.max(2.0 * LINE)).clamp(0.0, 1.0);
                line[i] = line[i].max(inside);
                blur[i] = blur[i].max(wide);
                place[axis][i] = at;
            }
        }
        let mut light = [0.0; RUN];
        for i in 0..RUN {
            light[i] = 1.0 - 0.4 * line[i];
        }
        if strength > 0.0 && blur[0].min(blur[RUN - 1]) < 0.4 {
            let tile = 0.55 * scale;
            for i in 0..RUN {
                let u = (place[0][i] - floor.origin[0]) * tile + floor.drift;
                let v = (place[1][i] - floor.origin[1]) * tile - 0.7 * floor.drift;
                let sharp = (1.0 - 2.5 * blur[i]).max(0.0);
                light[i] *= 1.0 + strength * sharp * floor.caustics.at(u, v);
            }
        }
        let at = |i: usize| [place[0][i], place[1][i]];
        if floor.shadow.reaches(at(0), at(RUN - 1)) {
            for (i, light) in light.iter_mut().enumerate() {
                *light *= 1.0 - 0.85 * floor.shadow.at(at(i));
            }
        }
        let mut packed = [0; RUN];
        for k in 0..3 {
            for i in 0..RUN {
                packed[i] |= byte(display(self.floor[k] * light[i] + self.water[k])) << (8 * k);
            }
        }
        for (pixel, packed) in pixels.iter_mut().zip(packed) {
            *pixel = [packed; 4];
        }
    }
}
