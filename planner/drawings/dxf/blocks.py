"""Number of entities that DXF blocks would draw, known before any is expanded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from microplan.planner.drawings.dxf.file import Block, DamagedError, DxfFile, Entity

MAX_NESTED = 64  # blocks in blocks; drawings have three or four


class EndlessError(ValueError):
    """A block holds itself, or blocks are nested too deep."""


@dataclass(frozen=True, slots=True)
class Weight:
    """Entities and vertices of a block on the selected layers, copies counted."""

    named: int = 0  # on layers that the entities name
    open: int = 0  # on layer "0", which takes the layer of the INSERT


@dataclass(frozen=True, slots=True)
class Weights:
    """The weight of the model space and of each block that it reaches."""

    model: int
    blocks: Mapping[str, Weight]  # by name in lower case


def weigh(file: DxfFile, layers: frozenset[str]) -> Weights:
    """Return how many entities and vertices `layers` hold with blocks expanded.

    Takes time in proportion to the file, whatever the numbers of copies.

    Raises
    ------
    EndlessError
        If a block that the model space reaches holds itself.
    DamagedError
        If an INSERT names a block that the file does not have.
    """
    known: dict[str, Weight] = {}
    total = _Scale(file, layers, known).weight(file.model, ())
    model = total.named + ("0" in layers) * total.open
    return Weights(model, known)


def wanted_weight(
    weights: Weights, block: Block, own: str, layers: frozenset[str]
) -> int:
    """Return the weight of a block inserted on layer `own`."""
    weight = weights.blocks[block.name.lower()]
    return weight.named + (own.lower() in layers) * weight.open


def inherited(layer: str, own: str) -> str:
    """Return the layer of what a block inserted on `own` has on `layer`."""
    return own if layer == "0" else layer


def copies(insert: Entity) -> tuple[int, int]:
    """Return how many columns and rows an INSERT has."""
    return max(insert.integer(70, 1), 1), max(insert.integer(71, 1), 1)


def hidden(file: DxfFile, layer: str, *, invisible: bool, insert: bool = False) -> str:
    """Return why an entity on `layer` is not seen, "" if it is.

    A block that is inserted on a layer that is off shows what it has on other layers.
    """
    if layer.lower() in file.frozen:
        return " on a frozen layer"
    if not insert and layer.lower() in file.off:
        return " on a layer that is off"
    return " made invisible" if invisible else ""


@dataclass(frozen=True, slots=True)
class _Scale:
    """Weighs entities; blocks that were weighed are known."""

    file: DxfFile
    layers: frozenset[str]
    known: dict[str, Weight]

    def weight(self, entities: Iterable[Entity], above: tuple[str, ...]) -> Weight:
        """Return the weight of entities in blocks `above`."""
        named = free = 0
        for entity in entities:
            layer = entity.layer.lower()
            if entity.kind == "INSERT":
                inner = self._block(entity, above)
                columns, rows = copies(entity)
                named += inner.named * columns * rows
                loose = inner.open * columns * rows + len(entity.parts)
            else:
                loose = _vertices(entity)
            if layer in self.layers and layer != "0":
                named += loose
            elif layer == "0":
                free += loose
        return Weight(named, free)

    def _block(self, insert: Entity, above: tuple[str, ...]) -> Weight:
        """Return the weight of the block that an INSERT names."""
        name = insert.text(2).lower()
        if name in self.known:
            return self.known[name]
        block = self.file.blocks.get(name)
        if block is None:
            message = f"INSERT {insert.label} names block '{insert.text(2)}', there is"
            raise DamagedError(message + " none of that name")
        if name in above:
            ring = " in ".join(f"'{n}'" for n in (*above[above.index(name) :], name))
            raise EndlessError(f"block {ring} holds itself")
        if len(above) >= MAX_NESTED:
            raise EndlessError(f"blocks are nested deeper than {MAX_NESTED}")
        if block.external:  # what it holds is unknown, and may be on any layer
            self.known[name] = Weight(0, 1)
        else:
            self.known[name] = self.weight(block.entities, (*above, name))
        return self.known[name]


def _vertices(entity: Entity) -> int:
    """Return the number of an entity's vertices, at least 1."""
    return max(entity.count(10), len(entity.parts), 1)
