//! Triangle meshes and solids.

use super::Vector;
use super::paint::Paint;
use crate::lane::sin_cos;

/// Corner of triangles.
#[derive(Debug, Clone, Copy)]
pub struct Vertex {
    /// Position, m.
    pub position: Vector,
    /// Outward unit normal.
    pub normal: Vector,
    /// Material.
    pub paint: Paint,
}

/// Triangles with counterclockwise corners as seen from outside.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Corners, which triangles share.
    pub vertices: Vec<Vertex>,
    /// Indices of the three vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
}

/// Unit vectors perpendicular to `axis` and to each other: `e1 x e2 = axis`.
pub fn across(axis: &Vector) -> [Vector; 2] {
    let minimum = axis.iamin();
    let e1 = (Vector::ith(minimum, 1.0) - axis * axis[minimum]).normalize();
    [e1, axis.cross(&e1)]
}

/// Points of the unit circle.
fn circle(count: usize) -> Vec<[f32; 2]> {
    (0..count)
        .map(|k| {
            let (sin, cos) = sin_cos(std::f64::consts::TAU * k as f64 / count as f64);
            [cos as f32, sin as f32]
        })
        .collect()
}

impl Mesh {
    /// Lower and upper corner of the box around the vertices; none without any.
    pub fn bounds(&self) -> Option<[Vector; 2]> {
        let corners = self.vertices.iter().map(|vertex| [vertex.position; 2]);
        corners.reduce(|[lower, upper], [at, _]| [lower.inf(&at), upper.sup(&at)])
    }

    /// A flat convex polygon.
    pub fn polygon(&mut self, corners: &[Vector], paint: Paint) {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let normal = normal.try_normalize(1e-20).unwrap_or_else(Vector::z);
        let first = self.vertices.len() as u32;
        self.vertices.extend(corners.iter().map(|&position| Vertex { position, normal, paint }));
        for k in 2..corners.len() as u32 {
            self.triangles.push([first, first + k - 1, first + k]);
        }
    }

    /// A box with these half edges, a right-handed triple of vectors.
    pub fn slab(&mut self, middle: Vector, half: [Vector; 3], paint: Paint) {
        for k in 0..3 {
            let [n, u, v] = [half[k], half[(k + 1) % 3], half[(k + 2) % 3]];
            for (n, u) in [(n, u), (-n, -u)] {
                let at = |a: f32, b: f32| middle + n + u * a + v * b;
                self.polygon(&[at(-1.0, -1.0), at(1.0, -1.0), at(1.0, 1.0), at(-1.0, 1.0)], paint);
            }
        }
    }

    /// An axis-aligned box.
    pub fn cuboid(&mut self, middle: Vector, half: Vector, paint: Paint) {
        self.slab(middle, [Vector::x() * half.x, Vector::y() * half.y, Vector::z() * half.z], paint);
    }

    /// An axis-aligned box with edges chamfered by `cut`.
    pub fn chamfered(&mut self, middle: Vector, half: Vector, cut: f32, paint: Paint) {
        let inner = half.map(|h| (h - cut).max(0.0));
        let signs = [-1.0_f32, 1.0];
        // Corner on the face normal to axis k.
        let corner = |s: [f32; 3], k: usize| {
            let mut p = inner;
            p[k] = half[k];
            middle + Vector::new(s[0] * p.x, s[1] * p.y, s[2] * p.z)
        };
        for k in 0..3 {
            let (u, v) = ((k + 1) % 3, (k + 2) % 3);
            for s in signs {
                // Corner on the face normal to an axis, on the sides `a` and `b` of the other two.
                let at = |a: f32, b: f32, axis: usize| {
                    let mut signs = [s; 3];
                    (signs[u], signs[v]) = (a, b);
                    corner(signs, axis)
                };
                self.polygon(&[at(-s, -1.0, k), at(s, -1.0, k), at(s, 1.0, k), at(-s, 1.0, k)], paint);
                // Edge between this face and the face of the next axis.
                for t in signs {
                    let mut quad = [at(t, -1.0, k), at(t, -1.0, u), at(t, 1.0, u), at(t, 1.0, k)];
                    if s * t < 0.0 {
                        quad.reverse();
                    }
                    self.polygon(&quad, paint);
                }
            }
        }
        for bits in 0..8 {
            let s = [0, 1, 2].map(|k| signs[bits >> k & 1]);
            let mut tip = [0, 1, 2].map(|k| corner(s, k));
            if s[0] * s[1] * s[2] < 0.0 {
                tip.reverse();
            }
            self.polygon(&tip, paint);
        }
    }

    /// A beam with a square section of half width `half`.
    pub fn beam(&mut self, from: Vector, to: Vector, half: f32, paint: Paint) {
        let along = to - from;
        let length = along.norm();
        if length > 1e-9 {
            let axis = along / length;
            let [u, v] = across(&axis);
            self.slab((from + to) * 0.5, [along * 0.5, u * half, v * half], paint);
        }
    }

    /// A surface of revolution about the unit vector `axis`, with the profile (height, radius) from the bottom up; shaded smoothly
    /// if `smooth`.
    pub fn lathe(
        &mut self,
        origin: Vector,
        axis: Vector,
        profile: &[(f32, f32)],
        segments: usize,
        smooth: bool,
        paint: impl Fn(usize) -> Paint,
    ) {
        let [e1, e2] = across(&axis);
        let circle = circle(segments);
        let normals: Vec<(f32, f32)> = profile
            .windows(2)
            .map(|pair| {
                let (dz, dr) = (pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
                let length = dz.hypot(dr).max(1e-20);
                (-dr / length, dz / length)
            })
            .collect();
        let at = |i: usize, side: usize| {
            if !smooth {
                return normals[side];
            }
            let (before, after) = (normals[i.max(1) - 1], normals[i.min(normals.len() - 1)]);
            let (z, r) = (before.0 + after.0, before.1 + after.1);
            let length = z.hypot(r).max(1e-20);
            (z / length, r / length)
        };
        let n = segments as u32;
        for side in 0..normals.len() {
            let first = self.vertices.len() as u32;
            for i in [side, side + 1] {
                let ((height, radius), (nz, nr)) = (profile[i], at(i, side));
                let paint = paint(i);
                for [cos, sin] in &circle {
                    let out = e1 * *cos + e2 * *sin;
                    let position = origin + axis * height + out * radius;
                    self.vertices.push(Vertex { position, normal: axis * nz + out * nr, paint });
                }
            }
            for j in 0..n {
                let k = (j + 1) % n;
                let [a, b, c, d] = [first + j, first + k, first + n + k, first + n + j];
                if profile[side].1 > 0.0 {
                    self.triangles.push([a, b, c]);
                }
                if profile[side + 1].1 > 0.0 {
                    self.triangles.push([a, c, d]);
                }
            }
        }
    }

    /// Adds a cylinder with flat ends.
    pub fn cylinder(&mut self, from: Vector, to: Vector, radius: f32, segments: usize, paint: Paint) {
        let along = to - from;
        let length = along.norm();
        if length > 1e-9 {
            let profile = [(0.0, 0.0), (0.0, radius), (length, radius), (length, 0.0)];
            self.lathe(from, along / length, &profile, segments, false, |_| paint);
        }
    }

    /// A torus about the z axis and the origin: radius of its circle and of its tube.
    pub fn torus(&mut self, radius: f32, tube: f32, segments: usize, paint: Paint) {
        let section = circle(segments / 2);
        let mut profile: Vec<_> = section.iter().map(|[cos, sin]| (-tube * sin, radius - tube * cos)).collect();
        profile.push(profile[0]);
        self.lathe(Vector::zeros(), Vector::z(), &profile, segments, true, |_| paint);
    }

    /// A capsule between two points; a ball if they coincide.
    pub fn capsule(&mut self, from: Vector, to: Vector, radius: f32, segments: usize, paint: Paint) {
        let along = to - from;
        let length = along.norm();
        let axis = if length > 1e-9 { along / length } else { Vector::z() };
        let rings = segments / 4;
        let quarter = &circle(4 * rings)[..=rings];
        let bottom = quarter.iter().map(|[cos, sin]| (-radius * cos, radius * sin));
        let top = quarter.iter().rev().map(|[cos, sin]| (length + radius * cos, radius * sin));
        let mut profile: Vec<(f32, f32)> = bottom.chain(top).collect();
        // Closed exactly at the poles.
        profile[0].1 = 0.0;
        profile.last_mut().expect("two ends").1 = 0.0;
        self.lathe(from, axis, &profile, segments, true, |_| paint);
    }

    /// An axis-aligned ellipsoid; `paint` depends on the fraction of its length from -x to +x.
    pub fn ellipsoid(&mut self, middle: Vector, half: Vector, segments: usize, paint: impl Fn(f32) -> Paint) {
        let first = self.vertices.len();
        let rings = segments;
        let points = circle(2 * rings);
        let mut profile: Vec<(f32, f32)> = points[..=rings].iter().map(|[cos, sin]| (-cos, *sin)).collect();
        profile[0].1 = 0.0;
        profile[rings].1 = 0.0;
        let paint = |i: usize| paint(0.5 + 0.5 * profile[i].0);
        self.lathe(Vector::zeros(), Vector::x(), &profile, segments, true, paint);
        for vertex in &mut self.vertices[first..] {
            // The normal is the position on the unit ball, divided by the half axes.
            let on_ball = vertex.position;
            vertex.position = middle + on_ball.component_mul(&half);
            vertex.normal = on_ball.component_div(&half).try_normalize(1e-20).unwrap_or_else(Vector::x);
        }
    }

    /// Appends what `draw` draws, transformed.
    pub fn add(&mut self, place: impl Fn(&Vertex) -> Vertex, draw: impl FnOnce(&mut Self)) {
        let mut mesh = Self::default();
        draw(&mut mesh);
        self.append(&mesh, place);
    }

    /// Appends the triangles of another mesh, transformed.
    pub fn append(&mut self, other: &Self, place: impl Fn(&Vertex) -> Vertex) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices.iter().map(place));
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|k| first + k)));
    }
}
