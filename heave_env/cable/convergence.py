"""What a solver says when it finds no answer."""

from __future__ import annotations


class ConvergenceError(RuntimeError):
    """A solve that found no answer; the message names the likely cause and what to change.

    Wrong parameters raise `ValueError` before any solve; this is for a system that looks possible and
    whose equations were not met.
    """

    def __init__(self, message: str, residual: float) -> None:
        super().__init__(f"{message} (residual {residual:.3g})")
        self.residual = residual
        """What was left of the equations, in the unit that the message names."""
