"""What several packages' tests share: the example, compiled once."""

from __future__ import annotations

import fcntl
import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests.planner.few_trials import compile_example

# No test depends on time, not even on how long its own examples take to make, and each
# run draws the same examples; `make bench` draws others.
settings.register_profile(
    "steady",
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "roving", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))


# Modules and rewritten tests are compiled once for all workers and for every process
# that a test starts, whatever the environment says of bytecode.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# What collecting makes stays to the end: garbage is looked for in what tests make.
gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage from now on, but not in what was collected."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep what compiles leave behind out of the user's own cache.

    All workers of one test run share it: what one has compiled no other compiles again.
    """
    folder = _shared(tmp_path_factory) / "cache"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="session")
def compiled_example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the plan folder of the gear-on-shaft example, made of few trials.

    All workers of one test run share it: the first compiles, the others wait. Nobody
    may change it.
    """
    shared = _shared(tmp_path_factory)
    folder = shared / "gear-on-shaft.plan"
    with (shared / "gear-on-shaft.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # let go when the file closes
        if not folder.exists():
            done = compile_example(folder)
            assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="session")
def example_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of one good run, frames kept; what it printed is beside it.

    `tests.executor.kept` says what lies beside it. All workers share it, as above, and
    nobody may change it.
    """
    from tests.executor.kept import RUN, SAID, keep_run  # most tests need no run

    shared = _shared(tmp_path_factory)
    with (shared / "gear.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (shared / SAID).exists():
            keep_run(shared)
    return shared / RUN


def _shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder that all workers of one test run have."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
