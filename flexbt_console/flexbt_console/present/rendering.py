# SPDX-License-Identifier: BSD-3-Clause
"""What the console knows as lines of text for a person. Everything that came over the network is escaped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from flexbt_console.mirror import (
    AutonomyLevel,
    Behavior,
    CommandState,
    Decision,
    DecisionKind,
    ExecutiveState,
    LogLine,
    Peer,
    Pose,
    Severity,
    Snapshot,
    StateKind,
    Structure,
    TrackedCommand,
    UserdataScope,
    View,
)
from flexbt_core.values import lines, one_line

LABEL_LENGTH: Final = 40
"""How many characters are shown of what a command is called."""

VALUE_LENGTH: Final = 200
"""How many characters of a value of userdata are shown."""


def link_word(view: View) -> str:
    """State of the link and age of the picture in short: LIVE 0.4 s. No view leaves it out."""
    if view.age is None:
        return 'NO EXECUTIVE'
    return f'{view.link.name} {age_text(view.age)}'


def link_line(view: View) -> str:
    """State of the link and age of the picture, and what that means for the rest."""
    if view.age is None:
        return 'NO EXECUTIVE was heard'
    return link_word(view) + (' ago' if view.live else ' ago: what follows may not be so any more')


def age_text(seconds: float) -> str:
    """A duration: 0.4 s, 75 s, 12 min, 3.2 h."""
    if seconds < 120.0:
        return f'{seconds:.1f} s'
    return f'{seconds / 60.0:.0f} min' if seconds < 7200.0 else f'{seconds / 3600.0:.1f} h'


def autonomy_text(level: int) -> str:
    """A level of autonomy with its name: 2 High."""
    try:
        return f'{level} {AutonomyLevel(level).name.capitalize()}'
    except ValueError:
        return f'{level} (unknown)'


def pose_text(value: Pose | None) -> str:
    """A pose in metres and radians."""
    if value is None:
        return 'unknown'
    return f'x {value.x:.2f} m  y {value.y:.2f} m  yaw {value.yaw:.2f} rad  ({one_line(value.frame)})'


def peers_text(known: Sequence[Peer]) -> str:
    """The nodes that the executive depends on, those that are not there in capitals."""
    return '  '.join(
        f'{one_line(peer.name)} {"GONE" if not peer.alive else "ok" if peer.ready else "not ready"}' for peer in known
    )


def behavior_line(view: View) -> str:
    """What runs, or how the last run ended."""
    snapshot = view.snapshot
    if snapshot is None:
        return ''
    name = one_line(snapshot.behavior) or 'no behavior'
    why = f' ({one_line(snapshot.message)})' if snapshot.message else ''
    if view.running:
        hint = ': "resume" goes on with it, "abort" gives it up'
        return f'{snapshot.state.name}  {name}{hint if snapshot.state is ExecutiveState.INTERRUPTED else ""}{why}'
    last = f'{name} ended: {one_line(snapshot.outcome) or "?"}' if snapshot.run_id else 'nothing has run yet'
    return f'{snapshot.state.name}  {last}{why}'


def authority_text(snapshot: Snapshot) -> str:
    """Who may command, and who asks for it."""
    asking = ', '.join(map(one_line, snapshot.authority_requests))
    return (one_line(snapshot.authority) or 'nobody: every operator may command') + (
        f'  (asked for by {asking})' if asking else ''
    )


def decision_line(pending: Decision, snapshot: Snapshot) -> str:
    """A pending decision of a snapshot in one line."""
    where = one_line(pending.path)
    prompt = f': {one_line(pending.prompt)}' if pending.prompt else ''
    if pending.kind is DecisionKind.INPUT:
        form = 'place or x y yaw' if pending.wants_pose else one_line(pending.input_type)
        return f'[{one_line(pending.id)}] {where} asks for a value ({form}){prompt}'
    if pending.kind is DecisionKind.TRANSITION:
        has_breakpoint = pending.path in snapshot.breakpoints
        needs = f' ({"breakpoint" if has_breakpoint else _required(pending.required_autonomy)})'
        return f'[{one_line(pending.id)}] {where} wants {one_line(pending.outcome)}{needs}{prompt}'
    return f'[{one_line(pending.id)}] {where} asks to choose{prompt}'


def _required(level: int) -> str:
    if level >= AutonomyLevel.FULL:
        return 'always your decision'
    return f'requires more than {autonomy_text(level)}' if level >= 0 else 'your decision'


def choice_line(pending: Decision) -> str:
    """What may be chosen, numbered; the outcome that is wanted is marked."""
    return '  '.join(
        f'{number} {one_line(choice)}{"*" if choice == pending.outcome else ""}'
        for number, choice in enumerate(pending.choices, 1)
    )


def status_lines(view: View) -> list[str]:
    """The whole picture."""
    shown = [f'link      {link_line(view)}']
    if view.problem:
        shown.append(f'problem   {one_line(view.problem)}')
    snapshot = view.snapshot
    if snapshot is None:
        return shown
    shown.append(f'behavior  {behavior_line(view)}')
    shown.append(f'autonomy  {autonomy_text(snapshot.autonomy)}')
    shown += [f'autonomy  {one_line(path)}: {autonomy_text(level)}' for path, level in snapshot.autonomy_levels]
    shown.append(f'authority {authority_text(snapshot)}')
    if snapshot.locked:
        shown.append(f'locked    {", ".join(map(one_line, snapshot.locked))}')
    if snapshot.breakpoints:
        shown.append(f'breaks at {", ".join(map(one_line, snapshot.breakpoints))}')
    for state in snapshot.active_states:
        shown.append(f'active    {one_line(state.path)}{" (paused)" if state.paused else ""}')
        shown += [f'            {one_line(line)}' for line in state.activity]
    for pending in snapshot.decisions:
        shown.append(f'waiting   {decision_line(pending, snapshot)}')
        if pending.choices:
            shown.append(f'            {choice_line(pending)}')
    shown.append(f'robot     {pose_text(snapshot.robot_pose)}')
    if snapshot.peers:
        shown.append(f'nodes     {peers_text(snapshot.peers)}')
    return shown


def behaviors_lines(known: Sequence[Behavior]) -> list[str]:
    """The behaviors and their parameters."""
    shown = []
    for behavior in known:
        error = f'  CANNOT BE USED: {one_line(behavior.error)}' if behavior.error else ''
        shown.append(f'{one_line(behavior.name)}  ({one_line(behavior.package)}){error}')
        if behavior.description:
            shown.append(f'    {one_line(behavior.description)}')
        for parameter in behavior.parameters:
            choices = f' of {", ".join(map(one_line, parameter.choices))}' if parameter.choices else ''
            text = f'    {one_line(parameter.name)}={one_line(parameter.default)}  {one_line(parameter.type)}{choices}'
            shown.append(f'{text}  {one_line(parameter.description)}'.rstrip())
    return shown or ['no behaviors are installed on the robot']


def structure_lines(known: Structure, view: View) -> list[str]:
    """The state machine, indented; active states are marked, each transition with what it requires."""
    active = set(view.active_levels)
    shown = [f'{one_line(known.behavior)}']
    for state in known.states:
        depth = 0 if state.path == '/' else state.path.count('/')
        label = state.path.rsplit('/', 1)[-1] or '/'
        mark = '>' if state.path in active else ' '
        kind = '' if state.kind is StateKind.STATE else f' {state.kind.name.lower()}'
        shown.append(f'{mark} {"  " * depth}{one_line(label)}  ({one_line(state.type)}{kind})')
        for outcome, target, level in zip(state.outcomes, state.targets, state.autonomy, strict=False):
            arrow = f'{one_line(outcome)} -> {one_line(target)}' if target else one_line(outcome)
            needed = f'  requires {autonomy_text(level)}' if level >= 0 else ''
            shown.append(f'  {"  " * depth}    {arrow}{needed}')
    return shown


def log_lines(line: LogLine) -> list[str]:
    """A line of the log with severity and state; continuation lines are indented."""
    severity = '' if line.severity in (Severity.INFO, Severity.UNKNOWN) else f'{line.severity.name}: '
    where = f'{one_line(line.path)}: ' if line.path else ''
    first, *more = lines(line.text)
    return [f'{severity}{where}{first}', *(f'    {text}' for text in more)]


def command_result_lines(tracked: TrackedCommand) -> list[str]:
    """What became of a command; continuation lines of the reason are indented."""
    name, duration = one_line(tracked.label, LABEL_LENGTH), tracked.duration
    if tracked.state is CommandState.APPLIED:
        return [f'{name}: applied ({(duration or 0.0) * 1e3:.0f} ms)']
    if tracked.state is CommandState.PENDING:
        return [f'{name}: sent, no answer yet']
    first, *more = lines(tracked.reason)
    end = 'refused' if tracked.state is CommandState.REFUSED else 'NO ANSWER'
    return [f'{name}: {end}: {first}', *(f'    {text}' for text in more)]


def userdata_lines(scopes: tuple[UserdataScope, ...]) -> list[str]:
    """The keys of each machine with type and value; long values are cut."""
    shown = []
    for scope in scopes:
        shown.append(one_line(scope.path))
        for value in scope.values:
            text = one_line(value.text)
            if len(text) > VALUE_LENGTH:
                text = f'{text[:VALUE_LENGTH]}... ({len(text)} characters; all of them: --json)'
            shown.append(f'  {one_line(value.key)} ({one_line(value.type) or "cannot be sent"}) = {text}')
    return shown or ['the machines have no userdata']


def places_lines(known: Mapping[str, Pose]) -> list[str]:
    """The named places."""
    shown = [
        f'{one_line(name)}  x {place.x:.2f}  y {place.y:.2f}  yaw {place.yaw:.2f}  ({one_line(place.frame)})'
        for name, place in sorted(known.items())
    ]
    return shown or ['no named places; give a file with --places']
