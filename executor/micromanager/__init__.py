"""Micro-Manager's devices as drivers: the extra `microplan[micromanager]`.

In: the hub's table of a station file, Micro-Manager's core. Out: devices that fulfil
executor.devices.drivers.
The type that passes: `Drive` (drives), `Hub` (hub).
May be touched here: a new kind of drive, with limits checked before the device moves.
The core is closed before Python ends (core).
Watched by: tests/executor/micromanager/test_micromanager.py.
"""
