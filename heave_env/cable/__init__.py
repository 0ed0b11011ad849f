"""Solvers of the cable, the law of its material, and the closed forms that they are held to.

Each room holds one solver and stands alone; `docs/solvers` tells which answers what. The solvers can be
had from here by name; a room is loaded when one of its names is first asked for, since the environment
needs but one of them.
"""

from importlib import import_module
from typing import Any

_ROOMS = {
    "AxialSolver": "axial",
    "ConvergenceError": "convergence",
    "FootprintSolver": "statics",
    "Lowering": "lowering",
    "LumpedMassSolver": "lumped_mass",
    "PlanarSolver": "planar",
    "SaggedSpanSolver": "sagged_span",
    "StaticsSolver": "statics",
    "Towing": "towing",
    "WavesSolver": "waves",
}

__all__ = list(_ROOMS)


def __getattr__(name: str) -> Any:
    if name not in _ROOMS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ROOMS[name]}"), name)
