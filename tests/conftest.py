"""The shared cable, payload and scenarios of the tests."""

from __future__ import annotations

import dataclasses

import pytest

from heave_env.cable.axial import AxialSolver
from heave_env.parameters import Cable, Payload
from heave_env.scenarios import Scenario, load


@pytest.fixture(scope="session")
def thesis_cable() -> Scenario:
    """The 900 m cable of Huang (1992), 6.2.6."""
    return load("thesis_cable")


@pytest.fixture(scope="session")
def dragless(thesis_cable: Scenario) -> tuple[Cable, Payload]:
    """The thesis's cable and payload in a fluid without drag."""
    assert thesis_cable.cable is not None and thesis_cable.payload is not None
    cable = dataclasses.replace(thesis_cable.cable, tangential_drag_coefficient=0.0)
    return cable, dataclasses.replace(thesis_cable.payload, drag_area=0.0)


@pytest.fixture(scope="session")
def dragless_solver(dragless: tuple[Cable, Payload]) -> AxialSolver:
    """The documented resolution: 20 elements (and steps of 0.05 s)."""
    cable, payload = dragless
    return AxialSolver(cable=cable, payload=payload, length=900.0, n_elements=20)
