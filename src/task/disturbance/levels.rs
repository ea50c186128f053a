//! Named disturbances.

use serde_json::{Value, json};

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
        make: || {
            let poorly = [0.5, 1.6];
            let parameters = json!({
                "mass": poorly, "added_mass": poorly, "linear_damping": poorly, "quadratic_damping": poorly,
                "thrust": [0.5, 1.3], "thruster_lag": [0.3, 3.0],
            });
            let changes = json!({
                "payload": { "share": [0.02, 0.16] },
                "thrusters": { "gain": [0.0, 0.8] },
                "delay": { "time": [0.0, 0.3], "periods": 0 },
                "parameters": parameters,
            });
            changed(storm(1.0), changes)
        },
    },
    Level {
        name: "current-hard",
        description: "As current, 1.3 times as fast, wandering faster, at any slope.",
        make: || {
            let steep = std::f64::consts::FRAC_PI_2;
            changed(
                current(HARD),
                json!({ "current": { "elevation": steep }, "drift": { "time": [2, 5], "vertical": 1 } }),
            )
        },
    },
    Level {
        name: "gusts-hard",
        description: "As gusts, 1.3 times as fast, rising in half the time and turning round.",
        make: || changed(gusts(HARD), json!({ "gust": { "rise": 0.5, "turns": true } })),
    },
    Level {
        name: "waves-hard",
        description: "Two trains of waves, 1.3 times as high, that cross.",
        make: || changed(waves(HARD), json!({ "waves": { "trains": 2 } })),
    },
    Level {
        name: "payload-hard",
        description: "As payload, 1.3 times as heavy, with a cable that pulls.",
        make: || changed(payload(HARD), json!({ "tether": true })),
    },
    Level {
        name: "thruster-loss-hard",
        description: "Two thrusters fade to between 0 and 50 % of their thrust.",
        make: || changed(thruster_loss(HARD), json!({ "thrusters": { "count": 2, "fade": 2 } })),
    },
    Level {
        name: "storm-hard",
        description: "As storm, 1.3 times as strong, with turning gusts, crossing waves and a cable.",
        make: || {
            let gust = json!({ "rise": 0.5, "turns": true });
            changed(storm(HARD), json!({ "gust": gust, "waves": { "trains": 2 }, "tether": true }))
        },
    },
];

/// Strength of the harder levels relative to the others.
const HARD: f64 = 1.3;

/// A disturbance with changes in the form of [`Disturbance::from_json`].
fn changed(base: Disturbance, changes: Value) -> Disturbance {
    let changes = changes.as_object().cloned().unwrap_or_default();
    base.changed(changes).expect("the changes are settings of components")
}

fn steady(low: f64, high: f64) -> Option<SteadyCurrent> {
    Some(SteadyCurrent { speed: Span::of(low, high), ..SteadyCurrent::default() })
}

fn current(by: f64) -> Disturbance {
    let drift = Drift { deviation: Span::of(0.03, 0.08).times(by), ..Drift::default() };
    Disturbance { current: steady(0.1 * by, 0.4 * by), drift: Some(drift), ..Disturbance::default() }
}

fn gusts(by: f64) -> Disturbance {
    let gust = Gust { speed: Span::of(0.1, 0.35).times(by), ..Gust::default() };
    Disturbance { current: steady(0.0, 0.2 * by), gust: Some(gust), ..Disturbance::default() }
}

fn waves(by: f64) -> Disturbance {
    let waves = Waves { height: Span::of(0.2, 0.5).times(by), ..Waves::default() };
    Disturbance { current: steady(0.0, 0.2 * by), waves: Some(waves), ..Disturbance::default() }
}

fn payload(by: f64) -> Disturbance {
    let payload = Payload { share: Span::of(0.03, 0.1).times(by), ..Payload::default() };
    Disturbance { current: steady(0.0, 0.2 * by), payload: Some(payload), ..Disturbance::default() }
}

fn thruster_loss(by: f64) -> Disturbance {
    let thrusters = ThrusterLoss { gain: Span::of(0.0, 0.5), ..ThrusterLoss::default() };
    Disturbance { current: steady(0.0, 0.2 * by), thrusters: Some(thrusters), ..Disturbance::default() }
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
