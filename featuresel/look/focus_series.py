"""Images of a look as its focus or zoom drifts away from nominal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from microplan.arrays import FloatArray
from microplan.featuresel.look.design import Trial
from microplan.featuresel.look.perturb import image, still
from microplan.featuresel.look.scenario import LookCase, moved_layers
from microplan.featuresel.look.static_layers import standing
from microplan.optics.lens.sensor import expose, to_unit
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


def posed(case: LookCase, farthest: Sequence[Trial]) -> Pictures | None:
    """Return a maker of images of targets whose poses and law stay those of trials.

    Parameters
    ----------
    case : LookCase
        The look.
    farthest : sequence of Trial
        One for each pose, all of one focus and zoom: the farthest from nominal.

    Returns
    -------
    callable of sequence of Trial, optional
        Yields the images of trials that differ from those given in light, noise, focus
        and zoom alone, the last two no farther off. Layers are transformed once. None
        where images do not share them.
    """
    first = farthest[0]
    focus_um = sorted((case.focus_um, case.focus_um + first.dz_um))
    zoom = sorted((1.0, first.magnification))
    reach = Range(focus_um=(focus_um[0], focus_um[1]), zoom=(zoom[0], zoom[1]))
    found = [
        standing(
            case, moved_layers(case, t.dx_um, t.dy_um, t.dtheta_rad), reach, t.model
        )
        for t in farthest
    ]
    ready = [each for each in found if each is not None]
    if not ready:
        return None

    def pictures(trials: Sequence[Trial]) -> Iterator[FloatArray]:
        behind = still(case, trials[0], reach)
        for each, trial in zip(ready, trials, strict=True):
            own = each.at(
                focus_um=case.focus_um + trial.dz_um, zoom=trial.magnification
            )
            yield image(case, trial, behind.with_(own), ())

    return pictures


def through_focus(case: LookCase, farthest: Sequence[Trial]) -> Pictures:
    """Return a maker of images between the nominal focus and that of some trials.

    Parameters
    ----------
    case : LookCase
        A look whose still layers look the same wherever the target is.
    farthest : sequence of Trial
        Trials of one focus, with nominal zoom and light.

    Returns
    -------
    callable of sequence of Trial
        Yields the images of trials that differ from those given in focus and noise
        alone, as `microplan.featuresel.look.perturb.image` within the errors of
        `microplan.optics.render.sampling`. Spectra are computed once, in single
        precision.
    """
    end_um = case.focus_um + farthest[0].dz_um
    reach = Range(focus_um=(min(case.focus_um, end_um), max(case.focus_um, end_um)))

    def ready(layers: tuple[Layer, ...]) -> PreparedScene:
        return prepare(
            Scene(layers=layers, background=case.background),
            case.microscope,
            reach,
            model=farthest[0].model,
            window=case.window,
            sampling=replace(case.sampling, single=True),
        )

    backdrop = ready(case.static)
    scenes = [
        ready(moved_layers(case, t.dx_um, t.dy_um, t.dtheta_rad)) for t in farthest
    ]

    def pictures(trials: Sequence[Trial]) -> Iterator[FloatArray]:
        focus_um = case.focus_um + trials[0].dz_um
        also = backdrop.patches(focus_um=focus_um)
        for scene, trial in zip(scenes, trials, strict=True):
            bright = scene.image(focus_um=focus_um, light=case.light, also=also)
            rng = np.random.default_rng(np.random.SeedSequence(trial.seed))
            yield to_unit(expose(bright, case.sensor, rng), case.sensor.bits)

    return pictures
