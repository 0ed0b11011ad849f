"""Counter-based random numbers: the published generator, its moments, and its own elementary functions."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import stats

from heave_env.streams import cosine_sine_of_turns, logarithm, normal_pair, philox, uniform


@njit
def words(seed, episode, stream, step, index):
    return philox(seed, episode, stream, step, index)


@njit
def normals(seed, n):
    out = np.empty(4 * n)
    for i in range(n):
        a, b, c, d = philox(seed, np.uint64(0), np.uint64(0), np.uint64(i), np.uint64(0))
        out[4 * i], out[4 * i + 1] = normal_pair(0.0, a, b)
        out[4 * i + 2], out[4 * i + 3] = normal_pair(0.0, c, d)
    return out


@njit
def logarithms(x):
    return np.array([logarithm(value) for value in x])


@njit
def turns(x):
    return [cosine_sine_of_turns(value) for value in x]


@njit
def uniform_of(word):
    return uniform(0.0, word)


def test_philox_gives_the_published_words():
    # Known answers of Philox4x32-10 in Random123 (Salmon et al. 2011): zero key, zero counter.
    zero = np.uint64(0)
    assert [int(w) for w in words(zero, zero, zero, zero, zero)] == [
        0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8,
    ]  # fmt: skip


def test_normals_are_standard_and_independent():
    z = normals(np.uint64(7), 50_000)
    assert stats.kstest(z, "norm").pvalue > 1e-3
    pairs = np.corrcoef(z.reshape(-1, 4).T)
    assert np.abs(pairs - np.eye(4)).max() < 0.02
    assert abs(np.corrcoef(z[:-4], z[4:])[0, 1]) < 0.01


def test_every_part_of_the_address_matters():
    base = (1, 2, 0, 3, 0)
    seen = {words(*(np.uint64(v) for v in base))}
    for place in range(5):
        moved = list(base)
        moved[place] += 1
        seen.add(words(*(np.uint64(v) for v in moved)))
    seen.add(words(np.uint64(1 + 2**32), *(np.uint64(v) for v in base[1:])))
    assert len(seen) == 7


def test_uniform_numbers_never_reach_the_ends():
    assert 0.0 < uniform_of(np.uint64(0)) < uniform_of(np.uint64(0xFFFFFFFF)) < 1.0


def test_logarithm_is_the_logarithm():
    x = np.concatenate([np.geomspace(2.0**-33, 1.0, 5001), 1.0 - np.geomspace(1e-10, 0.5, 500)])
    assert np.abs(logarithms(x) - np.log(x)).max() < 1e-14


def test_cosine_and_sine_of_turns():
    x = np.linspace(-3.0, 60.0, 9001)
    ours = np.array(turns(x))
    # The reference loses digits in 2 pi x itself: 1e-13 at 60 turns.
    assert np.abs(ours[:, 0] - np.cos(2.0 * np.pi * x)).max() < 2e-13
    assert np.abs(ours[:, 1] - np.sin(2.0 * np.pi * x)).max() < 2e-13
