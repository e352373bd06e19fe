"""Animals that misjudge a place: each one a known mistake, none invented."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np
from skimage.registration import phase_cross_correlation

from microplan.arrays import FloatArray
from microplan.featuresel.routines.circle import circle_caliper
from microplan.featuresel.routines.contract import (
    Artifact,
    Failure,
    Guess,
    LookModel,
    Measurement,
    Target,
)
from tests.featuresel.zoo.zoo_kinds import animal, answer

_HALF = 32  # of templates: 64 pixels suit Fourier transforms


def _template(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the nominal image about the target's nearest pixel."""
    p = {"column": target.column, "row": target.row, "search_px": target.search_px}
    part = _about(render(), p)
    return Artifact(parameters=p, arrays={"template": part.astype(np.float32)})


def _about(image: FloatArray, p: Mapping[str, float]) -> FloatArray:
    column, row = round(p["column"]), round(p["row"])
    return np.array(
        image[row - _HALF : row + _HALF, column - _HALF : column + _HALF],
        dtype=np.float64,
    )


def _stay(image: FloatArray, artifact: Artifact, guess: Guess) -> Measurement | Failure:
    """Say that nothing has moved."""
    return answer(guess.column, guess.row)


def _phase_only(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Give every frequency one vote: those that blur has emptied vote for noise."""
    p = artifact.parameters
    shift, _, _ = phase_cross_correlation(  # type: ignore[no-untyped-call] # skimage
        _about(image, p),
        artifact.arrays["template"].astype(np.float64),
        normalization="phase",
        upsample_factor=20,
    )
    return answer(p["column"] + shift[1], p["row"] + shift[0])


def _worn_template(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Hand OpenCV the template itself: it is windowed again at each call."""
    p, template = artifact.parameters, artifact.arrays["template"]
    window = cv2.createHanningWindow((2 * _HALF, 2 * _HALF), cv2.CV_32F)
    part = _about(image, p).astype(np.float32)
    (dx, dy), _ = cv2.phaseCorrelate(template, part, window)
    return answer(p["column"] + dx, p["row"] + dy)


def _whole_pixel(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Take the best match as it is, without the peak between pixels."""
    p = artifact.parameters
    core = artifact.arrays["template"][8:-8, 8:-8]
    scores = cv2.matchTemplate(image.astype(np.float32), core, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    dx = float(column) + _HALF - 8 - round(p["column"])
    dy = float(row) + _HALF - 8 - round(p["row"])
    return answer(p["column"] + dx, p["row"] + dy)


def _rounded_warp(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Align by steps, with a warp that rounds to 1/32 px and believes it does not."""
    template = artifact.arrays["template"].astype(np.float64)
    down, across = np.gradient(template)
    design = np.column_stack((across.ravel(), down.ravel(), np.ones(template.size)))
    solve = np.linalg.pinv(np.column_stack((design, template.ravel())))
    p = artifact.parameters
    x, y = guess.column - p["column"], guess.row - p["row"]
    left, top = round(p["column"]) - _HALF, round(p["row"]) - _HALF
    for _ in range(20):
        shift = np.array(((1, 0, left + x), (0, 1, top + y)), dtype=np.float64)
        seen = cv2.warpAffine(
            image, shift, (2 * _HALF, 2 * _HALF),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )  # fmt: skip
        dx, dy, _, gain = solve @ seen.ravel()
        x, y = x - dx / gain, y - dy / gain
    return answer(p["column"] + x, p["row"] + y)


def _wrong_polarity(render: LookModel, target: Target) -> Artifact | Failure:
    """Expect the edge to rise where it falls."""
    made = circle_caliper.prepare(render, target)
    if isinstance(made, Failure):
        return made
    p = made.parameters
    return replace(made, parameters={**p, "rising": 1.0 - p["rising"]})


def _blob(
    image: FloatArray, guess: Guess
) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]] | None:
    """Return the dark blob's contour about the guess, by Otsu's threshold."""
    span = np.ptp(image)
    grey = np.rint((image - image.min()) * (255 / span)).astype(np.uint8)
    _, mask = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
    _, labels = cv2.connectedComponents(mask)
    own = labels[round(guess.row), round(guess.column)]
    found, _ = cv2.findContours(
        (labels == own).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    return None if not found else np.asarray(max(found, key=len), dtype=np.int32)


def _raw_centroid(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Take a notched hole's centroid for its centre."""
    contour = _blob(image, guess)
    if contour is None:
        return Failure(code="no_blob", message="nothing dark")
    m = cv2.moments(contour)
    return answer(m["m10"] / m["m00"], m["m01"] / m["m00"])


def _whole_ellipse(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Fit an ellipse through all of a notched hole's contour."""
    contour = _blob(image, guess)
    if contour is None or len(contour) < 6:
        return Failure(code="no_blob", message="nothing dark")
    (column, row), _, _ = cv2.fitEllipse(contour)
    return answer(column, row)


def _tips(render: LookModel, target: Target) -> Artifact | Failure:
    """Return where the inner corners of the tips are drawn, px from the grip."""
    p, k = target.parameters, target.px_per_um
    return Artifact(
        parameters={
            "half_px": p["opening_um"] / 2 * k,
            "down_px": p["grip_from_tip_um"] * k,
            "theta_rad": target.theta_rad,
        }
    )


def _corners(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Refine the tips' corners by where gradients meet: blur draws that inwards."""
    p = artifact.parameters
    at = np.array(
        [
            (guess.column + side * p["half_px"], guess.row + p["down_px"])
            for side in (-1, 1)
        ],
        dtype=np.float32,
    ).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    found = cv2.cornerSubPix(image.astype(np.float32), at, (14, 14), (-1, -1), stop)
    (x1, y1), (x2, y2) = np.asarray(found, dtype=np.float64).reshape(2, 2)
    return answer((x1 + x2) / 2, (y1 + y2) / 2 - p["down_px"])


def _one_tooth_of_a_comb(render: LookModel, target: Target) -> Artifact | Failure:
    """Return one piece of a pattern that repeats."""
    made = _template(render, target)
    assert isinstance(made, Artifact)
    core = made.arrays["template"][_HALF - 6 : _HALF + 7, _HALF - 6 : _HALF + 7]
    return replace(made, arrays={"template": np.ascontiguousarray(core)})


def _best_of_many(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Take the best match within the search, however good the second is."""
    p = artifact.parameters
    reach = int(p["search_px"] + 8)
    column, row = round(guess.column), round(guess.row)
    part = image[row - reach : row + reach + 1, column - reach : column + reach + 1]
    scores = cv2.matchTemplate(
        part.astype(np.float32), artifact.arrays["template"], cv2.TM_CCOEFF_NORMED
    )
    v, u = np.unravel_index(int(np.argmax(scores)), scores.shape)
    dx = float(u) - (reach - 6) + column - round(p["column"])
    dy = float(v) - (reach - 6) + row - round(p["row"])
    return answer(p["column"] + dx, p["row"] + dy)


def _corner_template(render: LookModel, target: Target) -> Artifact | Failure:
    """Return the region, and where the reference point is in it."""
    p = {"column": target.column, "row": target.row, "theta_rad": target.theta_rad}
    image = render()[6:-6, 6:-6]
    return Artifact(parameters=p, arrays={"template": image.astype(np.float32)})


def _blurred_ecc(
    image: FloatArray, artifact: Artifact, guess: Guess
) -> Measurement | Failure:
    """Let ECC blur both images, and fit a scale to what the borders make of it."""
    p, template = artifact.parameters, artifact.arrays["template"]
    shift = (guess.column - p["column"], guess.row - p["row"])
    warp = np.array(((1, 0, 6 + shift[0]), (0, 1, 6 + shift[1])), dtype=np.float32)
    whole = np.ones(image.shape, dtype=np.uint8)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-6)
    try:
        _, found = cv2.findTransformECC(
            template, image.astype(np.float32), warp, cv2.MOTION_AFFINE, stop, whole, 61
        )
    except cv2.error as error:
        return Failure(code="diverged", message=str(error.err))
    x, y = np.asarray(found, dtype=np.float64) @ (p["column"] - 6, p["row"] - 6, 1.0)
    turned = math.atan2(-float(found[1, 0]), float(found[0, 0]))
    return answer(x, y, p["theta_rad"] + turned)


STAY = animal(name="stay", kind="circle", prepare=_template, measure=_stay)
PHASE_ONLY = animal(
    name="phase_only", kind="circle", prepare=_template, measure=_phase_only
)
WORN_TEMPLATE = animal(
    name="worn_template", kind="circle", prepare=_template, measure=_worn_template
)
WHOLE_PIXEL = animal(
    name="whole_pixel", kind="circle", prepare=_template, measure=_whole_pixel
)
ROUNDED_WARP = animal(
    name="rounded_warp",
    kind="circle",
    prepare=_template,
    measure=_rounded_warp,
    requires=("xy",),
    capture_px=2.0,
)
WRONG_POLARITY = animal(
    name="wrong_polarity",
    kind="circle",
    prepare=_wrong_polarity,
    measure=circle_caliper.measure,
)
RAW_CENTROID = animal(
    name="raw_centroid", kind="circle", prepare=_template, measure=_raw_centroid
)
WHOLE_ELLIPSE = animal(
    name="whole_ellipse", kind="circle", prepare=_template, measure=_whole_ellipse
)
CORNERS = animal(name="corners", kind="jaws", prepare=_tips, measure=_corners)
BEST_OF_MANY = animal(
    name="best_of_many",
    kind="outline",
    prepare=_one_tooth_of_a_comb,
    measure=_best_of_many,
)
BLURRED_ECC = animal(
    name="blurred_ecc",
    kind="outline",
    prepare=_corner_template,
    measure=_blurred_ecc,
    provides=("xy", "theta"),
    requires=("xy", "theta"),
    capture_px=2.0,
)
