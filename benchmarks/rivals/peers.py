"""Optics libraries on the renderer's job, each in an interpreter of its own.

They are no dependencies: one of them installs a package called `tests`, which would
hide the project's. `python3 -m venv build/peers` and
`build/peers/bin/pip install -c constraints.txt prysm pyotf` make them available;
without that the benchmarks compare with `benchmarks.rivals.naive` alone and say so.
"""

from __future__ import annotations

import math
import os
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import numpy.typing as npt

from benchmarks.optics.raster import coverage
from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Window
from microplan.optics.transfer.microscope import Microscope

ROOT = Path(__file__).parent.parent / "build" / "peers"
LIBRARIES = ("prysm", "pyotf")
_TAIL_UM = 20.0  # of the kernel beyond the blur circle, as in `benchmarks.rivals.naive`


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What one library made of a job."""

    images: FloatArray  # (planes, rows, columns)
    seconds: float  # CPU time an image, mean over the planes
    setup_s: float
    peak_mib: float  # allocated at once for one image


def available() -> tuple[str, ...]:
    """Return the libraries that are installed."""
    found = list(ROOT.glob("lib/python*/site-packages/*"))
    return tuple(name for name in LIBRARIES if any(p.name == name for p in found))


def run(
    library: str, outline: Outline, microscope: Microscope, z_um: Sequence[float]
) -> Result:
    """Return images of a white part over black, frame by frame.

    Parameters
    ----------
    library : str
        One of `available()`.
    outline : Outline
        The part, um.
    microscope : Microscope
        The setting; the object's cells are a whole part of its pixels, below
        wavelength / (4 A), so that the point spread is not undersampled.
    z_um : sequence of float
        Defocus of the planes.

    Raises
    ------
    RuntimeError
        If the library fails.
    """
    m = microscope
    samples = math.ceil(m.um_per_px / (m.wavelength_um / (4 * m.aperture)))
    step_um = m.um_per_px / samples
    reach_um = max(m.blur_diameter_um(z) for z in z_um) + 2 * _TAIL_UM
    size = 2 * math.ceil(reach_um / step_um / 2) + 1
    job: dict[str, npt.ArrayLike] = {
        "object": _cells(outline, m, samples, size - 1),
        "aperture": m.aperture,
        "wavelength_um": m.wavelength_um,
        "index": m.medium_index,
        "step_um": step_um,
        "samples": samples,
        "size": size,
        "rows": m.height_px,
        "columns": m.width_px,
        "z_um": np.asarray(z_um),
    }
    with TemporaryDirectory() as name:
        source, target = Path(name) / "job.npz", Path(name) / "result.npz"
        np.savez(
            source, allow_pickle=False, **{k: np.asarray(v) for k, v in job.items()}
        )
        script = Path(__file__).with_name("peer_jobs.py")
        call = [str(ROOT / "bin" / "python"), str(script), library]
        done = subprocess.run(
            [*call, str(source), str(target)],
            capture_output=True,
            text=True,
            check=False,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        )
        if done.returncode:
            raise RuntimeError(f"{library} ended with {done.returncode}: {done.stderr}")
        with np.load(target) as held:
            return Result(
                images=held["images"],
                seconds=float(held["seconds"].mean()),
                setup_s=float(held["setup_s"]),
                peak_mib=float(held["peak"]) / 2**20,
            )


def _cells(
    outline: Outline, microscope: Microscope, samples: int, border: int
) -> FloatArray:
    """Return the exact coverage of cells, `border` more than the frame's each way."""
    rows, columns = (
        n * samples + border for n in (microscope.height_px, microscope.width_px)
    )
    fine = replace(
        microscope,
        magnification=microscope.magnification * samples,
        width_px=columns,
        height_px=rows,
    )
    return coverage(outline, fine, Window(row=0, column=0, rows=rows, columns=columns))
