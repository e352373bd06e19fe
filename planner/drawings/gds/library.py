"""A GDSII library: records in, structures with their elements out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from microplan.planner.drawings.gds.records import (
    GdsError,
    GdsRecord,
    bits,
    integers,
    reals,
    records,
    text,
)

# KLayout keeps notes for itself in a structure of this name; it is no drawing
CONTEXT = "$$$CONTEXT_INFO$$$"
UNIT_M = (1e-13, 1e-2)  # of one database unit: what a drawing can mean, generously

_ABSOLUTE = 0x0006  # bits of STRANS: magnification or angle not to be compounded
_MIRROR = 0x8000
MAX_MAG = 1e6  # and its inverse
MAX_DEG = 3600.0

ShapeKind = Literal["BOUNDARY", "PATH", "BOX"]
_EVERYWHERE = {"ELFLAGS", "PLEX", "PROPATTR", "PROPVALUE"}
_NEEDED = {
    "BOUNDARY": {"LAYER", "DATATYPE", "XY"},
    "PATH": {"LAYER", "DATATYPE", "XY"},
    "BOX": {"LAYER", "BOXTYPE", "XY"},
    "SREF": {"SNAME", "XY"},
    "AREF": {"SNAME", "XY", "COLROW"},
    "TEXT": {"LAYER", "TEXTTYPE", "XY", "STRING"},
    "NODE": {"LAYER", "NODETYPE", "XY"},
}
_TRANSFORM = {"STRANS", "MAG", "ANGLE"}
_ALLOWED = {
    "PATH": {"PATHTYPE", "WIDTH", "BGNEXTN", "ENDEXTN"},
    "SREF": _TRANSFORM,
    "AREF": _TRANSFORM,
    "TEXT": {"PRESENTATION", "PATHTYPE", "WIDTH", *_TRANSFORM},
}
_AFTER_NAME = {"REFLIBS", "FONTS", "ATTRTABLE", "GENERATIONS", "FORMAT", "MASK",
               "ENDMASKS"}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class AreaElement:
    """One element that covers an area; lengths in database units."""

    kind: ShapeKind
    layer: str  # "1/0": layer/datatype
    xy: bytes  # (N, 2) big-endian int32
    offset: int
    path_type: int = 0
    width: int = 0  # negative: not to be scaled by magnifications
    begin: int = 0  # extensions of path type 4
    end: int = 0

    @property
    def points(self) -> int:
        """Return how many points it lists."""
        return len(self.xy) // 8


@dataclass(frozen=True, slots=True, kw_only=True)
class StructureReference:
    """A structure placed once, or in columns and rows; lengths in database units."""

    name: str
    offset: int
    origin: tuple[int, int]
    columns: int = 1
    rows: int = 1
    column_step: tuple[float, float] = (0.0, 0.0)
    row_step: tuple[float, float] = (0.0, 0.0)
    mirrored: bool = False  # about the x axis, before it is rotated
    mag: float = 1.0
    angle_deg: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Structure:
    """A cell: its shapes, its references, and counts of what was passed over."""

    name: str
    offset: int
    shapes: tuple[AreaElement, ...]
    references: tuple[StructureReference, ...]
    skipped: Mapping[tuple[str, str], int]  # layer, "TEXT" or "NODE" -> how many


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """Everything of a file that a drawing needs."""

    unit_um: float  # one database unit
    user_unit_m: float  # what the file calls its unit
    structures: Mapping[str, Structure]  # without KLayout's context

    @property
    def tops(self) -> tuple[str, ...]:
        """Return the cells that no other one refers to, in the order of their names."""
        placed = {r.name for s in self.structures.values() for r in s.references}
        return tuple(sorted(set(self.structures) - placed))


def read_library(data: bytes) -> Library:
    """Return the library in a stream file.

    Raises
    ------
    GdsError
        MP230 where the format is broken, MP232 where a cell is defined twice, MP233
        where a reference has no exact reading.
    """
    stream = records(data)
    for name in ("HEADER", "BGNLIB"):
        _expect(next(stream), name)
    record = next(stream)
    while record.name in ("LIBDIRSIZE", "SRFNAME", "LIBSECUR"):
        record = next(stream)
    _expect(record, "LIBNAME")
    record = next(stream)
    while record.name in _AFTER_NAME:
        record = next(stream)
    unit_um, user_unit_m = _units(_expect(record, "UNITS"))
    structures: dict[str, Structure] = {}
    for record in stream:
        if record.name == "ENDLIB":
            continue  # the stream looks at what follows
        found = _structure(_expect(record, "BGNSTR"), stream)
        if found.name in structures:
            message = f"cell '{found.name}' is defined twice"
            raise GdsError("MP232", found.offset, message)
        structures[found.name] = found
    structures.pop(CONTEXT, None)
    return Library(unit_um=unit_um, user_unit_m=user_unit_m, structures=structures)


def _expect(record: GdsRecord, name: str) -> GdsRecord:
    """Return the record if it is the one expected here."""
    if record.name != name:
        message = f"{record.name} stands where {name} must"
        raise GdsError("MP230", record.offset, message)
    return record


def _units(record: GdsRecord) -> tuple[float, float]:
    """Return a database unit in um, and the user unit in m.

    Twelve digits are kept: 1e-9 m is 1e-3 um whatever its last bit.
    """
    in_user, in_m = reals(record)
    low, high = UNIT_M
    if not (low <= in_m <= high and low <= in_m <= high * in_user):
        message = f"UNITS says {in_user:.6g} user units and {in_m:.6g} m"
        hint = f"a database unit must have {low:g} to {high:g} m"
        raise GdsError("MP230", record.offset, message, hint)
    return float(f"{in_m * 1e6:.12g}"), float(f"{in_m / in_user:.12g}")


def _structure(first: GdsRecord, stream: Iterator[GdsRecord]) -> Structure:
    """Return the structure that begins with BGNSTR."""
    name = text(_expect(next(stream), "STRNAME"))
    shapes: list[AreaElement] = []
    references: list[StructureReference] = []
    skipped: Counter[tuple[str, str]] = Counter()
    for record in stream:
        if record.name == "ENDSTR":
            break
        if record.name == "STRCLASS":
            continue
        if record.name not in _NEEDED:
            message = f"{record.name} stands where an element of '{name}' must begin"
            raise GdsError("MP230", record.offset, message)
        parts = _element(record, stream)
        if record.name in ("SREF", "AREF"):
            references.append(_reference(record, parts, name))
        elif record.name in ("TEXT", "NODE"):
            skipped[_layer(parts, f"{record.name}TYPE"), record.name] += 1
        else:
            shapes.append(_shape(record, parts))
    return Structure(
        name=name, offset=first.offset, shapes=tuple(shapes),
        references=tuple(references), skipped=dict(skipped),
    )  # fmt: skip


def _element(first: GdsRecord, stream: Iterator[GdsRecord]) -> dict[str, GdsRecord]:
    """Return the records of an element by name; properties are not kept."""
    needed = _NEEDED[first.name]
    allowed = needed | _EVERYWHERE | _ALLOWED.get(first.name, set())
    parts: dict[str, GdsRecord] = {}
    for record in stream:
        if record.name == "ENDEL":
            break
        if record.name not in allowed:
            message = f"{record.name} does not belong into {first.name}"
            raise GdsError("MP230", record.offset, message)
        if record.name in parts and not record.name.startswith("PROP"):
            message = f"{record.name} stands twice in {first.name}"
            raise GdsError("MP230", record.offset, message)
        parts[record.name] = record
    missing = sorted(needed - set(parts))
    if missing:
        message = f"{first.name} lacks {', '.join(missing)}"
        raise GdsError("MP230", first.offset, message)
    return parts


def _shape(first: GdsRecord, parts: Mapping[str, GdsRecord]) -> AreaElement:
    """Return a boundary, path or box."""
    kind: ShapeKind = "BOUNDARY"
    if first.name != "BOUNDARY":
        kind = "PATH" if first.name == "PATH" else "BOX"
    return AreaElement(
        kind=kind,
        layer=_layer(parts, "BOXTYPE" if kind == "BOX" else "DATATYPE"),
        xy=parts["XY"].body,
        offset=first.offset,
        path_type=_integer(parts, "PATHTYPE"),
        width=_integer(parts, "WIDTH"),
        begin=_integer(parts, "BGNEXTN"),
        end=_integer(parts, "ENDEXTN"),
    )


def _layer(parts: Mapping[str, GdsRecord], datatype: str) -> str:
    """Return an element's layer and datatype, or its equivalent."""
    return f"{bits(parts['LAYER'])}/{bits(parts[datatype])}"


def _integer(parts: Mapping[str, GdsRecord], name: str) -> int:
    """Return the integer of a record, 0 if it is not there as the format has it."""
    return integers(parts[name])[0] if name in parts else 0


def _reference(
    first: GdsRecord, parts: Mapping[str, GdsRecord], cell: str
) -> StructureReference:
    """Return a placement; what programs read differently is refused."""
    xy = integers(parts["XY"])
    wanted = 2 if first.name == "SREF" else 6
    if len(xy) != wanted:
        message = f"{first.name} has {len(xy) // 2} points, {wanted // 2} needed"
        raise GdsError("MP230", first.offset, message)
    strans = bits(parts["STRANS"]) if "STRANS" in parts else 0
    if strans & _ABSOLUTE:
        message = (
            f"{first.name} in cell '{cell}' has an absolute magnification or angle"
        )
        raise GdsError("MP233", first.offset, message, "save it with relative ones")
    mag = reals(parts["MAG"])[0] if "MAG" in parts else 1.0
    angle = reals(parts["ANGLE"])[0] if "ANGLE" in parts else 0.0
    if not (1 / MAX_MAG <= mag <= MAX_MAG and abs(angle) <= MAX_DEG):
        message = (
            f"{first.name} in cell '{cell}' is magnified {mag:.6g} times and turned "
            f"{angle:.6g} degrees, allowed {1 / MAX_MAG:g} to {MAX_MAG:g} and "
            f"{MAX_DEG:g} at most"
        )
        raise GdsError("MP233", first.offset, message)
    placed = StructureReference(
        name=text(parts["SNAME"]), offset=first.offset, origin=(xy[0], xy[1]),
        mirrored=bool(strans & _MIRROR), mag=mag, angle_deg=angle,
    )  # fmt: skip
    return placed if first.name == "SREF" else _array(placed, parts["COLROW"], xy, cell)


def _array(
    one: StructureReference, colrow: GdsRecord, xy: tuple[int, ...], cell: str
) -> StructureReference:
    """Return a placement in columns and rows; XY gives what lies behind the last."""
    columns, rows = integers(colrow)
    if columns < 1 or rows < 1:
        message = f"AREF in cell '{cell}' has {columns} columns and {rows} rows"
        raise GdsError("MP230", one.offset, message)
    x, y = one.origin
    return replace(
        one,
        columns=columns,
        rows=rows,
        column_step=((xy[2] - x) / columns, (xy[3] - y) / columns),
        row_step=((xy[4] - x) / rows, (xy[5] - y) / rows),
    )
