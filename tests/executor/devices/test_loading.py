"""Drivers of our own are found by both spellings of their module."""

from __future__ import annotations

import pytest

from microplan.executor.devices.loading import load
from microplan.executor.simulated.hub import cell


@pytest.mark.parametrize("module", ["executor", "microplan.executor"])
def test_a_station_file_may_leave_out_the_name_of_the_package(module: str) -> None:
    assert load(f"{module}.simulated.hub:cell", "hubs.cell.driver") is cell
