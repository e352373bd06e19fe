"""The augmented plan: frozen types shared by compiler, diff and executor.

In: decisions of planner.plan and its stages. Out: `plan.json`, `to_data` of `Plan`, to
planner.diff, planner.report, planner.export and all of the executor.
The type that passes: `Plan` (document). Lengths are um in the world (camera) frame and
angles rad unless a name says otherwise; docs/conventions.md defines frames and signs.
May be touched here: nothing without a new `FORMAT_VERSION` and schemas written again.
Watched by: tests/golden, tests/schemas/files/test_plan_schema.py.
"""

from __future__ import annotations

from microplan.schemas.plan.actions import (
    Action,
    AlignAction,
    AxesName,
    AxisMove,
    GraspAction,
    HeightSearch,
    InsertAction,
    LocateAction,
    MoveAction,
    ReleaseAction,
    RestAngle,
    VerifyAction,
)
from microplan.schemas.plan.bounds import BiasRow, StepBound, SuccessBound
from microplan.schemas.plan.document import (
    FORMAT_VERSION,
    SKETCH,
    Belief,
    FeaturePlace,
    Plan,
    Provenance,
    Reason,
    Requirements,
    check_version,
    dump_plan,
    newer_note,
    parse_plan,
)
from microplan.schemas.plan.evidence import (
    Evidence,
    FallbackRecord,
    FeatureRow,
    Score,
    Together,
)
from microplan.schemas.plan.looks import (
    EffectCost,
    EffectRow,
    LayerRecord,
    Look,
    SceneRecord,
    Shade,
    SketchedLook,
    View,
)
from microplan.schemas.plan.measures import (
    BiasAt,
    Depth,
    Gates,
    Measure,
    ModelCost,
    Reference,
    Region,
    Repeatability,
    RoutineUse,
)
from microplan.schemas.plan.steps import (
    Budget,
    BudgetRow,
    Conditions,
    Control,
    OnFailure,
    Step,
)

__all__ = [
    "FORMAT_VERSION",
    "SKETCH",
    "Action",
    "AlignAction",
    "AxesName",
    "AxisMove",
    "Belief",
    "BiasAt",
    "BiasRow",
    "Budget",
    "BudgetRow",
    "Conditions",
    "Control",
    "Depth",
    "EffectCost",
    "EffectRow",
    "Evidence",
    "FallbackRecord",
    "FeaturePlace",
    "FeatureRow",
    "Gates",
    "GraspAction",
    "HeightSearch",
    "InsertAction",
    "LayerRecord",
    "LocateAction",
    "Look",
    "Measure",
    "ModelCost",
    "MoveAction",
    "OnFailure",
    "Plan",
    "Provenance",
    "Reason",
    "Reference",
    "Region",
    "ReleaseAction",
    "Repeatability",
    "Requirements",
    "RestAngle",
    "RoutineUse",
    "SceneRecord",
    "Score",
    "Shade",
    "SketchedLook",
    "Step",
    "StepBound",
    "SuccessBound",
    "Together",
    "VerifyAction",
    "View",
    "check_version",
    "dump_plan",
    "newer_note",
    "parse_plan",
]
