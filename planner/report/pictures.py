"""The image of a look with its overlays; images of its trials."""

from __future__ import annotations

from collections.abc import Iterator

from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.outlines import CameraFrame, body, feature
from microplan.schemas.files.evidence import LookEvidence, Shown
from microplan.schemas.files.world import World
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import number, signed, um
from microplan.schemas.page.page import Caption, figure, png_size, png_uri
from microplan.schemas.plan import Look

_MODES = (
    ("image, marked", "as-marked"),
    ("image", "as-image"),
    ("drawing", "as-drawing"),
    ("flicker", "as-flicker"),
)
_ROOM = 0.12  # of the region, shown around it in the enlarged picture


def place_id(look: Look, name: str) -> str:
    """Return the id of a thing's position in a look's picture."""
    return slug("at", look.id, name)


def image_id(look: Look) -> str:
    """Return the id of a look's image."""
    return slug("image", look.id)


def marked(folder: ReportedPlan, look: Look) -> set[str]:
    """Return the names of what has a position in a look's picture."""
    evidence, world = folder.evidence.get(look.id), folder.world
    if look.scene.image not in folder.pictures or evidence is None:
        return set()
    found = {f"={mark.name}" for mark in evidence.features}
    if world is not None:
        names = [layer.name for layer in look.scene.layers]
        found |= {n for n in names if body(world, evidence, n) is not None}
    return found


def look_picture(folder: ReportedPlan, look: Look) -> Element:
    """Return the figure of a look: image, drawing, and a flicker between them."""
    data = folder.pictures.get(look.scene.image)
    caption = Caption(
        title=f"What the camera should see: {look.target}",
        shows=f"The image predicted for the look at {number(look.view.magnification)} "
        "times, the whole frame and its search region enlarged, with what is measured, "
        "the region searched and what stands in the light drawn in.",
        judge="Good: the solid lines lie on visible edges, and drawing and image "
        "flicker "
        "in place; bad: an edge that is measured is blurred away or behind a dotted "
        "body.",
        do="If the part on your screen looks different from this, stop and compare "
        "light, "
        "focus and side of the part before running the plan.",
    )
    if data is None:
        foreign = look.scene.image in folder.foreign
        why = "not the image that this plan is of" if foreign else "not in the folder"
        missing = el(
            "p", f"{look.scene.image} is {why}.", class_="bad" if foreign else "note"
        )
        return figure(caption, missing)
    width, height = png_size(data)
    name = slug("view", look.id)
    modes = [
        part
        for k, (words, kind) in enumerate(_MODES)
        for part in (
            el("input", type="radio", name=name, id=f"{name}.{k}", class_=kind,
               checked=k == 0),
            el("label", words, for_=f"{name}.{k}"),
        )
    ]  # fmt: skip
    pane = el(
        "div",
        el("div", _whole(folder, look, data, (width, height)), class_="shot"),
        el("div", _enlarged(folder, look), class_="shot"),
        class_="pane",
    )
    views = el(
        "fieldset", el("legend", f"Show {look.id} as"), modes, pane, class_="views"
    )
    return figure(caption, views, _key(look))


def _whole(
    folder: ReportedPlan, look: Look, data: bytes, size: tuple[int, int]
) -> Element:
    """Return the whole frame with drawing and marks."""
    frame = CameraFrame.of(folder.plan, look)
    picture = el("image", id=image_id(look), href=png_uri(data), x=-0.5, y=-0.5,
                 width=size[0], height=size[1])  # fmt: skip
    words = (
        f"Predicted image of {look.target} in the look {look.id}, {size[0]} by "
        f"{size[1]} pixels, {um(look.view.field_um[0])} wide"
    )
    return el(
        "svg", el("title", words), picture, _layers(folder, look, frame, ids=True),
        viewBox=frame.box, role="img", aria_label=words,
    )  # fmt: skip


def _enlarged(folder: ReportedPlan, look: Look) -> Element:
    """Return the region of the look, enlarged."""
    region, frame = look.measure.region, CameraFrame.of(folder.plan, look)
    shape = frame.width_px / frame.height_px  # both pictures are equally high
    tall = (1 + 2 * _ROOM) * max(region.rows, region.columns / shape)
    wide = tall * shape
    x = region.column - 0.5 + (region.columns - wide) / 2
    y = region.row - 0.5 + (region.rows - tall) / 2
    box = f"{x:.5g} {y:.5g} {wide:.5g} {tall:.5g}"
    words = f"The search region of {look.id}, enlarged"
    return el(
        "svg", el("title", words),
        el("use", href=f"#{image_id(look)}", class_="pixels"),
        _layers(folder, look, frame, ids=False),
        viewBox=box, role="img", aria_label=words,
    )  # fmt: skip


def _layers(folder: ReportedPlan, look: Look, frame: CameraFrame, *, ids: bool) -> Node:
    """Return drawing and marks over an image; one of both panes has the ids."""
    evidence, world = folder.evidence.get(look.id), folder.world
    drawn = None
    if evidence is not None and world is not None:
        drawn = _drawing(look, world, evidence, frame)
    marks = el("g", [*_marks(look, world, evidence, frame, ids=ids)], class_="marks")
    return [drawn, marks]


def _drawing(
    look: Look, world: World, evidence: LookEvidence, frame: CameraFrame
) -> Element:
    """Return the scene as drawn: flat faces, as bright as they should be."""
    bodies = [
        body(
            world, evidence, layer.name, fill=_grey(layer.reflectance * look.view.light)
        )
        for layer in look.scene.layers
    ]
    ground = el("rect", x=-0.5, y=-0.5, width=frame.width_px, height=frame.height_px,
                fill=_grey(world.stage_reflectance * look.view.light))  # fmt: skip
    return el("g", ground, el("g", bodies, transform=frame.from_world), class_="drawn")


def _grey(level: float) -> str:
    value = round(255 * min(max(level, 0.0), 1.0))
    return f"#{value:02x}{value:02x}{value:02x}"


def _marks(
    look: Look,
    world: World | None,
    evidence: LookEvidence | None,
    frame: CameraFrame,
    *,
    ids: bool,
) -> Iterator[Element]:
    """Yield what is marked: bodies, features, the region, and how far is searched."""
    over = {shade.by for shade in look.scene.shades}
    if evidence is not None and world is not None:
        for layer in look.scene.layers:
            kind = "occluder" if layer.name in over else "where"
            shape = body(world, evidence, layer.name)
            if shape is not None:
                yield _lined(frame, [shape], kind, _named(ids, look, layer.name))
    for mark in () if evidence is None else evidence.features:
        shapes = [*feature(world, evidence, mark)] if evidence is not None else []
        yield _lined(frame, shapes, "feature", _named(ids, look, f"={mark.name}"))
    for k, measure in enumerate(look.measures):
        region = measure.region
        name = _named(ids, look, f"region {k}")
        box = el("rect", x=region.column - 0.5, y=region.row - 0.5,
                 width=region.columns, height=region.rows)  # fmt: skip
        yield _both([box], "region", name)


def _named(ids: bool, look: Look, name: str) -> str | None:  # noqa: FBT001 - a pane's
    """Return the id of a mark, None in the pane that has none."""
    return place_id(look, name) if ids else None


def _lined(
    frame: CameraFrame, shapes: list[Element], kind: str, name: str | None
) -> Element:
    """Return shapes of the world as lines that show on any image."""
    return _both([el("g", shapes, transform=frame.from_world)], kind, name)


def _both(shapes: list[Element], kind: str, name: str | None) -> Element:
    """Return lines on a dark casing, so that they show on bright and dark."""
    cased = None if kind == "where" else el("g", shapes, class_="case")
    return el("g", cased, el("g", shapes, class_=kind), id=name)


def _key(look: Look) -> Element:
    """Return what the lines mean."""
    over = any(shade.hidden or shade.shaded for shade in look.scene.shades)
    rows = [("feature", "measured"), ("region", "search region")]
    rows += [("occluder", "hides or shades the target")] if over else []
    return el("ul", [el("li", _swatch(kind), words) for kind, words in rows],
              class_="key")  # fmt: skip


def _swatch(kind: str) -> Element:
    line = el("path", d="M2 7H26", class_=kind)
    return el("svg", el("g", line, class_="marks"), viewBox="0 0 28 14",
              aria_hidden="true")  # fmt: skip


def trial_pictures(folder: ReportedPlan, look: Look) -> Iterator[Element]:
    """Yield the figures of the ends of the usable range and of the worst trial."""
    evidence = folder.evidence.get(look.id)
    if evidence is None:
        return
    kept = [shown for shown in evidence.shown if shown.image in folder.pictures]
    ends = [shown for shown in kept if shown.what != "worst"]
    worst = [shown for shown in kept if shown.what == "worst"]
    if ends:
        yield figure(
            Caption(
                title="At the ends of the usable range",
                shows="The search region as the trials saw it at the last error of "
                "focus "
                "or magnification at which every draw was still measured within the "
                "tolerance.",
                judge="Good: you would not expect to find the target in a picture "
                "worse "
                "than these; bad: they look sharp, and the range ends near zero.",
                do=_range_advice(look),
            ),
            el("div", [_end(folder, look, shown) for shown in ends], class_="strip"),
        )
    for shown in worst:
        index = int(shown.value)
        trial = next((t for t in evidence.trials if t.trial == index), None)
        off = "" if trial is None else (
            f": focus off by {signed(trial.focus_um)} \u00b5m, magnification "
            f"{number(trial.magnification, 4)} of nominal, error {um(trial.error_um)}"
        )  # fmt: skip
        yield figure(
            Caption(
                title=f"The worst trial, number {index}",
                shows=f"The trial whose answer was furthest off{off}.",
                judge="Good: a picture so poor that nobody would trust it; bad: one "
                      "that "
                "looks like the others.",
                do=[_render(look, index), " makes it again at full depth."],
            ),
            el("div", _tile(folder, look, shown, f"worst trial of {look.id}"),
               class_="strip"),
        )  # fmt: skip


def _render(look: Look, trial: int) -> list[Node]:
    """Return the command that makes the image of a trial, no option of it broken."""
    pieces = ("microplan render TASK", f"--step {look.id.partition('.')[0]}",
              f"--trial {trial}", "-o worst.png")  # fmt: skip
    found: list[Node] = []
    for piece in pieces:
        kind = None if piece.startswith("--step") else "whole"  # names may be long
        found += [" " if found else None, el("code", piece, class_=kind)]
    return found


def _range_advice(look: Look) -> str:
    """Return what to do about the narrower end of the focus range."""
    low, high = look.measure.usable_focus_um
    return (
        f"Keep the focus within {signed(low)} to {signed(high)} \u00b5m of nominal for "
        "this look, the zoom at nominal, or refocus before it."
    )


def _end(folder: ReportedPlan, look: Look, shown: Shown) -> Element:
    """Return the picture at one end with its name."""
    if shown.what == "focus":
        words = f"focus {signed(shown.value)} \u00b5m"
    else:
        words = f"magnification \u00d7 {number(shown.value, 4)}"
    return el("div", _tile(folder, look, shown, words), el("p", words))


def _tile(folder: ReportedPlan, look: Look, shown: Shown, words: str) -> Element:
    """Return one small picture."""
    data = folder.pictures[shown.image]
    width, height = png_size(data)
    return el("img", src=png_uri(data), width=width, height=height, class_="pixels",
              alt=f"Search region of {look.id}: {words}")  # fmt: skip
