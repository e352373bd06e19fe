"""Images of a look as its focus or zoom drifts away from nominal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import image, pictured, still
from microplan.featuresel.look.scenario import LookCase, moved_layers
from microplan.featuresel.look.static_layers import Standing, standing
from microplan.optics.lens.sensor import linear
from microplan.optics.render.prepared_scene import PreparedScene, prepare
from microplan.optics.render.scene import Layer, Scene
from microplan.optics.render.view_range import Range

Pictures = Callable[[Sequence[Trial]], Iterator[FloatArray]]


def one_by_one(case: LookCase, trials: Sequence[Trial]) -> Iterator[FloatArray]:
    """Yield images of trials, (rows, columns) 0..1, each rendered anew.

    The trials have one focus and zoom.
    """
    backdrop = still(case, trials[0])
    for trial in trials:
        yield image(case, trial, backdrop)


def posed(case: LookCase, farthest: Trial) -> Pictures | None:
    """Return a maker of images of targets whose poses and law stay those of trials.

    Parameters
    ----------
    case : LookCase
        The look.
    farthest : Trial
        The farthest from nominal in focus and zoom.

    Returns
    -------
    callable of sequence of Trial, optional
        Yields the images of trials of one focus and zoom, no farther off. Layers are
        transformed once a pose, when it is first asked for. None where images do not
        share them.
    """
    first = farthest
    focus_um = sorted((case.focus_um, case.focus_um + first.dz_um))
    zoom = sorted((1.0, first.magnification))
    reach = Range(focus_um=(focus_um[0], focus_um[1]), zoom=(zoom[0], zoom[1]))

    @cache
    def ready(*pose: float) -> Standing | None:
        return standing(case, moved_layers(case, *pose), reach, first.model)

    if ready(*_pose(first)) is None:
        return None

    def pictures(trials: Sequence[Trial]) -> Iterator[FloatArray]:
        behind = still(case, trials[0], reach)
        for trial in trials:
            each = ready(*_pose(trial))
            if each is None:
                raise ValueError("images of one look share layers, or none does")
            own = each.at(
                focus_um=case.focus_um + trial.dz_um, zoom=trial.magnification
            )
            yield image(case, trial, behind.with_(own), ())

    return pictures


def _pose(trial: Trial) -> tuple[float, float, float]:
    """Return the displacement of the target, um, um, rad."""
    return (trial.dx_um, trial.dy_um, trial.dtheta_rad)


def through_focus(case: LookCase, farthest: Trial) -> Pictures:
    """Return a maker of images between the nominal focus and that of some trials.

    Parameters
    ----------
    case : LookCase
        A look whose still layers look the same wherever the target is.
    farthest : Trial
        The farthest from nominal in focus, with nominal zoom and light.

    Returns
    -------
    callable of sequence of Trial
        Yields the images of trials that differ from that one in pose, focus and noise
        alone, as `microplan.featuresel.look.perturb.image` within the errors of
        `microplan.optics.render.sampling`. Spectra are computed once a pose, when it is
        first asked for, in single precision.
    """
    end_um = case.focus_um + farthest.dz_um
    reach = Range(focus_um=(min(case.focus_um, end_um), max(case.focus_um, end_um)))

    def ready(layers: tuple[Layer, ...]) -> PreparedScene:
        return prepare(
            Scene(layers=layers, background=case.background),
            case.microscope,
            reach,
            model=farthest.model,
            window=case.window,
            sampling=replace(case.sampling, single=True),
        )

    @cache
    def moved(*pose: float) -> PreparedScene:
        return ready(moved_layers(case, *pose))

    backdrop = ready(case.static)

    def pictures(trials: Sequence[Trial]) -> Iterator[FloatArray]:
        focus_um = case.focus_um + trials[0].dz_um
        also = backdrop.patches(focus_um=focus_um)
        for trial in trials:
            scene = moved(*_pose(trial))
            bright = scene.image(focus_um=focus_um, light=case.light, also=also)
            seen = replace(case, focus_um=focus_um)
            yield linear(pictured(seen, trial, bright)[0], case.sensor)

    return pictures
