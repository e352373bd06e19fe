"""Focus steps of a point: a lens with its aberrations, or what to photograph."""

from __future__ import annotations

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


def twin(reading_um: float, zernike: dict[int, float]) -> FloatArray:
    """Return the light of a point by the twins' generator, a little off the middle."""
    bead = Body(shape=Point(0.03, -0.02).buffer(RADIUS_UM, 32), reflectance=1.0)
    optics = Optics(
        aperture=APERTURE, wavelength_um=WAVELENGTH_UM,
        focus_um=reading_um - ZERO_UM, zernike=zernike,
    )  # fmt: skip
    scene = Scene(bodies=(bead,), background=0.0)
    return np.asarray(image(scene, optics, SIZE, UM_PER_PX))


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


def taken(zernike: dict[int, float], peak: float = 40_000.0) -> list[FloatArray]:
    """Return counts over darkness, with the noise of photons."""
    lights = [twin(z, zernike) for z in READINGS.tolist()]
    scale, rng = peak / max(float(each.max()) for each in lights), np.random.default_rng
    return [
        258.0 + rng(k).poisson(np.maximum(each * scale / 2, 0)).astype(np.float64) * 2
        for k, each in enumerate(lights)
    ]


@pytest.mark.parametrize("reading_um", [-2.0, 0.15, 1.6])
def test_images_of_a_point_are_the_twins(reading_um: float) -> None:
    scope = Microscope(
        aperture=0.6, wavelength_um=WAVELENGTH_UM, medium_index=1.0, magnification=1.0,
        pitch_um=UM_PER_PX, width_px=SIZE[1], height_px=SIZE[0],
    )  # fmt: skip
    at_px = (0.03 / UM_PER_PX - 0.5, 0.02 / UM_PER_PX - 0.5)
    shown = np.zeros(SIZE)
    point = PointPicture(
        z_um=reading_um, scope=scope, radius_um=RADIUS_UM, at_px=at_px, shown=shown,
        used=np.ones(SIZE, dtype=np.bool_),
    )  # fmt: skip
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
    lights = [twin(z, {}) for z in z_um.tolist()]
    top = max(float(each.max()) for each in lights)
    made = [258 + rng.normal(0, 8, SIZE) + each * peak / top for each in lights]
    if change == "dark":
        made = [258 + rng.normal(0, 8, SIZE) for _ in lights]
    assert call(cell, series(tmp_path / "steps", made, z_um)) == 2
    shown = capsys.readouterr().err
    assert "MP904" in shown
    assert said in shown
    assert "bead" in shown
