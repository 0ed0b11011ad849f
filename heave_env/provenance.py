"""Where a result comes from: versions, commit, command line, machine and date."""

from __future__ import annotations

import platform
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import heave_env

PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "gymnasium",
    "control",
    "stable-baselines3",
    "sb3-contrib",
    "torch",
    "warp-lang",
    "matplotlib",
)
"""Distributions whose versions can alter a result or a figure."""


@cache
def versions() -> dict[str, str]:
    """Versions of heave-env, Python and the installed packages that matter; nothing is imported."""
    found = {"heave-env": heave_env.__version__, "python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def commit() -> str:
    """The checkout's commit, with `+changes` when tracked files differ from it; `unknown` outside one."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():  # installed somewhere below another project's repository
        return "unknown"

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10, check=True
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return done.stdout.strip()

    head = git("rev-parse", "HEAD")
    if not head:
        return "unknown"
    return head + ("+changes" if git("status", "--porcelain", "--untracked-files=no") else "")


def processor() -> str:
    """The processor's name as the system gives it, with the number of its logical cores."""
    import os

    name = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                name = line.partition(":")[2].strip()
                break
    except OSError:
        pass  # other systems have no /proc
    return f"{name}, {os.cpu_count()} logical cores"


def command_line(arguments: list[str] | None = None) -> str:
    """The command that ran, as one would type it; by default the process's own arguments."""
    return shlex.join(["heave", *(sys.argv[1:] if arguments is None else arguments)])


def provenance(arguments: list[str] | None = None) -> dict[str, Any]:
    """Everything about the making of a result but its scenario and seeds, as plain JSON values."""
    return {
        "command": command_line(arguments),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "versions": dict(versions()),
        "platform": platform.platform(),
        "processor": processor(),
    }
