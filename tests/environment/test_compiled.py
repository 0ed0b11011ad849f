"""The kernel's cache notices edits of every stage, not of its own file alone."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher

from heave_env import compiled

PROGRAM = """
from heave_env.plant import simulate
from heave_env.scenarios import load
import numpy as np
record = simulate(load("thesis_linear"), seeds=[0], duration=2.0, commands=np.ones(20))
print(record["winch_displacement"][-1, 0])
"""


def test_every_stage_file_counts_in_the_fingerprint(tmp_path, monkeypatch):
    package = Path(compiled.__file__).parent
    for name in compiled._STAGE_FILES:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(package / name, tmp_path / name)
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "compiled.py"))
    seen = {compiled.source_fingerprint()}
    for name in compiled._STAGE_FILES:
        with (tmp_path / name).open("a") as file:
            file.write("# an edit\n")
        seen.add(compiled.source_fingerprint())
    assert len(seen) == 1 + len(compiled._STAGE_FILES)


def test_every_file_whose_stages_others_compile_is_in_the_fingerprint():
    # Numba's cache sees edits of a compiled function's own file by itself.
    package = Path(compiled.__file__).parent
    texts = {path.relative_to(package): path.read_text(encoding="utf-8") for path in package.rglob("*.py")}
    compiling = {path for path, text in texts.items() if "@stage" in text or "@njit" in text}
    shared = {
        path.as_posix()
        for path in compiling
        for other in compiling - {path}
        if f"from heave_env.{'.'.join(path.with_suffix('').parts)} import" in texts[other]
    }
    assert {"hydrodynamics.py", "cable/axial.py"} <= shared
    assert shared <= set(compiled._STAGE_FILES)


@pytest.mark.slow
def test_an_edited_stage_is_compiled_anew(tmp_path):
    shutil.copytree(
        Path(compiled.__file__).parent,
        tmp_path / "heave_env",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}

    def displacement() -> float:
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return float(done.stdout)

    before = displacement()
    winch = tmp_path / "heave_env" / "winch.py"
    edited = winch.read_text().replace(
        "S[WINCH_DISPLACEMENT, lane] = u0 - gap", "S[WINCH_DISPLACEMENT, lane] = u0"
    )
    assert edited != winch.read_text()
    winch.write_text(edited)
    assert before == pytest.approx(2.0 * 0.8647 / 2.0, abs=1e-3)
    assert displacement() == pytest.approx(1.0)


def test_what_is_kept_on_disk_is_found_again():
    # Numba keys its cache by a closure's content, and another compiled function there is new in each process.
    package = Path(compiled.__file__).parent
    kept = []
    for path in package.rglob("*.py"):
        if "cache=True" not in path.read_text(encoding="utf-8"):
            continue
        name = ".".join(("heave_env", *path.relative_to(package).with_suffix("").parts))
        for found in vars(importlib.import_module(name)).values():
            for function in found if isinstance(found, tuple) else (found,):
                if isinstance(function, Dispatcher) and not isinstance(function._cache, NullCache):
                    kept.append(f"{name}.{function.py_func.__name__}")
                    cells = function.py_func.__closure__ or ()
                    assert not any(isinstance(cell.cell_contents, Dispatcher) for cell in cells), kept[-1]
    assert len(kept) > 8
