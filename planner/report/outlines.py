"""Outlines of bodies, drawn at their poses in a picture: SVG in its pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from microplan.schemas.files.evidence import FeatureMark, LookEvidence
from microplan.schemas.files.world import World, WorldOutline
from microplan.schemas.page.elements import Element, el, slug
from microplan.schemas.plan import Look, Plan
from microplan.schemas.pose import Pose

_FAR = 4.0  # arms of a cross, um at the least
_LEAST = 1e-9  # um per px: no lens magnifies more


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFrame:
    """From the world to the pixels of a camera frame."""

    width_px: int
    height_px: int
    px_per_um: float

    @classmethod
    def of(cls, plan: Plan, look: Look) -> CameraFrame:
        """Return the frame of a look; a plan that is edited by hand may hold zeros."""
        needs, um_per_px = plan.requirements, look.view.um_per_px
        return cls(
            width_px=max(needs.width_px, 1),
            height_px=max(needs.height_px, 1),
            px_per_um=1 / um_per_px if um_per_px > _LEAST else 1.0,
        )

    @property
    def box(self) -> str:
        """Return the view box of the whole frame: pixels are centred on integers."""
        return f"-0.5 -0.5 {self.width_px} {self.height_px}"

    @property
    def from_world(self) -> str:
        """Return the transform from the world."""
        k = self.px_per_um
        cx, cy = (self.width_px - 1) / 2, (self.height_px - 1) / 2
        return f"matrix({k:.6g} 0 0 {-k:.6g} {cx:.6g} {cy:.6g})"


def definitions(world: World) -> Element:
    """Return every body's outline once, for `body` to use."""
    paths = [_path(name, outline) for name, outline in world.outlines.items()]
    return el(
        "svg", el("defs", paths), width=0, height=0, aria_hidden="true",
        style="position:absolute",
    )  # fmt: skip


def body(
    world: World, evidence: LookEvidence, name: str, **attributes: str
) -> Element | None:
    """Return a body at its pose, in world coordinates; None if that is unknown."""
    owner, _, side = name.partition(".")
    pose = evidence.places.get(owner)
    if pose is None or name not in world.outlines:
        return None
    tool = next((t for t in world.tools if t.name == owner), None)
    if tool is not None:
        half = (evidence.opening_um or 0.0) / 2
        pose = pose.compose(Pose(x_um=-half if side == "left" else half, y_um=0.0))
    return el("use", href=f"#{slug('outline', name)}", transform=_matrix(pose),
              **attributes)  # fmt: skip


def feature(
    world: World | None, evidence: LookEvidence, mark: FeatureMark
) -> Iterator[Element]:
    """Yield what a feature looks like, in world coordinates."""
    p, owner = mark.parameters, mark.name.partition(".")[0]
    if world is not None and mark.kind in ("outline", "jaws"):
        jaws = [f"{owner}.left", f"{owner}.right"]
        names = [mark.body or owner] if mark.kind == "outline" else jaws
        yield from (u for n in names if (u := body(world, evidence, n)) is not None)
    yield el("g", [*_shape(mark.kind, p), _cross(_size_um(p))],
             transform=_matrix(mark.pose))  # fmt: skip


def _shape(kind: str, values: Mapping[str, float]) -> Iterator[Element]:
    """Yield a feature's own lines, in its frame."""
    if kind == "circle" and "radius_um" in values:
        yield el("circle", r=values["radius_um"])
    if kind == "teeth":
        for name in ("outer_um", "root_um", "bore_um"):
            if name in values:
                yield el("circle", r=values[name])
        if "notch_rad" in values:
            yield _spoke(values["notch_rad"], values.get("notch_radius_um", 0.0))
    if kind in ("edge", "pair"):
        half, across = values.get("length_um", 0.0) / 2, values.get("width_um", 0.0) / 2
        for x in sorted({-across, across}):
            yield el("path", d=f"M{x:.5g} {-half:.5g}V{half:.5g}")
    if kind == "corner":
        reach, half = values.get("reach_um", 0.0), values.get("angle_rad", 0.0) / 2
        ends = [(-reach * math.cos(half), s * reach * math.sin(half)) for s in (-1, 1)]
        (x0, y0), (x1, y1) = ends
        yield el("path", d=f"M{x0:.5g} {y0:.5g}L0 0L{x1:.5g} {y1:.5g}")


def _spoke(angle_rad: float, radius_um: float) -> Element:
    """Return a line outward through what breaks a symmetry."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    a, b = 0.75 * radius_um, 1.25 * radius_um
    return el("path", d=f"M{a * c:.5g} {a * s:.5g}L{b * c:.5g} {b * s:.5g}")


def _cross(size_um: float) -> Element:
    """Return a cross at the reference point."""
    r = size_um
    return el("path", d=f"M{-r:.5g} 0H{r:.5g}M0 {-r:.5g}V{r:.5g}")


def _size_um(values: Mapping[str, float]) -> float:
    """Return the arms of a cross that fits a feature."""
    names = ("radius_um", "bore_um", "outer_um", "extent_um", "opening_um")
    first = next((values[n] for n in names if n in values), 0.0)
    return max(first / 6, _FAR)


def _matrix(pose: Pose) -> str:
    """Return the transform out of a pose's frame."""
    c, s = math.cos(pose.theta_rad), math.sin(pose.theta_rad)
    return f"matrix({c:.6g} {s:.6g} {-s:.6g} {c:.6g} {pose.x_um:.6g} {pose.y_um:.6g})"


def _path(name: str, outline: WorldOutline) -> Element:
    """Return an outline as a path, arcs as arcs."""
    data = "".join(_ring(ring.edges) for ring in outline.rings)
    return el("path", id=slug("outline", name), d=data, fill_rule="evenodd",
              vector_effect="non-scaling-stroke")  # fmt: skip


def _ring(edges: Sequence[tuple[float, ...]]) -> str:
    """Return a closed ring as path data."""
    if not edges:
        return ""
    x, y = _start(edges[0])
    return f"M{x:.6g} {y:.6g}" + "".join(map(_edge, edges)) + "Z"


def _start(edge: tuple[float, ...]) -> tuple[float, float]:
    if len(edge) == 4:
        return edge[0], edge[1]
    cx, cy, radius, start, _ = edge
    return cx + radius * math.cos(start), cy + radius * math.sin(start)


def _edge(edge: tuple[float, ...]) -> str:
    """Return an edge as path data; more than half a turn in several arcs."""
    if len(edge) == 4:
        return f"L{edge[2]:.6g} {edge[3]:.6g}"
    cx, cy, radius, start, sweep = edge
    count = max(1, math.ceil(abs(sweep) / math.pi - 1e-9))
    side = int(sweep > 0)
    ends = [start + sweep * (k + 1) / count for k in range(count)]
    return "".join(
        f"A{radius:.6g} {radius:.6g} 0 0 {side} "
        f"{cx + radius * math.cos(a):.6g} {cy + radius * math.sin(a):.6g}"
        for a in ends
    )
