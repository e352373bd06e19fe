"""Devices of a station: driver contracts, station file, limits, time limits.

In: station.toml, drivers by name. Out: `Station` with checked devices, to
executor.motion and executor.run.
The type that passes: `Station` (station), `Rules` (safety), `ExecutorError` (errors);
within reading a file `Table` (tables), with the lines of its keys (toml_lines).
May be touched here: new keys of the station file, with schemas/station.schema.json and
docs/reference/station.md. The methods of drivers (drivers) are a documented contract.
Watched by: tests/executor/devices/test_station_file.py, test_station_schema.py.
"""
