"""Pictures of files: bits, colours, pages, and what is no picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from microplan.planner.measure.picture_files import (
    PictureCounts,
    PictureError,
    files_of,
    pages_of,
)
from tests.planner.measure.small_look import save

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4)


def any_size(_rows: int, _columns: int) -> None:
    """Take every size."""


def read(file: Path) -> list[PictureCounts]:
    """Return the pictures of a file, none of them unusable."""
    found = list(pages_of(file, any_size))
    pages = [page for page in found if isinstance(page, PictureCounts)]
    assert len(pages) == len(found)
    return pages


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("factor", [1, 257])
def test_counts_are_those_of_the_file(tmp_path: Path, suffix: str, factor: int) -> None:
    kind = np.uint8 if factor == 1 else np.uint16
    (page,) = read(save(tmp_path / f"a{suffix}", (GREY * kind(factor)).astype(kind)))
    assert (page.name, page.is_colour) == (f"a{suffix}", False)
    assert page.file_bits == (8 if factor == 1 else 16)
    np.testing.assert_array_equal(page.counts, factor * GREY.astype(float))


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_colours_become_their_luminance(tmp_path: Path, suffix: str) -> None:
    colours = np.stack([GREY * 20, GREY * 10, GREY], axis=-1).astype(np.uint8)
    (page,) = read(save(tmp_path / f"a{suffix}", colours))
    assert page.is_colour
    grey = GREY * (20 * 0.2125 + 10 * 0.7154 + 0.0721)  # ITU-R BT.709
    np.testing.assert_allclose(page.counts, grey, atol=0.5)  # whole counts


def test_grey_saved_as_colours_is_no_colour(tmp_path: Path) -> None:
    (page,) = read(save(tmp_path / "a.png", np.stack([GREY] * 3, axis=-1)))
    assert not page.is_colour
    np.testing.assert_array_equal(page.counts, GREY)


def test_each_page_is_a_picture_numbered_from_0(tmp_path: Path) -> None:
    pages = read(save(tmp_path / "a.tif", np.stack([GREY, GREY + 1])))
    assert [page.name for page in pages] == ["a.tif[0]", "a.tif[1]"]
    np.testing.assert_array_equal(pages[1].counts, GREY + 1.0)


def test_pages_packed_by_lzw_are_read(tmp_path: Path) -> None:
    file, pages = tmp_path / "packed.tif", np.arange(2 * 6 * 8).reshape(2, 6, 8) * 500
    first, second = (Image.fromarray(page.astype(np.uint16)) for page in pages)
    first.save(file, compression="tiff_lzw", save_all=True, append_images=[second])
    found = read(file)
    assert [each.file_bits for each in found] == [16, 16]
    np.testing.assert_array_equal([each.counts for each in found], pages)


def test_damage_to_a_packed_page_is_told(tmp_path: Path) -> None:
    file, rng = tmp_path / "packed.tif", np.random.default_rng(3)
    pixels = rng.integers(0, 255, (60, 80)).astype(np.uint8)
    Image.fromarray(pixels).save(file, compression="tiff_lzw")
    whole = file.read_bytes()
    file.write_bytes(whole[:200] + 400 * b"\xff" + whole[600:])
    (found,) = pages_of(file, any_size)
    assert isinstance(found, PictureError)
    assert "packed.tif cannot be read" in str(found)


def test_files_of_a_folder_come_by_name_without_hidden_ones(tmp_path: Path) -> None:
    for name in ("b.png", "a.png", ".c.png"):
        save(tmp_path / name, GREY)
    (tmp_path / "d").mkdir()
    assert files_of([tmp_path]) == [tmp_path / "a.png", tmp_path / "b.png"]


def test_what_is_no_picture_is_told_without_decoding(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no picture", encoding="utf-8")
    (tmp_path / "b").mkdir()
    found = files_of([tmp_path / "a.png", tmp_path / "b", tmp_path / "c.png"])
    words = [str(each) for each in found if isinstance(each, PictureError)]
    assert "no PNG or TIFF" in words[0]
    assert "no file" in words[1]
    assert "No such file" in words[2]


def test_pixels_of_a_size_that_is_refused_are_not_decoded(tmp_path: Path) -> None:
    whole = save(tmp_path / "a.png", GREY).read_bytes()
    (tmp_path / "a.png").write_bytes(whole[:40])  # its head alone
    (found,) = pages_of(tmp_path / "a.png", lambda r, c: (f"{c} x {r}", "another"))
    assert isinstance(found, PictureError)
    assert (str(found), found.hint) == ("a.png: 4 x 3", "another")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_file_cut_short_is_unusable(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (64, 64)).astype(np.uint8)
    file = save(tmp_path / f"a{suffix}", noise)
    file.write_bytes(file.read_bytes()[:2000])
    (found,) = pages_of(file, any_size)
    assert isinstance(found, PictureError)


@pytest.mark.parametrize("kind", [np.float32, np.int16, np.uint32])
def test_other_kinds_of_pixels_are_refused(
    tmp_path: Path, kind: type[np.generic]
) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY.astype(kind), photometric="minisblack")
    (found,) = pages_of(tmp_path / "a.tif", any_size)
    assert isinstance(found, PictureError)
    assert np.dtype(kind).name in str(found)


def test_white_as_0_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", GREY, photometric="miniswhite")
    (found,) = pages_of(tmp_path / "a.tif", any_size)
    assert isinstance(found, PictureError)
    assert "MINISWHITE" in str(found)
