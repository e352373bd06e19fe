"""The cell's own camera: bodies where they truly are, its faults, its surfaces."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.simulated.cameras.kinds import CameraKind
from microplan.executor.simulated.cameras.solid_pictures import bodies_of
from microplan.executor.simulated.cell import Cell, build_cell
from microplan.executor.simulated.imaging.imaging_view import LampLevel, PixelWindow
from microplan.schemas.codec import from_data, to_data
from microplan.schemas.files.world import World
from microplan.schemas.plan import Region
from microplan.schemas.pose import Pose
from tests.executor.bench import quiet, world

REGION = Region(row=180, column=260, rows=120, columns=120)
GEAR_UM = (4.0, -7.0)  # where its middle is shown


def seeing_the_gear(*faults: str) -> Cell:
    """Return a cell with the gear in the middle of the view and in focus."""
    cell = build_cell(quiet(world()), 2, faults, camera="solid")
    cell.truth.bodies["gear"].pose = Pose(
        x_um=600 + GEAR_UM[0], y_um=GEAR_UM[1], theta_rad=0.3
    )
    cell.lens.set_magnification(6.9)
    cell.lens.set_focus_um(100.0)
    return cell


def centroid_um(counts: np.ndarray, region: Region) -> tuple[float, float]:
    """Return the middle of what is bright, um from the axis."""
    # a little above the dark stage: at half the light, what blurs the notch's edges
    # would be taken for a wider notch
    light = np.clip(counts.astype(float) - 30, 0, None)
    row, column = np.mgrid[: region.rows, : region.columns]
    x = region.column + (light * column).sum() / light.sum() - 319.5
    y = 239.5 - region.row - (light * row).sum() / light.sum()
    return x * 7.5 / 6.9, y * 7.5 / 6.9


def test_the_gear_is_shown_where_it_truly_is() -> None:
    cell = seeing_the_gear()
    found = centroid_um(cell.camera.grab(REGION).counts, REGION)
    shown = cell.shown_um("gear", 0.0, 0.0)
    # the notch takes 31 um2 out of 5106 um2, 27 um off the middle towards +y, and the
    # gear is turned by .3 rad
    notch_um = 31 * 27 / 5106
    wanted = (
        shown[0] + notch_um * math.sin(0.3), shown[1] - notch_um * math.cos(0.3)
    )  # fmt: skip
    # what is cut off below 30 of 203 counts: .1 of a blur of .9 um along the notch's
    # 17 um of edges, 1.5 um2 or .008 um; noise: 2.5 counts at 30 um off in 4300 px,
    # 3 sigma are .02 um
    assert found == pytest.approx(wanted, abs=0.03)


def test_a_mirrored_camera_reads_the_other_side() -> None:
    """Noise apart: both cells draw it alike, so the very counts agree."""
    plain = seeing_the_gear()
    other = replace(REGION, column=640 - REGION.column - REGION.columns)
    mirrored = seeing_the_gear("mirror_camera")
    image = plain.camera.grab(REGION).counts
    # the mirrored camera draws its noise before it is mirrored
    again = mirrored.camera.grab(other).counts[:, ::-1]
    np.testing.assert_array_equal(image, again)


def test_a_swapped_camera_shows_x_along_y() -> None:
    swapped = seeing_the_gear("swap_camera")
    found = centroid_um(swapped.camera.grab(REGION).counts, REGION)
    shown = swapped.shown_um("gear", 0.0, 0.0)
    # an even number of columns and rows: half a pixel at most
    assert abs(found[0]) == pytest.approx(abs(shown[1]), abs=0.8)
    assert abs(found[1]) == pytest.approx(abs(shown[0]), abs=0.8)


def test_bodies_stand_where_the_truth_has_them() -> None:
    cell = seeing_the_gear()
    scene = bodies_of(cell.truth)
    named = {body.name: body for body in scene.bodies}
    assert set(named) == {
        "gear", "shaft_plate", "shaft_plate.post", "tweezers.left", "tweezers.right"
    }  # fmt: skip
    gear = cell.truth.bodies["gear"]
    assert named["gear"].top_um == pytest.approx(cell.truth.top_um(gear))
    assert named["gear"].outline.rings[1] == gear.part.outline.rings[1].edges
    grip, gap = cell.truth.grip_pose(), cell.truth.opening_um
    right, left = named["tweezers.right"].pose, named["tweezers.left"].pose
    assert right.x_um - left.x_um == pytest.approx(gap)
    assert (right.x_um + left.x_um) / 2 == pytest.approx(grip.x_um)


def test_a_bore_as_fabricated_is_that_of_the_contact() -> None:
    plain = world()
    gear = replace(plain.parts[0], profile_tolerance_um=0.3)
    truth = build_cell(replace(plain, parts=(gear, *plain.parts[1:])), 1).truth
    (bore,) = truth.bodies["gear"].holes
    assert bore.offset_um
    (shown,) = (body for body in bodies_of(truth).bodies if body.name == "gear")
    corners = np.array([edge[:2] for edge in shown.outline.rings[1]])
    np.testing.assert_array_equal(corners, bore.ring.corners_um)


def test_surfaces_are_drawn_from_their_intervals() -> None:
    plain = world()
    gear = replace(plain.parts[0], wall_reflectance=(0.2, 0.6), finish=(0.5, 0.5))
    rough = replace(plain, parts=(gear, *plain.parts[1:]))
    drawn = [build_cell(rough, seed).truth.surfaces for seed in range(60)]
    walls = np.array([found["gear"].wall_reflectance for found in drawn])
    # of 60 uniform draws none in the lowest or highest eighth: 3e-4 each
    assert 0.2 <= walls.min() < 0.25
    assert 0.55 < walls.max() <= 0.6
    assert all(found["gear"].finish == 0.5 for found in drawn)
    assert all(found["shaft_plate"].wall_reflectance == 0 for found in drawn)
    # a stream of its own: nothing else moved
    for seed in (0, 1):
        one, other = build_cell(plain, seed).truth, build_cell(rough, seed).truth
        assert one.bodies["gear"].pose == other.bodies["gear"].pose


def test_a_world_without_surfaces_has_black_rough_ones() -> None:
    data = to_data(world())
    for part in data["parts"]:
        del part["wall_reflectance"], part["finish"]
        for post in part["posts"]:
            del post["wall_reflectance"], post["finish"]
    assert from_data(World, data) == from_data(World, to_data(world()))


def test_both_cameras_see_through_the_lens_of_the_world() -> None:
    """Each by its own road: what terms and halo change is much the same."""
    changes = []
    for camera in ("solid", "quick"):
        images = [seen_by(camera, lens) for lens in (LENS, {})]
        # black walls darken the stage beside the gear: one has more contrast
        changes.append((images[0] - images[1]) / np.ptp(images[1]))
    likeness = np.corrcoef(changes[0].ravel(), changes[1].ravel())[0, 1]
    # the quick camera has 2 % more aperture and another model of defocus
    assert likeness > 0.97
    assert changes[0].std() == pytest.approx(changes[1].std(), rel=0.1)


LENS = {"wavefront": ((7, 0.05), (8, 0.08)), "halo_radius_um": 2.5, "halo_share": 0.08}


def seen_by(camera: CameraKind, lens: dict[str, Any]) -> FloatArray:
    """Return light on pixels round the gear, 4 um out of focus, at a high zoom."""
    still = quiet(world())
    optics = replace(still.optics, **lens)
    cell = build_cell(replace(still, optics=optics), 2, (), camera=camera)
    cell.truth.bodies["gear"].pose = Pose(x_um=600.0, y_um=0.0, theta_rad=0.3)
    cell.lens.set_magnification(20.0)
    cell.lens.set_focus_um(104.0)
    window = PixelWindow(row=160, column=360, rows=110, columns=110)
    return cell.camera.pictures.image(window, LampLevel(), height_px=480, scale=1.0)
