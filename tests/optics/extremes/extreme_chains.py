"""Extreme points of what stands on the renderer: choices, tiles, hiding and lenses."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.optics.raster import coverage
from microplan.arrays import FloatArray
from microplan.optics.layers.occlusion import occluded
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.lens import LensErrors
from microplan.optics.oracle import Oracle
from microplan.optics.outline.outline import Outline
from microplan.optics.render.fidelity import LADDER, Fidelity, choose
from microplan.optics.render.render import render
from microplan.optics.render.sampling import band_cut, margin_error, margin_um
from microplan.optics.render.scene import Illumination, Scene
from microplan.optics.render.tile_aliasing import margin_for, wrap_error
from tests.optics.extremes.extreme_givens import Given, optics_of, scene_of, shape_of


def _scene(g: Given) -> Scene:
    """Return the scene, without a layer if no shape is given."""
    if "shape" in g:
        return scene_of(g)
    return Scene(layers=(), background=g.get("background", 0.0))


def _chosen(g: Given) -> Fidelity:
    return choose(
        _scene(g), optics_of(g), focus_um=tuple(g["focus_um"]), limit=g["limit"]
    )


def _understated(g: Given) -> float:
    """Return by how much the oracle finds more error than predicted, 0 if none."""
    found, optics, outline = _chosen(g), optics_of(g), shape_of(g)
    worst = 0.0
    for focus in g["focus_um"]:
        image = render(
            scene_of(g),
            optics,
            focus_um=focus,
            model=found.model,
            sampling=found.sampling,
        )
        oracle = Oracle.of(outline, optics, deepest_um=abs(focus))
        error = float(np.abs(image - oracle.image("exact", -focus)).max())
        worst = max(worst, error - oracle.wrap_error - found.predicted_error)
    return max(worst, 0.0)


def _wrapped(g: Given) -> float:
    outline = shape_of(g) if "shape" in g else Outline(rings=())
    return wrap_error(outline, optics_of(g), g["margin"])


def _hidden(g: Given) -> FloatArray:
    return occluded(_scene(g), optics_of(g), focus_um=g.get("focus_um", 0.0))


def _farthest(g: Given) -> float:
    """Return the value of the occluded frame farthest from what is expected."""
    image = _hidden(g).ravel()
    return float(image[np.argmax(np.abs(image - g["all"]))])


def _as_one(g: Given) -> float:
    """Return the largest difference of coincident layers from the highest alone."""
    alone = {key: value for key, value in g.items() if key != "heights_um"}
    alone["z_um"] = max(g["heights_um"])
    image = render(_scene(alone), optics_of(g), focus_um=g.get("focus_um", 0.0))
    return float(np.abs(_hidden(g) - image).max())


def _lens_change(g: Given) -> float:
    """Return the largest change of an image by a lens' errors."""
    errors, optics, scene = LensErrors(**g["errors"]), optics_of(g), scene_of(g)
    seen = render(
        lens_scene(scene, optics, errors, 0.0),
        optics,
        focus_um=0.0,
        light=Illumination(gradient_x=errors.gradient_x, gradient_y=errors.gradient_y),
    )
    return float(np.abs(seen - render(scene, optics, focus_um=0.0)).max())


def _lens_aperture(g: Given) -> float:
    table = tuple((m, a) for m, a in g["apertures"])
    return LensErrors(apertures=table).aperture_at(g["magnification"])


CHAINS: Mapping[str, Callable[[Given], float]] = {
    "fidelity.rung": lambda g: float(LADDER.index(_chosen(g).model)),
    "fidelity.predicted": lambda g: _chosen(g).predicted_error,
    "fidelity.keeps": lambda g: float(_chosen(g).keeps_limit),
    "fidelity.understated": _understated,
    "sampling.cut": lambda g: band_cut(
        g.get("model", "exact"), optics_of(g), g["z_um"], g["error"]
    ),
    "sampling.margin_um": lambda g: margin_um(optics_of(g), g["z_um"]),
    "sampling.margin_error": lambda g: margin_error(g["margin"]),
    "wrap.error": _wrapped,
    "wrap.margin": lambda g: margin_for(shape_of(g), optics_of(g), g["error"]),
    "raster.area": lambda g: float(
        coverage(shape_of(g), optics_of(g)).sum() * optics_of(g).um_per_px ** 2
    ),
    "occluded.worst": _farthest,
    "occluded.as_one": _as_one,
    "lens.change": _lens_change,
    "lens.aperture": _lens_aperture,
}
