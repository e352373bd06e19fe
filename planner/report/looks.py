"""One look in the report: settings, image, accuracy, cost, effects ledger."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from microplan.planner.report.folder import ReportedPlan
from microplan.planner.report.margins import need_um
from microplan.planner.report.pictures import (
    look_picture,
    marked,
    place_id,
    trial_pictures,
)
from microplan.planner.report.trials import accuracy, chain_of, rejected, robustness
from microplan.schemas.page.elements import Element, Node, el, slug
from microplan.schemas.page.figures import degrees, number, quantity, seconds, span, um
from microplan.schemas.page.page import Column, facts, link, more, table
from microplan.schemas.plan import EffectRow, Look
from microplan.schemas.plan.views import ApertureRow

_COLUMNS = (
    Column("effect"), Column("how it is treated"), Column("error left", numeric=True),
    Column("limit", numeric=True), Column("costs its chain", numeric=True),
    Column("reason"),
)  # fmt: skip
# effects whose name in a plan says less than they are
_EFFECTS = {
    "shade of higher bodies": "shade of bodies on what lies lower, the ground too"
}


def ledger(rows: Sequence[EffectRow], of: str) -> Element | None:
    """Return the effects of a look or step, those beyond their limits counted first."""
    if not rows:
        return None
    over = sum(_is_over(row) for row in rows)
    silent = sum(row.predicted_error is None for row in rows)
    told = f"{over} above their limit, " if over else ""
    title = f"Effects of {of}: {len(rows)}, {told}{silent} without a number"
    return more(title, table(_COLUMNS, [_cells(row) for row in rows]))


def _is_over(row: EffectRow) -> bool:
    error, limit = row.predicted_error, row.limit
    return error is not None and limit is not None and error > limit


def _cells(row: EffectRow) -> list[Node]:
    """Return the cells of one effect."""
    said = number(row.predicted_error, 2)
    unit = f" {row.unit}" if row.predicted_error is not None else ""
    over = _is_over(row)
    error = el("span", f"{said}{unit}", " \u2013 above the limit" if over else None,
               class_="bad" if over else None)  # fmt: skip
    return [
        _EFFECTS.get(row.effect, row.effect),
        row.level,
        error,
        "\u2013" if row.limit is None else f"{number(row.limit, 2)} {row.unit}",
        _cost(row),
        row.reason,
    ]


def _cost(row: EffectRow) -> Node:
    """Return what an effect above its limit costs: bias, its half-width, sigma."""
    cost = row.cost
    if cost is None:
        return "\u2013"
    bias, half = (math.hypot(*each) for each in (cost.bias_um, cost.half_width_um))
    return f"{number(bias, 2)} \u00b1 {um(half)}, sigma {um(max(cost.sigma_um))}"


def look_id(look: Look) -> str:
    """Return the id of a look's section."""
    return slug("look", look.id)


def look_section(folder: ReportedPlan, look: Look) -> Element:
    """Return everything about one look."""
    evidence = folder.evidence.get(look.id)
    placed = marked(folder, look)
    content: Iterator[Node] = iter(
        [
            el("h3", f"Look {look.id}: {look.target}"),
            _facts(look),
            look_picture(folder, look),
            _measured(look, placed),
            _bodies(look, placed),
            el("div", [*robustness(look, evidence)], [*accuracy(look)], class_="cols"),
            [*trial_pictures(folder, look)],
            [*rejected(look)],
            ledger(look.effects, f"the look {look.id}"),
        ]
    )
    return el("section", list(content), id=look_id(look))


def _facts(look: Look) -> Element:
    """Return the look's figures."""
    low, high = look.measure.usable_focus_um
    needed = need_um(look.evidence.chosen)
    turn = look.sigma_theta_rad
    depth = next((row for row in _apertures(look) if row.chosen), None)
    pairs: list[tuple[str, Node]] = [
        ("magnification", f"{number(look.view.magnification)} \u00d7"),
        ("plane in focus", quantity(look.view.focus_um, "\u00b5m")),
        ("routines", chain_of(look.measure)),
        ("one sigma, per axis", [um(look.sigma_xy_um), _known_by(look)]),
        ("2 sigma + |bias| of tolerance",
         f"{um(needed)} of {um(look.evidence.tolerance_um)}"),
        ("usable focus", [span(low, high, "\u00b5m"), _drawn(look)]),
    ]  # fmt: skip
    if turn is not None:
        pairs.append(("one sigma of the angle", degrees(turn)))
    cost = look.model_cost
    if cost is not None:
        half = math.hypot(*cost.half_width_um)
        said = f"bias known to {um(half)}, sigma {um(max(cost.sigma_um))}"
        pairs.append(("errors of the images", f"{said} ({cost.pairs} pairs)"))
    if depth is not None:
        pairs.append(("depth of field", um(depth.depth_um)))
    if look.verdict is not None and look.verdict.change is not None:
        pairs.append(("time to look", seconds(look.verdict.change.total_s)))
    return facts(pairs)


def _known_by(look: Look) -> Element | None:
    """Return what sigma is known by, None where the plan does not say."""
    known = look.repeatability
    if known is None:
        return None
    half = um(math.hypot(*known.half_width_um))
    return el("small", f"{known.trials} random trials; bias known within {half}")


def _drawn(look: Look) -> Element | None:
    """Return how many images the usable range comes from."""
    count = look.measure.usable_draws
    return None if count is None else el("small", f"{count} draws a stop")


def _apertures(look: Look) -> tuple[ApertureRow, ...]:
    return () if look.verdict is None else look.verdict.apertures


def _measured(look: Look, placed: set[str]) -> Element:
    """Return the features measured, with links to their positions in the picture."""
    columns = (
        Column("measured"), Column("routines"), Column("if they fail"),
        Column("one sigma", numeric=True), Column("searched within", numeric=True),
    )  # fmt: skip
    rows: list[list[Node]] = []
    for measure in look.measures:
        name = measure.feature or look.target
        spare = " > ".join(use.id for use in measure.fallback) or "nothing"
        rows.append(
            [
                _named(look, name, f"={name}", placed), chain_of(measure), spare,
                um(measure.sigma_xy_um), um(measure.capture_um),
            ]
        )  # fmt: skip
    return table(columns, rows, label=f"What {look.id} measures")


def _bodies(look: Look, placed: set[str]) -> Element:
    """Return what is in view, the highest first, with links to its positions."""
    shades = {shade.by: shade for shade in look.scene.shades}
    rows: list[list[Node]] = []
    for layer in sorted(look.scene.layers, key=lambda la: (-la.z_um, la.name)):
        shade = shades.get(layer.name)
        said = (
            "\u2013"
            if shade is None
            else (
                f"{number(100 * shade.hidden, 2)} % hidden, "
                f"{number(100 * shade.shaded, 2)} % shaded"
            )
        )
        name = _named(look, layer.name, layer.name, placed)
        rows.append([name, um(layer.z_um), number(layer.reflectance, 2), said])
    columns = (
        Column("in view"), Column("height of its face", numeric=True),
        Column("reflectance", numeric=True), Column("of the target's edges"),
    )  # fmt: skip
    return table(columns, rows, label=f"What {look.id} has in view")


def _named(look: Look, name: str, place: str, placed: set[str]) -> Node:
    """Return a name, as a link where it has a position in the picture."""
    return link(name, place_id(look, place)) if place in placed else name
