"""Solvers of the cable, the law of its material, and the closed forms that they are held to.

Each room holds one solver and stands alone; `docs/solvers` tells which answers what.
"""

from heave_env.cable.axial import AxialSolver
from heave_env.cable.convergence import ConvergenceError
from heave_env.cable.lowering import Lowering
from heave_env.cable.lumped_mass import LumpedMassSolver
from heave_env.cable.planar import PlanarSolver
from heave_env.cable.sagged_span import SaggedSpanSolver
from heave_env.cable.statics import FootprintSolver, StaticsSolver
from heave_env.cable.towing import Towing
from heave_env.cable.waves import WavesSolver

__all__ = [
    "AxialSolver",
    "ConvergenceError",
    "FootprintSolver",
    "Lowering",
    "LumpedMassSolver",
    "PlanarSolver",
    "SaggedSpanSolver",
    "StaticsSolver",
    "Towing",
    "WavesSolver",
]
