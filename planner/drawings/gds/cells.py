"""The cell hierarchy of a GDSII library: cells reached, shapes placed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from microplan.planner.drawings.affine import Affine
from microplan.planner.drawings.gds.library import (
    AreaElement,
    Library,
    Structure,
    StructureReference,
)
from microplan.planner.drawings.gds.records import GdsError

MAX_DEPTH = 32  # cells inside cells
# on the selected layers, arrays counted out, a path as its pieces: long strips side by
# side, the slowest that are known, are united in 2 s
MAX_SHAPES = 6000
MAX_POINTS = 100_000  # of those shapes
ROUND_POINTS = 512  # at most of one round end of a path
MAX_UNITS = 2.0**36  # farthest from the origin, database units: 69 m of nm


@dataclass(frozen=True, slots=True)
class PlacedShape:
    """One shape where the top cell has it."""

    shape: AreaElement
    cell: str
    at: Affine


def affine(reference: StructureReference) -> Affine:
    """Return what a reference does to its structure: mirror, scale, rotate, shift.

    Quarter turns are exact.
    """
    quarter, rest = divmod(reference.angle_deg, 90.0)
    cos, sin = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarter) % 4):
        cos, sin = -sin, cos
    factor = complex(cos * reference.mag, sin * reference.mag)
    origin = complex(*reference.origin)
    return (
        Affine(b=factor, a=0j, t=origin)
        if reference.mirrored
        else Affine(factor, t=origin)
    )


def reached(library: Library, top: str) -> tuple[str, ...]:
    """Return the cells that `top` is made of, each after all that it refers to.

    Raises
    ------
    GdsError
        MP232 for a cell that is not in the file, that holds itself, or that lies more
        than MAX_DEPTH deep.
    """
    order: list[str] = []
    open_: dict[str, Iterator[StructureReference]] = {
        top: iter(library.structures[top].references)
    }
    done: set[str] = set()
    while open_:
        cell = next(reversed(open_))
        reference = next((r for r in open_[cell] if r.name not in done), None)
        if reference is None:
            del open_[cell]
            done.add(cell)
            order.append(cell)
            continue
        _refuse(library, cell, reference, open_)
        open_[reference.name] = iter(library.structures[reference.name].references)
    return tuple(order)


def _refuse(
    library: Library, cell: str, reference: StructureReference, path: Collection[str]
) -> None:
    """Raise if the reference leads nowhere, in a circle, or too deep."""
    name = reference.name
    if name not in library.structures:
        message = f"cell '{cell}' places '{name}', which the file does not hold"
        raise GdsError("MP232", reference.offset, message, "save it with all its cells")
    if name in path:
        message = f"cell '{name}' holds itself, by '{cell}'"
        raise GdsError("MP232", reference.offset, message)
    if len(path) >= MAX_DEPTH:
        message = f"cell '{name}' lies more than {MAX_DEPTH} cells deep"
        raise GdsError("MP232", reference.offset, message, "flatten it")


def held(library: Library, order: Sequence[str]) -> Counter[tuple[str, str]]:
    """Return how many elements of each layer and kind the last cell of `order` has.

    Arrays are counted out; copies are multiplied, not walked.
    """
    times: Counter[str] = Counter({order[-1]: 1})
    found: Counter[tuple[str, str]] = Counter()
    for cell in reversed(order):
        structure, n = library.structures[cell], times[cell]
        for shape in structure.shapes:
            found[shape.layer, shape.kind] += n
        for key, count in structure.skipped.items():
            found[key] += n * count
        for reference in structure.references:
            times[reference.name] += n * reference.columns * reference.rows
    return found


def expand(
    library: Library, order: Collection[str], layers: Collection[str]
) -> list[PlacedShape]:
    """Return the shapes on `layers` where the last cell of `order` has them.

    Raises
    ------
    GdsError
        MP215 if they are more than MAX_SHAPES or have more than MAX_POINTS points,
        which is known before any is placed; MP233 if one lies beyond MAX_UNITS.
    """
    weights = _weights(library, order, layers)
    *_, top = order
    found: list[PlacedShape] = []
    todo = [(top, Affine())]
    while todo:
        cell, at = todo.pop()
        structure = library.structures[cell]
        found += [
            PlacedShape(s, cell, at) for s in structure.shapes if s.layer in layers
        ]
        for reference in structure.references:
            if weights[reference.name]:
                todo += [(reference.name, a) for a in _copies(reference, at, cell)]
    return found


def _weights(
    library: Library, order: Collection[str], layers: Collection[str]
) -> Mapping[str, int]:
    """Return how many shapes on `layers` each cell holds; refuse too many."""
    shapes: dict[str, int] = {}
    points: dict[str, int] = {}
    cell = ""
    for cell in order:
        structure = library.structures[cell]
        shapes[cell], points[cell] = _own(structure, layers)
        for reference in structure.references:
            times = reference.columns * reference.rows
            shapes[cell] += times * shapes[reference.name]
            points[cell] += times * points[reference.name]
    if shapes[cell] > MAX_SHAPES or points[cell] > MAX_POINTS:
        message = (
            f"cell '{cell}' holds {shapes[cell]} shapes of {points[cell]} points on "
            f"the selected layers, allowed {MAX_SHAPES} and {MAX_POINTS}"
        )
        hint = "draw a smaller array, or select the cell of one part"
        raise GdsError("MP215", library.structures[cell].offset, message, hint)
    return shapes


def _own(structure: Structure, layers: Collection[str]) -> tuple[int, int]:
    """Return how many shapes on `layers` a cell itself has, and with how many points.

    A path counts as the pieces that it becomes: a stroke and a bend for each point.
    """
    shapes, points = 0, 0
    for shape in structure.shapes:
        if shape.layer not in layers:
            continue
        is_path = shape.kind == "PATH"
        shapes += 2 * shape.points if is_path else 1
        points += shape.points * (8 if is_path else 1)
        points += 2 * ROUND_POINTS if is_path and shape.path_type == 1 else 0
    return shapes, points


def _copies(reference: StructureReference, at: Affine, cell: str) -> Iterator[Affine]:
    """Yield where the top cell has each copy of a reference's structure."""
    one = affine(reference)
    for row in range(reference.rows):
        for column in range(reference.columns):
            (cx, cy), (rx, ry) = reference.column_step, reference.row_step
            x = one.t.real + column * cx + row * rx
            y = one.t.imag + column * cy + row * ry
            placed = at.of(replace(one, t=complex(x, y)))
            far = max(abs(placed.t.real), abs(placed.t.imag), placed.stretch)
            if not far <= MAX_UNITS:
                message = f"cell '{reference.name}' placed by '{cell}' is out of range"
                raise GdsError("MP233", reference.offset, message)
            yield placed
