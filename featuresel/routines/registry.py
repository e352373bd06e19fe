"""Registry of image routines: by name, loaded on first use."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import fields

from microplan.featuresel.routines.contract import Routine

_HERE = "microplan.featuresel.routines."
# id -> module:attribute; loaded on first use so that the executor's start stays cheap
REGISTRY: Mapping[str, str] = {
    "circle_caliper": _HERE + "circle.circle_caliper:CIRCLE_CALIPER",
    "contour_match": _HERE + "contour.match:CONTOUR_MATCH",
    "corner": _HERE + "edge.straight_edges:CORNER",
    "ecc": _HERE + "template.ecc:ECC",
    "edge_caliper": _HERE + "edge.edge_caliper:EDGE_CALIPER",
    "edge_pair": _HERE + "edge.straight_edges:EDGE_PAIR",
    "hough": _HERE + "circle.hough:HOUGH",
    "iso_circle": _HERE + "circle.iso_fit:ISO_CIRCLE",
    "iso_ellipse": _HERE + "circle.iso_fit:ISO_ELLIPSE",
    "keypoints": _HERE + "template.keypoints:KEYPOINTS",
    "likelihood": _HERE + "likelihood.likelihood:LIKELIHOOD",
    "line_caliper": _HERE + "edge.straight_edges:LINE_CALIPER",
    "ncc": _HERE + "template.ncc:NCC",
    "one_step": _HERE + "likelihood.likelihood:ONE_STEP",
    "otsu": _HERE + "template.otsu:OTSU",
    "phase_correlation": _HERE + "template.phase_correlation:PHASE_CORRELATION",
    "tooth_notch": _HERE + "edge.tooth_notch:TOOTH_NOTCH",
}
# constants of a module, as routines were declared before
_RETIRED = {
    "GIVES": "provides",
    "NEEDS": "requires",
    "DEAR": "expensive",
    "CONTROL": "baseline",
}


def load(name: str) -> Routine:
    """Return the declaration of the routine called `name`.

    Raises
    ------
    KeyError
        If the registry has none of this name.
    TypeError
        If its line in the registry does not lead to a `Routine`.
    """
    module_name, _, attribute = REGISTRY[name].partition(":")
    module = importlib.import_module(module_name)
    found = getattr(module, attribute, None) if attribute else None
    if isinstance(found, Routine):
        return found
    old = [f"{a} is now {b}" for a, b in _RETIRED.items() if hasattr(module, a)]
    raise TypeError(
        f"{name}: {REGISTRY[name]!r} is no module:attribute of a `Routine`("
        + ", ".join(field.name for field in fields(Routine))
        + ")"
        + "".join(f"; {words}" for words in old)
    )
