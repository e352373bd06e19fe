"""What a driver must do, as checks its author runs: `python -m executor.testing`."""

from executor.testing.bench import Bench, ConformanceError
from executor.testing.conformance import Result, conforms, failures

__all__ = ["Bench", "ConformanceError", "Result", "conforms", "failures"]
