//! Neural policies: the forward pass in lanes, and policies as files.

use std::collections::BTreeMap;

use proptest::prelude::*;
use uvms_gym::control::{ActionKind, Activation, Controller, Layer, Mlp, Network, Normalisation, Output, PolicySpec};
use uvms_gym::error::PolicyError;
use uvms_gym::lane::{Isa, Kernel, Lane, Real, tanh};

const ACTIVATIONS: [Activation; 3] = [Activation::Tanh, Activation::Relu, Activation::Elu];

/// Numbers in [-1, 1) that look random.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn row(&mut self, length: usize, scale: f32) -> Vec<f32> {
        (0..length).map(|_| scale * self.next()).collect()
    }
}

fn network(sizes: &[usize], activation: Activation, output: Output, seed: u64) -> Network {
    let mut noise = Noise(seed);
    let layers = sizes.windows(2).map(|pair| Layer {
        weights: noise.row(pair[0] * pair[1], 1.5 / (pair[0] as f32).sqrt()),
        biases: noise.row(pair[1], 0.3),
    });
    Network { history: 1, normalisation: None, layers: layers.collect(), activation, output }
}

fn normalised(sizes: &[usize], seed: u64) -> Network {
    let mut noise = Noise(seed + 1);
    let normalisation = Normalisation {
        mean: noise.row(sizes[0], 0.5),
        variance: noise.row(sizes[0], 0.5).iter().map(|x| 0.6 + x).collect(),
        epsilon: 1e-8,
        clip: 2.5,
    };
    Network { normalisation: Some(normalisation), ..network(sizes, Activation::Tanh, Output::Clip, seed) }
}

fn spec() -> PolicySpec {
    PolicySpec {
        task: "UVMS-StationKeep".into(),
        scene: "a scene".into(),
        end_effector: "left".into(),
        action: ActionKind::Wrench,
        actions: 6,
        control_period: 0.05,
        observation: vec![("position_error".into(), 3), ("attitude_error".into(), 4)],
    }
}

fn policy() -> Mlp {
    let notes = BTreeMap::from([("seed".to_owned(), "3".to_owned())]);
    Mlp::new(normalised(&[7, 10, 6], 4), Some(spec()), notes).unwrap()
}

fn mlp(network: Network) -> Mlp {
    Mlp::new(network, None, BTreeMap::new()).unwrap()
}

fn act(mlp: &Mlp, observations: &[f32]) -> Vec<f32> {
    let widths = mlp.widths();
    let mut actions = vec![7.0; observations.len() / widths.observation * widths.action];
    mlp.act(observations, &mut [], &mut actions).unwrap();
    actions
}

fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|x| x.to_bits()).collect()
}

/// The forward pass in double precision, as plainly as it can be written.
fn plain(network: &Network, observation: &[f32]) -> Vec<f64> {
    let mut x: Vec<f64> = observation.iter().map(|x| f64::from(*x)).collect();
    if let Some(n) = &network.normalisation {
        for (i, x) in x.iter_mut().enumerate() {
            let deviation = (f64::from(n.variance[i]) + f64::from(n.epsilon)).sqrt();
            *x = ((*x - f64::from(n.mean[i])) / deviation).clamp(-f64::from(n.clip), f64::from(n.clip));
        }
    }
    for (k, layer) in network.layers.iter().enumerate() {
        let sum = |o: usize| -> f64 {
            let row = &layer.weights[o * layer.inputs()..(o + 1) * layer.inputs()];
            row.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>() + f64::from(layer.biases[o])
        };
        let last = k + 1 == network.layers.len();
        let function = |y: f64| match (last, network.activation, network.output) {
            (true, _, Output::Clip) => y.clamp(-1.0, 1.0),
            (true, _, Output::Tanh) | (false, Activation::Tanh, _) => y.tanh(),
            (false, Activation::Relu, _) => y.max(0.0),
            (false, Activation::Elu, _) => {
                if y > 0.0 {
                    y
                } else {
                    y.exp_m1()
                }
            }
        };
        x = (0..layer.outputs()).map(|o| function(sum(o))).collect();
    }
    x
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn val_forward_pass_is_that_of_double_precision(
        sizes in prop::collection::vec(1usize..70, 2..5), activation in prop::sample::select(ACTIVATIONS.to_vec()),
        output in prop::sample::select(vec![Output::Clip, Output::Tanh]), seed: u64, normalise: bool,
    ) {
        let mut network = network(&sizes, activation, output, seed);
        network.normalisation = normalised(&sizes, seed).normalisation.filter(|_| normalise);
        let observation = Noise(seed ^ 5).row(sizes[0], 2.0);
        for isa in Isa::available() {
            let actions = act(&mlp(network.clone()).on(isa), &observation);
            for (a, expected) in actions.iter().zip(plain(&network, &observation)) {
                prop_assert!((f64::from(*a) - expected).abs() < 2e-6, "{}: {a} {expected}", isa.name());
            }
        }
    }

    #[test]
    fn rows_do_not_depend_on_their_number_or_place(n in 1usize..100, seed: u64) {
        let mlp = mlp(normalised(&[9, 20, 5, 3], seed));
        let observations = Noise(seed ^ 9).row(9 * n, 3.0);
        let together = act(&mlp, &observations);
        for (i, observation) in observations.chunks_exact(9).enumerate() {
            prop_assert_eq!(bits(&act(&mlp, observation)), bits(&together[3 * i..3 * i + 3]));
        }
    }

    #[test]
    fn history_is_the_last_observations_side_by_side(history in 2usize..5, n in 1usize..20, seed: u64) {
        let network = Network { history, ..normalised(&[4 * history, 9, 2], seed) };
        let (at_once, mlp) = (mlp(Network { history: 1, ..network.clone() }), mlp(network));
        let widths = mlp.widths();
        prop_assert_eq!((widths.observation, widths.memory), (4, 4 * (history - 1)));
        let (mut memory, mut actions) = (vec![0.0; n * widths.memory], vec![0.0; 2 * n]);
        let mut seen = vec![vec![0.0; 4 * history]; n];
        for step in 0..6 {
            let observations = Noise(seed ^ step).row(4 * n, 2.0);
            mlp.act(&observations, &mut memory, &mut actions).unwrap();
            for (row, (seen, actions)) in observations.chunks(4).zip(seen.iter_mut().zip(actions.chunks(2))) {
                seen.drain(..4);
                seen.extend(row);
                prop_assert_eq!(bits(&act(&at_once, seen)), bits(actions));
            }
        }
    }

    #[test]
    fn altered_files_are_refused_or_read_but_nothing_breaks(at in 0usize..4000, to: u8) {
        let mut bytes = policy().to_bytes().unwrap();
        let at = at % bytes.len();
        bytes[at] = to;
        if let Ok(policy) = Mlp::from_bytes(&bytes) {
            prop_assert_eq!(act(&policy, &vec![0.1; policy.widths().observation]).len(), policy.widths().action);
        }
    }
}

#[test]
fn all_lane_widths_give_the_same_bits() {
    for activation in ACTIVATIONS {
        for output in [Output::Clip, Output::Tanh] {
            let mlp = mlp(network(&[12, 33, 17, 6], activation, output, 1));
            let observations = Noise(2).row(12 * 77, 3.0);
            let all: Vec<_> = (Isa::available().filter(|isa| *isa != Isa::Plain))
                .map(|isa| bits(&act(&mlp.clone().on(isa), &observations)))
                .collect();
            assert!(all.windows(2).all(|pair| pair[0] == pair[1]), "{activation:?} {output:?}");
        }
    }
}

/// tanh of many numbers, a panel at a time.
struct Tanh(Vec<f32>);

impl Kernel<f32> for Tanh {
    #[inline(always)]
    fn run<L: Lane<Real = f32>>(&mut self) {
        for x in self.0.chunks_exact_mut(L::LANES) {
            tanh(L::load(x)).store(x);
        }
    }
}

#[test]
fn val_tanh_is_that_of_the_standard_library() {
    let mut noise = Noise(1);
    let mut given: Vec<f32> = (0..40_000).map(|i| noise.next() * 10.0_f32.powi(i % 9 - 6)).collect();
    given.extend([0.0, -0.0, f32::MIN_POSITIVE, 1e-40, 9.0, 9.01, 9.02, -9.5, 88.0, -1e30, f32::MAX, f32::INFINITY]);
    given.extend(vec![f32::NEG_INFINITY; 16 - given.len() % 16]);
    let run = |isa| {
        let mut work = Tanh(given.clone());
        f32::dispatch(isa, &mut work);
        work.0
    };
    for isa in Isa::available() {
        let mut worst = 0.0_f64;
        for (x, y) in given.iter().zip(run(isa)) {
            let expected = f64::from(*x).tanh();
            let unit = f64::from(((expected.abs() as f32).next_up() - expected.abs() as f32).max(f32::from_bits(1)));
            worst = worst.max((f64::from(y) - expected).abs() / unit);
            assert!(y.abs() <= 1.0 && (y == 0.0 || y.signum() == x.signum()), "tanh({x}) = {y}");
        }
        assert!(worst < 6.0, "{}: {worst} units in the last place", isa.name());
    }
}

#[test]
fn actions_never_leave_their_range() {
    let mut wild = network(&[3, 8, 4], Activation::Relu, Output::Clip, 5);
    wild.layers[0].weights.fill(f32::MAX);
    let actions = act(&mlp(wild), &[1.0, 1.0, -1.0, 1e30, 1e30, 1e30]);
    assert!(actions.iter().all(|a| a.abs() <= 1.0), "{actions:?}");
}

#[test]
fn files_keep_every_bit() {
    let policy = policy();
    let bytes = policy.to_bytes().unwrap();
    let again = Mlp::from_bytes(&bytes).unwrap();
    assert_eq!((again.network(), again.spec(), again.notes()), (policy.network(), policy.spec(), policy.notes()));
    assert_eq!(again.to_bytes().unwrap(), bytes);
    let (without, squashed) = (network(&[2, 1], Activation::Elu, Output::Tanh, 0), Mlp::from_bytes);
    let again = squashed(&mlp(without.clone()).to_bytes().unwrap()).unwrap();
    assert_eq!((again.network(), again.spec()), (&without, None));
}

#[test]
fn files_that_were_cut_off_are_refused() {
    let bytes = policy().to_bytes().unwrap();
    for length in 0..bytes.len() {
        let refused = Mlp::from_bytes(&bytes[..length]).unwrap_err();
        assert!(matches!(refused, PolicyError::File(_)), "{length}: {refused}");
    }
}

/// A file with its header altered.
fn altered(from: &str, to: &str) -> String {
    let bytes = policy().to_bytes().unwrap();
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
    assert!(header.contains(from), "{header}");
    let header = header.replacen(from, to, 1);
    let file = [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &bytes[8 + length..]].concat();
    Mlp::from_bytes(&file).unwrap_err().to_string()
}

#[test]
fn files_of_something_else_are_refused_by_what_is_wrong() {
    for (from, to, word) in [
        ("uvms_gym", "pt", "'uvms_gym'"),
        ("mlp/1", "mlp/2", "mlp/2"),
        ("\\\"sizes\\\":[7,10,6]", "\\\"sizes\\\":[7,10,10,6]", "layers.1.weight"),
        ("\\\"sizes\\\":[7,10,6]", "\\\"sizes\\\":[7,10]", "layers.1"),
        ("\\\"activation\\\":\\\"tanh\\\"", "\\\"activation\\\":\\\"gelu\\\"", "gelu"),
        ("\\\"clip\\\":2.5", "\\\"clip\\\":-2.5", "-2.5"),
        ("layers.0.bias", "layers.0.bios", "layers.0.bias"),
        ("\"F32\"", "\"I32\"", "I32"),
        ("\\\"actions\\\":6", "\\\"actions\\\":8", "8"),
    ] {
        let message = altered(from, to);
        assert!(message.contains(word), "{from} -> {to}: {message}");
        assert!(!message.contains('\n'));
    }
}

#[test]
fn policies_for_something_else_are_refused_by_the_difference() {
    let policy = policy();
    policy.check(&spec()).unwrap();
    // A period that is a product differs in its last digit.
    policy.check(&PolicySpec { control_period: 0.05_f64.next_up(), ..spec() }).unwrap();
    let observation = |name: &str, entries| vec![("position_error".into(), 3), (name.into(), entries)];
    for (other, what) in [
        (
            PolicySpec { task: "UVMS-EETrack".into(), ..spec() },
            "task is UVMS-StationKeep, the environment's UVMS-EETrack",
        ),
        (PolicySpec { scene: "another".into(), ..spec() }, "scene is a scene, the environment's another"),
        (PolicySpec { end_effector: "right".into(), ..spec() }, "end effector is left, the environment's right"),
        (PolicySpec { action: ActionKind::Thrusters, ..spec() }, "action is wrench, the environment's thrusters"),
        (PolicySpec { actions: 8, ..spec() }, "number of actions is 6, the environment's 8"),
        (PolicySpec { control_period: 0.1, ..spec() }, "control period is 0.050000000 s"),
        (
            PolicySpec { observation: observation("twist", 4), ..spec() },
            "attitude_error (4), the environment's twist (4)",
        ),
        (PolicySpec { observation: observation("attitude_error", 3), ..spec() }, "environment's attitude_error (3)"),
        (PolicySpec { observation: vec![("position_error".into(), 3)], ..spec() }, "the environment's nothing"),
    ] {
        let refused = policy.check(&other).unwrap_err().to_string();
        assert!(refused.contains(what), "{refused}");
    }
    // One that does not say what it is for must have the right widths, at least.
    mlp(network(&[7, 6], Activation::Tanh, Output::Clip, 0)).check(&spec()).unwrap();
    assert!(mlp(network(&[8, 6], Activation::Tanh, Output::Clip, 0)).check(&spec()).is_err());
    let misfit = Mlp::new(network(&[8, 6], Activation::Tanh, Output::Clip, 0), Some(spec()), BTreeMap::new());
    assert!(matches!(misfit, Err(PolicyError::Mismatch { .. })));
}
