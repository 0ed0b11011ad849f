"""Chance: counter-based random numbers that depend on nothing but their address.

A draw is addressed by (seed of the row, episode since seeding, stream, step within the episode,
index), so it is the same whatever the batch size, the threads or the actions. Logarithm, sine and
cosine are computed here from their series: no mathematical library of the machine has a say in the
sea, and the same address gives the same bits alone and in a batch. Every function takes plain numbers or
lanes of them (`heave_env.lanes`); in single precision the words are the same and the series shorter.

Source: Salmon et al. (2011), Philox4x32-10; Box and Muller (1958).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from heave_env.compiled import stage
from heave_env.lanes import (
    constant,
    exponent_of,
    floor,
    fused,
    is_single,
    low_halves,
    mantissa_of,
    signed_float,
    square_root,
    unsigned_float,
    where,
)

SEA, SENSORS, INITIAL, PARAMETERS = 0, 1, 2, 3
"""Streams: what the waves do, what the sensors add, where an episode begins, which plant it meets."""

_WORD = 0xFFFFFFFF
_MULTIPLIER_0, _MULTIPLIER_1 = 0xD2511F53, 0xCD9E8D57
_WEYL_0, _WEYL_1 = 0x9E3779B9, 0xBB67AE85
_STREAM_SHIFT = 24
_LN2 = math.log(2.0)


@stage
def philox(seed, episode, stream, step, index):
    """Four independent 32-bit words at an address: lanes of 32 bits, plain numbers as uint64."""
    word, half_word = constant(seed, _WORD), constant(seed, 32)
    multiplier_0, multiplier_1 = constant(seed, _MULTIPLIER_0), constant(seed, _MULTIPLIER_1)
    weyl_0, weyl_1 = constant(seed, _WEYL_0), constant(seed, _WEYL_1)
    k0, k1 = seed, seed >> half_word
    c0, c1 = step, episode
    c2, c3 = (stream << constant(seed, _STREAM_SHIFT)) | index, step >> half_word
    # Only the low halves mean anything; the high ones are cut off where a product would see them.
    for _ in range(10):
        p0, p1 = multiplier_0 * (c0 & word), multiplier_1 * (c2 & word)
        c0, c1, c2, c3 = (p1 >> half_word) ^ c1 ^ k0, p1, (p0 >> half_word) ^ c3 ^ k1, p0
        k0, k1 = k0 + weyl_0, k1 + weyl_1
    return low_halves(c0), low_halves(c1), low_halves(c2), low_halves(c3)


@stage
def uniform(like, word):
    """A number in (0, 1) from a 32-bit word, in the precision of `like`; 1 itself only if that is single."""
    number = unsigned_float(like, word)
    return (number + constant(number, 0.5)) * constant(number, 2.0**-32)


@njit(error_model="numpy")
def uniform_number(seed, episode, stream, index):
    """A number in (0, 1) at an address, outside any step."""
    a, _, _, _ = philox(
        np.uint64(seed), np.uint64(episode), np.uint64(stream), np.uint64(0), np.uint64(index)
    )
    return uniform(0.0, a)


@stage
def logarithm(x):
    """ln x of a positive normal number, within 2 ulp.

    In double precision ln m = 2 artanh((m-1)/(m+1)). In single precision, to spare the division, a polynomial
    P of least error in ln(1 + f) = f - f²/2 + f³ P(f).
    """
    one = constant(x, 1.0)
    exponent, mantissa = exponent_of(x), mantissa_of(x)
    large = mantissa > constant(x, 1.4142135623730951)
    mantissa = where(large, constant(x, 0.5) * mantissa, mantissa)
    exponent = where(large, exponent + one, exponent)
    if is_single(x):
        f = mantissa - one
        q = f * f
        series = constant(x, 0.08700419477239163)
        series = fused(series, f, constant(x, -0.14267489005257603))
        series = fused(series, f, constant(x, 0.14914772906245047))
        series = fused(series, f, constant(x, -0.16577584160466374))
        series = fused(series, f, constant(x, 0.19963063397935152))
        series = fused(series, f, constant(x, -0.2500133707331955))
        series = fused(series, f, constant(x, 0.33333910743645695))
        result = fused(f * q, series, fused(constant(x, -0.5), q, f))
    else:
        s = (mantissa - one) / (mantissa + one)
        q = s * s
        series = constant(x, 1.0 / 21.0)
        series = fused(series, q, constant(x, 1.0 / 19.0))
        series = fused(series, q, constant(x, 1.0 / 17.0))
        series = fused(series, q, constant(x, 1.0 / 15.0))
        series = fused(series, q, constant(x, 1.0 / 13.0))
        series = fused(series, q, constant(x, 1.0 / 11.0))
        series = fused(series, q, constant(x, 1.0 / 9.0))
        series = fused(series, q, constant(x, 1.0 / 7.0))
        series = fused(series, q, constant(x, 1.0 / 5.0))
        series = fused(series, q, constant(x, 1.0 / 3.0))
        s = s + s
        result = fused(s * q, series, s)
    return fused(exponent, constant(x, _LN2), result)


@stage
def _near_zero(x):
    """cos and sin of an angle within ±π/4 [rad]."""
    one = constant(x, 1.0)
    q = x * x
    if is_single(x):
        c = constant(x, 1.0 / -3628800.0)
        s = constant(x, 1.0 / 362880.0)
    else:
        c = constant(x, 1.0 / 20922789888000.0)
        c = fused(q, c, constant(x, 1.0 / -87178291200.0))
        c = fused(q, c, constant(x, 1.0 / 479001600.0))
        c = fused(q, c, constant(x, 1.0 / -3628800.0))
        s = constant(x, 1.0 / -1307674368000.0)
        s = fused(q, s, constant(x, 1.0 / 6227020800.0))
        s = fused(q, s, constant(x, 1.0 / -39916800.0))
        s = fused(q, s, constant(x, 1.0 / 362880.0))
    c = fused(q, c, constant(x, 1.0 / 40320.0))
    c = fused(q, c, constant(x, 1.0 / -720.0))
    c = fused(q, c, constant(x, 1.0 / 24.0))
    c = fused(q, fused(q, c, constant(x, -0.5)), one)
    s = fused(q, s, constant(x, 1.0 / -5040.0))
    s = fused(q, s, constant(x, 1.0 / 120.0))
    s = fused(q, s, constant(x, -1.0 / 6.0))
    return c, fused(x * q, s, x)


@stage
def _turned_by_quarters(cosine, sine, quarters):
    """cos and sin of an angle that is larger by so many quarters of a turn, 0 to 3, uint64."""
    one, two = constant(quarters, 1), constant(quarters, 2)
    odd = (quarters & one) == one
    c, s = where(odd, sine, cosine), where(odd, cosine, sine)
    c = where(((quarters + one) & two) == two, -c, c)
    return c, where((quarters & two) == two, -s, s)


@stage
def cosine_sine_of_turns(turns):
    """cos and sin of 2π `turns`, any finite number of turns, float64, within 1e-15."""
    quarter = floor(4.0 * turns + 0.5)
    c, s = _near_zero((turns - 0.25 * quarter) * (2.0 * math.pi))
    return _turned_by_quarters(c, s, np.uint64(np.int64(quarter) & 3))


@stage
def normal_pair(like, word_a, word_b):
    """Two independent standard normal numbers from two 32-bit words, in the precision of `like`."""
    u = uniform(like, word_a)
    radius = square_root(constant(u, -2.0) * logarithm(u))
    # The angle is (word + 1/2) 2⁻³² turns; the quarter nearest to it is split off in whole numbers.
    quarters = (word_b + constant(word_b, 1 << 29)) >> constant(word_b, 30)
    rest = signed_float(like, word_b - (quarters << constant(word_b, 30)))
    angle = (rest + constant(rest, 0.5)) * constant(rest, 2.0 * math.pi * 2.0**-32)
    c, s = _near_zero(angle)
    c, s = _turned_by_quarters(c, s, quarters & constant(quarters, 3))
    return radius * c, radius * s
