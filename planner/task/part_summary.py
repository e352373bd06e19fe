"""Summary of each part for `microplan check`: its shape, its drawing by layer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from microplan.optics.outline.outline import Outline
from microplan.planner.task.drawings import form, rows
from microplan.planner.task.regions.features import DominantCircle, dominant_circle
from microplan.planner.task.surfaces import surfaces
from microplan.planner.task.task import Part

MOST_CIRCLES = 12  # diameters that are listed for one part
MOST_PLACES = 4  # of circles of one diameter
MOST_LAYERS = 12  # of those that are not selected
MOST_KINDS = 8  # of entities, for one layer
SAME_UM = 1e-6  # centres and radii closer than this are one feature's


def parts_summary(parts: Mapping[str, Part]) -> str:
    """Return a few lines for each part, by name."""
    return "\n".join(line for name in sorted(parts) for line in part_lines(parts[name]))


def part_lines(part: Part) -> Iterator[str]:
    """Yield a part's size, what became of its drawing, and the circles found in it."""
    yield f"{part.name}: {_shape(part.outline)}, {part.thickness_um:g} um thick"
    for line in _drawing(part):
        # layers may be called anything, also what a terminal obeys
        yield "  " + "".join(c if c.isprintable() else "?" for c in line)
    found = [c for ring in part.outline.rings if (c := dominant_circle(ring))]
    lines = list(_circles(part, found))
    yield from (f"  {line}" for line in lines[:MOST_CIRCLES])
    if len(lines) > MOST_CIRCLES:
        yield f"  and circles of {_plural(len(lines) - MOST_CIRCLES, 'diameter')} more"
    for name, post in sorted(part.posts.items()):
        yield f"  post {name}: {_shape(post.outline)}, {post.height_um:g} um high"
    for name, mark in sorted(part.marks.items()):
        yield f"  mark {name}: {_shape(mark.outline)}, reflectance {mark.reflectance:g}"
    yield from (f"  {line}" for line in _regions(part))


def _regions(part: Part) -> Iterator[str]:
    """Yield the features that are rings, with their places and symmetries."""
    faces = surfaces(part)
    for name, feature in sorted(part.features.items()):
        if not feature.region:
            continue
        face = faces[feature.on].outline
        ring = feature.ring
        rings = face.rings if ring is None else (face.rings[ring],)
        x0, y0, x1, y1 = Outline(rings=rings).bounds_um
        x, y = (round(c, 6) + 0.0 for c in feature.center_um)  # no -0
        alike = {0: "round", 1: "no symmetry"}.get(
            feature.symmetry, f"{feature.symmetry}-fold"
        )
        size = f"{x1 - x0:.6g} x {y1 - y0:.6g} um about ({x:g}, {y:g})"
        on = f", on {feature.on}" if feature.on else ""
        yield f"region {name}: {size}{on}, {alike}"


def _drawing(part: Part) -> Iterator[str]:
    """Yield the file, and for each layer what was taken and what was ignored."""
    drawing = part.sheet.drawing
    yield f"from {drawing.file}, {form(drawing)}"
    table, whole = rows(part.sheet)
    rings = _rings(part)
    for row in (row for row in table if row.selected):
        became = rings.get(row.layer.lower(), "no ring of its own")
        left = f"; ignored: {_counts(row.ignored)}" if row.ignored else ""
        yield f"layer {row.layer}: {_counts(row.taken)} -> {became}{left}"
    others = [row for row in table if not row.selected]
    for row in others[:MOST_LAYERS]:
        yield f"layer {row.layer}: not selected, ignored: {_counts(row.ignored)}"
    if len(others) > MOST_LAYERS:
        yield f"and {_plural(len(others) - MOST_LAYERS, 'layer')} more, not selected"
    if not whole:
        yield "and more blocks on more layers than are counted"


def _rings(part: Part) -> dict[str, str]:
    """Return how many rings and edges came from each layer, its name in lower case."""
    found = [
        *part.outline.rings,
        *(r for p in part.posts.values() for r in p.outline.rings),
        *(r for m in part.marks.values() for r in m.outline.rings),
    ]
    count = Counter(ring.layer.lower() for ring in found)
    edges: Counter[str] = Counter()
    for ring in found:
        edges[ring.layer.lower()] += len(ring.edges)
    return {
        name: f"{_plural(count[name], 'ring')} of {_plural(edges[name], 'edge')}"
        for name in count
    }


def _counts(counts: Sequence[tuple[str, int]]) -> str:
    """Return what there is with its numbers, the first few."""
    said = [f"{n} {what}" for what, n in counts[:MOST_KINDS]]
    more = len(counts) - len(said)
    return ", ".join(said) + (f" and {more} kinds more" if more else "") or "nothing"


def _shape(outline: Outline) -> str:
    """Return the size, the area and the number of holes."""
    x0, y0, x1, y1 = outline.bounds_um
    holes = sum(ring.signed_area_um2 < 0 for ring in outline.rings)
    with_holes = f", {holes} hole{'s' if holes > 1 else ''}" if holes else ""
    return f"{x1 - x0:.6g} x {y1 - y0:.6g} um, {outline.area_um2:.6g} um2{with_holes}"


def _circles(part: Part, circles: Iterable[DominantCircle]) -> Iterator[str]:
    """Yield circles with the features that they are, alike ones together."""
    alike: dict[tuple[str, str, str], list[str]] = {}
    for circle in circles:
        x, y = (round(c, 6) + 0.0 for c in circle.center_um)  # no -0
        kind = "hole" if circle.hole else "rim"
        broken = "" if all(circle.on) else ", interrupted"
        names = _names(part, circle)
        ends = f"{broken} ({', '.join(names)})" if names else broken
        key = kind, f"{2 * circle.radius_um:.6g} um wide", ends
        alike.setdefault(key, []).append(f"({x:g}, {y:g})")
    for (kind, width, ends), places in alike.items():
        more = len(places) - MOST_PLACES
        at = f" at {', '.join(places[:MOST_PLACES])}" + (
            f" and {more} more" if more > 0 else ""
        )
        count = f"{len(places)} {kind}s" if len(places) > 1 else kind
        yield f"{count} {width}{at}{ends}"


def _names(part: Part, circle: DominantCircle) -> list[str]:
    """Return the features that a circle is."""
    return [
        name
        for name, feature in sorted(part.features.items())
        if feature.kind == "circle"
        and abs(feature.radius_um - circle.radius_um) <= SAME_UM
        and abs(feature.center_um[0] - circle.center_um[0]) <= SAME_UM
        and abs(feature.center_um[1] - circle.center_um[1]) <= SAME_UM
    ]


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
