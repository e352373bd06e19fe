"""A part's outline as an SVG picture: arcs as arcs, um as units, y up.

References
----------
W3C (2018), Scalable Vector Graphics 2, 9.3: path data.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from microplan.arrays import FloatArray, Point
from microplan.optics.outline.outline import Arc, Edge, Outline, Ring, flatten
from microplan.planner.store.folder import not_written, replace_alike
from microplan.planner.task.features import dominant_circle
from microplan.planner.task.task import Part
from microplan.schemas.page.labels import LabelBox

_SVG = "http://www.w3.org/2000/svg"
SIDE_PX = 720.0  # of the longer side of the drawing
_MARGIN = 0.08  # of the longer side
_WIDE = 0.62  # of a letter, over its height
_MOST_LINES = 64  # places that are tried for one line
_BELOW = 0.1  # of a letter, below its base: numbers and "um" have no tails
_SLACK = 1e-3  # of a letter: words on neighbouring lines do not meet
_ON_LINES = 6.0  # words on a line are as bad as words so many lines farther off
_LEFT = 2.0  # and to the left of a mark as so many
_BAR = 0.3  # of the width, that the scale bar takes at most
_STYLE = (
    "text{font-family:sans-serif;fill:#222}"
    ".part{fill:#d8e2ee;stroke:#1f3a5f}.post{fill:#f3d9a4;stroke:#7a5200}"
    ".mark{stroke:#a11;fill:none}.bar{stroke:#222}rect{fill:#fff}"
)


def write_drawings(parts: Mapping[str, Part], folder: Path) -> str:
    """Write a picture of every part, and return where they are.

    Raises
    ------
    OutputError
        MP702 if one cannot be written, MP703 if another file is in its place.
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
    """Return a picture of a part and its posts, circles marked with their diameters."""
    x0, y0, x1, y1 = part.outline.bounds_um
    longer = max(x1 - x0, y1 - y0)
    margin, line = _MARGIN * longer, longer / 500
    left, top = x0 - margin, -y1 - margin
    width, height = x1 - x0 + 2 * margin, y1 - y0 + 2.5 * margin
    scale = SIDE_PX / max(width, height)
    box = f"{left:.6g} {top:.6g} {width:.6g} {height:.6g}"
    size = f'width="{width * scale:.0f}" height="{height * scale:.0f}"'
    title = escape(f"{part.name}: {x1 - x0:.6g} x {y1 - y0:.6g} um")
    bar = _bar((x0, y0), width, margin)
    return "\n".join(
        [
            f'<svg xmlns="{_SVG}" viewBox="{box}" {size} role="img">',
            f"<title>{title}</title><style>{_STYLE}</style>",
            f'<rect x="{left:.6g}" y="{top:.6g}" width="100%" height="100%"/>',
            f'<g stroke-width="{line:.4g}" font-size="{margin / 2.2:.4g}">',
            _path(part.outline, "part"),
            *(_path(post.outline, "post") for _, post in sorted(part.posts.items())),
            *_marks(part, margin / 4, margin / 2.2),
            bar,
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
    """Return an edge as path data; more than half a turn in two arcs."""
    if not isinstance(edge, Arc):
        return f"L{edge.end[0]:.8g} {-edge.end[1]:.8g}"
    turns = max(1, math.ceil(abs(edge.sweep_rad) / math.pi - 1e-9))
    side = int(edge.sweep_rad < 0)  # y points down in SVG
    ends = (edge.at((k + 1) / turns) for k in range(turns))
    radius = f"{edge.radius_um:.8g}"
    return " ".join(f"A{radius} {radius} 0 0 {side} {x:.8g} {-y:.8g}" for x, y in ends)


def _marks(part: Part, size: float, letter: float) -> Iterator[str]:
    """Yield a cross at every circle's middle, with its diameter, each in its place."""
    found = [c for ring in part.outline.rings if (c := dominant_circle(ring))]
    middles = [(c.center_um[0], -c.center_um[1]) for c in found]
    lines = np.vstack([_lines(part, letter), *(_cross(x, y, size) for x, y in middles)])
    words: list[LabelBox] = []
    for circle, (x, y) in zip(found, middles, strict=True):
        across = f"M{x - size:.6g} {y:.6g}h{2 * size:.6g}"
        down = f"M{x:.6g} {y - size:.6g}v{2 * size:.6g}"
        yield f'<path class="mark" d="{across}{down}"/>'
        said = f"{2 * circle.radius_um:.6g} um"
        box = _place((x, y), size, letter, said, (words, lines, _reach(part, letter)))
        words.append(box)
        base = box.bottom - _BELOW * letter
        yield f'<text x="{box.left:.6g}" y="{base:.6g}">{said}</text>'


def _lines(part: Part, letter: float) -> FloatArray:
    """Return what is drawn of a part and its posts as lines; (N, 4) x0, y0, x1, y1."""
    outlines = [part.outline, *(post.outline for post in part.posts.values())]
    found = [np.empty((0, 4))]
    for ring in (ring for outline in outlines for ring in outline.rings):
        x, y = flatten(ring, letter / 20).T
        found.append(np.column_stack([x, -y, np.roll(x, -1), -np.roll(y, -1)]))
    return np.vstack(found)


def _cross(x: float, y: float, size: float) -> FloatArray:
    """Return the two lines of a mark; (2, 4)."""
    return np.array([[x - size, y, x + size, y], [x, y - size, x, y + size]])


def _reach(part: Part, letter: float) -> LabelBox:
    """Return where words may stand: beside the part, above the scale bar."""
    x0, y0, x1, y1 = part.outline.bounds_um
    aside = _MARGIN * max(x1 - x0, y1 - y0)
    top, bottom = -y1 - letter, -y0 + letter + _BELOW * letter
    return LabelBox(left=x0 - aside, top=top, right=x1 + aside, bottom=bottom)


def _place(
    at: Point,
    size: float,
    letter: float,
    said: str,
    there: tuple[Sequence[LabelBox], FloatArray, LabelBox],
) -> LabelBox:
    """Return the place beside a mark for words: near it, on no other, on few lines.

    Where so many circles lie so close that there is none, words stand on words.
    """
    words, lines, reach = there
    tried = [*_tried(at, size, letter, _WIDE * letter * len(said))]
    best, least = tried[0][1], math.inf
    for far, box in tried:
        if far >= least:
            break
        if not reach.holds(box) or any(map(box.grown(-_SLACK * letter).meets, words)):
            continue
        cost = far + (_ON_LINES if _is_crossed(box, lines) else 0.0)
        if cost < least:
            best, least = box, cost
    return best


def _tried(
    at: Point, size: float, letter: float, wide: float
) -> list[tuple[float, LabelBox]]:
    """Return boxes beside a mark and how far off they are, in letters, near to far."""
    (x, y), found = at, []
    for k in range(_MOST_LINES):
        lines = (k + 1) // 2
        base = y - size / 2 + lines * (letter if k % 2 else -letter)
        top, bottom = base - (1 - _BELOW) * letter, base + _BELOW * letter
        for left, aside in ((x + size, 0.0), (x - size - wide, _LEFT)):
            box = LabelBox(left=left, top=top, right=left + wide, bottom=bottom)
            found.append((lines + aside, box))
    return sorted(found, key=lambda pair: pair[0])


def _is_crossed(box: LabelBox, lines: FloatArray) -> bool:
    """Return whether any line runs through a box."""
    x, y = lines[:, 0::2], lines[:, 1::2]
    near = (
        (x.min(axis=1) < box.right)
        & (x.max(axis=1) > box.left)
        & (y.min(axis=1) < box.bottom)
        & (y.max(axis=1) > box.top)
    )
    return any(box.crossed(((a, b), (c, d))) for a, b, c, d in lines[near].tolist())


def _bar(corner: Point, width: float, margin: float) -> str:
    """Return a scale bar of 1, 2 or 5 times a power of ten um below the part."""
    power = 10.0 ** math.floor(math.log10(_BAR * width))
    length = max(k * power for k in (1, 2, 5) if k * power <= _BAR * width)
    x, y = corner[0], -corner[1] + margin
    return (
        f'<path class="bar" d="M{x:.6g} {y:.6g}h{length:.6g}"/>'
        f'<text x="{x + length + margin / 4:.6g}" y="{y:.6g}">{length:g} um</text>'
    )
