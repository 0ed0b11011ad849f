"""Chance: counter-based random numbers that depend on nothing but their address.

A draw is addressed by (seed of the row, episode since seeding, stream, step within the episode,
index), so it is the same whatever the batch size, the threads or the actions. Logarithm, sine and
cosine are computed here from their series: no mathematical library of the machine has a say in the
sea, and the same address gives the same bits alone and in a batch.

Source: Salmon et al. (2011), Philox4x32-10; Box and Muller (1958).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from heave_env.compiled import stage

SEA, SENSORS, INITIAL, PARAMETERS = 0, 1, 2, 3
"""Streams: what the waves do, what the sensors add, where an episode begins, which plant it meets."""

_WORD = np.uint64(0xFFFFFFFF)
_HALF_WORD = np.uint64(32)
_MULTIPLIER_0, _MULTIPLIER_1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_WEYL_0, _WEYL_1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_STREAM_SHIFT = np.uint64(24)

_MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
_ONE_BITS = np.uint64(0x3FF0000000000000)
_EXPONENT_SHIFT = np.uint64(52)
_LN2 = math.log(2.0)


@intrinsic
def _bits_of(typing_context, number):
    """The 64 bits of a float64."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.uint64))

    return types.uint64(types.float64), generate


@intrinsic
def _float_of(typing_context, bits):
    """The float64 of 64 bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.float64))

    return types.float64(types.uint64), generate


@stage
def philox(seed, episode, stream, step, index):
    """Four independent 32-bit words at an address, as uint64."""
    k0, k1 = seed & _WORD, seed >> _HALF_WORD
    c0, c1 = step & _WORD, episode & _WORD
    c2, c3 = (stream << _STREAM_SHIFT) | index, step >> _HALF_WORD
    for _ in range(10):
        p0, p1 = _MULTIPLIER_0 * c0, _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = (p1 >> _HALF_WORD) ^ c1 ^ k0, p1 & _WORD, (p0 >> _HALF_WORD) ^ c3 ^ k1, p0 & _WORD
        k0, k1 = (k0 + _WEYL_0) & _WORD, (k1 + _WEYL_1) & _WORD
    return c0, c1, c2, c3


@stage
def uniform(word):
    """A number in (0, 1) from a 32-bit word."""
    return (float(np.int64(word)) + 0.5) * 2.0**-32


@njit(error_model="numpy")
def uniform_number(seed, episode, stream, index):
    """A number in (0, 1) at an address, outside any step."""
    a, _, _, _ = philox(
        np.uint64(seed), np.uint64(episode), np.uint64(stream), np.uint64(0), np.uint64(index)
    )
    return uniform(a)


@stage
def logarithm(x):
    """ln x of a positive normal number, within 2 ulp: ln m = 2 artanh((m-1)/(m+1))."""
    bits = _bits_of(x)
    exponent = np.float64(np.int64(bits >> _EXPONENT_SHIFT) - 1023)
    mantissa = _float_of((bits & _MANTISSA) | _ONE_BITS)
    large = mantissa > 1.4142135623730951
    mantissa = 0.5 * mantissa if large else mantissa
    exponent = exponent + 1.0 if large else exponent
    s = (mantissa - 1.0) / (mantissa + 1.0)
    q = s * s
    series = 1.0 / 21.0
    series = series * q + 1.0 / 19.0
    series = series * q + 1.0 / 17.0
    series = series * q + 1.0 / 15.0
    series = series * q + 1.0 / 13.0
    series = series * q + 1.0 / 11.0
    series = series * q + 1.0 / 9.0
    series = series * q + 1.0 / 7.0
    series = series * q + 1.0 / 5.0
    series = series * q + 1.0 / 3.0
    return exponent * _LN2 + 2.0 * s * (1.0 + q * series)


@stage
def cosine_sine_of_turns(turns):
    """cos and sin of 2π `turns`, any finite number of turns, within 1e-15."""
    quarter = math.floor(4.0 * turns + 0.5)
    x = (turns - 0.25 * quarter) * (2.0 * math.pi)
    q = x * x
    c = 1.0 / 20922789888000.0
    c = 1.0 / -87178291200.0 + q * c
    c = 1.0 / 479001600.0 + q * c
    c = 1.0 / -3628800.0 + q * c
    c = 1.0 / 40320.0 + q * c
    c = 1.0 / -720.0 + q * c
    c = 1.0 / 24.0 + q * c
    c = 1.0 + q * (-0.5 + q * c)
    s = 1.0 / -1307674368000.0
    s = 1.0 / 6227020800.0 + q * s
    s = 1.0 / -39916800.0 + q * s
    s = 1.0 / 362880.0 + q * s
    s = 1.0 / -5040.0 + q * s
    s = 1.0 / 120.0 + q * s
    s = x * (1.0 + q * (-1.0 / 6.0 + q * s))
    turn = np.int64(quarter) & 3
    odd = (turn & 1) == 1
    cosine = s if odd else c
    sine = c if odd else s
    cosine = -cosine if turn == 1 or turn == 2 else cosine
    sine = -sine if turn >= 2 else sine
    return cosine, sine


@stage
def normal_pair(word_a, word_b):
    """Two independent standard normal numbers from two 32-bit words."""
    radius = math.sqrt(-2.0 * logarithm(uniform(word_a)))
    cosine, sine = cosine_sine_of_turns(uniform(word_b))
    return radius * cosine, radius * sine
