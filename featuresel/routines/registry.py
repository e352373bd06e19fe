"""The registry of image routines: by name, loaded on first use."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import cast

from microplan.featuresel.routines.contract import Routine

# id -> module; loaded on first use so that the executor's start stays cheap
REGISTRY: Mapping[str, str] = {
    "circle_caliper": "microplan.featuresel.routines.circle.circle_caliper",
    "contour_match": "microplan.featuresel.routines.contour.match",
    "corner": "microplan.featuresel.routines.edge.corner",
    "ecc": "microplan.featuresel.routines.template.ecc",
    "edge_caliper": "microplan.featuresel.routines.edge.edge_caliper",
    "edge_pair": "microplan.featuresel.routines.edge.edge_pair",
    "hough": "microplan.featuresel.routines.circle.hough",
    "iso_circle": "microplan.featuresel.routines.circle.iso_circle",
    "iso_ellipse": "microplan.featuresel.routines.circle.iso_ellipse",
    "keypoints": "microplan.featuresel.routines.template.keypoints",
    "likelihood": "microplan.featuresel.routines.likelihood.likelihood",
    "line_caliper": "microplan.featuresel.routines.edge.line_caliper",
    "ncc": "microplan.featuresel.routines.template.ncc",
    "one_step": "microplan.featuresel.routines.likelihood.gauss_newton_step",
    "otsu": "microplan.featuresel.routines.template.otsu",
    "phase_correlation": "microplan.featuresel.routines.template.phase_correlation",
    "tooth_notch": "microplan.featuresel.routines.edge.tooth_notch",
}


def load(name: str) -> Routine:
    """Return the routine called `name`; KeyError if there is none."""
    return cast(Routine, importlib.import_module(REGISTRY[name]))
