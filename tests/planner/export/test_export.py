"""`microplan export`: what the tools that it is for read in its files."""

from __future__ import annotations

import importlib.util
import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import ezdxf.filemanagement
import jsonschema
import numpy as np
import pytest
import shapely
import tifffile
from ezdxf.entities.polyline import Polyline
from shapely.geometry import LineString, Polygon

from microplan.optics.outline.outline import flatten, place
from microplan.planner.cli.main import main
from microplan.planner.export.dxf import LAYERS
from microplan.planner.export.folder import ExportedPlan, Viewed, read_folder
from microplan.planner.export.tracks import RingTrack
from microplan.schemas.codec import from_data
from microplan.schemas.files import json_schema
from microplan.schemas.files.outlines import LookOutlines, Outlines, SegmentEdge
from microplan.schemas.plan import Look, Plan, parse_plan

Capture = pytest.CaptureFixture[str]
Change = Callable[[Any], None]

NEEDS_USEQ = pytest.mark.skipif(
    importlib.util.find_spec("useq") is None, reason="needs microplan[micromanager]"
)


@pytest.fixture(scope="module")
def plan(compiled_example: Path) -> Plan:
    return parse_plan((compiled_example / "plan.json").read_text(encoding="utf-8"))


def looks_of(plan: Plan) -> list[Look]:
    return [look for step in plan.steps for look in step.looks]


def export(plan: Path, to: str, out: Path, *more: str) -> int:
    return main(["export", str(plan), "--to", to, "-o", str(out), *more])


@pytest.fixture(scope="module")
def outlines(compiled_example: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return the example's outlines as the JSON file has them."""
    out = tmp_path_factory.mktemp("outlines") / "gear.json"
    assert export(compiled_example, "json", out) == 0
    return json.loads(out.read_text(encoding="utf-8"))


@pytest.fixture
def copy(compiled_example: Path, tmp_path: Path) -> Path:
    """Return a copy of the example's plan folder that may be spoilt."""
    return Path(shutil.copytree(compiled_example, tmp_path / "copy.plan"))


def change(file: Path, spoil: Change) -> None:
    """Change the data of a JSON file."""
    data = json.loads(file.read_text(encoding="utf-8"))
    spoil(data)
    file.write_text(json.dumps(data), encoding="utf-8")


# outlines


def test_the_json_fits_its_schema_and_its_types(outlines: Any, plan: Plan) -> None:
    jsonschema.Draft202012Validator(json_schema.load("outlines")).validate(outlines)
    found = from_data(Outlines, outlines)
    assert [look.look for look in found.looks] == [look.id for look in looks_of(plan)]
    for told, look in zip(found.looks, looks_of(plan), strict=True):
        assert told.target == look.target
        assert (told.um_per_px, told.image_sha256) == (
            look.view.um_per_px,
            look.scene.image_sha256,
        )
        region, reference = look.measure.region, look.measure.reference
        if not look.measure.feature:
            pose = reference.pose  # with the plan's six digits
            assert (told.pose.x_um, told.pose.y_um) == (pose.x_um, pose.y_um)
            assert told.pose.theta_rad == pytest.approx(pose.theta_rad, rel=1e-5)
            assert told.column_px - region.column == pytest.approx(
                reference.column, abs=1e-3
            )
            assert told.row_px - region.row == pytest.approx(reference.row, abs=1e-3)


def test_lengths_add_up(outlines: Any) -> None:
    for look in from_data(Outlines, outlines).looks:
        pieces = sum(line(look, k).length for k in range(len(look.pieces)))
        whole = pieces + look.hidden_um + look.outside_um
        # each end of a piece is within one sample of where it is counted
        most = 2 * len(look.pieces) * look.um_per_px + 1e-3 * look.length_um
        assert whole == pytest.approx(look.length_um, abs=most)


def line(look: LookOutlines, index: int) -> LineString:
    """Return a piece as many points in the target's frame."""
    points: list[tuple[float, float]] = []
    for edge in look.pieces[index].edges:
        if isinstance(edge, SegmentEdge):
            points += [edge.start_um, edge.end_um]
            continue
        for angle in edge.start_rad + np.linspace(0, 1, 257) * edge.sweep_rad:
            (x, y), r = edge.center_um, edge.radius_um
            points.append((x + r * math.cos(angle), y + r * math.sin(angle)))
    return LineString(points)


def test_polarity_is_what_the_reflectances_on_both_sides_say(
    compiled_example: Path, outlines: Any
) -> None:
    """No picture is asked: the topmost body on each side of the edge, and its share."""
    folder = read_folder(compiled_example, [])
    asked = 0
    for viewed, told in zip(
        folder.looks, from_data(Outlines, outlines).looks, strict=True
    ):
        for index, piece in enumerate(told.pieces):
            middle = line(told, index).interpolate(0.37, normalized=True)
            ahead = line(told, index).interpolate(0.371, normalized=True)
            way = np.array([ahead.x - middle.x, ahead.y - middle.y])
            out = np.array([way[1], -way[0]]) / np.hypot(*way)
            sides = [
                reflectance(
                    folder,
                    viewed,
                    told.pose.apply(middle.x + d * out[0], middle.y + d * out[1]),
                )
                for d in (0.5, -0.5)
            ]
            brighter = "dark_to_light" if sides[0] > sides[1] else "light_to_dark"
            assert piece.polarity == brighter, (told.look, index)
            assert piece.contrast <= told.light * abs(sides[0] - sides[1])
            asked += 1
    assert asked >= 10


def reflectance(
    folder: ExportedPlan, viewed: Viewed, point: tuple[float, float]
) -> float:
    """Return the reflectance of the topmost body at a point of the world."""
    world = folder.world
    known = {part.name: part.reflectance for part in world.parts}
    known |= {p.name: p.reflectance for part in world.parts for p in part.posts}
    for tool in world.tools:
        known |= dict.fromkeys(
            (f"{tool.name}.left", f"{tool.name}.right"), tool.reflectance
        )
    top, found = -math.inf, world.stage_reflectance
    for body in viewed.scene.bodies:
        outline = folder.outlines[body.name]
        placed = place(outline, body.pose.x_um, body.pose.y_um, body.pose.theta_rad)
        odd = False
        for ring in placed.rings:
            odd ^= Polygon(flatten(ring, 0.02)).contains(shapely.Point(point))
        if odd and body.z_um > top:
            top, found = body.z_um, known[body.name]
    return found


def test_a_target_has_the_same_edges_however_it_is_turned(outlines: Any) -> None:
    looks = {look.look: look for look in from_data(Outlines, outlines).looks}
    before, after = looks["find_gear"], looks["check_seated.target"]
    assert before.pose.theta_rad != after.pose.theta_rad
    assert [p.closed for p in before.pieces] == [p.closed for p in after.pieces]
    for index in range(len(before.pieces)):
        ends = line(before, index), line(after, index)
        assert ends[0].hausdorff_distance(ends[1]) < 1e-6


def test_fingers_that_reach_out_of_the_frame_are_cut_at_its_border(
    compiled_example: Path, outlines: Any
) -> None:
    looks = from_data(Outlines, outlines).looks
    fingers = next(look for look in looks if look.look == "see_fingers")
    assert [p.body for p in fingers.pieces] == ["tweezers.left", "tweezers.right"]
    assert fingers.outside_um > 0.9 * fingers.length_um
    for index, piece in enumerate(fingers.pieces):
        rows = [
            fingers.row_px - y / fingers.um_per_px
            for _, y in line(fingers, index).coords
        ]
        assert min(rows) > 0
        assert min(rows[0], rows[-1]) == pytest.approx(min(rows), abs=1e-3)
        assert not piece.closed


# DXF


def test_ezdxf_reads_every_piece_where_the_json_has_it(
    compiled_example: Path, outlines: Any, tmp_path: Path
) -> None:
    out = tmp_path / "contours"
    assert export(compiled_example, "dxf", out) == 0
    index = json.loads((out / "export.json").read_text(encoding="utf-8"))
    assert [f["look"] for f in index["files"]] == [x["look"] for x in outlines["looks"]]
    for told, look in zip(
        index["files"], from_data(Outlines, outlines).looks, strict=True
    ):
        document = ezdxf.filemanagement.readfile(out / told["file"])
        audit = document.audit()
        assert (audit.errors, audit.fixes) == ([], [])
        assert (document.dxfversion, document.units) == ("AC1009", 13)  # R12, microns
        drawn = list(document.modelspace())
        assert len(drawn) == len(look.pieces)
        for k, (entity, piece) in enumerate(zip(drawn, look.pieces, strict=True)):
            assert isinstance(entity, Polyline)
            assert entity.dxf.layer == LAYERS[piece.polarity][0]
            assert entity.is_closed == piece.closed
            corners = [(p.x, p.y) for p in entity.points()]
            if piece.closed:
                corners.append(corners[0])
            off = LineString(corners).hausdorff_distance(line(look, k))
            assert off < 0.02 * look.um_per_px + 0.002  # chords of both
            tags = [tag.value for tag in entity.get_xdata("MICROPLAN")]
            assert tags == [
                "polarity", piece.polarity,
                "contrast", pytest.approx(piece.contrast, rel=1e-8),
                "least_contrast", pytest.approx(piece.least_contrast, rel=1e-8),
                "body", piece.body,
            ]  # fmt: skip


# OME-TIFF


def test_tifffile_and_ome_types_read_the_images(
    compiled_example: Path, plan: Plan, tmp_path: Path
) -> None:
    import ome_types  # what takes long to load is not loaded by each worker

    out = tmp_path / "images"
    assert export(compiled_example, "ome-tiff", out) == 0
    index = json.loads((out / "export.json").read_text(encoding="utf-8"))
    for told, look in zip(index["files"], looks_of(plan), strict=True):
        file = out / told["file"]
        assert file.name.endswith(".ome.tiff")
        with tifffile.TiffFile(file) as read:
            page = read.pages[0]
            assert isinstance(page, tifffile.TiffPage)
            assert read.is_ome
            assert (read.series[0].axes, read.series[0].shape) == ("YX", (480, 640))
            pixels = read.asarray()
            text = read.ome_metadata
            across, per = page.tags["XResolution"].value
        assert text is not None
        shown = cv2.imread(
            str(compiled_example / look.scene.image), cv2.IMREAD_UNCHANGED
        )
        assert shown is not None
        assert pixels.dtype == np.uint8
        np.testing.assert_array_equal(pixels, shown)
        assert 1e4 * per / across == pytest.approx(look.view.um_per_px, rel=1e-6)
        found = ome_types.from_xml(text)
        (image,) = found.images
        kept = image.pixels
        assert (image.name, kept.dimension_order.value) == (look.id, "XYCZT")
        assert kept.physical_size_x == kept.physical_size_y == look.view.um_per_px
        assert kept.physical_size_x_unit.value == "\N{MICRO SIGN}m"
        assert kept.channels[0].emission_wavelength == 600
        objective = found.instruments[0].objectives[0]
        assert objective.nominal_magnification == look.view.magnification
        assert objective.lens_na == 0.42
        assert kept.planes[0].position_z == look.view.focus_um


def test_the_description_obeys_the_ome_schema_whatever_the_names(
    copy: Path, tmp_path: Path
) -> None:
    import ome_types

    def rename(data: Any) -> None:
        data["name"] = 'a<b> & "c"\x07 \N{GREEK SMALL LETTER MU}'

    change(copy / "plan.json", rename)
    out = tmp_path / "images"
    assert export(copy, "ome-tiff", out, "--look", "find_gear") == 0
    with tifffile.TiffFile(out / "find_gear.ome.tiff") as read:
        text = read.ome_metadata
    assert text is not None
    ome_types.validate_xml(text)  # against OME's own XML Schema
    annotations = ome_types.from_xml(text).structured_annotations
    assert annotations is not None
    notes = annotations.map_annotations[0].value
    assert notes["plan"] == 'a<b> & "c"\ufffd \N{GREEK SMALL LETTER MU}'


# sequences of views


@NEEDS_USEQ
@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_useq_reads_positions_and_focus_stacks(
    suffix: str, compiled_example: Path, plan: Plan, tmp_path: Path
) -> None:
    import useq

    out = tmp_path / f"looks.{suffix}"
    assert export(compiled_example, "useq", out, "--channel", "Coaxial") == 0
    found = useq.MDASequence.from_file(out)
    assert [p.name for p in found.stage_positions] == [x.id for x in looks_of(plan)]
    events = list(found)
    for number, look in enumerate(looks_of(plan)):
        mine = [e for e in events if e.index["p"] == number]
        heights = [e.z_pos for e in mine if e.z_pos is not None]
        low, high = look.measure.usable_focus_um
        assert heights == sorted(heights)
        assert heights[0] == pytest.approx(look.view.focus_um + min(low, 0.0))
        assert heights[-1] == pytest.approx(look.view.focus_um + max(high, 0.0))
        assert look.view.focus_um in heights
        assert 3 <= len(mine) <= 25
        assert {e.pos_name for e in mine} == {look.id}
        assert {e.channel.config for e in mine if e.channel} == {"Coaxial"}
        assert len({(e.x_pos, e.y_pos) for e in mine}) == 1
        nested = found.stage_positions[number].sequence
        assert nested is not None
        assert nested.metadata["microplan"]["look"] == look.id
        assert nested.metadata["microplan"]["magnification"] == look.view.magnification
    by_name = {p.name: (p.x, p.y) for p in found.stage_positions}
    assert by_name["find_gear"] == (-600.0, 0.0)  # the start, as the task states it
    assert by_name["find_shaft"] == (0.0, 0.0)  # view_um, the post at the origin


@NEEDS_USEQ
def test_a_sequence_runs_on_micro_managers_core(
    compiled_example: Path, plan: Plan, tmp_path: Path
) -> None:
    import useq
    from mm_test_adapters import device_adapter_path

    from microplan.executor.micromanager.core import LoadedDevice, close_core, open_core

    out = tmp_path / "looks.yaml"
    assert export(compiled_example, "useq", out, "--look", "find_shaft") == 0
    devices = {
        "XY": "DXYStage", "Z": "DStage", "Camera": "DCam", "Shutter": "DShutter",
    }  # fmt: skip
    core = open_core(
        [str(device_adapter_path())],
        devices=[
            LoadedDevice(label=label, adapter="DemoCamera", device=device)
            for label, device in devices.items()
        ],
    )
    try:
        core.setXYStageDevice("XY")
        core.setFocusDevice("Z")
        core.setCameraDevice("Camera")
        core.setShutterDevice("Shutter")
        core.setExposure(1.0)
        at: list[tuple[float, float, float]] = []

        def grabbed(_image: object, _event: object, _notes: object) -> None:
            x, y = core.getXYPosition()
            at.append((x, y, core.getPosition()))

        core.mda.events.frameReady.connect(grabbed)
        sequence = useq.MDASequence.from_file(out)
        core.mda.run(sequence)
    finally:
        close_core(core)
    (look,) = (x for x in looks_of(plan) if x.id == "find_shaft")
    planned = [(e.x_pos, e.y_pos, e.z_pos) for e in sequence]
    assert len(at) == len(planned) >= 3
    np.testing.assert_allclose(at, np.array(planned, dtype=float), atol=0.05)
    assert min(abs(z - look.view.focus_um) for *_, z in at) < 0.05


# what is written, and what is not


@pytest.mark.parametrize(
    ("to", "name"),
    [("json", "a.json"), ("useq", "a.yaml"), ("dxf", "a"), ("ome-tiff", "a")],
)
def test_the_same_plan_gives_the_same_bytes_and_is_not_overwritten_unasked(
    to: str, name: str, compiled_example: Path, tmp_path: Path, capsys: Capture
) -> None:
    def content(path: Path) -> dict[str, bytes]:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        return {file.name: file.read_bytes() for file in files}

    out = tmp_path / "deep" / name
    only = ("--look", "find_shaft")
    assert export(compiled_example, to, out, *only) == 0
    before = content(out)
    assert export(compiled_example, to, out, *only) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert content(out) == before
    assert export(compiled_example, to, out, *only, "--overwrite") == 0
    assert content(out) == before
    assert list(out.parent.iterdir()) == [out]  # nothing is left beside it
    for data in before.values():
        assert str(compiled_example).encode() not in data


def test_only_an_export_is_overwritten(
    compiled_example: Path, tmp_path: Path, capsys: Capture
) -> None:
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    (thesis / "chapter.txt").write_text("years", encoding="utf-8")
    more = ("--look", "find_shaft", "--overwrite")
    assert export(compiled_example, "dxf", thesis, *more) == 2
    assert "error[MP703]" in capsys.readouterr().err
    assert export(compiled_example, "json", thesis, *more) == 2
    assert "error[MP702]" in capsys.readouterr().err  # neither .json nor a file
    (tmp_path / "x.json").mkdir()
    assert export(compiled_example, "json", tmp_path / "x.json", *more) == 2
    assert "error[MP702]" in capsys.readouterr().err
    assert [p.name for p in thesis.iterdir()] == ["chapter.txt"]
    (tmp_path / "empty").mkdir()
    assert export(compiled_example, "dxf", tmp_path / "empty", *more) == 0


def test_names_of_files_are_harmless_and_differ(copy: Path, tmp_path: Path) -> None:
    names = ["../../up", "..", "UP", "up", "a b\n"]

    def rename(data: Any) -> None:
        looks = [look for step in data["steps"] for look in step["looks"]]
        for look, name in zip(looks, names, strict=False):
            look["id"] = name

    def rename_too(data: Any) -> None:
        for look, name in zip(data["looks"], names, strict=False):
            look["look"] = name

    change(copy / "plan.json", rename)
    change(copy / "scenes.json", rename_too)
    out = tmp_path / "out" / "dxf"
    only = [word for name in names for word in (f"--look={name}",)]
    assert export(copy, "dxf", out, *only) == 0
    assert sorted(p.name for p in out.iterdir()) == [
        "UP.dxf", "__.dxf", "______up.dxf", "a_b_.dxf", "export.json", "up.2.dxf",
    ]  # fmt: skip
    assert list((tmp_path / "out").iterdir()) == [out]
    for file in out.glob("*.dxf"):
        assert ezdxf.filemanagement.readfile(
            file
        ).modelspace()  # no line of a name became a tag


def test_a_look_that_is_not_there_is_told_with_those_that_are(
    compiled_example: Path, tmp_path: Path, capsys: Capture
) -> None:
    assert export(compiled_example, "json", tmp_path / "a.json", "--look", "lift") == 2
    told = capsys.readouterr().err
    assert "error[MP720]" in told
    assert "find_gear, see_fingers" in told
    assert not (tmp_path / "a.json").exists()


def test_a_plan_without_looks_and_an_infeasible_one_are_told(
    copy: Path, tmp_path: Path, capsys: Capture
) -> None:
    def refuse(data: Any) -> None:
        data["status"] = "infeasible"
        reason = {"code": "MP401", "step": "insert", "message": "out of the field"}
        data["reasons"] = [reason]

    change(copy / "plan.json", refuse)
    assert export(copy, "json", tmp_path / "a.json", "--look", "find_shaft") == 0
    told = capsys.readouterr().err
    assert "warning[MP722]" in told
    assert "out of the field" in told
    written = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert written["status"] == "infeasible"

    change(copy / "plan.json", lambda data: data.update(steps=[]))
    assert export(copy, "json", tmp_path / "b.json") == 2
    told = capsys.readouterr().err
    assert "error[MP720]" in told
    assert "out of the field" in told


def _cut(data: Any) -> None:
    data["looks"] = data["looks"][1:]


def _open(data: Any) -> None:
    data["parts"][0]["outline"]["rings"][0]["edges"].pop()


def _blind(data: Any) -> None:
    data["optics"]["wavelength_um"] = -1.0


def _aimless(data: Any) -> None:
    data["looks"][0]["target"]["bodies"] = []


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("scenes.json", lambda file: file.unlink()),
        ("world.json", lambda file: file.unlink()),
        ("images/find_gear.png", lambda file: file.unlink()),
        ("images/find_gear.png", lambda file: file.write_bytes(b"GIF89a" * 9)),
        ("images/find_gear.png", lambda f: shutil.copy(f.parent / "find_shaft.png", f)),
        ("scenes.json", lambda file: file.write_bytes(b"{" * 20)),
        ("scenes.json", lambda file: file.write_bytes(b"\xff")),
        ("scenes.json", lambda file: file.write_text('{"looks": 7}')),
        ("scenes.json", lambda file: change(file, _cut)),
        ("world.json", lambda file: change(file, _open)),
        ("world.json", lambda file: change(file, lambda d: d.update(parts=[]))),
        ("world.json", lambda file: change(file, _blind)),
        ("scenes.json", lambda file: change(file, _aimless)),
    ],
)  # fmt: skip
def test_a_folder_that_is_not_whole_is_refused(
    name: str, spoil: Callable[[Path], object], copy: Path, capsys: Capture
) -> None:
    spoil(copy / name)
    out = copy.parent / "out"
    assert export(copy, "dxf", out, "--look", "find_gear") == 2
    assert "error[MP721]" in capsys.readouterr().err
    assert not out.exists()


def test_an_image_is_looked_for_in_the_folder_alone(
    copy: Path, capsys: Capture
) -> None:
    image = copy / "images" / "find_gear.png"
    image.rename(copy.parent / "find_gear.png")

    def lead_out(data: Any) -> None:
        data["steps"][0]["looks"][0]["scene"]["image"] = "../find_gear.png"

    change(copy / "plan.json", lead_out)
    out = copy.parent / "out"
    assert export(copy, "ome-tiff", out, "--look", "find_gear") == 2
    assert "outside of the plan folder" in capsys.readouterr().err


def test_no_plan_is_a_finding(tmp_path: Path, capsys: Capture) -> None:
    assert export(tmp_path, "json", tmp_path / "a.json") == 2
    assert "error[MP704]" in capsys.readouterr().err


def test_scenes_have_the_target_where_the_plan_expects_it(
    compiled_example: Path,
) -> None:
    """The middle of a circle's ring is the reference point of the look."""
    seen = 0
    for viewed in read_folder(compiled_example, []).looks:
        target, measure = viewed.scene.target, viewed.look.measure
        if target.ring is None or measure.feature:
            continue
        folder = read_folder(compiled_example, [viewed.look.id])
        body = next(b for b in viewed.scene.bodies if b.name == target.bodies[0])
        ring = folder.outlines[body.name].rings[target.ring]
        xy = RingTrack(ring).along(np.linspace(0, 1, 401)[:-1] * 1e4)[:, :2]
        middle = body.pose.apply(*((xy.max(axis=0) + xy.min(axis=0)) / 2))
        pose = measure.reference.pose
        assert math.dist(middle, (pose.x_um, pose.y_um)) < 3.0  # a notch of the bore
        assert body.z_um == pytest.approx(measure.reference.z_um)
        seen += 1
    assert seen == 4
