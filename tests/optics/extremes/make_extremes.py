"""Make `extremes.json` and `docs/extremes.md`: extreme points with expected values.

`python -m tests.optics.extremes.make_extremes` needs mpmath (one of the `dev` extras;
tests do not). `--page` writes the page alone, from the list. No expected value is
computed by `optics`: they come from mpmath, closed forms, bounds or symmetry, as each
point says.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.optics.extremes.extreme_entries import RENDERED, ROUNDING, Entry, entry
from tests.optics.extremes.extreme_points import LIST, points, table_rows
from tests.optics.extremes.high_precision import (
    Number,
    diffraction,
    exact,
    geometric,
    hopkins,
    jinc,
    model_at,
    mpmath,
    product,
    stokseth,
)
from tests.optics.extremes.make_chain_extremes import chains

PAGE = Path(__file__).parents[3] / "docs" / "extremes.md"

INTRODUCTION = """\
# Extreme points

{count} points at the ends of what `optics` accepts, each with the value that must come
out, the largest error allowed (absolute) and the source of both, are listed in
[extremes.json](../tests/optics/extremes/extremes.json). A nan, an infinity or a
warning is a failure too. `tests/optics/extremes/test_extremes.py` checks them one by
one, and `make bench` counts failures as `optics.extremes_failed`. List and page are
written by `python -m tests.optics.extremes.make_extremes`.

Where nothing else is said A = .42, n = 1, the wavelength is .6 um, the magnification
10, the pitch 7.5 um and the frame 31 x 31 pixels; lengths of parts are um."""

TINY = 5e-324  # the smallest double
BELOW = 1 - 2**-53  # one ulp below 1
ABOVE = 1 + 2**-52
MODELS = ("geometric", "product", "stokseth", "hopkins", "exact")
MP50 = "mpmath, 50 digits"
MP24 = "mpmath, 24 digits, the overlap in two dimensions"


def _closed_models() -> Iterator[Entry]:
    for x in (0.0, TINY, 1e-300, 1e-12, 0.5, BELOW, 1.0, ABOVE, 1e300):
        value = diffraction(x)
        # near the end acos(1 - d) is as good as d, an ulp in the argument itself
        allowed = float(value) * (1e-12 if x == BELOW else ROUNDING)
        where = "0 beyond the cutoff" if x >= 1 else f"{MP50}, closed form"
        yield entry("diffraction", value, allowed, where, x=x)
    models: tuple[tuple[str, Callable[[float, float], Number]], ...] = (
        ("geometric", geometric),
        ("product", product),
        ("stokseth", stokseth),
    )
    for name, model in models:
        for x, w in (
            (TINY, 1000.0), (0.5, 0.0), (0.5, 1e-12), (0.3, 1000.0), (BELOW, 1000.0),
            (1.0, 0.3),
        ):  # fmt: skip
            # a phase of q rad is rounded to 2e-16 q, and |jinc'| <= 1.6 q**-1.5
            yield entry(name, model(x, w), ROUNDING, f"{MP50}, closed form", x=x, w=w)
    for q in (0.999e-3, 1.001e-3):
        x = q / (8 * math.pi)
        yield entry(
            "geometric", geometric(x, 1.0), ROUNDING,
            f"{MP50}, either side of where the series ends", x=x, w=1.0,
        )  # fmt: skip
    yield entry(
        "geometric", geometric(3.0, 0.7), ROUNDING, f"{MP50}, no cutoff", x=3.0, w=0.7
    )


def _hopkins_points() -> Iterator[Entry]:
    for x, w in (
        (0.0, 1000.0), (TINY, 1.0), (0.5, 0.0), (0.5, 1e-12), (1e-12, 1e5),
        (0.01, 1.0), (0.5, 3.0), (0.9, 30.0), (1e-3, 1000.0), (0.5, 1000.0),
        (0.99, 1000.0), (0.3, 1e5), (1e-6, 1e5), (BELOW, 1000.0), (1.0, 1000.0),
    ):  # fmt: skip
        how = f"{MP50}, one integral"
        if 8 * math.pi * w * x * (1 - x) > 200:
            how = f"{MP50}, along imaginary axes"
        yield entry("hopkins", hopkins(x, w), 1e-12, how, x=x, w=w)
    yield entry(
        "hopkins", hopkins(0.4, 2.0), 1e-12, f"{MP50}; even in x and w", x=-0.4, w=-2.0
    )


def _exact_points() -> Iterator[Entry]:
    for index in (1.0, 1.33, 1.5):
        for share in (1e-3, 0.999):
            a = share * index
            yield entry(
                "exact", diffraction(0.3), 1e-13, f"{MP50}; in focus, diffraction",
                x=0.3, z_um=0.0, aperture=a, index=index,
            )  # fmt: skip
    for x, z, a, index in (
        (0.3, 1e-12, 0.42, 1.0),
        (0.3, 1e6, 1e-3, 1.0),
        (0.05, 2.0, 0.42, 1.0),
        (0.5, 20.0, 0.42, 1.0),
        (0.5, -20.0, 0.42, 1.0),
        (0.3, 3.0, 0.95, 1.0),
        (0.3, 1.0, 0.999, 1.0),
        (0.02, 10.0, 0.999, 1.0),
        (0.4, 2.0, 1.32867, 1.33),
        (0.4, 2.0, 1.4985, 1.5),
        (1e-7, 1e6, 0.42, 1.0),
        (1e-7, 1e6, 0.95, 1.0),
        (2e-6, 1e6, 0.42, 1.0),
        (1e-12, 1e6, 0.42, 1.0),
        (0.999, 1000.0, 0.42, 1.0),
    ):
        value = exact(x, abs(z), a, index)
        note = "; even in z" if z < 0 else ""
        given = {"x": x, "z_um": z, "aperture": a, "index": index}
        yield entry("exact", value, 1e-12, MP24 + note, **given)
    yield entry(
        "exact", 1, 0, "1 at frequency 0", x=0.0, z_um=1e6, aperture=0.999, index=1.0
    )
    yield entry(
        "exact", 1, ROUNDING, "1 at frequency 0", x=TINY, z_um=1e6, aperture=0.42,
        index=1.0,
    )  # fmt: skip
    for x in (1.0, 2.0):
        yield entry(
            "exact", 0, 0, "0 beyond the cutoff", x=x, z_um=1e6, aperture=0.95,
            index=1.0,
        )  # fmt: skip
    for x, a in ((0.3, 0.42), (0.9, 0.42), (0.3, 0.95), (0.3, 0.999)):
        # per line of the overlap at most 4 / (k z dD/dxi) with dD/dxi >= 2 A**2 x / n
        bound = 8 * 0.6 / (2 * math.pi**2 * 1e6 * a**2 * x)
        yield entry(
            "exact", 0, bound, "van der Corput: at most 8 n / (pi k z A^2 x)",
            x=x, z_um=1e6, aperture=a, index=1.0,
        )  # fmt: skip


def _tables() -> Iterator[Entry]:
    for model in MODELS:
        for x, z, x_max in ((0.37, 0.0, 1.0), (0.37, 1e-12, 1.0), (1.3e-7, 1e6, 1e-4)):
            yield entry(
                "table", model_at(model, x, z), 2e-5,
                "mpmath, the model itself; stated error of the table",
                model=model, x=x, z_um=z, x_max=x_max,
            )  # fmt: skip
        yield entry(
            "transfer", model_at(model, 0.2, 1e-12), 1e-13, "mpmath, the model itself",
            model=model, x=0.2, z_um=1e-12,
        )  # fmt: skip


def _model_errors() -> Iterator[Entry]:
    for model, z, a, value, why in (
        ("hopkins", 0.0, 0.42, 2e-5, "in focus: the table's error alone"),
        ("product", 1e-12, 0.42, 2e-5, "in focus: the table's error alone"),
        ("exact", 1e6, 0.999, 2e-5, "the table's error alone"),
        ("geometric", 1.0, 0.999, 1.0, "1 where nobody has measured it"),
    ):
        given = {"model": model, "z_um": z, "aperture": a}
        yield entry("model_error", value, 1e-12, why, **given)


def _numbers() -> Iterator[Entry]:
    mp = mpmath()
    lam = mp.mpf(0.6)
    for a, index in ((1e-3, 1.0), (0.999, 1.0), (1e-3, 1.5), (1.4985, 1.5)):
        A, n = mp.mpf(a), mp.mpf(index)
        root = mp.sqrt(n**2 - A**2)
        for name, value in (
            ("wave_depth_exact_um", lam / (2 * (n - root))),
            ("wave_depth_um", n * lam / A**2),
            ("airy_radius_um", mp.mpf("0.61") * lam / A),
        ):
            yield entry(
                name, value, float(value) * ROUNDING, f"{MP50}, closed form",
                aperture=a, index=index,
            )  # fmt: skip
        for z in (1e-12, 1e6):
            Z = mp.mpf(z)
            for name, value in (
                ("rim_w20_um", Z * (n - root)),
                ("paraxial_w20_um", Z * A**2 / (2 * n)),
                ("blur_diameter_um", 2 * Z * A / root),
            ):
                # n - A cancels by 1e-3 in the data: rounding there counts 500 times
                allowed = float(value) * (1e-13 if a / index > 0.9 else ROUNDING)
                yield entry(
                    name, value, allowed, f"{MP50}, closed form",
                    aperture=a, index=index, z_um=z,
                )  # fmt: skip


def _coefficients() -> Iterator[Entry]:
    mp = mpmath()

    def wave(radius: float, f: Number) -> Number:
        return mp.pi * mp.mpf(radius) ** 2 * jinc(2 * mp.pi * f * mp.mpf(radius))

    for radius, tile, cut in ((5e-4, 200.0, 1.4), (50.0, 400.0, 1.4)):
        for order in ((0, 0), (3, 4)):
            f = mp.hypot(*order) / mp.mpf(tile)
            # KERNEL_ERROR 2e-5 times perimeter over 2 pi tile heights, times the area
            allowed = 2e-5 * radius * tile + 1e-12
            yield entry(
                "coefficient", wave(radius, f), allowed,
                f"{MP50}: R J1(2 pi f R) / f; error stated by `spectrum`",
                shape="disc", size_um=radius, tile_um=tile, cut_per_um=cut, order=order,
            )  # fmt: skip
    yield entry(
        "coefficient", wave(50.0, mp.mpf(5) / 400), 2e-5 * 50 * 400 + 5e-8,
        "a disc; the gap of 1e-9 rad is worth 5e-8 um2",
        shape="almost a disc", size_um=50.0, gap_rad=1e-9, tile_um=400.0,
        cut_per_um=1.4, order=(3, 4),
    )  # fmt: skip
    side, r = 40.0, 1e-6
    yield entry(
        "coefficient", side**2, 2e-5 * 160 / (2 * math.pi) * 400, "a sharp square",
        shape="rounded square", size_um=side, fillet_um=r, tile_um=400.0,
        cut_per_um=1.4, order=(0, 0),
    )  # fmt: skip
    yield entry(
        "coefficient", 0.05, 2e-5 * 100 / (2 * math.pi) * 400, "length times width",
        shape="sliver", size_um=50.0, width_um=1e-3, tile_um=400.0, cut_per_um=1.4,
        order=(0, 0),
    )  # fmt: skip


def _edge(p_um: float, offset_um: float) -> Number:
    """Return the image of a straight edge in focus, averaged over a pixel p wide."""
    mp = mpmath()
    fc = mp.mpf(2) * mp.mpf(0.42) / mp.mpf(0.6)
    p, d = mp.mpf(p_um), mp.mpf(offset_um)

    def wave(f: Number) -> Number:
        box = mp.sin(mp.pi * f * p) / (mp.pi * f * p)
        return diffraction(f / fc) * box * mp.sin(2 * mp.pi * f * d) / (mp.pi * f)

    return mp.mpf(1) / 2 - mp.quad(wave, mp.linspace(mp.mpf(10) ** -40, fc, 12))


def _images() -> Iterator[Entry]:
    frame = RENDERED
    yield from _edge_images()
    yield from _small_and_large()
    for m, side in ((0.5, 1e5), (200.0, 2e3)):
        yield entry(
            "image.centre", 0.5, frame, "symmetry: an edge through the pixel",
            shape="half plane", magnification=m, width_px=3, height_px=3,
        )  # fmt: skip
        yield entry(
            "image.worst", 1, frame, "the part covers the field",
            shape="square", size_um=side, magnification=m, width_px=3, height_px=3,
            all=1.0,
        )  # fmt: skip
    for z in (0.0, 20.0):
        yield entry(
            "image.centre", 1, frame, "one pixel, covered",
            shape="disc", size_um=400.0, z_um=z, width_px=1, height_px=1,
        )  # fmt: skip
    yield entry(
        "image.worst", 0.3, 1e-12, "no contrast, no image",
        shape="disc", size_um=5.0, reflectance=0.3, background=0.3, z_um=3.0, all=0.3,
    )  # fmt: skip
    yield entry(
        "image.worst", 0.3, 0.7 * frame, "no contrast where layers coincide",
        shape="disc", size_um=5.0, reflectance=0.3, background=0.3,
        heights_um=[0.0, 1e-12], all=0.3,
    )  # fmt: skip
    for heights in ([0.0, 0.0], [0.0, 1e-12]):
        yield entry(
            "image.centre", 1, 4 * frame, "coincident layers are covered once",
            shape="disc", size_um=60.0, heights_um=heights, width_px=3, height_px=3,
        )  # fmt: skip


def _edge_images() -> Iterator[Entry]:
    p = 0.75
    for ff in (1.0, 0.25, 1e-6):
        for right in (0, 1, 2):
            value = _edge(p * math.sqrt(ff), right * p)
            yield entry(
                "image.centre", value, RENDERED,
                f"{MP50}: edge spread, pixel averaged; the renderer's stated errors",
                shape="half plane", fill_factor=ff, right_px=right,
            )  # fmt: skip


def _small_and_large() -> Iterator[Entry]:
    dot = 5e-4
    # the Airy peak pi (A / lambda)**2 times the area; the pixel is .0375 um
    peak = (math.pi * 0.42 / 0.6 * dot) ** 2
    yield entry(
        "image.centre", peak, 0.01 * peak,
        "Airy peak times the area; 1 %: its fall over the pixel",
        shape="disc", size_um=dot, magnification=200.0,
    )  # fmt: skip
    for shape in (
        {"shape": "sliver", "size_um": 5.0, "width_um": 1e-3},
        {"shape": "disc", "size_um": 0.5},
    ):
        area = 5e-3 if shape["shape"] == "sliver" else math.pi * 0.25
        # light farther than R from an Airy pattern: 2 / (pi**2 A R / lambda) of all
        outside = 2 * 0.6 / (math.pi**2 * 0.42 * 60)
        yield entry(
            "image.energy", area, (outside + RENDERED) * area,
            "energy: the area, but for the Airy pattern's tail beyond 60 um",
            width_px=161, height_px=161, **shape,
        )  # fmt: skip
    yield entry(
        "image.worst", 1, RENDERED, "10 mm cover the field",
        shape="square", size_um=1e4, all=1.0,
    )  # fmt: skip
    for at in (1e3, 1e6, 1e9):
        yield entry(
            "image.worst", 0, RENDERED, "a part far outside the field",
            shape="disc", size_um=50.0, at_x_um=at, all=0.0,
        )  # fmt: skip
    yield entry(
        "image.change", 0, 4e-8, "in focus; two tables' floor of 2e-8",
        shape="disc", size_um=5.0, z_um=1e-12,
    )  # fmt: skip
    for z in (3.0, 1e3):
        yield entry(
            "image.symmetry", 0, 0, "even in z", shape="disc", size_um=5.0, z_um=z
        )
    # irradiance on the axis: the pupil's middle, where z tan = z A rho / n
    spread = (50.0 / (1e5 * 0.42)) ** 2
    yield entry(
        "image.centre", spread, 0.01 * spread + 2e-5,
        "rays: R^2 n^2 / (z A)^2; diffraction 1 %, table 2e-5",
        shape="disc", size_um=50.0, z_um=1e5, width_px=3, height_px=3,
    )  # fmt: skip


def _sensor() -> Iterator[Entry]:
    for bits in (1, 16):
        top = 2**bits - 1
        common = {"full_well_e": 1e4, "read_noise_e": 0.0, "bits": bits}
        yield entry("sensor.mean", 0, 0, "dark", light=0.0, **common)
        yield entry("sensor.mean", 0, 0, "below dark is dark", light=-1e300, **common)
        yield entry("sensor.mean", top, 0, "saturated", light=1e300, **common)
    for gain, light, value, why in (
        (TINY, 1.0, 0, "a gain next to nothing: no counts"),
        (1e-12, 1e300, 0, "full well, far below half a count"),
        (1e-3, 1e300, round(65.535), "below gain 1 the full well ends it"),
        (1e300, 0.0, 0, "no light, whatever the gain"),
        (1e300, 1.0, 65535, "one electron is enough"),
    ):
        yield entry(
            "sensor.mean", value, 0, why,
            full_well_e=1e4, read_noise_e=0.0, bits=16, light=light, gain=gain,
        )  # fmt: skip
    yield entry(
        "sensor.mean", 0.5 * 65535, 5 * 65535 * math.sqrt(0.5 / 1e9 / 1000),
        "mean of 1000 Poisson draws, 5 sigma",
        full_well_e=1e9, read_noise_e=0.0, bits=16, light=0.5,
    )  # fmt: skip


def _jacobians() -> Iterator[Entry]:
    k = 10 / 7.5
    middle = [15.0, 15.0]
    for row, column, value in ((0, 2, 0.0), (1, 2, 0.0), (0, 0, k), (1, 1, -k)):
        yield entry(
            "jacobian.point", value, abs(value) * ROUNDING,
            "on the axis a turn moves nothing", at_px=middle, row=row, column=column,
        )  # fmt: skip
    yield entry(
        "jacobian.point", 15 - (15 - k * 1e9), 1e9 * k * ROUNDING,
        "a lever of 1 km: row - row of the axis",
        at_px=middle, row=0, column=2, axis_um=[0.0, 1e9],
    )  # fmt: skip


def entries() -> list[Entry]:
    """Compute all points."""
    mp = mpmath()
    mp.mp.dps = 50
    makers = (
        _closed_models, _hopkins_points, _exact_points, _tables, _model_errors,
        _numbers, _coefficients, _images, _sensor, _jacobians, chains,
    )  # fmt: skip
    return [found for maker in makers for found in maker()]


def page() -> str:
    """Return the page with a row for each kind of point."""
    lines = [
        *INTRODUCTION.format(count=len(points())).splitlines(),
        "",
        "| what | points | numbers given | largest error allowed | source |",
        "|---|---|---|---|---|",
        *table_rows(),
    ]
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Write the list and its page."""
    if "--page" not in arguments:
        try:
            made = entries()
        except ModuleNotFoundError:
            sys.stderr.write("mpmath is missing: pip install 'mpmath>=1.3'\n")
            return 2
        lines = ",\n".join(json.dumps(each) for each in made)
        LIST.write_text(f'{{"points": [\n{lines}\n]}}\n', encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
