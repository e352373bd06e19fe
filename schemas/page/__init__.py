"""Pages in HTML with SVG charts, text on the console, formats of numbers.

In: texts, numbers and points from planner.report, executor.analysis and the commands.
Out: elements, escaped on writing, and lines on standard output or standard error.
The type that passes: `Element` (elements).
May be touched here: style, charts and wording; no element may run or fetch anything,
every chart keeps a title and a description, and 390 px must be enough.
Watched by: tests/schemas/page/test_html.py, tests/browser/test_pages.py.
"""
