"""What another machine's last digits may not change: the choices."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from microplan.featuresel.selection.constraints import Constraints
from microplan.featuresel.selection.select import select
from microplan.featuresel.sets.feature_set import choose_set
from microplan.featuresel.sets.pose_covariance import (
    FeatureMeasurement,
    PoseRequirement,
)
from microplan.featuresel.trials.chains import Chain, principle
from microplan.featuresel.trials.score import ChainScore
from microplan.schemas import plan as p

GOLDEN = Path(__file__).parents[2] / "golden" / "gear_on_shaft.fast.json"
ANGLE_RAD = 0.01  # stands for the look's own; no chain comes near it
# What another machine makes of a need, relative, and of what no image enters:
# `python -m benchmarks machines` finds .0043 and 0.
NOISE = 5e-3
ROUNDING = 1e-9
TIMES = 200


@dataclass(frozen=True)
class Choice:
    """What trials showed of one look, as a plan tells it, and what it had to meet."""

    scores: tuple[ChainScore, ...]
    tolerance_um: float
    tolerance_theta_rad: float | None
    spoilt: Mapping[Chain, str] = field(default_factory=dict)  # by better images

    @property
    def task(self) -> Constraints:
        return Constraints(
            tolerance_um=self.tolerance_um,
            tolerance_theta_rad=self.tolerance_theta_rad,
            rejected=self.spoilt,
        )

    def made(self) -> tuple[object, ...]:
        """Return the chain chosen, the fallback, the front, and who was rejected."""
        found = select(self.scores, self.task)
        return (
            found.chosen and found.chosen.chain,
            found.fallback and found.fallback.chain,
            [score.chain for score in found.pareto],
            [(chain, why.startswith("rejected")) for chain, why in found.reasons],
        )

    def noisy(self, noise: float, rng: np.random.Generator) -> Choice:
        """Return the same scores, each number off by up to `noise` of itself.

        A bias, which may nearly vanish, is off by `noise` of the spread as well.
        """

        def off(value: float, beside: float = 0.0) -> float:
            return value + noise * rng.uniform(-1, 1) * (abs(value) + beside)

        return replace(
            self,
            scores=tuple(
                replace(
                    s,
                    cost=s.cost * (1 + ROUNDING * rng.uniform(-1, 1)),
                    sigma_um=s.sigma_um and off(s.sigma_um),
                    bias_um=s.bias_um and _pair(off, s.bias_um, s.sigma_um or 0.0),
                    sigma_theta_rad=s.sigma_theta_rad and off(s.sigma_theta_rad),
                    bias_theta_rad=s.bias_theta_rad and off(s.bias_theta_rad),
                )
                for s in self.scores
            ),
        )


def _pair(
    off: Callable[[float, float], float], values: tuple[float, float], beside: float
) -> tuple[float, float]:
    return off(values[0], beside), off(values[1], beside)


def a_score(told: p.Score) -> ChainScore:
    """Return a score as the plan has it; biases of angles are not in plans."""
    turned = told.sigma_theta_rad is not None
    return ChainScore(
        chain=told.chain, principle=principle(told.chain),
        trials=told.trials, success=told.success,
        success_lower=told.success_lower, silent=told.silent,
        silent_upper=told.silent_upper, failures=(), bias_um=told.bias_um,
        sigma_um=told.sigma_um, worst_um=told.worst_um,
        angles=told.success if turned else 0,
        bias_theta_rad=0.0 if turned else None,
        sigma_theta_rad=told.sigma_theta_rad, cost=told.cost,
    )  # fmt: skip


@pytest.fixture(scope="module")
def choices() -> Mapping[str, Choice]:
    """Return the choices of the example's looks."""
    plan = p.parse_plan(GOLDEN.read_text(encoding="utf-8"))
    found = {}
    for look in (look for step in plan.steps for look in step.looks):
        told = (look.evidence.chosen, *look.evidence.others)
        angle = any("gives no angle" in score.reason for score in told)
        found[look.id] = Choice(
            scores=tuple(map(a_score, told)),
            tolerance_um=look.evidence.tolerance_um,
            tolerance_theta_rad=ANGLE_RAD if angle else None,
            spoilt={s.chain: s.reason for s in told if "errors of images" in s.reason},
        )
    return found


def test_the_plans_choices_follow_from_its_scores(
    choices: Mapping[str, Choice],
) -> None:
    plan = p.parse_plan(GOLDEN.read_text(encoding="utf-8"))
    looks = {look.id: look for step in plan.steps for look in step.looks}
    assert len(choices) == 8
    for name, choice in choices.items():
        found = select(choice.scores, choice.task)
        assert found.chosen is not None
        assert found.chosen.chain == looks[name].evidence.chosen.chain
        again = () if found.fallback is None else found.fallback.chain
        told = [call.id for call in looks[name].measure.fallback]
        assert list(again[-1:]) == told[-1:]


def test_noise_in_every_score_changes_no_choice(choices: Mapping[str, Choice]) -> None:
    rng = np.random.default_rng(1)
    for choice in choices.values():
        made = choice.made()
        for _ in range(TIMES):
            found = choice.noisy(NOISE, rng).made()
            assert found[:2] == made[:2]  # what is used, and what is fallen back on


def test_noise_would_change_choices_if_it_were_larger(
    choices: Mapping[str, Choice],
) -> None:
    """The test above can fail: two in ten is no noise but another measurement."""
    rng = np.random.default_rng(1)
    changed = {
        name
        for name, choice in choices.items()
        for _ in range(20)
        if choice.noisy(0.2, rng).made() != choice.made()
    }
    assert changed


@pytest.mark.parametrize("tolerance_um", [0.8, 1.0])
def test_chains_as_good_as_each_other_go_by_name(
    choices: Mapping[str, Choice], tolerance_um: float
) -> None:
    """Costs and needs that are equal, and a need that just meets the tolerance."""
    one = choices["find_gear"].scores[0]
    one = replace(one, sigma_um=0.4, bias_um=(0.0, 0.0), sigma_theta_rad=None)
    twins = tuple(replace(one, chain=(name,)) for name in ("c", "b", "a", "d"))
    choice = Choice(twins, tolerance_um, None)
    rng = np.random.default_rng(2)
    for _ in range(TIMES):
        chosen, fallback, front, _ = choice.noisy(ROUNDING, rng).made()
        assert (chosen, fallback, front) == (("a",), ("b",), [("a",)])


def test_mirrored_features_go_by_name() -> None:
    """Four equal circles about the middle: pairs across tell as much as each other."""
    need = PoseRequirement(sigma_um=1.0, sigma_theta_rad=0.01, radius_um=50.0, most=3)
    rng = np.random.default_rng(3)
    found = set()
    for _ in range(TIMES):
        sights = [
            FeatureMeasurement(
                name=name,
                x_um=x * (1 + ROUNDING * rng.uniform(-1, 1)),
                y_um=y * (1 + ROUNDING * rng.uniform(-1, 1)),
                sigma_um=0.1 * (1 + ROUNDING * rng.uniform(-1, 1)),
                cost=2.0 * (1 + ROUNDING * rng.uniform(-1, 1)),
            )
            for name, x, y in (
                ("d", 40.0, 40.0), ("a", -40.0, 40.0), ("c", -40.0, -40.0),
                ("b", 40.0, -40.0),
            )
        ]  # fmt: skip
        found.add(choose_set(sights, need).names)
    assert len(found) == 1
