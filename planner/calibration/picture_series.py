"""Pictures of one still scene read from files, and the noise that they tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
    PictureSource,
)
from microplan.planner.calibration.count_levels import CountLevels, count_levels
from microplan.planner.calibration.estimates import Refused
from microplan.planner.calibration.noise_line import NoiseLine, noise_line
from microplan.planner.calibration.photon_transfer import CHART, NoiseRow, noise_rows
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.response.code_levels import CodeUse, code_use
from microplan.planner.calibration.still_frames import StillScene
from microplan.planner.measure.picture_files import PictureError
from microplan.planner.source.diagnostics import Report, Span

_CUT = 0.001  # share of counts that a few odd pixels have
FEWEST_FRAMES = 8  # of which each pixel's variance is known to about half of itself


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseByLevel:
    """What still frames tell of a camera, in counts of its own bits."""

    frames: int
    levels: CountLevels
    rows: tuple[NoiseRow, ...]
    source: PictureSource
    black_level: float | None  # counts without light; None: not known

    @property
    def line(self) -> NoiseLine | Refused:
        """Return the noise as a line over the level, if that explains it."""
        return noise_line(self.rows)

    @property
    def series(self) -> CalibrationSeries:
        """Return the noise as lines of a workcell."""
        table = CalibratedValue(
            key="noise_table",
            value=tuple((row.level, row.variance) for row in self.rows),
            sigma=tuple(row.sigma for row in self.rows),
            unit="counts, counts^2",
            method="differences of successive pictures of a still scene",
            source=self.source,
            where=("camera", "noise_table"),
        )
        points = [(row.level, row.variance) for row in self.rows]
        line = self.line
        through: list[tuple[float, float]] = []
        if isinstance(line, NoiseLine):
            slope, at_zero = line.gain.value, line.at_zero.value
            ends = (points[0][0], points[-1][0])
            through = [(level, at_zero + slope * level) for level in ends]
        return CalibrationSeries(
            heading=f"noise in {self.frames} pictures",
            values=(table,),
            notes=(*_by_level(self.rows), _line_words(line, self.black_level)),
            curves={"photon transfer": CalibrationCurve(points=points, line=through)},
        )


def camera_noise(
    files: Sequence[Path | PictureError],
    camera_bits: int,
    bits: int | None,
    report: Report,
    black_level: float | None = None,
) -> NoiseByLevel | None:
    """Return what frames of a still scene tell of a camera, None if too little.

    Parameters
    ----------
    files : sequence of Path or PictureError
        As `microplan.planner.measure.picture_files.files_of` returns them, in the order
        of time.
    camera_bits : int
        Of the workcell's camera.
    bits : int, optional
        Of the pictures, if that is stated.
    report : Report
        Receives MP901 for pictures that cannot be used, MP904 for what all of them do
        not tell.
    black_level : float, optional
        As stated, counts.
    """
    intake = PictureIntake(report=report, camera_bits=camera_bits, bits=bits)
    scene: StillScene | None = None
    for page in intake.pages(files):
        if scene is None:
            scene = StillScene.of(page.counts, intake.top)
        else:
            scene.add(page.counts)
    if scene is None and report.failed:
        return None
    where = Span(file=str(files[0]) if files else "")
    if scene is None or scene.frames < FEWEST_FRAMES:
        message = f"{intake.taken} pictures tell no noise, {FEWEST_FRAMES} are needed"
        hint = "take more of one still scene, nothing moved or changed between them"
        report.error(CODE, where, message, hint)
        return None
    levels = count_levels(scene.codes, intake.top)
    if not intake.fits(levels.highest, where):
        return None
    rows = noise_rows(scene, levels)
    if not rows:
        message = "no pixel is clear of edges and of where counts are cut off"
        report.error(CODE, where, message, f"photograph {CHART}")
    doubts(levels, code_use(scene.codes, camera_bits), where, report)
    if not rows:
        return None
    return NoiseByLevel(
        frames=scene.frames,
        levels=levels,
        rows=rows,
        source=intake.source(),
        black_level=black_level,
    )


def doubts(
    levels: CountLevels, use: CodeUse | Refused, where: Span, report: Report
) -> None:
    """Report where counts are cut off and left out, and what to do about it."""
    if levels.step > 1:
        message = f"all counts are multiples of {levels.step}"
        hint = "the camera has fewer bits: save its own counts, and state --bits"
        report.warning(CODE, where, message, hint)
    elif isinstance(use, CodeUse) and use.missing:
        message = f"{use.missing} counts never occur between others that often do"
        hint = "a table in the camera leaves them out: switch it off"
        report.warning(CODE, where, message, hint)
    if levels.dark_share > _CUT:
        message = f"{levels.dark_share:.0%} of the counts are 0: the black level "
        message += "cuts off, and the noise in the dark is not told"
        hint = "raise the camera's offset and take them again"
        report.warning(CODE, where, message, hint)
    if levels.white_share > _CUT:
        message = f"{levels.white_share:.0%} of the counts are saturated, at "
        message += f"{levels.white_level}"
        hint = "expose for a shorter time, and take them again"
        report.warning(CODE, where, message, hint)


def _by_level(rows: Sequence[NoiseRow]) -> list[str]:
    """Return the noise by level in words."""
    lines = []
    for row in rows:
        noise = row.variance**0.5
        words = f"at {row.level:8.1f} counts: {noise:.3g}"
        if row.sigma is not None:
            words += f" +- {row.sigma / 2 / noise:.2g}"
        lines.append(words)
    return lines


def _line_words(line: NoiseLine | Refused, black: float | None) -> str:
    """Return whether photons and read noise explain the noise."""
    if isinstance(line, Refused):
        return f"no {line.what}: {line.why}; photograph {line.take}"
    if not line.suffices:
        return "photons and read noise do not explain it: the table does"
    electrons = 1 / line.gain.value
    words = f"photons and read noise explain it: {electrons:.4g}"
    if line.gain.sigma is not None:
        words += f" +- {electrons * line.gain.sigma / line.gain.value:.2g}"
    words += " electrons a count"
    if black is None:  # in darkness counts are not 0
        return words
    return f"{words}, {line.read_noise_e(black):.3g} of read noise"
