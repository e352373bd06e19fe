"""Layers as a kind of light shows them: silhouettes, dull faces, lines of edges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from microplan.optics.light.lamps import RingLamp, edge_line
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.transfer.microscope import Microscope
from microplan.planner.task.finishes import SurfaceFinish
from microplan.planner.task.surfaces import OWN, surfaces
from microplan.planner.task.task import FaceMark, Part, Task
from microplan.planner.task.workcell import Workcell
from microplan.planner.views.targets import TargetShape


def ring_lamp(cell: Workcell) -> RingLamp | None:
    """Return the ring of light around the objective, None for other light."""
    elevation = cell.light.elevation_rad
    if not cell.light.is_ring or elevation is None:
        return None
    return RingLamp(low_rad=elevation[0], high_rad=elevation[1])


def lamp_below(cell: Workcell) -> float | None:
    """Return the aperture of a lamp below, None for other light."""
    return cell.light.aperture if cell.light.is_transmitted else None


def asks_for_walls(cell: Workcell) -> bool:
    """Return whether the light comes from below or aside, where walls hide the most."""
    return cell.light.is_transmitted or ring_lamp(cell) is not None


def stage_level(cell: Workcell) -> float:
    """Return what the stage sends: what it lets through, or sends back dully."""
    stage = cell.stage
    if cell.light.is_transmitted:
        return stage.transmittance or 0.0
    if cell.light.is_ring and stage.finish is not None:
        return stage.reflectance * (1 - sum(stage.finish) / 2)
    return stage.reflectance


def field_level(level: float, cell: Workcell, microscope: Microscope) -> float:
    """Return the background's level through a lens: of a lamp below its pupil's share.

    `level` is the stage's.
    """
    if not cell.light.is_transmitted:
        return level
    return level * (microscope.cone_aperture / microscope.aperture) ** 2


def through(cell: Workcell, scene: Scene, microscope: Microscope) -> Scene:
    """Return a scene of the world as a lens sees its background."""
    if not cell.light.is_transmitted:
        return scene
    return replace(scene, background=field_level(scene.background, cell, microscope))


def lit_layers(task: Task, layers: Iterable[Layer]) -> tuple[Layer, ...]:
    """Return layers of the world with what they send in the workcell's light."""
    cell = task.workcell
    if cell.light.is_transmitted:
        return tuple(_silhouette(task, layer) for layer in layers)
    lamp = ring_lamp(cell)
    if lamp is None:
        return tuple(layers)
    return tuple(_dull(task, layer, lamp) for layer in layers)


def looks_bright(task: Task, shape: TargetShape) -> bool:
    """Return whether a target is brighter than its surroundings in the light."""
    if task.workcell.light.is_transmitted:
        return not shape.bright
    part = task.parts.get(shape.owner)
    if not task.workcell.light.is_ring or part is None:
        return shape.bright
    face = surfaces(part)[shape.body.partition(".")[2]]
    if face.around is None:
        return shape.bright
    own, under = (
        _dull_level(part, name, level)
        for name, level in ((face.name, face.reflectance), (_under(part, face.name),
                            face.around))
    )  # fmt: skip
    return shape.bright == (face.bright == (own > under))


def dull_level(task: Task, body: str, reflectance: float) -> float:
    """Return what a body's face sends in the workcell's light, by its name."""
    if task.workcell.light.is_transmitted:
        return 0.0
    if not task.workcell.light.is_ring:
        return reflectance
    return reflectance * (1 - _finish(task, body))


def _silhouette(task: Task, layer: Layer) -> Layer:
    """Return a layer in light from below: what it lets through, and nothing sent."""
    clear = _transmittance(task, layer.name)
    return replace(layer, reflectance=0.0, finish=0.0, transmittance=clear)


def _dull(task: Task, layer: Layer, lamp: RingLamp) -> Layer:
    """Return a layer in a ring of light: its dull share, and the line of its edges."""
    finish = _finish(task, layer.name)
    surface = _surface(task, layer.name)
    line = None
    if isinstance(surface, SurfaceFinish):
        line = edge_line(
            lamp,
            mirrored=layer.reflectance * finish,
            radius_um=surface.edge_radius_um or 0.0,
            rings=_own_rings(task, layer),
        )
    return replace(
        layer,
        reflectance=layer.reflectance * (1 - finish),
        finish=0.0,
        edge_line=line,
    )


def _dull_level(part: Part, name: str, reflectance: float) -> float:
    """Return what a part's face sends in a ring of light."""
    return reflectance * (1 - _middle(_face(part, name)))


def _under(part: Part, name: str) -> str:
    """Return the face that a face of a part lies or stands on."""
    return part.marks[name].on if name in part.marks else OWN


def _finish(task: Task, body: str) -> float:
    return _middle(_surface(task, body))


def _middle(surface: SurfaceFinish | FaceMark) -> float:
    """Return the finish that images take."""
    if isinstance(surface, SurfaceFinish):
        return surface.seen_finish
    return 0.0 if surface.finish is None else sum(surface.finish) / 2


def _transmittance(task: Task, body: str) -> float:
    """Return what a body lets through; of a mark, together with what carries it."""
    surface = _surface(task, body)
    if isinstance(surface, SurfaceFinish):
        return surface.transmittance
    owner = body.partition(".")[0]
    carrier = f"{owner}.{surface.on}" if surface.on else owner
    return surface.transmittance * _transmittance(task, carrier)


def _own_rings(task: Task, layer: Layer) -> int:
    """Return how many rings of a layer are its own; marks' come after them."""
    part = task.parts.get(layer.name.partition(".")[0])
    if part is None:
        return len(layer.outline.rings)
    face = layer.name.partition(".")[2]
    marks = [mark for mark in part.marks.values() if mark.on == face]
    return len(layer.outline.rings) - sum(len(m.outline.rings) for m in marks)


def _surface(task: Task, body: str) -> SurfaceFinish | FaceMark:
    """Return the surface of a body or mark by its name in a scene."""
    owner, _, inner = body.partition(".")
    if owner in task.workcell.tools:
        return task.workcell.tools[owner].surface
    return _face(task.parts[owner], inner)


def _face(part: Part, name: str) -> SurfaceFinish | FaceMark:
    """Return the surface of a part's own face, of a post, or a mark."""
    if name in part.posts:
        return part.posts[name].surface
    return part.marks.get(name, part.surface)
