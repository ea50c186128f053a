//! Laws of the detection of a lost thruster.

use nalgebra as na;
use uvms_gym::control::thruster_fault::{LOST, SHARE, ThrusterFaults};
use uvms_gym::control::{Allocation, FaultGains, THRUSTERS};
use uvms_gym::description::Scene;
use uvms_gym::lie::Vector6;
use uvms_gym::task::EpisodeKey;
use uvms_gym::task::random::{Purpose, Stream};

const GAINS: FaultGains = FaultGains { fault_threshold: 20.0, fault_loss: 0.6, fault_memory: 0.0 };

struct Case {
    scene: Scene,
    allocation: Allocation,
    faults: ThrusterFaults,
}

impl Case {
    fn new(name: &str, gains: FaultGains) -> Self {
        let scene = Scene::shipped(name).unwrap();
        let allocation = Allocation::new(&scene.vehicle).unwrap();
        let faults = ThrusterFaults::new(gains, &scene.vehicle, &allocation, 0.1).unwrap();
        Self { scene, allocation, faults }
    }

    /// Effect of a demanded wrench when thruster i has lost a share.
    fn effect(&self, i: usize, share: f64, demand: [f64; 6]) -> na::Vector6<f64> {
        let mut thrusts = self.allocation.unsaturated(&demand.into());
        thrusts[i] *= 1.0 - share;
        self.allocation.wrench(&thrusts)
    }
}

#[test]
fn thrusters_have_the_effect_of_the_demand_without_a_lost_share_or_come_closest_to_it() {
    let wanted = [3.0, -2.0, 1.0, 0.3, -0.2, 0.1];
    for (name, redundant) in [("bluerov2-heavy", true), ("petasus-pum", false), ("rexrov", true)] {
        let case = Case::new(name, GAINS);
        for i in 0..case.allocation.count() {
            let mut memory = vec![0.0; case.faults.memory()];
            for share in [0.5, 0.999] {
                (memory[LOST], memory[SHARE]) = (1.0 + i as f64, share);
                let demand = case.faults.demand(Vector6::from_array(wanted), &memory).to_array();
                let effect = case.effect(i, share, demand);
                let missed = (effect - na::Vector6::from(wanted)).norm();
                if redundant || share == 0.5 {
                    // Rounding of the allocation, times the demand on the others.
                    assert!(missed < 1e-8, "{name} {i}: {missed}");
                } else {
                    let mut others = case.scene.vehicle.clone();
                    others.thrusters.remove(i);
                    let others = Allocation::new(&others).unwrap();
                    let closest = others.wrench(&others.unsaturated(&wanted.into()));
                    // What is left of the trial of 15 % of the thrust.
                    let tried = case.allocation.column(i) * (0.001 * 0.15 * case.allocation.range(i));
                    assert!((effect - closest - tried).norm() < 1e-9 && missed > 1e-3, "{name} {i}");
                }
            }
            // Nothing changes where none is lost.
            memory[LOST] = 0.0;
            assert_eq!(case.faults.demand(Vector6::from_array(wanted), &memory).to_array(), wanted);
        }
    }
    // A demand beyond the limits of the lost thruster does not scale down the others.
    let case = Case::new("bluerov2-heavy", GAINS);
    for i in 0..8 {
        let mut memory = vec![0.0; case.faults.memory()];
        (memory[LOST], memory[SHARE]) = (1.0 + i as f64, 1.0);
        let wanted: [f64; 6] = (case.allocation.column(i) * (0.6 * case.allocation.range(i))).into();
        let demand = case.faults.demand(Vector6::from_array(wanted), &memory).to_array();
        let [lower, upper] = case.allocation.limits(i);
        let thrust = case.allocation.unsaturated(&demand.into())[i];
        assert!((lower..=upper + 1e-9).contains(&thrust) && thrust > 0.99 * upper, "{i}: {thrust}");
    }
}

/// Steps until a loss is found, its thruster and share, for a share lost by one thruster and by all.
fn found(gains: FaultGains, seed: u64, lost: (usize, f64), by_all: f64, steps: usize) -> Option<(usize, usize, f64)> {
    let case = Case::new("bluerov2-heavy", gains);
    let (count, draw) = (case.allocation.count(), Stream::new(EpisodeKey { seed, episode: 0 }, Purpose::START));
    let mut memory = vec![0.0; case.faults.memory()];
    let mut index = 0;
    let mut normal = || {
        index += 1;
        draw.normal(index)
    };
    for step in 0..steps {
        let mut differences = [Vector6::zero(); THRUSTERS];
        let mut innovation: [f64; 6] = std::array::from_fn(|_| normal());
        for (i, difference) in differences.iter_mut().enumerate().take(count) {
            let column = case.allocation.column(i) * (2.0 * normal());
            *difference = Vector6::from_array(column.into());
            let share = by_all + if step >= 200 && i == lost.0 { lost.1 } else { 0.0 };
            (0..6).for_each(|k| innovation[k] -= share * column[k]);
        }
        case.faults.decide(Vector6::from_array(innovation), &differences, true, &mut memory);
        if memory[LOST] > 0.5 {
            return Some((step, memory[LOST] as usize - 1, memory[SHARE]));
        }
    }
    None
}

#[test]
fn a_lost_thruster_is_found_and_weak_ones_are_none() {
    let gains = FaultGains { fault_threshold: 7.0, fault_memory: 1.0, ..GAINS };
    for i in 0..8 {
        let (step, which, share) = found(gains, i as u64, (i, 1.0), 0.0, 600).unwrap();
        assert!(which == i && (200..400).contains(&step) && share > 0.5, "{i}: {step} {which} {share}");
        assert_eq!(found(gains, i as u64, (i, 0.2), 0.0, 400), None);
        // Nor are all of them, as with a heavy vehicle.
        assert_eq!(found(gains, i as u64, (i, 0.0), 0.6, 400), None);
    }
}

#[test]
fn val_twice_the_log_likelihood_ratio_of_noise_is_chi_squared() {
    // Of two thrusters' differences the common factor leaves one direction, in which one of both has lost thrust: the
    // ratio exceeds h = 1/2 where a normal number of half the history's deviation exceeds 1 in magnitude.
    let gains = FaultGains { fault_threshold: 0.5, fault_loss: 0.0, fault_memory: 0.0 };
    let case = Case::new("bluerov2-heavy", gains);
    let (trials, mut alarms) = (10_000, 0);
    for seed in 0..trials {
        let draw = Stream::new(EpisodeKey { seed, episode: 0 }, Purpose::START);
        let six = |step: u32, size: f64| {
            Vector6::from_array(std::array::from_fn(|k| size * draw.normal(8 * step + k as u32)))
        };
        let (mut memory, mut differences) = (vec![0.0; case.faults.memory()], [Vector6::zero(); THRUSTERS]);
        (0..150).for_each(|step| case.faults.decide(six(step, 2.0), &differences, true, &mut memory));
        assert_eq!(memory[LOST], 0.0);
        (differences[0], differences[1]) = (six(301, 50.0), six(302, 50.0));
        case.faults.decide(six(303, 1.0), &differences, true, &mut memory);
        alarms += u32::from(memory[LOST] > 0.5);
    }
    let (share, expected) = (f64::from(alarms) / trials as f64, 0.0455);
    // Five deviations; variances of a finite history add a few percent.
    assert!((share / expected - 1.0).abs() < 0.05 + 5.0 / (expected * trials as f64).sqrt(), "{share}");
}
