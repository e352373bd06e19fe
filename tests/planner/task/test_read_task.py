"""Mistakes in task and workcell: right code, right place, all at once."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from microplan.optics.render.scene import Illumination
from microplan.planner.source.diagnostics import Report, Span, render_text
from microplan.planner.source.source import read_source
from microplan.planner.task.read_task import load_task
from microplan.planner.task.task import Task
from tests.planner.examples import change, copy_example

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "gear_on_shaft"
SCHEMAS = ROOT / "schemas"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a copy of the example that may be spoilt."""
    return Path(shutil.copytree(EXAMPLE, tmp_path / "example"))


def load(folder: Path) -> Task:
    """Return the task in `folder`, which must be free of errors."""
    report = Report()
    task = load_task(folder / "task.yaml", report)
    assert task is not None, [render_text(finding) for finding in report.found]
    return task


def codes(folder: Path) -> list[str]:
    """Return the codes of what is found, in order of place."""
    report = Report()
    load_task(folder / "task.yaml", report)
    return [finding.code for finding in report.in_order]


def edit(folder: Path, file: str, old: str, new: str) -> None:
    """Replace the first `old` in a file, which must be there."""
    text = (folder / file).read_text(encoding="utf-8")
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")


# file, what is replaced, by what with <<the place of the finding>> marked, code
NICKEL = "material: nickel"
MIRROR, BLACK = (f"{NICKEL}\n    wall: {{kind: {kind}," for kind in ("mirror", "black"))
MISTAKES = [
    ("task.yaml", "thickness_um: 100", "<<thicknes_um>>: 100", "MP104"),
    ("task.yaml", "seed: 1998", "<<sed>>: 1998", "MP104"),
    ("task.yaml", "speed_um_per_s: 20}", ("speed_um_per_s: 20, if_blocked: "
     "{back_um: 20, <<serch>>: spiral, pitch_um: 4, radius_um: 8}}"), "MP104"),
    ("task.yaml", "reflectance: 0.80", "reflectance: <<bright>>", "MP101"),
    ("task.yaml", "reflectance: 0.80", "reflectance: <<true>>", "MP101"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<NaN>>", "MP101"),
    ("task.yaml", "seed: 1998", "seed: <<19.5>>", "MP101"),
    ("task.yaml", "view_um: [0, 0]", "view_um: <<here>>", "MP101"),
    ("task.yaml", "units: um, layers: [O", "layers: [O", "MP102"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<-100>>", "MP103"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<1e9>>", "MP103"),
    ("task.yaml", "reflectance: 0.80", "reflectance: <<1.5>>", "MP103"),
    ("task.yaml", "x_um: -600", "x_um: <<1e300>>", "MP103"),
    ("task.yaml", "seed: 1998", "seed: <<-1>>", "MP103"),
    ("task.yaml", "magnification_sigma: 0.005", "magnification_sigma: <<0.2>>",
     "MP103"),
    ("task.yaml", "tolerance_xy_um: 3", "tolerance_xy_um: <<0>>", "MP103"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<.nan>>", "MP008"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<-.inf>>", "MP008"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<1e999>>", "MP008"),
    ("task.yaml", "seed: 1998", "seed: 1998\n<<seed>>: 1999", "MP004"),
    ("task.yaml", "thickness_um: 100", "thickness_um: <<&t 100>>", "MP005"),
    ("task.yaml", "name: gear-on-shaft", "name: <<*other>>", "MP005"),
    ("task.yaml", "seed: 1998", "seed: <<!!int 1998>>", "MP006"),
    ("task.yaml", "microplan: 1", "microplan: <<2>>", "MP013"),
    ("task.yaml", "do: locate, ", "do: <<find>>, ", "MP105"),
    ("task.yaml", "units: um", "units: <<micron>>", "MP105"),
    ("task.yaml", "method: auto", "method: <<no>>", "MP105"),
    ("task.yaml", "view_um: [0, 0]", "view_um: <<[0, 0, 0]>>", "MP106"),
    ("task.yaml", "id: find_gear,", "id: <<find gear>>,", "MP107"),
    ("task.yaml", "target: gear.bore", "target: <<gear.bore.rim>>", "MP107"),
    ("task.yaml", "do: locate, ", "do: locate, <<to>>: gear,", "MP109"),
    ("task.yaml", "{on: stage, x_um: 0", "{on: stage, <<z_um>>: 0, x_um: 0", "MP109"),
    ("task.yaml", "kind: notch,", "kind: notch, <<count>>: 3,", "MP109"),
    ("task.yaml", "origin: bore", "origin: <<boer>>", "MP110"),
    ("task.yaml", "hole: gear.bore", "hole: <<gaer.bore>>", "MP110"),
    ("task.yaml", "seated_on: shaft_plate", "seated_on: <<plate>>", "MP110"),
    ("task.yaml", "with: tweezers", "with: <<tweezer>>", "MP110"),
    ("task.yaml", "onto: shaft_plate.post", "onto: <<shaft_plate.pots>>", "MP110"),
    ("task.yaml", "id: lift,", "id: <<grasp>>,", "MP111"),
    ("task.yaml", "hole: gear.bore", "hole: <<gear>>", "MP112"),
    ("task.yaml", "empty: tweezers", "empty: <<gear>>", "MP112"),
    ("task.yaml", "light_gain: [0.7, 1.3]", "light_gain: <<[1.3, 0.7]>>", "MP113"),
    ("task.yaml", "z_um: -260", "z_um: <<-2600>>", "MP118"),
    ("task.yaml", "opening_um: 96", "opening_um: <<9>>", "MP118"),
    ("task.yaml", "workcell: workcell.yaml", "workcell: <<nowhere.yaml>>", "MP001"),
    ("task.yaml", "workcell: workcell.yaml", "workcell: <<parts>>", "MP001"),
    ("task.yaml", "file: parts/gear18.dxf", "file: <<parts/gear.dxf>>", "MP001"),
    ("task.yaml", "file: parts/gear18.dxf", "file: <<../gear18.dxf>>", "MP010"),
    ("task.yaml", "file: parts/gear18.dxf", "file: <</etc/passwd>>", "MP010"),
    ("task.yaml", "file: parts/gear18.dxf", 'file: <<"C:\\\\gear18.dxf">>', "MP010"),
    ("task.yaml", "file: parts/gear18.dxf", 'file: <<"a\\0b">>', "MP010"),
    ("task.yaml", "count: 18", "count: 17", "MP222"),
    ("task.yaml", "origin: bore", "origin: [1, <<bore>>]", "MP101"),
    ("task.yaml", "origin: bore", "origin: <<[1]>>", "MP106"),
    ("task.yaml", "origin: bore", "origin: <<true>>", "MP101"),
    ("task.yaml", "layers: [OUTLINE, BORE]", "layers: <<[OUTLINE, BOER]>>", "MP204"),
    ("task.yaml", "layer: POST", "layer: <<PSOT>>", "MP204"),
    ("task.yaml", "file: parts/gear18.dxf", "file: <<workcell.yaml>>", "MP201"),
    ("task.yaml", NICKEL, f"{NICKEL}\n    finish: <<-1>>", "MP103"),
    ("task.yaml", NICKEL, f"{NICKEL}\n    finish: <<[0.9, 0.1]>>", "MP113"),
    ("task.yaml", NICKEL, f"{NICKEL}\n    finish: <<[0.1]>>", "MP106"),
    ("task.yaml", NICKEL, f"{NICKEL}\n    wall: {{kind: <<shiny>>}}", "MP105"),
    ("task.yaml", NICKEL, f"{MIRROR} reflectance: <<2>>}}", "MP103"),
    ("task.yaml", NICKEL, f"{MIRROR} reflectance: [0.5, <<1.5>>]}}", "MP103"),
    ("task.yaml", NICKEL, f"{MIRROR} reflectance: <<[0.5, 0.4]>>}}", "MP113"),
    ("task.yaml", NICKEL, f"{BLACK} <<reflectance>>: 0.5}}", "MP109"),
    ("workcell.yaml", "wavelength_um", "<<wavelenght_um>>", "MP104"),
    ("workcell.yaml", "coverage: 1sigma", "coverage: <<2sigma>>", "MP105"),
    ("workcell.yaml", "0.42   ", "<<-0.42>>   ", "MP103"),
    ("workcell.yaml", "aperture: 0.42", "aperture: <<1.2>>", "MP116"),
    ("workcell.yaml", "[640, 480]", "[640, 500]", "MP116"),
    ("workcell.yaml", "distortion: 0.0 ", "distortion: <<0.6>> ", "MP103"),
    ("workcell.yaml", "min_um: -500", "min_um: 600", "MP113"),
    ("workcell.yaml", "bits: 8", "bits: <<64>>", "MP103"),
    ("workcell.yaml", "[FINGER_L, FINGER_R]", "<<[FINGER_L]>>", "MP223"),
    ("workcell.yaml", "microplan_workcell: 1", "microplan_workcell: <<7>>", "MP013"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "old", "new", "code"), MISTAKES)
def test_a_mistake_is_the_only_finding_and_points_at_its_place(
    folder: Path, file: str, old: str, new: str, code: str
) -> None:
    edit(folder, file, old, new.replace("<<", "").replace(">>", ""))
    report = Report()
    assert load_task(folder / "task.yaml", report) is None
    assert [finding.code for finding in report.found] == [code]
    where = report.found[0].where
    assert where.file == (folder / file).as_posix()
    assert where.line > 0
    if "<<" not in new:
        return
    text = (EXAMPLE / file).read_text(encoding="utf-8").replace(old, new, 1)
    before, _, rest = text.partition("<<")
    assert where.line == before.count("\n") + 1
    assert where.column == len(before) - (before.rfind("\n") + 1) + 1
    assert where.length == len(rest.partition(">>")[0])


def test_all_mistakes_of_all_files_are_found_at_once(folder: Path) -> None:
    edit(folder, "task.yaml", "seed: 1998", "seed: -1")
    edit(folder, "task.yaml", "thickness_um: 100", "thicknes_um: 100")
    edit(folder, "task.yaml", "count: 18", "count: 20")
    edit(folder, "task.yaml", "onto: shaft_plate.post", "onto: shaft_plate.pots")
    edit(folder, "task.yaml", "parts/shaft_plate.dxf", "parts/plate.dxf")
    edit(folder, "workcell.yaml", "coverage: 1sigma", "coverage: 2sigma")
    edit(folder, "workcell.yaml", "parts/tweezer_fingers.dxf", "../fingers.dxf")
    assert codes(folder) == [
        "MP103", "MP104", "MP222", "MP001", "MP110", "MP105", "MP010",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("kept", "missing"),
    [
        ("empty: tweezers", ["on", "within_um"]),  # parked is not seated
        ("within_um: 2.9", ["on"]),
        ("within_um: 2.9, height_within_um: 10, empty: tweezers", ["on"]),
        ("on: shaft_plate.post, empty: tweezers", ["within_um"]),
    ],
)
def test_a_verification_needs_a_seat(
    folder: Path, kept: str, missing: list[str]
) -> None:
    """An empty tool counts only once the part was found where it should sit."""
    whole = "on: shaft_plate.post, within_um: 2.9, height_within_um: 10"
    edit(folder, "task.yaml", f"{whole}, empty: tweezers", kept)
    report = Report()
    assert load_task(folder / "task.yaml", report) is None
    assert [(f.code, f.message) for f in report.found] == [
        ("MP102", f"key '{key}' is missing in steps[13] (verify)") for key in missing
    ]


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("  gear:\n", '  "<gear>":\n', "MP107"),  # no name
        ("  gear:\n", f"  gear{'r' * 61}:\n", "MP107"),  # one letter too long
        ("      bore: ", '      "b ore": ', "MP107"),
        ("  gear:\n", "  robot:\n", "MP117"),  # an axis group's
    ],
)
def test_a_name_that_was_refused_is_not_suggested(
    folder: Path, old: str, new: str, code: str
) -> None:
    edit(folder, "task.yaml", old, new)
    edit(folder, "task.yaml", "hole: gear.bore", "hole: geer.bore")
    report = Report()
    assert load_task(folder / "task.yaml", report) is None
    name = new.strip(' ":\n')
    assert code in {f.code for f in report.found if name in f.message}
    hints = [f.hint for f in report.found if f.code == "MP110"]
    assert hints
    assert not [hint for hint in hints if name in hint]


def test_a_reference_says_what_a_name_may_hold(folder: Path) -> None:
    edit(folder, "task.yaml", "hole: gear.bore", 'hole: "<gear>.bore"')
    report = Report()
    assert load_task(folder / "task.yaml", report) is None
    (found,) = report.found
    assert (found.code, found.where.line) == ("MP107", 34)
    assert "cannot be '<gear>.bore'" in found.message
    assert "part.feature" in found.hint
    assert "letters, digits, _ and -" in found.hint


def test_a_renamed_part_is_one_finding_that_names_every_use(folder: Path) -> None:
    edit(folder, "task.yaml", "  gear:\n", "  wheel:\n")
    edit(folder, "task.yaml", "onto: shaft_plate.post", "onto: shaft_plate.pots")
    report = Report()
    assert load_task(folder / "task.yaml", report) is None
    part, post = report.in_order
    assert (part.code, post.code) == ("MP110", "MP110")
    text = (folder / "task.yaml").read_text(encoding="utf-8").splitlines()
    named = re.compile(r"\bgear(\.bore)?[:, }]")
    start = next(k for k, line in enumerate(text) if line.startswith("start:"))
    uses = [k for k, line in enumerate(text, 1) if k > start and named.search(line)]
    assert part.where.line == uses[0]
    lines = ", ".join(str(k) for k in uses[1:])
    assert part.message == f"no part is called 'gear'; it is also used in line {lines}"
    assert "wheel" in part.hint
    assert "'shaft_plate.post'" in post.hint


def test_a_finding_reads_like_the_design(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edit(folder, "workcell.yaml", "  wavelength_um: 0.6   ", "  wavelenght_um: 0.6 #")
    monkeypatch.chdir(folder)
    report = Report()
    load_task("task.yaml", report)
    text = render_text(report.found[0]).splitlines()
    assert text[0] == "error[MP104]: unknown key 'wavelenght_um' in optics"
    assert text[1] == " --> workcell.yaml:8:3"
    assert text[3].startswith("8 |   wavelenght_um: 0.6 #")
    assert text[4] == "  |   ^^^^^^^^^^^^^ did you mean 'wavelength_um'?"


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("opening_um: 96", "opening_um: 96,5", "MP104"),
        ("view_um: [0, 0]", "view_um: [0,5, 0]", "MP106"),
    ],
)
def test_a_decimal_comma_in_a_list_is_told_as_such(
    folder: Path, old: str, new: str, code: str
) -> None:
    edit(folder, "task.yaml", old, new)
    report = Report()
    load_task(folder / "task.yaml", report)
    found = next(d for d in report.found if d.code == code)
    assert found.hint == "a comma ends an entry: decimals take a point, as in 0.5"


@pytest.mark.parametrize("file", ["task.yaml", "workcell.yaml"])
@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"", "MP011"),
        (b"# nothing yet\n\n", "MP011"),
        (b"name: 5 \xb5m\n", "MP002"),
        ("name: µ\n".encode("utf-16"), "MP002"),
        (b"a: [1, 2\n", "MP003"),
        (b"a: 1\n---\nb: 2\n", "MP007"),
        (b"a: " + b"[" * 60 + b"]" * 60, "MP009"),
        (b"#" * (1 << 20) + b"\n", "MP009"),
        (b"[a, b]: 1\n", "MP012"),
        (b"- 1\n- 2\n", "MP101"),
        (b"just text\n", "MP101"),
        (b"null\n", "MP101"),
        (b"\x00\n", "MP003"),
    ],
)
def test_a_file_that_is_none_is_refused(
    folder: Path, file: str, content: bytes, code: str
) -> None:
    (folder / file).write_bytes(content)
    assert code in codes(folder)


def test_a_task_that_is_not_there_or_a_folder_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.yaml", tmp_path):
        report = Report()
        assert load_task(path, report) is None
        assert [finding.code for finding in report.found] == ["MP001"]
        assert report.found[0].where.file == str(path)


def test_of_a_folder_its_task_is_named(folder: Path) -> None:
    report = Report()
    assert load_task(folder, report) is None
    hint = f"did you mean '{folder / 'task.yaml'}'?"
    assert [(f.code, f.hint) for f in report.found] == [("MP001", hint)]


def test_a_link_may_not_lead_out_of_the_folder(folder: Path) -> None:
    outside = folder.parent / "gear.dxf"
    (folder / "parts" / "gear18.dxf").rename(outside)
    (folder / "parts" / "gear18.dxf").symlink_to(outside)
    assert codes(folder) == ["MP010"]


def test_a_byte_order_mark_and_windows_line_ends_change_nothing(folder: Path) -> None:
    plain = load(folder)
    raw = (folder / "task.yaml").read_bytes()
    (folder / "task.yaml").write_bytes(b"\xef\xbb\xbf" + raw.replace(b"\n", b"\r\n"))
    other = load(folder)
    assert other.normalised == plain.normalised
    assert other.steps[3].where.line == plain.steps[3].where.line


def test_angles_spreads_and_units_are_converted(folder: Path) -> None:
    edit(folder, "workcell.yaml", "coverage: 1sigma  ", "coverage: 3sigma  ")
    task = load(folder)
    robot, stage = task.workcell.robot.axes, task.workcell.stage.axes
    assert robot.repeatability_xy_um == pytest.approx(0.4 / 3, rel=1e-15)
    arcsec = math.radians(23.56 / 3600)
    assert robot.repeatability_theta_rad == pytest.approx(arcsec / 3, rel=1e-15)
    assert stage.repeatability_xy_um == 1.0
    assert robot.limits["theta_rad"] == (-math.pi, math.pi)
    assert task.workcell.camera.pitch_um == 7.5
    assert task.workcell.stage.axis_tilt_sigma_rad == 0.002
    assert task.part_starts["shaft_plate"].sigma_theta_rad == math.radians(1)
    assert task.benchmark.pose_sigma_theta_rad == math.radians(5)
    gear = task.part_starts["gear"]
    assert gear.theta_any
    assert gear.sigma_theta_rad == pytest.approx(2 * math.pi / math.sqrt(12))


def test_a_range_is_a_uniform_distribution_of_that_half_width(folder: Path) -> None:
    edit(folder, "workcell.yaml", "coverage: 1sigma  ", "coverage: range  ")
    robot = load(folder).workcell.robot.axes
    assert robot.repeatability_z_um == pytest.approx(2 * 8 / math.sqrt(12), rel=1e-15)


def test_an_aperture_table_is_read(folder: Path) -> None:
    table = "[{magnification: 6.9, value: 0.2}, {magnification: 44.5, value: 0.42}]"
    edit(
        folder,
        "workcell.yaml",
        "numerical_aperture: 0.42",
        f"numerical_aperture: {table}",
    )
    optics = load(folder).workcell.optics
    assert optics.apertures == ((6.9, 0.2), (44.5, 0.42))
    # a fixed stop behind the zoom: a power of the magnification between rows
    middle = math.sqrt(6.9 * 44.5)
    assert optics.aperture(middle) == pytest.approx(math.sqrt(0.2 * 0.42))
    assert (optics.aperture(6.9), optics.aperture(100.0)) == (0.2, 0.42)


def test_the_ends_of_an_aperture_table_hold_for_zooms_beyond_it(folder: Path) -> None:
    table = "[{magnification: 10, value: 0.2}, {magnification: 20, value: 0.4}]"
    edit(
        folder,
        "workcell.yaml",
        "numerical_aperture: 0.42",
        f"numerical_aperture: {table}",
    )
    optics = load(folder).workcell.optics
    for zoom, aperture in ((6.9, 0.2), (10.0, 0.2), (20.0, 0.4), (44.5, 0.4)):
        assert optics.aperture(zoom) == pytest.approx(aperture)
        assert optics.lens.aperture_at(zoom) == pytest.approx(aperture)


def test_the_steepest_light_that_is_read_stays_light() -> None:
    task, workcell = (
        json.loads((SCHEMAS / f"{name}.schema.json").read_text())["properties"]
        for name in ("task", "workcell")
    )
    steepest = (
        task["benchmark"]["properties"]["light_gradient"]["items"]["maximum"],
        workcell["light"]["properties"]["gradient"]["maximum"],
    )
    for gradient in steepest:
        along = gradient * math.sqrt(0.5)  # to a corner of the field, where it is worst
        assert Illumination(gradient_x=along, gradient_y=along).gain == 1


def test_the_example_is_read_as_it_stands(folder: Path) -> None:
    task = load(folder)
    assert [step.verb for step in task.steps] == [
        "locate", "locate", "align", "grasp", "move", "locate", "move",
        "locate", "align", "insert", "release", "move", "verify",
    ]  # fmt: skip
    assert list(task.parts) == ["gear", "shaft_plate"]
    assert task.steps[3].tool == "tweezers"
    assert task.steps[1].move[2].to.z_um == 40
    assert task.steps[1].move[2].to.x_um is None
    assert task.workcell.tools["tweezers"].stick_probability == 0
    assert task.where["goal.success_probability"].line == 35
    assert task.steps[9].spans["speed_um_per_s"].text.count("speed_um_per_s: 20") == 1


def test_steps_that_state_what_to_do_when_blocked_are_marked(
    folder: Path,
) -> None:
    search = "if_blocked: {back_um: 20, search: spiral, pitch_um: 4, radius_um: 8}"
    change(
        folder / "task.yaml", "speed_um_per_s: 20}", f"speed_um_per_s: 20, {search}}}"
    )
    assert [step.if_blocked for step in load(folder).steps][8:11] == [
        False,
        True,
        False,
    ]


def test_the_order_of_keys_means_nothing(folder: Path) -> None:
    plain = load(folder)
    for file in ("task.yaml", "workcell.yaml"):
        path = folder / file
        source = read_source(path, file, Report(), Span(file=file))
        assert source is not None
        # JSON is YAML
        path.write_text(json.dumps(_reversed(source.data)), encoding="utf-8")
    other = load(folder)
    assert json.dumps(other.normalised) == json.dumps(plain.normalised)
    assert json.dumps(other.workcell.normalised) == json.dumps(
        plain.workcell.normalised
    )
    assert list(other.parts) == list(plain.parts)


def _reversed(data: object) -> object:
    """Return plain data with the keys of every mapping in reverse order."""
    if isinstance(data, dict):
        return {key: _reversed(data[key]) for key in reversed(list(data))}
    return [_reversed(item) for item in data] if isinstance(data, list) else data


def test_defaults_are_filled_in_before_hashing(folder: Path) -> None:
    plain = load(folder)
    edit(folder, "task.yaml", "  prefer: balanced ", "  # ")
    edit(folder, "task.yaml", "theta_deg: 0}", "theta_deg: 0.0}")
    assert load(folder).normalised == plain.normalised


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("task.yaml", "seed: 1998", "seed: 1999"),
        ("task.yaml", "layer: POST, height_um: 250", "layer: POST, height_um: 249"),
        ("parts/shaft_plate.dxf", "22.0", "21.9"),
        ("parts/gear18.dxf", "OUTLINE\n 10\n0.0", "OUTLINE\n 10\n0.0005"),
        ("workcell.yaml", "numerical_aperture: 0.42", "numerical_aperture: 0.41"),
    ],
)
def test_a_change_of_meaning_changes_what_is_hashed(
    folder: Path, file: str, old: str, new: str
) -> None:
    plain = load(folder)
    edit(folder, file, old, new)
    other = load(folder)
    assert (other.normalised, other.workcell.normalised) != (
        plain.normalised, plain.workcell.normalised,
    )  # fmt: skip


def test_reading_a_task_loads_no_imaging_library() -> None:
    code = (
        "import sys; from microplan.planner.source.diagnostics import Report;"
        "from microplan.planner.task.read_task import load_task;"
        f"assert load_task({str(EXAMPLE / 'task.yaml')!r}, Report());"
        "print([m for m in ('cv2', 'scipy', 'skimage', 'PIL') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


NO_COMMA = "write it without a comma: decimals take a point, thousands nothing"
ALONE = "write a number alone: where there is a unit, the key's name ends in it"


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ("layers: [OUTLINE, BORE]", "layers: [0, OUTLINE]", 'write it in quotes: "0"'),
        ("layers: [OUTLINE, BORE]", "layers: OUTLINE", "write [OUTLINE]"),
        ("thickness_um: 100", "thickness_um: 100um", "write 100"),
        ("thickness_um: 100", "thickness_um: '1.0e2'", "write 1.0e2"),
        ("gear, view_um: [0, 0]", "gear, view_um: [0, -1.5 um]", "write -1.5"),
        ("thickness_um: 100", "thickness_um: .5 \u00b5m", "write .5"),
        ("speed_um_per_s: 20", "speed_um_per_s: 20 s", ALONE),
        ("thickness_um: 100", "thickness_um: 99,5", NO_COMMA),
        ("thickness_um: 100", "thickness_um: '1,000.5um'", NO_COMMA),
        ("thickness_um: 100", "thickness_um: 1.2.3", ""),
        ("thickness_um: 100", "thickness_um: \uff11\uff10\uff10", ""),
        ("thickness_um: 100", "thickness_um: 0.1 mm", ALONE),
        ("success_probability: 0.95", "success_probability: 95%", ALONE),
        ("thickness_um: 100", "thickness_um: thick", ""),
        ("seed: 1998", "seed: '1998'", "write 1998"),
        ("seed: 1998", "seed: '19.5'", ""),
        ("count: 18", "count: 18 teeth", ALONE),
        ("thickness_um: 100", f"thickness_um: '1{' ' * 100_000}!'", ""),
        ("thickness_um: 100", "thickness_um: .nan", "write a number"),
    ],
)
def test_a_value_of_another_kind_is_told_how_to_be_written(
    tmp_path: Path, old: str, new: str, hint: str
) -> None:
    file = copy_example(tmp_path / "task")
    change(file, old, new)
    report = Report()
    assert load_task(file, report) is None
    assert hint in [finding.hint for finding in report.found]
