"""What options of the command line accept: parsers that refuse in a sentence."""

from __future__ import annotations

import argparse


def count(text: str) -> int:
    """A positive number, also as 2e6."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if value < 1 or value != int(value):
        raise argparse.ArgumentTypeError(f"must be a positive whole number, got {text!r}")
    return int(value)


def seed(text: str) -> int:
    """A whole number, zero or more."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"must be a whole number that is not negative, got {text!r}")
    return int(text)


def positive(text: str, unit: str = "") -> float:
    """A positive number."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a positive number{unit}, got {text!r}")
    return value


def seconds(text: str) -> float:
    """A positive time [s]."""
    return positive(text, " of seconds")
