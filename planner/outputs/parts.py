"""What `microplan check` says of each part: size, area, holes, circles, layers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

from optics.outline import Outline
from planner.inputs.features import Circle, dominant_circle
from planner.inputs.task import Part

MOST_CIRCLES = 12  # that are listed for one part
SAME_UM = 1e-6  # centres and radii closer than this are one feature's


def parts_summary(parts: Mapping[str, Part]) -> str:
    """Return a few lines for each part, by name."""
    return "\n".join(line for name in sorted(parts) for line in part_lines(parts[name]))


def part_lines(part: Part) -> Iterator[str]:
    """Yield a part's size, what it consists of, and the circles found in it."""
    yield f"{part.name}: {_shape(part.outline)}, {part.thickness_um:g} um thick"
    for name, count in _layers(part.outline):
        yield f"  layer {name or '(none)'}: {count}"
    found = [c for ring in part.outline.rings if (c := dominant_circle(ring))]
    for circle in found[:MOST_CIRCLES]:
        yield f"  {_circle(part, circle)}"
    if len(found) > MOST_CIRCLES:
        yield f"  and {len(found) - MOST_CIRCLES} circles more"
    for name, post in sorted(part.posts.items()):
        yield f"  post {name}: {_shape(post.outline)}, {post.height_um:g} um high"


def _shape(outline: Outline) -> str:
    """Return the size, the area and the number of holes."""
    x0, y0, x1, y1 = outline.bounds_um
    holes = len(outline.rings) - 1
    with_holes = f", {holes} hole{'s' if holes > 1 else ''}" if holes else ""
    return f"{x1 - x0:.6g} x {y1 - y0:.6g} um, {outline.area_um2:.6g} um2{with_holes}"


def _layers(outline: Outline) -> Iterator[tuple[str, str]]:
    """Yield each layer with its rings and edges."""
    rings = Counter(ring.layer for ring in outline.rings)
    edges: Counter[str] = Counter()
    for ring in outline.rings:
        edges[ring.layer] += len(ring.edges)
    for name in sorted(rings):
        yield name, f"{_plural(rings[name], 'ring')} of {_plural(edges[name], 'edge')}"


def _circle(part: Part, circle: Circle) -> str:
    """Return a circle with the features that it is."""
    names = [
        name
        for name, feature in sorted(part.features.items())
        if feature.kind == "circle"
        and abs(feature.radius_um - circle.radius_um) <= SAME_UM
        and abs(feature.center_um[0] - circle.center_um[0]) <= SAME_UM
        and abs(feature.center_um[1] - circle.center_um[1]) <= SAME_UM
    ]
    x, y = (round(c, 6) + 0.0 for c in circle.center_um)  # no -0
    kind = "hole" if circle.hole else "rim"
    broken = "" if all(circle.on) else ", interrupted"
    said = f" ({', '.join(names)})" if names else ""
    return f"{kind} {2 * circle.radius_um:.6g} um wide at ({x:g}, {y:g}){broken}{said}"


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
