"""A real point source through focus: the lens learned on odd planes, tried on even.

`real.z_sign` is the share of the even planes farther than half the depth of field from
focus whose side of it is found from that picture alone; `real.point_height_um` the rms
difference of their heights from the stage's; `real.point_aperture` the aperture over
the stated one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.real.point_fit import (
    found_height_um,
    height_um,
    learned,
    stated_lens,
)
from validation.point_source.series import noise_counts, read_series

_HEIGHTS = np.arange(-4.5, 4.51, 0.05)  # um


def _measure(_: Options) -> Iterator[Figure]:
    series = read_series()
    noise = noise_counts(series)
    numbers = range(len(series))
    lens = learned({k: series[k] for k in numbers if k % 2}, noise)
    depth_um = lens.lens.wave_depth_um
    known, found = [], []
    for k in numbers:
        z_um = height_um(lens, k)
        if k % 2 == 0 and abs(z_um) > depth_um / 2:
            known.append(z_um)
            found.append(found_height_um(series[k], lens.lens, noise, _HEIGHTS))
            print(
                f"plane {k}: {z_um:.2f} um by the stage, {found[-1]:.2f} by its image"
            )
    print(f"wavefront, Noll and waves rms: {lens.lens.wavefront}")
    off_um = np.subtract(found, known)
    right = float(np.mean(np.sign(found) == np.sign(known)))
    yield Figure(name="real.z_sign", value=right, unit="1")
    rms_um = float(np.sqrt(np.mean(off_um**2)))
    yield Figure(name="real.point_height_um", value=rms_um, unit="um")
    aperture = lens.lens.aperture / stated_lens().aperture
    yield Figure(name="real.point_aperture", value=aperture, unit="1")


BENCHMARK = Benchmark(
    names=("real.z_sign", "real.point_height_um", "real.point_aperture"),
    measure=_measure,
)
