//! Rasteriser: triangles to samples to pixels.
//!
//! Corners are rounded to a grid of 1/16 pixel, and coverage is decided in integers with the top-left rule: each sample on the
//! common edge of two triangles belongs to exactly one of them.

use std::ops::{AddAssign, BitOr};

use super::Vector;
use super::camera::Camera;

/// Samples per pixel.
const SAMPLES: usize = 4;
/// Steps of the grid per pixel.
const GRID: i64 = 16;
/// Sample positions in a pixel, in grid steps from its corner.
const OFFSETS: [[i64; 2]; SAMPLES] = [[6, 2], [14, 6], [2, 10], [10, 14]];
/// Distance beyond the picture at which triangles are clipped, pixels.
const MARGIN: f32 = 2048.0;

/// A shaded corner in camera coordinates.
#[derive(Debug, Clone, Copy)]
pub struct Corner {
    /// Right, up and depth, m.
    pub view: Vector,
    /// Gamma-encoded red, green and blue, and opacity, 0 to 1.
    pub colour: [f32; 4],
}

/// A corner in screen coordinates.
#[derive(Debug, Clone, Copy)]
struct ScreenCorner {
    x: i64,
    y: i64,
    /// Inverse depth, 1/m.
    nearness: f32,
    colour: [f32; 4],
}

/// Frame buffer.
#[derive(Debug, Default)]
pub struct Canvas {
    width: usize,
    height: usize,
    /// Inverse depth, 1/m; 0 for the background.
    nearness: Vec<[f32; SAMPLES]>,
    colours: Vec<[u32; SAMPLES]>,
}

/// Maps 0 to 1 to 0 to 255, by the last bits of a number with unit spacing.
#[inline]
pub fn byte(x: f32) -> u32 {
    (x * 255.0 + 8_388_608.0).to_bits() & 255
}

/// Packs the colour of a sample, 0 to 1.
#[inline]
pub fn pack([r, g, b]: [f32; 3]) -> u32 {
    byte(r) | (byte(g) << 8) | (byte(b) << 16)
}

/// One channel of a packed colour, 0 to 1.
#[inline]
fn unpack(colour: u32, channel: usize) -> f32 {
    ((colour >> (8 * channel)) & 255) as f32 * (1.0 / 255.0)
}

impl Canvas {
    /// Sets the size and clears the depth. Every row must be written by [`Self::row`] next.
    pub fn clear(&mut self, [width, height]: [usize; 2]) {
        (self.width, self.height) = (width, height);
        self.nearness.clear();
        self.nearness.resize(width * height, [0.0; SAMPLES]);
        self.colours.resize(width * height, [0; SAMPLES]);
    }

    /// Pixels of a row.
    pub fn row(&mut self, y: usize) -> &mut [[u32; SAMPLES]] {
        &mut self.colours[y * self.width..(y + 1) * self.width]
    }

    /// Sets the depth of a row, by the inverse depth, 1/m, at a distance from the top of the picture, pixels.
    pub fn set_nearness(&mut self, y: usize, nearness: impl Fn(f32) -> f32) {
        let samples = OFFSETS.map(|[_, down]| nearness(y as f32 + down as f32 / GRID as f32));
        self.nearness[y * self.width..(y + 1) * self.width].fill(samples);
    }

    /// Averages the samples: red, green, blue by rows.
    pub fn resolve(&self) -> Vec<u8> {
        let mut out = vec![0; 3 * self.colours.len()];
        for k in 0..self.colours.len() {
            let (pixel, samples) = (&mut out[3 * k..][..3], &self.colours[k]);
            // Two channels at a time: sums of four bytes do not overlap.
            let (mut red_blue, mut green) = (0, 0);
            for sample in samples {
                red_blue += sample & 0xFF00FF;
                green += sample & 0xFF00;
            }
            pixel[0] = (((red_blue + 2) >> 2) & 255) as u8;
            pixel[1] = (((green + 0x200) >> 10) & 255) as u8;
            pixel[2] = (((red_blue + 0x20000) >> 18) & 255) as u8;
        }
        out
    }

    /// Draws a triangle with counterclockwise corners; back faces are culled. Transparent triangles must be drawn last, from far to
    /// near.
    pub fn triangle(&mut self, camera: &Camera, corners: [&Corner; 3]) {
        if corners.iter().all(|c| self.is_safe(camera, &c.view)) {
            let pins = corners.map(|corner| self.to_screen(camera, corner));
            self.fill(pins);
            return;
        }
        let mut polygon: Vec<Corner> = corners.map(|c| *c).to_vec();
        let (wide, high) = ((camera.centre[0] + MARGIN) / camera.focal, (camera.centre[1] + MARGIN) / camera.focal);
        let planes = [
            [0.0, 0.0, 1.0, camera.near],
            [-1.0, 0.0, wide, 0.0],
            [1.0, 0.0, wide, 0.0],
            [0.0, -1.0, high, 0.0],
            [0.0, 1.0, high, 0.0],
        ];
        for plane in planes {
            polygon = cut(&polygon, plane);
            if polygon.len() < 3 {
                return;
            }
        }
        let pins: Vec<ScreenCorner> = polygon.iter().map(|corner| self.to_screen(camera, corner)).collect();
        for k in 2..pins.len() {
            self.fill([pins[0], pins[k - 1], pins[k]]);
        }
    }

    /// True if a corner has positive depth and lies on or near the screen.
    fn is_safe(&self, camera: &Camera, view: &Vector) -> bool {
        let [x, y] = [view.x.abs(), view.y.abs()];
        view.z >= camera.near
            && x * camera.focal <= view.z * (camera.centre[0] + MARGIN)
            && y * camera.focal <= view.z * (camera.centre[1] + MARGIN)
    }

    fn to_screen(&self, camera: &Camera, corner: &Corner) -> ScreenCorner {
        let [x, y] = camera.project(&corner.view);
        // Positive, so that truncation rounds down.
        const MOST: i64 = 1 << 20;
        let grid = |t: f32| ((f64::from(t) * GRID as f64 + (MOST as f64 + 0.5)) as i64).clamp(0, 2 * MOST) - MOST;
        ScreenCorner { x: grid(x), y: grid(y), nearness: 1.0 / corner.view.z, colour: corner.colour }
    }

    fn fill(&mut self, [a, b, c]: [ScreenCorner; 3]) {
        // Counterclockwise is clockwise where y points down.
        let [b, c] = [c, b];
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area <= 0 {
            return;
        }
        let bound = |of: fn(&ScreenCorner) -> i64, size: usize| {
            let (minimum, most) = (of(&a).min(of(&b)).min(of(&c)), of(&a).max(of(&b)).max(of(&c)));
            (minimum.div_euclid(GRID).max(0), (most.div_euclid(GRID) + 1).min(size as i64))
        };
        let ((left, right), (top, bottom)) = (bound(|p| p.x, self.width), bound(|p| p.y, self.height));
        if left >= right || top >= bottom {
            return;
        }
        // Edge function from p to q: at least 0 inside.
        let edge = |p: &ScreenCorner, q: &ScreenCorner| {
            let (dx, dy) = (q.x - p.x, q.y - p.y);
            let ours = dy < 0 || (dy == 0 && dx > 0);
            let at = dx * (top * GRID - p.y) - dy * (left * GRID - p.x) - i64::from(!ours);
            Edge { samples: OFFSETS.map(|[x, y]| at + dx * y - dy * x), along: -dy * GRID, down: dx * GRID }
        };
        let edges = [edge(&a, &b), edge(&b, &c), edge(&c, &a)];
        let area = Area { columns: [left, right], rows: [top, bottom], from: [a.x, a.y] };
        let shading = Shading::new(&a, &b, &c);
        // Within 1000 pixels, no product of differences exceeds 2^29.
        let small = [&a, &b, &c].iter().all(|p| {
            let (x, y) = (p.x - left * GRID, p.y - top * GRID);
            x.abs().max(y.abs()) < 1000 * GRID
        }) && (right - left).max(bottom - top) < 1000;
        if small {
            self.scan(&area, &edges, |x| x as i32, &shading);
        } else {
            self.scan(&area, &edges, |x| x, &shading);
        }
    }

    /// Draws the samples of an area where all three edge functions are at least 0, computed in the integer type to which `narrow`
    /// converts.
    fn scan<T>(&mut self, area: &Area, edges: &[Edge; 3], narrow: impl Fn(i64) -> T, shading: &Shading)
    where
        T: Copy + AddAssign + BitOr<Output = T> + PartialOrd,
    {
        let Area { columns: [left, right], rows: [top, bottom], from } = *area;
        let Shading { nearness: [n0, nx, ny], spread, .. } = *shading;
        let (zero, along) = (narrow(0), edges.each_ref().map(|edge| narrow(edge.along)));
        for y in top..bottom {
            let [mut first, mut end] = [left, right];
            if right - left > 8 {
                for edge in edges {
                    edge.narrow(y - top, left, &mut first, &mut end);
                }
            }
            let fy = (y * GRID - from[1]) as f32;
            let skipped = first - left;
            let mut at = edges.each_ref().map(|edge| {
                let gain = edge.down * (y - top) + edge.along * skipped;
                edge.samples.map(|sample| narrow(sample + gain))
            });
            let row = y as usize * self.width;
            for x in first..end {
                let (mut outside, mut any) = ([zero; SAMPLES], false);
                for s in 0..SAMPLES {
                    outside[s] = at[0][s] | at[1][s] | at[2][s];
                    any |= outside[s] >= zero;
                    for i in 0..3 {
                        at[i][s] += along[i];
                    }
                }
                if !any {
                    continue;
                }
                let fx = (x * GRID - from[0]) as f32;
                let nearness = n0 + nx * fx + ny * fy;
                let pixel = row + x as usize;
                let depths = &mut self.nearness[pixel];
                let (mut seen, mut any) = ([false; SAMPLES], false);
                for s in 0..SAMPLES {
                    seen[s] = outside[s] >= zero && nearness + spread[s] > depths[s];
                    any |= seen[s];
                }
                if !any {
                    continue;
                }
                let [r, g, b, alpha] = shading.colour(fx, fy);
                let colours = &mut self.colours[pixel];
                if shading.opaque {
                    let packed = pack([r, g, b]);
                    for s in 0..SAMPLES {
                        if seen[s] {
                            depths[s] = nearness + spread[s];
                            colours[s] = packed;
                        }
                    }
                } else {
                    let over = [r, g, b];
                    for s in 0..SAMPLES {
                        if seen[s] {
                            let mut mixed = [0.0; 3];
                            for k in 0..3 {
                                let under = unpack(colours[s], k);
                                mixed[k] = under + (over[k] - under) * alpha;
                            }
                            colours[s] = pack(mixed);
                        }
                    }
                }
            }
        }
    }

    /// Covered samples of each pixel.
    pub fn coverage(&self) -> Vec<usize> {
        self.nearness.iter().map(|n| n.iter().filter(|n| **n > 0.0).count()).collect()
    }

    /// Samples of a pixel.
    pub fn samples(&self, x: usize, y: usize) -> [u32; SAMPLES] {
        self.colours[y * self.width + x]
    }
}

/// Pixels that a triangle may cover, and the origin of its edge functions, in grid steps.
struct Area {
    columns: [i64; 2],
    rows: [i64; 2],
    from: [i64; 2],
}

/// Edge function of a triangle: at least 0 on the inner side.
struct Edge {
    /// Values at the samples of the first pixel.
    samples: [i64; SAMPLES],
    /// Increments per pixel, along and down.
    along: i64,
    down: i64,
}

impl Edge {
    /// Narrows the columns `first..end` of a row to those that can have samples inside; columns count from `left`.
    fn narrow(&self, row: i64, left: i64, first: &mut i64, end: &mut i64) {
        let [a, b, c, d] = self.samples;
        let most = a.max(b).max(c).max(d) + self.down * row;
        match self.along {
            0 if most < 0 => *end = *first,
            0 => {}
            along if along > 0 => *first = (*first).max(left + (-most).max(0).div_euclid(along)),
            along => *end = (*end).min(left + if most < 0 { 0 } else { most / -along + 1 }),
        }
    }
}

/// Linear interpolation over a triangle: value at the first corner, and gradient along and down per grid step.
struct Shading {
    nearness: [f32; 3],
    /// Offsets of the samples relative to the corner of the pixel.
    spread: [f32; SAMPLES],
    colour: [[f32; 3]; 4],
    /// Minimum and maximum value at the corners.
    range: [[f32; 2]; 4],
    opaque: bool,
}

impl Shading {
    fn new(a: &ScreenCorner, b: &ScreenCorner, c: &ScreenCorner) -> Self {
        let (bx, by, cx, cy) = ((b.x - a.x) as f32, (b.y - a.y) as f32, (c.x - a.x) as f32, (c.y - a.y) as f32);
        let inverse = 1.0 / (bx * cy - by * cx);
        let plane = |a: f32, b: f32, c: f32| {
            let (b, c) = (b - a, c - a);
            [a, (b * cy - c * by) * inverse, (c * bx - b * cx) * inverse]
        };
        let nearness = plane(a.nearness, b.nearness, c.nearness);
        let [_, nx, ny] = nearness;
        let of = |k: usize| [a.colour[k], b.colour[k], c.colour[k]];
        let range = [0, 1, 2, 3].map(|k| {
            let [x, y, z] = of(k);
            [x.min(y).min(z), x.max(y).max(z)]
        });
        Self {
            nearness,
            spread: OFFSETS.map(|[x, y]| nx * x as f32 + ny * y as f32),
            colour: [0, 1, 2, 3].map(|k| {
                let [x, y, z] = of(k);
                plane(x, y, z)
            }),
            range,
            opaque: range[3][0] >= 1.0,
        }
    }

    /// Colour at the centre of a pixel, clamped to the range of the corners.
    #[inline]
    fn colour(&self, x: f32, y: f32) -> [f32; 4] {
        let (x, y) = (x + 0.5 * GRID as f32, y + 0.5 * GRID as f32);
        let mut colour = [0.0; 4];
        for k in 0..4 {
            let ([at, along, down], [minimum, most]) = (self.colour[k], self.range[k]);
            colour[k] = (at + along * x + down * y).max(minimum).min(most);
        }
        colour
    }
}

/// Clips a polygon to `n . view >= d`. The common edge of two polygons is cut at the same point.
fn cut(polygon: &[Corner], [x, y, z, d]: [f32; 4]) -> Vec<Corner> {
    let height = |c: &Corner| x * c.view.x + y * c.view.y + z * c.view.z - d;
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, from) in polygon.iter().enumerate() {
        let to = &polygon[(i + 1) % polygon.len()];
        let (h, g) = (height(from), height(to));
        if h >= 0.0 {
            kept.push(*from);
        }
        if (h >= 0.0) != (g >= 0.0) {
            // From the inner to the outer end, in either orientation of the polygon.
            let (inner, outer, share) = if h >= 0.0 { (from, to, h / (h - g)) } else { (to, from, g / (g - h)) };
            kept.push(Corner {
                view: inner.view + (outer.view - inner.view) * share,
                colour: std::array::from_fn(|k| inner.colour[k] + (outer.colour[k] - inner.colour[k]) * share),
            });
        }
    }
    kept
}
