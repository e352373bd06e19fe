"""Conformance checks of drivers: `python -m microplan.executor.testing`."""

from microplan.executor.testing.bench import Bench, ConformanceError
from microplan.executor.testing.conformance import Result, conforms, failures

__all__ = ["Bench", "ConformanceError", "Result", "conforms", "failures"]
