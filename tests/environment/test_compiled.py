"""The kernel's cache notices edits of every stage, not of its own file alone."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit
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
        "S[WINCH_DISPLACEMENT] = command - gap", "S[WINCH_DISPLACEMENT] = command"
    )
    assert edited != winch.read_text()
    winch.write_text(edited)
    assert before == pytest.approx(2.0 * 0.8647 / 2.0, abs=1e-3)
    assert displacement() == pytest.approx(1.0)


def test_a_line_says_when_something_is_compiled_and_only_then(capsys, monkeypatch):
    def twice(values):
        return values[0] + values[0]

    def thrice(values):
        return 3 * values[0]

    pair = njit(twice), njit(thrice)
    compiled.announce_compilation(pair, "two small sums")
    for function in pair:
        for _ in range(2):
            function(np.ones(1))
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1
    assert "compiling two small sums in float64" in said.err
    pair[1](np.ones(1, dtype=np.float32))
    assert "in float32" in capsys.readouterr().err
    monkeypatch.setattr(compiled.multiprocessing, "parent_process", lambda: "a parent")
    pair[1](np.ones(1, dtype=np.int64))
    assert capsys.readouterr().err == ""


def test_the_plant_s_kernels_are_announced():
    from heave_env import kernel, plant

    assert plant.Plant  # announces
    for pair in kernel.KERNELS.values():
        assert all("the plant's kernel" in compiled._notices.names[id(function)] for function in pair)


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
