"""Files of a plan folder apart from the plan: world, evidence, outlines, times.

In: `World`, `Scenes` and `LookEvidence` from planner.looks and planner.plan. Out: the
same types, to executor.simulated, planner.report and planner.export; JSON Schemas.
The type that passes: `World` (world), `LookEvidence` (evidence).
May be touched here: predicted times; after a change of types write the schemas again,
`python -m microplan.schemas.files.plan_schema`. Comments of fields are descriptions.
Watched by: tests/schemas/files/test_plan_schema.py and test_field_notes.py.
"""
