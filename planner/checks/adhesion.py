"""What makes a small part stick: four forces as intervals, never one number.

Surfaces touch at their roughest points: the least force is that of three round
asperities as high as the roughness, the greatest that of the whole face at one
roughness away (van der Waals, contact potential), of one round body as wide as the
face (capillary), or of the field at which air breaks down (charge). Real parts lie
between, an order of magnitude either way; geometry alone cannot tell where.

References
----------
Israelachvili (2011), Intermolecular and Surface Forces, 3rd ed.: sphere and plane at
contact A R / (6 D0**2) and planes A / (6 pi D**3) (table 13.3), D0 = 0.165 nm,
capillary 4 pi R gamma cos(theta) (chapter 17), the Kelvin radius.
Rumpf (1990), Particle Technology: asperity and body behind it add up.
Fearing (1995), IROS, 212-217: a survey of sticking effects for micro parts: forces by
charge and contact potential, which are below 0.5 V.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from planner.inputs.task import Environment
from schemas.verdicts import Force

Bounds = tuple[float, float]

ASPERITIES = 3  # on which one rigid face rests on another
CONTACT_UM = 0.165e-3  # D0
HAMAKER_UN_UM = (0.5e-7, 4e-7)  # 0.5..4e-19 J: oxides to metals in air
TENSION_UN_PER_UM = 0.0728  # of water at 20 C
WETTING = (0.5, 1.0)  # cos(theta) of what is not made to repel water
DRY = 0.05  # relative humidity below which no meniscus forms
PERMITTIVITY_UN_PER_V2 = 8.854e-6  # F/m is N/V**2
BREAKDOWN_V_PER_UM = 30.0  # of gaps of some micrometres; 3 V/um in wide ones
POTENTIAL_V = (0.05, 0.5)
# Roughness for which the formulas hold: below, faces are atomically smooth and cling by
# area; above, asperities are no small part of the face.
ROUGHNESS_UM = (0.002, 0.5)
GRAVITY_UM_PER_S2 = 9.81e6
# kg/m3; what is not named may be anything from a polymer to platinum
DENSITY: dict[str, float] = {
    "nickel": 8900.0, "silicon": 2330.0, "gold": 19300.0, "copper": 8960.0,
    "silica": 2200.0, "glass": 2500.0, "steel": 7850.0, "aluminium": 2700.0,
    "su-8": 1200.0, "gaas": 5320.0, "diamond": 3510.0,
}  # fmt: skip
UNKNOWN_DENSITY: Bounds = (900.0, 21500.0)
UN_PER_KG_UM_PER_S2 = 1.0  # kg um/s2 is uN

Sticks = Literal["stays", "may stick", "will stick"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Face:
    """Where two bodies touch."""

    area_um2: float

    @property
    def radius_um(self) -> float:
        """Return the radius of a disc of that area."""
        return math.sqrt(self.area_um2 / math.pi)


def weight_un(material: str, volume_um3: float) -> Bounds:
    """Return the least and greatest weight of a part, uN."""
    known = DENSITY.get(material.strip().lower())
    low, high = UNKNOWN_DENSITY if known is None else (known, known)
    per = volume_um3 * 1e-18 * GRAVITY_UM_PER_S2 * UN_PER_KG_UM_PER_S2
    return low * per, high * per


def forces(face: Face, environment: Environment) -> tuple[Force, ...]:
    """Return the four forces that pull on a face, each with its validity.

    Parameters
    ----------
    face : Face
        Area over which the bodies face each other.
    environment : Environment
        Humidity, charge, roughness.

    Returns
    -------
    tuple of Force
        Normal to the face, uN; a force that is ruled out is (0, 0).
    """
    rough = min(max(environment.roughness_um, ROUGHNESS_UM[0]), ROUGHNESS_UM[1])
    valid = (
        f"rms roughness {1e3 * ROUGHNESS_UM[0]:g}..{1e3 * ROUGHNESS_UM[1]:g} nm, taken "
        f"as {1e3 * rough:.3g} nm"
    )
    return (
        _force("van der Waals", _waals(face, rough), f"{valid}; rigid faces"),
        _force(
            "capillary",
            _capillary(face, rough, environment.humidity),
            f"{valid}; water, from {DRY:g} relative humidity on, taken as "
            f"{environment.humidity:g}",
        ),
        _force(
            "charge",
            _charge(face, grounded=environment.grounded),
            f"up to {BREAKDOWN_V_PER_UM:g} V/um over the face; "
            + ("grounded conductors hold none" if environment.grounded else "floating"),
        ),
        _force(
            "contact potential",
            _potential(face, rough),
            f"{valid}; {POTENTIAL_V[0]:g}..{POTENTIAL_V[1]:g} V between bare metals",
        ),
    )


def total(found: tuple[Force, ...]) -> Bounds:
    """Return the sum of forces that act together."""
    return sum(f.least_un for f in found), sum(f.most_un for f in found)


def verdict(pull_un: Bounds, hold_un: Bounds) -> Sticks:
    """Return whether a part follows what pulls it away from what holds it.

    `will stick` only where even the least pull beats the greatest hold, `stays` only
    where the greatest does not.
    """
    if pull_un[0] > hold_un[1]:
        return "will stick"
    return "stays" if pull_un[1] <= hold_un[0] else "may stick"


def _force(name: str, bounds: Bounds, validity: str) -> Force:
    return Force(name=name, least_un=bounds[0], most_un=bounds[1], validity=validity)


def _waals(face: Face, rough_um: float) -> Bounds:
    """Return asperities alone, and with the whole face behind them."""
    points = [_at_contact(a, min(rough_um, face.radius_um)) for a in HAMAKER_UN_UM]
    behind = HAMAKER_UN_UM[1] * face.area_um2 / (6 * math.pi * rough_um**3)
    return points[0], points[1] + behind


def _at_contact(hamaker_un_um: float, radius_um: float) -> float:
    """Return the pull of the asperities on a plane."""
    return ASPERITIES * hamaker_un_um * radius_um / (6 * CONTACT_UM**2)


def _capillary(face: Face, rough_um: float, humidity: float) -> Bounds:
    """Return menisci about asperities, and one about a body as wide as the face."""
    if humidity < DRY:
        return 0.0, 0.0
    per = 4 * math.pi * TENSION_UN_PER_UM
    small = min(rough_um, face.radius_um)
    low = ASPERITIES * per * WETTING[0] * small
    return low, max(low, per * WETTING[1] * face.radius_um)


def _charge(face: Face, *, grounded: bool) -> Bounds:
    """Return the pull of the largest field that air stands."""
    if grounded:
        return 0.0, 0.0
    return 0.0, PERMITTIVITY_UN_PER_V2 * BREAKDOWN_V_PER_UM**2 / 2 * face.area_um2


def _potential(face: Face, rough_um: float) -> Bounds:
    """Return the pull of two plates: asperities apart, or one roughness apart."""
    small = math.pi * min(rough_um, face.radius_um) ** 2 * ASPERITIES
    areas = (min(small, face.area_um2), face.area_um2)
    low, high = (
        PERMITTIVITY_UN_PER_V2 * volts**2 * area / (2 * rough_um**2)
        for volts, area in zip(POTENTIAL_V, areas, strict=True)
    )
    return low, max(low, high)
