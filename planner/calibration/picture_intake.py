"""Pictures of one camera as they are read: one size, one scale, no copies, a hash."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

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
    digest: str = ""  # sha256 of the hashes of the counts, in their order
    met: set[str] = field(default_factory=set)  # names of pictures, copies too
    _size: tuple[int, int] | None = None
    _first: str = ""
    _seen: dict[bytes, int] = field(default_factory=dict)

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

    def _is_new(self, page: PictureCounts) -> bool:
        """Return whether a picture is no copy; it is taken then, else reported."""
        self.met.add(page.name)
        key = hashlib.sha256(page.counts.tobytes()).digest()
        if key in self._seen:
            message = f"{page.name} has exactly the pixels of picture "
            message += f"{self._seen[key]} of its series"
            hint = "take another picture: a copy has no noise of its own"
            self.report.warning(CODE, Span(file=str(page.path)), message, hint)
            return False
        self.taken += 1
        self._seen[key] = self.taken
        self.digest = hashlib.sha256(self.digest.encode() + key).hexdigest()
        if self._size is None:
            rows, columns = page.counts.shape
            self._size, self._first = (rows, columns), page.name
            most = float(page.counts.max())
            self.top = full_scale(most, page.file_bits, self.camera_bits, self.bits)
        return True
