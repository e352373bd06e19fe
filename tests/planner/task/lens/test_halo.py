"""Halos as the workcell states them, and findings where they cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from microplan.planner.task.workcell import HaloSpec
from tests.planner.task.lens.test_wavefront import stated
from tests.planner.task.light.test_check_light import loaded


def test_a_halo_is_read(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, stated("halo: {radius_um: 2.5, share: .06}"))
    assert task is not None
    assert task.workcell.optics.halo == HaloSpec(radius_um=2.5, share=0.06)


def test_none_is_stated_by_default(tmp_path: Path) -> None:
    task, _ = loaded(tmp_path, {})
    assert task is not None
    assert task.workcell.optics.halo is None


@pytest.mark.parametrize(
    ("text", "code", "at", "said"),
    [
        ("halo: {radius_um: 0, share: .1}", "MP103", "0,", "0"),
        ("halo: {radius_um: 2, share: .6}", "MP103", ".6}", "at most 0.5, got 0.6"),
        ("halo: {radius_um: 2}", "MP102", "halo", "'share'"),
    ],
)
def test_a_halo_that_cannot_be_is_told_at_its_place(
    tmp_path: Path, text: str, code: str, at: str, said: str
) -> None:
    task, found = loaded(tmp_path, stated(text))
    assert task is None
    (finding,) = [each for each in found if each.severity == "error"]
    assert (finding.code, finding.where.column) == (code, 3 + text.index(at))
    assert said in finding.message
