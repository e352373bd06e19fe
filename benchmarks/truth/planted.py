"""Planted faults: five mistakes, each in the compiler alone, then in the cell alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from benchmarks.figures import Benchmark, Figure, Options
from benchmarks.truth.cell_side import Photographed
from benchmarks.truth.comparison import apart
from benchmarks.truth.compiler_side import Surface, TrialCase, trial_image
from benchmarks.truth.examples import GEAR as GEAR_EXAMPLE
from benchmarks.truth.examples import plan_of
from benchmarks.truth.judged_looks import JudgedLook, cell_image, judged_looks
from microplan.executor.simulated.imaging.solids.plane_outline import PlaneOutline
from microplan.executor.simulated.imaging.solids.solid_scene import SolidBody
from microplan.optics.outline.outline import Edge, Outline, Ring, Segment
from microplan.optics.render.scene import Layer

LOWER_UM, FLAT_UM, WIDER_UM, SHARE = 20.0, 1e-3, 1.0, 0.9
GEAR, FINGERS = "gear", "tweezers"
BORE_UM = 30.0  # a ring of the gear that stays within it is its bore


@dataclass(frozen=True, slots=True, kw_only=True)
class Plant:
    """One mistake, as each side would make it."""

    name: str
    in_compiler: Callable[[TrialCase], TrialCase]
    in_cell: Callable[[Photographed], Photographed]
    mirrors: bool = False  # pictures are upside down


def found(plant: Plant, looks: Sequence[JudgedLook]) -> tuple[bool, bool]:
    """Return whether a mistake of the compiler's, and one of the cell's, is noticed.

    It is where a picture that meets the aims without it misses them with it.
    """
    good = [look for look in looks if _passes(look.trial, look.cell)]
    flip = plant.mirrors
    return (
        any(not _passes(plant.in_compiler(k.trial), k.cell, flip) for k in good),
        any(not _passes(k.trial, plant.in_cell(k.cell), flip) for k in good),
    )


def _passes(trial: TrialCase, cell: Photographed, flip: bool = False) -> bool:  # noqa: FBT001, FBT002 - a fact
    """Return whether two pictures agree; `flip` turns one of them upside down."""
    image = trial_image(trial.case)
    return apart(image[::-1] if flip else image, cell_image(cell)).passes


def _of_layers(
    trial: TrialCase, owner: str, change: Callable[[Layer], Layer]
) -> TrialCase:
    """Return a case with other layers of one owner."""

    def changed(layers: tuple[Layer, ...]) -> tuple[Layer, ...]:
        return tuple(
            change(la) if la.name.partition(".")[0] == owner else la for la in layers
        )

    case = trial.case
    static, moving = changed(case.static), changed(case.moving)
    return replace(trial, case=replace(case, static=static, moving=moving))


def _of_bodies(
    cell: Photographed, owner: str, change: Callable[[SolidBody], SolidBody]
) -> Photographed:
    """Return a scene with other bodies of one owner."""
    bodies = tuple(
        change(b) if b.name.partition(".")[0] == owner else b for b in cell.scene.bodies
    )
    return replace(cell, scene=replace(cell.scene, bodies=bodies))


def _lower_layer(layer: Layer) -> Layer:
    low = layer.underside_um
    return replace(
        layer,
        z_um=layer.z_um - LOWER_UM,
        underside_um=None if low is None else low - LOWER_UM,
    )


def _lower_body(body: SolidBody) -> SolidBody:
    return replace(
        body, top_um=body.top_um - LOWER_UM, bottom_um=body.bottom_um - LOWER_UM
    )


def _flat_layer(layer: Layer) -> Layer:
    return replace(layer, underside_um=layer.z_um - FLAT_UM)


def _flat_body(body: SolidBody) -> SolidBody:
    return replace(body, bottom_um=body.top_um - FLAT_UM)


def _narrow_case(trial: TrialCase) -> TrialCase:
    case = trial.case
    lamp = case.lamp_aperture
    scope = replace(case.microscope, aperture=SHARE * case.microscope.aperture)
    dim = None if lamp is None else SHARE * lamp
    return replace(trial, case=replace(case, microscope=scope, lamp_aperture=dim))


def _narrow_view(cell: Photographed) -> Photographed:
    return replace(cell, view=replace(cell.view, aperture=SHARE * cell.view.aperture))


def _wide_layer(layer: Layer) -> Layer:
    rings = layer.outline.rings
    x0, y0, x1, y1 = Outline(rings=rings[:1]).bounds_um
    middle = ((x0 + x1) / 2, (y0 + y1) / 2)
    wide = [
        Ring(edges=tuple(_wide_edge(e, middle) for e in ring.edges), layer=ring.layer)
        if _is_bore(Outline(rings=(ring,)).bounds_um)
        else ring
        for ring in rings
    ]
    return replace(layer, outline=Outline(rings=tuple(wide)))


def _wide_edge(edge: Edge, middle: tuple[float, float]) -> Edge:
    """Return an edge of the bore farther from its middle."""
    scale = 1 + WIDER_UM / 25.0  # R of the example's bore

    def away(point: tuple[float, float]) -> tuple[float, float]:
        x, y = (m + scale * (p - m) for p, m in zip(point, middle, strict=True))
        return (x, y)

    if isinstance(edge, Segment):
        return Segment(start=away(edge.start), end=away(edge.end))
    return replace(edge, center=away(edge.center), radius_um=scale * edge.radius_um)


def _is_bore(bounds: tuple[float, float, float, float]) -> bool:
    x0, y0, x1, y1 = bounds
    return max(x1 - x0, y1 - y0) < 2 * BORE_UM


def _wide_body(body: SolidBody) -> SolidBody:
    """Return the gear with a wider bore; its frame's origin is the bore's middle."""
    scale = 1 + WIDER_UM / 25.0
    rings = []
    for ring in body.outline.rings:
        is_bore = _is_bore(PlaneOutline((ring,)).box)
        rings.append(_scaled(ring, scale) if is_bore else ring)
    return replace(body, outline=PlaneOutline(tuple(rings)))


def _scaled(
    ring: tuple[tuple[float, ...], ...], scale: float
) -> tuple[tuple[float, ...], ...]:
    """Return a ring of edges larger; the last two numbers of an arc are angles."""
    made = []
    for edge in ring:
        lengths = 3 if len(edge) == 5 else 4
        made.append((*(scale * v for v in edge[:lengths]), *edge[lengths:]))
    return tuple(made)


def _mirrored_case(trial: TrialCase) -> TrialCase:
    case = trial.case
    row = case.microscope.height_px - case.window.row - case.window.rows
    return replace(trial, case=replace(case, window=replace(case.window, row=row)))


def _mirrored_view(cell: Photographed) -> Photographed:
    row = cell.view.height_px - cell.window.row - cell.window.rows
    return replace(cell, window=replace(cell.window, row=row))


GEAR_LOOKS = ("see_fingers", "bring_between", "over_shaft", "check_seated.seat")


def _measure(options: Options) -> Iterator[Figure]:
    with plan_of(GEAR_EXAMPLE, options) as plan_file:
        looks = judged_looks(
            GEAR_EXAMPLE.file, plan_file, Surface(wall=0.0), GEAR_LOOKS
        )
        count = sum(sum(found(plant, looks)) for plant in PLANTS.values())
    yield Figure(name="truth.planted_found", value=count, unit=f"of {2 * len(PLANTS)}")


PLANTS: Mapping[str, Plant] = {
    plant.name: plant
    for plant in (
        Plant(
            name="fingers_lower",
            in_compiler=lambda t: _of_layers(t, FINGERS, _lower_layer),
            in_cell=lambda c: _of_bodies(c, FINGERS, _lower_body),
        ),
        Plant(
            name="flat_gear",
            in_compiler=lambda t: _of_layers(t, GEAR, _flat_layer),
            in_cell=lambda c: _of_bodies(c, GEAR, _flat_body),
        ),
        Plant(
            name="mirrored_y",
            in_compiler=_mirrored_case,
            in_cell=_mirrored_view,
            mirrors=True,
        ),
        Plant(name="aperture", in_compiler=_narrow_case, in_cell=_narrow_view),
        Plant(
            name="bore_wider",
            in_compiler=lambda t: _of_layers(t, GEAR, _wide_layer),
            in_cell=lambda c: _of_bodies(c, GEAR, _wide_body),
        ),
    )
}

BENCHMARK = Benchmark(names=("truth.planted_found",), measure=_measure)
