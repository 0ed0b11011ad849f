"""Files of an experiment: written whole or not at all, read back with a sentence when they are broken.

Every writer builds its file beside the target and renames it into place, so an interrupted or failed
command leaves what was there before.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heave_env.files import write_atomic

Array = np.ndarray

RUN_FILE = "run.json"
RESULTS_FILE = "results.csv"
SUMMARY_FILE = "results.json"
EPISODES_FILE = "episodes.csv"
TRAJECTORIES_FILE = "trajectories.npz"
REPORT_FILE = "report.html"

COMPARISON = "comparison"
"""`kind` in the `run.json` of a comparison's folder."""
LEAGUE = "league"
"""`kind` in the `run.json` of a league's folder."""


def write_bytes(path: str | Path, content: bytes) -> Path:
    """Replaces a file by new content in one step; missing folders above it are made.

    Raises:
        ValueError: If the file cannot be written there.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, content)
    except OSError as error:
        raise ValueError(f"cannot write {str(path)!r}: {error.strerror or error}") from error
    return path


def write_text(path: str | Path, content: str) -> Path:
    """Replaces a text file (UTF-8) in one step."""
    return write_bytes(path, content.encode("utf-8"))


def plain(value: Any) -> Any:
    """The value in JSON's own types: NumPy scalars and arrays unpacked, what is not finite as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value


def write_json(path: str | Path, content: Any) -> Path:
    """Replaces a JSON file in one step; strictly JSON, so NaN becomes null."""
    text = json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False)
    return write_text(path, text + "\n")


def read_json(path: str | Path) -> Any:
    """Reads a JSON file.

    Raises:
        ValueError: If it cannot be read or is no JSON.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"cannot read {str(path)!r}: {error.strerror}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{str(path)!r} is not valid JSON: {error}") from error


def cell(value: Any) -> str:
    """A CSV cell: every digit of a number, nothing for what is missing or not finite."""
    if value is None:
        return ""
    if isinstance(value, (bool, np.bool_)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value)) if math.isfinite(value) else ""
    return str(value)


def table_text(columns: Sequence[str], rows: Iterable[Sequence[Any]], comments: Sequence[str] = ()) -> str:
    """CSV text: comment lines beginning with #, the header, the rows."""
    buffer = io.StringIO()
    for comment in comments:
        buffer.write(f"# {' '.join(comment.split())}\n")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([cell(value) for value in row] for row in rows)
    return buffer.getvalue()


def read_table(path: str | Path) -> list[dict[str, str]]:
    """Rows of a CSV file by column; lines that begin with # are comments.

    Raises:
        ValueError: If it cannot be read.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(line for line in file if not line.startswith("#")))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"cannot read {str(path)!r}: {error}") from error


def write_arrays(path: str | Path, arrays: Mapping[str, Array]) -> Path:
    """Replaces a compressed npz file in one step; plain arrays only."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return write_bytes(path, buffer.getvalue())


def read_arrays(path: str | Path) -> dict[str, Array]:
    """Arrays of an npz file by name; never unpickles.

    Raises:
        ValueError: If it cannot be read.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except Exception as error:  # zipfile, zlib and numpy each raise their own on a broken file
        raise ValueError(f"cannot read arrays from {str(path)!r}: {error}") from error


def check_folder(out: str | Path, kind: str) -> Path:
    """The folder for a run's files, checked before any work is done.

    Raises:
        ValueError: If it is a file, or holds a run of another kind.
    """
    out = Path(out)
    if out.exists() and not out.is_dir():
        raise ValueError(f"{str(out)!r} is a file; give a folder for the results")
    if (out / RUN_FILE).exists():
        holder = read_json(out / RUN_FILE)
        found = holder.get("kind") if isinstance(holder, dict) else None
        if found != kind:
            raise ValueError(
                f"folder {str(out)!r} holds another kind of run ({found or 'training'}); "
                "give another folder, nothing was overwritten"
            )
    return out


def check_file(out: str | Path) -> Path:
    """The path of an output file, checked before any work is done.

    Raises:
        ValueError: If it is a folder.
    """
    out = Path(out)
    if out.is_dir():
        raise ValueError(f"{str(out)!r} is a folder; give the path of a file")
    return out
