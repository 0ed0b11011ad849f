"""How compiled stages are declared, and the fingerprint that keeps their cache honest."""

from __future__ import annotations

import hashlib
from pathlib import Path

from numba import njit

# IEEE division and no reassociation: the same operations in the same order in every variant, so a row
# has the same bits alone and in a batch. Stages are inlined into the kernel that calls them.
stage = njit(error_model="numpy", forceinline=True)
# For a seldom effect: called, not inlined, so that kernels without it stay as short as they were.
seldom = njit(error_model="numpy")

_STAGE_FILES = (
    "streams.py",
    "layout.py",
    "lanes.py",
    "compiled.py",
    "hydrodynamics.py",
    "cable/constitutive.py",
    "cable/axial.py",
    "winch.py",
    "compensator.py",
    "kernel.py",
)


def source_fingerprint() -> int:
    """A number that changes whenever the source of any stage does.

    Numba's cache looks at the file of the cached function alone; kernels carry this number as a
    constant, so that an edit of an imported stage makes them compile anew.
    """
    digest = hashlib.sha256()
    for name in _STAGE_FILES:
        digest.update((Path(__file__).parent / name).read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")
