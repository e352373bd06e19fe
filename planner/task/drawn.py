"""A part's outline as an SVG picture: arcs as arcs, um as units, y up.

References
----------
W3C (2018), Scalable Vector Graphics 2, 9.3: path data.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import escape

from microplan.arrays import Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring
from microplan.planner.store.folder import not_written, replace_alike
from microplan.planner.task.regions.features import dominant_circle
from microplan.planner.task.task import Part

_SVG = "http://www.w3.org/2000/svg"
SIDE_PX = 720.0  # of the longer side of the drawing
_MARGIN = 0.08  # of the longer side
_ROW = 1.3  # from one line of the legend to the next, in letters
_MOST_ROWS = 24  # of the legend
_MOST_DIAMETERS = 6  # of circles about one middle, in one line of it
_BAR = 0.3  # of the width, that the scale bar takes at most
_STYLE = (
    "text{font-family:sans-serif;fill:#222}"
    ".part{fill:#d8e2ee;stroke:#1f3a5f}.post{fill:#f3d9a4;stroke:#7a5200}"
    ".flat{fill:#cfe3c8;stroke:#2c5a1e}"
    ".number{paint-order:stroke;stroke:#fff;stroke-width:.25em}"
    ".mark{stroke:#a11;fill:none}.bar{stroke:#222}rect{fill:#fff}"
)


def write_drawings(parts: Mapping[str, Part], folder: Path) -> str:
    """Write a picture of every part, and return where they are.

    Raises
    ------
    OutputError
        MP702 if one cannot be written, MP703 if another file has its name.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(folder, error) from error
    for name, part in parts.items():
        data = svg(part).encode()
        replace_alike(folder / f"{name}.svg", data, head=data.index(b"viewBox"))
    return f"drawings: {', '.join(str(folder / f'{n}.svg') for n in sorted(parts))}"


def svg(part: Part) -> str:
    """Return a picture of a part and its posts, with a legend of circles' diameters."""
    x0, y0, x1, y1 = part.outline.bounds_um
    longer = max(x1 - x0, y1 - y0)
    margin, line = _MARGIN * longer, longer / 500
    letter = margin / 2.2
    marks, rows = _marks(part, margin / 4)
    left, top = x0 - margin, -y1 - margin
    width = x1 - x0 + 2 * margin
    height = y1 - y0 + 2.5 * margin + len(rows) * _ROW * letter
    scale = SIDE_PX / max(width, height)
    box = f"{left:.6g} {top:.6g} {width:.6g} {height:.6g}"
    size = f'width="{width * scale:.0f}" height="{height * scale:.0f}"'
    title = escape(f"{part.name}: {x1 - x0:.6g} x {y1 - y0:.6g} um")
    legend = [
        f'<text class="row" x="{x0:.6g}" y="{margin - y0 + k * _ROW * letter:.6g}">'
        f"{row}</text>"
        for k, row in enumerate(rows, 1)
    ]
    return "\n".join(
        [
            f'<svg xmlns="{_SVG}" viewBox="{box}" {size} role="img">',
            f"<title>{title}</title><style>{_STYLE}</style>",
            f'<rect x="{left:.6g}" y="{top:.6g}" width="100%" height="100%"/>',
            f'<g stroke-width="{line:.4g}" font-size="{letter:.4g}">',
            _path(part.outline, "part"),
            *(_path(mark.outline, "flat") for _, mark in sorted(part.marks.items())),
            *(_path(post.outline, "post") for _, post in sorted(part.posts.items())),
            *marks,
            _bar((x0, y0), width, margin),
            *legend,
            "</g></svg>\n",
        ]
    )


def _path(outline: Outline, name: str) -> str:
    """Return an outline as one filled path."""
    data = " ".join(_ring(ring) for ring in outline.rings)
    return f'<path class="{name}" fill-rule="evenodd" d="{data}"/>'


def _ring(ring: Ring) -> str:
    """Return a closed ring as path data."""
    x, y = ring.edges[0].start
    return " ".join([f"M{x:.8g} {-y:.8g}", *map(_edge, ring.edges), "Z"])


def _edge(edge: Edge) -> str:
    """Return an edge as path data; one of more than pi as two arcs."""
    if not isinstance(edge, Arc):
        return f"L{edge.end[0]:.8g} {-edge.end[1]:.8g}"
    turns = max(1, math.ceil(abs(edge.sweep_rad) / math.pi - 1e-9))
    side = int(edge.sweep_rad < 0)  # y points down in SVG
    ends = (edge.at((k + 1) / turns) for k in range(turns))
    radius = f"{edge.radius_um:.8g}"
    return " ".join(f"A{radius} {radius} 0 0 {side} {x:.8g} {-y:.8g}" for x, y in ends)


def _marks(part: Part, size: float) -> tuple[list[str], list[str]]:
    """Return a numbered cross at every circle's middle, and what the numbers mean.

    Circles about one middle share a cross; crosses of the same diameters a number.
    """
    about: dict[Point, list[str]] = {}
    for ring in part.outline.rings:
        if found := dominant_circle(ring):
            x, y = (round(c, 6) + 0.0 for c in found.center_um)
            about.setdefault((x, -y), []).append(f"{2 * found.radius_um:.6g}")
    numbers: dict[str, int] = {}
    marks = []
    for (x, y), diameters in about.items():
        said = ", ".join(diameters[:_MOST_DIAMETERS])
        said += ", ... um" if len(diameters) > _MOST_DIAMETERS else " um"
        number = numbers.setdefault(said, len(numbers) + 1)
        across = f"M{x - size:.6g} {y:.6g}h{2 * size:.6g}"
        down = f"M{x:.6g} {y - size:.6g}v{2 * size:.6g}"
        at = f'x="{x + size:.6g}" y="{y - size / 2:.6g}"'
        marks.append(f'<path class="mark" d="{across}{down}"/>')
        marks.append(f'<text class="number" {at}>{number}</text>')
    rows = [f"{number}: {said}" for said, number in numbers.items()]
    more = len(rows) - _MOST_ROWS
    return marks, rows[:_MOST_ROWS] + ([f"and {more} more"] if more > 0 else [])


def _bar(corner: Point, width: float, margin: float) -> str:
    """Return a scale bar of 1, 2 or 5 times a power of ten um below the part."""
    power = 10.0 ** math.floor(math.log10(_BAR * width))
    length = max(k * power for k in (1, 2, 5) if k * power <= _BAR * width)
    x, y = corner[0], -corner[1] + margin
    return (
        f'<path class="bar" d="M{x:.6g} {y:.6g}h{length:.6g}"/>'
        f'<text x="{x + length + margin / 4:.6g}" y="{y:.6g}">{length:g} um</text>'
    )
