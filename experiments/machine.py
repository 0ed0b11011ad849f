"""What one core of this machine can do at most: multiply-adds on registers, and copying memory.

The multiply-adds are LLVM's `fma` on vectors that stay in registers, in as many independent chains as hide
its latency; of several widths and numbers of chains the fastest counts. No memory is touched, so this is the
roof over any kernel. Copying is NumPy's, of arrays larger than a core's caches; bytes read and bytes written
both count.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

VARIANTS = ((4, 10), (8, 8), (8, 10), (16, 8), (16, 10))
"""Lanes of a vector and chains that are tried, for float32; float64 has half the lanes."""
COPIED = 1 << 27
"""Size of the array that is copied [bytes]."""


@dataclass(frozen=True)
class Peaks:
    """Roofs over one core."""

    float32_flops: float
    """Floating-point operations, a multiply-add counting two [1/s]."""
    float64_flops: float
    """The same in double precision [1/s]."""
    copied_bytes: float
    """Bytes read plus bytes written [1/s]."""

    def to_mapping(self) -> dict[str, float]:
        """The peaks as plain values."""
        return asdict(self)


def chained(n_lanes: int, n_chains: int, precision: str) -> Callable[[float, int], float]:
    """A compiled function of a number and of rounds: `n_chains` x <- x a + b of vectors in each round."""
    from llvmlite import ir  # type: ignore[import-untyped]
    from numba import njit, types
    from numba.core import cgutils
    from numba.extending import intrinsic

    scalar, name = (ir.FloatType(), "f32") if precision == "float32" else (ir.DoubleType(), "f64")
    vector = ir.VectorType(scalar, n_lanes)
    given_type = types.float32 if precision == "float32" else types.float64

    @intrinsic
    def chains(typing_context: Any, number: Any, rounds: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            number, rounds = arguments
            kind = ir.FunctionType(vector, [vector] * 3)
            fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{n_lanes}{name}")

            def everywhere(value: Any) -> Any:
                made = ir.Constant(vector, ir.Undefined)
                for lane in range(n_lanes):
                    made = builder.insert_element(made, value, ir.Constant(ir.IntType(32), lane))
                return made

            factor = everywhere(number)
            places = []
            for chain in range(n_chains):
                start = builder.fadd(number, ir.Constant(scalar, float(chain)))
                places.append(cgutils.alloca_once_value(builder, everywhere(start)))
            with cgutils.for_range(builder, rounds):
                for place in places:
                    builder.store(builder.call(fma, [builder.load(place), factor, factor]), place)
            total = builder.load(places[0])
            for place in places[1:]:
                total = builder.fadd(total, builder.load(place))
            return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

        return given_type(given_type, types.intp), generate

    @njit([given_type(given_type, types.intp)])
    def run(number: Any, rounds: Any) -> Any:
        return chains(number, rounds)

    return run


def _median_seconds(call: Callable[[], Any], repeats: int) -> float:
    call()
    spent = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        spent.append(time.perf_counter() - begin)
    return statistics.median(spent)


def multiply_add_peak(precision: str, *, rounds: int = 1_000_000, repeats: int = 5) -> float:
    """Floating-point operations per second in chains of multiply-adds on registers, the best variant's."""
    best = 0.0
    for wide, n_chains in VARIANTS:
        n_lanes = wide if precision == "float32" else wide // 2
        run = chained(n_lanes, n_chains, precision)
        seconds = _median_seconds(lambda run=run: run(0.5, rounds), repeats)  # type: ignore[misc]
        best = max(best, 2.0 * n_lanes * n_chains * rounds / seconds)
    return best


def copy_peak(*, size: int = COPIED, repeats: int = 5) -> float:
    """Bytes read plus bytes written per second when a large array is copied."""
    source, target = np.ones(size // 8), np.zeros(size // 8)
    return 2.0 * size / _median_seconds(lambda: np.copyto(target, source), repeats)


def measured_peaks(*, quick: bool = False) -> Peaks:
    """Measures the roofs; `quick` measures shortly, to see that all runs."""
    rounds, repeats, size = (10_000, 1, 1 << 22) if quick else (1_000_000, 5, COPIED)
    return Peaks(
        float32_flops=multiply_add_peak("float32", rounds=rounds, repeats=repeats),
        float64_flops=multiply_add_peak("float64", rounds=rounds, repeats=repeats),
        copied_bytes=copy_peak(size=size, repeats=repeats),
    )
