"""What a referee asks of a comparison: robust averages, intervals over seas and trainings, who beats whom.

Scores are one number per training seed and sea, (n_trainings, n_seas); a designed controller has one row.
Lower is better: a score is a cost, or its ratio to another controller's in the same sea.

Intervals are percentile bootstraps in which seas and trainings are drawn anew with replacement, each by
itself, since both are samples: the next user meets other seas and trains with other seeds. All scores that
are compared are drawn alike sea by sea (they are paired); trainings are drawn for each agent by itself. Where
several scenarios are pooled, each is a stratum of its own.

Source: Agarwal et al. (2021), for the interquartile mean, the probability of improvement, performance
profiles and the stratified bootstrap, which draws trainings alone; Owen (2007), for drawing both.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import trim_mean

from experiments.metrics import CONFIDENCE

Array = np.ndarray
Statistic = Callable[[Sequence[Array]], float]
"""Takes the scores of those compared, each (n_trainings, n_seas), and returns one number."""

N_RESAMPLES = 2000
"""Resamples of a bootstrap [-]."""


@dataclass(frozen=True)
class Estimate:
    """A statistic and its interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: Array) -> float:
    """Mean of the middle half of all scores: a quarter is left out at either end.

    Raises:
        ValueError: If there are no scores or one is not finite.
    """
    return float(trim_mean(_checked(scores), 0.25, axis=None))


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
    below = (ours[:, None] < theirs[None]).mean()
    equal = (ours[:, None] == theirs[None]).mean()
    return float(below + 0.5 * equal)


def performance_profile(scores: Array, thresholds: Array) -> Array:
    """Share of all scores that are at or below each threshold, (n_thresholds,)."""
    ordered = np.sort(_checked(scores), axis=None)
    return np.asarray(np.searchsorted(ordered, np.asarray(thresholds), side="right") / len(ordered))


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
    rng = np.random.default_rng(seed)
    draws = np.empty(n_resamples)
    for i in range(n_resamples):
        draws[i] = np.mean([statistic(_resampled(stratum, rng)) for stratum in checked])
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(draws, [tail, 1.0 - tail])
    value = float(np.mean([statistic(stratum) for stratum in checked]))
    return Estimate(value, float(low), float(high))


def mean_ratio(scores: Sequence[Array]) -> float:
    """Mean of the first over the mean of the second."""
    ours, theirs = scores
    return float(ours.mean() / theirs.mean())


def mean_difference(scores: Sequence[Array]) -> float:
    """Mean of the first less the mean of the second."""
    ours, theirs = scores
    return float(ours.mean() - theirs.mean())


def _resampled(stratum: Sequence[Array], rng: np.random.Generator) -> list[Array]:
    seas = rng.integers(stratum[0].shape[1], size=stratum[0].shape[1])
    return [scores[np.ix_(rng.integers(len(scores), size=len(scores)), seas)] for scores in stratum]


def _checked(scores: Array) -> Array:
    scores = np.atleast_2d(np.asarray(scores, dtype=float))
    if scores.ndim != 2 or scores.size == 0:
        raise ValueError(f"scores must be (n_trainings, n_seas), got shape {scores.shape}")
    if not np.isfinite(scores).all():
        raise ValueError(
            "scores must be finite: give a sea that failed the cost that the task charges for a failure"
        )
    return scores
