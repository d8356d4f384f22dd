# SPDX-License-Identifier: BSD-3-Clause
"""What the operator is shown of a running machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from builtin_interfaces.msg import Time

from flexbt_common.runtime import RosClock
from flexbt_core.state_machine import HeldBack, LeafRun, MachineRun, is_inside
from flexbt_core.values import sendable
from flexbt_msgs.msg import ActiveState, PendingDecision

_NANOSECONDS = 1_000_000_000

_MOST_LINES: Final = 20
_LONGEST_LINE: Final = 200
"""Of what a state says that it does: each status has it, and the link may be slow."""

_RAISED: Final = ('activity() raised; see the log',)
"""Instead of what a state says that it does. It is not asked again as long as it is active."""

_KINDS = {
    PendingDecision.TRANSITION: 'transition',
    PendingDecision.CHOICE: 'choice',
    PendingDecision.INPUT: 'input',
}


@dataclass
class _ActiveLeaf:
    path: str
    entered: Time
    run: LeafRun
    activity: tuple[str, ...] = ()
    held_back: tuple[str, ...] = ()


class RunView:
    """The picture of a machine: taken on the thread of the run with each change, read on any other."""

    def __init__(self, clock: RosClock, run_id: str) -> None:
        self._clock = clock
        # Decisions are numbered by the run; with this they are unique in the executive.
        self._prefix = f'{run_id[:8]}-'
        self._leaves: tuple[_ActiveLeaf, ...] = ()
        self._decisions: tuple[PendingDecision, ...] = ()
        self._entered_at: dict[str, float] = {}
        self._paused: frozenset[str] = frozenset()
        self.is_paused = False
        self.locked: Sequence[str] = ()
        self.breakpoints: Sequence[str] = ()
        self.levels: Mapping[str, int] = {}
        """The level of the root, and of each sub-tree that has another one than what is around it, by path."""

    def is_outdated(self, machine: MachineRun) -> bool:
        """Whether a state is active that is not in the picture."""
        return any(self._entered_at.get(leaf.path) != leaf.entered_at for leaf in machine.active_states())

    def left(self, path: str) -> None:
        """A state was left: when it is seen again it was entered anew, even if no time has passed."""
        self._entered_at.pop(path, None)

    def update(self, machine: MachineRun) -> list[tuple[str, dict[str, Any]]]:
        """Take the picture; on the thread of the run. What has not changed keeps its time stamp.

        Gives what is new as events of the record (:mod:`flexbt_onboard.record.event_log`), with their fields.
        """
        known = {leaf.path: leaf for leaf in self._leaves}
        events: list[tuple[str, dict[str, Any]]] = []
        leaves, times = [], {}
        held_back = machine.held_back
        for active in machine.active_states():
            leaf = known.get(active.path)
            if leaf is None or self._entered_at.get(active.path) != active.entered_at:
                leaf = _ActiveLeaf(active.path, self._stamp(active.entered_at), active)
                events.append(('entered', {'path': active.path}))
            leaf.held_back = tuple(_line(one, leaf.path) for one in held_back if is_inside(leaf.path, one.path))
            leaves.append(leaf)
            times[active.path] = active.entered_at
        shown = {decision.id: decision for decision in self._decisions}
        decisions = []
        for decision in machine.decisions:
            own_id = self._prefix + decision.id
            message = shown.pop(own_id, None)
            if message is None:
                message = PendingDecision(
                    id=own_id,
                    kind=decision.kind.value,
                    path=decision.path,
                    outcome=decision.outcome,
                    outcomes=list(decision.outcomes),
                    required_autonomy=decision.required,
                    prompt=decision.prompt,
                    since=self._stamp(decision.since),
                )
                events.append(('waiting', waiting_fields(message)))
            decisions.append(message)
        events += [('decided', {'decision': own_id}) for own_id in shown]
        self._entered_at = times
        self._paused = frozenset(active.path for active in machine.active_states() if active.is_paused)
        self.is_paused = machine.is_paused
        self.locked, self.breakpoints = machine.locked, machine.breakpoints
        self.levels = machine.autonomy_levels
        self._leaves, self._decisions = tuple(leaves), tuple(decisions)
        return events

    def ask_activities(self) -> bool:
        """Ask the active states what they are doing; on the thread of the run. Whether one says something else."""
        is_new = False
        for leaf in self._leaves:
            if leaf.activity is _RAISED:
                continue
            activity = _activity(leaf.run)
            is_new |= activity != leaf.activity
            leaf.activity = activity
        return is_new

    def active_states(self) -> list[ActiveState]:
        """The active leaves, with what they were doing when they were asked last, and first what locks hold back."""
        return [
            ActiveState(
                path=leaf.path,
                entered=leaf.entered,
                paused=leaf.path in self._paused,
                activity=[*leaf.held_back, *leaf.activity],
            )
            for leaf in self._leaves
        ]

    def decisions(self) -> list[PendingDecision]:
        """What waits for the operator."""
        return list(self._decisions)

    def own_decision(self, decision_id: str) -> str | None:
        """The number that the run gave to a decision; None when it is no decision of this run."""
        own = decision_id.removeprefix(self._prefix)
        return own if own != decision_id else None

    def _stamp(self, when: float) -> Time:
        """ROS time of a time of the run's clock, which may be ahead of ROS time by jumps that were taken out."""
        now = self._clock.stamp()
        nanoseconds = now.sec * _NANOSECONDS + now.nanosec - int((self._clock.now() - when) * _NANOSECONDS)
        seconds, rest = divmod(max(nanoseconds, 0), _NANOSECONDS)
        return Time(sec=seconds, nanosec=rest)


def waiting_fields(decision: PendingDecision) -> dict[str, Any]:
    """The fields of the event 'waiting' of the record."""
    return {
        'decision': decision.id,
        'path': decision.path,
        'kind': _KINDS.get(decision.kind, ''),
        'outcome': decision.outcome,
        'outcomes': list(decision.outcomes),
        'required': decision.required_autonomy,
        'prompt': decision.prompt,
    }


def _line(held_back: HeldBack, path: str) -> str:
    who = '' if held_back.path == path else f'{held_back.path}: '
    return sendable(f"{who}'{held_back.outcome}' waits for the unlock of {', '.join(held_back.locked)}", _LONGEST_LINE)


def _activity(leaf: LeafRun) -> tuple[str, ...]:
    lines = leaf.activity()
    if lines is None:
        return _RAISED
    if len(lines) > _MOST_LINES:
        lines[_MOST_LINES:] = [f'... {len(lines) - _MOST_LINES} more']
    return tuple(sendable(line, _LONGEST_LINE) for line in lines)
