"""Maps of a target's occluders at some focus heights, from rendered images.

Out of focus rays that pass the occluder meet other parts of the target's edge than
those that do not: what the product of both leaves out moves with the target.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from microplan.arrays import FloatArray, IntArray
from microplan.featuresel.routines.contract import LookModel, Occluders, Target

_DEPTHS = 2.0  # wave depths of field between heights: what is in front is blurred
_MOST = 9  # heights
_JOINT = 15  # heights of the joint part, closer near focus: each takes 18 images
_DENSE = 1.5  # depths about focus, where they are closest
# Of the search, that the target is displaced by along both axes. In focus all of it:
# what is let through farther out is not learnt. A parabola is nearer to less.
_FAR, _JOINT_FAR = 1.0, 0.5
_SAME = 0.002  # of full scale: an image that differs less from the target alone is it
# Of the distance to the occluder: there a tenth of its light seems to come from, by
# the exact law at an aperture of .42 against Hopkins'; .2 to .3 serve equally well.
_CORE = 0.3
_FLAT = 1e-3  # per px: what is no steeper has no edge
# Places of the target, in steps to the right and down, and px between pixels.
_BESIDE = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1]])
_BETWEEN = np.array([[-0.5, 0.0], [0.0, -0.5], [-0.5, -0.5]])
_DOUBT = 0.02  # of full scale: where the target varies less, the occluder decides
MOST_TURN_RAD = 0.5  # turned farther, an edge meets other rays of the occluder


@dataclass(frozen=True, slots=True, kw_only=True)
class FrontMaps:
    """Image = light + through x target alone + joint, at some focus heights."""

    light: FloatArray  # (K, rows, columns), K odd
    through: FloatArray  # (K, rows, columns)
    core_light: FloatArray  # (K, rows, columns) what less blur of it changes them by
    core_through: FloatArray  # (K, rows, columns)
    # what the product leaves out with the target at its nominal place; what moves of
    # the target to the right and down change that by, per px, their squares and their
    # product, per px^2; it moves along
    joint: FloatArray  # (L, 6, rows, columns)
    joint_fine: FloatArray  # (L, 2 rows, 2 columns) the first of these, twice as fine
    # asinh of the L heights of that over some depths of field: at equal steps
    joint_steps: FloatArray
    depth_um: float


def front_maps(
    model: LookModel, target: Target, image: FloatArray, reach_um: float
) -> FrontMaps | None:
    """Return how a look differs from its target alone; None if it does not.

    Parameters
    ----------
    model : LookModel
        The look.
    target : Target
        What is to be found.
    image : (rows, columns) float array
        The nominal image.
    reach_um : float
        Heights are at equal steps from -reach to reach off nominal focus.

    Notes
    -----
    In focus a line through what each pixel shows against the target alone, at six
    positions of the target, nominal and as far as its search: what covers or
    shades it, what is seen next to it, and what shades what. The slope is that of
    `LookModel.occluders` where the target's light hardly varies, and so is what focus
    changes. What is left, displaced with the target, is the joint part: a parabola
    over positions half as far. In focus there is none.
    """
    if float(np.abs(image - np.clip(model.alone(), 0, 1)).max()) < _SAME:
        return None
    count = 2 * math.ceil(reach_um / (_DEPTHS * model.blur.depth_um)) + 1
    heights = np.linspace(-reach_um, reach_um, min(count, _MOST))
    depth_um = _DENSE * model.blur.depth_um
    steps = np.arcsinh(reach_um / depth_um) * np.linspace(-1, 1, _JOINT)
    shown = [
        _Displaced.at(model, target, depth_um * float(np.sinh(s)), share=_JOINT_FAR)
        for s in steps
    ]
    beside = _Displaced.at(model, target, 0.0, share=_FAR).change()
    found = [model.occluders(dz) for dz in heights.tolist()]
    cores = _cores(model, target, heights)
    parts = [each.joint(beside) for each in shown]
    return FrontMaps(
        light=np.stack([each.light + beside.light for each in found]),
        through=np.stack([each.through + beside.through for each in found]),
        core_light=np.stack([core.light for core in cores]),
        core_through=np.stack([core.through for core in cores]),
        joint=np.stack([joint for joint, _ in parts]),
        joint_fine=np.stack([fine for _, fine in parts]),
        joint_steps=steps,
        depth_um=depth_um,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Displaced:
    """A look with its target at 9 places, at one focus height."""

    far_px: int  # whole pixels are not resampled
    alone: FloatArray  # (9, rows, columns)
    seen: FloatArray  # (9, rows, columns)
    assumed: Occluders

    @classmethod
    def at(
        cls, model: LookModel, target: Target, dz_um: float, *, share: float
    ) -> _Displaced:
        """Return the look `dz_um` off nominal focus, displaced by a share of search."""
        far = max(round(share * target.search_px), 1)
        moves = np.concatenate((far * _BESIDE, _BETWEEN))
        places = (moves * [1, -1] / target.px_per_um).tolist()
        return cls(
            far_px=far,
            alone=np.stack(
                [model.alone(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in places]
            ),
            seen=np.stack([model(dx_um=x, dy_um=y, dz_um=dz_um) for x, y in places]),
            assumed=model.occluders(dz_um),
        )

    def change(self) -> Occluders:
        """Return what lies below or beside the target changes of its occluders.

        By the line through what each pixel shows against the target alone: in focus,
        where the product is exact.
        """
        count = len(_BESIDE)
        seen, alone = self.seen[:count], self.alone[:count]
        off, shown = alone - alone.mean(axis=0), seen - seen.mean(axis=0)
        doubt = len(seen) * _DOUBT**2
        slope = (off * shown).sum(axis=0) + doubt * self.assumed.through
        through = slope / ((off**2).sum(axis=0) + doubt)
        light = seen.mean(axis=0) - through * alone.mean(axis=0)
        return Occluders(
            light=light - self.assumed.light, through=through - self.assumed.through
        )

    def joint(self, beside: Occluders) -> tuple[FloatArray, FloatArray]:
        """Return what the product leaves out where the target is, as in `FrontMaps`.

        `beside` is the change of light and share in focus.
        """
        light = self.assumed.light + beside.light
        left = self.seen - light - (self.assumed.through + beside.through) * self.alone
        moves, count = self.far_px * _BESIDE, len(_BESIDE)
        back = [_shifted(a, -m) for a, m in zip(left[:count], moves, strict=True)]
        design = np.array([_parabola(*move) for move in moves.tolist()])
        found = np.linalg.solve(design, np.stack(back).reshape(count, -1))
        joint: FloatArray = found.reshape(left[:count].shape)
        rows, columns = joint.shape[1:]
        fine = np.empty((2 * rows, 2 * columns))
        fine[::2, ::2] = joint[0]
        for (x, y), there in zip(_BETWEEN, left[count:], strict=True):
            own = there - np.tensordot(_parabola(x, y), joint, 1) + joint[0]
            # a pixel shows what lies as far on the other side of it
            fine[int(-2 * y) :: 2, int(-2 * x) :: 2] = own
        return joint, fine


def _parabola(x: float, y: float) -> tuple[float, ...]:
    """Return what the maps of the joint part are multiplied by at a move, px."""
    return (1.0, x, y, x**2, y**2, x * y)


def _shifted(values: FloatArray, by_px: IntArray) -> FloatArray:
    """Return a map displaced to the right and down; beyond its border it goes on."""
    rows, columns = (
        np.clip(np.arange(size) - by, 0, size - 1)
        for size, by in zip(values.shape, by_px[::-1], strict=True)
    )
    return values[np.ix_(rows, columns)]


def _cores(model: LookModel, target: Target, heights: FloatArray) -> list[Occluders]:
    """Return what less blur of the occluder changes, at some focus heights."""
    near_um = _CORE * _height_um(model, target)
    return [_core(model, dz, near_um) for dz in heights.tolist()]


def _core(model: LookModel, dz_um: float, near_um: float) -> Occluders:
    """Return what the blur of an occluder nearer by so much changes."""
    seen, core = model.occluders(dz_um), model.occluders(dz_um + near_um)
    return Occluders(light=core.light - seen.light, through=core.through - seen.through)


def _height_um(model: LookModel, target: Target) -> float:
    """Return how far above nominal focus the edges of the occluder are.

    An edge blurred to a disc of radius R is nowhere steeper than 2 / (pi R).
    """
    step_um = model.blur.depth_um
    below, here, above = (
        max(float(np.abs(g).max()) for g in np.gradient(model.occluders(dz).through))
        for dz in (-step_um, 0.0, step_um)
    )
    if here < _FLAT:
        return 0.0
    height_um = 2 / (math.pi * here * model.blur.cone * target.px_per_um)
    return math.copysign(height_um, above - below)
