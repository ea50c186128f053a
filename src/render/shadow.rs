//! Soft shadow on the floor.

use super::Vector;
use super::mesh::Mesh;

/// Texels per side.
const SIDE: usize = 128;

/// Shadow map of a square of the floor: fraction of light that is blocked, 0 to 1.
#[derive(Debug)]
pub struct Shadow {
    corner: [f32; 2],
    /// Texels per metre.
    density: f32,
    texels: Vec<f32>,
}

impl Shadow {
    /// Shadow of a mesh on a floor at the height `floor`, in light from `sun`, on a square of half edge `half` under `middle`.
    pub fn new(mesh: &Mesh, floor: f32, sun: &Vector, middle: &Vector, half: f32) -> Self {
        let slant = [sun.x / sun.z, sun.y / sun.z];
        let fall = |p: &Vector| {
            let height = (p.z - floor).max(0.0);
            [p.x - slant[0] * height, p.y - slant[1] * height]
        };
        let foot = fall(middle);
        let density = SIDE as f32 / (2.0 * half);
        let mut this = Self { corner: [foot[0] - half, foot[1] - half], density, texels: vec![0.0; SIDE * SIDE] };
        let points: Vec<[f32; 2]> = mesh.vertices.iter().map(|v| this.texel(fall(&v.position))).collect();
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|k| k as usize);
            let high = [a, b, c].iter().any(|&k| mesh.vertices[k].position.z > floor);
            if high && mesh.vertices[a].paint.alpha >= 1.0 {
                this.fill([points[a], points[b], points[c]]);
            }
        }
        for _ in 0..3 {
            this.blur(3);
        }
        this
    }

    #[inline]
    fn texel(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        [(x - self.corner[0]) * self.density, (y - self.corner[1]) * self.density]
    }

    /// Darkens the texels that a triangle of either orientation covers.
    fn fill(&mut self, mut p: [[f32; 2]; 3]) {
        let cross =
            |a: [f32; 2], b: [f32; 2], c: [f32; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if cross(p[0], p[1], p[2]) < 0.0 {
            p.swap(1, 2);
        }
        let range = |k: usize| {
            let (minimum, most) = (p[0][k].min(p[1][k]).min(p[2][k]), p[0][k].max(p[1][k]).max(p[2][k]));
            (minimum.max(0.0) as usize, (most.max(0.0).min(SIDE as f32) as usize + 1).min(SIDE))
        };
        let ((left, right), (top, bottom)) = (range(0), range(1));
        for y in top..bottom {
            for x in left..right {
                let at = [x as f32 + 0.5, y as f32 + 0.5];
                // Half a texel more on every side, for thin objects.
                let near =
                    |a: [f32; 2], b: [f32; 2]| cross(a, b, at) >= -0.5 * ((b[0] - a[0]).abs() + (b[1] - a[1]).abs());
                if near(p[0], p[1]) && near(p[1], p[2]) && near(p[2], p[0]) {
                    self.texels[y * SIDE + x] = 1.0;
                }
            }
        }
    }

    /// Box filter over `2 radius + 1` texels along rows, then columns.
    fn blur(&mut self, radius: usize) {
        let mut line = [0.0; SIDE];
        for (stride, step) in [(SIDE, 1), (1, SIDE)] {
            for k in 0..SIDE {
                let at = |i: usize| k * stride + i * step;
                let mut sum = 0.0;
                for i in 0..SIDE + radius {
                    if i < SIDE {
                        sum += self.texels[at(i)];
                    }
                    if i > 2 * radius {
                        sum -= self.texels[at(i - 2 * radius - 1)];
                    }
                    if i >= radius {
                        line[i - radius] = sum / (2 * radius + 1) as f32;
                    }
                }
                for (i, value) in line.iter().enumerate() {
                    self.texels[at(i)] = *value;
                }
            }
        }
    }

    /// True if a point of the line between two points may be inside the square.
    pub fn reaches(&self, from: [f32; 2], to: [f32; 2]) -> bool {
        let (from, to) = (self.texel(from), self.texel(to));
        (0..2).all(|k| from[k].max(to[k]) > 0.0 && from[k].min(to[k]) < SIDE as f32)
    }

    /// Fraction of light that is blocked at a point of the floor.
    #[inline]
    pub fn at(&self, place: [f32; 2]) -> f32 {
        let [x, y] = self.texel(place);
        let (x, y) = (x - 0.5, y - 0.5);
        let most = (SIDE - 1) as f32;
        if !(x >= 0.0 && y >= 0.0 && x < most && y < most) {
            return 0.0;
        }
        let (i, k) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - k as f32);
        let at = k * SIDE + i;
        let row = |at: usize| self.texels[at] + (self.texels[at + 1] - self.texels[at]) * fx;
        let (near, far) = (row(at), row(at + SIDE));
        near + (far - near) * fy
    }
}
