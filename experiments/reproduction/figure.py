"""What a reproduced figure is: a function that draws, and says with which parameters.

@reproduction("H 3.3", "Maximum tension against frequency, polyester rope in air")
def thesis_3_3(figure) -> Caption:
    axes = figure.subplots()
    ...
    return Caption(parameters="...", assumed="...", shows="...")
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Caption:
    """What stands beneath a reproduced figure."""

    parameters: str
    """The exact parameters used, with units."""
    shows: str
    """What is to be seen, and whether it is what the source says."""
    assumed: str = ""
    """What print does not give and was assumed; empty if nothing."""


@dataclass(frozen=True)
class Reproduction:
    """A registered figure."""

    label: str
    """Source and number, as `H 3.3`: H Huang (1992), B Berteaux, M Moustafa (2001), W Welch and Tulin
    (1993)."""
    title: str
    """What it shows."""
    size: tuple[float, float]
    """Width and height [in]."""
    draw: Callable[[Any], Caption]
    """Draws on an empty Matplotlib figure."""

    @property
    def file_name(self) -> str:
        """Name of its picture: `h_3_3.png`."""
        return self.label.lower().replace(" ", "_").replace(".", "_").replace("-", "_") + ".png"


REGISTRY: dict[str, Reproduction] = {}
"""Figures by label, in the order of their definition."""


def reproduction(
    label: str, title: str, *, size: tuple[float, float] = (6.0, 3.8)
) -> Callable[[Callable[[Any], Caption]], Callable[[Any], Caption]]:
    """Registers a drawing function as the reproduction of a published figure."""

    def register(draw: Callable[[Any], Caption]) -> Callable[[Any], Caption]:
        if label in REGISTRY:
            raise ValueError(f"two figures are called {label!r}")
        REGISTRY[label] = Reproduction(label, title, size, draw)
        return draw

    return register
