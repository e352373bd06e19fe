"""Twins against shapely, textbooks and what they state of themselves."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from ezdxf.filemanagement import readfile
from shapely.geometry import MultiPolygon, Polygon, box

from validation import twins
from validation.twins import optics, scenes, series
from validation.twins.camera import Camera, dusted, exposed, graded
from validation.twins.optics import Optics
from validation.twins.scenes import Body, Floats, Scene, coverage, placed

SIZE, PITCH = (72, 96), 0.4
LENS = Optics(aperture=0.42, wavelength_um=0.6)
SHAPES = {
    "gear": scenes.gear(9.0, 7.5, 2.0),
    "ring": scenes.ring(8.0, 5.0),
    "dot": scenes.dot(4.0),
    "notch": scenes.square_with_notch(10.0, 4.0),
    "cross": scenes.cross(12.0, 3.0),
    "slot": scenes.slot(12.0, 3.0),
}


def centroid_um(light: Floats, size: tuple[int, int] = SIZE) -> tuple[float, float]:
    x, y = scenes.axes_um(size, PITCH)
    total = light.sum()
    return float((light @ x).sum() / total), float((y @ light).sum() / total)


def middle_um(light: Floats) -> tuple[float, float]:
    """Return the centroid of squares: a lens spreads faint light past the picture."""
    return centroid_um((light - light[0, 0]) ** 2)


@pytest.mark.parametrize("name", SHAPES)
def test_coverage_has_the_area_and_the_centroid_of_the_shape(name: str) -> None:
    shape = placed(SHAPES[name], 2.13, -1.37, 0.4)
    found = coverage(shape, SIZE, PITCH)
    assert found.sum() * PITCH**2 == pytest.approx(shape.area, rel=1e-3)
    middle = shape.centroid.coords[0]
    assert centroid_um(found) == pytest.approx(middle, abs=4e-3 * PITCH)


def test_coverage_of_pixels_is_that_of_their_squares() -> None:
    shape = placed(SHAPES["gear"], 0.3, 0.2, 0.1)
    found = coverage(shape, (50, 51), PITCH, 8)
    x, y = scenes.axes_um((50, 51), PITCH)
    for row, column in np.random.default_rng(0).integers(5, 45, (60, 2)):
        half = PITCH / 2
        a, b = x[column], y[row]
        pixel = box(a - half, b - half, a + half, b + half)
        wanted = shape.intersection(pixel).area / PITCH**2
        assert found[row, column] == pytest.approx(wanted, abs=0.06)
    with pytest.raises(ValueError, match="finer"):
        coverage(shape, SIZE, PITCH, 4)


def test_a_mark_lands_where_conventions_say() -> None:
    """+x is right, +y is up, angles turn counter-clockwise."""
    mark = box(4.9 * PITCH, -0.1 * PITCH, 5.1 * PITCH, 0.1 * PITCH)  # on +x
    size = (41, 31)
    for theta, where in ((0.0, (20, 20)), (math.pi / 2, (15, 15))):
        assert np.argwhere(
            coverage(placed(mark, 0, 0, theta), size, PITCH)
        ).tolist() == [list(where)]
    moved = coverage(placed(mark, PITCH, 2 * PITCH, 0), size, PITCH)
    assert np.argwhere(moved).tolist() == [[18, 21]]


@pytest.mark.parametrize("coherence", [None, 0.6])
def test_the_centroid_of_a_dot_is_its_pose(coherence: float | None) -> None:
    lens = Optics(aperture=0.42, wavelength_um=0.6, focus_um=1.5, coherence=coherence)
    body = Body(shape=placed(SHAPES["dot"], 1.237, -0.711, 0.3), reflectance=0.9)
    scene = Scene(bodies=(body,), background=0.1)
    x, y = middle_um(optics.image(scene, lens, SIZE, PITCH))
    assert x == pytest.approx(1.237, abs=2e-3 * PITCH)
    assert y == pytest.approx(-0.711, abs=2e-3 * PITCH)


def test_the_transfer_in_focus_is_the_textbook_s() -> None:
    """The common area of two discs: Goodman, Introduction to Fourier Optics, 6.3."""
    plane = optics.plane_of(LENS, SIZE, PITCH)
    found = optics.transfer(LENS, plane)[0]
    u = plane.frequencies()[0][0]
    for share in (0.2, 0.5, 0.8):
        at = int(np.argmin(np.abs(u - share * 2 * 0.42 / 0.6)))
        x = u[at] * 0.6 / (2 * 0.42)
        wanted = 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x**2))
        assert found[at] == pytest.approx(wanted, abs=3e-3)
    assert np.abs(found[np.abs(u) > 1.01 * 2 * 0.42 / 0.6]).max() < 1e-9


def test_a_grating_loses_the_contrast_that_transfer_and_pixels_say() -> None:
    """The whole way: bodies, lens and the mean over pixels."""
    period, pitch, size = 2.0, 0.25, (8, 64)
    bars = MultiPolygon(
        [box((k - 0.25) * period, -6, (k + 0.25) * period, 6) for k in range(-6, 7)]
    )
    scene = Scene(bodies=(Body(shape=bars, reflectance=1.0),), background=0.0)
    line = optics.image(scene, LENS, size, pitch)[4]
    x = scenes.axes_um(size, pitch)[0]
    found = 2 * np.mean(line * np.cos(2 * np.pi * x / period))
    s = 0.6 / (2 * 0.42 * period)
    passed = 2 / np.pi * (np.arccos(s) - s * np.sqrt(1 - s**2))
    assert found == pytest.approx(
        2 / np.pi * passed * np.sinc(pitch / period), rel=4e-3
    )


@pytest.mark.parametrize("focus_um", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("halo", [None, (1.0, 0.2)])
def test_defocus_and_halo_conserve_energy(
    focus_um: float, halo: tuple[float, float] | None
) -> None:
    lens = Optics(aperture=0.42, wavelength_um=0.6, focus_um=focus_um, halo=halo)
    shape = SHAPES["notch"]
    scene = Scene(bodies=(Body(shape=shape, reflectance=0.7),), background=0.0)
    total = optics.image(scene, lens, (120, 120), PITCH).sum() * PITCH**2
    assert total == pytest.approx(0.7 * shape.area, rel=5e-3)


def test_heights_blur_by_their_distance_from_focus() -> None:
    left, right = placed(SHAPES["dot"], -9, 0, 0), placed(SHAPES["dot"], 9, 0, 0)
    low = Body(shape=left, reflectance=1.0, z_um=0.0)
    high = Body(shape=right, reflectance=1.0, z_um=5.0)
    scene = Scene(bodies=(low, high), background=0.0)
    light = optics.image(scene, LENS, SIZE, PITCH)
    steep = np.abs(np.diff(light, axis=1))
    assert steep[:, :48].max() > 2 * steep[:, 48:].max()
    focused = Optics(aperture=0.42, wavelength_um=0.6, focus_um=5.0)
    assert optics.image(scene, focused, SIZE, PITCH)[:, ::-1] == pytest.approx(
        light, abs=1e-6
    )


@pytest.mark.parametrize(("coherence", "wanted"), [(0.0, 0.25), (None, 0.5)])
def test_the_mid_level_of_an_edge(coherence: float | None, wanted: float) -> None:
    """A quarter in coherent light, half in incoherent."""
    lens = Optics(aperture=0.42, wavelength_um=0.6, coherence=coherence)
    half = Body(shape=box(0, -500, 500, 500), reflectance=1.0)
    scene = Scene(bodies=(half,), background=0.0)
    light = optics.image(scene, lens, (9, 129), 0.05)
    assert light[4, 64] == pytest.approx(wanted, abs=5e-3)
    assert light[4, 32] < 0.1 < 0.8 < light[4, 96]


def test_even_light_stays_even() -> None:
    for coherence in (None, 0.0, 0.7):
        lens = Optics(aperture=0.42, wavelength_um=0.6, coherence=coherence)
        light = optics.image(Scene(bodies=(), background=0.3), lens, (8, 8), PITCH)
        assert light == pytest.approx(0.3)
    low = Body(shape=SHAPES["dot"], reflectance=1.0)
    two = (low, Body(shape=SHAPES["ring"], reflectance=1.0, z_um=1.0))
    lens = Optics(aperture=0.42, wavelength_um=0.6, coherence=0.5)
    with pytest.raises(ValueError, match="one height"):
        optics.image(Scene(bodies=two, background=0.0), lens, SIZE, PITCH)


def test_zernikes_are_noll_s() -> None:
    """Orthonormal over the disc, and the named ones have their textbook forms."""
    axis = (np.arange(200) + 0.5) / 100 - 1
    x, y = np.meshgrid(axis, axis)
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    disc = r <= 1
    some = np.stack([optics.zernike(j, r, angle)[disc] for j in range(1, 16)])
    assert some @ some.T / disc.sum() == pytest.approx(np.eye(15), abs=0.02)
    assert some[1] == pytest.approx(2 * x[disc])
    assert some[2] == pytest.approx(2 * y[disc])
    assert some[3] == pytest.approx(math.sqrt(3) * (2 * r**2 - 1)[disc])
    assert some[10] == pytest.approx(math.sqrt(5) * (6 * r**4 - 6 * r**2 + 1)[disc])


def test_counts_have_the_noise_that_is_stated() -> None:
    light = np.full((250, 250), 0.4)
    rng = np.random.default_rng(1)
    table = Camera(bits=12, white=4000, noise_table=[(0, 10.0), (4000, 410.0)])
    well = Camera(bits=12, black=100, white=4000, read_noise=6, full_well=9000)
    bent = Camera(bits=12, white=4000, gamma=0.6, full_well=9000, gain=1.2)
    for camera in (table, well, bent):
        counts = exposed(light, camera, rng)
        wanted = float(camera.variance(light)[0, 0]) + 1 / 12
        assert counts.mean() == pytest.approx(camera.level(light)[0, 0], rel=1e-3)
        assert counts.var() == pytest.approx(wanted, rel=0.03)
    assert table.variance(light)[0, 0] == pytest.approx(170)
    assert well.variance(light)[0, 0] == pytest.approx(36 + 3900**2 * 0.4 / 9000)
    fixed = Camera(bits=16, white=5e4, pattern=20.0)
    first = exposed(light, fixed, rng).astype(float)
    assert first.std() == pytest.approx(20, rel=0.02)
    assert (exposed(light, fixed, rng) == first).all()
    with pytest.raises(ValueError, match="alone"):
        Camera(read_noise=1.0, noise_table=[(0, 1.0)])


def test_the_dark_is_cut_off_and_the_bright_too() -> None:
    light = np.linspace(0, 1, 101)[None, :]
    rng = np.random.default_rng(1)
    counts = exposed(light, Camera(black=-51.0, white=255.0), rng)[0]
    assert (counts[:17] == 0).all()
    assert counts[50] == pytest.approx(102, abs=1)
    assert exposed(light, Camera(white=400.0), rng)[0, 65:].min() == 255
    gamma = exposed(light, Camera(gamma=0.5), rng)[0]
    assert gamma[25] == pytest.approx(127.5, abs=1)


def test_dust_takes_light_and_a_gradient_keeps_its_mean() -> None:
    light = np.full(SIZE, 0.5)
    dusty = dusted(light, 10, np.random.default_rng(0))
    assert dusty.max() <= 0.5
    assert dusty.mean() < 0.499
    uneven = graded(light, 0.2, 0.1)
    assert uneven.mean() == pytest.approx(0.5)
    assert uneven[0, -1] > uneven[0, 0] > uneven[-1, 0]


def rig(**camera: float) -> series.Rig:
    return series.Rig(
        part=(Body(shape=SHAPES["dot"], reflectance=0.8),),
        surroundings=Scene(bodies=(), background=0.0),
        optics=LENS,
        camera=Camera(bits=16, white=60000.0, **camera),  # type: ignore[arg-type]
        size=SIZE,
        um_per_px=PITCH,
    )


def test_frames_show_the_part_at_their_truth_and_repeat_by_seed() -> None:
    pose = series.Pose(x_um=1.0, y_um=-0.5)
    found = list(series.still(rig(), pose, 3, vibration_um=0.3, seed=5))
    assert len({frame.truth for frame in found}) == 3
    for frame in found:
        where = middle_um(frame.counts.astype(float))
        wanted = (frame.truth.x_um, frame.truth.y_um)
        assert where == pytest.approx(wanted, abs=2e-3 * PITCH)
    again = list(series.still(rig(), pose, 1, vibration_um=0.3, seed=5))
    assert (again[0].counts == found[0].counts).all()
    (moved,) = series.stage_moves(rig(), pose, [(2.0, 1.0)])
    assert moved.truth == series.Pose(x_um=3.0, y_um=0.5)


def test_light_and_focus_change_frames() -> None:
    half, full = series.light_levels(rig(), series.Pose(), [0.5, 1.0])
    assert half.counts == pytest.approx(full.counts / 2, abs=1)
    sharp, blurred = series.focus_steps(rig(), series.Pose(), [0.0, 4.0])
    assert np.ptp(np.diff(sharp.counts.astype(float))) > 1.5 * np.ptp(
        np.diff(blurred.counts.astype(float))
    )


@pytest.mark.parametrize("ending", [".png", ".tif"])
@pytest.mark.parametrize("bits", [8, 12])
def test_a_folder_holds_the_frames(tmp_path: Path, ending: str, bits: int) -> None:
    counts = np.random.default_rng(0).integers(0, 2**bits, (5, 7)).astype(np.uint16)
    said = series.Reading(focus_um=1.5, stage_y_um=-2.0, light=0.5)
    frame = series.Frame(counts=counts, truth=series.Pose(x_um=3.0), reading=said)
    truths = series.write(tmp_path / "f", [frame], bits=bits, ending=ending)
    assert truths == (frame.truth,)
    file = tmp_path / "f" / f"0000{ending}"
    read = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert read.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert (read == counts).all()
    if ending == ".tif":
        assert (tifffile.imread(file) == counts).all()
    lines = (tmp_path / "f" / "readings.csv").read_text(encoding="utf-8").split("\n")
    assert lines[0] == "file,focus_um,stage_x_um,stage_y_um,light"
    assert lines[1] == f"0000{ending},1.5,0.0,-2.0,0.5"


def test_a_drawing_holds_the_rings_of_a_shape(tmp_path: Path) -> None:
    scenes.write_dxf(SHAPES["ring"], tmp_path / "a.dxf", "PART")
    document = readfile(tmp_path / "a.dxf")
    assert document.header["$INSUNITS"] == 13
    lines = list(document.modelspace().query("LWPOLYLINE"))
    assert all(each.closed and each.dxf.layer == "PART" for each in lines)
    outer, inner = (Polygon(each.get_points("xy")).area for each in lines)
    assert outer - inner == pytest.approx(SHAPES["ring"].area)


def test_twins_import_nothing_of_what_they_judge() -> None:
    for file in Path(twins.__file__).parent.parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [getattr(node, "module", None) or ""]
            if isinstance(node, ast.Import):
                names = [each.name for each in node.names]
            assert not any(each.split(".")[0] == "microplan" for each in names), file
