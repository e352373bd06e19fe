"""Points of an image where edges of layers of different height come close."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from microplan.arrays import Box, FloatArray
from microplan.optics.outline.clip import EdgeArrays, clip, grown
from microplan.optics.render.fidelity import steps
from microplan.optics.render.pixels import axis_px
from microplan.optics.render.scene import Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope

# Edges farther than this beyond the blur do not matter, in wavelengths / A: the image
# of an endless edge is 1 / (20 pi**3) from its end there.
_TAIL = 20.0
_SPACING = 0.5  # of nodes along edges, in wavelengths / A
_NODES = 20_000  # of a face; beyond, the spacing grows
_NEAR = 3.0  # wavelengths / A beyond both blurs: edges that meet
_TAKEN = 160  # nodes a face, for each other face
_AROUND = 4  # points a node
_GOLDEN_RAD = math.pi * (3 - math.sqrt(5))


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerFace:
    """All layers of one height, and their edges near a window."""

    z_um: float  # above the plane in focus
    layers: tuple[Layer, ...]
    nodes_um: FloatArray  # (N, 2), along the edges
    spacing_um: float  # of neighbouring nodes
    blur_um: float  # radius of the blur circle
    step: float  # the largest step of reflectance at its edges


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Points of an image near edges of two faces."""

    at_um: FloatArray  # (N, 2) in the plane in focus
    away_um: FloatArray  # (faces, N) from the nearest edge of each, never too large
    # (faces, N) length of edges within the blur, or a Fresnel zone if that is smaller,
    # and `_NEAR`, over that of a straight edge: more than 1 if several are near
    crowding: FloatArray


def faces(
    scene: Scene, microscope: Microscope, focus_um: float, window: Window
) -> list[LayerFace]:
    """Return the faces whose blurred edges come near a window, the lowest first."""
    airy = microscope.wavelength_um / microscope.aperture
    pairs = list(zip(scene.layers, steps(scene), strict=True))
    found = []
    for z_um in sorted({layer.z_um for layer in scene.layers}):
        own = tuple(layer for layer in scene.layers if layer.z_um == z_um)
        step = max(step for layer, step in pairs if layer.z_um == z_um)
        blur = microscope.blur_diameter_um(z_um - focus_um) / 2
        box = grown(seen_um(microscope, window), blur + _TAIL * airy)
        nodes, spacing = _nodes([clip(o.outline, box) for o in own], box, airy)
        if len(nodes):
            face = LayerFace(
                z_um=z_um - focus_um,
                layers=own,
                nodes_um=nodes,
                spacing_um=spacing,
                blur_um=blur,
                step=step,
            )
            found.append(face)
    return found


def meeting_points(
    found: Sequence[LayerFace], microscope: Microscope, window: Window
) -> Points:
    """Return points where edges of two faces come nearest, inside a window.

    They lie around edges of either, as far as the sharper of the two is blurred; points
    outside are moved onto the window's border.
    """
    airy = microscope.wavelength_um / microscope.aperture
    seen = seen_um(microscope, window)
    trees = [cKDTree(face.nodes_um) for face in found]
    parts = [np.empty((0, 2))]
    for i, j in itertools.combinations(range(len(found)), 2):
        if found[i].step == 0:  # what is hidden looks like what is behind it
            continue
        pair = (found[i], trees[i]), (found[j], trees[j])
        reach = sum(face.blur_um for face, _ in pair) + _NEAR * airy
        radius = min(face.blur_um for face, _ in pair) + airy
        for (face, _), (_, tree) in (pair, pair[::-1]):
            nodes = face.nodes_um
            beyond = np.abs(nodes - np.clip(nodes, seen[:2], seen[2:])).max(axis=1)
            away = tree.query(nodes)[0] + beyond
            taken = _spread(away, max(reach, float(away.min()) + airy))
            around = _around(nodes[taken], radius)
            parts.append(np.clip(around, seen[:2], seen[2:]))
    at = np.concatenate(parts)
    distance, crowding = np.zeros((2, len(found), len(at)))
    for k, (face, tree) in enumerate(zip(found, trees, strict=True)):
        distance[k] = np.maximum(tree.query(at)[0] - face.spacing_um / 2, 0)
        # farther apart, edges of one face diffract each on its own
        fresnel = math.sqrt(
            microscope.wavelength_um * abs(face.z_um) / microscope.medium_index
        )
        radius = min(face.blur_um, fresnel) + _NEAR * airy
        length = tree.query_ball_point(at, radius, return_length=True)
        crowding[k] = length * face.spacing_um / (2 * radius)
    return Points(at_um=at, away_um=distance, crowding=crowding)


def seen_um(microscope: Microscope, window: Window) -> Box:
    """Return the box of a window in the plane in focus, um."""
    cx, cy = axis_px(microscope)
    p = microscope.um_per_px
    left, top = (window.column - 0.5 - cx) * p, (cy - window.row + 0.5) * p
    return (left, top - window.rows * p, left + window.columns * p, top)


def _spread(away: FloatArray, near: float) -> npt.NDArray[np.intp]:
    """Return nodes up to `near`: the nearest, and as many evenly among the others."""
    order = np.argsort(np.round(away / near, 9), kind="stable")  # equals in order
    inside = np.flatnonzero(away <= near)
    if len(inside) <= _TAKEN:
        return inside
    evenly = inside[np.linspace(0, len(inside) - 1, _TAKEN // 2).astype(np.intp)]
    return np.union1d(order[: _TAKEN // 2], evenly)


def _around(nodes: FloatArray, radius: float) -> FloatArray:
    """Return points in discs around nodes, the nodes themselves among them."""
    i = np.arange(len(nodes) * _AROUND)
    r = radius * np.sqrt(i % _AROUND / _AROUND)
    offset = np.stack([r * np.cos(_GOLDEN_RAD * i), r * np.sin(_GOLDEN_RAD * i)], 1)
    return np.asarray(np.repeat(nodes, _AROUND, axis=0) + offset)


def _inside(points: FloatArray, box: Box) -> FloatArray:
    x, y = points.T
    inside: FloatArray = points[
        (x >= box[0]) & (x <= box[2]) & (y >= box[1]) & (y <= box[3])
    ]
    return inside


def _nodes(
    parts: Sequence[EdgeArrays], box: Box, airy: float
) -> tuple[FloatArray, float]:
    """Return nodes evenly along edges, but not along the box, and their spacing, um."""
    lines = np.concatenate([part.segments for part in parts])
    arcs = np.concatenate([part.arcs for part in parts])
    lengths = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    total = float(lengths.sum() + (arcs[:, 2] * np.abs(arcs[:, 4])).sum())
    spacing = max(_SPACING * airy, total / _NODES)
    line, t = _places(lengths, spacing)
    flat = lines[line, :2] + t[:, None] * (lines[line, 2:] - lines[line, :2])
    arc, t = _places(arcs[:, 2] * np.abs(arcs[:, 4]), spacing)
    cx, cy, radius, start, sweep = arcs[arc].T
    angle = start + t * sweep
    bent = np.stack([cx + radius * np.cos(angle), cy + radius * np.sin(angle)], axis=1)
    nodes = np.concatenate([flat, bent])
    rim = grown(box, -1e-9 * (box[2] - box[0]))  # cut bodies have edges along the box
    return _inside(nodes, rim), spacing


def _places(
    lengths: FloatArray, spacing: float
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the edge and the position 0..1 on it of each node."""
    count = np.maximum(np.ceil(lengths / spacing), 1).astype(np.intp)
    edge = np.repeat(np.arange(len(count)), count)
    index = np.arange(len(edge)) - (np.cumsum(count) - count)[edge]
    return edge, (index + 0.5) / count[edge]
