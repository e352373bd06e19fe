"""A measurement look: its view, its target, its evidence."""

from __future__ import annotations

from dataclasses import dataclass

from microplan.schemas.plan.evidence import Evidence, Together
from microplan.schemas.plan.measures import Measure, ModelCost, Repeatability
from microplan.schemas.plan.views import CoarseFirst, ViewVerdict


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How the microscope is set for a look."""

    magnification: float  # zoom that is set
    focus_um: float  # world height of the plane in focus
    focus_stops_um: tuple[float, ...]  # tried in turn where nothing is found at first
    light: float  # level of the light [1]
    field_um: tuple[float, float]  # width, height
    um_per_px: float  # in object space
    # whether the region is read about the believed target, whole pixels off the planned
    # place: what is about it lies off, too. Added after 2.4
    follows: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerRecord:
    """One body the camera sees."""

    name: str  # part, post, or finger
    z_um: float  # world height of its top face
    reflectance: float  # of its top face


@dataclass(frozen=True, slots=True, kw_only=True)
class Shade:
    """How much of a target's edges a higher body covers or shades, 0..1 each."""

    target: str  # part whose edges are counted
    by: str  # the higher body
    hidden: float  # share of the edges that it covers
    shaded: float  # share of the edges that it shades


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRecord:
    """What is in view, and the reference image of it."""

    layers: tuple[LayerRecord, ...]  # bodies in view, by rising height
    shades: tuple[Shade, ...]  # what covers or shades what
    image: str  # path in the plan folder
    image_sha256: str  # of the decoded pixels


@dataclass(frozen=True, slots=True, kw_only=True)
class SketchedLook:
    """What a look shows at its nominal pose."""

    id: str  # of the look
    step: str  # that asks for it
    target: str  # part, part.feature, part.post, tool.grip
    view: View  # zoom, focus, light
    scene: SceneRecord  # what is in view


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectCost:
    """What an effect above its limit costs a look's chain, by pairs of images."""

    by: str  # what the better image of a pair has
    pairs: int  # of images that the chain answered both of
    # mean difference of its answers, target's frame; 0 of surfaces that trials draw
    bias_um: tuple[float, float]
    half_width_um: tuple[float, float]  # of that: two-sided 95 %, and of an interval
    sigma_um: tuple[float, float]  # standard deviation over the poses; 0 as above


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRow:
    """One effect, how it is treated, and what leaving the rest out costs."""

    effect: str  # what is modelled or left out
    level: str  # how far it is modelled
    predicted_error: float | None  # of leaving the rest out; None: not known
    limit: float | None  # what it may cost; None: none is set
    unit: str  # of error and limit
    reason: str  # why this level
    # Added after 2.4; None: within its limit, or not known. Of the look's target.
    cost: EffectCost | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One measurement of one target through the microscope."""

    id: str  # what steps call the look
    target: str  # part, part.feature, part.post, tool.grip
    view: View  # zoom, focus, light
    scene: SceneRecord  # what is in view
    effects: tuple[EffectRow, ...]  # the optical effects ledger
    measure: Measure  # how its first feature is measured
    evidence: Evidence  # the trials behind the choice
    others: tuple[Measure, ...] = ()  # further features, measured on the same frame
    together: Together | None = None  # None: `measure` alone tells the pose
    verdict: ViewVerdict | None = None  # None: unknown
    coarse: CoarseFirst | None = None  # None: nothing comes before

    @property
    def measures(self) -> tuple[Measure, ...]:
        """Return how each feature of the look is measured, the first first."""
        return (self.measure, *self.others)

    @property
    def sigma_xy_um(self) -> float:
        """Return the spread of the target's place per axis, from the trials."""
        if self.together is None:
            return self.measure.sigma_xy_um
        return self.together.sigma_xy_um

    @property
    def repeatability(self) -> Repeatability | None:
        """Return what sigma and bias of the target's place are known by."""
        if self.together is None:
            return self.measure.repeatability
        return self.together.repeatability

    @property
    def model_cost(self) -> ModelCost | None:
        """Return what its images' errors cost the target's place."""
        if self.together is None:
            return self.measure.model_cost
        return self.together.model_cost

    @property
    def sigma_theta_rad(self) -> float | None:
        """Return the spread of the target's angle, None if it is not measured."""
        if self.together is None:
            return self.measure.sigma_theta_rad
        return self.together.sigma_theta_rad
