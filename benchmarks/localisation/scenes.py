"""What routines are asked to find: parts and features, clean and disturbed.

The estimator's images come from Hopkins' law, the truth from the exact one with a band
and a margin ten times better than the estimator's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.scenario import LookCase
from microplan.featuresel.look.sensitivity import LookSetting
from microplan.featuresel.routines.contract import TargetKind
from microplan.optics.lens.sensor import expose, to_unit
from microplan.optics.outline.outline import Outline, Ring, place
from microplan.optics.render.prepared_scene import PreparedScene, prepare
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.render.view_range import Range
from microplan.optics.transfer.microscope import Microscope
from tests.featuresel.conftest import (
    GEAR,
    JAWS,
    MICROSCOPE,
    TEETH,
    finger_layer,
    gear_layer,
    make_case,
    on_target,
    polygon,
    post_layer,
)
from tests.featuresel.conftest import bracket as bracket_case

FOCUS_SIGMA_UM = 9.0  # three of them hold 25 um, the farthest that is measured
ZOOM = 0.05  # largest relative error
GRADIENT = 0.3  # change of the light across the field
GAIN = (0.7, 1.2)  # no pixel saturates at a reflectance of .8
PLACE_UM = 3.0  # largest displacement along an axis
CONDITIONS = ("plain", "zoom", "gradient", "fingers", "all")
FINE = Sampling(band_error=5e-6, margin=160.0)
_HALF_UM = 55.0  # where fingers reach over what has no radius
_LONG_UM = 400.0  # beyond the window
_SHARED = 25  # trials of one angle: spectra are made once for them
_LARGEST_ZOOM_FIELD_UM = 120.0  # the gear, its search and its blur


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """One trial: where the look stands, and the image the camera gives."""

    setting: LookSetting
    image: FloatArray


def gear() -> LookCase:
    """The gear at any angle, m 6.9."""
    case = make_case("teeth", GEAR, (gear_layer(),), theta_any=True, half_px=(120, 120))
    return replace(case, target=replace(case.target, symmetry=TEETH))


def gear_close() -> LookCase:
    """The gear at the highest magnification that keeps it in the field.

    Of the frame, what is as wide as it is high: routines read nothing beside it.
    """
    m = MICROSCOPE.height_px * MICROSCOPE.pitch_um / _LARGEST_ZOOM_FIELD_UM
    scope: Microscope = replace(MICROSCOPE, magnification=m)
    side = scope.height_px
    middle = Window(row=0, column=(scope.width_px - side) // 2, rows=side, columns=side)
    return on_target(replace(gear(), microscope=scope, window=middle))


def shaft() -> LookCase:
    """The shaft's top, m 6.9."""
    return make_case(
        "circle",
        {"radius_um": 22.0},
        (post_layer(),),
        half_px=(60, 60),
        background=0.15,
    )


def fingers() -> LookCase:
    """Both fingers, nearly straight, m 6.9."""
    return make_case(
        "jaws", JAWS, (finger_layer(),), half_px=(120, 190), theta_rad=0.02, y_um=-20.0
    )


def bracket() -> LookCase:
    """An L with a hole, its whole outline at any angle, m 6.9."""
    return bracket_case()


def edge() -> LookCase:
    """One straight edge across the window, its part below it, m 6.9."""
    below = polygon(
        (-_LONG_UM, -_LONG_UM), (0, -_LONG_UM), (0, _LONG_UM), (-_LONG_UM, _LONG_UM)
    )
    return _straight("edge", below, math.pi / 2, length_um=90.0)


def pair() -> LookCase:
    """A bar of 30 um across the window, m 6.9."""
    bar = polygon((-15, -_LONG_UM), (15, -_LONG_UM), (15, _LONG_UM), (-15, _LONG_UM))
    return _straight("pair", bar, math.pi / 2, length_um=90.0, width_um=30.0)


def corner() -> LookCase:
    """A right angle that opens to the left, its legs out of the window, m 6.9."""
    side = _LONG_UM
    quarter = polygon((-side, -side), (0, 0), (-side, side))
    return _straight("corner", quarter, 0.1, angle_rad=math.pi / 2, reach_um=45.0)


def _straight(
    kind: TargetKind, ring: Ring, theta_rad: float, **parameters: float
) -> LookCase:
    """Return a look at straight edges that reach across the window."""
    layer = Layer(
        name="part", outline=Outline(rings=(ring,)), z_um=0.0, reflectance=0.7
    )
    return make_case(kind, parameters, (layer,), half_px=(70, 70), theta_rad=theta_rad)


FITTED: Mapping[str, Callable[[], LookCase]] = {
    "gear": gear,
    "gear_close": gear_close,
    "shaft": shaft,
    "fingers": fingers,
}  # whose every point the likelihood fit is measured at
SCENES: Mapping[str, Callable[[], LookCase]] = {
    **FITTED,
    "bracket": bracket,
    "edge": edge,
    "pair": pair,
    "corner": corner,
}
ACROSS = ("edge", "pair")  # known in one direction only, here nearly that of y


def disturbed(case: LookCase, condition: str) -> LookCase:
    """Return the look with the spreads of a condition, and fingers where it has them.

    Routines free what the spreads hold, and the limit is of the same numbers.
    """
    zoom = ZOOM if condition in ("zoom", "all") else 0.0
    gradient = GRADIENT if condition in ("gradient", "all") else 0.0
    static: tuple[Layer, ...] = ()
    if condition in ("fingers", "all") and case.target.kind != "jaws":
        static = (finger_layer(130.0, opening_um=1.92 * _radius_um(case)),)
    return replace(
        case,
        static=static,
        spread=replace(
            case.spread,
            focus_sigma_um=FOCUS_SIGMA_UM,
            magnification_sigma=zoom / 2,
            light_gain=GAIN,
            light_gradient=(0.0, gradient),
            pose_sigma_xy_um=PLACE_UM / 2,
            search_um=PLACE_UM * 1.5,
        ),
        target=replace(
            case.target, search_px=PLACE_UM * 1.5 * case.microscope.px_per_um
        ),
    )


def free_names(case: LookCase) -> tuple[str, ...]:
    """Return what is to be told, by the names of the limit.

    What the likelihood fit leaves free, but for the place along an edge, which no
    routine tells.
    """
    names = ["y"] if case.target.kind in ACROSS else ["x", "y"]
    names += (["theta"] if case.target.kind != "circle" else []) + ["z"]
    names += ["zoom"] if case.spread.magnification_sigma > 0 else []
    names += ["gain"]
    if case.spread.light_gradient[1] > 0:
        names += ["gradient_x", "gradient_y"]
    return tuple(names)


def draws(
    case: LookCase, z_um: float, count: int, seed: int, *, part: int = 0
) -> Iterator[Drawn]:
    """Yield trials of a look at one focus; nothing but the numbers given decides them.

    Poses and light are the same at every focus, the noise is not: every image has its
    own, and no image is exposed twice. Another `part` has other trials.

    Places are anywhere in a pixel, angles and zooms anywhere in their range, one for
    each `_SHARED` trials.
    """
    rng = np.random.default_rng([seed, part])
    noise = np.random.default_rng([seed, part, round(1e3 * z_um) + 10**6])
    for first in range(0, count, _SHARED):
        group = _group(case, z_um, rng)
        moving, still = _prepared(case, group)
        for _ in range(min(_SHARED, count - first)):
            yield _exposed(case, _setting(case, group, rng), moving, still, noise)


def _radius_um(case: LookCase) -> float:
    p = case.target.parameters
    return p.get("outer_um", p.get("radius_um", _HALF_UM))


def _group(case: LookCase, z_um: float, rng: np.random.Generator) -> LookSetting:
    """Return the turn and zoom that some trials share."""
    turn = 0.0
    if case.target.kind != "circle":
        reach = math.pi if case.theta_any else case.target.theta_range_rad / 2
        turn = float(rng.uniform(-reach, reach))
    zoom = 2 * case.spread.magnification_sigma
    zoomed = 1 + float(rng.uniform(-zoom, zoom))
    return LookSetting(dtheta_rad=turn, dz_um=z_um, zoom=zoomed)


def _setting(
    case: LookCase, group: LookSetting, rng: np.random.Generator
) -> LookSetting:
    """Return where one trial stands."""
    dx, dy = rng.uniform(-PLACE_UM, PLACE_UM, 2)
    gradient, angle = rng.uniform(0, case.spread.light_gradient[1]), rng.uniform(0, 7)
    return replace(
        group,
        dx_um=float(dx),
        dy_um=float(dy),
        gain=float(rng.uniform(*GAIN)),
        gradient_x=float(gradient * math.cos(angle)),
        gradient_y=float(gradient * math.sin(angle)),
    )


def _prepared(
    case: LookCase, group: LookSetting
) -> tuple[PreparedScene, PreparedScene | None]:
    """Return what moves and what stands still, by the exact law at one focus."""
    height = case.focus_um + group.dz_um
    reach = Range(focus_um=(height, height), shift_um=PLACE_UM)
    scope = replace(
        case.microscope, magnification=case.microscope.magnification * group.zoom
    )
    theta = case.theta_rad + group.dtheta_rad
    moved = tuple(
        replace(
            layer,
            outline=place(layer.outline, case.x_um, case.y_um, theta),
        )
        for layer in case.moving
    )

    def ready(layers: tuple[Layer, ...]) -> PreparedScene:
        return prepare(
            Scene(layers=layers, background=case.background),
            scope,
            reach,
            window=case.window,
            sampling=FINE,
        )

    return ready(moved), ready(case.static) if case.static else None


def _exposed(
    case: LookCase,
    at: LookSetting,
    moving: PreparedScene,
    still: PreparedScene | None,
    rng: np.random.Generator,
) -> Drawn:
    """Return one trial with the camera's noise."""
    focus_um = case.focus_um + at.dz_um
    also = () if still is None else still.patches(focus_um=focus_um)
    image = moving.image(
        focus_um=focus_um,
        shift_um=(at.dx_um, at.dy_um),
        light=Illumination(
            gain=at.gain, gradient_x=at.gradient_x, gradient_y=at.gradient_y
        ),
        also=also,
    )
    return Drawn(
        setting=at, image=to_unit(expose(image, case.sensor, rng), case.sensor.bits)
    )
