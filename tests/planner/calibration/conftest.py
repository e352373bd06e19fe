"""What tests of calibrations share: a part that is found by few trials."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.planner.measure.small_look import fewer_trials


@pytest.fixture(autouse=True, scope="module")
def _fewer_trials() -> Iterator[None]:
    """Spend little on how a part is found: what is measured then does not tell."""
    with fewer_trials():
        yield
