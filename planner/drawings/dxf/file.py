"""A DXF file as its tables: layers, block definitions, entities, nothing lost.

Every entity of the sections ENTITIES and BLOCKS is kept with its raw tags; nothing is
repaired, left out or filled in, so what cannot be understood can be said.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from microplan.planner.drawings.dxf.tags import DxfError, Tags, read_tags, unescaped

# on all layers together, with vertices and table entries: looked through in 2 s
MAX_ITEMS = 150_000

_COMMENT = 999  # group code
_FROZEN = 1  # bit of a layer's flags
_XREF = 4 | 8 | 32  # bits of a block's flags: its content is in another file
_READ = frozenset(("HEADER", "TABLES", "BLOCKS", "ENTITIES"))  # of the sections


@dataclass(slots=True)
class Entity:
    """One entity: its tags in order, and the vertices or attributes that follow it."""

    kind: str
    tags: Tags
    first: int  # of its tags, after its kind
    last: int  # of its tags, not included
    parts: list[Entity] = field(default_factory=list)

    def indices(self, code: int) -> Iterator[int]:
        """Return the indices of the tags with a group code, in order."""
        return self.tags.where(code, self.first, self.last)

    def count(self, code: int) -> int:
        """Return how many values of a group code there are."""
        return self.tags.codes[self.first : self.last].count(code)

    def text(self, code: int, default: str = "") -> str:
        """Return the first value of a group code as text."""
        for at in self.indices(code):
            return unescaped(str(self.tags.values[at]).strip())
        return default

    def number(self, code: int, default: float | None = None) -> float:
        """Return the first value of a group code; ValueError if it is no number."""
        for at in self.indices(code):
            return finite(self.tags, at)
        if default is None:
            raise ValueError(f"{self.kind} lacks its group {code}")
        return default

    def integer(self, code: int, default: int | None = None) -> int:
        """Return the first value of a group code; ValueError if it is not whole."""
        value = self.number(code, default)
        if value != int(value):
            raise ValueError(f"group {code} of {self.kind} is {value}")
        return int(value)

    def numbers(self, code: int) -> list[float]:
        """Return all values of a group code."""
        return [finite(self.tags, at) for at in self.indices(code)]

    def point(self, code: int, default: complex | None = None) -> complex:
        """Return x + i y of the point whose x has this code."""
        if default is not None and not self.count(code):
            return default
        return complex(self.number(code), self.number(code + 10))

    def points(self, code: int) -> list[complex]:
        """Return x + i y of all points whose x has this code."""
        x, y = self.numbers(code), self.numbers(code + 10)
        if len(x) != len(y):
            raise ValueError(f"{self.kind} has {len(x)} x and {len(y)} y")
        return [complex(*xy) for xy in zip(x, y, strict=True)]

    @property
    def layer(self) -> str:
        """Return the name of its layer."""
        return self.text(8, "0") or "0"

    @property
    def place(self) -> str:
        """Return its line or byte in the file."""
        return self.tags.place(self.first - 1)

    @property
    def label(self) -> str:
        """Return the handle by which a CAD program finds it, or its line or byte."""
        handle = self.text(5)
        return f"#{handle}" if handle else self.place

    @property
    def in_paper(self) -> bool:
        """Return whether it belongs to the paper space."""
        return self.text(67, "0") == "1"

    @property
    def invisible(self) -> bool:
        """Return whether it is switched off by itself."""
        return self.text(60, "0") == "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A block definition."""

    name: str
    base: complex
    entities: tuple[Entity, ...]
    external: bool  # a reference to another file


@dataclass(frozen=True, slots=True, kw_only=True)
class DxfFile:
    """What a DXF file holds; names of layers and blocks in lower case are keys."""

    version: str  # "AC1009" is R12
    units: int  # $INSUNITS, 0 if it has none
    items: int  # groups 0: entities of all sections, and what holds them
    off: frozenset[str]  # layers
    frozen: frozenset[str]
    blocks: Mapping[str, Block]
    model: tuple[Entity, ...]
    paper: tuple[Entity, ...]


def finite(tags: Tags, index: int) -> float:
    """Return a tag's value as a number; ValueError if it is none or not finite."""
    value = tags.values[index]
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or "_" in str(value):
        said, place = str(value).strip()[:20], tags.place(index)
        raise ValueError(f"group {tags.codes[index]} at {place} is {said!r}, no number")
    return number


class CrowdedError(ValueError):
    """The file holds more entities than are looked through."""


class DamagedError(ValueError):
    """The file can be read, and something in it leads nowhere."""


def read_dxf(data: bytes) -> DxfFile:
    """Return the content of a DXF file.

    Raises
    ------
    DxfError
        If it is not a whole DXF file.
    CrowdedError
        If it has more than MAX_ITEMS entities, on whatever layers.
    DamagedError
        If vertices or attributes are where none can be, or blocks do not end.
    ValueError
        If a number that is needed is none.
    """
    tags = read_tags(data)
    sections = _sections(tags)
    if not {"ENTITIES", "BLOCKS"} & sections.keys():
        raise DxfError("it has no section of entities")
    header = _header(sections.get("HEADER", []))
    blocks = _blocks(sections.get("BLOCKS", []))
    drawn = _linked(sections.get("ENTITIES", []))
    for block in blocks.values():
        if block.name.lower() in ("*model_space", "$model_space"):
            drawn = [*block.entities, *drawn]
    paper = [entity for entity in drawn if entity.in_paper]
    for block in blocks.values():
        if block.name.lower().startswith(("*paper_space", "$paper_space")):
            paper += block.entities
    layers = [item for item in sections.get("TABLES", []) if item.kind == "LAYER"]
    return DxfFile(
        version=header.get("$ACADVER", ""),
        units=int(float(header.get("$INSUNITS", "0"))),
        items=tags.codes.count(0),
        off=_names(layer for layer in layers if layer.number(62, 7) < 0),
        frozen=_names(layer for layer in layers if layer.integer(70, 0) & _FROZEN),
        blocks=blocks,
        model=tuple(entity for entity in drawn if not entity.in_paper),
        paper=tuple(paper),
    )


def _sections(tags: Tags) -> dict[str, list[Entity]]:
    """Return the items of the sections that are read; what has no type is one item."""
    found: dict[str, list[Entity]] = {}
    items: list[Entity] | None = None
    count = tags.codes.count(0)
    if count > MAX_ITEMS:
        raise CrowdedError(f"it holds {count} entities, at most {MAX_ITEMS}")
    marks = [*tags.where(0), len(tags.codes)]
    if any(code != _COMMENT for code in tags.codes[: marks[0]]):
        raise DxfError(f"group {tags.codes[0]} at {tags.place(0)} is in no section")
    for at, after in pairwise(marks):
        kind = str(tags.values[at]).strip().upper()
        if kind == "SECTION":
            name = Entity(kind, tags, at + 1, after).text(2).upper()
            if items is not None or not name:
                raise DxfError(f"a section at {tags.place(at)} has no name or no place")
            items = found.setdefault(name, []) if name in _READ else []
            items.append(Entity(name, tags, at + 1, after))
        elif items is None:
            raise DxfError(f"{kind[:20]} at {tags.place(at)} is in no section")
        elif kind == "ENDSEC":
            items = None
        else:
            items.append(Entity(kind, tags, at + 1, after))
    if items is not None:
        raise DxfError("its last section does not end")
    return found


def _header(items: Sequence[Entity]) -> dict[str, str]:
    """Return the first value of each header variable."""
    values: dict[str, str] = {}
    name = ""
    for item in items[:1]:
        for at in range(item.first, item.last):
            value = str(item.tags.values[at]).strip()
            if item.tags.codes[at] == 9:
                name = value.upper()
            else:
                values.setdefault(name, value)
    return values


def _linked(items: Iterable[Entity]) -> list[Entity]:
    """Return entities with the vertices and attributes that follow them."""
    found: list[Entity] = []
    owner: Entity | None = None
    for item in items:
        if item.kind in _READ:
            continue
        if item.kind in ("VERTEX", "ATTRIB", "SEQEND"):
            if owner is None:
                raise DamagedError(f"{item.kind} at {item.place} belongs to nothing")
            if item.kind == "SEQEND":
                owner = None
            else:
                owner.parts.append(item)
            continue
        if owner is not None:
            raise DamagedError(f"{owner.kind} {owner.label} has no end")
        found.append(item)
        follows = item.kind == "INSERT" and item.text(66) == "1"
        owner = item if follows or item.kind == "POLYLINE" else None
    if owner is not None:
        raise DamagedError(f"{owner.kind} {owner.label} has no end")
    return found


def _blocks(items: Sequence[Entity]) -> dict[str, Block]:
    """Return the block definitions by name in lower case."""
    blocks: dict[str, Block] = {}
    head: Entity | None = None
    inner: list[Entity] = []
    for item in items:
        if item.kind == "BLOCK":
            if head is not None:
                raise DamagedError(f"block '{head.text(2)}' does not end")
            head, inner = item, []
        elif item.kind == "ENDBLK" and head is not None:
            name = head.text(2)
            if name.lower() in blocks:
                raise DamagedError(f"block '{name}' is defined twice")
            blocks[name.lower()] = Block(
                name=name,
                base=head.point(10, 0j),
                entities=tuple(_linked(inner)),
                external=bool(head.integer(70, 0) & _XREF),
            )
            head = None
        elif head is not None:
            inner.append(item)
        elif item.kind not in _READ:
            raise DamagedError(f"{item.kind} at {item.place} is in no block")
    if head is not None:
        raise DamagedError(f"block '{head.text(2)}' does not end")
    return blocks


def _names(layers: Iterable[Entity]) -> frozenset[str]:
    """Return the names of layers, lower case as DXF compares them."""
    return frozenset(layer.text(2).lower() for layer in layers)
