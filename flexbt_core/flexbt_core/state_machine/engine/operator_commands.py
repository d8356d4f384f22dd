# SPDX-License-Identifier: BSD-3-Clause
"""Operator commands for :meth:`MachineRun.command`, which applies them between two steps.

Each returns the reason for a refusal, or None. A command that would change nothing is refused too, so that each
command has either an effect or a reason.
"""

from __future__ import annotations

from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, no_level
from flexbt_core.state_machine.model.definition import ROOT_PATH, is_inside
from flexbt_core.state_machine.model.state_host import Severity

from .controls import STEPS, Step
from .events import AutonomySet, BreakpointSet, DecisionTaken, LockSet, Logged, OutcomeForced, RunPaused
from .region import ContainerRun, Region, RegionChild
from .run import MachineRun


def confirm(run: MachineRun, decision_id: str) -> str | None:
    """Confirm a pending decision: the run takes the outcome that it suggests."""
    region = _deciding(run, decision_id)
    if region is None or region.decision is None:
        return _no_decision(run, decision_id)
    decision = region.decision
    if not decision.outcome:
        return f'decision {decision_id} suggests nothing: force one of {", ".join(decision.outcomes)}'
    refusal = _leaving(region, decision.path) or _paused(run, decision.path)
    if refusal is None:
        run.tell(DecisionTaken(decision_id))
        run.controls.step = None
        region.approve()
    return refusal


def step(run: MachineRun, how: str, decision_id: str) -> str | None:
    """Confirm a pending decision, and hold the next transition for the operator at any autonomy: 'into' holds any,
    'over' one of a node that is not nested deeper, 'out' one of the container around the node, or further out.

    The step lasts until a decision is confirmed or an outcome forced, or :func:`clear_breakpoint` of its path.
    """
    region = _deciding(run, decision_id)
    path = region.decision.path if region is not None and region.decision is not None else ''
    if how not in STEPS:
        return f'there is no step {how!r}; there are {", ".join(STEPS)}'
    if how == 'out' and path.count('/') == 1:
        return f'{path} is in no container but the root, which is not left by a transition; use over'
    refusal = confirm(run, decision_id)
    if refusal is None:
        run.controls.step = Step(how, path)
    return refusal


def force(run: MachineRun, path: str, outcome: str, decision_id: str = '') -> str | None:
    """Leave an active state or machine by an outcome. ``decision_id`` is the decision that this overrides, or ''."""
    found = _active(run, path)
    if isinstance(found, str):
        return found
    region, child = found
    if decision_id and (region.decision is None or region.decision.id != decision_id):
        deciding = _deciding(run, decision_id)
        if deciding is None or deciding.decision is None:
            return _no_decision(run, decision_id)
        return f'decision {decision_id!r} is about {deciding.decision.path}, not about {path}'
    outcomes = child.definition.outcomes
    if outcome not in outcomes:
        return f'{path} has no outcome {outcome!r}; its outcomes are {", ".join(outcomes)}'
    refusal = _leaving(region, path) or _paused(run, path)
    if refusal is None:
        run.tell(OutcomeForced(path, outcome))
        run.controls.step = None
        region.force(outcome)
    return refusal


def repeat(run: MachineRun, path: str) -> str | None:
    """Leave an active state or machine, and enter it again when it has halted."""
    found = _active(run, path)
    if isinstance(found, str):
        return found
    region, _ = found
    refusal = _leaving(region, path) or _paused(run, path)
    if refusal is None:
        locked = [one for one in run.locked_inside(path) if one != path]
        if locked:
            return f'{path} cannot be left, since {locked[0]} is locked; unlock it first'
        region.repeat()
    return refusal


def set_autonomy(run: MachineRun, level: int, path: str = '') -> str | None:
    """Set the autonomy level of the run, or of the sub-tree ``path``. It replaces the levels of nested sub-trees; a
    line for the operator lists these."""
    top = path or ROOT_PATH
    if level not in AUTONOMY_NAMES:
        return no_level(level)
    if top not in run.controls:
        return f'there is no state {path!r}'
    own = {at: one for at, one in run.controls.levels().items() if at not in (ROOT_PATH, top) and is_inside(at, top)}
    run.controls.set_level(level, top)
    replaced = ', '.join(f'{at} ({AUTONOMY_NAMES[one]})' for at, one in own.items() if one != level)
    if replaced or top != ROOT_PATH:
        text = f'its level of autonomy is {AUTONOMY_NAMES[level]} now'
        run.tell(Logged(Severity.INFO, top, f'{text}, instead of those of {replaced}' if replaced else text))
    run.tell(AutonomySet(top, level))
    return None


def pause(run: MachineRun) -> str | None:
    """Pause the run: it executes and leaves no state, and the clocks of the active states stop.

    Their on_pause is called. Until :func:`resume`, commands that would leave a state or machine are refused; other
    commands and a stop work as usual. States that are already halting continue to halt, but no state is entered.
    """
    if run.is_paused:
        return 'the run is paused already'
    run.pausing.set_paused(True)
    run.tell(RunPaused(True))
    return None


def resume(run: MachineRun) -> str | None:
    """Resume the run after :func:`pause`."""
    if not run.is_paused:
        return 'the run is not paused'
    run.pausing.set_paused(False)
    run.tell(RunPaused(False))
    return None


def lock(run: MachineRun, path: str) -> str | None:
    """Block each transition that would leave a state or machine, including those that leave a machine around it.

    A wanted outcome, also a forced one, is kept until :func:`unlock`. A stop is not blocked, nor is :func:`repeat` of
    the locked node itself. A node that is not active yet becomes locked when it is entered. A line for the operator
    tells that a node is being left already.
    """
    refusal = _mark(run, run.controls.locked, LockSet, path, 'is locked')
    found = _active(run, path)
    if refusal is None and not isinstance(found, str) and _is_left(found[0]):
        text = 'it is being left already; the lock holds it from the next time that it is entered'
        run.tell(Logged(Severity.WARN, path, text))
    return refusal


def unlock(run: MachineRun, path: str) -> str | None:
    """Undo :func:`lock`: blocked transitions happen, unless something else prevents them."""
    return _unmark(run, run.controls.locked, LockSet, path, 'is locked')


def set_breakpoint(run: MachineRun, path: str) -> str | None:
    """Make each transition out of a state or machine wait for the operator, at every level of autonomy."""
    if path == ROOT_PATH:
        return f'a breakpoint holds a transition, and none leaves {ROOT_PATH}; set it on one of its states'
    return _mark(run, run.controls.breakpoints, BreakpointSet, path, 'has a breakpoint')


def clear_breakpoint(run: MachineRun, path: str) -> str | None:
    """Undo :func:`set_breakpoint`, or end the step from a state: the autonomy level decides again, also for a
    transition that waits."""
    if run.controls.step is not None and run.controls.step.path == path and path not in run.controls.breakpoints:
        run.controls.step = None
        run.tell(BreakpointSet(path, False))
        return None
    return _unmark(run, run.controls.breakpoints, BreakpointSet, path, 'has a breakpoint')


_Marked = type[LockSet] | type[BreakpointSet]


def _mark(run: MachineRun, marked: set[str], event: _Marked, path: str, what: str) -> str | None:
    """Add a state or machine to ``marked`` and report the event. ``what`` describes the mark in a refusal."""
    if path not in run.controls:
        return f'there is no state {path!r}'
    if path in marked:
        return f'{path} {what} already'
    marked.add(path)
    run.tell(event(path, True))
    return None


def _unmark(run: MachineRun, marked: set[str], event: _Marked, path: str, what: str) -> str | None:
    """Remove a state or machine from ``marked`` and report the event."""
    if path not in marked:
        return f'{path!r} is not one that {what} ({", ".join(sorted(marked)) or "none"})'
    marked.remove(path)
    run.tell(event(path, False))
    return None


def _active(run: MachineRun, path: str) -> tuple[Region, RegionChild] | str:
    """Return the region and the active child at ``path``, or the reason for a refusal."""
    for region in run.regions():
        if region.child is not None and region.child.path == path:
            return region, region.child
    if path not in run.controls or path == ROOT_PATH:
        return f'there is no state {path!r}' if path not in run.controls else 'the root cannot be left: stop the run'
    active = ', '.join(leaf.path for leaf in run.active_states()) or 'none'
    return f'{path} is not active (active: {active})'


def _is_left(region: Region) -> bool:
    return region.is_leaving or region.container.is_ending


def _leaving(region: Region, path: str) -> str | None:
    """Return why nothing can be made of the outcomes of a node: it, or a machine around it, is to be left."""
    if _is_left(region):
        return f'{path} is being left already'
    around: ContainerRun | None = region.container
    while around is not None:
        if around.outcome is not None:
            return f'{path} stands still, since {around.path} is to be left by {around.outcome!r}'
        around = around.around
    return None


def _paused(run: MachineRun, path: str) -> str | None:
    if run.pausing.is_paused:
        return 'the run is paused; resume it first'
    return f'{path} is paused while {run.pausing.priority} has priority' if run.pausing.holds(path) else None


def _no_decision(run: MachineRun, decision_id: str) -> str:
    pending = ', '.join(decision.id for decision in run.decisions) or 'none'
    return f'decision {decision_id!r} is not pending any more (pending: {pending})'


def _deciding(run: MachineRun, decision_id: str) -> Region | None:
    return next((one for one in run.regions() if one.decision and one.decision.id == decision_id), None)
