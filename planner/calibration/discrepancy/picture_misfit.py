"""What a picture of a part shows besides the fitted image of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import BoolArray, FloatArray
from microplan.featuresel.look.camera_noise import camera_noise
from microplan.featuresel.look.discrepancy import Discrepancy, contrast, edge_steps
from microplan.featuresel.look.scenario import LookCase

# of the usual step: what an edge's middle and a face have of it; a face lies so many
# reaches from all edges
_EDGE, _FACE, _APART = 0.1, 0.02, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureMisfit:
    """Light less the fitted image; arrays are (rows, columns), 1 at full scale."""

    residual: FloatArray
    image: FloatArray  # as fitted
    steps: FloatArray  # of edges in their middles
    noise: FloatArray  # the camera's variance by the workcell, full scale squared
    used: BoolArray  # pixels of the picture itself
    edges: BoolArray
    faces: BoolArray
    step: float  # usual at the target's edges
    basis: FloatArray  # (N, 6) of the N used pixels, orthonormal: what was fitted


def part_discrepancy(case: LookCase) -> Discrepancy:
    """Return the correlation lengths of a look's discrepancy, all shares 1."""
    fine_um = case.microscope.wavelength_um / case.microscope.aperture
    size_um = max(case.target.size_um, fine_um)
    return Discrepancy(edge=1, flat=1, pixel=1, fine_um=fine_um, size_um=size_um)


def left_over(light: FloatArray, basis: FloatArray, used: BoolArray) -> FloatArray:
    """Return light (rows, columns) less its part in a basis (N, K); 0 if not used."""
    found = np.zeros_like(light)
    values = light[used]
    found[used] = values - basis @ (basis.T @ values)
    return found


def misfit_of(
    case: LookCase,
    shown: FloatArray,
    meant: FloatArray,
    at_px: tuple[float, float],
    used: BoolArray,
) -> PictureMisfit | None:
    """Return what a picture shows besides its image; None if it shows no such part.

    Fitted are gain, offset, shift, turn and scale.

    Parameters
    ----------
    case : LookCase
        Of the region that is shown.
    shown : (rows, columns) float array
        Its light, 1 at full scale.
    meant : (rows, columns) float array
        The image of the part where it was found.
    at_px : (column, row)
        Where the target is in it.
    used : (rows, columns) bool array
        Pixels that are the picture's.
    """
    design = _design(meant, at_px)[:, used].T
    numbers = np.linalg.lstsq(design, shown[used], rcond=None)[0]
    if not numbers[0] > 0:
        return None
    basis = np.linalg.qr(design)[0]
    residual = left_over(shown, basis, used)
    image = np.where(used, shown - residual, numbers[0] * meant + numbers[1])
    reach_px = case.reach_um * case.target.px_per_um
    target = replace(case.target, column=at_px[0], row=at_px[1])
    step = contrast(image, target, reach_px)
    steps = edge_steps(image, reach_px)
    around = edge_steps(image, _APART * reach_px)
    noise = camera_noise(replace(case.sensor, gain=1.0), case.microscope.fill_factor)
    return PictureMisfit(
        residual=residual,
        image=image,
        steps=steps,
        noise=noise.noise_variance(image),
        used=used,
        edges=used & (steps > _EDGE * step),
        faces=used & (around < _FACE * step),
        step=step,
        basis=basis,
    )


def _design(meant: FloatArray, at_px: tuple[float, float]) -> FloatArray:
    """Return an image's changes by gain, offset, shift, turn, scale, (6, R, C)."""
    down, right = np.gradient(meant)
    row, column = np.indices(meant.shape, dtype=np.float64)
    x, y = column - at_px[0], row - at_px[1]
    turn, scale = x * down - y * right, x * right + y * down
    return np.stack([meant, np.ones_like(meant), right, down, turn, scale])
