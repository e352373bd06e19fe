"""A part that no look can take in: most likely its unit is another one."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.executing.drawings_located import Job, write
from microplan.planner.source.diagnostics import Report
from microplan.planner.task.check_workcell import likely_units
from microplan.planner.task.read_task import load_task
from tests.planner.drawings.dxf_text import box, dxf
from tests.planner.examples import EXAMPLE, read

# the example's field is 4800 um / 6.9 = 695.7 um wide, 8 pixels are 1.35 um at 44.5 x,
# the stage reaches over 10 mm and a field
CASES = [
    (40e3, "mm", ["um"]),
    (100.0, "um", []),
    (0.6, "um", ["mm"]),
    (1.4, "um", []),
    (1.3, "um", []),  # 1.3 mm are too large for a look as well
    (13.9e3, "mm", []),  # 20 fields: a plate
    (14e3, "mm", ["um"]),
    (20e3, "um", ["nm"]),
    (0.02e3 * 25.4e3, "inch", ["um"]),
]


@pytest.mark.parametrize(("extent_um", "units", "likely"), CASES)
def test_the_likely_unit_is_one_that_fits_the_field(
    extent_um: float, units: str, likely: list[str]
) -> None:
    cell = read(EXAMPLE / "task.yaml").workcell
    assert likely_units(extent_um, units, cell)[1] == likely


@pytest.mark.parametrize(
    ("size", "units", "said"),
    [(40.0, "mm", "is it drawn in um?"), (0.6, "um", "is it drawn in mm?"),
     (40.0, "um", "")],
)  # fmt: skip
def test_a_task_names_the_likely_unit(
    size: float, units: str, said: str, tmp_path: Path
) -> None:
    drawing = tmp_path / "box.dxf"
    drawing.write_text(dxf(box(size, size), units=0))
    job = Job(path=drawing, called="box", units=units, layers=["A"], cell="",
              extent_um=40.0)  # fmt: skip
    write(job, tmp_path / "task")
    report = Report()
    task = load_task(tmp_path / "task" / "task.yaml", report)
    found = [(finding.code, finding.hint) for finding in report.found]
    assert found == ([("MP216", said)] if said else [])
    assert (task is None) == bool(said)
