"""Adhesion of small parts: weight, four forces as intervals, never one number.

Faces touch at their roughest points. The least pull is that of three steep asperities
on bare faces that repel water and hold no charge. The greatest is that of blunt ones
with the whole face at one roughness away (van der Waals, contact potential), of a round
meniscus as wide as the face, or of a flooded gap where the air is humid enough
(capillary), or of the field at which air breaks down (charge). Geometry alone does not
decide where real parts lie.

References
----------
Fearing (1995), Survey of sticking effects for micro parts handling: below a millimetre
these forces exceed weight. Every formula is derived where it is used, and again in
the tests; constants that are not derived are from:
Yang et al. (2020), Capillary condensation under atomic-scale confinement, Nature, eq.
(1): the humidity that fills a slit.
Peschot et al. (2014), Deviations from the Paschen's law at short gap distances from 100
nm to 10 um in air and nitrogen: 350 V/um in gaps below 1 um. The least voltage of
Paschen's law in air is 327 V, at 7.5 um.
Riviere (1957), Contact potential difference measurements by the Kelvin method: work
functions of clean metals from 4.17 eV (iron) to 4.74 eV (nickel). Gold and aluminium
are about 1 V apart under a Kelvin probe.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from microplan.planner.task.task import Environment, Part, Task
from microplan.schemas.plan.verdicts import Force

Bounds = tuple[float, float]

# um/s2; kg um/s2 is uN
GRAVITY_UM_PER_S2 = 9.81e6
# kg/m3 of solid bodies; what is not named may be anything from a polymer to platinum
DENSITY: dict[str, float] = {
    "nickel": 8900.0, "silicon": 2330.0, "gold": 19300.0, "copper": 8960.0,
    "silica": 2200.0, "glass": 2500.0, "steel": 7850.0, "aluminium": 2700.0,
    "su-8": 1200.0, "gaas": 5320.0, "gallium arsenide": 5320.0, "diamond": 3510.0,
}  # fmt: skip
UNKNOWN_DENSITY: Bounds = (900.0, 21500.0)
# Metals and doped semiconductors: a charge leaves them where they touch earthed ones.
CONDUCTORS = frozenset(
    ("nickel", "silicon", "gold", "copper", "steel", "aluminium", "gaas",
     "gallium arsenide")
)  # fmt: skip
# Gases have less, liquids more: water 1.33, the least of organic liquids 1.25.
LIQUID_INDEX = 1.1


def weight_un(material: str, volume_um3: float, *, medium_index: float = 1.0) -> Bounds:
    """Return the least and greatest weight of a part, uN.

    In a liquid, whose density is not specified, buoyancy may take all of it.
    """
    known = DENSITY.get(_named(material))
    low, high = UNKNOWN_DENSITY if known is None else (known, known)
    per = volume_um3 * 1e-18 * GRAVITY_UM_PER_S2
    return (0.0 if in_liquid(medium_index) else low * per), high * per


def volume_um3(part: Part) -> float:
    """Return the volume of a part with its posts."""
    posts = sum(p.outline.area_um2 * p.height_um for p in part.posts.values())
    return part.outline.area_um2 * part.thickness_um + posts


def conducts(material: str) -> bool:
    """Return whether a material is known to let charge flow; unnamed ones may not."""
    return _named(material) in CONDUCTORS


def in_liquid(medium_index: float) -> bool:
    """Return whether a medium of that refractive index is a liquid."""
    return medium_index > LIQUID_INDEX


def _named(material: str) -> str:
    return material.strip().lower()


ASPERITIES = 3  # on which one rigid face rests on another
# Distance of two bodies at contact: surface tension is A / (24 pi D0**2) with it.
CONTACT_UM = 0.165e-3
# 0.5 to 4e-19 J in air: 3 h / (4 pi) times the integral of ((eps - 1) / (eps + 1))**2
# over frequency is 0.5 for an insulator of index 1.42 that absorbs at 3e15 Hz, 3.3 for
# free electrons with the plasma energy of aluminium, 15.3 eV.
HAMAKER_UN_UM = (0.5e-7, 4e-7)
ZJ = 1e9  # in a uN um
TENSION_UN_PER_UM = 0.0728  # of water at 20 C
# A slit of this width over ln(1 / humidity) fills: 2 gamma V / (R T), V = 18.07 ml/mol.
SLIT_UM = 1.08e-3
DRY = 0.025  # relative humidity at which that is a molecule of water, 0.3 nm
PERMITTIVITY_UN_PER_V2 = 8.854e-6  # F/m is N/V**2
PASCHEN_V = 327.0  # least voltage at which air breaks down, over PASCHEN_UM
PASCHEN_UM = 7.5
EMISSION_V_PER_UM = 350.0  # field at which gaps below 1 um break down
POTENTIAL_V = 1.0  # between unlike bare metals, at most
# Least slope of an asperity, rms: a sinusoid of rms height s and rms slope m has crests
# of radius s / (sqrt(2) m**2). As round as high, s, it has 0.84, the other end.
SLOPE = 0.1
BLUNT = 1 / (math.sqrt(2) * SLOPE**2)
STEEP_UM = 0.5  # higher asperities are rough themselves: no larger radius is certain

Sticks = Literal["stays", "may stick", "will stick"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactFace:
    """Where two bodies touch."""

    area_um2: float
    conducts: bool = False  # both sides let charge flow
    liquid: bool = False  # what is around them

    @property
    def radius_um(self) -> float:
        """Return the radius of a disc of that area."""
        return math.sqrt(self.area_um2 / math.pi)


def forces(face: ContactFace, environment: Environment) -> tuple[Force, ...]:
    """Return the four forces that pull on a face, each with its validity.

    Parameters
    ----------
    face : ContactFace
        Area over which the bodies face each other, and in what.
    environment : Environment
        Humidity, charge, roughness.

    Returns
    -------
    tuple of Force
        Normal to the face, uN; a force that is ruled out is (0, 0).
    """
    rough_nm, humid = 1e3 * environment.roughness_um, environment.humidity
    rough = f"rms roughness {rough_nm:.3g} nm"
    free = environment.grounded and face.conducts
    air = "; as in air, double layers are not modelled" if face.liquid else ""
    return (
        _force(
            "van der Waals",
            _waals(face, environment.roughness_um),
            f"{rough}, rms slope of asperities {SLOPE:g}..0.84, rigid faces, Hamaker "
            f"constant {ZJ * HAMAKER_UN_UM[0]:g}..{ZJ * HAMAKER_UN_UM[1]:g} zJ"
            + (", any in a liquid" if face.liquid else ""),
        ),
        _force(
            "capillary",
            _capillary(face, environment),
            "no meniscus in a liquid"
            if face.liquid
            else f"{rough}; water at relative humidity {humid:g}, from {DRY:g} on; "
            "none where faces repel it",
        ),
        _force(
            "charge",
            (0.0, 0.0 if free else _charged(face)),
            "earthed conductors hold none"
            if free
            else f"up to {_breakdown_v_per_um(face):.3g} V/um, at which air breaks "
            "down; not earthed, or not known to conduct" + air,
        ),
        _force(
            "contact potential",
            (0.0, _potential(face, environment.roughness_um)),
            f"{rough}; none between like metals, up to {POTENTIAL_V:g} V between "
            "unlike ones" + air,
        ),
    )


def part_forces(task: Task, area_um2: float, names: Iterable[str]) -> tuple[Force, ...]:
    """Return the forces on a face of parts; fingers and stage are taken to conduct."""
    face = ContactFace(
        area_um2=area_um2,
        conducts=all(conducts(task.parts[name].material) for name in names),
        liquid=in_liquid(task.workcell.optics.medium_index),
    )
    return forces(face, task.environment)


def part_weight_un(task: Task, part: Part) -> Bounds:
    """Return the least and greatest weight of a part with its posts, uN."""
    index = task.workcell.optics.medium_index
    return weight_un(part.material, volume_um3(part), medium_index=index)


def total(found: tuple[Force, ...]) -> Bounds:
    """Return the sum of forces that act together."""
    return sum(f.least_un for f in found), sum(f.most_un for f in found)


def verdict(pull_un: Bounds, hold_un: Bounds) -> Sticks:
    """Return whether a part follows what pulls it away from what holds it.

    `will stick` only where even the least pull beats the greatest hold, `stays` only
    where the greatest does not beat the least.
    """
    if pull_un[0] > hold_un[1]:
        return "will stick"
    return "stays" if pull_un[1] <= hold_un[0] else "may stick"


def _force(name: str, bounds: Bounds, validity: str) -> Force:
    return Force(name=name, least_un=bounds[0], most_un=bounds[1], validity=validity)


def _gap_um(rough_um: float) -> float:
    """Return how far apart the faces are, but for their asperities."""
    return max(rough_um, CONTACT_UM)


def _waals(face: ContactFace, rough_um: float) -> Bounds:
    """Return steep asperities alone, and blunt ones with the whole face behind them.

    A pair potential -C / r**6 over two half spaces gives A / (6 pi D**3) per area, A =
    pi**2 C n1 n2; over a sphere near one A R / (6 D**2). Asperities and what lies
    behind them add up, as in Rumpf's model of a rough plane.
    """
    steep = _at_contact(HAMAKER_UN_UM[0], min(rough_um, STEEP_UM, face.radius_um))
    blunt = _at_contact(HAMAKER_UN_UM[1], min(BLUNT * rough_um, face.radius_um))
    behind = HAMAKER_UN_UM[1] * face.area_um2 / (6 * math.pi * _gap_um(rough_um) ** 3)
    # a liquid takes from the constant all there is, where it is like the bodies
    return (0.0 if face.liquid else steep), blunt + behind


def _at_contact(hamaker_un_um: float, radius_um: float) -> float:
    """Return the pull of the asperities on a plane."""
    return ASPERITIES * hamaker_un_um * radius_um / (6 * CONTACT_UM**2)


def _capillary(face: ContactFace, environment: Environment) -> Bounds:
    """Return no meniscus, and the strongest there may be.

    Round bodies: a meniscus of radius r wets 4 pi R r of a sphere at gamma / r, which
    makes 4 pi R gamma whatever r. Flat ones, where the gap fills: a meniscus as wide as
    the gap h pulls with 2 gamma / h.
    """
    humidity, rough_um = environment.humidity, environment.roughness_um
    if face.liquid or humidity < DRY:
        return 0.0, 0.0
    blunt = ASPERITIES * min(BLUNT * rough_um, face.radius_um)
    most = 4 * math.pi * TENSION_UN_PER_UM * max(blunt, face.radius_um)
    gap_um = _gap_um(rough_um)
    if gap_um * math.log(1 / humidity) <= SLIT_UM:
        most = max(most, 2 * TENSION_UN_PER_UM / gap_um * face.area_um2)
    return 0.0, most


def _breakdown_v_per_um(face: ContactFace) -> float:
    """Return the largest field that a charged face keeps while it comes near.

    The gap it crosses breaks down at 327 V at least, the width of the face is the
    largest that counts: farther away the field spreads. Between 350 V/um and the
    Paschen minimum the voltage is that of the minimum.
    """
    across = min(2 * face.radius_um, PASCHEN_UM)
    return min(EMISSION_V_PER_UM, PASCHEN_V / across) if across else EMISSION_V_PER_UM


def _charged(face: ContactFace) -> float:
    """Return the pull of that field: sigma**2 / (2 eps0) with sigma = eps0 E."""
    field = _breakdown_v_per_um(face)
    return PERMITTIVITY_UN_PER_V2 * field**2 / 2 * face.area_um2


def _potential(face: ContactFace, rough_um: float) -> float:
    """Return the pull of a plate capacitor one roughness wide, V**2 dC/dd / 2."""
    field = POTENTIAL_V / _gap_um(rough_um)
    return PERMITTIVITY_UN_PER_V2 * field**2 / 2 * face.area_um2
