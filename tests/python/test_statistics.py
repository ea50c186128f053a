import math

import numpy as np
import pytest

from uvms_gym.cli.statistics import Estimate, bootstrap, improvement_probability, interquartile_mean


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 8, 9, 256])
def test_interquartile_mean_cuts_a_quarter_rounded_down_at_either_end(n: int) -> None:
    # On 0, 1, ..., n - 1 in any order it is the middle, as of any symmetric set.
    assert interquartile_mean(np.random.default_rng(n).permutation(n)) == pytest.approx((n - 1) / 2)
    # On squares it is what scipy.stats.trim_mean(x, 0.25) is: the mean over the middle n - 2 floor(n / 4).
    cut = n // 4
    middle = [i * i for i in range(cut, n - cut)]
    assert interquartile_mean([i * i for i in range(n)]) == pytest.approx(math.fsum(middle) / len(middle))


def test_interquartile_mean_ignores_outliers_and_keeps_leading_axes() -> None:
    scores = np.array([[1.0, 2.0, 3.0, 1e9], [-1e9, 4.0, 5.0, 6.0]])
    assert interquartile_mean(scores).tolist() == [2.5, 4.5]


def test_interquartile_mean_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="no scores"):
        interquartile_mean([])


def test_bootstrap_interval_of_a_mean_has_the_width_that_theory_gives() -> None:
    scores = np.random.default_rng(1).normal(3.0, 2.0, size=400)
    estimate = bootstrap([scores], 0, statistic=lambda x: x.mean(axis=-1))
    half = 1.96 * scores.std() / math.sqrt(400)
    assert estimate.value == pytest.approx(scores.mean())
    assert estimate.value - estimate.low == pytest.approx(half, rel=0.1)
    assert estimate.high - estimate.value == pytest.approx(half, rel=0.1)


def test_bootstrap_covers_the_truth_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    # A shifted Laplace distribution is symmetric: its interquartile mean is its centre.
    hits = [
        low <= 5.0 <= high
        for trial in range(200)
        for _, low, high in [bootstrap([rng.laplace(5.0, size=60)], trial, resamples=300)]
    ]
    assert 0.89 <= np.mean(hits) <= 0.99


def test_bootstrap_resamples_within_strata() -> None:
    # Two strata without spread of their own: whatever is drawn, half the scores are 0 and half are 10.
    assert bootstrap([np.zeros(8), np.full(8, 10.0)], 3) == Estimate(5.0, 5.0, 5.0)


def test_bootstrap_is_deterministic_by_seed_whatever_the_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = [np.random.default_rng(3).random(50)]
    assert bootstrap(scores, 7) == bootstrap(scores, 7)
    assert bootstrap(scores, 7) != bootstrap(scores, 8)
    whole = bootstrap(scores, 7)
    monkeypatch.setattr("uvms_gym.cli.statistics._CHUNK", 333)
    assert bootstrap(scores, 7) == whole


def test_improvement_probability_is_the_share_of_better_pairs() -> None:
    rng = np.random.default_rng(4)
    x, y = rng.integers(0, 9, size=31), rng.integers(2, 12, size=17)
    by_hand = np.mean([(a < b) + 0.5 * (a == b) for a in x for b in y])
    estimate = improvement_probability([(x, y)], 0)
    assert estimate.value == pytest.approx(by_hand)
    assert estimate.low < by_hand < estimate.high
    other = improvement_probability([(y, x)], 0)
    assert other.value == pytest.approx(1.0 - by_hand)


def test_improvement_probability_of_equals_is_a_half_and_of_separate_scores_is_certain() -> None:
    assert improvement_probability([(np.ones(5), np.ones(6))], 0) == Estimate(0.5, 0.5, 0.5)
    assert improvement_probability([(np.arange(5), np.arange(5) + 10)], 0) == Estimate(1.0, 1.0, 1.0)


def test_improvement_probability_averages_over_tasks() -> None:
    certain, impossible = (np.zeros(4), np.ones(4)), (np.ones(4), np.zeros(4))
    assert improvement_probability([certain, impossible], 0) == Estimate(0.5, 0.5, 0.5)


def test_improvement_interval_has_the_width_that_theory_gives() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.normal(size=200), rng.normal(size=200)
    estimate = improvement_probability([(x, y)], 0)
    # The variance of the Mann-Whitney share of two like samples is (n + m + 1) / (12 n m).
    half = 1.96 * math.sqrt(401 / (12 * 200 * 200))
    assert 0.5 * (estimate.high - estimate.low) == pytest.approx(half, rel=0.12)
