# SPDX-License-Identifier: BSD-3-Clause
"""What has changed from one view to the next: events, for people and for programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from flexbt_console.mirror import LogLine, Mirror, Snapshot, Structure, View
from flexbt_core.values import one_line

from .json_form import status_json, structure_json
from .rendering import authority_text, autonomy_text, behavior_line, choice_line, decision_line, link_word, log_lines


class Event(NamedTuple):
    """Something that has changed: its name, what is told to programs, and lines for people."""

    name: str
    value: dict[str, Any]
    text: list[str]


class Follower:
    """Finds what has changed in a view, compared to the one before."""

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self._before: View | None = None
        self._structure: Structure | None = None
        self._lines: tuple[LogLine, ...] = ()

    def events(self, view: View) -> list[Event]:
        """What is new. Heartbeats are no events."""
        events: list[Event] = []
        before, self._before = self._before, view
        if before is None or (before.link, before.problem) != (view.link, view.problem):
            problem = [one_line(view.problem)] if view.problem else []
            value = {'link': view.link.value, 'age': view.age, 'problem': view.problem}
            events.append(Event('link', value, [f'link: {link_word(view)}', *problem]))
        if view.structure is not None and view.structure != self._structure:
            self._structure = view.structure
            events.append(Event('structure', structure_json(view.structure), []))
        if view.behaviors is not None and (before is None or before.behaviors != view.behaviors):
            events.append(Event('behaviors', {'behaviors': view.behaviors}, []))
        if view.snapshot is not None:
            text = _changes(before, view)
            if before is None or _essence(before) != _essence(view):
                events.append(Event('status', status_json(view), text))
        lines = self._mirror.log()
        known = {(line.executive_id, line.sequence) for line in self._lines}
        for line in lines:
            if (line.executive_id, line.sequence) not in known:
                events.append(Event('log', {'line': line}, [f'log: {text}' for text in log_lines(line)]))
        self._lines = lines
        return events


def _essence(view: View) -> Snapshot | None:
    """The snapshot without what a heartbeat alone changes."""
    return view.snapshot and replace(view.snapshot, sequence=0, stamp=0.0, heartbeat_period=0.0, results=())


def _changes(before: View | None, view: View) -> list[str]:
    old = before.snapshot if before else None
    new = view.snapshot
    if new is None:
        return []
    text = []
    if old is not None and old.executive_id != new.executive_id:
        text.append('the executive was restarted')
    if old is None or (old.state, old.run_id, old.outcome, old.message) != (
        new.state,
        new.run_id,
        new.outcome,
        new.message,
    ):
        text.append(f'behavior: {behavior_line(view)}')
    if old is None or old.autonomy != new.autonomy:
        text.append(f'autonomy: {autonomy_text(new.autonomy)}')
    for word, before_, now in (
        ('locked', old.locked if old else (), new.locked),
        ('breakpoints', old.breakpoints if old else (), new.breakpoints),
    ):
        if before_ != now:
            text.append(f'{word}: {", ".join(map(one_line, now)) or "none"}')
    known = (old.authority, old.authority_requests) if old else ('', ())
    if known != (new.authority, new.authority_requests):
        text.append(f'authority: {authority_text(new)}')
    if old is None or [s.path for s in old.active_states] != [s.path for s in new.active_states]:
        active = '  '.join(one_line(state.path) for state in new.active_states)
        text.append(f'active: {active or "none"}')
    pending = {decision.id for decision in old.decisions} if old else set()
    for decision in new.decisions:
        if decision.id not in pending:
            text.append(f'waiting: {decision_line(decision, new)}')
            text += [f'    {choice_line(decision)}'] if decision.choices else []
    settled = pending - {decision.id for decision in new.decisions}
    text += [f'no longer waiting: {one_line(id)}' for id in sorted(settled)]
    alive = {peer.name: peer.alive for peer in old.peers} if old else {}
    for peer in new.peers:
        if alive.get(peer.name, True) != peer.alive:
            text.append(f'node {one_line(peer.name)} is {"there again" if peer.alive else "GONE"}')
    return text
