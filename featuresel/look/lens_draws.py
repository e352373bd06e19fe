"""What a lens truly does in a trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from microplan.optics.lens.lens import MAX_DISTORTION, LensErrors


def true_lens(
    known: LensErrors, doubt: LensErrors, sigmas: Sequence[float]
) -> LensErrors | None:
    """Return what a lens truly does, its unknown errors so many sigmas off.

    Parameters
    ----------
    known : LensErrors
        What is known of it; its sigmas are not read.
    doubt : LensErrors
        How well: only its sigmas are read. The light's gradient is drawn elsewhere.
    sigmas : (6,) sequence of float
        Of distortion, shift in x and y, scale, curvature, edge offset.

    Returns
    -------
    LensErrors or None
        None if nothing is unknown.
    """
    spread = (
        doubt.distortion_sigma,
        doubt.lateral_sigma,
        doubt.lateral_sigma,
        doubt.scale_sigma_per_um,
        doubt.field_curvature_sigma_per_um,
        doubt.edge_offset_sigma_um,
    )
    if not any(spread):
        return None
    off = [float(sigma * many) for sigma, many in zip(spread, sigmas, strict=True)]
    distortion = known.distortion + off[0]
    return replace(
        known,
        distortion=min(max(distortion, -MAX_DISTORTION), MAX_DISTORTION),
        lateral_x=known.lateral_x + off[1],
        lateral_y=known.lateral_y + off[2],
        scale_per_um=known.scale_per_um + off[3],
        field_curvature_per_um=known.field_curvature_per_um + off[4],
        edge_offset_um=known.edge_offset_um + off[5],
    )
