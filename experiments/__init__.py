"""Experiments: roll out, score, compare, benchmark and report; the `heave` command."""
