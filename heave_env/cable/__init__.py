"""Solvers of the cable, and the closed forms that they are held to."""
