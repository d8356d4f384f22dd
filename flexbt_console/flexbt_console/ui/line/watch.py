# SPDX-License-Identifier: BSD-3-Clause
"""Following an executive: a line for each change, for people or for programs."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from flexbt_console.errors import ExitCode, NoLinkError
from flexbt_console.mirror import LinkState, Mirror, View, choices
from flexbt_console.mirror.records import LogLine, Structure
from flexbt_console.present import json_form, rendering
from flexbt_core.values import one_line

if TYPE_CHECKING:
    from flexbt_console.link.operator_link import OperatorLink


class Follower:
    """Finds what is new in a view, compared to the one before."""

    def __init__(self, mirror: Mirror) -> None:
        self._mirror = mirror
        self._before: View | None = None
        self._structure: Structure | None = None
        self._lines: tuple[LogLine, ...] = ()

    def new(self, view: View) -> list[tuple[str, Any, list[str]]]:
        """Events: name, what is told to programs, and lines for people. Heartbeats are no events."""
        events: list[tuple[str, Any, list[str]]] = []
        before, self._before = self._before, view
        if before is None or (before.link, before.problem) != (view.link, view.problem):
            problem = [one_line(view.problem)] if view.problem else []
            value = {'link': view.link.value, 'age': view.age, 'problem': view.problem}
            events.append(('link', value, [f'link: {rendering.link_word(view)}', *problem]))
        if view.structure is not None and view.structure != self._structure:
            self._structure = view.structure
            events.append(('structure', json_form.structure(view.structure), []))
        if view.behaviors is not None and (before is None or before.behaviors != view.behaviors):
            events.append(('behaviors', {'behaviors': view.behaviors}, []))
        if view.snapshot is not None:
            text = _changes(before, view)
            if before is None or before.snapshot is None or _essence(before) != _essence(view):
                events.append(('status', json_form.status(view), text))
        lines = self._mirror.log()
        known = {(line.executive_id, line.sequence) for line in self._lines}
        for line in lines:
            if (line.executive_id, line.sequence) not in known:
                events.append(('log', {'line': line}, [f'log: {text}' for text in rendering.log_line(line)]))
        self._lines = lines
        return events


def watch(mirror: Mirror, link: OperatorLink, *, as_json: bool, seconds: float | None) -> ExitCode:
    """Print every change, until interrupted or for so many seconds.

    Raises:
        NoLinkError: the time is over, and no executive was heard.
    """
    follower = Follower(mirror)
    end = None if seconds is None else time.monotonic() + seconds
    while True:
        left = None if end is None else max(0.0, end - time.monotonic())
        events = link.wait_for(lambda view: follower.new(view) or None, left)
        if events is None:
            break
        for name, value, text in events:
            if as_json:
                print(json_form.encode({'event': name, 'time': time.time(), **value}), flush=True)
            elif text:
                stamp = time.strftime('%H:%M:%S')
                print('\n'.join(f'{stamp} {line}' for line in text), flush=True)
    view = mirror.view()
    if view.snapshot is None:
        raise NoLinkError(f'no executive was heard in {seconds:g} s')
    return ExitCode.OK if view.link is not LinkState.LOST else ExitCode.NO_LINK


def _essence(view: View) -> tuple[Any, ...]:
    # What a heartbeat alone does not change.
    s = view.snapshot
    assert s is not None
    return (
        s.executive_id, s.state, s.run_id, s.behavior, s.outcome, s.message, s.autonomy, s.active_states,
        s.decisions, s.peers, s.robot_pose, s.authority, s.authority_requests,
        s.locked, s.breakpoints, s.autonomy_levels,
    )  # fmt: skip


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
        text.append(f'behavior: {rendering.behavior_line(view)}')
    if old is None or old.autonomy != new.autonomy:
        text.append(f'autonomy: {rendering.autonomy(new.autonomy)}')
    for word, before_, now in (
        ('locked', old.locked if old else (), new.locked),
        ('breakpoints', old.breakpoints if old else (), new.breakpoints),
    ):
        if before_ != now:
            text.append(f'{word}: {", ".join(map(one_line, now)) or "none"}')
    known = (old.authority, old.authority_requests) if old else ('', ())
    if known != (new.authority, new.authority_requests):
        text.append(f'authority: {rendering.authority(new)}')
    if old is None or [s.path for s in old.active_states] != [s.path for s in new.active_states]:
        active = '  '.join(one_line(state.path) for state in new.active_states)
        text.append(f'active: {active or "none"}')
    asked = {decision.id for decision in old.decisions} if old else set()
    for decision in new.decisions:
        if decision.id not in asked:
            text.append(f'waiting: {rendering.decision(decision, new)}')
            options = choices(decision)
            text += [f'    {rendering.choice_lines(options, decision.outcome)}'] if options else []
    answered = asked - {decision.id for decision in new.decisions}
    text += [f'no longer waiting: {one_line(id)}' for id in sorted(answered)]
    alive = {peer.name: peer.alive for peer in old.peers} if old else {}
    for peer in new.peers:
        if alive.get(peer.name, True) != peer.alive:
            text.append(f'node {one_line(peer.name)} is {"there again" if peer.alive else "GONE"}')
    return text
