"""A quick look of the example, and pictures that its camera could have taken."""

from __future__ import annotations

import atexit
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any
from unittest.mock import patch

import numpy as np
import numpy.typing as npt
import tifffile
from skimage.io import imsave

from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import counts
from microplan.planner.measure.picture_look import (
    PictureLook,
    PictureLookCall,
    picture_look,
)
from microplan.planner.source.diagnostics import Report
from microplan.planner.store.memo import Memo
from microplan.planner.store.store import Store, place
from microplan.planner.task.presets import PRESETS
from tests.planner.examples import copy_example, one_look, one_zoom, read
from tests.planner.few_trials import EFFORT

Counts = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
STEP = "see_post"
CHAIN = ("otsu", "likelihood")
CALL = ("--step", STEP, "--chain", ",".join(CHAIN), "--preset", "fast")


@contextmanager
def fewer_trials() -> Iterator[None]:
    """Let the preset `fast` spend less while inside."""
    with patch.dict(PRESETS, {"fast": EFFORT}):
        yield


@cache
def task_file() -> Path:
    """Return a task with one look at a post, of one magnification."""
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder)
    file = copy_example(folder / "task")
    one_look(file, post_um=22.0)  # as drawn
    one_zoom(file)
    return file


@cache
def post_look() -> PictureLook:
    """Return that look made ready with `CHAIN`."""
    call = PictureLookCall(step=STEP, chain=CHAIN, preset="fast")
    look = picture_look(read(task_file()), call, Report(), Memo(Store(place())))
    assert look is not None
    return look


def taken(dx_um: float, dy_um: float, seed: int = 3) -> Counts:
    """Return a picture of the region as trials have them, the post displaced."""
    case = post_look().case
    trial = Trial(
        index=0,
        dx_um=dx_um,
        dy_um=dy_um,
        dtheta_rad=0.0,
        model=case.model,
        seed=(seed,),
    )
    return counts(case, trial)


def in_frame(region: Counts, down: int = 0, right: int = 0) -> Counts:
    """Return a whole frame with a region in it, moved by whole pixels."""
    case = post_look().case
    scope, window = case.microscope, case.window
    frame = np.full((scope.height_px, scope.width_px), region[0, 0], region.dtype)
    rows = slice(window.row + down, window.row + down + window.rows)
    columns = slice(window.column + right, window.column + right + window.columns)
    frame[rows, columns] = region
    return frame


def save(file: Path, pixels: npt.NDArray[Any]) -> Path:
    """Write a PNG or TIFF file and return its path."""
    if file.suffix == ".png":
        imsave(str(file), pixels, check_contrast=False)
    else:
        is_colour = pixels.shape[-1] == 3
        tifffile.imwrite(file, pixels, photometric="rgb" if is_colour else "minisblack")
    return file


def deep(pixels: Counts) -> Counts:
    """Return 8-bit counts as the same light in 16 bits."""
    return (pixels.astype(np.uint16) * 257).astype(np.uint16)
