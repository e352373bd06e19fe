"""Pictures of the simulated camera, each true state rendered once."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from microplan.arrays import FloatArray
from microplan.executor.simulated.cameras.quick_pictures import QuickPictures
from microplan.executor.simulated.imaging.imaging_view import LampLevel, PixelWindow

RENDER = QuickPictures.image
_MOST_BYTES = 1 << 28  # of pictures that are kept, those asked for last
_SEEN: dict[bytes, FloatArray] = {}


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
    bodies = [
        (name, body.made, [post.made for post in body.posts],
         truth.pose(body), truth.top_um(body))
        for name, body in truth.bodies.items()
    ]  # fmt: skip
    key = pickle.dumps((
        truth.world, bodies, truth.grip_pose(), truth.grip_z_um(), truth.opening_um,
        truth.tool, truth.stage_z_um(), lens.focus_um, lens.shift_um, lens.errors, lamp,
        pictures._microscope(height_px, scale), window,
    ))  # fmt: skip
    found = _SEEN.pop(key, None)
    if found is None:
        found = RENDER(pictures, window, lamp, height_px=height_px, scale=scale)
        found.setflags(write=False)  # it may be given again
    while _SEEN and sum(each.nbytes for each in _SEEN.values()) > _MOST_BYTES:
        del _SEEN[next(iter(_SEEN))]
    _SEEN[key] = found
    return found


@contextmanager
def each_state_once() -> Iterator[None]:
    """Render each true state once while inside, and not again in later such places."""
    with patch.object(QuickPictures, "image", remembered):
        yield
