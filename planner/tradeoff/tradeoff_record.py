"""Record of a tradeoff of images: methods, steps, their CSV, JSON or table."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

from microplan.schemas.codec import DIGITS, to_data

_NOT_OF_A_ROW = ("ways", "focus_heights_um", "layers_in_view")


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMethod:
    """One method of rendering a look's image: its time, its errors.

    Errors are of unit contrast, over all pixels of the region. The model's errors are
    against the exact model with the layers treated alike, the largest of all focus
    heights, and None where layers hide one another ray by ray; the others are against
    traced layers at the nominal focus.
    """

    model: str  # of defocus
    layers: str  # "blend" or "occluded"
    band_error: float  # what cutting the band may cost, of unit contrast
    margin: float  # around all that blurs light, in wavelengths / A
    float_bits: int  # of the transforms, 64 or 32
    rays_per_cell: int  # of occluded layers, else 0
    time_ms: float  # of one image, one thread, the least of several
    law_max_error: float | None
    law_rms_error: float | None
    max_error: float
    rms_error: float
    is_choice: bool  # what the compiler takes
    on_law_front: bool  # no other is both faster and nearer the exact model
    on_front: bool  # no other is both faster and nearer the traced layers


@dataclass(frozen=True, slots=True, kw_only=True)
class StepTradeoff:
    """All methods of rendering the first look of a step."""

    step: str
    look: str
    target: str
    magnification: float
    focus_um: float  # world height of the plane in focus
    focus_heights_um: tuple[float, ...]  # that the model is measured at
    row: int  # of the region in the frame
    column: int
    rows: int
    columns: int
    um_per_px: float
    layers_in_view: tuple[str, ...]
    limit: float  # image error that the compiler may make, of unit contrast
    predicted_error: float  # of its choice: model, band, margin and tables
    predicted_layer_error: float  # of its choice: hidden layers, and their diffraction
    law_oracle: str  # what the model's errors are measured against
    law_oracle_error: float  # its own, a bound
    oracle: str  # what all errors together are measured against
    oracle_error: float  # its own: how far coarser cells and fewer rays are off
    floor_ms: float  # CPU time of one real transform of the region, there and back
    ways: tuple[MeasuredMethod, ...]

    @property
    def choice(self) -> MeasuredMethod:
        """Return what the compiler takes."""
        return next(method for method in self.ways if method.is_choice)

    @property
    def has_layers(self) -> bool:
        """Return whether layers of different height are in view."""
        return any(method.layers == "occluded" for method in self.ways)


@dataclass(frozen=True, slots=True, kw_only=True)
class Tradeoff:
    """What is measured of a task, on which machine, with which versions."""

    format_version: str
    task: str
    note: str
    machine: str  # system and kind of processor
    microplan: str
    python: str
    numpy: str
    scipy: str
    repeats: int  # of which the least time is taken
    steps: tuple[StepTradeoff, ...]


def json_text(found: object, digits: int = DIGITS) -> str:
    """Return the JSON of a record, keys in the order of its fields."""
    return json.dumps(to_data(found, digits), indent=2, ensure_ascii=False) + "\n"


def csv_rows(names: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return rows of values below their names; a value that is None is left empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return stream.getvalue()


def csv_text(found: Tradeoff) -> str:
    """Return one row for every method of every step."""
    of_step = [f.name for f in fields(StepTradeoff) if f.name not in _NOT_OF_A_ROW]
    of_method = [f.name for f in fields(MeasuredMethod)]
    return csv_rows(
        of_step + of_method,
        (
            [getattr(step, name) for name in of_step]
            + [getattr(method, name) for name in of_method]
            for step in found.steps
            for method in step.ways
        ),
    )


def aligned(rows: Sequence[Sequence[str]], words: int) -> list[str]:
    """Return rows of text in columns, the first `words` to the left, others right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            text.ljust(width) if k < words else text.rjust(width)
            for k, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def table(step: StepTradeoff) -> str:
    """Return the step's Pareto front and the compiler's choice as lines of text."""
    layered = step.has_layers  # else fronts differ by what is in focus alone
    shown = [
        method
        for method in step.ways
        if method.is_choice or method.on_law_front or (method.on_front and layered)
    ]
    head = (
        f"{step.step}: {step.target} at {step.magnification:.4g} x, focus "
        f"{step.focus_um:g} um, {step.columns} x {step.rows} px, "
        f"limit {step.limit:g}"
    )
    last = f"  > the compiler's choice: {_said(step)}"
    ordered = sorted(shown, key=lambda method: method.time_ms)
    rows = ["  " + line for line in aligned(_rows(ordered), words=3)]
    return "\n".join([head, *rows, last])


def _said(step: StepTradeoff) -> str:
    """Return what the choice was predicted to err, and what it errs."""
    choice = step.choice
    parts = []
    if choice.law_max_error is not None:
        parts.append(
            f"law and sampling predicted {step.predicted_error:.2g}, "
            f"measured {choice.law_max_error:.2g}"
        )
    if step.has_layers:
        total = step.predicted_error + step.predicted_layer_error
        parts.append(
            f"with layers and their diffraction predicted {total:.2g}, "
            f"against traced rays {choice.max_error:.2g}"
        )
    return "; ".join(parts)


def _rows(methods: Iterable[MeasuredMethod]) -> list[tuple[str, ...]]:
    """Return a row of text for every method, under a row of headings."""
    rows: list[tuple[str, ...]] = [
        ("", "law", "layers", "band", "margin", "bits", "ms", "law err", "total")
    ]
    for method in methods:
        rows.append(
            (
                ">" if method.is_choice else "",
                method.model,
                f"{method.rays_per_cell} rays" if method.rays_per_cell else "blend",
                f"{method.band_error:.0e}",
                f"{method.margin:.3g}",
                str(method.float_bits),
                f"{method.time_ms:.3g}",
                "" if method.law_max_error is None else f"{method.law_max_error:.1e}",
                f"{method.max_error:.1e}",
            )
        )
    return rows


def _cell(value: object) -> object:
    """Return a value as a cell: six digits, yes and no as 1 and 0."""
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple):
        return "; ".join(value)
    return value
