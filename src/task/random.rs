//! Counter-based random numbers: every draw has an address, and nothing else decides its value.
//!
//! Philox4x32-10 after J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.

use std::f64::consts::TAU;

use nalgebra::Vector3;

/// Draws of one episode belong to (seed, episode).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct EpisodeKey {
    /// Seed of the environment.
    pub seed: u64,
    /// Number of the episode since that seed was set.
    pub episode: u64,
}

impl EpisodeKey {
    /// The next episode under the same seed.
    pub fn following(self) -> Self {
        Self { episode: self.episode.wrapping_add(1), ..self }
    }
}

/// What a stream of draws is for. A stream's draws do not depend on how many another stream takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// Start state relative to the target.
    Start = 0,
    /// Target pose.
    Target = 1,
    /// Current.
    Current = 2,
    /// Joint reference.
    Reference = 3,
    /// Wandering current: what it starts from.
    Drift = 32,
    /// Gusts.
    Gust = 33,
    /// Waves.
    Waves = 34,
    /// Pushes.
    Impulse = 35,
    /// Tether.
    Tether = 36,
    /// Payload.
    Payload = 37,
    /// Thrusters that fail.
    Thrusters = 38,
    /// What sensors are off by throughout an episode.
    Bias = 39,
    /// Factors on the scene's parameters.
    Parameters = 40,
    /// What differs from one control period to the next.
    Noise = 41,
}

/// A stream of draws, addressed by index. Each index is one block of 128 bits, to be used for one draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stream {
    key: EpisodeKey,
    purpose: Purpose,
}

impl Stream {
    /// The stream for `purpose` in the episode `key`.
    pub fn new(key: EpisodeKey, purpose: Purpose) -> Self {
        Self { key, purpose }
    }

    /// Draw `index`, uniform in [0, 1).
    pub fn uniform(&self, index: u32) -> f64 {
        self.pair(index)[0]
    }

    /// Draw `index`, uniform in [low, high).
    pub fn uniform_in(&self, index: u32, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform(index)
    }

    /// Draw `index`, normal with mean 0 and deviation 1 (Box-Muller).
    pub fn normal(&self, index: u32) -> f64 {
        let [u, v] = self.pair(index);
        (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
    }

    /// Draw `index`, uniform on the unit sphere (Archimedes: height and azimuth are uniform).
    pub fn unit_vector(&self, index: u32) -> Vector3<f64> {
        let [u, v] = self.pair(index);
        let height = 2.0 * u - 1.0;
        let radius = (1.0 - height * height).sqrt();
        let (sine, cosine) = (TAU * v).sin_cos();
        Vector3::new(radius * cosine, radius * sine, height)
    }

    /// Draw `index`, four numbers uniform in (0, 1), in steps of 2^-32.
    pub fn quad(&self, index: u32) -> [f64; 4] {
        self.words(index).map(|word| (f64::from(word) + 0.5) * (1.0 / (1u64 << 32) as f64))
    }

    /// Two numbers in [0, 1) with 53 random bits each.
    fn pair(&self, index: u32) -> [f64; 2] {
        let [a, b, c, d] = self.words(index);
        let unit =
            |low: u32, high: u32| ((u64::from(high) << 32 | u64::from(low)) >> 11) as f64 * (1.0 / (1u64 << 53) as f64);
        [unit(a, b), unit(c, d)]
    }

    fn words(&self, index: u32) -> [u32; 4] {
        let EpisodeKey { seed, episode } = self.key;
        let counter = [index, self.purpose as u32, episode as u32, (episode >> 32) as u32];
        philox4x32(counter, [seed as u32, (seed >> 32) as u32])
    }
}

/// Ten rounds of Philox 4x32: a bijection of the counter for every key.
fn philox4x32(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for round in 0..10 {
        if round > 0 {
            key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
        }
        let first = u64::from(counter[0]) * 0xD251_1F53;
        let second = u64::from(counter[2]) * 0xCD9E_8D57;
        counter = [
            (second >> 32) as u32 ^ counter[1] ^ key[0],
            second as u32,
            (first >> 32) as u32 ^ counter[3] ^ key[1],
            first as u32,
        ];
    }
    counter
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Known answers that Random123 publishes for philox4x32-10 (kat_vectors).
    #[test]
    fn val_philox_gives_the_published_answers() {
        let known = [
            ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
            ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
            (
                [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
                [0xa409_3822, 0x299f_31d0],
                [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
            ),
        ];
        for (counter, key, answer) in known {
            assert_eq!(philox4x32(counter, key), answer);
        }
    }

    #[test]
    fn uniform_draws_have_the_moments_of_their_distribution() {
        let stream = Stream::new(EpisodeKey { seed: 7, episode: 3 }, Purpose::Start);
        let n = 20_000u32;
        let mean = |f: &dyn Fn(u32) -> f64| (0..n).map(f).sum::<f64>() / f64::from(n);
        // Five deviations of each estimate.
        assert!((mean(&|i| stream.uniform(i)) - 0.5).abs() < 5.0 * (1.0 / 12.0 / f64::from(n)).sqrt());
        assert!(mean(&|i| stream.normal(i)).abs() < 5.0 / f64::from(n).sqrt());
        assert!((mean(&|i| stream.normal(i).powi(2)) - 1.0).abs() < 5.0 * (2.0 / f64::from(n)).sqrt());
        for axis in 0..3 {
            assert!((mean(&|i| stream.unit_vector(i)[axis].powi(2)) - 1.0 / 3.0).abs() < 0.012);
            assert!(mean(&|i| stream.unit_vector(i)[axis]).abs() < 0.021);
        }
        assert!((0..n).all(|i| (stream.unit_vector(i).norm() - 1.0).abs() < 1e-15));
    }

    #[test]
    fn every_part_of_the_address_changes_the_draw() {
        let draw = |seed, episode, purpose, i| Stream::new(EpisodeKey { seed, episode }, purpose).uniform(i);
        let all = [
            draw(1, 0, Purpose::Start, 0),
            draw(1 << 32, 0, Purpose::Start, 0),
            draw(0, 1, Purpose::Start, 0),
            draw(0, 1 << 32, Purpose::Start, 0),
            draw(0, 0, Purpose::Current, 0),
            draw(0, 0, Purpose::Start, 1),
            draw(0, 0, Purpose::Start, 0),
        ];
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a != b));
        }
    }
}
