"""What parts are made of: weight, and whether they hold a charge."""

from __future__ import annotations

from microplan.planner.task.task import Part

Bounds = tuple[float, float]

# um/s2; kg um/s2 is uN
GRAVITY_UM_PER_S2 = 9.81e6
# kg/m3 of solid bodies; what is not named may be anything from a polymer to platinum
DENSITY: dict[str, float] = {
    "nickel": 8900.0, "silicon": 2330.0, "gold": 19300.0, "copper": 8960.0,
    "silica": 2200.0, "glass": 2500.0, "steel": 7850.0, "aluminium": 2700.0,
    "su-8": 1200.0, "gaas": 5320.0, "gallium arsenide": 5320.0, "diamond": 3510.0,
}  # fmt: skip
UNKNOWN_DENSITY: Bounds = (900.0, 21500.0)
# Metals and doped semiconductors: a charge leaves them where they touch earthed ones.
CONDUCTORS = frozenset(
    ("nickel", "silicon", "gold", "copper", "steel", "aluminium", "gaas",
     "gallium arsenide")
)  # fmt: skip
# Gases have less, liquids more: water 1.33, the least of organic liquids 1.25.
LIQUID_INDEX = 1.1


def weight_un(material: str, volume_um3: float, *, medium_index: float = 1.0) -> Bounds:
    """Return the least and greatest weight of a part, uN.

    In a liquid, whose density nobody states, buoyancy may take all of it.
    """
    known = DENSITY.get(_named(material))
    low, high = UNKNOWN_DENSITY if known is None else (known, known)
    per = volume_um3 * 1e-18 * GRAVITY_UM_PER_S2
    return (0.0 if in_liquid(medium_index) else low * per), high * per


def volume_um3(part: Part) -> float:
    """Return the volume of a part with its posts."""
    posts = sum(p.outline.area_um2 * p.height_um for p in part.posts.values())
    return part.outline.area_um2 * part.thickness_um + posts


def conducts(material: str) -> bool:
    """Return whether a material is known to let charge flow; unnamed ones may not."""
    return _named(material) in CONDUCTORS


def in_liquid(medium_index: float) -> bool:
    """Return whether a medium of that refractive index is a liquid."""
    return medium_index > LIQUID_INDEX


def _named(material: str) -> str:
    return material.strip().lower()
