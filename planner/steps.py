"""One step compiled: its looks, action, control, conditions and budget."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

from planner.actions import action_of, axis_move
from planner.checks.handling import report_handling, verdicts_of
from planner.checks.mechanics import mechanical_rows
from planner.conditions import conditions_of
from planner.control import control_of, method_of, tolerance_um
from planner.diagnostics import Report
from planner.inputs.task import Task
from planner.looks import CompiledLook, Effects, compile_look
from planner.memory import Memory, remember
from planner.model.assembly import owner_of
from planner.model.requests import requests
from planner.model.steps import StepState
from planner.placements import place_budget
from planner.step_budget import budget_of
from schemas import plan as p
from schemas.codec import to_data

IRREVERSIBLE = ("grasp", "insert", "release")
PHYSICAL = (*IRREVERSIBLE, "move", "align")


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledStep:
    """A step as the plan has it, its looks with their files, and what it leaves."""

    step: p.Step
    looks: tuple[CompiledLook, ...]
    memory: Memory


def compile_step(
    task: Task,
    states: tuple[StepState, ...],
    index: int,
    memory: Memory,
    effects: Effects,
    report: Report,
) -> CompiledStep | None:
    """Return step `index`, None if one of its looks cannot be done."""
    here = states[index]
    goal = memory.seen.get(owner_of(here.step.to or ""))
    within: float | None = None
    if here.step.verb == "align":
        within = tolerance_um(task, states, here, goal, report)
    looks, before = [], memory.seen.get(owner_of(here.step.target or ""))
    for request in requests(task, states, index, within):
        look = compile_look(task, request, effects, memory.magnification, report)
        if look is None:
            return None
        looks.append(look)
        memory = remember(memory, here.step.id, look)
    if within is not None:
        choice = method_of(task, states, here, within, memory.seen, report)
        memory = replace(memory, within_um=within, choice=choice, before=before)
    step = _step(task, states, here, tuple(looks), memory, effects)
    report_handling(here, step.grasp, step.release, report, step.placing)
    step = replace(step, key=journal_key(step, memory.key))
    return CompiledStep(
        step=step, looks=tuple(looks), memory=replace(memory, key=step.key)
    )


def journal_key(step: p.Step, before: str) -> str:
    """Return the sha256 of a step's content and the key of the step before it."""
    content = json.dumps(to_data(replace(step, key="")), sort_keys=True)
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


def _step(
    task: Task,
    states: tuple[StepState, ...],
    here: StepState,
    looks: Sequence[CompiledLook],
    memory: Memory,
    effects: Effects,
) -> p.Step:
    """Return the plan's step, without its key."""
    step = here.step
    control = None
    if step.verb == "align":
        control = control_of(task, here, memory.within_um, memory.choice)
    budget, placing = budget_of(task, states, here, memory, effects), None
    if step.verb == "release":
        placed = place_budget(task, states, here, memory, effects)
        budget, placing = placed or (budget, None)
    verdicts = verdicts_of(task, states, here)
    return p.Step(
        id=step.id,
        verb=step.verb,
        key="",
        physical=step.verb in PHYSICAL or bool(here.moves),
        irreversible=step.verb in IRREVERSIBLE,
        moves=tuple(axis_move(move) for move in here.moves),
        looks=tuple(look.look for look in looks),
        action=action_of(task, here, looks),
        control=control,
        conditions=conditions_of(here),
        budget=budget,
        fit=verdicts.fit,
        grasp=verdicts.grasp,
        release=verdicts.release,
        placing=placing,
        effects=mechanical_rows(
            here, budget, verdicts.fit, verdicts.grasp, verdicts.release
        ),
    )
