"""Measurement looks: how one look at a target is measured, chosen by trials.

A look is one image of the target at one setting of the microscope, with the routines
that measure the target's pose in it.

In: `Request` and `ViewPlan` (views), `Task` (task), `CompileContext` (plan).
Out: `CompiledLook` (to plan and budget), with its files.
The type that passes: `Evaluation` (evaluation): a case with its compared routines.
May be touched here: the order in which magnifications, targets and sets are tried; what
a look's record and evidence show.
Watched by: tests/planner/looks/test_compile_look.py
"""
