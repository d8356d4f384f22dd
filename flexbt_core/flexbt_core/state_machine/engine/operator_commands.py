# SPDX-License-Identifier: BSD-3-Clause
"""Commands to a run: queued on any thread, applied on the thread of the run, each answered exactly once.

A command that would change nothing is refused as well, so that each has exactly one effect or a reason.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterator
from typing import Protocol

from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES, Decision
from flexbt_core.state_machine.model.definition import ROOT_PATH, is_inside
from flexbt_core.state_machine.model.state_host import Severity

from .engine import Engine
from .leaf import LeafRun
from .region import Region, RegionChild


class CommandedRun(Engine, Protocol):
    """What the commands need of a run."""

    def regions(self) -> Iterator[Region]:
        """Return the regions of everything that is active, outermost first."""

    def active_states(self) -> list[LeafRun]:
        """Return the states that are active."""

    @property
    def decisions(self) -> list[Decision]:
        """What waits for the operator, oldest first."""


def confirm(run: CommandedRun, decision_id: str) -> str | None:
    """Let what a decision asks for happen."""
    region = _deciding(run, decision_id)
    if region is None or region.decision is None:
        return _no_decision(run, decision_id)
    decision = region.decision
    if not decision.outcome:
        return f'decision {decision_id} suggests nothing: force one of {", ".join(decision.outcomes)}'
    refusal = _paused(run, decision.path)
    if refusal is None:
        if run.monitor is not None:
            run.monitor.confirmed(decision_id)
        region.approve()
    return refusal


def force(run: CommandedRun, path: str, outcome: str, decision_id: str) -> str | None:
    """Leave a state or machine by an outcome."""
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
        if run.monitor is not None:
            run.monitor.forced(path, outcome)
        region.force(outcome)
    return refusal


def repeat(run: CommandedRun, path: str) -> str | None:
    """Leave a state or machine and enter it again."""
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


def set_autonomy(run: CommandedRun, level: int, path: str) -> str | None:
    """Set the level of a sub-tree, '' for all. It replaces those of the sub-trees in it, which the observer is told."""
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
        run.observer.log(Severity.INFO, top, f'{text}, instead of those of {replaced}' if replaced else text)
    run.changed()
    return None


def set_paused(run: CommandedRun, is_paused: bool) -> str | None:
    """Pause the run, or let it go on."""
    if run.pausing.is_paused is is_paused:
        return 'the run is paused already' if is_paused else 'the run is not paused'
    run.pausing.set_paused(is_paused)
    run.changed()
    return None


def mark(run: CommandedRun, marked: set[str], path: str, what: str) -> str | None:
    """Put a state or machine among the ``marked`` ones, which is ``what`` it has then."""
    if path not in run.controls:
        return f'there is no state {path!r}'
    if path in marked:
        return f'{path} {what} already'
    marked.add(path)
    run.changed()
    return None


def unmark(run: CommandedRun, marked: set[str], path: str, what: str) -> str | None:
    """Take a state or machine from the marked ones."""
    if path not in marked:
        return f'{path!r} is not one that {what} ({", ".join(sorted(marked)) or "none"})'
    marked.remove(path)
    run.changed()
    return None


def no_level(level: int) -> str:
    """Why a number is refused."""
    return f'autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3'


def _active(run: CommandedRun, path: str) -> tuple[Region, RegionChild] | str:
    """Return where something is active, and what it is; or why nothing can be done with it."""
    for region in run.regions():
        if region.child is not None and region.child.path == path:
            return region, region.child
    if path not in run.controls or path == ROOT_PATH:
        return f'there is no state {path!r}' if path not in run.controls else 'the root cannot be left: stop the run'
    active = ', '.join(leaf.path for leaf in run.active_states()) or 'none'
    return f'{path} is not active (active: {active})'


def _leaving(region: Region, path: str) -> str | None:
    return f'{path} is being left already' if region.is_leaving or region.container.is_ending else None


def _paused(run: CommandedRun, path: str) -> str | None:
    if run.pausing.is_paused:
        return 'the run is paused; resume it first'
    return f'{path} is paused while {run.pausing.priority} has priority' if run.pausing.holds(path) else None


def _no_decision(run: CommandedRun, decision_id: str) -> str:
    pending = ', '.join(decision.id for decision in run.decisions) or 'none'
    return f'decision {decision_id!r} is not pending any more (pending: {pending})'


def _deciding(run: CommandedRun, decision_id: str) -> Region | None:
    return next((one for one in run.regions() if one.decision and one.decision.id == decision_id), None)


# Commands to a run: given on any thread, applied on the thread of the run, each answered exactly once.

CommandReply = Callable[['str | None'], None]
"""Told the fate of a command: None when it was applied, otherwise why it was refused."""


class CommandQueue:
    """Commands in the order in which they were given."""

    def __init__(self) -> None:
        self._commands: deque[tuple[Callable[[], str | None], CommandReply]] = deque()
        self._closed: str | None = None
        self._lock = threading.Lock()

    def put(self, apply: Callable[[], str | None], answer: CommandReply) -> None:
        """Keep a command; ``apply`` gives the refusal, or None. When it is too late it is answered at once."""
        with self._lock:
            closed = self._closed
            if closed is None:
                self._commands.append((apply, answer))
        if closed is not None:
            answer(closed)

    def apply_next(self) -> bool:
        """Apply the oldest command; False when there is none."""
        if not self._commands:
            return False
        apply, answer = self._commands.popleft()
        answer(apply())
        return True

    def refuse(self, reason: str) -> None:
        """Refuse what was given up to now; not what the answers bring about, so that it comes to an end."""
        for _ in range(len(self._commands)):
            _, answer = self._commands.popleft()
            answer(reason)

    def close(self, reason: str) -> None:
        """Refuse what was given and whatever will be, on the thread that gives it."""
        with self._lock:
            self._closed = reason
        self.refuse(reason)
