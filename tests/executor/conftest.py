"""What tests of the executor share: runs of the simulated cell that render less."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.executor.pictures import each_state_once


@pytest.fixture
def one_render_a_state() -> Iterator[None]:
    """Render each true state once in all tests: runs differ by what goes wrong.

    The noise of a frame is drawn afresh.
    """
    with each_state_once():
        yield
