"""Statistics of scores, against the definitions written out."""

import math

import numpy as np
import pytest

from uvms_gym.studies.comparison.statistics import Draws, Estimate, Sample, Scores, interquartile_mean

RNG = np.random.default_rng(11)
SEEDS, EPISODES = 3, 37
#: With ties, and with one controller that has seeds and one that has none.
MANY = np.round(RNG.lognormal(size=(SEEDS, EPISODES)), 1)
ONE = np.round(RNG.lognormal(0.4, 1.0, size=(1, EPISODES)), 1)


def resamples(draws: Draws, scores: np.ndarray) -> list[np.ndarray]:
    """Every resample written out: rows and columns as often as they are drawn."""
    rows = draws.seeds(len(scores))
    return [
        np.repeat(np.repeat(scores, rows[r], axis=0), draws.episodes[r], axis=1).ravel() for r in range(draws.resamples)
    ]


def trimmed(scores: np.ndarray, share: float) -> float:
    """Trimmed mean, as scipy.stats.trim_mean defines it."""
    ordered = sorted(scores.tolist())
    cut = int(share * len(ordered))
    middle = ordered[cut : len(ordered) - cut]
    return math.fsum(middle) / len(middle)


@pytest.mark.parametrize("scores", [MANY, ONE], ids=["seeds", "none"])
@pytest.mark.parametrize("cut", [0.0, 0.25])
def test_means_quantiles_and_profiles_are_those_of_resamples_written_out(scores: np.ndarray, cut: float) -> None:
    draws = Draws(EPISODES, 5, resamples=50)
    thresholds = [0.05, 0.5, 1.0, 2.0, 50.0]
    mean, p95, profile = Scores(scores, draws).statistics(cut, 0.95, thresholds)
    written = resamples(draws, scores)
    assert mean.value == pytest.approx(trimmed(scores.ravel(), cut))
    np.testing.assert_allclose(mean.resampled, [trimmed(one, cut) for one in written], rtol=1e-12)
    assert p95.value == pytest.approx(np.quantile(scores, 0.95))
    np.testing.assert_allclose(p95.resampled, [np.quantile(one, 0.95) for one in written], rtol=1e-12)
    shares = np.array([[np.mean(one <= tau) for tau in thresholds] for one in written])
    np.testing.assert_allclose(profile.value, [np.mean(scores <= tau) for tau in thresholds])
    np.testing.assert_allclose(profile.low, np.quantile(shares, 0.025, axis=0), atol=1e-12)
    np.testing.assert_allclose(profile.high, np.quantile(shares, 0.975, axis=0), atol=1e-12)


@pytest.mark.parametrize(("x", "y"), [(MANY, ONE), (ONE, MANY), (MANY, MANY)], ids=["xy", "yx", "xx"])
def test_improvement_is_the_share_of_better_pairs_in_resamples_written_out(x: np.ndarray, y: np.ndarray) -> None:
    draws = Draws(EPISODES, 6, resamples=20)
    found = Scores(x, draws).improvement(Scores(y, draws))

    def share(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.mean([(p < q) + 0.5 * (p == q) for p in a for q in b]))

    assert found.value == pytest.approx(share(x.ravel(), y.ravel()))
    by_hand = [share(a, b) for a, b in zip(resamples(draws, x), resamples(draws, y), strict=True)]
    np.testing.assert_allclose(found.resampled, by_hand, rtol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 8, 9, 256])
def test_interquartile_mean_cuts_a_quarter_rounded_down_at_either_end(n: int) -> None:
    # On 0, 1, ..., n - 1 in any order it is the middle, as of any symmetric set.
    assert interquartile_mean(np.random.default_rng(n).permutation(n)) == pytest.approx((n - 1) / 2)
    squares = np.arange(n, dtype=np.float64) ** 2
    assert interquartile_mean(squares) == pytest.approx(trimmed(squares, 0.25))
    assert Scores(squares, Draws(n, 0, 3)).statistics()[0].value == pytest.approx(trimmed(squares, 0.25))


def test_of_nothing_and_of_other_episodes_there_are_no_statistics() -> None:
    with pytest.raises(ValueError, match="no scores"):
        interquartile_mean([])
    with pytest.raises(ValueError, match="no scores"):
        Scores(np.zeros((0, 4)), Draws(4, 0))
    with pytest.raises(ValueError, match="5 episodes, but 4 are drawn"):
        Scores(np.zeros(5), Draws(4, 0))


def test_interval_of_a_mean_has_the_width_that_theory_gives() -> None:
    scores = np.random.default_rng(1).normal(3.0, 2.0, size=400)
    value, low, high = Scores(scores, Draws(400, 0)).statistics(cut=0.0)[0].estimate()
    half = 1.96 * scores.std() / math.sqrt(400)
    assert value == pytest.approx(scores.mean())
    assert value - low == pytest.approx(half, rel=0.12)
    assert high - value == pytest.approx(half, rel=0.12)


def test_intervals_hold_for_other_training_seeds_too() -> None:
    # Seeds differ by far more than episodes: the interval is as wide as of a mean over four seeds, not over 400 scores.
    seeds = np.array([0.0, 1.0, 2.0, 3.0])
    scores = seeds[:, None] + 0.01 * np.random.default_rng(2).normal(size=(4, 100))
    _, low, high = Scores(scores, Draws(100, 0)).statistics(cut=0.0)[0].estimate()
    assert 0.5 * (high - low) == pytest.approx(1.96 * seeds.std() / 2.0, rel=0.15)


def test_intervals_cover_the_truth_about_as_often_as_they_say() -> None:
    rng = np.random.default_rng(2)
    # A shifted Laplace distribution is symmetric: its interquartile mean is its centre.
    hits = []
    for trial in range(200):
        mean, _, _ = Scores(rng.laplace(5.0, size=60), Draws(60, trial, 300)).statistics()
        _, low, high = mean.estimate()
        hits.append(low <= 5.0 <= high)
    assert 0.89 <= np.mean(hits) <= 0.99


def test_improvement_of_equals_is_a_half_and_of_separate_scores_is_certain() -> None:
    draws = Draws(5, 0, 100)

    def estimate(x: np.ndarray, y: np.ndarray) -> Estimate:
        return Scores(x, draws).improvement(Scores(y, draws)).estimate()

    assert estimate(np.ones(5), np.ones(5)) == Estimate(0.5, 0.5, 0.5)
    assert estimate(np.arange(5), np.arange(5) + 10) == Estimate(1.0, 1.0, 1.0)


def test_ratios_make_use_of_the_pairing() -> None:
    # Twice another's score in every episode: the ratio is known exactly, however much the episodes differ.
    draws = Draws(EPISODES, 0)
    mean, twice = (Scores(factor * ONE, draws).statistics()[0] for factor in (1.0, 2.0))
    value, low, high = twice.over(mean).estimate()
    assert (value, low, high) == pytest.approx((2.0, 2.0, 2.0))
    assert mean.estimate().high > 1.05 * mean.value
    nothing = mean.over(Sample(0.0, np.zeros(draws.resamples))).estimate()
    assert all(math.isnan(number) for number in nothing)


def test_resamples_are_deterministic_by_seed_whatever_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    def all_of(seed: int) -> list[np.ndarray]:
        draws = Draws(EPISODES, seed, 60)
        mean, p95, _ = Scores(MANY, draws).statistics()
        return [mean.resampled, p95.resampled, Scores(MANY, draws).improvement(Scores(ONE, draws)).resampled]

    whole = all_of(7)
    assert (whole[0] != all_of(8)[0]).any()
    monkeypatch.setattr("uvms_gym.studies.comparison.statistics._CHUNK", 333)
    for one, other in zip(whole, all_of(7), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
