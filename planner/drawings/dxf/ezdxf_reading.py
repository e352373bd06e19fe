"""Reading of a DXF file by ezdxf in its own process: counts, extents.

The library may be slow, take much memory or fail in any way on files that are odd; its
process is killed, and the compiler goes on.
"""

from __future__ import annotations

import json
import logging
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from io import StringIO
from typing import Any, TypedDict

import ezdxf
from ezdxf.document import Drawing
from ezdxf.lldxf.tagger import binary_tags_loader
from ezdxf.math import Matrix44

from microplan.planner.drawings.dxf.tags import is_binary, text_of

MAX_VISITS = 40_000  # entities that extents are taken of, blocks expanded
MAX_FIXES = 100  # of the audit, that are reported

_FRAME = 16  # flag of a vertex that is a control point

Row = tuple[str, str, str, int]  # block, "" for the model space; layer; kind; number
Bounds = tuple[float, float, float, float]


class Question(TypedDict):
    """What is asked about a file; lengths in drawing units."""

    memory: int  # bytes that the process may take
    layers: list[list[str]]  # of each outline, in lower case
    fine: list[float]  # how far chords may run inside the curves of each


class EzdxfAnswer(TypedDict, total=False):
    """What ezdxf found, or the error that it ended with."""

    error: str
    before: list[Row]  # the audit
    after: list[Row]
    fixes: list[str]
    bounds: list[Bounds | None]  # of each outline, None if not known


def main() -> None:
    """Read a line with a Question and then the file from stdin, print an Answer."""
    question: Question = json.loads(sys.stdin.buffer.readline())
    out, sys.stdout = sys.stdout, sys.stderr  # for whatever the library prints
    _bound_memory(question["memory"])
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())
    try:
        answer = answer_to(sys.stdin.buffer.read(), question)
    except Exception as error:  # noqa: BLE001 - the library raises whatever comes
        answer = EzdxfAnswer(error=f"{type(error).__name__}: {error}"[:200])
    out.write(json.dumps(answer))


def answer_to(data: bytes, question: Question) -> EzdxfAnswer:
    """Return what the library makes of a file.

    Raises
    ------
    Exception
        Of any kind, if it cannot read the file.
    """
    document = _load(data)
    before = _rows(document)
    bounds = [
        _bounds(document, frozenset(layers), fine)
        for layers, fine in zip(question["layers"], question["fine"], strict=True)
    ]
    audit = document.audit()
    fixes = [f"{found.message}"[:200] for found in (*audit.fixes, *audit.errors)]
    return EzdxfAnswer(
        before=before, after=_rows(document), fixes=fixes[:MAX_FIXES], bounds=bounds
    )


def _load(data: bytes) -> Drawing:
    """Return the file as the library reads it strictly, without its repairs."""
    if is_binary(data):
        return Drawing.load(binary_tags_loader(data, errors="surrogateescape"))
    text = StringIO(text_of(data), newline=None)
    return ezdxf.read(text)  # type: ignore[attr-defined]  # re-exported by ezdxf


def _rows(document: Drawing) -> list[Row]:
    """Return how many entities the model space and each block hold."""
    places: dict[str, Any] = {"": document.modelspace()}
    for block in document.blocks:
        if not block.is_any_layout:
            places[block.name.lower()] = block
    return [
        (name, layer, kind, count)
        for name, place in places.items()
        for (layer, kind), count in Counter(
            (_layer(entity), entity.dxftype()) for entity in place
        ).items()
    ]


def _bounds(document: Drawing, layers: frozenset[str], fine: float) -> Bounds | None:
    """Return the extent of all lines on `layers`, None if not known."""
    walk = _LibraryWalk(document, layers, fine)
    xs: list[float] = []
    ys: list[float] = []
    try:
        for chain in walk.chains(document.modelspace(), "0", Matrix44()):
            x, y = [p[0] for p in chain], [p[1] for p in chain]
            if max(x) > min(x) or max(y) > min(y):  # what has no length is left out
                xs += min(x), max(x)
                ys += min(y), max(y)
    except _NoExtentError:
        return None
    return (min(xs), min(ys), max(xs), max(ys)) if xs else None


class _NoExtentError(Exception):
    """The library has too much to do for an extent, or draws it wrong."""


class _LibraryWalk:
    """Goes through blocks with the library's matrices.

    Only these are multiplied: blocks in blocks that it transforms itself lose shear.
    """

    def __init__(self, document: Drawing, layers: frozenset[str], fine: float) -> None:
        self.layers = layers
        self.fine = fine
        self.visits = 0
        table = list(document.layers)
        self.frozen = {layer.dxf.name.lower() for layer in table if layer.is_frozen()}
        self.off = {layer.dxf.name.lower() for layer in table if layer.is_off()}

    def chains(
        self, entities: Iterable[Any], own: str, frame: Matrix44
    ) -> Iterator[list[Any]]:
        """Yield the corners of what is seen on the selected layers."""
        x, y = frame.ux, frame.uy
        fine = self.fine / max(x.magnitude + y.magnitude, 1e-9)
        for entity in entities:
            self._count()
            layer = _layer(entity)
            layer = own if layer == "0" else layer
            if layer in self.frozen or _is_invisible(entity):
                continue
            if entity.dxftype() == "INSERT":
                yield from self._block(entity, layer, frame)
            elif layer in self.layers and layer not in self.off:
                for chain in _corners(entity, fine):
                    yield list(frame.transform_vertices(chain))

    def _block(self, insert: Any, own: str, frame: Matrix44) -> Iterator[list[Any]]:
        """Yield the corners of every copy of a block."""
        block = insert.block()
        for copy in insert.multi_insert() if insert.mcount > 1 else [insert]:
            self._count()  # it may be empty
            if block is not None:
                yield from self.chains(block, own, copy.matrix44() @ frame)

    def _count(self) -> None:
        self.visits += 1
        if self.visits > MAX_VISITS:
            raise _NoExtentError


def _layer(entity: Any) -> str:
    """Return an entity's layer; "0" for kinds that the library keeps as raw tags."""
    known = entity.dxf.is_supported("layer")
    return (entity.dxf.layer.lower() if known else "") or "0"


def _is_invisible(entity: Any) -> bool:
    known = entity.dxf.is_supported("invisible")
    return bool(known and entity.dxf.get("invisible", 0))


def _corners(entity: Any, fine: float) -> Iterator[list[Any]]:
    """Yield the corners of an entity cut into chords."""
    kind = entity.dxftype()
    if kind == "LINE":
        yield [entity.dxf.start, entity.dxf.end]
    elif kind in ("CIRCLE", "ARC"):
        yield list(entity.flattening(min(fine, entity.dxf.radius / 100)))
    elif kind == "ELLIPSE":
        yield list(entity.flattening(fine))
    elif kind == "SPLINE":
        knots, degree = list(entity.knots), entity.dxf.degree
        if len(set(knots[: degree + 1])) > 1 or len(set(knots[-degree - 1 :])) > 1:
            raise _NoExtentError  # it draws those with open ends beyond them
        yield list(entity.flattening(fine))
    elif kind in ("LWPOLYLINE", "POLYLINE"):
        if kind == "POLYLINE":  # the library draws control points as corners, too
            knees = entity.vertices
            knees[:] = [v for v in knees if not v.dxf.flags & _FRAME]
        for piece in entity.virtual_entities():
            yield from _corners(piece, fine)
    elif kind in ("SOLID", "TRACE"):
        yield list(entity.wcs_vertices())


def _bound_memory(most: int) -> None:
    """Limit the memory of the process, where the system can."""
    try:
        import resource
    except ImportError:  # Windows; time alone is bounded there
        return
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
