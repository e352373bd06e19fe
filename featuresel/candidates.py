"""Chains of routines worth trying on a kind of target, coarse to fine."""

from __future__ import annotations

from featuresel.routines import Target

Chain = tuple[str, ...]

_PLACE: dict[str, tuple[Chain, ...]] = {
    "circle": (
        ("otsu", "circle_caliper"),
        ("ncc", "circle_caliper"),
        ("circle_caliper",),
        ("ncc",),
        ("otsu",),
    ),
    "teeth": (
        ("otsu", "circle_caliper"),
        ("ncc", "circle_caliper"),
        ("circle_caliper",),
        ("ncc",),
        ("otsu",),
    ),
    "outline": (("ncc",), ("otsu", "ncc"), ("otsu",)),
    "jaws": (("edge_caliper",), ("ncc", "edge_caliper"), ("ncc",)),
}


def chains(target: Target) -> tuple[Chain, ...]:
    """Return the chains to try on `target`, in a fixed order.

    A toothed part with a notch is tried with and without the angle, because the trials
    decide whether the angle is needed.
    """
    found = _PLACE[target.kind]
    if target.kind == "teeth" and "notch_rad" in target.parameters:
        return tuple((*chain, "tooth_notch") for chain in found) + found
    return found
