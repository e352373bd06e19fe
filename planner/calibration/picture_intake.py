"""Pictures of one camera as they are read: one size, one scale, no copies, a hash."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from microplan.planner.calibration.calibrated_value import PictureSource
from microplan.planner.measure.picture_files import (
    PictureCounts,
    PictureError,
    pages_of,
)
from microplan.planner.measure.picture_light import full_scale
from microplan.planner.source.diagnostics import Report, Span

CODE = "MP904"


@dataclass(slots=True, kw_only=True)
class PictureIntake:
    """What pictures have in common; one picture is in memory at a time."""

    report: Report
    camera_bits: int  # of the workcell's camera
    bits: int | None  # of the pictures, if that is stated
    top: int = 0  # full scale, counts
    taken: int = 0
    met: set[str] = field(default_factory=set)  # names of pictures, copies too
    _size: tuple[int, int] | None = None
    _first: str = ""
    _seen: dict[bytes, int] = field(default_factory=dict)
    _copies: list[tuple[str, Path, int]] = field(default_factory=list)

    def pages(self, files: Sequence[Path | PictureError]) -> Iterator[PictureCounts]:
        """Yield the pictures of files; what cannot be used is reported."""
        for file in files:
            if isinstance(file, PictureError):
                self._refuse(file)
                continue
            for page in pages_of(file, self._other_size):
                if isinstance(page, PictureError):
                    self._refuse(page)
                elif self._is_new(page):
                    yield page
        self._report_copies()

    def source(self, numbers: Collection[int] | None = None) -> PictureSource:
        """Return the pictures taken, with a hash of the hashes of their counts.

        Those of some numbers, counted from 1 as they are `taken`, or all.
        """
        keys = [k for k, n in self._seen.items() if numbers is None or n in numbers]
        digest = ""
        for key in keys:
            digest = hashlib.sha256(digest.encode() + key).hexdigest()
        return PictureSource(pictures=len(keys), sha256=digest)

    def fits(self, highest: float, where: Span) -> bool:
        """Return whether counts fit the workcell's camera; else report it."""
        message, hint, own = "", "state it with --bits", 2**self.camera_bits - 1
        if highest > self.top:
            message = f"counts reach {highest:.0f}, full scale is {self.top}"
        elif self.top != own:
            message = f"the pictures' full scale is {self.top}, the workcell's camera "
            message += f"counts to {own}"
            hint = "mend camera.bits in the workcell, or state --bits"
        if message:
            self.report.error(CODE, where, message, hint)
        return not message

    def _other_size(self, rows: int, columns: int) -> tuple[str, str] | None:
        """Return why a picture is not taken, None if it is as large as the first."""
        if self._size is None or (rows, columns) == self._size:
            return None
        height, width = self._size
        return (
            f"it is {columns} x {rows} px, {self._first} is {width} x {height}",
            "calibrate with pictures of one size at a time",
        )

    def _refuse(self, error: PictureError) -> None:
        """Report a picture that cannot be used."""
        self.report.error(error.code, Span(file=error.file), str(error), error.hint)

    def _report_copies(self) -> None:
        """Report pictures that are copies, all at once: there may be many."""
        if not self._copies:
            return
        (name, path, number), more = self._copies[0], len(self._copies) - 1
        message = f"{name} has exactly the pixels of picture {number} of its series"
        message += f", and {more} more are copies" if more else ""
        hint = "take another picture: a copy has no noise of its own"
        self.report.warning(CODE, Span(file=str(path)), message, hint)
        self._copies.clear()

    def _is_new(self, page: PictureCounts) -> bool:
        """Return whether a picture is no copy; it is taken then, else reported."""
        self.met.add(page.name)
        key = hashlib.sha256(page.counts.tobytes()).digest()
        if key in self._seen:
            self._copies.append((page.name, page.path, self._seen[key]))
            return False
        self.taken += 1
        self._seen[key] = self.taken
        if self._size is None:
            rows, columns = page.counts.shape
            self._size, self._first = (rows, columns), page.name
            most = float(page.counts.max())
            self.top = full_scale(most, page.file_bits, self.camera_bits, self.bits)
        return True
