"""Pictures of the simulated camera, each true state rendered once."""

from __future__ import annotations

from microplan.arrays import FloatArray
from microplan.executor.simulated.camera import SimCamera
from microplan.optics.render.scene import Window

RENDER = SimCamera._image
_SEEN: dict[tuple[str, ...], FloatArray] = {}


def remembered(
    camera: SimCamera, window: Window | None, *, height_px: int | None = None
) -> FloatArray:
    """Return what `SimCamera._image` does; the noise of a frame is drawn afresh."""
    truth, lens, light = camera._truth, camera._lens, camera._light
    bodies = ((n, truth.pose(b), truth.under_um(b)) for n, b in truth.bodies.items())
    key = (
        *bodies, truth.grip_pose(), truth.grip_z_um(), truth.opening_um, truth.tool,
        truth.stage_z_um(), lens.magnification, lens.focus_um, lens.shift_um,
        light.now(), camera._microscope(height_px), window,
    )  # fmt: skip
    hashed = tuple(map(repr, key))
    if hashed not in _SEEN:
        _SEEN[hashed] = RENDER(camera, window, height_px=height_px)
    return _SEEN[hashed]
