"""Outlines taken from a drawing, counts by layer of entities taken or ignored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from microplan.optics.outline.outline import Outline
from microplan.planner.source.diagnostics import Span

Counts = Mapping[tuple[str, str], int]  # by layer and what it is


@dataclass(frozen=True, slots=True, kw_only=True)
class Taken:
    """An outline with the layers that it was taken from."""

    outline: Outline  # um, in the drawing's frame
    chord_um: float  # farthest that its edges miss a curve of the drawing
    layers: tuple[str, ...]
    at: Span  # where they are asked for
    taken: Counts
    skipped: Counts  # left out by rules that look at more than one entity
    plain: bool = True  # its extent is that of its entities: no strokes, no hatches


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRow:
    """What became of the entities of one layer."""

    layer: str
    selected: bool
    taken: tuple[tuple[str, int], ...]  # what, how many
    ignored: tuple[tuple[str, int], ...]


def layer_rows(held: Counts, takes: Sequence[Taken]) -> tuple[LayerRow, ...]:
    """Return a row for each layer, in the order of their names.

    Parameters
    ----------
    held : counts
        Everything in the drawing; kinds as in `Taken.taken`, or with a reason why
        they are not seen.
    takes : sequence of Taken
        All that was taken from it.
    """
    chosen = {name.lower() for take in takes for name in take.layers}
    names: dict[str, str] = {}  # in DXF "A" and "a" are one layer
    for layer, _ in (*held, *(key for take in takes for key in take.taken)):
        names.setdefault(layer.lower(), layer)
    left = _folded(held)
    taken: dict[str, dict[str, int]] = {}
    for take in takes:
        for layer, row in _folded(take.skipped).items():
            _ruled_out(left.get(layer, {}), row)
        for layer, row in _folded(take.taken).items():
            if layer not in taken:  # a post may share it
                taken[layer] = row
                for kind, n in row.items():
                    _remove(left.setdefault(layer, {}), kind, n)
    return tuple(
        LayerRow(
            layer=names[key],
            selected=key in chosen,
            taken=tuple(sorted(taken.get(key, {}).items())),
            ignored=tuple(sorted(left.get(key, {}).items())),
        )
        for key in sorted(names)
    )


def _folded(counts: Counts) -> dict[str, dict[str, int]]:
    """Return counts by layer in lower case, then by what they are."""
    found: dict[str, dict[str, int]] = {}
    for (layer, what), n in counts.items():
        row = found.setdefault(layer.lower(), {})
        row[what] = row.get(what, 0) + n
    return found


def _ruled_out(left: dict[str, int], row: Mapping[str, int]) -> None:
    """Give what is left over the reasons that the reader had.

    Blocks that are not seen are counted by what they hold.
    """
    for what, n in row.items():
        kind = what.partition(" ")[0]
        if what not in left and kind in left:
            _remove(left, kind, n)
            left[what] = n


def _remove(row: dict[str, int], kind: str, n: int) -> None:
    """Take `n` of a kind out of a row."""
    row[kind] = row.get(kind, 0) - n
    if row[kind] <= 0:
        del row[kind]
