"""The command line `microplan`: one subcommand a job.

In: `argparse.Namespace` (arguments); `Report`, `PlanBytes`, `Task` from the folders
below. Out: text on standard output and standard error, an exit status.
The type that passes: `Report` (planner/source/diagnostics).
May be touched here: wording of help texts, the order of output, forms of findings.
Options and exit statuses are public, and findings go to standard error alone.
Watched by: tests/planner/cli/test_main.py
"""
