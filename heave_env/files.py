"""Files written whole or not at all, and tables of numbers read without mercy."""

from __future__ import annotations

import csv
import math
import os
from pathlib import Path

import numpy as np


def write_atomic(path: Path, content: bytes) -> None:
    """Writes a file to a temporary one beside it, flushed to disk, then renames that into place.

    Raises:
        OSError: If the file cannot be written; what was there before is there still.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with draft.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def modified(path: str | Path) -> int:
    """When a file was last written, so that a changed one is read anew [ns]; 0 if it is not there."""
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0


def read_columns(
    path: str | Path, what: str, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> tuple[dict[str, np.ndarray], list[int]]:
    """Reads named columns of finite numbers from a CSV file; lines that begin with # are comments.

    Args:
        path: The file.
        what: What it is, for the complaint, as `motion file`.
        required: Columns that must be there, in any order among others.
        optional: Columns that are read if they are there.

    Returns:
        The columns by name, (n_rows,) each, and the line in the file of each row.

    Raises:
        ValueError: If the file cannot be read, a column is missing, or a value is missing or no number.
    """
    path = Path(path)
    try:
        with path.open(newline="", encoding="utf-8") as file:
            numbered = [
                (i, line) for i, line in enumerate(file, 1) if line.strip() and not line.startswith("#")
            ]
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ValueError(f"cannot read {what} {str(path)!r}: {reason}") from error
    reader = csv.reader([line for _, line in numbered])
    header = [cell.strip() for cell in next(reader, [])]
    for column in required:
        if column not in header:
            names = f"{', '.join(required[:-1])} and {required[-1]}"
            if optional:
                names = f"{', '.join(required)} and optionally {', '.join(optional)}"
            raise ValueError(
                f"{what} {str(path)!r} lacks the column {column!r} in its header {header!r}: name the "
                f"columns {names}"
            )
    wanted = [column for column in (*required, *optional) if column in header]
    values: dict[str, list[float]] = {column: [] for column in wanted}
    lines = [number for number, _ in numbered[1:]]
    for number, row in zip(lines, reader, strict=True):
        for column in wanted:
            place = header.index(column)
            text = row[place].strip() if place < len(row) else ""
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                raise ValueError(
                    f"{what} {str(path)!r} line {number}: {column} is {text!r}, which is no number; "
                    "fill the gap"
                )
            values[column].append(value)
    return {column: np.array(items) for column, items in values.items()}, lines
