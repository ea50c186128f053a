//! Counter-based random numbers: every draw has an address, and nothing else decides its value.

use uvms_gym::task::random::*;

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
    let stream = Stream::new(EpisodeKey { seed: 7, episode: 3 }, Purpose::START);
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
        draw(1, 0, Purpose::START, 0),
        draw(1 << 32, 0, Purpose::START, 0),
        draw(0, 1, Purpose::START, 0),
        draw(0, 1 << 32, Purpose::START, 0),
        draw(0, 0, Purpose::CURRENT, 0),
        draw(0, 0, Purpose::START, 1),
        draw(0, 0, Purpose::START, 0),
    ];
    for (i, a) in all.iter().enumerate() {
        assert!(all[..i].iter().all(|b| a != b));
    }
}
