"""Runs on the simulated cell as the benchmark makes them."""

from pathlib import Path

import pytest

from benchmarks.executing.runs import perform, perform_all
from tests.executor.bench import Folder, assembly, world


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan of the gear-on-shaft job that was built by hand."""
    folder = Folder(tmp_path_factory.mktemp("plan") / "gear.plan")
    return folder.write(assembly(folder), world())


@pytest.mark.slow
def test_a_run_depends_on_its_seed_alone(plan: Path, tmp_path: Path) -> None:
    alone = [perform(plan, tmp_path / "alone", seed) for seed in (0, 2)]
    assert perform_all(plan, tmp_path / "together", [0, 2], jobs=2) == alone
    assert [outcome.seed for outcome in alone] == [0, 2]


def test_a_plan_that_is_not_there_ends_the_benchmark(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"seed 7 ended with 2:\n.*MP802"):
        perform(tmp_path / "plan.json", tmp_path, 7)
