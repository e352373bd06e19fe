"""`microplan measure`: places found in pictures, gates, findings, exit statuses."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from microplan.planner.cli.main import main
from tests.planner.measure.small_look import (
    CALL,
    CHAIN,
    Counts,
    deep,
    in_frame,
    post_look,
    save,
    taken,
    task_file,
)

AT_UM = (1.3, -0.7)  # where the post is in most pictures
RADIUS_UM, PITCH_UM = 22.0, 7.5  # of the drawn post, of the camera's pixels
SIGMAS = 4.0  # of a stated standard deviation: one look of 10 000 is farther off


def measure(*words: str | Path) -> int:
    """Return the exit status of a call."""
    return main(["measure", "--task", str(task_file()), *CALL, *map(str, words)])


def found(capsys: pytest.CaptureFixture[str], *words: str | Path) -> list[Any]:
    """Return the objects that a call prints, whatever its exit status."""
    capsys.readouterr()
    measure(*words, "--json")
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def is_there(one: dict[str, Any], x_um: float, y_um: float) -> bool:
    """Return whether a place lies within what is said of it, in both axes."""
    sigma_um = math.hypot(one["repeatability_um"], one["trueness_um"])
    off_um = max(abs(one["x_um"] - x_um), abs(one["y_um"] - y_um))
    return bool(off_um <= SIGMAS * sigma_um)


@pytest.fixture(scope="module")
def region() -> Counts:
    """Return a picture of the look's region."""
    return taken(*AT_UM)


def test_a_post_is_found_within_what_is_said_of_it(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    file = save(tmp_path / "a.png", region)
    assert measure(file, "--json") == 0
    (one,) = map(json.loads, capsys.readouterr().out.splitlines())
    assert (one["name"], one["accepted"], one["theta_deg"]) == ("a.png", True, None)
    assert is_there(one, *AT_UM)
    assert 0 < one["limit_um"] <= one["repeatability_um"] < 0.02
    assert [gate["name"] for gate in one["gates"]] == ["score", "spread", "shift"]
    scope = post_look().case.microscope
    column = (scope.width_px - 1) / 2 + one["x_um"] / scope.um_per_px
    assert one["column_px"] == pytest.approx(column)


def test_a_whole_frame_is_cut_at_the_region(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [save(tmp_path / "a.png", region)]
    files.append(save(tmp_path / "b.png", in_frame(region)))
    first, second = found(capsys, *files)
    assert first == second | {"name": "a.png"}


@pytest.mark.parametrize("off_px", [0.0, 2.4])
def test_near_a_place_the_answer_moves_with_the_picture(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str], off_px: float
) -> None:
    there = save(tmp_path / "a.png", region)
    moved = save(tmp_path / "b.png", in_frame(region, down=40, right=-100))
    (one,) = found(capsys, there)
    near = f"{219.5 + off_px}px,{279.5 + off_px}px"
    (two,) = found(capsys, moved, "--near", near)
    k = post_look().case.microscope.um_per_px
    # from another start the same image is fitted anew, to a share of its noise
    within_um = 0.1 * one["repeatability_um"] + (1e-9 if off_px == 0 else 0.002)
    assert two["x_um"] - one["x_um"] == pytest.approx(-100 * k, abs=within_um)
    assert two["y_um"] - one["y_um"] == pytest.approx(-40 * k, abs=within_um)
    (three,) = found(capsys, moved, f"--near={-100 * k}um,{-40 * k}um")
    assert three["accepted"]


def test_near_pixels_a_picture_of_any_size_that_holds_the_region_will_do(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = in_frame(region, down=40, right=-100)
    part = save(tmp_path / "a.png", frame[150:400, 100:360])
    (one,) = found(capsys, part, "--near", "119.5px,129.5px")
    k = post_look().case.microscope.um_per_px
    x_um, y_um = AT_UM
    assert one["column_px"] == pytest.approx(119.5 + x_um / k, abs=0.1)
    assert one["row_px"] == pytest.approx(129.5 - y_um / k, abs=0.1)


def test_bits_and_colours_of_a_file_do_not_matter(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    tinted = np.stack([region, region, region // 2], axis=-1)
    files = [
        save(tmp_path / "a.png", region),
        save(tmp_path / "b.tif", deep(region)),
        save(tmp_path / "c.png", deep(region)),
        save(tmp_path / "d.png", tinted),
    ]
    first, *others = found(capsys, *files)
    assert all(one["accepted"] for one in others)
    for one in others:
        assert is_there(one, first["x_um"], first["y_um"])
    assert measure(*files) == 0
    assert capsys.readouterr().out.count("as grey") == 1


def test_pages_are_measured_one_by_one_past_an_unusable_one(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = np.stack([region, np.zeros_like(region), taken(*AT_UM, seed=4)])
    file = save(tmp_path / "a.tif", pages)
    assert measure(file) == 2
    said = capsys.readouterr()
    assert [line.split(":")[0] for line in said.out.splitlines()[:2]] == [
        "a.tif[0]", "a.tif[2]",
    ]  # fmt: skip
    assert "2 of 2 accepted; their places vary by" in said.out
    assert "a.tif[1]: its region is all black" in said.err


def test_every_unusable_picture_is_told_and_the_others_are_measured(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    save(tmp_path / "good.png", region)
    save(tmp_path / "size.png", region[1:])
    save(tmp_path / "black.png", np.zeros_like(region))
    (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    assert measure(tmp_path, tmp_path / "nowhere.png") == 2
    said = capsys.readouterr()
    assert said.err.count("error[MP901]") == 4
    assert said.out.startswith("good.png: shaft_plate.post at ")
    for words in ("it is 92 x 91 px", "all black", "no PNG or TIFF", "No such file"):
        assert words in said.err


def test_counts_above_full_scale_are_refused(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    assert measure(save(tmp_path / "a.png", region), "--bits", "6") == 2
    assert "full scale is 63" in capsys.readouterr().err


def test_copies_and_saturated_pictures_are_measured_with_a_warning(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    bright = np.minimum(region.astype(int) * 3, 255).astype(np.uint8)
    save(tmp_path / "a.png", region)
    save(tmp_path / "b.png", region)
    save(tmp_path / "c.png", bright)
    measure(tmp_path)
    said = capsys.readouterr()
    assert "b.png has exactly the pixels of a.png" in said.err
    share = np.mean(bright == 255)
    assert f"c.png: {100 * share:.0f} % of its region is at full scale" in said.err
    assert [line[:5] for line in said.out.splitlines()[:3]] == [
        "a.png", "b.png", "c.png",
    ]  # fmt: skip


def test_a_picture_without_the_part_is_refused(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(1)
    ground = rng.normal(40, 3, region.shape).astype(np.uint8)
    assert measure(save(tmp_path / "a.png", ground)) == 1
    line = capsys.readouterr().out.splitlines()[0]
    assert "not found" in line or "refused: " in line


def test_a_part_farther_off_than_it_may_be_is_refused_by_its_gate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far = save(tmp_path / "a.png", taken(15.0, 0.0))
    assert measure(far, "--chain", "otsu") == 1
    line = capsys.readouterr().out.splitlines()[0]
    assert "; refused: shift 15.1 um, at most 13.5 um" in line
    (one,) = found(capsys, far, "--chain", "otsu")
    assert [gate["passed"] for gate in one["gates"]] == [True, True, False]
    frame = save(tmp_path / "b.png", in_frame(taken(15.0, 0.0)))
    assert measure(frame, "--chain", "otsu", "--near=15um,0um") == 0


def test_a_place_near_the_rim_is_told(
    tmp_path: Path, region: Counts, capsys: pytest.CaptureFixture[str]
) -> None:
    file = save(tmp_path / "a.png", in_frame(region))
    assert measure(file, "--near", "12px,240px") == 2
    assert "46 px or more from the left rim" in capsys.readouterr().err


def test_an_unknown_routine_is_told_before_anything_is_read(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert measure("nowhere.png", "--chain", "otsu,likelyhood") == 2
    said = capsys.readouterr().err
    assert "error[MP902]: no routine 'likelyhood'" in said
    assert "nowhere" not in said


def test_a_disc_drawn_by_hand_is_found_where_it_was_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # a raster of its own: points of light on a grid 16 times finer, a Gaussian for the
    # lens, means over pixels; its radius and pitch are those of the drawing
    window, scope = post_look().case.window, post_look().case.microscope
    fine, um_per_px = 16, PITCH_UM / scope.magnification
    row, column = np.mgrid[: window.rows * fine, : window.columns * fine]
    x_um = ((column + 0.5) / fine - 0.5 + window.column - 319.5) * um_per_px
    y_um = -((row + 0.5) / fine - 0.5 + window.row - 239.5) * um_per_px
    disc = np.hypot(x_um - 2.21, y_um + 3.37) <= RADIUS_UM
    light = gaussian_filter(0.15 + 0.5 * disc, 0.6 / um_per_px * fine)
    pixels = light.reshape(window.rows, fine, window.columns, fine).mean(axis=(1, 3))
    noise = np.random.default_rng(2).normal(0, 2.0, pixels.shape)
    file = save(tmp_path / "a.png", np.rint(255 * pixels + noise).astype(np.uint8))
    for chain in (",".join(CHAIN), "otsu,circle_caliper"):
        (one,) = found(capsys, file, "--chain", chain)
        assert one["x_um"] == pytest.approx(2.21, abs=0.1), chain
        assert one["y_um"] == pytest.approx(-3.37, abs=0.1), chain
