"""Counts of the entities of a DXF drawing by layer, kind, with blocks expanded."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from microplan.planner.drawings.dxf.blocks import copies, hidden, inherited
from microplan.planner.drawings.dxf.file import DxfFile, Entity

MAX_ROWS = 100_000  # of work, 0.1 s: blocks on many layers could ask for 1e9

Held = Counter[tuple[str, str]]  # by layer and what: "LINE", "LINE made invisible"


@dataclass(frozen=True, slots=True)
class _Rows:
    """What a block holds, alike entities together."""

    # kind or block, layer, made invisible -> how many
    entities: Counter[tuple[str, str, bool]]
    inserts: Counter[tuple[str, str, bool]]


def held(file: DxfFile) -> tuple[Held, bool]:
    """Return how many entities each layer holds, and whether all were counted.

    Copies of blocks are multiplied, not walked; beyond MAX_ROWS products counting
    stops. Entities that are not seen are counted by the reason.
    """
    found: Held = Counter()
    for entity in file.paper:
        found[entity.layer, f"{entity.kind} in paper space"] += 1
    # copies of a block by layer, and why they are not seen, "" if they are
    times: defaultdict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
    times[""]["0", ""] = 1
    work = 0
    for name in reached(file):
        rows = _rows(file.model if not name else file.blocks[name].entities)
        for (own, outer), n in times[name].items():
            work += len(rows.entities) + len(rows.inserts)
            if work > MAX_ROWS:
                return found, False
            for (kind, layer, invisible), count in rows.entities.items():
                on = inherited(layer, own)
                why = outer or hidden(file, on, invisible=invisible)
                found[on, kind + why] += n * count
            for (block, layer, invisible), count in rows.inserts.items():
                on = inherited(layer, own)
                why = outer or hidden(file, on, invisible=invisible, insert=True)
                times[block][on, why] += n * count
    return found, True


def by_layer(found: Held) -> dict[str, int]:
    """Return how many entities each layer holds outside the paper space."""
    counts: Counter[str] = Counter()
    for (layer, what), n in found.items():
        if not what.endswith(" in paper space"):
            counts[layer] += n
    return {name: counts[name] for name in sorted(counts)}


def reached(file: DxfFile) -> list[str]:
    """Return the blocks that the model space reaches, "" for itself, holders first."""
    done: dict[str, None] = {}
    path: dict[str, Iterator[str]] = {"": _inner(file, file.model)}
    while path:
        name = next(reversed(path))
        inner = next((b for b in path[name] if b not in done and b not in path), None)
        if inner is None:
            del path[name]
            done[name] = None
        else:
            path[inner] = _inner(file, file.blocks[inner].entities)
    return list(reversed(done))


def _inner(file: DxfFile, entities: Iterable[Entity]) -> Iterator[str]:
    """Yield the blocks that entities name, those that the file has."""
    names = (e.text(2).lower() for e in entities if e.kind == "INSERT")
    return (name for name in dict.fromkeys(names) if name in file.blocks)


def _rows(entities: Iterable[Entity]) -> _Rows:
    """Return entities counted."""
    rows = _Rows(Counter(), Counter())
    for entity in entities:
        layer, invisible = entity.layer, entity.invisible
        if entity.kind != "INSERT":
            rows.entities[entity.kind, layer, invisible] += 1
            continue
        columns, lines = copies(entity)
        name = entity.text(2).lower()
        rows.inserts[name, layer, invisible] += columns * lines
        for part in entity.parts:
            rows.entities[part.kind, part.layer, part.invisible] += 1
    return rows
