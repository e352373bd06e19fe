"""Focus steps of a point: a lens with its aberrations, or what to photograph."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf.filemanagement
import numpy as np
import pytest
import tifffile
import yaml
from shapely.geometry import Point

from benchmarks.real.point_fit import found_height_um
from microplan.arrays import FloatArray
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.calibration.through_focus.lens_picture import TriedLens
from microplan.planner.calibration.through_focus.point_checks import why_unfit
from microplan.planner.calibration.through_focus.point_picture import PointPicture
from microplan.planner.cli.main import main
from tests.planner.calibration.twin_series import cell_of
from validation.point_source.series import noise_counts, read_series
from validation.twins.optics import Optics, image
from validation.twins.scenes import Body, Scene

APERTURE, WAVELENGTH_UM, ZERO_UM, UM_PER_PX, SIZE = 0.58, 0.55, 0.15, 0.16, (48, 48)
RADIUS_UM, MAGNIFICATION = 0.05, 40.0
READINGS = np.linspace(-3.0, 3.3, 9)
WAVES = {6: 0.05, 8: -0.06, 11: 0.04}
REAL = Path("validation/point_source/series.tif")


def twin(
    reading_um: float, zernike: dict[int, float], um_per_px: float = UM_PER_PX,
    other_px: float | None = None,
) -> FloatArray:  # fmt: skip
    """Return the light of a point by the twins' generator, a little off the middle.

    With another half as bright to the right, if it is said how far.
    """
    bead = Body(shape=Point(0.03, -0.02).buffer(RADIUS_UM, 32), reflectance=1.0)
    bodies = [bead]
    if other_px is not None:
        place = Point(other_px * um_per_px, 0.0).buffer(RADIUS_UM, 32)
        bodies.append(Body(shape=place, reflectance=0.5))
    optics = Optics(
        aperture=APERTURE, wavelength_um=WAVELENGTH_UM,
        focus_um=reading_um - ZERO_UM, zernike=zernike,
    )  # fmt: skip
    scene = Scene(bodies=tuple(bodies), background=0.0)
    return np.asarray(image(scene, optics, SIZE, um_per_px))


def station(folder: Path, side_px: int, um_per_px: float, optics: str) -> Path:
    """Return a workcell, and a drawing of a point beside it."""
    cell = cell_of(folder)
    text = cell.read_text(encoding="utf-8")
    side_um = side_px * um_per_px * MAGNIFICATION
    for old, new in (
        ("[960, 720], pixels: [128, 96]",
         f"[{side_um}, {side_um}], pixels: [{side_px}, {side_px}]"),
        ("numerical_aperture: 0.42", optics.split(", ")[0]),
        ("wavelength_um: 0.6", optics.split(", ")[1]),
        ("bits: 8,", "bits: 16, black_level: 258, response: 1.0,"),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    cell.write_text(text, encoding="utf-8")
    drawing = ezdxf.filemanagement.new("R2010")
    drawing.header["$INSUNITS"] = 13
    drawing.modelspace().add_circle((0, 0), RADIUS_UM)
    drawing.saveas(folder / "bead.dxf")
    return cell


def series(folder: Path, pictures: list[FloatArray], z_um: FloatArray) -> Path:
    folder.mkdir()
    rows = ["file,z_um"]
    for number, (each, z) in enumerate(zip(pictures, z_um.tolist(), strict=True)):
        counts = np.clip(np.rint(each), 0, 65535).astype(np.uint16)
        tifffile.imwrite(folder / f"{number:02d}.tif", counts)
        rows.append(f"{number:02d}.tif,{z:.4f}")
    (folder / "readings.csv").write_text("\n".join(rows), encoding="utf-8")
    return folder


def call(cell: Path, pictures: Path, *more: str) -> int:
    part = ["--part", str(cell.parent / "bead.dxf"), "--magnification", "40"]
    return main(["calibrate", str(pictures), "--workcell", str(cell), *part, *more])


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("point") / "task"
    lens = f"numerical_aperture: 0.6, wavelength_um: {WAVELENGTH_UM}"
    return station(folder, SIZE[0], UM_PER_PX, lens)


def taken(
    zernike: dict[int, float], peak: float = 40_000.0, um_per_px: float = UM_PER_PX
) -> list[FloatArray]:
    """Return counts over darkness, with the noise of photons."""
    lights = [twin(z, zernike, um_per_px) for z in READINGS.tolist()]
    scale, rng = peak / max(float(each.max()) for each in lights), np.random.default_rng
    return [
        258.0 + rng(k).poisson(np.maximum(each * scale / 2, 0)).astype(np.float64) * 2
        for k, each in enumerate(lights)
    ]


def posed(reading_um: float) -> PointPicture:
    """Return a dark picture of the twin's point."""
    scope = Microscope(
        aperture=0.6, wavelength_um=WAVELENGTH_UM, medium_index=1.0, magnification=1.0,
        pitch_um=UM_PER_PX, width_px=SIZE[1], height_px=SIZE[0],
    )  # fmt: skip
    return PointPicture(
        z_um=reading_um, scope=scope, radius_um=RADIUS_UM,
        at_px=(0.03 / UM_PER_PX - 0.5, 0.02 / UM_PER_PX - 0.5), shown=np.zeros(SIZE),
        used=np.ones(SIZE, dtype=np.bool_),
    )  # fmt: skip


@pytest.mark.parametrize("reading_um", [-2.0, 0.15, 1.6])
def test_images_of_a_point_are_the_twins(reading_um: float) -> None:
    point = posed(reading_um)
    lens = TriedLens(
        aperture=APERTURE, zero_um=ZERO_UM, scale=1.0, terms=tuple(WAVES.items())
    )
    found, meant = point.image(lens), twin(reading_um, WAVES)
    scale = float((found * meant).sum() / (found * found).sum())
    np.testing.assert_allclose(found * scale, meant, atol=0.01 * float(meant.max()))


@pytest.mark.slow
def test_a_twins_lens_comes_out_of_a_point(cell: Path, tmp_path: Path) -> None:
    out = cell.parent / "new.yaml"
    steps = series(tmp_path / "steps", taken(WAVES), READINGS)
    assert call(cell, steps, "-o", str(out)) == 0
    new: Any = yaml.safe_load(out.read_text(encoding="utf-8"))
    how = new["calibrated"]
    for key, true in (
        ("numerical_aperture", APERTURE), ("focus_zero_um", ZERO_UM),
        ("focus_scale", 1.0),
    ):  # fmt: skip
        off = abs(how[key]["value"] - true)
        assert off < 4 * how[key]["standard_deviation"]
        assert off < 0.02
    rows = {row["noll"]: row for row in new["optics"]["wavefront"]}
    assert set(WAVES) <= set(rows)
    for noll, row in rows.items():
        off = abs(row["waves"] - WAVES.get(noll, 0.0))
        assert off < 4 * row["sigma_waves"]
        assert off < 0.003


@pytest.mark.slow
def test_a_real_point_tells_the_side_of_focus(tmp_path: Path) -> None:
    """Learned on the odd planes; heights of the even ones by the benchmark's fit."""
    real = station(
        tmp_path / "task", 64, 0.13, "numerical_aperture: 0.85, wavelength_um: 0.52"
    )
    planes: FloatArray = np.asarray(tifffile.imread(REAL), dtype=np.float64)
    odd = np.arange(1, 25, 2)
    out = real.parent / "new.yaml"
    readings: FloatArray = -0.3 * odd.astype(np.float64)
    steps = series(tmp_path / "steps", list(planes[odd]), readings)
    assert call(real, steps, "-o", str(out)) == 0
    new: Any = yaml.safe_load(out.read_text(encoding="utf-8"))
    assert new["optics"]["numerical_aperture"] == pytest.approx(0.85, rel=0.06)
    how, rows = new["calibrated"], new["optics"]["wavefront"]
    lens = Microscope(
        aperture=new["optics"]["numerical_aperture"], wavelength_um=0.52,
        medium_index=1.0, magnification=1.0, pitch_um=0.13, width_px=64, height_px=64,
        wavefront=tuple((row["noll"], row["waves"]) for row in rows),
    )  # fmt: skip
    right, tried, pictures = 0, 0, read_series()
    for k in range(0, 25, 2):
        scale = how["focus_scale"]["value"]
        z_um = scale * (0.3 * k + how["focus_zero_um"]["value"])
        if abs(z_um) > lens.wave_depth_um / 2:
            heights = np.arange(-4.5, 4.51, 0.1)
            found = found_height_um(pictures[k], lens, noise_counts(pictures), heights)
            tried += 1
            right += found * z_um > 0
    assert tried >= 11
    assert right >= tried - 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("saturated", "is saturated where the point is"),
        ("few", "5 focus readings, 6 are needed"),
        ("one side", "readings below the sharpest"),
        ("dark", "has a bright point"),
        ("dark near", "has a bright point within 8 px"),
        ("flat", "has a bright point"),
        ("left", "nearer to the border than 12 px"),
        ("right", "nearer to the border than 12 px"),
        ("coarse", "photograph the bead at 28 x or more"),  # 4 A .32 um 20 / wavelength
        ("two", "a point 18 px away is 5"),
    ],
)
def test_points_that_tell_no_lens_are_findings(
    cell: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: str,
    said: str,
) -> None:  # fmt: skip
    rng = np.random.default_rng(0)
    peak = {"saturated": 200_000.0}.get(change, 30_000.0)
    kept = {"few": slice(2, 7), "one side": slice(4, 9)}.get(change, slice(None))
    z_um = READINGS[kept]
    if change == "one side":
        z_um = np.linspace(0.15, 3.3, 7)
    other_px = 18.5 if change == "two" else None
    lights = [twin(z, {}, other_px=other_px) for z in z_um.tolist()]
    top = max(float(each.max()) for each in lights)
    made: list[FloatArray] = [
        258 + rng.normal(0, 8, SIZE) + each * peak / top for each in lights
    ]
    if change.startswith("dark"):
        made = [258 + rng.normal(0, 8, SIZE) for _ in lights]
    if change == "flat":
        made = [258.0 + np.rint(rng.random(SIZE) * 0.55) for _ in lights]
    shift = {"left": -22, "right": 20}.get(change, 0)
    made = [np.roll(each, shift, axis=1) for each in made]
    more = {"dark near": ("--near", "24px,24px"), "coarse": ("--magnification", "20")}
    steps = series(tmp_path / "steps", made, z_um)
    assert call(cell, steps, *more.get(change, ())) == 2
    shown = capsys.readouterr().err
    assert "MP904" in shown
    assert said in shown
    assert "bead" in shown


@pytest.mark.slow
def test_pixels_too_large_for_the_aperture_found_are_a_finding(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An aperture stated too small allows what that of the pictures does not."""
    lens = f"numerical_aperture: 0.42, wavelength_um: {WAVELENGTH_UM}"
    coarse = station(tmp_path / "task", SIZE[0], 0.3, lens)
    steps = series(tmp_path / "steps", taken({}, um_per_px=0.3), READINGS)
    assert call(coarse, steps) == 2
    shown = capsys.readouterr().err
    needed = re.search(r"at ([0-9.]+) x or more", shown)
    assert needed
    true = 4 * APERTURE * 0.3 / WAVELENGTH_UM * MAGNIFICATION
    assert float(needed[1]) == pytest.approx(true, rel=0.03)


@pytest.mark.parametrize(
    "noll",
    [
        *(5, 8, 11),
        *(pytest.param(n, marks=pytest.mark.slow) for n in (6, 7, 9, 10, 22)),
    ],
)
def test_rings_of_an_aberrated_lens_are_no_other_point(noll: int) -> None:
    point, lights = posed(0.0), [twin(z, {noll: 0.1}) for z in READINGS.tolist()]
    top = max(float(each.max()) for each in lights)
    pictures = [
        replace(point, z_um=z, shown=each / top * 0.5)
        for z, each in zip(READINGS.tolist(), lights, strict=True)
    ]
    assert why_unfit(pictures, 1 / 65535) == ""


@pytest.mark.parametrize("drawn", ["ellipse", "two circles"])
def test_a_bead_is_drawn_as_one_circle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], drawn: str
) -> None:
    lens = f"numerical_aperture: 0.6, wavelength_um: {WAVELENGTH_UM}"
    cell = station(tmp_path / "task", SIZE[0], UM_PER_PX, lens)
    drawing = ezdxf.filemanagement.new("R2010")
    drawing.header["$INSUNITS"] = 13
    if drawn == "ellipse":
        drawing.modelspace().add_ellipse((0, 0), (0.06, 0), 0.7)
    else:
        for x in (0.0, 0.5):
            drawing.modelspace().add_circle((x, 0), RADIUS_UM)
    drawing.saveas(cell.parent / "bead.dxf")
    dark = [np.full(SIZE, 258.0 + k) for k in range(len(READINGS))]
    assert call(cell, series(tmp_path / "steps", dark, READINGS)) == 2
    shown = capsys.readouterr().err
    assert "MP903" in shown
    assert "draw a bead as one circle" in shown
