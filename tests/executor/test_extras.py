"""Tests of an extra are skipped only where the extra is not asked for."""

from __future__ import annotations

import importlib.util
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_micro_manager_is_there_wherever_the_development_extra_is() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    development = project["project"]["optional-dependencies"]["dev"]
    assert "microplan[micromanager]" in development
    assert any(line.startswith("mm-test-adapters") for line in development)
    if importlib.util.find_spec("importlinter") is None:  # it comes with the extra
        return
    assert importlib.util.find_spec("pymmcore_plus") is not None
    assert importlib.util.find_spec("mm_test_adapters") is not None
