"""A user's pictures of a look: found, refused with a reason, compared with the plan."""

from __future__ import annotations

import json
import math
import shutil
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from microplan.arrays import FloatArray
from microplan.executor.analysis.annotate import write_marked
from microplan.executor.analysis.appearance import appearance, likeness
from microplan.executor.analysis.picture_file import read_picture, size_of
from microplan.executor.analysis.picture_report import together
from microplan.executor.analysis.pictures import Finding, find_in, viewer
from microplan.executor.cli.main import main
from microplan.executor.devices.errors import ExecutorError
from microplan.executor.record.frames import INDEX
from microplan.executor.run.artifacts import Artifacts
from microplan.executor.simulated.cell import build_cell
from microplan.schemas.plan import Plan, Region, dump_plan, parse_plan
from microplan.schemas.pose import Pose
from tests.executor.bench import Folder, assembly, quiet, world

LOOK = "find_gear"
HEIGHT, WIDTH, SIDE = 480, 640, 200
PLACES = ((4.0, -7.0), (-3.0, 2.0))  # where the gear truly is, um from the axis


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a plan folder whose first look finds the gear."""
    folder = tmp_path_factory.mktemp("plans") / "gear.plan"
    maker = Folder(folder)
    plan = assembly(maker)
    maker.write(replace(plan, steps=plan.steps[:1]), world())
    return folder


@pytest.fixture(scope="module")
def frames() -> list[Any]:
    """Return frames of the gear at `PLACES`, and another of the first."""
    cell = build_cell(quiet(world()), 5)
    cell.lens.set_magnification(6.9)
    cell.lens.set_focus_um(100.0)
    found = []
    for x_um, y_um in (*PLACES, PLACES[0]):
        pose = Pose(x_um=600.0 + x_um, y_um=y_um, theta_rad=0.4)
        cell.truth.bodies["gear"].pose = pose
        found.append(cell.camera.grab().counts)
    return found


def plan_of(folder: Path) -> Plan:
    return parse_plan((folder / "plan.json").read_text("utf-8"))


def region_of(plan: Plan) -> Region:
    return plan.steps[0].looks[0].measure.region


def found_in(folder: Path, path: Path, bits: int | None = None) -> Finding:
    plan = plan_of(folder)
    seer = viewer(plan, folder, Artifacts.from_folder(plan, folder), LOOK, bits=bits)
    return find_in(seer, path)


def call(folder: Path, pictures: Path, *options: str) -> int:
    words = ["--mode", "replay", "--pictures", str(pictures), "--look", LOOK]
    return main([str(folder), *words, *options])


def png(rows: int, columns: int, body: bytes = b"") -> bytes:
    """Return a PNG file whose head promises a size."""
    chunks = []
    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    for kind, data in ((b"IHDR", head), (b"IDAT", zlib.compress(body)), (b"IEND", b"")):
        sum_ = struct.pack(">I", zlib.crc32(kind + data))
        chunks.append(struct.pack(">I", len(data)) + kind + data + sum_)
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def test_the_gear_is_found_where_it_truly_is(
    built: Path, frames: list[Any], tmp_path: Path
) -> None:
    for frame, place in zip(frames, PLACES, strict=False):
        cv2.imwrite(str(tmp_path / "a.png"), frame)
        found = found_in(built, tmp_path / "a.png")
        assert found.found, found.why
        # the bore's notch pulls the circle by some hundredths of a um; see bias_um
        assert (found.x_um, found.y_um) == pytest.approx(place, abs=0.15)
        assert [g.name for g in found.attempts[0].gates][:1] == ["score"]
        assert all(g.passed for g in found.attempts[0].gates)


def test_a_runs_frames_are_read_where_the_run_read_them(
    built: Path, frames: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of the scene lies 90 pixels off, which the run knew."""
    plan = plan_of(built)
    step, look = plan.steps[0], plan.steps[0].looks[0]
    follows = replace(look, view=replace(look.view, follows=True))
    folder = shutil.copytree(built, tmp_path / "plan")
    changed = replace(plan, steps=(replace(step, looks=(follows,)),))
    (folder / "plan.json").write_text(dump_plan(changed), "utf-8")
    pictures = tmp_path / "frames"
    pictures.mkdir()
    moved = np.roll(frames[0], (-60, 90), axis=(0, 1))
    cv2.imwrite(str(pictures / "a.png"), moved)
    region = region_of(plan)
    where = [region.row - 60, region.column + 90, region.rows, region.columns]
    index, pitch_um = pictures / INDEX, look.view.um_per_px
    asked = str(pictures), "--format", "json", "--marked", str(tmp_path / "marked")

    def found(line: dict[str, object]) -> dict[str, Any]:
        index.write_text(json.dumps(line) + "\n", "utf-8")
        call(folder, Path(asked[0]), *asked[1:])
        said: dict[str, Any] = json.loads(capsys.readouterr().out)["pictures"][0]
        return said

    line: dict[str, object] = {"file": "frames/a.png", "look": LOOK, "measured": where}
    right = found(line)
    assert right["code"] is None, right
    assert (right["x_um"], right["y_um"]) == pytest.approx(
        (PLACES[0][0] + 90 * pitch_um, PLACES[0][1] + 60 * pitch_um), abs=0.15
    )
    for wrong in (
        {**line, "look": "other"},
        {**line, "file": "frames/b.png"},
        {**line, "measured": [-60, 0, *where[2:]]},
        {**line, "measured": [1e9, where[1], *where[2:]]},
        {**line, "measured": [*where[:2], 5, 5]},
        {**line, "measured": where[:3]},
        {**line, "measured": None},
    ):
        assert found(wrong)["code"] is not None, wrong


def test_every_kind_of_picture_of_the_same_frame_says_the_same(
    built: Path, frames: list[Any], tmp_path: Path
) -> None:
    grey, region = frames[0], region_of(plan_of(built))
    rows = slice(region.row, region.row + region.rows)
    part = grey[rows, region.column : region.column + region.columns]
    deep = grey.astype(np.uint16) * 257  # 255 becomes 65535
    alpha = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGRA)
    kinds = {
        "grey.png": grey, "part.png": part, "grey.tif": grey, "deep.png": deep,
        "deep.TIFF": deep, "colour.png": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR),
        "alpha.png": alpha, "colour.tif": cv2.cvtColor(deep, cv2.COLOR_GRAY2BGR),
    }  # fmt: skip
    seen = {}
    for name, counts in kinds.items():
        assert cv2.imwrite(str(tmp_path / name), counts)
        found = found_in(built, tmp_path / name)
        assert found.found, (name, found.why)
        seen[name] = (found.x_um, found.y_um)
    first = seen["grey.png"]
    for place in seen.values():
        assert place == pytest.approx(first, abs=1e-9)  # luma's weights sum to 1


def test_colour_becomes_grey_by_the_stated_weights(built: Path, tmp_path: Path) -> None:
    plan = plan_of(built)
    pixels = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = 10, 100, 200  # blue, green, red
    cv2.imwrite(str(tmp_path / "c.png"), pixels)
    image = read_picture(tmp_path / "c.png", plan.requirements, region_of(plan)).image
    wanted = (0.299 * 200 + 0.587 * 100 + 0.114 * 10) / 255
    np.testing.assert_allclose(image, wanted, rtol=1e-12)


@pytest.mark.parametrize(
    ("most", "depth", "bits", "hint"),
    [
        (4095, np.uint16, None, "say --bits 12"),
        (900, np.uint16, None, "say --bits 10"),
        (16383, np.uint16, None, "say --bits 14"),
        (16384, np.uint16, None, ""),  # it needs more than any camera has
        (4095, np.uint16, 12, ""),
        (200, np.uint8, None, ""),
    ],
)
def test_a_shallow_picture_in_a_deep_file_is_told(
    built: Path, tmp_path: Path, most: int, depth: type, bits: int | None, hint: str
) -> None:
    plan, path = plan_of(built), tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), most, dtype=depth))
    found = read_picture(path, plan.requirements, region_of(plan), bits).hint
    assert found.endswith(hint)
    assert bool(found) == bool(hint)


def test_full_scale_of_a_16_bit_picture_is_the_cameras(
    built: Path, tmp_path: Path
) -> None:
    plan = plan_of(built)
    region, path = region_of(plan), tmp_path / "a.tif"
    twelve = replace(plan.requirements, bits=12)
    cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), 2048, dtype=np.uint16))
    assert read_picture(path, twelve, region).image[0, 0] == pytest.approx(2048 / 4095)
    assert read_picture(path, twelve, region, 16).image[0, 0] == pytest.approx(
        2048 / 65535
    )
    cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), 4096, dtype=np.uint16))
    with pytest.raises(Exception, match="full scale of 12 bits is 4095: --bits"):
        read_picture(path, twelve, region)


def spoilt(frame: Any) -> dict[str, bytes]:
    """Return files that cannot be used."""
    good = cv2.imencode(".png", frame)[1].tobytes()
    tif = cv2.imencode(".tif", frame)[1].tobytes()
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 0xFF
    return {
        "cut.png": good[: len(good) // 2],
        "flipped.png": bytes(flipped),
        "head.png": good[:20],
        "cut.tif": tif[: len(tif) // 2],
        "head.tif": b"II*\0\x08\0\0\0",
        "far.tif": b"II*\0\xff\xff\xff\xff" + bytes(64),
        "one.png": png(1, 1, b"\0\0"),
        "bomb.png": png(20000, 20000, bytes(10**6)),
        "zero.png": png(0, 0),
        "liar.png": png(HEIGHT, WIDTH, b"\0\0"),
        "note.png": b"I am no picture\n",
        "empty.png": b"",
        "picture.jpg": cv2.imencode(".jpg", frame)[1].tobytes(),
        "float.tif": cv2.imencode(".tif", frame.astype(np.float32))[1].tobytes(),
        "small.png": cv2.imencode(".png", frame[::2, ::2])[1].tobytes(),
    }


def test_a_bad_picture_does_not_end_the_rest(
    built: Path, frames: list[Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    bad = spoilt(frames[0])
    for name, data in bad.items():
        (folder / name).write_bytes(data)
    cv2.imwrite(str(folder / "zz_good.png"), frames[0])
    assert call(built, folder, "--format", "json") == 1
    said = json.loads(capfd.readouterr().out)
    codes = {p["picture"]: p["code"] for p in said["pictures"]}
    assert codes == {**dict.fromkeys(sorted(bad), "MP878"), "zz_good.png": None}
    assert said["together"]["found"]["trials"] == 1
    marked = tmp_path / f"{LOOK}.marked"
    assert [p.name for p in marked.iterdir()] == ["zz_good.png"]


def test_pixels_are_not_read_before_the_size_is_known(
    tmp_path: Path, built: Path
) -> None:
    # 400 MB if it were read: the head alone refuses it
    path, plan = tmp_path / "bomb.png", plan_of(built)
    path.write_bytes(png(20000, 20000))
    assert size_of(path.read_bytes()) == (20000, 20000)
    with pytest.raises(Exception, match="it is 20000 x 20000 px"):
        read_picture(path, plan.requirements, region_of(plan))


@pytest.mark.parametrize("value", [0, 130, 255])
def test_an_even_picture_shows_nothing_and_says_why(
    built: Path, tmp_path: Path, value: int, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), np.full((HEIGHT, WIDTH), value, dtype=np.uint8))
    assert call(built, folder) == 1
    out = capfd.readouterr().out
    assert "a.png: a target was not found [MP820]" in out
    assert "found in 0 of 1 pictures" in out


def test_a_gate_that_does_not_pass_is_told_with_value_and_limit(
    built: Path, frames: list[Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = (built / "plan.json").read_text("utf-8")
    other = tmp_path / "strict.plan"
    other.mkdir()
    for name in ("artifacts", "images"):
        if (built / name).exists():
            (other / name).symlink_to(built / name)
    plan = plan_of(built)
    shift = plan.steps[0].looks[0].measure.gates.max_shift_um
    assert f'"max_shift_um": {shift}' in text
    strict = text.replace(f'"max_shift_um": {shift}', '"max_shift_um": 1.5')
    (other / "plan.json").write_text(strict, "utf-8")
    folder = tmp_path / "mine"
    folder.mkdir()
    cv2.imwrite(str(folder / "a.png"), frames[0])
    assert call(other, folder, "--marked", str(tmp_path / "out")) == 1
    out = capfd.readouterr().out
    assert "[MP822]" in out
    assert "um from where it was expected, at most 1.5 um" in out
    assert "<= 1.5 NO" in out
    # the cross is red where the gear truly is, 4 um right and 7 um down
    marked = cv2.imread(str(tmp_path / "out" / "a.png"))
    assert marked is not None
    times = marked.shape[0] // HEIGHT
    column = round(((WIDTH - 1) / 2 + 4.0 * 6.9 / 7.5 + 0.5) * times - 0.5)
    row = round(((HEIGHT - 1) / 2 + 7.0 * 6.9 / 7.5 + 0.5) * times - 0.5)
    near = marked[row - 2 : row + 3, column - 2 : column + 3].reshape(-1, 3)
    assert any(np.array_equal(pixel, (60, 60, 255)) for pixel in near)


def test_no_folder_no_file_and_no_look_are_refused(
    built: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert call(built, tmp_path / "none") == 2
    (tmp_path / "empty").mkdir()
    assert call(built, tmp_path / "empty") == 2
    assert capfd.readouterr().err.count("error[MP878]") == 2
    words = ["--mode", "replay", "--pictures", str(tmp_path)]
    assert main([str(built), *words, "--look", "elsewhere"]) == 2
    assert "the plan has: find_gear" in capfd.readouterr().err
    assert main([str(built), *words]) == 2
    assert main([str(built), *words, "--look", LOOK, "--marked", str(tmp_path)]) == 2


def test_a_routine_that_is_not_installed_is_told(
    built: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.plan"
    other.mkdir()
    text = (built / "plan.json").read_text("utf-8")
    spoilt_text = text.replace('"id": "circle_caliper"', '"id": "crystal_ball"')
    assert spoilt_text != text
    (other / "plan.json").write_text(spoilt_text, "utf-8")
    assert call(other, tmp_path) == 3
    assert "error[MP810]" in capfd.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["--mode", "run", "--station", "sim", "--from", "x"],
        ["--mode", "replay", "--from", "x", "--pictures", "y", "--look", "z"],
        ["--mode", "replay", "--from", "x", "--look", "z"],
        ["--mode", "replay", "--from", "x", "--station", "sim"],
        ["--mode", "replay"],
        ["--mode", "compare"],
        ["--mode", "check", "--station", "sim", "--runs", "x"],
        ["--mode", "replay", "--pictures", "x", "--look", "z", "--bits", "17"],
        ["--mode", "replay", "--pictures", "x", "--look", "z", "--turn-deg", "nan"],
    ],
)
def test_a_call_that_contradicts_itself_is_wrong(
    built: Path, words: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    assert main([str(built), *words]) == 2
    assert "usage: microplan-run" in capfd.readouterr().err


def seen_at(x_um: float, y_um: float) -> Finding:
    """Return a finding as from a picture; what its chain did is left out."""
    found = Finding(name="", code=None, why="", x_um=x_um, y_um=y_um)
    return replace(found, attempts=(None,))  # type: ignore[arg-type]  # counted only


def test_scatter_is_judged_against_the_plan_where_nothing_moved(built: Path) -> None:
    plan = plan_of(built)
    seer = viewer(plan, built, Artifacts.from_folder(plan, built), LOOK)
    sigma = seer.look.sigma_xy_um
    rng = np.random.default_rng(7)
    draws = rng.standard_normal((40, 2))
    right = [seen_at(*(sigma * d)) for d in draws]
    wide = [seen_at(*(2 * sigma * d)) for d in draws]
    assert together(seer, right, still=True).refuted == ()
    assert together(seer, wide, still=True).refuted == ("scatter",)
    assert together(seer, wide).refuted == ()
    place = together(seer, right, still=True).place
    assert place is not None
    wanted = math.sqrt(float(np.var(sigma * draws, axis=0, ddof=1).mean()))
    assert place.sigma == pytest.approx(wanted, rel=1e-12)
    assert place.low < sigma < place.high


def test_too_few_found_refutes_the_promise(built: Path) -> None:
    plan = plan_of(built)
    seer = viewer(plan, built, Artifacts.from_folder(plan, built), LOOK)
    chosen = replace(seer.look.evidence.chosen, success_lower=0.9)
    evidence = replace(seer.look.evidence, chosen=chosen)
    seer.look = replace(seer.look, evidence=evidence)
    lost = replace(seen_at(0.0, 0.0), code="MP820")
    assert together(seer, [seen_at(0.0, 0.0)] * 9 + [lost]).refuted == ()
    assert together(seer, [lost] * 5 + [seen_at(0.0, 0.0)] * 5).refuted == ("found",)


def blurred(image: FloatArray, times: int) -> FloatArray:
    for _ in range(times):
        image = (image + np.roll(image, 1, 0) + np.roll(image, 1, 1)) / 3
    return image


def test_light_contrast_and_blur_are_told(frames: list[Any]) -> None:
    image = frames[0] / 255.0
    reference = appearance(image)
    same = likeness(appearance(image), reference)
    assert same.words == ()
    assert (same.brightness, same.contrast, same.sharpness) == (1.0, 1.0, 1.0)
    dark = likeness(appearance(image / 2), reference)
    assert dark.brightness == pytest.approx(0.5)
    assert dark.contrast == pytest.approx(0.5)
    assert dark.sharpness == pytest.approx(1.0)  # it is of the contrast
    assert len(dark.words) == 2
    soft = likeness(appearance(blurred(image, 12)), reference)
    assert soft.sharpness is not None
    assert soft.sharpness < 0.8
    assert any("sharpness" in word for word in soft.words)
    black = likeness(appearance(image), appearance(np.zeros((20, 20))))
    assert black.brightness is None


def test_a_name_that_leaves_no_room_says_how_long_it_may_be(tmp_path: Path) -> None:
    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    write_marked(tmp_path, "a" * 251, picture)
    with pytest.raises(ExecutorError, match="has 252 bytes; 251 leave room") as caught:
        write_marked(tmp_path, "a" * 252, picture)
    assert caught.value.code == "MP878"
