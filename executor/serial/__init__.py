"""Serial driver for zoom, focus, jaws: an example to copy.

In: options of a station file, a serial port. Out: `Controller.lens`, `Controller.jaws`,
which fulfil executor.devices.drivers.
The type that passes: `Answer` (link).
May be touched here: all of it; the protocol is documented in docs/drivers.md, and the
standard library suffices (POSIX).
Watched by: tests/executor/serial/test_serial.py, with a controller of its own.
"""
