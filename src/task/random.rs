//! Counter-based random numbers: the value of a draw depends only on its address.
//!
//! Philox4x32-10 after J. K. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.

use std::f64::consts::TAU;

use nalgebra::Vector3;

/// Key of an episode's draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct EpisodeKey {
    /// Seed of the environment.
    pub seed: u64,
    /// Number of the episode under that seed.
    pub episode: u64,
}

impl EpisodeKey {
    /// The next episode under the same seed.
    pub fn following(self) -> Self {
        Self { episode: self.episode.wrapping_add(1), ..self }
    }
}

/// Purpose of a stream of draws. Streams are independent of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Purpose(u32);

impl Purpose {
    /// Start state relative to the target.
    pub const START: Self = Self(0);
    /// Target pose.
    pub const TARGET: Self = Self(1);
    /// Current.
    pub const CURRENT: Self = Self(2);
    /// References of joints and paths.
    pub const REFERENCE: Self = Self(3);
    /// Numbers of the scene.
    pub const SCENE: Self = Self(42);

    /// Purpose of a component of a disturbance: numbers from 32 on.
    pub const fn of(stream: u32) -> Self {
        Self(stream)
    }
}

/// A stream of draws, addressed by index. Each index is a block of 128 bits for one draw.
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
        let counter = [index, self.purpose.0, episode as u32, (episode >> 32) as u32];
        philox4x32(counter, [seed as u32, (seed >> 32) as u32])
    }
}

/// Ten rounds of Philox 4x32: a bijection of the counter for every key.
pub fn philox4x32(mut counter: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
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
