"""Phase correlation with the nominal image: a shift of everything. Kept as a control.

It takes shifts of the whole picture for the target's: the static scene in the view
pulls it to the nominal position. OpenCV's function writes into its inputs where their
size suits its transform, so it is handed copies.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.routines import work
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Routine,
    Target,
)
from microplan.featuresel.routines.picture import cut, half_px

_LEAST_RESPONSE = 0.3  # share of the power near the peak; noise leaves a third
_FAINT = 0.01  # standard deviation below which an image shows nothing
_TRANSFORMS = 1.8  # its work over that of correlation by size
_SPREAD_PX = 0.5  # a centroid of 5 x 5 values of a peak that blur has widened


def prepare(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the piece of the nominal image that holds target and search."""
    image = render()
    # as the search may take the target, and what is cut must not leave the region
    half = half_px(target, image.shape, 0.0)
    if min(half) < 4:
        return Failure("outside", f"{min(half)} px between target and border")
    template = cut(image, target, half)
    if not float(template.std()) > _FAINT:
        return Failure("no_contrast", "the template is blank")
    return Artifact(
        parameters={
            "column": target.column,
            "row": target.row,
            "search_px": target.search_px,
        },
        arrays={"template": template.astype(np.float32)},
    )


def measure(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Return the phase correlation's peak, px, in `image`, (rows, columns) 0..1."""
    p = artifact.parameters
    template = artifact.arrays["template"].astype(np.float64)
    rows, columns = template.shape
    left = round(p["column"]) - columns // 2
    top = round(p["row"]) - rows // 2
    part = image[top : top + rows, left : left + columns].astype(np.float64)
    if part.shape != template.shape:
        return Failure("outside", "the template leaves the region")
    if not float(part.std()) > _FAINT:
        return Failure("no_contrast", "the image is blank")
    window = cv2.createHanningWindow((columns, rows), cv2.CV_64F)
    (dx, dy), response = cv2.phaseCorrelate(template, part.copy(), window)
    if not response > _LEAST_RESPONSE:
        return Failure(
            "low_score", f"response {response:.3f}, at least {_LEAST_RESPONSE}"
        )
    column, row = p["column"] + dx, p["row"] + dy
    if math.hypot(column - guess.column, row - guess.row) > 1.5 * p["search_px"] + 2:
        return Failure("outside", f"shift of {dx:.1f}, {dy:.1f} px")
    return Measurement(
        column=float(column),
        row=float(row),
        score=float(min(response, 1.0)),
        spread_px=_SPREAD_PX,
    )


def cost(artifact: Artifact, _pixels: int) -> float:
    """Return the work of one `measure`, see `contract.Routine`."""
    return work.correlate(_TRANSFORMS * artifact.arrays["template"].size)


PHASE_CORRELATION = Routine(
    name="phase_correlation",
    version="1",
    kinds=("circle", "teeth", "outline", "jaws"),
    principle="area",
    provides=("xy",),
    baseline=True,
    prepare=prepare,
    measure=measure,
    cost=cost,
)
