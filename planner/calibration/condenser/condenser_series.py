"""Condenser settings of a known part: coherence and edge offset as workcell lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.planner.calibration.calibrated_value import (
    CalibratedValue,
    CalibrationCurve,
    CalibrationSeries,
    PictureSource,
    single,
)
from microplan.planner.calibration.condenser.coherent_profiles import (
    LEAST,
    MOST,
    CoherentProfiles,
    coherent_profiles,
    tells_sides,
)
from microplan.planner.calibration.condenser.condenser_fit import (
    TAKE,
    AtEnd,
    CondenserFit,
    CondenserLook,
    fit_condenser,
    unfit_settings,
)
from microplan.planner.calibration.condenser.condenser_words import (
    condenser_words,
    stated_doubts,
)
from microplan.planner.calibration.condenser.edge_mean import edge_mean, tells_scale
from microplan.planner.calibration.estimates import BlockEstimate, Refused
from microplan.planner.calibration.geometry.part_finder import PartFinder
from microplan.planner.calibration.picture_intake import CODE, PictureIntake
from microplan.planner.calibration.readings import (
    PictureReading,
    PictureReadings,
    readings_of_pages,
)
from microplan.planner.calibration.through_focus.edge_profile import (
    EdgePoints,
    across_px,
    points_seen,
)
from microplan.planner.measure.measuring import MeasuredPicture
from microplan.planner.source.diagnostics import Report, Span

# times the settings as read, either way: coherence that is tried, first and then
_BEYOND = (1.25, 2.0)
_WHERE = ("optics", "coherence")
_COAXIAL = "coaxial"
_WHITE = 0.998  # of full scale: a pixel that reaches it is cut off
_CUT = 0.001  # of pixels, that a few odd ones have
_STILL_PX = 1.5  # that a part at one place moves between settings
_SIDES = "a defocus counts alike on both sides: by the wavefront that the workcell "
_SIDES += "states they differ, and the side of focus is left out"


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedCondenser:
    """What a workcell states of its light, and of what makes counts of it."""

    kind: str  # of light
    lacks: str  # what makes light of counts and is not stated, in words; "": nothing
    coherence: float | None  # None: none, or an interval

    def tells(self, readings: PictureReadings, report: Report) -> bool:
        """Return whether pictures may tell a coherence; else report why not."""
        message, hint = self._lacking()
        if not message:
            apertures = [row.condenser_aperture or 0.0 for row in readings.rows]
            refused = unfit_settings(apertures)
            if refused is not None:
                message = f"no {refused.what}: {refused.why}"
                hint = f"photograph {refused.take}"
        if message:
            report.error(CODE, Span(file=str(readings.file)), message, hint)
        return not message

    def _lacking(self) -> tuple[str, str]:
        """Return what the workcell lacks, and what to do; "" if nothing."""
        if self.kind != _COAXIAL:
            why = f"light.kind is {self.kind}: its condenser is not the objective"
            return f"no coherence: {why}", "coaxial light alone is told by settings"
        if not self.lacks:
            return "", ""
        why = f"the workcell states {self.lacks}: counts that are not "
        why += "proportional to light look like another coherence"
        return f"no coherence: {why}", "calibrate with a series of lights first"


def condenser_settings(
    readings: PictureReadings,
    finder: PartFinder,
    intake: PictureIntake,
    stated: StatedCondenser,
) -> CalibrationSeries | None:
    """Return what a part at several settings of the condenser tells, None if nothing.

    Parameters
    ----------
    readings : PictureReadings
        With the condenser's numerical aperture of each picture, of which three digits
        count; places by stage readings and groups. The first row's setting is that of
        the workcell.
    finder : PartFinder
        Of these pictures.
    intake : PictureIntake
        New; its report receives MP901, MP904 and MP905.
    stated : StatedCondenser
        By the workcell.
    """
    report, where = intake.report, Span(file=str(readings.file))
    points, aperture = _points(finder), finder.series.look.case.microscope.aperture
    if points is None:
        message = "the first picture in which it is found shows too few of its edges"
        report.error(CODE, where, message, "is it whole, in focus, and alone?")
        return None
    looks = _looks(readings, finder, intake, points)
    if report.failed or not intake.fits(0, where):
        return None
    setting = _setting(readings.rows[0], aperture)
    told = _fitted(points, finder, looks, setting)
    if isinstance(told, Refused):
        hint = f"photograph {told.take}"
        report.error(CODE, where, f"no {told.what}: {told.why}", hint)
        return None
    found, table = told
    stated_doubts(found, aperture, where, report)
    read, scaled = setting * aperture, tells_scale(points)
    um_per_px = points.case.microscope.um_per_px
    source = intake.source()
    return CalibrationSeries(
        heading=f"coherence in {source.pictures} pictures at {len(found.settings)} "
        "settings of the condenser",
        values=(
            single(
                "coherence", found.coherence(setting), source,
                where=_WHERE, stated=stated.coherence,
            ),
            *_by_setting(found, aperture, source),
            _offset(found, um_per_px, source),
        ),
        notes=(
            *condenser_words(found, read, scaled=scaled),
            *([_SIDES] if tells_sides(points.case.microscope) else []),
        ),
        curves=_curves(found, looks, table, aperture),
    )  # fmt: skip


def _points(finder: PartFinder) -> EdgePoints | None:
    """Return the edges that the picture shows in which the part was found."""
    first = finder.first
    case = first.region.case
    theta = case.target.theta_rad + first.pose[2]
    return points_seen(case, first.shown, first.at_px, theta)


def _looks(
    readings: PictureReadings,
    finder: PartFinder,
    intake: PictureIntake,
    points: EdgePoints,
) -> list[CondenserLook]:
    """Return the mean profile of each place and setting; frames are one picture."""
    aperture = finder.series.look.case.microscope.aperture
    held: dict[tuple[str, float], list[FloatArray]] = {}
    spots: dict[str, list[tuple[float, float]]] = {}
    for row, page in readings_of_pages(readings, intake):
        seen = finder.found_in(page)
        profile = _mean(points, seen) if isinstance(seen, MeasuredPicture) else None
        if profile is None or not isinstance(seen, MeasuredPicture):
            message = f"{page.name} does not show the part's edges"
            hint = "is it whole in the field, and in focus?"
            intake.report.warning(CODE, Span(file=str(page.path)), message, hint)
            continue
        if (cut := float(np.mean(seen.shown >= _WHITE))) > _CUT:
            message = f"{page.name} is saturated in {cut:.1%} of what is about the part"
            message += ": edges look like another coherence"
            hint = "take it again with less light"
            intake.report.error(CODE, Span(file=str(page.path)), message, hint)
            continue
        spots.setdefault(_place(row), []).append(seen.at_px)
        setting = _setting(row, aperture)
        held.setdefault((_place(row), setting), []).append(profile)
    if any(np.ptp(at, axis=0).max() > _STILL_PX for at in spots.values()):
        message = "the part moves between pictures that are of one place by the table"
        hint = "state x_um and y_um, or a group, of each place"
        intake.report.warning(CODE, Span(file=str(readings.file)), message, hint)
    return [
        CondenserLook(place=place, setting=s, profile=np.mean(profiles, axis=0))
        for (place, s), profiles in held.items()
    ]


def _mean(points: EdgePoints, seen: MeasuredPicture) -> FloatArray | None:
    """Return the mean profile across edges, (L,); None if a picture lacks them."""
    if seen.failure:
        return None
    theta = seen.region.case.target.theta_rad + seen.pose[2]
    return edge_mean(replace(points, theta_rad=theta), seen.shown, seen.at_px)


def _setting(row: PictureReading, aperture: float) -> float:
    """Return a condenser's aperture, three digits as read, over the objective's."""
    return float(f"{row.condenser_aperture or 0.0:.3g}") / aperture


def _place(row: PictureReading) -> str:
    """Return what tells a place from others."""
    return f"{row.x_um:g} {row.y_um:g} {row.group}"


def _fitted(
    points: EdgePoints,
    finder: PartFinder,
    looks: Sequence[CondenserLook],
    first: float,
) -> tuple[CondenserFit, CoherentProfiles] | Refused:
    """Return what pictures tell with the images' profiles about it, or why not.

    `first`: the setting that is the workcell's.
    """
    settings = sorted({look.setting for look in looks})
    refused = unfit_settings(settings) or _beyond(settings, first)
    if refused is not None:
        return refused
    found: CondenserFit | Refused | None = None
    for times in _BEYOND:
        within = settings[0] / times, min(settings[-1] * times, MOST)
        table = coherent_profiles(points, finder.first.pose, within)
        found = None if table is None else fit_condenser(looks, table)
        if table is not None and isinstance(found, CondenserFit):
            return found, table
        if not isinstance(found, AtEnd):
            break
    if isinstance(found, Refused):
        return found
    why = "the part's edges leave the images that they are held against"
    return Refused(what="coherence", why=why, take="it farther from the border")


def _beyond(settings: Sequence[float], first: float) -> Refused | None:
    """Return why settings, rising, cannot be held against images; None if they can."""
    why = ""
    if first not in settings:
        why = "the first row's setting is the workcell's, and no picture of it is left"
    elif settings[0] < LEAST:
        why = f"a setting means {settings[0]:.3g}, {LEAST:g} is the least that is told"
    elif settings[-1] >= MOST:
        why = f"a setting means {settings[-1]:.3g}, only below {MOST:g} it is told"
    return Refused(what="coherence", why=why, take=TAKE) if why else None


def _by_setting(
    fit: CondenserFit, aperture: float, source: PictureSource
) -> list[CalibratedValue]:
    """Return the coherence of each setting, named by the condenser as read."""
    found = []
    for setting in fit.settings:  # names have no point
        read = f"{setting * aperture:.4g}".replace(".", "_")
        found.append(single(f"coherence_at_{read}", fit.coherence(setting), source))
    return found


def _offset(
    fit: CondenserFit, um_per_px: float, source: PictureSource
) -> CalibratedValue:
    """Return the offset of the part's own edges, without what coherence moves."""
    px = fit.offset_px
    found = BlockEstimate(
        value=px.value * um_per_px,
        sigma=None if px.sigma is None else px.sigma * um_per_px,
        method=f"edges of the part itself, outwards from those drawn; {px.method}",
        blocks=px.blocks,
    )
    return single("own_edge_offset_um", found, source, unit="um")


def _curves(
    fit: CondenserFit,
    looks: Sequence[CondenserLook],
    table: CoherentProfiles,
    aperture: float,
) -> dict[str, CalibrationCurve]:
    """Return one profile of each setting with the image's through it."""
    found, across = {}, across_px().tolist()
    for setting in fit.settings:
        look = next(each for each in looks if each.setting == setting)
        s, offset = fit.coherence(setting).value, fit.offset_px.value
        meant = table(s, fit.ratio.value, fit.defocus, offset)
        line = meant * float(look.profile @ meant) / float(meant @ meant)
        found[f"edge at a condenser of {setting * aperture:.3g}"] = CalibrationCurve(
            points=list(zip(across, look.profile.tolist(), strict=True)),
            line=list(zip(across, line.tolist(), strict=True)),
        )
    return found
