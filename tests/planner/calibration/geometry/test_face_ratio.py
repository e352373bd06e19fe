"""Faces on a part against its own: told, or refused where pictures cannot tell them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from ezdxf.filemanagement import readfile
from shapely.geometry import Polygon, box

from microplan.featuresel.look.scenario import LookCase
from microplan.optics.outline.outline import Outline
from microplan.optics.render.scene import Layer
from microplan.planner.calibration.estimates import BlockEstimate
from microplan.planner.calibration.geometry.face_ratio import face_ratios
from microplan.planner.calibration.geometry.light_field import PlacedGain
from microplan.planner.cli.main import main
from microplan.planner.measure.part_task import PartCall, part_task
from microplan.planner.source.diagnostics import CallError, Report
from tests.featuresel.conftest import disc, make_case
from tests.planner.calibration.twin_series import (
    LENS,
    SIZE,
    UM_PER_PX,
    cell_of,
)
from validation.twins.camera import Camera, exposed, graded
from validation.twins.optics import image
from validation.twins.scenes import Body, Scene, square_with_notch, write_dxf
from validation.twins.series import Frame, Pose, Reading, write

SIGMAS = 4.0
PART = square_with_notch(16.0, 3.0)
PAD = box(-6.0, -6.0, -1.5, 5.0)
GRID_PX = [(x, y) for x in (-20, 0, 20) for y in (-10, 10)]
FAR_PX = 20


def moves() -> Iterator[Frame]:
    """Yield a part with a darker pad, in light that is not even.

    It moves by whole pixels: all are of one image.
    """
    own = Body(shape=Polygon(PART.exterior, [PAD.exterior]), reflectance=0.8)
    scene = Scene(bodies=(own, Body(shape=PAD, reflectance=0.3)), background=0.1)
    wide = image(scene, LENS, (SIZE[0] + 2 * FAR_PX, SIZE[1] + 2 * FAR_PX), UM_PER_PX)
    camera, rng = Camera(gain=1.05, read_noise=1.0), np.random.default_rng(0)
    for right, up in GRID_PX:
        rows = slice(FAR_PX + up, FAR_PX + up + SIZE[0])
        columns = slice(FAR_PX - right, FAR_PX - right + SIZE[1])
        light = graded(wide[rows, columns], 0.2, -0.1)
        x_um, y_um = right * UM_PER_PX, up * UM_PER_PX
        yield Frame(
            counts=exposed(light, camera, rng),
            truth=Pose(x_um=x_um, y_um=y_um),
            reading=Reading(stage_x_um=x_um, stage_y_um=y_um),
        )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a workcell, a drawing and moves of a part with a pad."""
    found = tmp_path_factory.mktemp("faces") / "task"
    cell = cell_of(found)
    text = cell.read_text(encoding="utf-8")
    cell.write_text(text.replace("sensor_um:", "black_level: 0, sensor_um:"))
    draw(found / "part.dxf")
    write(found / "moves", moves(), bits=8)
    return found


def draw(file: Path) -> None:
    """Write the part's outline and its pad on a layer each."""
    write_dxf(PART, file, "OUT")
    document = readfile(file)
    corners = [(x, y) for x, y in PAD.exterior.coords[:-1]]
    space = document.modelspace()
    space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "PADS"})
    document.saveas(file)


def call(folder: Path, faces: str, *words: str) -> int:
    drawing = ("--part", str(folder / "part.dxf"), "--layers", "OUT")
    where = ("--magnification", "20", "--near", "63px,47px,0", "--faces", faces)
    cell = ("--workcell", str(folder / "workcell.yaml"))
    return main(["calibrate", str(folder / "moves"), *cell, *drawing, *where, *words])


def test_a_face_comes_out_within_its_deviation(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "new.yaml"
    assert call(folder, "PADS:0.38", "-o", str(out)) == 0
    found = yaml.safe_load(out.read_text(encoding="utf-8"))["calibrated"]
    for name, light in (("background", 0.1), ("face_PADS", 0.3)):
        ratio = found[f"reflectance_{name}_over_part"]
        assert abs(ratio["value"] - light / 0.8) < SIGMAS * ratio["standard_deviation"]
        assert ratio["standard_deviation"] < 1e-3
    assert "no absolute reflectance" in capsys.readouterr().out


def part_with_face(radius_um: float, ratio: float) -> LookCase:
    """Return a look at a disc of .8 with a round face on it."""
    face = disc(radius_um)
    faces = (Outline(rings=(disc(12.0), face.reversed())), Outline(rings=(face,)))
    named = (("part", 0.8), ("part.face_DOT", 0.8 * ratio))
    layers = tuple(
        Layer(name=name, outline=outline, z_um=0.0, reflectance=light)
        for (name, light), outline in zip(named, faces, strict=True)
    )
    case = make_case("circle", {"radius_um": 12.0}, layers)
    return replace(case, background=0.1, lamp_aperture=None)


def test_faces_that_are_not_as_stated_or_too_small_are_refused() -> None:
    one = PlacedGain(right=0.0, up=0.0, gain=1.0, faces=(0.5,))
    ratio = (0.1 + 0.5 * 0.7) / 0.8
    for radius_um, stated, why in (
        (6.0, ratio + 0.04, ""),
        (6.0, ratio + 0.06, "--faces says 0.622, pictures about 0.562"),
        (1.0, ratio, "blur of its edges fills it"),
        (11.5, ratio, "blur of its edges fills the part beside it"),
    ):
        case = part_with_face(radius_um, stated)
        gain = case.light.gain
        told = replace(one, gain=1.0 / gain, faces=(0.5 / gain,))
        found = face_ratios([[told]], case, has_black=True)
        assert isinstance(found["background"], BlockEstimate)
        face = found["face_DOT"]
        if isinstance(face, BlockEstimate):
            assert not why
            assert face.value == pytest.approx(ratio)
            assert face.sigma is None  # of one place
        else:
            assert face.why == why


def test_what_is_no_face_is_refused(folder: Path) -> None:
    asked = PartCall(
        part=folder / "part.dxf",
        workcell=folder / "workcell.yaml",
        layers=("OUT",),
        magnification=20.0,
    )
    for faces, why in (
        ((("PADS", 1.3),), "its ratio must be 0 to 1.25, is 1.3"),
        ((("PADS", 0.3), ("PADS", 0.4)), "has PADS twice"),
    ):
        with pytest.raises(CallError, match=why):
            part_task(replace(asked, faces=faces), Report())
    report = Report()
    assert part_task(replace(asked, faces=(("NO", 0.5),)), report) is None
    (found,) = report.found
    assert (found.code, Path(found.where.file).name) == ("MP204", "part.dxf")
