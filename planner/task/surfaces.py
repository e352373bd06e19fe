"""Flat faces of a part: its own, those of its posts, and the marks that lie on them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import shapely

from microplan.optics.outline.outline import Outline, flatten, place
from microplan.planner.drawings.census import Taken
from microplan.planner.source.diagnostics import Report
from microplan.planner.source.schema import Checked
from microplan.planner.source.source import Key
from microplan.planner.task.drawings import AnyDrawing, take
from microplan.planner.task.finishes import interval
from microplan.planner.task.task import FaceMark, Part

Covering = tuple[str, Outline, float]  # a mark: name in a scene, edges, reflectance

OWN = ""  # the name of the part's own face
_CHORD_UM = 0.005  # of the polygons that are compared
# beyond its face a mark may be by what chords miss, on both sides
OVER_UM = 2 * _CHORD_UM


@dataclass(frozen=True, slots=True, kw_only=True)
class Surface:
    """A flat face with an edge: what is seen of a part, a post or a mark."""

    name: str  # "", "post", "mark" or "post.mark"
    outline: Outline  # um, in the part's frame
    z_um: float  # above the part's underside
    reflectance: float
    around: float | None  # reflectance of what it stands or lies on; None: any

    @property
    def bright(self) -> bool:
        """Return whether it is brighter than what surrounds it, as parts are."""
        return self.around is None or self.reflectance > self.around

    def body(self, part: str) -> str:
        """Return what it is called in a scene: part, part.post, part.mark."""
        return f"{part}.{self.name}" if self.name else part


def surfaces(part: Part) -> dict[str, Surface]:
    """Return a part's faces by name: its own, then its posts', then its marks'."""
    top_um = part.thickness_um
    found = {
        OWN: Surface(
            name=OWN, outline=part.outline, z_um=top_um, reflectance=part.reflectance,
            around=None,
        )
    }  # fmt: skip
    for name, post in part.posts.items():
        found[name] = Surface(
            name=name, outline=post.outline, z_um=top_um + post.height_um,
            reflectance=post.reflectance, around=part.reflectance,
        )  # fmt: skip
    for name, mark in part.marks.items():
        under = found[mark.on]
        found[name] = Surface(
            name=name, outline=mark.outline, z_um=under.z_um,
            reflectance=mark.reflectance, around=under.reflectance,
        )  # fmt: skip
    return found


def marks_on(
    part: Part, face: str, pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Covering, ...]:
    """Return the marks on one of a part's faces, the part at a pose (um, um, rad)."""
    return tuple(
        (f"{part.name}.{mark.name}", place(mark.outline, *pose), mark.reflectance)
        for mark in part.marks.values()
        if mark.on == face
    )


def without_marks(outline: Outline, marks: Iterable[Outline]) -> Outline:
    """Return a face without what marks cover of it: they lie in it side by side."""
    rings = [ring.reversed() for mark in marks for ring in mark.rings]
    return Outline(rings=(*outline.rings, *rings)) if rings else outline


def take_marks(
    task: Checked, part: str, drawing: AnyDrawing, report: Report
) -> dict[str, Taken]:
    """Return what the layers of a part's marks enclose, by the marks' names."""
    found: dict[str, Taken] = {}
    for name, where, raw in _declared(task, part):
        layer = task.source.value(*where, "layer")
        taken = take(drawing, [raw["layer"]], report, layer, apart=True)
        if taken is not None:
            found[name] = taken
    return found


def unread_layers(task: Checked, part: str, taken: Collection[str]) -> frozenset[str]:
    """Return the layers of posts and marks that are not among those taken, by names.

    In lower case: what is wrong with them was reported.
    """
    source = task.source
    posts = source.mapping("parts", part, "posts")
    named = [*posts.items(), *source.mapping("parts", part, "marks").items()]
    for post in posts:
        marks = source.mapping("parts", part, "posts", post, "marks")
        named += [(f"{post}.{key}", raw) for key, raw in marks.items()]
    layers = [raw.get("layer") for name, raw in named
              if isinstance(raw, dict) and name not in taken]  # fmt: skip
    return frozenset(name.lower() for name in layers if isinstance(name, str))


def read_marks(
    task: Checked, part: str, taken: Mapping[str, Taken], origin: tuple[float, float]
) -> dict[str, FaceMark]:
    """Return the marks in the part's frame, by name."""
    return {
        name: FaceMark(
            name=name,
            on=name.rpartition(".")[0],
            outline=place(taken[name].outline, -origin[0], -origin[1]),
            reflectance=float(raw["reflectance"]),
            finish=interval(raw["finish"]) if "finish" in raw else None,
            transmittance=float(raw.get("transmittance", 0.0)),
            where=task.source.key(*where),
        )
        for name, where, raw in _declared(task, part)
        if name in taken
    }


def check_marks(
    task: Checked, part: str, faces: Mapping[str, Outline], report: Report
) -> None:
    """Report marks that reach beyond their face, or cover each other.

    `faces` has the outlines of the part, its posts and its marks by name.
    """
    shapes = {name: _polygons(outline) for name, outline in faces.items()}
    seen: dict[str, list[str]] = {}
    for name, where, raw in _declared(task, part):
        under = name.rpartition(".")[0]
        if name not in shapes or under not in shapes:
            continue
        at, layer = task.source.value(*where, "layer"), raw["layer"]
        face = part + (f".{under}" if under else "")
        beyond = shapes[name].difference(shapes[under].buffer(OVER_UM))
        if not beyond.is_empty:
            point = beyond.representative_point()
            message = (
                f"mark {name} on layer '{layer}' reaches beyond the face of {face}, as "
                f"at ({point.x:.6g}, {point.y:.6g}) um of the drawing"
            )
            report.error("MP229", at, message, "a mark lies on a face: draw it there")
        for other in seen.setdefault(under, []):
            if shapes[name].buffer(-OVER_UM).intersects(shapes[other]):
                message = f"marks {other} and {name} cover each other on {face}"
                report.error("MP229", at, message, "cut one out of the other")
        seen[under].append(name)


def _declared(
    task: Checked, part: str
) -> Iterable[tuple[str, tuple[Key, ...], Mapping[str, Any]]]:
    """Yield name, place and keys of every mark that is in order, of posts too."""
    posts = task.source.mapping("parts", part, "posts")
    owners: list[tuple[str, tuple[Key, ...]]] = [("", ("parts", part))]
    owners += [(f"{post}.", ("parts", part, "posts", post)) for post in sorted(posts)]
    for prefix, owner in owners:
        for key, raw in sorted(task.source.mapping(*owner, "marks").items()):
            where = (*owner, "marks", key)
            if task.good(*where):
                yield prefix + key, where, raw


def _polygons(outline: Outline) -> shapely.geometry.base.BaseGeometry:
    """Return outer rings without their holes."""
    outer, holes = list[shapely.Polygon](), list[shapely.Polygon]()
    for ring in outline.rings:
        group = outer if ring.signed_area_um2 > 0 else holes
        group.append(shapely.Polygon(flatten(ring, _CHORD_UM)))
    return shapely.union_all(outer).difference(shapely.union_all(holes))
