//! Bench tables of thrusters: the maker's rows, between them, and the way back.

use proptest::prelude::*;
use uvms_gym::description::{Scene, ThrustTable};

use crate::thrusters::{puck, settled};

/// Rows and voltages of the T200's table, read here by themselves.
fn rows() -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
    let text = include_str!("../../src/description/t200.csv");
    let mut lines = text.lines().skip_while(|line| line.starts_with('#'));
    let header = lines.next().unwrap();
    let voltages = header.split(',').skip(1).map(|cell| cell.strip_suffix('V').unwrap().parse().unwrap()).collect();
    let rows = lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect::<Vec<f64>>());
    let (pulses, thrusts) = rows.map(|row| (row[0], row[1..].to_vec())).unzip();
    (pulses, voltages, thrusts)
}

/// Full thrust of the same sign at a voltage, N.
fn full(thrust: f64, column: usize, thrusts: &[Vec<f64>]) -> f64 {
    if thrust < 0.0 { -thrusts[0][column] } else { thrusts[thrusts.len() - 1][column] }
}

#[test]
fn val_a_scene_with_the_t200_gives_the_makers_thrusts_at_every_voltage() {
    let (pulses, voltages, thrusts) = rows();
    assert_eq!((pulses.len(), voltages.as_slice()), (41, [10.0, 12.0, 14.0, 16.0, 18.0, 20.0].as_slice()));
    for (column, voltage) in voltages.iter().enumerate() {
        let [lower, upper] = [thrusts[0][column], thrusts[40][column]];
        let mut scene = puck("map = 't200'");
        scene.vehicle.voltage = Some(*voltage);
        scene.vehicle.thrusters[0].limits = [lower, upper];
        for (pulse, row) in pulses.iter().zip(&thrusts) {
            let command =
                if *pulse < 1500.0 { lower * (1500.0 - pulse) / 400.0 } else { upper * (pulse - 1500.0) / 400.0 };
            let (given, bench) = (settled(&scene, command), row[column]);
            assert!((given - bench).abs() < 1e-9, "{voltage} V, {pulse} us: {given} N, {bench} N on the bench");
            assert!(bench != 0.0 || given == 0.0, "{voltage} V, {pulse} us: {given} N in the dead band");
            assert_eq!(ThrustTable::t200().thrust(*pulse, *voltage), bench, "{voltage} V, {pulse} us");
        }
    }
    // 16 V where a scene states none.
    let scene = Scene { ..puck("map = 't200'") };
    assert!((settled(&scene, 60.0) - 51.44).abs() < 1e-9 && (settled(&scene, -40.0) + 39.91).abs() < 1e-9);
}

/// Rows of the maker's full table that the shipped one leaves out.
#[test]
fn val_the_makers_thrusts_between_the_rows() {
    let table = ThrustTable::t200();
    for (pulse, at_12, at_16) in [(1134.0, -25.5, -36.8), (1470.0, 0.0, -0.4), (1530.0, 0.0, 0.0), (1887.0, 35.7, 50.4)]
    {
        for (voltage, bench, fully) in [(12.0, at_12, [28.48, 36.42]), (16.0, at_16, [39.91, 51.44])] {
            let given = table.thrust(pulse, voltage);
            let bound = 0.02 * fully[usize::from(pulse > 1500.0)];
            assert!((given - bench).abs() < bound, "{pulse} us, {voltage} V: {given} N, {bench} N on the bench");
        }
    }
}

#[test]
fn rows_and_voltages_that_are_left_out_are_met_by_those_beside_them() {
    let (pulses, voltages, thrusts) = rows();
    let every = |first: usize| -> Vec<_> {
        (0..41)
            .filter(|k| k % 2 == first || *k == 0 || *k == 20 || *k == 40)
            .map(|k| (pulses[k], thrusts[k].clone()))
            .collect()
    };
    for first in [0, 1] {
        let (some, theirs) = every(first).into_iter().unzip();
        let table = ThrustTable::new(some, voltages.clone(), theirs).unwrap();
        for (pulse, row) in pulses.iter().zip(&thrusts) {
            for (column, bench) in row.iter().enumerate() {
                let error = (table.thrust(*pulse, voltages[column]) - bench).abs() / full(*bench, column, &thrusts);
                assert!(error < 0.02, "{pulse} us, {} V: {error}", voltages[column]);
            }
        }
    }
    for left_out in 1..5 {
        let without =
            |row: &Vec<f64>| row.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, x)| *x).collect();
        let table =
            ThrustTable::new(pulses.clone(), without(&voltages), thrusts.iter().map(without).collect()).unwrap();
        for (pulse, row) in pulses.iter().zip(&thrusts) {
            let bench = row[left_out];
            let error = (table.thrust(*pulse, voltages[left_out]) - bench).abs() / full(bench, left_out, &thrusts);
            // Twice the distance of the table: a quarter of it remains between its own voltages.
            assert!(error < 0.03, "{pulse} us without {} V: {error}", voltages[left_out]);
        }
    }
}

#[test]
fn thrust_begins_without_a_jump_at_the_edge_of_the_dead_band() {
    for voltage in [10.0, 11.0, 12.0, 15.3, 16.0, 20.0] {
        let at = |pulse: f64| ThrustTable::t200().thrust(pulse, voltage);
        assert!((1480..=1520).all(|pulse| at(f64::from(pulse)) == 0.0), "{voltage} V");
        assert!(at(1440.0) < -0.5 && at(1560.0) > 0.5, "{voltage} V");
        let fine = (0..8000).map(|k| 1100.0 + 0.1 * f64::from(k));
        let most = fine.map(|pulse| (at(pulse + 0.1) - at(pulse)).abs()).fold(0.0, f64::max);
        assert!(most < 0.04, "{voltage} V: {most} N within 0.1 us");
    }
    // Commands of a scene: within one of 1 mN from the edge at 20 us of 400.
    let scene = puck("map = 't200'");
    for edge in [-40.0 * 0.05, 60.0 * 0.05] {
        assert_eq!(settled(&scene, edge), 0.0);
        let beyond = settled(&scene, edge * 1.001);
        assert!(beyond * edge > 0.0 && beyond.abs() < 1e-3, "{edge} N: {beyond} N");
    }
}

#[test]
fn a_table_of_ones_own_has_the_form_of_the_t200s() {
    let map = "map = { pulses = [1000, 1400, 1600, 2000], voltages = [24], thrusts = [[-80], [0], [0], [100]] }";
    let text = puck("").to_toml_string().replace("[vehicle]\n", "[vehicle]\nvoltage = 24\n");
    let text = text.replace("limits = [-40.0, 60.0]", &format!("limits = [-80.0, 100.0]\n{map}"));
    let scene = Scene::from_toml_str(&text, "own").unwrap();
    // Neutral at 1500 us: 60 N are 1800 us, half of the way from 1600 to 2000 us.
    for (command, thrust) in [(60.0, 50.0), (100.0, 100.0), (20.0, 0.0), (0.0, 0.0), (-48.0, -40.0), (-16.0, 0.0)] {
        assert!((settled(&scene, command) - thrust).abs() < 1e-12, "{command}: {}", settled(&scene, command));
    }
    assert_eq!(Scene::from_toml_str(&scene.to_toml_string(), "again").unwrap(), scene);
    let forward = ThrustTable::new(vec![1000.0, 2000.0], vec![24.0], vec![vec![0.0], vec![50.0]]).unwrap();
    assert_eq!(forward.points([0.0, 50.0], 24.0), [[0.0, 0.0], [50.0, 50.0]]);
    assert_eq!((forward.pulse(25.0, 24.0), forward.pulse(-1.0, 24.0)), (1500.0, 1000.0));
}

#[test]
fn tables_and_voltages_that_cannot_be_are_refused_in_a_line() {
    let scene = |voltage: &str, map: &str| {
        let text = puck("").to_toml_string().replace("[vehicle]\n", &format!("[vehicle]\n{voltage}\n"));
        let text = text.replace("limits = [-40.0, 60.0]", &format!("limits = [-40.0, 60.0]\nmap = {map}"));
        Scene::from_toml_str(&text, "puck.toml").map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(scene("voltage = 10", "'t200'"), Ok(()));
    for (voltage, map, expected) in [
        ("voltage = 9.9", "'t200'", "vehicle.voltage: is 9.9 V, but the bench table of a thruster has 10.0 to 20.0 V"),
        ("voltage = 20.5", "'t200'", "vehicle.voltage: is 20.5 V, but"),
        ("voltage = nan", "'t200'", "vehicle.voltage: NaN is not a finite number"),
        ("voltage = -1", "[[0, 0], [1, 1]]", "vehicle.voltage: is -1.0, but must be > 0"),
        (
            "",
            "'T100'",
            "vehicle.thrusters[0].map (main): no map is named \"T100\": expected \"t200\", a table, or pairs",
        ),
        ("", "[]", "vehicle.thrusters[0].map (main): must contain the pair [0, 0]"),
        ("", "{ pulses = [], voltages = [], thrusts = [] }", "map (main): has 0 pulses, but must have 2 to 64"),
        ("", "{ pulses = [1, 2], voltages = [], thrusts = [[], []] }", "has no voltages"),
        ("", "{ pulses = [1, 1], voltages = [16], thrusts = [[0], [1]] }", "pulses must ascend, but 1.0 follows 1.0"),
        ("", "{ pulses = [1, 2], voltages = [3, 2], thrusts = [[0, 0], [1, 1]] }", "voltages must ascend, but 2.0"),
        ("", "{ pulses = [1, 2], voltages = [16], thrusts = [[0]] }", "thrusts has 1 rows, but there are 2 pulses"),
        ("", "{ pulses = [1, 2], voltages = [16], thrusts = [[0], []] }", "thrusts[1] has 0 numbers, but there are 1"),
        ("", "{ pulses = [1, 2], voltages = [16], thrusts = [[0], [-1]] }", "must not descend, but those of 2.0 us do"),
        ("", "{ pulses = [1, 2], voltages = [16], thrusts = [[1], [2]] }", "no pulse gives 0 N at every voltage"),
        ("", "{ pulses = [1, 2], thrusts = [[0], [2]] }", "expected \"t200\", a table of pulses, voltages and thrusts"),
    ] {
        let error = scene(voltage, map).unwrap_err();
        assert!(error.contains(expected) && !error.contains('\n'), "{map}: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Never less thrust for a longer pulse; the same for all lanes of a scene.
    #[test]
    fn thrust_never_falls_with_the_pulse(a in 1100.0..1900.0, b in 1100.0..1900.0, voltage in 10.0..20.0) {
        let [low, high] = if a < b { [a, b] } else { [b, a] };
        let table = ThrustTable::t200();
        prop_assert!(table.thrust(low, voltage) <= table.thrust(high, voltage));
    }

    /// Outside the dead band, to a billionth of the microsecond that matters.
    #[test]
    fn the_pulse_of_a_thrust_is_the_one_that_gave_it(pulse in 1100.0..1900.0, voltage in 10.0..20.0) {
        let table = ThrustTable::t200();
        let thrust = table.thrust(pulse, voltage);
        let back = table.pulse(thrust, voltage);
        if thrust == 0.0 {
            prop_assert_eq!(back, 1500.0);
        } else {
            prop_assert!((back - pulse).abs() < 1e-6, "{} N: {} us", thrust, back);
        }
    }
}
