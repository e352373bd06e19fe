"""Record of a run: journal, recorded calls, frames, outcome, the run folder.

In: events, intents and calls of executor.run and executor.devices. Out: the run folder;
what an interrupted run can resume from; a station that replays a record.
The type that passes: `ReadJournal` (recovery), `Recorded` (recorded_calls),
`RunResult` (outcome).
May be touched here: wording of lists; formats of files only with their FORMAT raised
and old ones read.
Watched by: tests/executor/record/test_write_ahead_log.py, test_run_folder.py.
"""
