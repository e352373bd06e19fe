"""What extreme points are about: settings, shapes and scenes, made from a few words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from tests.optics.shapes import disc, rectangle

Given = Mapping[str, Any]


def optics_of(g: Given) -> Microscope:
    """Return the setting, the usual one where nothing is said."""
    return Microscope(
        aperture=g.get("aperture", 0.42),
        wavelength_um=g.get("wavelength_um", 0.6),
        medium_index=g.get("index", 1.0),
        magnification=g.get("magnification", 10.0),
        pitch_um=g.get("pitch_um", 7.5),
        width_px=g.get("width_px", 31),
        height_px=g.get("height_px", 31),
        fill_factor=g.get("fill_factor", 1.0),
    )


def shape_of(g: Given) -> Outline:
    """Return the outline a point speaks of, about (at_x, 0)."""
    x, size = g.get("at_x_um", 0.0), g.get("size_um", 0.0)
    kind = g["shape"]
    if kind == "disc":
        return disc(size, (x, 0.0))
    if kind == "square":
        return rectangle(x - size / 2, -size / 2, x + size / 2, size / 2)
    if kind == "half plane":  # 10 mm of it
        return rectangle(-1e4, -5e3, 0.0, 5e3)
    if kind == "sliver":
        return rectangle(-size / 2, -g["width_um"] / 2, size / 2, g["width_um"] / 2)
    if kind == "rounded square":
        return _rounded(size, g["fillet_um"])
    if kind == "almost a disc":
        return _almost(size, g["gap_rad"])
    raise ValueError(f"no shape {kind!r}")


def scene_of(g: Given) -> Scene:
    """Return the scene a point speaks of: one shape at one height or at several."""
    heights = g.get("heights_um", [g.get("z_um", 0.0)])
    layers = tuple(
        Layer(
            name=f"part {k}",
            outline=shape_of(g),
            z_um=z,
            reflectance=g.get("reflectance", 1.0),
        )
        for k, z in enumerate(heights)
    )
    return Scene(layers=layers, background=g.get("background", 0.0))


def _rounded(side: float, r: float) -> Outline:
    """Return a square with corners rounded by arcs of radius r."""
    h = side / 2 - r
    edges: list[Segment | Arc] = []
    for k, (cx, cy) in enumerate(((h, h), (-h, h), (-h, -h), (h, -h))):
        arc = Arc(
            center=(cx, cy),
            radius_um=r,
            start_rad=k * math.pi / 2,
            sweep_rad=math.pi / 2,
        )
        if edges:
            edges.append(Segment(start=edges[-1].end, end=arc.start))
        edges.append(arc)
    edges.append(Segment(start=edges[-1].end, end=edges[0].start))
    return Outline(rings=(Ring(edges=tuple(edges)),))


def _almost(radius: float, gap_rad: float) -> Outline:
    """Return a disc whose arc leaves a gap, closed by a chord."""
    arc = Arc(
        center=(0.0, 0.0),
        radius_um=radius,
        start_rad=0.0,
        sweep_rad=2 * math.pi - gap_rad,
    )
    return Outline(rings=(Ring(edges=(arc, Segment(start=arc.end, end=arc.start))),))
