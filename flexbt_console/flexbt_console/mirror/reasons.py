# SPDX-License-Identifier: BSD-3-Clause
"""Why a state waits for the operator, as far as it, or who was active before it, has said so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from .records import Decision, DecisionKind, EventKind, ExecutiveEvent, LogLine, Severity, Snapshot

_OLDER_SECONDS: Final = 1.0
"""What a container says about its outcome may be so much older than its decision."""

_PASSING_SECONDS: Final = 1.0
"""A state that was active for a shorter time has only led on from the one before it."""


def reasons(snapshot: Snapshot, log: Sequence[LogLine], events: Sequence[ExecutiveEvent]) -> dict[str, LogLine]:
    """By the decisions of a snapshot: the gravest of what the state has told since it was entered, the newest of these.

    Of a state that has told nothing, or asks for a value: what was told as more than information by the state that has
    led to it, or by one before that, if those between have only led on. Both sequences are in their order.
    """
    if not snapshot.decisions:
        return {}
    entered = {state.path: state.entered for state in snapshot.active_states}
    told = [line for line in log if line.run_id == snapshot.run_id]
    left = [one for one in events if one.kind is EventKind.TRANSITION and one.run_id == snapshot.run_id]
    found = {}
    for decision in snapshot.decisions:
        since = entered.get(decision.path, decision.since - _OLDER_SECONDS)
        asks = decision.kind is DecisionKind.INPUT
        line = None if asks else _gravest(line for line in _inside(told, decision.path) if line.stamp >= since)
        if line := line or _told_before(decision, told, left):
            found[decision.id] = line
    return found


def _told_before(decision: Decision, told: Sequence[LogLine], left: Sequence[ExecutiveEvent]) -> LogLine | None:
    path = decision.path
    before = _to(path, left)
    while before is not None:
        path, until = before.path, before.stamp
        left = [one for one in left if one.sequence < before.sequence]
        entry = _to(path, left)
        since = entry.stamp if entry is not None else 0.0
        grave = (line for line in _inside(told, path) if line.severity > Severity.INFO)
        if line := _gravest(line for line in grave if since <= line.stamp <= until):
            return line
        before = entry if until - since < _PASSING_SECONDS else None
    return None


def _to(path: str, left: Sequence[ExecutiveEvent]) -> ExecutiveEvent | None:
    """The latest transition to a state, or to a container around it."""
    return next((one for one in reversed(left) if one.target and f'{path}/'.startswith(f'{one.target}/')), None)


def _inside(told: Sequence[LogLine], path: str) -> Iterable[LogLine]:
    inside = path.rstrip('/') + '/'
    return (line for line in told if f'{line.path}/'.startswith(inside))


def _gravest(lines: Iterable[LogLine]) -> LogLine | None:
    return max(lines, key=lambda line: (line.severity, line.sequence), default=None)
