"""Expected values of extreme points of choices, tiles, hiding, lenses and rasters."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from microplan.optics.render.sampling import FAR_ERROR
from tests.optics.extremes.extreme_entries import RENDERED, ROUNDING, Entry, entry

AIRY = 0.6 / 0.42  # wavelength / A of the usual setting, um
CUTOFF = 2 / AIRY
STEEPEST = 8 / (3 * math.pi) * CUTOFF  # of an edge in focus, per um: its line spread
# two tables and what lies beyond two tiles, half planes 4.9 mm away on four sides, and
# two digits rounded up
EVEN = 1.02 * (4e-5 + FAR_ERROR + 4 * AIRY / (math.pi**3 * 4.9e3))
FULL = {"shape": "square", "size_um": 1e4}
TINY_UM = 5e-324  # the smallest double
DISC = {"shape": "disc", "size_um": 5.0}


def chains() -> Iterator[Entry]:
    """Make all of them."""
    yield from _choices()
    yield from _samplings()
    yield from _tiles()
    yield from _rasters()
    yield from _hidden()
    yield from _lenses()


def _choices() -> Iterator[Entry]:
    for limit, rung, keeps in ((1e-9, 2, 0), (1.0, 0, 1)):
        given = {"focus_um": [-4.0], "limit": limit, **DISC}
        why = "the last" if rung else "the first"
        yield entry("fidelity.rung", rung, 0, f"{why} of the ladder", **given)
        why = "no table keeps 1e-9" if rung else "no image errs by more than 1"
        yield entry("fidelity.keeps", keeps, 0, why, **given)
        for focus in ([0.0], [-4.0], [-1e-12, 4.0]):
            yield entry(
                "fidelity.understated", 0, 0, "the oracle finds no more than predicted",
                **{**given, "focus_um": focus},
            )  # fmt: skip
    for focus in ([0.0], [1e6]):
        given = {"focus_um": focus, "limit": 1e-9}
        yield entry(
            "fidelity.rung", 0, 0, "empty scene: the first model will do", **given
        )
        yield entry("fidelity.predicted", 0, 0, "empty scene: no error", **given)
    for z in (0.0, 100.0):
        yield entry(
            "fidelity.predicted", 0, EVEN, "tables and tiles; it covers the field",
            focus_um=[z], limit=1e-3, **FULL,
        )  # fmt: skip


def _samplings() -> Iterator[Entry]:
    for z in (0.0, 1e-12):
        yield entry(
            "sampling.cut", 1, 0, "nothing may be cut", z_um=z, error=1e-300
        )  # fmt: skip
    # ln 1e6 at most is cut from the lowest frequency kept, times 3 / pi
    for z in (0.0, 1e6):
        yield entry(
            "sampling.cut", 1e-6, 1e-6 * ROUNDING,
            "all may be cut: 3 ln(1e6) / pi = 13.2 is the most", z_um=z, error=20.0,
        )  # fmt: skip
    for z in (0.0, 1e-12, 1e6):
        spread = z * 0.42 / math.sqrt(1 - 0.42**2)
        value = spread + 40 * AIRY
        yield entry(
            "sampling.margin_um", value, value * ROUNDING,
            "closed form: blur radius and 40 wavelength / A", z_um=z,
        )  # fmt: skip
    for margin in (1e-300, 40.0, 1e300):
        value = 1 / (math.pi**3 * margin)
        yield entry(
            "sampling.margin_error", value, value * ROUNDING, "closed form",
            margin=margin,
        )  # fmt: skip


def _tiles() -> Iterator[Entry]:
    # K area sum r**-3: repetitions on a lattice wider than the margin are 9.034 / d**3
    # together; twice that for a pixel that is nearer to one of them
    d = 40 * AIRY
    dot = math.pi * 5e-4**2
    most = AIRY / (2 * math.pi**3) * dot * 2 * 9.034 / d**3
    for at in (0.0, 10.0, 1e3, 1e9):
        yield entry(
            "wrap.error", 0, most, "K area times the lattice sum of r^-3 at the margin",
            shape="disc", size_um=5e-4, at_x_um=at, margin=40.0,
        )  # fmt: skip
    # a half plane beyond each of four sides: lambda / A / (pi**3 d) each
    for shape, far in ((FULL, 4.9e3), ({"shape": "half plane"}, d)):
        yield entry(
            "wrap.error", 0, 4 * AIRY / (math.pi**3 * far),
            "half planes beyond four sides", margin=40.0, **shape,
        )  # fmt: skip
    yield entry("wrap.error", 0, 0, "no outline", margin=40.0)
    for error, value, why in (
        (0.0, 160.0, "none is enough: the last of the list"),
        (1.0, 5.0, "any will do: the first of the list"),
    ):
        yield entry("wrap.margin", value, value * ROUNDING, why, error=error, **DISC)


def _rasters() -> Iterator[Entry]:
    yield entry(
        "raster.area", 1e-6, 1e-6 * 1e-9, "1 nm squared, in doubles of 12 um",
        shape="square", size_um=1e-3,
    )  # fmt: skip
    for radius, m in ((5.0, 10.0), (5e4, 1e-3)):
        # a chord's sagitta c, a nanometre at most, takes 2 c / 3 off all along the rim
        area = math.pi * radius**2
        allowed = 2 * math.pi * radius * 1e-3 + area * ROUNDING
        yield entry(
            "raster.area", area, allowed, "area, less 1 nm of the rim",
            shape="disc", size_um=radius, magnification=m,
        )  # fmt: skip
    sliver = {"shape": "sliver", "size_um": 5.0, "width_um": 1e-9}
    yield entry("raster.area", 5e-9, 5e-9 * 1e-6, "length times width", **sliver)
    yield entry(
        "raster.area", (31 * 0.75) ** 2, 1e-10, "the whole field is covered", **FULL
    )


def _hidden() -> Iterator[Entry]:
    yield entry("occluded.worst", 0.3, 0, "empty scene", background=0.3, all=0.3)
    yield entry(
        "occluded.worst", 0.3, 1e-12, "no contrast, no image",
        background=0.3, reflectance=0.3, z_um=3.0, all=0.3, **DISC,
    )  # fmt: skip
    yield entry(
        "occluded.as_one", 0, 1e-12, "one layer is rendered", heights_um=[3.0], **DISC
    )
    # cells that both edges share hold 1 / 6 of their width too much on average
    cell = 0.12 * AIRY / 6 * STEEPEST
    for heights in ([0.0, TINY_UM], [0.0, 1e-12]):
        yield entry(
            "occluded.as_one", 0, cell + 2 * RENDERED,
            "coincident layers hide each other, but for cells that edges share",
            heights_um=heights, **DISC,
        )  # fmt: skip
    yield entry(
        "occluded.as_one", 0, 0.25 + 2 * RENDERED,
        "of one height they are blended: at most a (1 - a) too much",
        heights_um=[0.0, 0.0], **DISC,
    )  # fmt: skip
    for order in itertools.permutations((0.0, 1e-12)):
        yield entry(
            "occluded.worst", 1, 4 * RENDERED, "coincident layers cover the field",
            heights_um=list(order), all=1.0, **FULL,
        )  # fmt: skip


ALL_TINY = {
    "distortion": TINY_UM,
    "lateral_x": TINY_UM,
    "scale_per_um": TINY_UM,
    "field_curvature_per_um": TINY_UM,
    "edge_offset_um": TINY_UM,
    "gradient_x": TINY_UM,
}


def _lenses() -> Iterator[Entry]:
    for z in (0.0, 3.0, 1e3):
        given = {"z_um": z, **DISC}
        yield entry(
            "lens.change", 0, 0, "no errors: the very image", errors={}, **given
        )
        yield entry(
            "lens.change", 0, 2 * RENDERED + 1e-5 * STEEPEST,
            "as good as no errors; edges within .01 nm", errors=ALL_TINY, **given,
        )  # fmt: skip
    table = [[1.0, 0.001], [200.0, 0.999]]
    for m, value in ((1.0, 0.001), (200.0, 0.999), (math.sqrt(200), 0.999e-3**0.5)):
        yield entry(
            "lens.aperture", value, value * ROUNDING, "closed form: a power between",
            apertures=table, magnification=m,
        )  # fmt: skip
