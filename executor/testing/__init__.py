"""Conformance checks of drivers: `python -m microplan.executor.testing`.

In: a driver, its role, a `Bench` with safe steps. Out: one `Result` a check.
The type that passes: `Bench` (bench), `Check` (bench).
May be touched here: a new check, with a driver in the tests that fails it. The checks
of movers and others come from the contract in executor.devices.drivers alone.
Watched by: tests/executor/testing/test_conformance.py.
"""

from microplan.executor.testing.bench import Bench, ConformanceError
from microplan.executor.testing.conformance import Result, conforms, failures

__all__ = ["Bench", "ConformanceError", "Result", "conforms", "failures"]
