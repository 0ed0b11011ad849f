"""Vectors of lanes compute what plain numbers and loops over lanes do, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from heave_env import kernel
from heave_env.lanes import (
    absolute,
    aligned_zeros,
    any_of,
    block_at,
    constant,
    converted,
    counting,
    exponent_of,
    floor,
    fused,
    lane,
    lane_of,
    lanes_of,
    mantissa_of,
    maximum,
    minimum,
    negated,
    numbers_from,
    pair,
    signed_float,
    square_root,
    store_across,
    swapped,
    unsigned_float,
    where,
    words_at,
)
from heave_env.scenarios import load

N = 16
"""Lanes of the vectors here."""
DTYPES = {"float64": 0, "float32": 1}
FLOATS = (0.0, -0.0, 1.5, -2.25, 0.1, 3e20, -7e-20, np.inf, -np.inf, np.nan, 0.7, -0.7, 12.5, -1e-3, 2.0, 5.5)
WORDS = (0, 1, 2, 2**31, 2**32 - 1, 2**32, 2**53 + 1, 2**63, 2**64 - 1, 7, 11, 2**30, 2**29, 3, 5, 99)


def of_floats(single, n_lanes, plain):
    """Every operation on floats, compiled over the rows of a block: three to read, the rest to fill."""

    @njit(error_model="numpy")
    def run(address):
        S = block_at(address, single, n_lanes, plain)
        a, b, c = S[0], S[1], S[2]
        S[3], S[4], S[5], S[6], S[7] = a + b, a - b, a * b, a / b, -a
        S[8], S[9], S[10], S[11] = fused(a, b, c), square_root(a), floor(a), absolute(a)
        S[12], S[13] = minimum(a, b), maximum(a, b)
        S[14], S[15], S[16] = where(a < b, b, c), where(a <= b, b, c), where(a > b, b, c)
        S[17], S[18], S[19] = where(a >= b, b, c), where(a == b, b, c), where(a != b, b, c)
        less, more = a < b, b < c
        S[20], S[21], S[22] = where(less & more, a, c), where(less | more, a, c), where(less ^ more, a, c)
        S[23], S[24] = where(negated(less), a, c), a * constant(S, 0.1)
        S[25] = converted(S, converted(0.0, a) * converted(0.0, b))

    return run


def of_words(n_lanes, plain):
    """The same of words: two rows to read."""

    @njit
    def run(address):
        I = words_at(address, n_lanes, plain)
        p, q = I[0], I[1]
        some = q & constant(q, 31)
        I[2], I[3], I[4], I[5], I[6], I[7] = p + q, p - q, p * q, p & q, p | q, p ^ q
        I[8], I[9], I[10] = p << some, p >> some, where(p >= q, p, constant(q, 4))

    return run


def three_ways(make, rows, dtype):
    """What vectors, loops over lanes and plain numbers, one lane after the other, leave in a buffer."""
    found = []
    for n_lanes, plain in ((N, 0), (N, 1), (1, 0)):
        run = make(n_lanes, plain)
        result = np.zeros(rows.shape, dtype=dtype)
        for first in range(0, N, n_lanes):
            buffer = aligned_zeros((len(rows), n_lanes), dtype)
            buffer[:] = rows[:, first : first + n_lanes]
            run(buffer.ctypes.data)
            result[:, first : first + n_lanes] = buffer
        found.append(result)
    return found


def same_bits(a, b):
    """Equal to the last bit and sign; of what is no number it is enough that neither is one."""
    numbers = ~np.isnan(a)
    assert np.array_equal(np.isnan(a), np.isnan(b))
    return np.array_equal(a[numbers], b[numbers]) and np.array_equal(
        np.signbit(a[numbers]), np.signbit(b[numbers])
    )


@pytest.mark.parametrize("dtype", DTYPES)
def test_operations_on_floats(dtype):
    a = np.array(FLOATS)
    rows = np.zeros((26, N), dtype=dtype)
    rows[:3] = a, np.roll(a, 5), np.roll(a[::-1], 3)
    vectors, loops, numbers = three_ways(lambda n, plain: of_floats(DTYPES[dtype], n, plain), rows, dtype)
    for row in range(3, len(rows)):
        assert vectors[row].any(), row
        assert same_bits(vectors[row], loops[row]), row
        assert same_bits(vectors[row], numbers[row]), row
    x, y, z = vectors[:3]
    with np.errstate(all="ignore"):
        assert same_bits(vectors[6], x / y)
        assert same_bits(vectors[14], np.where(x < y, y, z))
        assert same_bits(vectors[19], np.where(x != y, y, z))


def test_operations_on_words():
    p = np.array(WORDS, dtype=np.uint64)
    rows = np.zeros((11, N), dtype=np.uint64)
    rows[:2] = p, np.roll(p, 7)
    vectors, loops, numbers = three_ways(of_words, rows, np.uint64)
    assert vectors.any(axis=1).all()
    assert np.array_equal(vectors, loops)
    assert np.array_equal(vectors, numbers)
    assert np.array_equal(vectors[4], p * np.roll(p, 7))


@pytest.mark.parametrize("dtype", DTYPES)
def test_words_become_floats_and_floats_come_apart(dtype):
    single, p = DTYPES[dtype], np.array(WORDS, dtype=np.uint64)

    @njit
    def run(words, floats):
        for number in range(N):
            own, into = (
                lane_of(words_at(words, N, 0), number),
                lane_of(block_at(floats, single, N, 0), number),
            )
            into[4], into[5] = unsigned_float(into, own[0]), signed_float(into, own[0])
            into[6], into[7] = exponent_of(into[8]), mantissa_of(into[8])
        P, S = words_at(words, N, 0), block_at(floats, single, N, 0)
        S[0], S[1] = unsigned_float(S, P[0]), signed_float(S, P[0])
        S[2], S[3] = exponent_of(S[8]), mantissa_of(S[8])

    words, floats = aligned_zeros((1, N), np.uint64), aligned_zeros((9, N), dtype)
    words[0], floats[8] = p, np.geomspace(1e-30, 1e30, N)
    run(words.ctypes.data, floats.ctypes.data)
    assert np.array_equal(floats[:4], floats[4:8])
    assert np.array_equal(floats[0], (p & np.uint64(0xFFFFFFFF)).astype(dtype))
    assert np.array_equal(floats[1], p.astype(np.uint32).view(np.int32).astype(dtype))
    assert np.array_equal(floats[3] * 2.0 ** floats[2].astype(float), floats[8].astype(float))
    assert np.all((floats[3] >= 1.0) & (floats[3] < 2.0))


def test_parts_of_a_block_are_where_they_should_be():
    @njit
    def run(address, across):
        S = block_at(address, 1, N, 0)
        part = lanes_of(S, 4, 8)
        part[1] = part[0] + constant(part, 1.0)
        lane_of(S, 2)[1] = np.float32(77.0)
        numbers_from(S, 2)[3] = np.float32(5.0)
        store_across(block_at(across, 1, 1, 0), 1, 6, S[0], S[1], S[2], S[0])
        return lane(counting(4), 3), any_of(S[0] > constant(S, 14.5)), any_of(S[0] > constant(S, 15.5))

    rows, across = aligned_zeros((3, N), np.float32), aligned_zeros((N, 6), np.float32)
    rows[0] = np.arange(N)
    assert run(rows.ctypes.data, across.ctypes.data) == (3, True, False)
    assert np.array_equal(rows[1], [0, 0, 77, 0, 5, 6, 7, 8, 9, 10, 11, 12, 0, 0, 0, 0])
    assert rows[2, 3] == 5.0 and np.count_nonzero(rows[2]) == 1
    assert np.array_equal(across[:, 1:5], rows[[0, 1, 2, 0]].T)
    assert not across[:, [0, 5]].any()


def test_precisions_do_not_mix_unseen():
    @njit
    def run(address):
        S = block_at(address, 1, N, 0)
        S[0] = S[0] + 1.0

    with pytest.raises(Exception, match="No implementation of function"):
        run(0)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", ["sea_state_5", "hybrid"])
def test_the_kernel_of_vectors_is_that_of_loops(name, dtype, monkeypatch):
    from heave_env.plant import Plant

    scenario, n_envs, found = load(name), 5, []
    plain = kernel._make(DTYPES[dtype], 8, 1, 1), kernel._make(DTYPES[dtype], 8, 0, 1)
    monkeypatch.setitem(kernel.BATCH_LANES, dtype, 8)
    for made in plain:
        monkeypatch.setitem(kernel.KERNELS, (dtype, 8), made)
        plant = Plant(scenario, n_envs, dtype=dtype)
        plant.begin(np.ones(n_envs, dtype=bool), np.arange(n_envs))
        for step in range(50):
            plant.advance(np.full(n_envs, np.sin(0.1 * step)))
        found.append((plant.observation.copy(), plant.channels, plant.reward.copy()))
    for loops, vectors in zip(*found, strict=True):
        assert np.array_equal(loops, vectors)


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_pair_of_numbers_takes_two_lanes(dtype):
    single = DTYPES[dtype]

    @njit
    def run(address):
        S = block_at(address, single, 1, 0)
        both = swapped(pair(S[0], S[1])) * constant(pair(S[0], S[1]), 2.0)
        return lane(both, 0), lane(both, 1)

    rows = np.array([3.0, 5.0], dtype=dtype)
    assert run(rows.ctypes.data) == (10.0, 6.0)
