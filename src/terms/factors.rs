//! Factors on the parameters of single instances, for domain randomisation.

/// Number of entries of [`Factors`].
pub const FACTORS: usize = 8;

/// Factors on the parameters of one instance, the same for all of its bodies; 1 leaves the scene unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors<L> {
    /// Mass, inertia and weight.
    pub mass: L,
    /// Added mass.
    pub added_mass: L,
    /// Linear damping, and damping by forward speed.
    pub linear_damping: L,
    /// Quadratic damping.
    pub quadratic_damping: L,
    /// Displaced volume and buoyancy.
    pub volume: L,
    /// Point mass at the end effector, kg (not a factor).
    pub payload: L,
    /// Thrust.
    pub thrust: L,
    /// Thrusters' time constants.
    pub thruster_lag: L,
}

impl Factors<f64> {
    /// The unchanged scene.
    pub const ONE: Self = Self {
        mass: 1.0,
        added_mass: 1.0,
        linear_damping: 1.0,
        quadratic_damping: 1.0,
        volume: 1.0,
        payload: 0.0,
        thrust: 1.0,
        thruster_lag: 1.0,
    };
    /// The scene without added mass.
    pub const RIGID: Self = Self { added_mass: 0.0, ..Self::ONE };
}

impl Factors<f64> {
    /// Entries that concern bodies: all but the thrusters'.
    pub fn of_bodies(&self) -> [f64; FACTORS - 2] {
        let [bodies @ .., _, _] = self.to_array();
        bodies
    }
}

impl<L: Copy> Factors<L> {
    /// Names, in the order of [`Self::to_array`].
    pub const NAMES: [&'static str; FACTORS] =
        ["mass", "added_mass", "linear_damping", "quadratic_damping", "volume", "payload", "thrust", "thruster_lag"];

    /// From an array in the order of [`Self::NAMES`].
    #[inline(always)]
    pub fn from_array(numbers: [L; FACTORS]) -> Self {
        let [mass, added_mass, linear_damping, quadratic_damping, volume, payload, thrust, thruster_lag] = numbers;
        Self { mass, added_mass, linear_damping, quadratic_damping, volume, payload, thrust, thruster_lag }
    }

    /// Array in the order of [`Self::NAMES`].
    pub fn to_array(&self) -> [L; FACTORS] {
        let Self { mass, added_mass, linear_damping, quadratic_damping, volume, payload, thrust, thruster_lag } = *self;
        [mass, added_mass, linear_damping, quadratic_damping, volume, payload, thrust, thruster_lag]
    }
}
