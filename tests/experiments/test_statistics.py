"""The comparison's statistics against their definitions, and their intervals against chance."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.stats import norm, trim_mean

from experiments.statistics import (
    Resamples,
    bootstrap,
    improvement,
    interquartile_mean,
    mean,
    mean_difference,
    mean_ratio,
    middle_mean,
    performance_profile,
    probability_of_improvement,
    profile_band,
)


def test_the_interquartile_mean_leaves_out_a_quarter_at_either_end():
    scores = np.array([[100.0, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, -50.0]])
    assert interquartile_mean(scores) == pytest.approx((2.0 + 3.0 + 4.0 + 5.0) / 4.0)
    assert interquartile_mean(np.full((2, 3), 7.0)) == 7.0
    rng = np.random.default_rng(0)
    assert interquartile_mean(rng.normal(3.0, 1.0, (4, 20_000))) == pytest.approx(3.0, abs=0.02)


def test_the_probability_of_improvement_counts_every_pair():
    rng = np.random.default_rng(1)
    ours, theirs = rng.integers(0, 4, (3, 5)).astype(float), rng.integers(0, 4, (2, 5)).astype(float)
    counted = [
        (ours[i, k] < theirs[j, k]) + 0.5 * (ours[i, k] == theirs[j, k])
        for i, j, k in product(range(3), range(2), range(5))
    ]
    assert probability_of_improvement(ours, theirs) == pytest.approx(np.mean(counted))
    assert probability_of_improvement(ours, theirs) + probability_of_improvement(theirs, ours) == 1.0
    shifted = rng.normal(0.0, 1.0, (1, 50_000))
    better = probability_of_improvement(rng.normal(-1.0, 1.0, (1, 50_000)), shifted)
    assert better == pytest.approx(norm.cdf(1.0 / np.sqrt(2.0)), abs=0.01)


def test_a_performance_profile_is_the_distribution():
    scores = np.array([[1.0, 2.0], [3.0, 4.0]])
    shares = performance_profile(scores, np.array([0.5, 1.0, 2.5, 4.0]))
    np.testing.assert_allclose(shares, [0.0, 0.25, 0.5, 1.0])


def test_a_profile_over_scenarios_counts_each_alike_and_its_band_is_the_bootstraps():
    rng = np.random.default_rng(4)
    strata = [rng.uniform(0.0, 2.0, (3, 7)), rng.uniform(0.5, 1.5, (1, 30))]
    thresholds = np.array([0.6, 1.0, 1.9])
    value, low, high = profile_band(strata, thresholds, n_resamples=400)
    counted = [np.mean([np.mean(part <= at) for part in strata]) for at in thresholds]
    np.testing.assert_allclose(value, counted)
    for i, at in enumerate(thresholds):

        def share(scores, drawn, at=at):
            return mean([(scores[0] <= at).astype(float)], drawn)

        found = bootstrap(share, [[part] for part in strata], n_resamples=400)
        assert (found.value, found.low, found.high) == pytest.approx((value[i], low[i], high[i]))
    with pytest.raises(ValueError, match="at least one scenario"):
        profile_band([], thresholds)


def test_an_interval_covers_the_truth_as_often_as_it_says():
    """Scores with noise of the sea, of the training, and of both: 95 % intervals cover in about 95 of 100."""
    rng = np.random.default_rng(2)
    covered = 0
    for trial in range(100):
        sea = rng.normal(0.0, 1.0, (1, 60))
        theirs = 10.0 + sea + rng.normal(0.0, 0.2, (1, 60))
        ours = 9.0 + sea + rng.normal(0.0, 0.3, (8, 1)) + rng.normal(0.0, 0.2, (8, 60))
        found = bootstrap(mean_difference, [[ours, theirs]], n_resamples=300, seed=trial)
        covered += found.low <= -1.0 <= found.high
    # Eight trainings are few: a percentile bootstrap is somewhat narrow.
    assert 84 <= covered <= 99


def test_pairing_takes_the_sea_out_of_the_interval():
    rng = np.random.default_rng(3)
    sea = rng.normal(0.0, 5.0, (1, 200))
    ours, theirs = 1.0 + sea, 2.0 + sea + rng.normal(0.0, 0.01, (1, 200))
    paired = bootstrap(mean_difference, [[ours, theirs]], n_resamples=200)
    assert paired.low < -1.0 + 0.01 and paired.high > -1.0 - 0.01
    assert paired.high - paired.low < 0.01
    shuffled = bootstrap(mean_difference, [[ours, rng.permuted(theirs, axis=1)]], n_resamples=200)
    assert shuffled.high - shuffled.low > 1.0


def test_strata_are_averaged_each_by_itself():
    one, other = [np.full((1, 5), 2.0), np.full((1, 5), 4.0)], [np.full((1, 9), 3.0), np.full((1, 9), 4.0)]
    found = bootstrap(mean_ratio, [one, other], n_resamples=10)
    assert found.value == found.low == found.high == pytest.approx(0.5 * (0.5 + 0.75))


def test_the_same_seed_gives_the_same_interval():
    scores = [[np.random.default_rng(4).normal(0.0, 1.0, (2, 30)), np.zeros((1, 30))]]
    assert bootstrap(mean_difference, scores, n_resamples=50) == bootstrap(
        mean_difference, scores, n_resamples=50
    )
    assert bootstrap(mean_difference, scores, n_resamples=50, seed=1) != bootstrap(
        mean_difference, scores, n_resamples=50
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: interquartile_mean(np.array([[1.0, np.nan]])), "scores must be finite"),
        (lambda: interquartile_mean(np.zeros((0, 3))), "n_trainings, n_seas"),
        (lambda: probability_of_improvement(np.zeros((1, 3)), np.zeros((1, 4))), "same seas"),
        (lambda: bootstrap(mean_ratio, []), "at least one scenario"),
        (lambda: bootstrap(mean_ratio, [[np.ones((1, 3)), np.ones((1, 4))]]), "same seas"),
        (
            lambda: bootstrap(mean_ratio, [[np.ones((1, 3))] * 2], confidence=1.0),
            "confidence between 0 and 1",
        ),
    ],
)
def test_what_cannot_be_compared_is_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_statistics_of_resamples_are_those_of_the_scores_drawn():
    """Counting how often a sea and a training are drawn is the same as drawing them."""
    rng = np.random.default_rng(6)
    ours, theirs = rng.integers(0, 9, (3, 7)).astype(float), rng.integers(0, 9, (2, 7)).astype(float) + 1.0
    seas, first, second = rng.integers(7, size=7), rng.integers(3, size=3), rng.integers(2, size=2)
    drawn = Resamples(
        np.bincount(seas, minlength=7)[None].astype(float),
        tuple(np.bincount(i, minlength=n)[None].astype(float) for i, n in ((first, 3), (second, 2))),
    )
    ours_drawn, theirs_drawn = ours[np.ix_(first, seas)], theirs[np.ix_(second, seas)]
    for statistic, expected in (
        (mean, ours_drawn.mean()),
        (mean_ratio, ours_drawn.mean() / theirs_drawn.mean()),
        (mean_difference, ours_drawn.mean() - theirs_drawn.mean()),
        (middle_mean, trim_mean(ours_drawn, 0.25, axis=None)),
        (improvement, probability_of_improvement(ours_drawn, theirs_drawn)),
    ):
        np.testing.assert_allclose(statistic([ours, theirs], drawn), [expected], rtol=1e-13)


def test_everybody_is_drawn_in_the_same_seas():
    sea = np.arange(1.0, 31.0)[None]
    found = bootstrap(mean_ratio, [[2.0 * sea, sea]], n_resamples=50)
    assert found.low == pytest.approx(2.0) and found.high == pytest.approx(2.0)
    # Whoever is compared with whom, and however many trainings there are.
    several = bootstrap(mean, [[np.repeat(sea, 4, axis=0)]], n_resamples=50)
    alone = bootstrap(mean, [[sea]], n_resamples=50)
    assert (several.low, several.high) == pytest.approx((alone.low, alone.high))
