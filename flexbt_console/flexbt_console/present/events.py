# SPDX-License-Identifier: BSD-3-Clause
"""Changes from one view to the next: events, for people and for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror, N
from flexbt_console.mirror.records import EventKind, ExecutiveSnapshot, ExecutiveState, Structure
from flexbt_console.mirror.unexpected_motion import why_at_rest
from flexbt_console.mirror.view import View
from flexbt_core.values.text import one_line

from .debugging import breakpoint_lines, held_lines
from .json_form import status_json, structure_json
from .rendering import (
    alarm_line,
    authority_text,
    autonomy_text,
    behavior_line,
    choice_line,
    decision_line,
    event_line,
    link_word,
    log_lines,
    peer_line,
)
from .style import Line, Tone, toned

SETTLE_SECONDS: Final = 0.3
"""Time after the first status within which other latched messages, such as the log, arrive, s."""


class Event(NamedTuple):
    """A change: its name, the value for programs, and lines for people."""

    name: str
    value: dict[str, Any]
    text: list[str]


class Follower:
    """A reader of views that finds what has changed since the one before.

    Programs get all of it. For people, a momentary delay is not an event: a view shows it.
    """

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self._before: View | None = None
        self._told_link: tuple[LinkState, str] | None = None
        self._structure: Structure | None = None
        self._told: dict[type, set[tuple[str, int]]] = {}
        """Executive and number of the lines of the log, and of the events, that were there the last time."""

    def events(self, view: View) -> list[Event]:
        """Return the new events. Heartbeats are none, and none are reported before an executive could be received."""
        if view.listening:
            return []
        events: list[Event] = []
        before, self._before = self._before, view
        if before is None or (before.link, before.problem) != (view.link, view.problem):
            value = {'link': view.link.value, 'age': view.age, 'problem': view.problem}
            events.append(Event('link', value, self._link_text(view)))
        motion = view.unwanted_motion
        if (motion is None) != (before is None or before.unwanted_motion is None):
            stands = view.snapshot is not None and why_at_rest(view.snapshot)
            over = 'the robot stands again' if stands else 'the robot need not stand still any more'
            events.append(
                Event('unwanted_motion', {'unwanted_motion': motion}, [alarm_line(view) or Line(over, Tone.GOOD)])
            )
        if view.structure is not None and view.structure != self._structure:
            self._structure = view.structure
            events.append(Event('structure', structure_json(view.structure), []))
        if view.behaviors is not None and (before is None or before.behaviors != view.behaviors):
            events.append(Event('behaviors', {'behaviors': view.behaviors}, []))
        # A state reports something, and then wants something: simultaneous events are reported in this order.
        for line in self._new(self._mirror.log()):
            told: list[str] = [toned(f'log: {text}', text) for text in log_lines(line)]
            events.append(Event('log', {'line': line}, told))
        for event in self._new(self._mirror.events()):
            name = event.kind.name.lower()
            # The status has the target of a transition.
            is_told = event.kind is EventKind.COMMAND and not event.is_in_log
            events.append(Event(name, {name: event}, [event_line(event)] if is_told else []))
        if view.snapshot is not None and (before is None or _essence(before) != _essence(view)):
            events.append(Event('status', status_json(view), _changes(before, view)))
        return events

    def _new(self, numbered: Sequence[N]) -> list[N]:
        """Return the lines or events that are new since the last time."""
        if not numbered:
            return []
        kind = type(numbered[0])
        known, self._told[kind] = self._told.get(kind, set()), {(one.executive_id, one.sequence) for one in numbered}
        return [one for one in numbered if (one.executive_id, one.sequence) not in known]

    def _link_text(self, view: View) -> list[str]:
        """Return the lines for a change of the link; none while it is late, since it is LIVE or LOST soon."""
        if self._told_link is not None and view.link is LinkState.STALE and view.problem == self._told_link[1]:
            return []
        if self._told_link == (view.link, view.problem):
            return []
        self._told_link = view.link, view.problem
        word = link_word(view)
        problem = [Line(one_line(view.problem), Tone.ERROR)] if view.problem else []
        return [toned(f'link: {word}', word), *problem]


def _essence(view: View) -> ExecutiveSnapshot | None:
    """Return the snapshot without the fields that a heartbeat alone changes."""
    snapshot = view.snapshot
    if snapshot is None:
        return None
    peers = tuple(replace(peer, age=0.0, problem='') for peer in snapshot.peers)  # which may have the time
    return replace(snapshot, sequence=0, stamp=0.0, heartbeat_period=0.0, results=(), peers=peers)


def _run_essence(snapshot: ExecutiveSnapshot) -> tuple[Any, ...]:
    """Return the report of a run; parts that have not stopped yet are reported once."""
    is_stopping = snapshot.state is ExecutiveState.STOPPING
    message = bool(snapshot.message) if is_stopping else snapshot.message
    return snapshot.state, snapshot.run_id, snapshot.outcome, message


def _changes(before: View | None, view: View) -> list[str]:
    old = before.snapshot if before else None
    new = view.snapshot
    if new is None:
        return []
    text: list[str] = []
    if old is not None and old.executive_id != new.executive_id:
        text.append(Line('the executive was restarted', Tone.WARNING))
    if old is None or _run_essence(old) != _run_essence(new):
        what = behavior_line(view)
        text.append(toned(f'behavior: {what}', what))
    if old is None or old.autonomy != new.autonomy:
        text.append(f'autonomy: {autonomy_text(new.autonomy)}')
    for word, before_, now in (
        ('locked', old.locked if old else (), new.locked),
        ('breakpoints', old.breakpoints if old else (), new.breakpoints),
    ):
        if before_ != now:
            text.append(f'{word}: {", ".join(map(one_line, now)) or "none"}')
    if (old.tree_holds if old else ()) != new.tree_holds:
        text += held_lines(new) or ['no tree is held']
    if (old.tree_breakpoints if old else ()) != new.tree_breakpoints:
        text += breakpoint_lines(new) or ['nothing is set at trees']
    known = (old.authority, old.authority_requests) if old else ('', ())
    if known != (new.authority, new.authority_requests):
        text.append(f'authority: {authority_text(new)}')
    if old is None or [s.path for s in old.active_states] != [s.path for s in new.active_states]:
        active = '  '.join(one_line(state.path) for state in new.active_states)
        text.append(f'active: {active or "none"}')
    pending = {decision.id for decision in old.decisions} if old else set()
    for decision in new.decisions:
        if decision.id not in pending:
            text.append(Line(f'waiting: {decision_line(decision, new)}', Tone.DECISION))
            text += [f'    {choice_line(decision)}'] if decision.choices else []
    settled = pending - {decision.id for decision in new.decisions}
    text += [f'no longer waiting: {one_line(id)}' for id in sorted(settled)]
    alive = {peer.name: peer.alive for peer in old.peers} if old else {}
    for peer in new.peers:
        if peer.expected and alive.get(peer.name, True) != peer.alive:
            again = Line(f'node {one_line(peer.name)} is there again', Tone.GOOD)
            text.append(again if peer.alive else Line(f'node {peer_line(peer)}', Tone.ERROR))
    return text
