"""Pictures of the simulated camera, each true state rendered once."""

from __future__ import annotations

from microplan.arrays import FloatArray
from microplan.executor.simulated.cameras.quick_pictures import QuickPictures
from microplan.executor.simulated.imaging.imaging_view import LampLevel, PixelWindow

RENDER = QuickPictures.image
_SEEN: dict[tuple[str, ...], FloatArray] = {}


def remembered(
    pictures: QuickPictures,
    window: PixelWindow,
    lamp: LampLevel,
    *,
    height_px: int,
    scale: float,
) -> FloatArray:
    """Return what `QuickPictures.image` does; the noise of a frame is drawn afresh."""
    truth, lens = pictures._truth, pictures._lens
    bodies = ((n, truth.pose(b), truth.under_um(b)) for n, b in truth.bodies.items())
    key = (
        *bodies, truth.grip_pose(), truth.grip_z_um(), truth.opening_um, truth.tool,
        truth.stage_z_um(), lens.focus_um, lens.shift_um, lamp,
        pictures._microscope(height_px, scale), window,
    )  # fmt: skip
    hashed = tuple(map(repr, key))
    if hashed not in _SEEN:
        _SEEN[hashed] = RENDER(pictures, window, lamp, height_px=height_px, scale=scale)
    return _SEEN[hashed]
