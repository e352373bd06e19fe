"""Views: how the microscope is set for a look: target, zoom, focus, light, region.

In: states of a step (`StepState`) from planner.assembly; parts from planner.task.
Out: requests of looks (`Request`), their settings (`ViewPlan`), to planner.looks;
scenes, times and verdicts of settings, to planner.plan.
The type that passes: `Request` (planner.views.requests), then `ViewPlan`.
May be touched here: words of findings MP401 to MP406, rungs of the zoom ladder.
Ask first: shares of tolerances in `requests`: every plan depends on them.
Watched by: tests/planner/views/test_views.py, test_zooms.py.
"""
