"""What several packages' tests share: the example, compiled once."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.planner.examples import EXAMPLE, microplan


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what compiles leave behind out of the user's own cache."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def compiled_example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the plan folder of the gear-on-shaft example at preset fast.

    All workers of one test run share it: the first compiles, the others wait. Nobody
    may change it.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    folder = shared / "gear-on-shaft.plan"
    with (shared / "gear-on-shaft.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # let go when the file closes
        if not folder.exists():
            task = str(EXAMPLE / "task.yaml")
            options = ("-o", str(folder), "--preset", "fast", "--jobs", "2")
            done = microplan("compile", task, *options)
            assert done.returncode == 0, done.stderr
    return folder
