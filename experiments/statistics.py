"""What a referee asks of a comparison: robust averages, intervals over seas and trainings, who beats whom.

Scores are one number per training seed and sea, (n_trainings, n_seas); a designed controller has one row.
Lower is better: a score is a cost, or its ratio to another controller's in the same sea.

Intervals are percentile bootstraps in which seas and trainings are drawn anew with replacement, each by
itself, since both are samples: the next user meets other seas and trains with other seeds. All scores that
are compared are drawn alike sea by sea (they are paired); trainings are drawn for each agent by itself. Where
several scenarios are pooled, each is a stratum of its own.

A resample is told by how often it has each sea and each training, so that a statistic of thousands of them is
a few products of matrices.

Source: Agarwal et al. (2021), for the interquartile mean, the probability of improvement, performance
profiles and the stratified bootstrap, which draws trainings alone; Owen (2007), for drawing both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from experiments.metrics import CONFIDENCE

Array = np.ndarray

N_RESAMPLES = 2000
"""Resamples of a bootstrap [-]."""


@dataclass(frozen=True)
class Estimate:
    """A statistic and its interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Resamples:
    """How often each sea and each training was drawn, of as many draws as there are of them."""

    seas: Array
    """(n_resamples, n_seas)."""
    trainings: tuple[Array, ...]
    """Of each of those compared, (n_resamples, n_trainings)."""


Statistic = Callable[[Sequence[Array], Resamples], Array]
"""Takes the scores of those compared, each (n_trainings, n_seas), and returns a number per resample."""


# Statistics of resamples -------------------------------------------------------------------------


def mean(scores: Sequence[Array], drawn: Resamples, which: int = 0) -> Array:
    """Mean of the first (or another) of those compared, (n_resamples,)."""
    trainings = drawn.trainings[which]
    total = (trainings * (drawn.seas @ scores[which].T)).sum(axis=1)
    return np.asarray(total / scores[which].size)


def mean_ratio(scores: Sequence[Array], drawn: Resamples) -> Array:
    """Mean of the first over the mean of the second, (n_resamples,)."""
    return mean(scores, drawn, 0) / mean(scores, drawn, 1)


def mean_difference(scores: Sequence[Array], drawn: Resamples) -> Array:
    """Mean of the first less the mean of the second, (n_resamples,)."""
    return mean(scores, drawn, 0) - mean(scores, drawn, 1)


def middle_mean(scores: Sequence[Array], drawn: Resamples) -> Array:
    """Interquartile mean of the first, (n_resamples,)."""
    order = np.argsort(scores[0], axis=None)
    counts = (drawn.trainings[0][:, :, None] * drawn.seas[:, None, :]).reshape(len(drawn.seas), -1)
    reached = np.cumsum(counts[:, order], axis=1)
    cut = np.floor(0.25 * reached[:, -1:])
    inside = np.clip(reached, cut, reached[:, -1:] - cut)
    kept = np.diff(inside, axis=1, prepend=cut)
    return np.asarray(kept @ scores[0].ravel()[order] / kept.sum(axis=1))


def improvement(scores: Sequence[Array], drawn: Resamples) -> Array:
    """Probability that the first is below the second, (n_resamples,)."""
    ours, theirs = scores
    first, second = drawn.trainings
    below = (ours[:, None] < theirs[None]) + 0.5 * (ours[:, None] == theirs[None])
    won = np.zeros(len(drawn.seas))
    for j in range(len(theirs)):
        won += second[:, j] * (first * (drawn.seas @ below[:, j].T)).sum(axis=1)
    return np.asarray(won / below.size)


# What they say of the scores as they are ---------------------------------------------------------


def interquartile_mean(scores: Array) -> float:
    """Mean of the middle half of all scores: a quarter is left out at either end.

    Raises:
        ValueError: If there are no scores or one is not finite.
    """
    scores = _checked(scores)
    return float(middle_mean([scores], _as_they_are([scores]))[0])


def probability_of_improvement(ours: Array, theirs: Array) -> float:
    """How likely a training of ours is below one of theirs in a sea of chance; ties count half.

    Args:
        ours: (n_trainings, n_seas).
        theirs: (n_their_trainings, n_seas), in the same seas.

    Raises:
        ValueError: If the seas are not the same number, or a score is not finite.
    """
    ours, theirs = _checked(ours), _checked(theirs)
    if ours.shape[1] != theirs.shape[1]:
        raise ValueError(
            f"both must have been scored in the same seas, got {ours.shape[1]} and {theirs.shape[1]}"
        )
    return float(improvement([ours, theirs], _as_they_are([ours, theirs]))[0])


def performance_profile(scores: Array, thresholds: Array) -> Array:
    """Share of all scores that are at or below each threshold, (n_thresholds,)."""
    ordered = np.sort(_checked(scores), axis=None)
    return np.asarray(np.searchsorted(ordered, np.asarray(thresholds), side="right") / len(ordered))


# Intervals ---------------------------------------------------------------------------------------


def bootstrap(
    statistic: Statistic,
    strata: Sequence[Sequence[Array]],
    *,
    n_resamples: int = N_RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> Estimate:
    """A statistic of paired scores with its interval.

    Args:
        statistic: What is wanted, of one stratum; over several strata it is averaged.
        strata: By scenario, the scores of those compared, each (n_trainings, n_seas) over the same seas.
        n_resamples: Resamples [-].
        confidence: Level of the interval [-].
        seed: Of the resampling.

    Raises:
        ValueError: If there is nothing to compare, a score is not finite, or seas do not match.
    """
    if not strata or not all(strata):
        raise ValueError("a bootstrap wants at least one scenario with at least one array of scores")
    checked = [[_checked(scores) for scores in stratum] for stratum in strata]
    for stratum in checked:
        if len({scores.shape[1] for scores in stratum}) > 1:
            raise ValueError("scores that are compared must be of the same seas, one column per sea")
    if n_resamples < 1 or not 0.0 < confidence < 1.0:
        raise ValueError(
            "n_resamples must be positive and confidence between 0 and 1, got "
            f"{n_resamples!r} and {confidence!r}"
        )
    draws = np.zeros(n_resamples)
    value = 0.0
    for i, stratum in enumerate(checked):
        draws += statistic(stratum, _resamples(stratum, n_resamples, (seed, i))) / len(checked)
        value += float(statistic(stratum, _as_they_are(stratum))[0]) / len(checked)
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    return Estimate(value, float(low), float(high))


def profile_band(
    strata: Sequence[Array],
    thresholds: Array,
    *,
    n_resamples: int = N_RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = 0,
) -> tuple[Array, Array, Array]:
    """A performance profile over several scenarios, each counting alike, with its pointwise interval.

    Args:
        strata: By scenario, the scores of one contestant, (n_trainings, n_seas).
        thresholds: Scores, (n_thresholds,).
        n_resamples: Resamples [-].
        confidence: Level of the interval [-].
        seed: Of the resampling.

    Returns:
        Share of the scores at or below each threshold [-] and the ends of its interval, each (n_thresholds,).

    Raises:
        ValueError: If there are no scores or one is not finite.
    """
    if not strata:
        raise ValueError("a performance profile wants the scores of at least one scenario")
    thresholds = np.asarray(thresholds, dtype=float)
    value, draws = np.zeros(len(thresholds)), np.zeros((n_resamples, len(thresholds)))
    for i, stratum in enumerate(strata):
        scores = _checked(stratum)
        value += performance_profile(scores, thresholds) / len(strata)
        drawn = _resamples([scores], n_resamples, (seed, i))
        for training, counts in zip(scores, drawn.trainings[0].T, strict=True):
            below = (training[:, None] <= thresholds).astype(float)
            draws += counts[:, None] * (drawn.seas @ below) / (scores.size * len(strata))
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(draws, [tail, 1.0 - tail], axis=0)
    return value, low, high


def _as_they_are(stratum: Sequence[Array]) -> Resamples:
    return Resamples(
        np.ones((1, stratum[0].shape[1])), tuple(np.ones((1, len(scores))) for scores in stratum)
    )


def _resamples(stratum: Sequence[Array], n_resamples: int, seed: tuple[int, ...]) -> Resamples:
    # Seas and each one's trainings have seeds of their own: whoever is compared, the seas are drawn alike.
    trainings = (_counts(len(scores), n_resamples, (*seed, 1 + i)) for i, scores in enumerate(stratum))
    return Resamples(_counts(stratum[0].shape[1], n_resamples, (*seed, 0)), tuple(trainings))


@lru_cache(maxsize=64)
def _counts(n: int, n_resamples: int, seed: tuple[int, ...]) -> Array:
    """How often each of n was drawn in n draws with replacement, (n_resamples, n)."""
    if n == 1:
        return np.ones((n_resamples, 1))
    drawn = np.random.default_rng(seed).integers(n, size=(n_resamples, n))
    drawn += n * np.arange(n_resamples)[:, None]
    counts = np.bincount(drawn.ravel(), minlength=n * n_resamples).reshape(n_resamples, n).astype(float)
    counts.flags.writeable = False
    return counts


def _checked(scores: Array) -> Array:
    scores = np.atleast_2d(np.asarray(scores, dtype=float))
    if scores.ndim != 2 or scores.size == 0:
        raise ValueError(f"scores must be (n_trainings, n_seas), got shape {scores.shape}")
    if not np.isfinite(scores).all():
        raise ValueError(
            "scores must be finite: give a sea that failed the cost that the task charges for a failure"
        )
    return scores
