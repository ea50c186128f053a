//! Materials, light and water.

use super::Vector;

/// Material of a surface; colours are linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paint {
    /// Red, green, blue.
    pub colour: [f32; 3],
    /// Opacity.
    pub alpha: f32,
    /// Strength of highlights.
    pub gloss: f32,
    /// Emissive fraction of the colour.
    pub glow: f32,
}

impl Paint {
    /// Matt paint of the colour `0xRRGGBB`.
    pub const fn new(hex: u32) -> Self {
        const fn linear(byte: u32) -> f32 {
            let x = (byte & 255) as f32 / 255.0;
            x * x
        }
        let colour = [linear(hex >> 16), linear(hex >> 8), linear(hex)];
        Self { colour, alpha: 1.0, gloss: 0.0, glow: 0.0 }
    }

    /// The paint with highlights.
    pub const fn glossy(self, gloss: f32) -> Self {
        Self { gloss, ..self }
    }

    /// The paint with emission.
    pub const fn glowing(self, glow: f32) -> Self {
        Self { glow, ..self }
    }

    /// The paint with transparency.
    pub const fn clear(self, alpha: f32) -> Self {
        Self { alpha, ..self }
    }

    /// Interpolates between two paints.
    pub fn mix(self, to: Self, share: f32) -> Self {
        let colour = std::array::from_fn(|k| self.colour[k] + (to.colour[k] - self.colour[k]) * share);
        Self { colour, ..self }
    }
}

/// Light and water.
#[derive(Debug, Clone, Copy)]
pub struct Water {
    /// Colour at the horizon, above and below, linear.
    horizon: [f32; 3],
    above: [f32; 3],
    below: [f32; 3],
    /// Extinction per metre of red, green, blue.
    extinction: [f32; 3],
    /// Direction towards the sun.
    pub sun: Vector,
    /// Light from the sun, from above and from below.
    direct: f32,
    sky: [f32; 3],
    ground: [f32; 3],
    /// Strength of the caustics.
    pub caustics: f32,
    /// Paint of the floor.
    pub floor: [f32; 3],
}

impl Water {
    /// Water viewed from `distance`, m, or a vacuum.
    pub fn new(wet: bool, distance: f32, sun: Vector) -> Self {
        // Clarity in proportion to the distance, so that pictures of large and small vehicles look alike.
        let per = 1.0 / distance.max(1e-6);
        if wet {
            Self {
                horizon: Paint::new(0x2F86A0).colour,
                above: Paint::new(0x9ADBE2).colour,
                below: Paint::new(0x0B4258).colour,
                extinction: [0.30 * per, 0.13 * per, 0.105 * per],
                sun,
                direct: 0.95,
                sky: [0.50, 0.62, 0.66],
                ground: [0.17, 0.22, 0.22],
                caustics: 0.55,
                floor: Paint::new(0xC6BC9A).colour,
            }
        } else {
            Self {
                horizon: Paint::new(0x2B2F3A).colour,
                above: Paint::new(0x15171E).colour,
                below: Paint::new(0x22252E).colour,
                extinction: [0.10 * per; 3],
                sun,
                direct: 1.0,
                sky: [0.42, 0.44, 0.48],
                ground: [0.16, 0.16, 0.17],
                caustics: 0.0,
                floor: Paint::new(0x5A5F6B).colour,
            }
        }
    }

    /// Colour of the water in a direction, by the sine of its elevation.
    pub fn colour(&self, sine: f32) -> [f32; 3] {
        let (to, share) = if sine > 0.0 { (&self.above, sine / 0.75) } else { (&self.below, -sine / 0.6) };
        let share = share.min(1.0);
        let share = share * (2.0 - share);
        std::array::from_fn(|k| self.horizon[k] + (to[k] - self.horizon[k]) * share)
    }

    /// Transmission of a colour over this distance through the water, m.
    pub fn transmission(&self, way: f32) -> [f32; 3] {
        self.extinction.map(|k| decay(k * way))
    }

    /// Irradiance of a surface with this normal.
    pub fn light(&self, normal: &Vector) -> [f32; 3] {
        let up = 0.5 + 0.5 * normal.z;
        let direct = self.direct * normal.dot(&self.sun).max(0.0);
        std::array::from_fn(|k| self.ground[k] + (self.sky[k] - self.ground[k]) * up + direct)
    }

    /// Colour of a painted surface seen through the water, with the unit vector `to_eye`.
    pub fn shade(&self, paint: &Paint, normal: &Vector, to_eye: &Vector, way: f32) -> [f32; 3] {
        let light = self.light(normal);
        let half = self.sun + to_eye;
        let mut shine = normal.dot(&half).max(0.0) / half.norm().max(1e-6);
        for _ in 0..5 {
            shine *= shine;
        }
        let (through, water) = (self.transmission(way), self.colour(-to_eye.z));
        std::array::from_fn(|k| {
            let lit = paint.colour[k] * (light[k] + (1.0 - light[k]) * paint.glow) + paint.gloss * shine;
            water[k] + (lit - water[k]) * through[k]
        })
    }
}

/// Approximate `exp(-x)` for x >= 0, the same on every machine.
pub fn decay(x: f32) -> f32 {
    let y = 1.0 + x * (1.0 / 16.0) + x * x * (1.0 / 512.0);
    let y = y * y;
    let y = y * y;
    let y = y * y;
    1.0 / (y * y)
}

/// Gamma-encoded value of a linear colour, 0 to 1.
#[inline]
pub fn display(linear: f32) -> f32 {
    linear.clamp(0.0, 1.0).sqrt()
}
