"""What a finished part of a run found, kept in its folder so that the same command goes on from there.

A part is one controller in all seas of one scenario. Its file is an npz without pickles, written whole or not
at all, and says by its identity what it was made of. A part of another identity, or a broken one, counts as
not there: it is run again and replaced.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from experiments import runs

Array = np.ndarray

FOLDER = "kept"
"""Folder of the finished parts in a run's folder."""
IDENTITY = "identity"
"""Array of a kept file that says what it was made of, as JSON."""


def kept_file(folder: Path, scenario: str, label: str) -> Path:
    """Where the part of a controller in a scenario is kept."""
    return folder / FOLDER / _plain(scenario) / f"{_plain(label)}.npz"


def read_kept(path: Path, identity: Mapping[str, Any]) -> dict[str, Array] | None:
    """The arrays of a part, or None if there is none of that identity."""
    if not path.is_file():
        return None
    try:
        arrays = runs.read_arrays(path)
    except ValueError:
        return None  # cut short or altered by someone
    return arrays if str(arrays.pop(IDENTITY, "")) == _text(identity) else None


def write_kept(path: Path, identity: Mapping[str, Any], arrays: Mapping[str, Array]) -> None:
    """Keeps the arrays of a finished part.

    Raises:
        ValueError: If the file cannot be written.
    """
    runs.write_arrays(path, {**arrays, IDENTITY: np.array(_text(identity))})


def _text(identity: Mapping[str, Any]) -> str:
    return json.dumps(runs.plain(identity), sort_keys=True)


def _plain(name: str) -> str:
    """A file name of a name, which no other name has."""
    plain = re.sub(r"[^\w.@-]+", "_", name).strip(".")
    return plain if plain == name else f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
