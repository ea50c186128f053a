//! Named disturbances.

use super::{
    ArmMotion, Delay, Disturbance, Drift, Gust, Impulse, Noise, Parameters, Payload, Span, SteadyCurrent, ThrusterLoss,
    Waves,
};

/// A named disturbance.
#[derive(Debug, Clone, Copy)]
pub struct Level {
    /// Name, by which options select the level.
    pub name: &'static str,
    /// Description, one sentence.
    pub description: &'static str,
    make: fn() -> Disturbance,
}

impl Level {
    /// Its components.
    pub fn disturbance(&self) -> Disturbance {
        (self.make)()
    }
}

/// Levels for training, mild to strong, then harder ones for evaluation only: 1.3 times as strong, and with shapes
/// that the others lack.
pub const LEVELS: [Level; 14] = [
    Level {
        name: "calm",
        description: "Still water; only the scene's own current, if it has one.",
        make: Disturbance::default,
    },
    Level { name: "current", description: "A steady current and one that wanders about it.", make: || current(1.0) },
    Level { name: "gusts", description: "Gusts of 0.1 to 0.35 m/s on a weak current.", make: || gusts(1.0) },
    Level { name: "waves", description: "A train of waves a few metres above.", make: || waves(1.0) },
    Level { name: "payload", description: "The gripper picks up a mass and drops it again.", make: || payload(1.0) },
    Level {
        name: "thruster-loss",
        description: "One thruster falls to between 0 and 50 % of its thrust.",
        make: || thruster_loss(1.0),
    },
    Level {
        name: "storm",
        description: "All at once: current, gusts, waves, pushes, a fast arm, a payload, a weak thruster, noisy and late \
                      sensors, and parameters off by up to 30 %.",
        make: || storm(1.0),
    },
    Level {
        name: "storm-wide",
        description: "As storm, with a vehicle that is known poorly: masses and drag 0.5 to 1.6 times, thrust 0.5 to 1.3, \
                      lag 0.3 to 3 times as in the scene, sensors 0 to 0.3 s late, a heavy payload, a lost thruster.",
        make: storm_wide,
    },
    Level {
        name: "current-hard",
        description: "As current, 1.3 times as fast, wandering faster, at any slope.",
        make: current_hard,
    },
    Level {
        name: "gusts-hard",
        description: "As gusts, 1.3 times as fast, rising in half the time and turning round.",
        make: gusts_hard,
    },
    Level { name: "waves-hard", description: "Two trains of waves, 1.3 times as high, that cross.", make: waves_hard },
    Level {
        name: "payload-hard",
        description: "As payload, 1.3 times as heavy, with a cable that pulls.",
        make: payload_hard,
    },
    Level {
        name: "thruster-loss-hard",
        description: "Two thrusters fade to between 0 and 50 % of their thrust.",
        make: thruster_loss_hard,
    },
    Level {
        name: "storm-hard",
        description: "As storm, 1.3 times as strong, with turning gusts, crossing waves and a cable.",
        make: storm_hard,
    },
];

/// Strength of the harder levels relative to the others.
const HARD: f64 = 1.3;

fn steady(low: f64, high: f64) -> Option<SteadyCurrent> {
    Some(SteadyCurrent { speed: Span::of(low, high), ..SteadyCurrent::default() })
}

fn current(by: f64) -> Disturbance {
    let drift = Drift { deviation: Span::of(0.03, 0.08).times(by), ..Drift::default() };
    Disturbance { current: steady(0.1 * by, 0.4 * by), drift: Some(drift), ..Disturbance::default() }
}

fn current_hard() -> Disturbance {
    let mut hard = current(HARD);
    if let (Some(current), Some(drift)) = (&mut hard.current, &mut hard.drift) {
        current.elevation = std::f64::consts::FRAC_PI_2;
        (drift.time, drift.vertical) = (Span::of(2.0, 5.0), 1.0);
    }
    hard
}

fn gusts(by: f64) -> Disturbance {
    let gust = Gust { speed: Span::of(0.1, 0.35).times(by), ..Gust::default() };
    Disturbance { current: steady(0.0, 0.2 * by), gust: Some(gust), ..Disturbance::default() }
}

fn gusts_hard() -> Disturbance {
    let mut hard = gusts(HARD);
    if let Some(gust) = &mut hard.gust {
        (gust.rise, gust.turns) = (0.5, true);
    }
    hard
}

fn waves(by: f64) -> Disturbance {
    let waves = Waves { height: Span::of(0.2, 0.5).times(by), ..Waves::default() };
    Disturbance { current: steady(0.0, 0.2 * by), waves: Some(waves), ..Disturbance::default() }
}

fn waves_hard() -> Disturbance {
    let mut hard = waves(HARD);
    if let Some(waves) = &mut hard.waves {
        waves.trains = 2;
    }
    hard
}

fn payload(by: f64) -> Disturbance {
    let payload = Payload { share: Span::of(0.03, 0.1).times(by), ..Payload::default() };
    Disturbance { current: steady(0.0, 0.2 * by), payload: Some(payload), ..Disturbance::default() }
}

fn payload_hard() -> Disturbance {
    Disturbance { tether: Some(super::Tether::default()), ..payload(HARD) }
}

fn thruster_loss(by: f64) -> Disturbance {
    let thrusters = ThrusterLoss { gain: Span::of(0.0, 0.5), ..ThrusterLoss::default() };
    Disturbance { current: steady(0.0, 0.2 * by), thrusters: Some(thrusters), ..Disturbance::default() }
}

fn thruster_loss_hard() -> Disturbance {
    let mut hard = thruster_loss(HARD);
    if let Some(thrusters) = &mut hard.thrusters {
        (thrusters.count, thrusters.fade) = (2, 2.0);
    }
    hard
}

fn storm(by: f64) -> Disturbance {
    Disturbance {
        current: steady(0.1 * by, 0.3 * by),
        drift: Some(Drift { deviation: Span::of(0.02, 0.06).times(by), ..Drift::default() }),
        gust: Some(Gust { speed: Span::of(0.1, 0.25).times(by), ..Gust::default() }),
        waves: Some(Waves { height: Span::of(0.1, 0.4).times(by), ..Waves::default() }),
        impulse: Some(Impulse { share: Span::of(0.3, 1.0).times(by), ..Impulse::default() }),
        payload: Some(Payload { share: Span::of(0.02, 0.08).times(by), ..Payload::default() }),
        thrusters: Some(ThrusterLoss { gain: Span::of(0.5, 0.8).times(1.0 / by), ..ThrusterLoss::default() }),
        arm: Some(ArmMotion { amplitude: by, speed: 1.5 * by }),
        noise: Some(Noise::default()),
        delay: Some(Delay { periods: 1, ..Delay::default() }),
        parameters: Some(Parameters::within(0.3 * by)),
        ..Disturbance::default()
    }
}

fn storm_wide() -> Disturbance {
    let mut wide = storm(1.0);
    if let (Some(payload), Some(thrusters)) = (&mut wide.payload, &mut wide.thrusters) {
        (payload.share, thrusters.gain) = (Span::of(0.02, 0.16), Span::of(0.0, 0.8));
    }
    let poorly = Span::of(0.5, 1.6);
    let parameters = Parameters::of([
        ("mass", poorly),
        ("added_mass", poorly),
        ("linear_damping", poorly),
        ("quadratic_damping", poorly),
        ("thrust", Span::of(0.5, 1.3)),
        ("thruster_lag", Span::of(0.3, 3.0)),
    ]);
    let delay = Delay { time: Span::of(0.0, 0.3), ..Delay::default() };
    Disturbance { delay: Some(delay), parameters: Some(parameters), ..wide }
}

fn storm_hard() -> Disturbance {
    let mut hard = storm(HARD);
    if let (Some(gust), Some(waves)) = (&mut hard.gust, &mut hard.waves) {
        (gust.rise, gust.turns, waves.trains) = (0.5, true, 2);
    }
    Disturbance { tether: Some(super::Tether::default()), ..hard }
}
