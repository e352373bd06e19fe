"""One look to be tried: scene, optics, target, tolerances and spreads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from microplan.arrays import FloatArray
from microplan.featuresel.look.discrepancy import Discrepancy
from microplan.featuresel.look.unknown_surfaces import UnknownSurface
from microplan.featuresel.routines.contract import Target
from microplan.featuresel.routines.picture import RegionFrame
from microplan.optics.layers.coaxial_light import Irradiance
from microplan.optics.layers.occlusion import occluded
from microplan.optics.layers.solids.solid_bodies import is_solid
from microplan.optics.lens.distorted_scene import lens_scene
from microplan.optics.lens.lens import LensErrors
from microplan.optics.lens.sensor import Sensor
from microplan.optics.light.lamps import RingLamp
from microplan.optics.light.lit_image import render_lit
from microplan.optics.light.ring import MIDDLE
from microplan.optics.light.transmitted import is_clear
from microplan.optics.outline.outline import place
from microplan.optics.render.render import Covered
from microplan.optics.render.sampling import Sampling
from microplan.optics.render.scene import Illumination, Layer, Scene, Window
from microplan.optics.transfer.microscope import Microscope

_SURE = LensErrors()  # no error is known, none unknown


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownRotation:
    """Something that is not the target's owner, at an angle that is not measured.

    Its layers turn about a point of the world, all of them together.
    """

    owner: str
    x_um: float
    y_um: float
    sigma_theta_rad: float  # pi: any angle

    def __post_init__(self) -> None:
        if not 0 < self.sigma_theta_rad <= math.pi:
            raise ValueError(
                f"sigma_theta_rad must be in (0, pi], got {self.sigma_theta_rad}"
            )

    @property
    def is_any(self) -> bool:
        """Return whether the angle is uniform over the circle."""
        return self.sigma_theta_rad >= math.pi


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialSpread:
    """What trials are perturbed by; sigmas are one standard deviation per axis.

    Of a look there are two: what is tried, and what the workcell states.
    """

    focus_sigma_um: float
    magnification_sigma: float  # of the ratio to nominal
    light_gain: tuple[float, float]  # uniform in this interval, times the nominal gain
    light_gradient: tuple[float, float]  # magnitude; the direction is any
    pose_sigma_xy_um: float
    pose_sigma_theta_rad: float
    search_um: float  # how far off a look may start; trials reach it at the extremes
    # of the static bodies that are not the target's owner, all of them together
    occluder_sigma_um: float = 0.0
    # by up to which all bodies lie off together, x and y, uniform: half a pixel where
    # the region moves with the target
    together_um: float = 0.0
    turning: tuple[UnknownRotation, ...] = ()  # of that, what lies at unknown angles
    noise: tuple[float, float] = (1.0, 1.0)  # uniform, times the sensor's noise
    lens: LensErrors = _SURE  # only its sigmas count, about the look's own

    def __post_init__(self) -> None:
        names = ("focus_sigma_um", "magnification_sigma", "pose_sigma_xy_um")
        more = ("pose_sigma_theta_rad", "search_um", "occluder_sigma_um", "together_um")
        for name in (*names, *more):
            value = getattr(self, name)
            if not (value >= 0 and math.isfinite(value)):
                raise ValueError(f"{name} must be finite and >= 0, got {value}")
        if self.magnification_sigma > 0.1:
            raise ValueError(
                f"magnification_sigma must be at most .1, got "
                f"{self.magnification_sigma}"
            )
        for name in ("light_gain", "light_gradient"):
            low, high = getattr(self, name)
            if not 0 <= low <= high < math.inf:
                raise ValueError(f"{name} must be 0 <= low <= high, got {low}, {high}")
        low, high = self.noise
        if not 0 < low <= high < math.inf:
            raise ValueError(f"noise must be 0 < low <= high, got {low}, {high}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LookCase:
    """A look before a routine is chosen for it; picklable.

    The target's frame has its origin at the target's reference point. The model is the
    compiler's rung of the defocus law, the sampling its band and margin.
    """

    key: str  # names the case; seeds depend on it
    static: tuple[Layer, ...]  # world frame
    moving: tuple[Layer, ...]  # outlines in the target's frame
    background: float
    x_um: float  # nominal world pose of the target's frame
    y_um: float
    theta_rad: float
    theta_any: bool  # the angle is uniform over the circle
    microscope: Microscope
    focus_um: float
    light: Illumination
    window: Window  # the region of the frame
    sensor: Sensor
    target: Target
    model: str
    sampling: Sampling
    lens: LensErrors  # what is known of it
    lamp_aperture: float | None  # of coaxial light that bodies shade; None: no shade
    background_z_um: float | None  # None: the background is never shaded
    ring: RingLamp | None = None  # of light from around the objective
    line: float = MIDDLE  # where lines of edges lie within their rounding, 0..1
    treatment: str  # of layers, one of `microplan.optics.layers.layer_error.TREATMENTS`
    tolerance_um: float  # what the look has to meet per axis, 2 sigma and bias
    tolerance_theta_rad: float | None  # None: the angle is not needed
    spread: TrialSpread  # what is tried: corners, usable ranges, what routines allow
    # the workcell's own, which sigma and bias are promised for; None: the same
    stated: TrialSpread | None = None
    # walls and faces by a thick body near the line of sight
    surfaces: tuple[UnknownSurface, ...] = ()
    discrepancy: Discrepancy | None = None  # of pictures from images; None: none

    def __post_init__(self) -> None:
        if not self.tolerance_um > 0:
            raise ValueError(f"tolerance_um must be positive, got {self.tolerance_um}")
        if self.tolerance_theta_rad is not None and not self.tolerance_theta_rad > 0:
            raise ValueError(
                f"tolerance_theta_rad must be positive, got {self.tolerance_theta_rad}"
            )

    @property
    def promised(self) -> TrialSpread:
        """Return the spreads that sigma and bias are promised for."""
        return self.spread if self.stated is None else self.stated

    @property
    def drawn(self) -> TrialSpread:
        """Return the spreads of random trials by which chains are chosen.

        Those that are promised for, the focus within what is tried: a target whose
        height is known less well is found from further focus stops.
        """
        focus_um = min(self.promised.focus_sigma_um, self.spread.focus_sigma_um)
        return replace(self.promised, focus_sigma_um=focus_um)

    @property
    def reach_um(self) -> float:
        """Return how far the target's blurred edges reach to either side, um."""
        scope, owner = self.microscope, self.target.name.partition(".")[0]
        off = {layer.name: abs(layer.z_um - self.focus_um) for layer in self.moving}
        nearest_um = min(off.values(), default=0.0)
        off_um = off.get(self.target.name, off.get(owner, nearest_um))
        fine_um = scope.wavelength_um / scope.aperture
        return fine_um + scope.blur_diameter_um(off_um) / 2

    def line_at(self, share: float) -> float:
        """Return where lines of edges lie in a trial: nobody knows it of a ring's."""
        return MIDDLE if self.ring is None else float(share)

    @property
    def shares_still_layers(self) -> bool:
        """Return whether the static scene is blurred alike wherever the target is."""
        return self.treatment != "occluded" and not self.lens.changes_scene

    @property
    def shares_spectra(self) -> bool:
        """Return whether images at several focus heights come from the same spectra.

        Bodies of several heights hide the same rays, and walls some of those past their
        tops: that is another sum each time.
        """
        layers = (*self.static, *self.moving)
        heights = {layer.z_um for layer in layers}
        is_even = self.lamp_aperture is None and len(heights) <= 1
        is_even = is_even and not is_solid(layers) and self.ring is None
        is_even = is_even and not is_clear(layers)
        return self.shares_still_layers and is_even

    def zoomed(self, ratio: float) -> Microscope:
        """Return the microscope at so many times the nominal magnification."""
        magnification = self.microscope.magnification * ratio
        return replace(self.microscope, magnification=magnification)

    def lit(self, gain: float, gradient_x: float, gradient_y: float) -> Illumination:
        """Return the light with its gain multiplied and gradients added."""
        return Illumination(
            gain=self.light.gain * gain,
            gradient_x=self.light.gradient_x + gradient_x,
            gradient_y=self.light.gradient_y + gradient_y,
        )

    @property
    def frame(self) -> RegionFrame:
        """Return the nominal map from pixels of the region to the world."""
        return RegionFrame(
            width_px=self.microscope.width_px,
            height_px=self.microscope.height_px,
            um_per_px=self.microscope.um_per_px,
            row=self.window.row,
            column=self.window.column,
        )


@dataclass(frozen=True, slots=True)
class Backdrop:
    """Layers blurred at one focus and zoom, and the light that they leave."""

    layers: tuple[Covered, ...] = ()
    under: tuple[Irradiance, ...] | None = None  # None: computed with the image

    def with_(self, other: Backdrop) -> Backdrop:
        """Return the layers of both, and the light under all of them."""
        if not self.layers:
            return other
        under = None
        if self.under is not None and other.under is not None:
            pairs = zip(self.under, other.under, strict=True)
            under = tuple(one.with_(more) for one, more in pairs)
        return Backdrop(self.layers + other.layers, under)


def scene(case: LookCase, dx_um: float, dy_um: float, dtheta_rad: float) -> Scene:
    """Return the case's scene with the target displaced in the world frame.

    Parameters
    ----------
    case : LookCase
        The look.
    dx_um, dy_um : float
        Displacement of the target's reference point, world axes, um.
    dtheta_rad : float
        Rotation of the target about its reference point.
    """
    moved = moved_layers(case, dx_um, dy_um, dtheta_rad)
    return Scene(
        layers=case.static + moved,
        background=case.background,
        background_z_um=case.background_z_um,
    )


def moved_layers(
    case: LookCase, dx_um: float, dy_um: float, dtheta_rad: float
) -> tuple[Layer, ...]:
    """Return the layers that move with the target, displaced as in `scene`."""
    x, y = case.x_um + dx_um, case.y_um + dy_um
    return tuple(
        replace(layer, outline=place(layer.outline, x, y, case.theta_rad + dtheta_rad))
        for layer in case.moving
    )


def render_look(
    case: LookCase,
    moved: Sequence[Layer],
    backdrop: Backdrop,
) -> FloatArray:
    """Return the region without noise, (rows, columns), 1 at full scale.

    As the case's fidelity has it.

    Parameters
    ----------
    case : LookCase
        The look, perturbed or not.
    moved : sequence of Layer
        The target's layers in the world, see `moved_layers`.
    backdrop : Backdrop
        The static scene of this look.
    """
    if case.shares_still_layers:
        layers, also = tuple(moved), backdrop.layers
    else:
        layers, also = case.static + tuple(moved), ()
    shown = Scene(
        layers=layers,
        background=case.background,
        background_z_um=case.background_z_um,
    )
    shown = lens_scene(shown, case.microscope, case.lens, case.focus_um)
    if case.treatment == "occluded":
        return occluded(
            shown,
            case.microscope,
            focus_um=case.focus_um,
            model=case.model,
            window=case.window,
            light=case.light,
            lamp_aperture=case.lamp_aperture,
        )
    return render_lit(
        shown,
        case.microscope,
        focus_um=case.focus_um,
        lamp_aperture=case.lamp_aperture,
        ring=case.ring,
        line=case.line,
        model=case.model,
        window=case.window,
        light=case.light,
        also=also,
        under=backdrop.under if also else None,
        sampling=case.sampling,
    )
