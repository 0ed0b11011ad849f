"""Every validation case passes: the solvers agree with closed forms, print, each other and another code."""

import importlib.util

import pytest

from experiments.validate import validations
from experiments.validation.checks import Check

CASES = [
    pytest.param(case, id=name, marks=[pytest.mark.slow] if case.slow else [])
    for name, case in validations().items()
]


@pytest.mark.parametrize("case", CASES)
def test_every_check_passes(case):
    if case.needs is not None and importlib.util.find_spec(case.needs) is None:
        pytest.skip(f"needs {case.needs}")
    checks = [finding for finding in case.findings() if isinstance(finding, Check)]
    lost = [
        f"{check.quantity}: {check.ours:.8g}, not {check.reference:.8g}"
        for check in checks
        if not check.passed
    ]
    assert checks
    assert lost == []


@pytest.mark.parametrize("case", CASES)
def test_every_case_says_what_it_compares(case):
    assert len(case.summary) > 40
