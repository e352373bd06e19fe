"""Lens of the simulated cell: zoom, focus, a new error after each move."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from microplan.executor.simulated.imaging.imaging_view import TrueLensErrors
from microplan.executor.simulated.timeline import DelayedDevice, DeviceFaults, Timeline
from microplan.schemas.files.world import WorldLens

MAX_DISTORTION = 0.25  # relative at the corner; a third would fold the field over
_MOST_SINE = 0.999  # of the marginal ray
LIMIT_DIGITS = 1e-5  # relative: a plan's numbers carry six digits


class SimLens(DelayedDevice):
    """Zoom and focus: each move lands a little elsewhere; faults begin with `lens_`."""

    def __init__(
        self,
        timeline: Timeline,
        rngs: tuple[np.random.Generator, np.random.Generator],  # zoom, focus
        lateral: tuple[float, float],
        errors: TrueLensErrors,
        trouble: DeviceFaults,
    ) -> None:
        super().__init__(timeline, trouble)
        self.model, self.serial = "simulated lens", "sim-lens"
        self.optics = timeline.truth.world.optics
        self._zoom_rng, self._focus_rng = rngs
        self._lateral = lateral  # um sideways per um of focus
        self.errors = errors
        self.magnification = self.optics.magnification[0]
        self.focus_um = 0.0
        self._jump = (0.0, 0.0)
        self._commanded = (self.magnification, 0.0)
        self._target = ("focus_um", 0.0)

    def start_magnification(self, magnification: float) -> None:
        """Zoom: the image jumps and the scale is off by a new amount."""
        self._check("magnification", magnification, self.optics.magnification)
        self._order(self.optics.zoom_time_s, "magnification", magnification)

    def start_focus_um(self, focus_um: float) -> None:
        """Focus, with its repeatability."""
        self._check("focus_um", focus_um, self.optics.focus_um)
        self._order(self.optics.focus_time_s, "focus_um", focus_um)

    def set_magnification(self, magnification: float) -> None:
        """Zoom, and let the cell's time pass until it is done."""
        self.start_magnification(magnification)
        self._timeline.run_out(self.motion)

    def set_focus_um(self, focus_um: float) -> None:
        """Focus, and let the cell's time pass until it is done."""
        self.start_focus_um(focus_um)
        self._timeline.run_out(self.motion)

    def reading(self) -> tuple[float, float]:
        """Return the commands: the drives do not see their errors."""
        if self.motion.pending():
            self._trouble.hang("hangs")
            if self._trouble.on("nan"):
                return (math.nan, self._commanded[1])
        return self._commanded

    def state(self) -> dict[str, Any]:
        """Return commands, what they came to, and the motion under way."""
        return {
            "commanded": self._commanded,
            "magnification": self.magnification,
            "focus_um": self.focus_um,
            "jump_um": self._jump,
            "target": self._target,
            "left_s": self.motion.left_s(),
        }

    def restore(self, data: Mapping[str, Any]) -> None:
        """Be where `state` says."""
        self._commanded = _pair(data["commanded"])
        self.magnification, self.focus_um = data["magnification"], data["focus_um"]
        self._jump = _pair(data["jump_um"])
        name, value = data["target"]
        self._target = (name, value)
        if data["left_s"] is not None:
            self._begin(data["left_s"], name, value)

    @property
    def commanded(self) -> tuple[float, float]:
        """Return the magnification and focus, um, that were asked for last."""
        return self._commanded

    @property
    def shift_um(self) -> tuple[float, float]:
        """Return the shift of the whole image, um."""
        x, y = self._lateral
        return (self._jump[0] + x * self.focus_um, self._jump[1] + y * self.focus_um)

    @property
    def aperture(self) -> float:
        """Return the true aperture at the zoom that was set."""
        zoom, aperture = np.log(np.array(self.optics.apertures)).T
        stated = math.exp(np.interp(math.log(self._commanded[0]), zoom, aperture))
        return min(stated, _MOST_SINE * self.optics.medium_index)

    def _check(self, name: str, value: float, within: tuple[float, float]) -> None:
        """Refuse what the drive cannot reach; limits come in six digits."""
        slack = LIMIT_DIGITS * max(abs(v) for v in within)
        if not within[0] - slack <= value <= within[1] + slack:  # also refuses nan
            raise ValueError(f"{name} = {value:g} is outside {within[0]}..{within[1]}")

    def _order(self, seconds: float, name: str, value: float) -> None:
        """Take the order to zoom or to focus."""
        self._trouble.refuse("raises")
        self._begin(math.inf if self._trouble.on("stuck") else seconds, name, value)
        self._timeline.changed()

    def _begin(self, seconds: float, name: str, value: float) -> None:
        """Begin a motion that changes the lens when it ends."""
        self._target = (name, value)
        arrive = self._zoomed if name == "magnification" else self._focused
        self.motion.begin(seconds, lambda: arrive(value))

    def _zoomed(self, magnification: float) -> None:
        """Be at a new zoom: the image jumps and the scale is off by a new amount."""
        scale, x, y = self._zoom_rng.standard_normal(3)
        self._commanded = (magnification, self._commanded[1])
        self.magnification = magnification * (1 + self.optics.scale_sigma * scale)
        sigma_um = self.optics.parcentric_sigma_um
        self._jump = (sigma_um * x, sigma_um * y)

    def _focused(self, focus_um: float) -> None:
        """Be at a new focus, with its repeatability."""
        error = self._focus_rng.standard_normal()
        self._commanded = (self._commanded[0], focus_um)
        self.focus_um = focus_um + self.optics.focus_repeatability_um * error


def _pair(values: Sequence[float]) -> tuple[float, float]:
    """Return two numbers of a list."""
    return (values[0], values[1])


def drawn_errors(lens: WorldLens, rng: np.random.Generator) -> TrueLensErrors:
    """Return the true errors of the lens: the known part and a draw of the unknown."""
    distortion, scale, curvature = rng.standard_normal(3)
    true = lens.distortion + lens.distortion_sigma * distortion
    return TrueLensErrors(
        distortion=max(min(true, MAX_DISTORTION), -MAX_DISTORTION),
        lateral_x=lens.lateral_um_per_um[0],
        lateral_y=lens.lateral_um_per_um[1],
        scale_per_um=lens.scale_per_um + lens.scale_sigma_per_um * scale,
        field_curvature_per_um=lens.field_curvature_per_um
        + lens.field_curvature_sigma_per_um * curvature,
    )
