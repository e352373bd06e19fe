"""The report of a plan folder: one HTML page without scripts.

In: `Plan`, `World`, `LookEvidence` (schemas), pictures and findings of the folder.
Out: report.html, which fetches nothing; the same folder gives the same bytes.
The type that passes: `ReportedPlan` (folder).
May be touched here: sections, captions, tables, figures. Elements and style are in
schemas/page; what a folder lacks is left out of the page, never guessed.
Watched by: tests/planner/report/test_report.py
"""
