"""What tests of the executor share: runs of the simulated cell that render less."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from microplan.executor.simulated.cameras.quick_pictures import QuickPictures
from tests.executor.pictures import forget, remembered


@pytest.fixture(scope="module")
def one_render_a_state() -> Iterator[None]:
    """Render each true state once in a module: its runs differ by what goes wrong.

    The noise of a frame is drawn afresh.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(QuickPictures, "image", remembered)
        yield
    forget()
