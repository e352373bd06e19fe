"""Visible edges in pieces: on pictures drawn by formulas, not rendered."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.special import ndtr

from microplan.arrays import FloatArray
from microplan.optics.outline.outline import Arc, Outline, Ring, Segment
from microplan.planner.export.folder import ExportedPlan, Viewed, read_folder
from microplan.planner.export.pieces import look_outlines
from microplan.planner.store.pictures import picture, picture_sha256
from microplan.schemas.files.evidence import PlacedBody
from microplan.schemas.files.outlines import ArcEdge, LookOutlines
from microplan.schemas.pose import Pose

LOOK = "check_seated.seat"  # a post of 22 um at the origin, nothing over it
RADIUS_UM = 22.0
BLUR_PX = 1.0
POST = "shaft_plate.post"


@pytest.fixture(scope="module")
def folder(compiled_example: Path) -> ExportedPlan:
    return read_folder(compiled_example, [LOOK])


def grid(look: Viewed) -> tuple[FloatArray, FloatArray]:
    """Return the world place of every pixel of a frame of 640 x 480, um."""
    rows, columns = np.mgrid[0:480, 0:640]
    pitch = look.look.view.um_per_px
    return (columns - 319.5) * pitch, (239.5 - rows) * pitch


def disc(look: Viewed, inside: float, outside: FloatArray | float) -> FloatArray:
    """Return the picture of a disc about the origin, its rim a normal distribution."""
    x, y = grid(look)
    blur_um = BLUR_PX * look.look.view.um_per_px
    share = ndtr((RADIUS_UM - np.hypot(x, y)) / blur_um)
    found: FloatArray = inside * share + outside * (1 - share)
    return found


def seen(
    folder: ExportedPlan, image: FloatArray, path: Path, viewed: Viewed | None = None
) -> LookOutlines:
    """Return the pieces of a look if its picture were another one."""
    viewed = viewed or folder.looks[0]
    pixels = picture(image)
    (path / "images").mkdir(exist_ok=True)
    ok, data = cv2.imencode(".png", pixels)
    assert ok
    (path / "images" / "drawn.png").write_bytes(data.tobytes())
    scene = replace(
        viewed.look.scene,
        image="images/drawn.png",
        image_sha256=picture_sha256(pixels),
    )
    drawn = replace(viewed, look=replace(viewed.look, scene=scene))
    return look_outlines(replace(folder, path=path), drawn)


def covered(
    folder: ExportedPlan, outline: Outline, z_um: float
) -> tuple[ExportedPlan, Viewed]:
    """Return the folder and its look with one more body."""
    viewed = folder.looks[0]
    lid = PlacedBody(name="lid", pose=Pose(x_um=0.0, y_um=0.0), z_um=z_um)
    scene = replace(viewed.scene, bodies=(*viewed.scene.bodies, lid))
    outlines = {**folder.outlines, "lid": outline}
    return replace(folder, outlines=outlines), replace(viewed, scene=scene)


def box(x0: float, y0: float, x1: float, y1: float) -> Outline:
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return Outline(rings=(Ring(edges=tuple(Segment(start=a, end=b) for a, b in ends)),))


@pytest.mark.parametrize(
    ("inside", "outside", "polarity"),
    [(0.8, 0.2, "light_to_dark"), (0.2, 0.8, "dark_to_light")],
)
def test_a_disc_is_one_piece_with_the_step_that_the_filter_sees(
    inside: float, outside: float, polarity: str, folder: ExportedPlan, tmp_path: Path
) -> None:
    found = seen(folder, disc(folder.looks[0], inside, outside), tmp_path)
    (piece,) = found.pieces
    assert (piece.polarity, piece.closed, piece.body) == (polarity, True, POST)
    # a Gaussian derivative of width w sees w / sqrt(w^2 + b^2) of an edge with blur b;
    # pixels, grey levels and the rim's curve change that by a percent
    share = found.filter_px / math.hypot(found.filter_px, BLUR_PX)
    assert piece.contrast == pytest.approx(0.6 * share, rel=0.03)
    assert piece.least_contrast == pytest.approx(0.6 * share, rel=0.04)
    assert found.length_um == pytest.approx(math.tau * RADIUS_UM)
    assert (found.hidden_um, found.outside_um) == (0.0, 0.0)
    assert (found.column_px, found.row_px) == (319.5, 239.5)


def test_two_sides_of_a_disc_may_have_two_polarities(
    folder: ExportedPlan, tmp_path: Path
) -> None:
    look = folder.looks[0]
    x, _ = grid(look)
    found = seen(folder, disc(look, 0.5, np.where(x > 0, 0.8, 0.2)), tmp_path)
    clear = [p for p in found.pieces if p.polarity != "unclear"]
    assert sorted(p.polarity for p in clear) == ["dark_to_light", "light_to_dark"]
    total = 0.0
    for piece in clear:
        middles = []
        for edge in piece.edges:
            assert isinstance(edge, ArcEdge)
            total += edge.radius_um * abs(edge.sweep_rad)
            middles.append(math.cos(edge.start_rad + edge.sweep_rad / 2))
        right = piece.polarity == "dark_to_light"
        assert all((middle > 0) == right for middle in middles)
    # what is unclear lies where the background changes sides, over the filter's reach
    around = math.tau * RADIUS_UM
    assert around - 2 * 6 * found.filter_px * found.um_per_px < total <= around + 1e-6


def test_no_contrast_is_told_as_unclear(folder: ExportedPlan, tmp_path: Path) -> None:
    found = seen(folder, disc(folder.looks[0], 0.5, 0.5), tmp_path)
    assert [p.polarity for p in found.pieces] == ["unclear"]


@pytest.mark.parametrize("offset_um", [0.0, 9.5, -21.0])
def test_what_lies_under_a_higher_body_is_cut_away(
    offset_um: float, folder: ExportedPlan, tmp_path: Path
) -> None:
    lid = box(offset_um, -500.0, 500.0, 500.0)
    over, viewed = covered(folder, lid, 300.0)
    found = seen(over, disc(viewed, 0.8, 0.2), tmp_path, viewed)
    half_rad = math.acos(offset_um / RADIUS_UM)  # of the rim right of the lid's edge
    spacing_um = 0.5 * found.um_per_px
    assert found.hidden_um == pytest.approx(
        2 * half_rad * RADIUS_UM, abs=2 * spacing_um
    )
    (piece,) = found.pieces
    assert not piece.closed
    edges = [edge for edge in piece.edges if isinstance(edge, ArcEdge)]
    ends = (edges[0].start_rad, edges[-1].start_rad + edges[-1].sweep_rad)
    assert sum(edge.sweep_rad for edge in edges) == pytest.approx(
        math.tau - 2 * half_rad, abs=1e-5
    )
    assert [math.cos(end) * RADIUS_UM for end in ends] == pytest.approx(
        [offset_um] * 2, abs=1e-4
    )


@pytest.mark.parametrize("z_um", [-5.0, 249.0, 250.0])
def test_what_is_not_higher_hides_nothing(
    z_um: float, folder: ExportedPlan, tmp_path: Path
) -> None:
    under, viewed = covered(folder, box(-500.0, -500.0, 500.0, 500.0), z_um)
    found = seen(under, disc(viewed, 0.8, 0.2), tmp_path, viewed)
    assert found.hidden_um == 0.0
    assert [p.closed for p in found.pieces] == [True]


def test_a_target_that_is_all_covered_has_no_piece(
    folder: ExportedPlan, tmp_path: Path
) -> None:
    over, viewed = covered(folder, box(-500.0, -500.0, 500.0, 500.0), 300.0)
    found = seen(over, disc(viewed, 0.8, 0.2), tmp_path, viewed)
    assert found.pieces == ()
    assert found.hidden_um == pytest.approx(found.length_um)


def test_what_is_out_of_the_frame_is_cut_away(
    folder: ExportedPlan, tmp_path: Path
) -> None:
    viewed = folder.looks[0]
    edge_um = 319.5 * viewed.look.view.um_per_px  # of the frame, from its middle
    shift = Pose(x_um=edge_um, y_um=0.0)
    bodies = tuple(
        replace(b, pose=shift) if b.name == POST else b for b in viewed.scene.bodies
    )
    target = replace(viewed.scene.target, pose=shift)
    moved = replace(viewed, scene=replace(viewed.scene, bodies=bodies, target=target))
    image = np.roll(disc(viewed, 0.8, 0.2), 320, axis=1)
    found = seen(folder, image, tmp_path, moved)
    assert 0.5 * found.length_um < found.outside_um < 0.9 * found.length_um
    for piece in found.pieces:
        for arc in piece.edges:
            assert isinstance(arc, ArcEdge)
            for share in np.linspace(0, 1, 9):
                angle = arc.start_rad + share * arc.sweep_rad
                assert RADIUS_UM * math.cos(angle) < 0


def test_a_ring_that_is_run_the_other_way_looks_the_same(
    folder: ExportedPlan, tmp_path: Path
) -> None:
    """A hole of a bright plate: out of the material leads into the dark middle."""
    hole = Ring(
        edges=(
            Arc(
                center=(0.0, 0.0),
                radius_um=RADIUS_UM,
                start_rad=0.0,
                sweep_rad=-math.tau,
            ),
        )
    )
    plate = Outline(rings=(*box(-90.0, -90.0, 90.0, 90.0).rings, hole))
    viewed = folder.looks[0]
    target = replace(viewed.scene.target, ring=1)
    viewed = replace(viewed, scene=replace(viewed.scene, target=target))
    holed = replace(folder, outlines={**folder.outlines, POST: plate})
    found = seen(holed, disc(viewed, 0.1, 0.7), tmp_path, viewed)
    assert [(p.polarity, p.closed) for p in found.pieces] == [("light_to_dark", True)]
