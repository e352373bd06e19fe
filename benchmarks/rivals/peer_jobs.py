"""One optics library on one job: python peer_jobs.py LIBRARY JOB.npz RESULT.npz.

Runs under an interpreter of its own and imports nothing of this project. The job holds
the outline's exact coverage of fine cells; a library makes the point spread of each
plane, and `scipy.signal.fftconvolve`, the fastest convolution at hand, does the rest.
"""

from __future__ import annotations

import math
import sys
import time
import tracemalloc
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

warnings.simplefilter("ignore")  # of old libraries under new numpy

Job = Mapping[str, Any]


def prysm_spread(job: Job) -> Callable[[float], Any]:
    """Return defocus -> point spread by matrix Fourier transforms of a pupil."""
    from prysm.propagation import Wavefront

    samples = 2 * math.ceil(job["size"] * job["step_um"] * job["aperture"]
                            / job["wavelength_um"])  # fmt: skip
    x = (np.arange(samples) - samples // 2) * (2 / samples)  # mm, pupil radius 1 mm
    r2 = x**2 + x[:, None] ** 2
    sine2 = r2 * job["aperture"] ** 2
    axial = np.sqrt(np.maximum(job["index"] ** 2 - sine2, 0)) - job["index"]

    def spread(z_um: float) -> Any:
        phase_nm = np.where(r2 <= 1, axial, 0) * z_um * 1000
        wave = Wavefront.from_amp_and_phase(
            (r2 <= 1).astype(float), phase_nm, float(job["wavelength_um"]), 2 / samples
        )
        focal_mm = 1 / float(job["aperture"])
        field = wave.focus_fixed_sampling(
            focal_mm, float(job["step_um"]), int(job["size"])
        )
        return np.abs(field.data) ** 2

    return spread


def pyotf_spread(job: Job) -> Callable[[float], Any]:
    """Return defocus -> point spread by pyotf's scalar model."""
    from pyotf.otf import HanserPSF

    def spread(z_um: float) -> Any:
        model = HanserPSF(
            wl=float(job["wavelength_um"]) * 1000,
            na=float(job["aperture"]),
            ni=float(job["index"]),
            res=float(job["step_um"]) * 1000,
            size=int(job["size"]),
            zrange=np.array([z_um * 1000]),
            vec_corr="none",
            condition="none",
        )
        return model.PSFi[0]

    return spread


LIBRARIES = {"prysm": prysm_spread, "pyotf": pyotf_spread}


def image(job: Job, spread: Callable[[float], Any], z_um: float) -> Any:
    """Return the frame of a white part over black."""
    from scipy.signal import fftconvolve

    kernel = spread(z_um)
    blurred = fftconvolve(job["object"], kernel / kernel.sum(), mode="valid")
    n, rows, columns = int(job["samples"]), int(job["rows"]), int(job["columns"])
    return blurred.reshape(rows, n, columns, n).mean(axis=(1, 3))


def main(library: str, source: str, target: str) -> None:
    """Do the job: set-up and every plane by CPU time, then one plane by memory."""
    with np.load(source) as held:
        job = dict(held)
    start = time.process_time()
    spread = LIBRARIES[library](job)
    image(job, spread, float(job["z_um"][0]))  # imports, plans and warm caches
    setup_s = time.process_time() - start
    images, seconds = [], []
    for z_um in job["z_um"]:
        start = time.process_time()
        images.append(image(job, spread, float(z_um)))
        seconds.append(time.process_time() - start)
    tracemalloc.start()
    image(job, spread, float(job["z_um"][-1]))
    peak = tracemalloc.get_traced_memory()[1]
    np.savez(target, images=images, seconds=seconds, setup_s=setup_s, peak=peak)


if __name__ == "__main__":
    main(*sys.argv[1:])
