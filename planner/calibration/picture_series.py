"""Pictures of one still scene read from files, and what they tell of the camera."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from microplan.planner.calibration.count_levels import CountLevels, count_levels
from microplan.planner.calibration.photon_transfer import NoiseRow, noise_rows
from microplan.planner.calibration.still_frames import StillScene
from microplan.planner.measure.picture_files import (
    PictureCounts,
    PictureError,
    pages_of,
)
from microplan.planner.measure.picture_light import full_scale
from microplan.planner.source.diagnostics import Report, Span

CODE = "MP904"
_CUT = 0.001  # share of counts that a few odd pixels have
FEWEST_FRAMES = 8  # of which each pixel's variance is known to about half of itself


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseByLevel:
    """What still frames tell of a camera, in counts of its own bits."""

    frames: int
    levels: CountLevels
    rows: tuple[NoiseRow, ...]
    sha256: str  # of the pictures' counts, in their order


def camera_noise(
    files: Sequence[Path | PictureError],
    camera_bits: int,
    bits: int | None,
    report: Report,
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
    """
    frames = _Frames(report=report, camera_bits=camera_bits, bits=bits)
    for file in files:
        if isinstance(file, PictureError):
            frames.refuse(file)
            continue
        for page in pages_of(file, frames.other_size):
            frames.add(page)
    return frames.result(files)


@dataclass(slots=True, kw_only=True)
class _Frames:
    """Frames as they are read."""

    report: Report
    camera_bits: int
    bits: int | None
    scene: StillScene | None = None
    top: int = 0
    last: bytes = b""
    first: str = ""  # name of the first
    digest: str = ""

    def other_size(self, rows: int, columns: int) -> tuple[str, str] | None:
        """Return why a picture is not taken, None if it is as large as the first."""
        if self.scene is None or (rows, columns) == self.scene.total.shape:
            return None
        height, width = self.scene.total.shape
        return (
            f"it is {columns} x {rows} px, {self.first} is {width} x {height}",
            "calibrate with pictures of one size at a time",
        )

    def refuse(self, error: PictureError) -> None:
        """Report a picture that cannot be used."""
        self.report.error(error.code, Span(file=error.file), str(error), error.hint)

    def add(self, page: PictureCounts | PictureError) -> None:
        """Take one picture, or report why not."""
        if isinstance(page, PictureError):
            self.refuse(page)
            return
        key = hashlib.sha256(page.counts.tobytes()).digest()
        if key == self.last:
            message = f"{page.name} has exactly the pixels of the picture before it"
            hint = "take another picture: a copy has no noise of its own"
            self.report.warning(CODE, Span(file=str(page.path)), message, hint)
            return
        self.last = key
        self.digest = hashlib.sha256(self.digest.encode() + key).hexdigest()
        if self.scene is None:
            most, first = float(page.counts.max()), page.counts
            self.top = full_scale(most, page.file_bits, self.camera_bits, self.bits)
            self.first, self.scene = page.name, StillScene.of(first, self.top)
        else:
            self.scene.add(page.counts)

    def result(self, files: Sequence[Path | PictureError]) -> NoiseByLevel | None:
        """Return what all frames tell, None if it was reported why they do not."""
        scene, where = self.scene, Span(file=str(files[0]) if files else "")
        count = 0 if scene is None else scene.frames
        if scene is None or count < FEWEST_FRAMES:
            message = f"{count} pictures tell no noise, {FEWEST_FRAMES} are needed"
            hint = "take more of one still scene, nothing moved or changed between them"
            self.report.error(CODE, where, message, hint)
            return None
        levels = count_levels(scene.codes, self.top)
        if levels.highest > self.top:
            message = f"counts reach {levels.highest}, full scale is {self.top}"
            self.report.error(CODE, where, message, "state it with --bits")
            return None
        own = 2**self.camera_bits - 1
        if self.top != own:
            message = f"the pictures' full scale is {self.top}, the workcell's camera "
            message += f"counts to {own}"
            hint = "mend camera.bits in the workcell, or state --bits"
            self.report.error(CODE, where, message, hint)
            return None
        rows = noise_rows(scene, levels)
        self._doubts(levels, rows, where)
        if not rows:
            return None
        return NoiseByLevel(
            frames=count,
            levels=levels,
            rows=rows,
            sha256=self.digest,
        )

    def _doubts(
        self, levels: CountLevels, rows: Sequence[NoiseRow], where: Span
    ) -> None:
        """Report what the pictures do not tell, and what to photograph instead."""
        if not rows:
            message = "no pixel is clear of edges and of where counts are cut off"
            hint = "photograph a chart or a field with even patches between dark and "
            self.report.error(CODE, where, message, hint + "bright")
        if levels.step > 1:
            message = f"all counts are multiples of {levels.step}"
            hint = "the camera has fewer bits: save its own counts, and state --bits"
            self.report.warning(CODE, where, message, hint)
        if levels.dark_share > _CUT:
            message = f"{levels.dark_share:.0%} of the counts are 0: the black level "
            message += "cuts off, and the noise in the dark is not told"
            hint = "raise the camera's offset and take them again"
            self.report.warning(CODE, where, message, hint)
        if levels.white_share > _CUT:
            message = f"{levels.white_share:.0%} of the counts are saturated, at "
            message += f"{levels.white_level}"
            hint = "expose for a shorter time, and take them again"
            self.report.warning(CODE, where, message, hint)
