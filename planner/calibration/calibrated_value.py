"""One value that pictures tell, with how surely, how, and of which pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from microplan.planner.calibration.estimates import BlockEstimate

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureSource:
    """The pictures that a value was found in."""

    pictures: int
    sha256: str  # of their counts


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedValue:
    """A value, or a table of them, and what the workcell states of it."""

    key: str  # of the block `calibrated`
    value: float | Rows  # a table: by rows
    sigma: tuple[float | None, ...]  # standard deviations; None: not known
    unit: str  # "1": none
    method: str
    source: PictureSource
    where: tuple[str, str] | None = None  # section and key of the workcell; None: none
    text: str = ""  # the line's value as YAML; "": the value itself
    stated: float | None = None  # by the workcell so far

    @property
    def pull(self) -> float | None:
        """Return value less stated over the standard deviation, None if not known."""
        if self.stated is None or not isinstance(self.value, float) or not self.sigma:
            return None
        (sigma,) = self.sigma
        return (self.value - self.stated) / sigma if sigma else None

    @property
    def line(self) -> str:
        """Return the value as YAML, in one line."""
        if self.text:
            return self.text
        if isinstance(self.value, float):
            return f"{self.value:.6g}"
        rows = (", ".join(f"{number:.6g}" for number in row) for row in self.value)
        return "[" + ", ".join(f"[{row}]" for row in rows) + "]"

    @property
    def record(self) -> dict[str, Any]:
        """Return what the block `calibrated` says of it."""
        found: dict[str, Any] = {}
        if isinstance(self.value, float):
            found["value"] = float(f"{self.value:.6g}")
        sigma = [None if s is None else float(f"{s:.3g}") for s in self.sigma]
        if any(s is not None for s in sigma):
            single = isinstance(self.value, float)
            found["standard_deviation"] = sigma[0] if single else sigma
        return found | {
            "method": self.method,
            "pictures": self.source.pictures,
            "sha256": self.source.sha256,
        }


@dataclass(slots=True, kw_only=True)
class CalibrationCurve:
    """Points of one chart, and a line through them."""

    points: Sequence[tuple[float, float]]
    line: Sequence[tuple[float, float]] = ()


@dataclass(slots=True, kw_only=True)
class CalibrationSeries:
    """All that one series of pictures tells."""

    heading: str
    values: tuple[CalibratedValue, ...]
    notes: tuple[str, ...] = ()  # in words, what is no value
    curves: dict[str, CalibrationCurve] = field(default_factory=dict)


def single(
    key: str,
    found: BlockEstimate,
    source: PictureSource,
    *,
    unit: str = "1",
    where: tuple[str, str] | None = None,
    stated: float | None = None,
) -> CalibratedValue:
    """Return an estimate of one number as a value of some pictures."""
    return CalibratedValue(
        key=key,
        value=float(found.value),
        sigma=(found.sigma,),
        unit=unit,
        method=found.method,
        source=source,
        where=where,
        stated=stated,
    )
