"""Micro-Manager's devices as drivers: the extra `microplan[micromanager]`."""
