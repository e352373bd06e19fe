"""All series of pictures of a call, and the workcell that they amount to."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationSeries,
)
from microplan.planner.calibration.condenser.condenser_series import (
    StatedCondenser,
    condenser_settings,
)
from microplan.planner.calibration.discrepancy.discrepancy_values import (
    MOST,
    SECTION,
    with_discrepancy,
)
from microplan.planner.calibration.even_field.field_series import (
    FieldCell,
    even_field,
)
from microplan.planner.calibration.geometry.light_field import WHERE
from microplan.planner.calibration.geometry.light_of_places import (
    StatedLight,
    with_light,
)
from microplan.planner.calibration.geometry.part_finder import part_finder
from microplan.planner.calibration.geometry.part_places import PartPlaces
from microplan.planner.calibration.geometry.placed_stills import placed_stills
from microplan.planner.calibration.geometry.stage_series import stage_axes
from microplan.planner.calibration.light_series import camera_response
from microplan.planner.calibration.ome_positions import OME, read_positions
from microplan.planner.calibration.picture_intake import PictureIntake
from microplan.planner.calibration.picture_series import camera_noise
from microplan.planner.calibration.readings import (
    READINGS,
    PictureReadings,
    read_readings,
)
from microplan.planner.calibration.through_focus.focus_series import (
    StatedLens,
    focus_axis,
)
from microplan.planner.calibration.through_focus.point_series import (
    point_focus,
    point_part,
)
from microplan.planner.calibration.workcell_lines import with_calibrated
from microplan.planner.measure.part_task import PartCall
from microplan.planner.measure.picture_files import PictureError, files_of
from microplan.planner.source.diagnostics import (
    CallError,
    Diagnostic,
    Report,
    Span,
)
from microplan.planner.source.schema import Checked, check, with_defaults
from microplan.planner.source.source import parse
from microplan.planner.store.memo import EVERY_TIME, Memo
from microplan.planner.task.camera.check_camera import BITS, check_camera
from microplan.planner.task.camera.read_camera import read_camera
from microplan.planner.task.light.read_light import read_coherence

_STATED = ("response", "black_level", "white_level", "full_well_e")
_APART = 3.0  # standard deviations: two series contradict each other


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrateCall:
    """Pictures, and the camera's workcell."""

    pictures: Sequence[Path]  # files, and folders, those with a table a series each
    cell: Checked  # the workcell
    bits: int | None  # of the pictures, if that is stated
    part: PartCall | None = None  # that pictures with stage and focus readings show
    memo: Memo = EVERY_TIME  # keeps how the part is found


def calibrated(call: CalibrateCall, report: Report) -> list[CalibrationSeries]:
    """Return what each series of pictures tells; findings of those that do not.

    Folders with a table of readings, and OME-TIFF files whose planes have positions,
    are a series each, all other pictures frames of one still scene.
    """
    tables = [path for path in call.pictures if (path / READINGS).is_file()]
    files = [path for path in call.pictures if path.name.endswith(OME)]
    read = [read_readings(folder, report) for folder in tables]
    placed = {path: read_positions(path, report) for path in files}
    others = [
        path
        for path in call.pictures
        if path not in tables and placed.get(path) is None
    ]
    found: list[CalibrationSeries | None] = []
    if others and not report.failed:
        found.append(_still(files_of(others), call, report))
    for readings in (*read, *placed.values()):
        if readings is not None:
            found.append(_with_readings(readings, call, report))
    return [series for series in found if series is not None]


def _still(
    files: Sequence[Path | PictureError], call: CalibrateCall, report: Report
) -> CalibrationSeries | None:
    """Return what frames of a still scene tell."""
    black = stated_numbers(call.cell).get("black_level")
    noise = camera_noise(files, _camera_bits(call.cell), call.bits, report, black)
    return None if noise is None else noise.series


def _with_readings(
    readings: PictureReadings, call: CalibrateCall, report: Report
) -> CalibrationSeries | None:
    """Return what a series with readings tells."""
    moved = len({row.group for row in readings.rows}) > 1
    if readings.kind == "still" and not moved:
        return _still(readings.files, call, report)
    intake = PictureIntake(
        report=report, camera_bits=_camera_bits(call.cell), bits=call.bits
    )
    if readings.kind == "light":
        return camera_response(readings, intake, stated_numbers(call.cell))
    if readings.kind == "field":
        return even_field(readings, intake, _field_cell(call.cell))
    if call.part is None:
        what = "groups" if readings.kind == "still" else f"{readings.kind} readings"
        message = f"{what} tell something of a known part only"
        raise CallError("MP903", message, readings.file, "--part names its drawing")
    condenser = _stated_condenser(call.cell)
    if readings.kind == "condenser" and not condenser.tells(readings, report):
        return None
    if readings.kind == "focus":
        point = point_part(call.part, call.cell)
        if point is not None:
            return point_focus(readings, point, intake, _stated_lens(call.cell))
    finder = part_finder(readings, call.part, call.bits, report, call.memo)
    if finder is None:
        return None
    if readings.kind == "condenser":
        return condenser_settings(readings, finder, intake, condenser)
    if readings.kind == "focus":
        return focus_axis(readings, finder, intake, _stated_lens(call.cell))
    at = Span(file=str(readings.file))
    places = PartPlaces(finder=finder, intake=intake)
    if readings.kind == "stage":
        bend = _number(call.cell, "optics", "distortion")
        series = stage_axes(readings, places, bend)
    else:
        series = placed_stills(readings, places)
    lit = StatedLight(
        gradient=_number(call.cell, *WHERE),
        has_black=_number(call.cell, "camera", "black_level") is not None,
        coherence=read_coherence(with_defaults(call.cell.source.data, "workcell")),
    )
    series = with_light(series, places, at, lit)
    shares = stated_shares(call.cell)
    return with_discrepancy(series, places.misfits, intake, at, shares)


def _camera_bits(cell: Checked) -> int:
    """Return the bits of a workcell's camera."""
    return int(cell.source.get("camera", "bits") or BITS)


def stated_numbers(cell: Checked) -> Mapping[str, float]:
    """Return the numbers that a workcell states of its camera, by key."""
    said = {key: _number(cell, "camera", key) for key in _STATED}
    return {key: number for key, number in said.items() if number is not None}


def _number(cell: Checked, section: str, key: str) -> float | None:
    """Return a number that a workcell states, None if it states none there."""
    said = cell.source.get(section, key)
    return float(said) if isinstance(said, int | float) else None


def _stated_lens(cell: Checked) -> StatedLens:
    """Return what a workcell states of its lens."""
    rms = cell.source.get("optics", "wavefront_rms")
    aperture = _number(cell, "optics", "numerical_aperture")
    return StatedLens(aperture=aperture, has_rms=rms is not None)


def _field_cell(cell: Checked) -> FieldCell:
    """Return what a workcell states of camera and light."""
    raw, said = with_defaults(cell.source.data, "workcell"), stated_numbers(cell)
    camera = read_camera(raw["camera"])
    return FieldCell(
        response=camera.response,
        lacks=_unstated(cell),
        white=said.get("white_level"),
        gradient=_number(cell, *WHERE),
        size_px=(camera.height_px, camera.width_px),
    )


def _unstated(cell: Checked) -> str:
    """Return which keys that make light of counts are not stated, "" if all are."""
    said = {
        "response": cell.source.get("camera", "response") is not None,
        "black_level": "black_level" in stated_numbers(cell),
    }
    return " and ".join(f"no camera.{key}" for key, has in said.items() if not has)


def _stated_condenser(cell: Checked) -> StatedCondenser:
    """Return what a workcell states of its light and of what makes counts of it."""
    data = with_defaults(cell.source.data, "workcell")
    return StatedCondenser(
        kind=str(data["light"]["kind"]),
        lacks=_unstated(cell),
        coherence=_number(cell, "optics", "coherence"),
    )


def stated_shares(cell: Checked) -> Mapping[str, float]:
    """Return the shares of its discrepancy that a workcell states [1], by name."""
    said = {name: cell.source.get(SECTION, name) for name in MOST}
    return {k: float(v) for k, v in said.items() if isinstance(v, int | float)}


def first_of_each(
    series: Sequence[CalibrationSeries], where: Span, report: Report
) -> list[CalibratedValue]:
    """Return the values of all series; of those with one key the first.

    Parameters
    ----------
    series : sequence of CalibrationSeries
        In the order of the call.
    where : Span
        What findings are about.
    report : Report
        Receives MP904 for each value that is left out.
    """
    held: dict[str, tuple[CalibratedValue, str]] = {}
    for each in series:
        for value in each.values:
            first, heading = held.setdefault(value.key, (value, each.heading))
            if first is not value:
                message = f"{value.key}: {_shown(first)} by the {heading}, "
                message += f"{_shown(value)} by the {each.heading}; "
                message += _judged(first, value) + "the first is taken"
                hint = "calibrate with one series of a kind at a time"
                report.warning("MP904", where, message, hint)
    return [value for value, _ in held.values()]


def _shown(value: CalibratedValue) -> str:
    """Return a value in words."""
    if not isinstance(value.value, float):
        return f"a table of {len(value.value)} rows"
    (sigma,) = value.sigma
    return f"{value.value:.5g}" + (f" +- {sigma:.2g}" if sigma else "")


def _judged(first: CalibratedValue, other: CalibratedValue) -> str:
    """Return whether two values contradict each other, in words, "" if not known."""
    if not (isinstance(first.value, float) and isinstance(other.value, float)):
        return ""
    sigma = math.hypot(first.sigma[0] or 0.0, other.sigma[0] or 0.0)
    off = abs(first.value - other.value)
    if not sigma:
        return ""
    words = f"{off / sigma:.2g} standard deviations apart"
    return (
        f"{words}: they contradict each other; "
        if off > _APART * sigma
        else f"{words}; "
    )


def calibrated_text(
    text: str, values: Sequence[CalibratedValue], out: Path, report: Report
) -> str | None:
    """Return a workcell's text with values in it; None if it were no workcell then.

    Parameters
    ----------
    text : str
        A valid workcell file.
    values : sequence of CalibratedValue
        One of each key.
    out : Path
        Where the text will be; findings say so.
    report : Report
        Receives what the values contradict.
    """
    new = with_calibrated(text, values)
    source = parse(new, out, str(out), report)
    if source is None:
        return None
    at = Span(file=str(out))
    before = len(report.found)
    cell = check(source, "workcell", "microplan_workcell", report)
    check_camera(cell, report)
    wrong = [each for each in report.found[before:] if each.severity == "error"]
    if wrong:
        message = "values that were found are none of a workcell; nothing is written"
        report.error("MP904", at, message, _at_fault(cell, values, wrong))
        return None
    return new


def _at_fault(
    cell: Checked, values: Sequence[CalibratedValue], wrong: Sequence[Diagnostic]
) -> str:
    """Return how to mend values that errors contradict: by keys stated beside them."""
    found, said = {value.where for value in values}, " ".join(e.message for e in wrong)
    camera = cell.source.get("camera")
    stated = [key for key in camera if key in said and ("camera", key) not in found]
    if stated:
        return f"mend {' and '.join(f'camera.{key}' for key in stated)} in the workcell"
    return "take the pictures again"
