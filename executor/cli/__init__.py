"""Command line microplan-run: options, the station, one run, its result.

In: arguments, a plan folder, a station file, the operator's answers. Out: lines on
stdout and stderr, the exit status, the run folder.
The type that passes: `RunOptions` (options), `RunJob` (session).
May be touched here: messages to the operator; options are documented and stay. This
folder alone prints, and `main` alone catches every exception.
Watched by: tests/executor/cli/test_main.py.
"""
