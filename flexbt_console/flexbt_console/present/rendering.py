# SPDX-License-Identifier: BSD-3-Clause
"""The console's data as lines of text for a person. Everything that came over the network is escaped."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

from flexbt_console.mirror.command_tracker import CommandState, Confirmation, TrackedCommand
from flexbt_console.mirror.fleet import Need, RobotOverview, Urgency, needs_of
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    ActiveState,
    AutonomyLevel,
    Behavior,
    BehaviorParameter,
    CommandKind,
    Decision,
    DecisionKind,
    DriveProgress,
    EventKind,
    ExecutiveEvent,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    IncidentReport,
    LogLine,
    LogSeverity,
    Peer,
    StateKind,
    Structure,
    SubjectValue,
    Synthesis,
    TreeHold,
    UserdataScope,
)
from flexbt_console.mirror.view import View
from flexbt_core.values.text import escape_lines, one_line, pluralize

from .style import Line, Tone, tone_of, toned

BOOLEANS: Final = ('false', 'true')
"""Texts of the values of a parameter that is a bool."""

LABEL_LENGTH: Final = 40
"""Maximum number of characters shown of the name of a command."""

SUBJECT_LENGTH: Final = 60
"""Maximum number of characters shown of the subject of a decision."""

VALUE_LENGTH: Final = 200
"""Maximum number of characters shown of a value of userdata."""

FIRST_WALL_TIME: Final = 1e9
"""Seconds since 1970: a time before 2001 is not a time of day, but simulated time."""

_LINK_TONES: Final = {LinkState.LIVE: Tone.GOOD, LinkState.STALE: Tone.WARNING, LinkState.LOST: Tone.ERROR}
_URGENCY_TONES: Final = {
    Urgency.ALARM: Tone.ERROR,
    Urgency.DECISION: Tone.DECISION,
    Urgency.FAILED: Tone.ERROR,
    Urgency.UNREACHABLE: Tone.WARNING,
    Urgency.LATE: Tone.WARNING,
    Urgency.DEGRADED: Tone.WARNING,
    Urgency.IDLE: Tone.DIM,
}
_SEVERITY_TONES: Final = {LogSeverity.WARN: Tone.WARNING, LogSeverity.ERROR: Tone.ERROR}
_COMMAND_TONES: Final = {
    CommandState.APPLIED: Tone.PLAIN,
    CommandState.PENDING: Tone.WARNING,
    CommandState.REFUSED: Tone.WARNING,
    CommandState.TIMEOUT: Tone.ERROR,
}


def link_word(view: View) -> str:
    """State of the link and age of the picture in short: LIVE 0.4 s. No view leaves it out."""
    if view.listening:
        return Line('LISTENING', Tone.WARNING)
    text = 'NO EXECUTIVE' if view.age is None else f'{view.link.name} {age_text(view.age)}'
    return Line(text, _LINK_TONES[view.link])


def link_line(view: View) -> str:
    """State of the link and age of the picture, and what that means for the rest."""
    word = link_word(view)
    if view.age is None:
        return toned(f'{word} for an executive' if view.listening else f'{word} was heard', word)
    return Line(f'{word} ago' + ('' if view.live else ': the rest may be outdated'), _LINK_TONES[view.link])


def age_text(seconds: float) -> str:
    """Return a duration: 0.4 s, 75 s, 12 min, 3.2 h."""
    if seconds < 120.0:
        return f'{seconds:.1f} s'
    return f'{seconds / 60.0:.0f} min' if seconds < 7200.0 else f'{seconds / 3600.0:.1f} h'


def autonomy_text(level: int) -> str:
    """Return a level of autonomy with its name: 2 High."""
    try:
        return f'{level} {AutonomyLevel(level).name.capitalize()}'
    except ValueError:
        return f'{level} (unknown)'


def where_lines(snapshot: ExecutiveSnapshot) -> list[str]:
    """Return the pose of the robot, or why it is unknown: unexpected motion is not detected then."""
    pose, blind = snapshot.robot_pose, blind_text(snapshot)
    known = [pose_text(pose)] if pose is not None or not blind else []
    return [*known, *([Line(blind, Tone.WARNING)] if blind else [])]


def blind_text(snapshot: ExecutiveSnapshot) -> str:
    """Return that the pose is unknown or old, and the consequence; '' if it is known."""
    what = 'pose old' if snapshot.robot_pose is not None else 'pose unknown'
    return f'{what}: {one_line(snapshot.pose_problem)}; motion is not watched' if snapshot.pose_problem else ''


def pose_text(value: FramedPose | None) -> str:
    """Return a pose in metres and radians."""
    if value is None:
        return 'unknown'
    return f'x {value.x:.2f} m  y {value.y:.2f} m  yaw {value.yaw:.2f} rad  ({one_line(value.frame)})'


def peer_line(peer: Peer) -> str:
    """Return a node that the executive depends on; in capitals when it is not there, and what is wrong with it."""
    word, tone = 'ok', Tone.PLAIN
    if not peer.expected:
        word, tone = 'not seen', Tone.DIM
    elif not peer.alive:
        word, tone = 'not found', Tone.ERROR
    elif peer.late:
        word, tone = f'late {age_text(peer.age)}', Tone.WARNING
    elif not peer.ready:
        word, tone = 'not ready', Tone.WARNING
    problem = f': {one_line(peer.problem)}' if peer.problem and tone not in (Tone.PLAIN, Tone.DIM) else ''
    return Line(f'{one_line(peer.name)} {word}{problem}', tone)


def what_runs(view: View) -> str:
    """Return what runs, or how the last run ended, without the reason."""
    snapshot = view.snapshot
    if snapshot is None:
        return ''
    name = one_line(snapshot.behavior) or 'no behavior'
    state = snapshot.state.name
    if snapshot.state is ExecutiveState.INTERRUPTED:
        return Line(f'{state}  {name}: "resume" continues it, "abort" drops it', Tone.WARNING)
    if view.running:
        return f'{state}  {name}'
    if not snapshot.run_id:
        return f'{state}  nothing has run yet'
    if not snapshot.outcome:
        return Line(f'{state}  {name} did not start', Tone.WARNING)
    is_error = snapshot.outcome == 'error'
    return Line(f'{state}  {name} ended: {one_line(snapshot.outcome)}', Tone.ERROR if is_error else Tone.PLAIN)


def behavior_line(view: View) -> str:
    """Return what runs, or how the last run ended, and why."""
    what, snapshot = what_runs(view), view.snapshot
    why = f' ({one_line(snapshot.message)})' if snapshot is not None and snapshot.message else ''
    tone = Tone.WARNING if why and view.running else tone_of(what)
    return Line(f'{what}{why}', tone)


def authority_text(snapshot: ExecutiveSnapshot) -> str:
    """Return the operator who has the authority, and those who request it."""
    asking = ', '.join(map(one_line, snapshot.authority_requests))
    return (one_line(snapshot.authority) or 'nobody; every operator may command') + (
        f'  (requested by {asking})' if asking else ''
    )


def authority_asked_line(snapshot: ExecutiveSnapshot, operator: str | None) -> str:
    """Return the operators who request the authority from this one, and the key that answers them; '' if nobody
    does."""
    if snapshot.authority != operator or not snapshot.authority_requests:
        return ''
    oldest, *others = snapshot.authority_requests
    who = f'{one_line(oldest)} and {len(others)} more request' if others else f'{one_line(oldest)} requests'
    return Line(f'{who} control: press "c" to answer', Tone.WARNING)


def decision_line(pending: Decision, snapshot: ExecutiveSnapshot) -> str:
    """Return a pending decision of a snapshot in one line, with the identifier by which it is answered."""
    return f'[{one_line(pending.id)}] {asked_text(pending, snapshot)}'


def asked_text(pending: Decision, snapshot: ExecutiveSnapshot) -> str:
    """Return the question of a pending decision of a snapshot."""
    where = one_line(pending.path)
    prompt = f': {one_line(pending.prompt)}' if pending.prompt else ''
    if pending.kind is DecisionKind.INPUT:
        form = 'place or x y yaw' if pending.wants_pose else one_line(pending.input_type)
        return f'{where} asks for a value ({form}){prompt}'
    if pending.kind is DecisionKind.TRANSITION:
        has_breakpoint = pending.path in snapshot.breakpoints
        level = pending.required_autonomy
        is_step = snapshot.step and level >= 0 and level < snapshot.level_of(pending.path)
        needs = (
            'breakpoint'
            if has_breakpoint
            else 'step'
            if is_step
            else autonomy_needed(level)
            if level >= 0
            else 'your decision'
        )
        return f'{where} wants {one_line(pending.outcome)} ({needs}){prompt}'
    return f'{one_line(pending.prompt)} ({where})' if pending.prompt else f'{where}: choose an outcome'


def autonomy_needed(level: int) -> str:
    """Return the level of autonomy at which a transition that requires ``level`` needs no operator."""
    return 'always asks' if level >= AutonomyLevel.FULL else f'auto at {AutonomyLevel(level + 1).name.capitalize()}'


def reason_lines(pending: Decision, view: View) -> list[str]:
    """Return the state's reason for the decision, or the report that led to it; nothing if neither is known."""
    reason = view.reasons.get(pending.id)
    if reason is None:
        return []
    word = 'because' if f'{reason.path}/'.startswith(pending.path.rstrip('/') + '/') else 'after'
    first, *more = log_lines(replace(reason, path='') if reason.path == pending.path else reason)
    return [toned(f'{word} {first}', first), *more]


def subject_lines(pending: Decision, view: View) -> list[str]:
    """Return the subject of a pending decision, or that it was not received, and what part of it is not shown."""
    if lacking := view.lacks(pending):
        return [Line(f'{one_line(lacking)} NOT RECEIVED: the subject of this decision is not shown', Tone.ERROR)]
    subject = view.subject(pending)
    if subject is None:
        return []
    texts = [f'{one_line(value.key)}: {_subject_text(value, view)}' for value in subject.values]
    about = [f'about {"; ".join(texts)}'] if texts else []
    return [*about, *(Line(one_line(note), Tone.WARNING) for note in subject.notes)]


def _subject_text(value: SubjectValue, view: View) -> str:
    if value.points:
        length = sum(math.dist(a, b) for a, b in pairwise(value.points))
        return f'{length:.1f} m to {place_text(FramedPose(*value.points[-1], frame=value.frame), view.places)}'
    if value.pose is not None:
        return place_text(value.pose, view.places)
    return one_line(value.text, SUBJECT_LENGTH)


def choice_line(pending: Decision) -> str:
    """Return the choices, numbered; the outcome that the state wants is marked."""
    return '  '.join(
        f'{number} {one_line(choice)}{"*" if choice == pending.outcome else ""}'
        for number, choice in enumerate(pending.choices, 1)
    )


def status_lines(view: View) -> list[str]:
    """Return the whole view."""
    shown = [_labelled('link', link_line(view))]
    shown += [_labelled('', alarm)] if (alarm := alarm_line(view)) else []
    if view.problem:
        shown.append(_labelled('problem', Line(one_line(view.problem), Tone.ERROR)))
    snapshot = view.snapshot
    if snapshot is None:
        return shown
    shown.append(_labelled('behavior', behavior_line(view)))
    shown.append(f'autonomy  {autonomy_text(snapshot.autonomy)}')
    shown += [f'autonomy  {one_line(path)}: {autonomy_text(level)}' for path, level in snapshot.autonomy_levels]
    shown.append(f'authority {authority_text(snapshot)}')
    if snapshot.locked:
        shown.append(f'locked    {", ".join(map(one_line, snapshot.locked))}')
    if snapshot.breakpoints:
        shown.append(f'breaks at {", ".join(map(one_line, snapshot.breakpoints))}')
    if snapshot.step:
        shown.append(f'step      {one_line(snapshot.step)}; "clear" with that path ends it')
    for state in snapshot.active_states:
        shown.append(f'active    {one_line(state.path)}{" (paused)" if state.paused else ""}')
        if state.progress is not None and (text := progress_text(state.progress, view.places)):
            shown.append(f'            {text}')
        shown += [f'            {one_line(line)}' for line in state.activity]
        shown += [f'            {line}' for line in not_paused_lines(state)]
    for pending in snapshot.decisions:
        shown.append(_labelled('waiting', Line(decision_line(pending, snapshot), Tone.DECISION)))
        told = (*subject_lines(pending, view), *reason_lines(pending, view))
        shown += [toned(f'  {line}', line) for line in told]
        if pending.choices:
            shown.append(f'            {choice_line(pending)}')
    shown += [_labelled('robot', line) for line in where_lines(snapshot)]
    missed = snapshot.missed_peers
    well = [peer_line(peer) for peer in snapshot.peers if peer not in missed]
    if well:
        shown.append(_labelled('nodes', '  '.join(well)))
    shown += [_labelled('node', peer_line(peer)) for peer in missed]
    return shown


def _labelled(label: str, line: str) -> str:
    return toned(f'{label:<9} {line}', line)


def not_paused_lines(state: ActiveState) -> list[str]:
    """Return the activities of a paused state that continue nevertheless."""
    return [Line(f'still active: {one_line(text)}', Tone.WARNING) for text in state.not_paused]


def limits_text(parameter: BehaviorParameter) -> str:
    """Return the limits of a parameter with its unit, as in ``from 0 to 1 m/s``; '' where it has neither."""
    lower, upper, unit = (one_line(text) for text in (parameter.minimum, parameter.maximum, parameter.unit))
    return ' '.join([*(['from', lower] if lower else []), *(['to', upper] if upper else []), *([unit] if unit else [])])


def parameter_text(parameter: BehaviorParameter) -> str:
    """Return the text of a parameter in a form: label and name, allowed values, and description."""
    name, label = one_line(parameter.name), one_line(parameter.label)
    choices = parameter.choices or BOOLEANS * (parameter.type == 'bool')
    may_be = ' | '.join(map(one_line, choices)) or one_line(parameter.type)
    told = ', '.join(filter(None, (may_be, limits_text(parameter))))
    head = f'{label} [{name}]' if label not in ('', name) else name
    return f'{head} ({told})  {one_line(parameter.description)}'.rstrip()


def machine_text_lines(behavior: Behavior) -> list[str]:
    """Return the machine of a synthesized behavior, or that it was not received; nothing of one that is installed."""
    if behavior.lacks_machine:
        return [Line('machine NOT RECEIVED (it may be too long): this behavior is not shown', Tone.ERROR)]
    return [one_line(line) for line in behavior.machine.splitlines()]


def behaviors_lines(known: Sequence[Behavior], *, with_machines: bool = False) -> list[str]:
    """Return the behaviors and their parameters; of those that were synthesized the machine, or how many lines it
    has."""
    shown = []
    for behavior in known:
        error = f'  CANNOT BE USED: {one_line(behavior.error)}' if behavior.error else ''
        shown.append(f'{one_line(behavior.name)}  ({one_line(behavior.package)}){error}')
        if behavior.description:
            shown.append(f'    {one_line(behavior.description)}')
        for parameter in behavior.parameters:
            shown.append(f'    {parameter_text(parameter)}, default {one_line(parameter.default)}')
        for known_input in behavior.inputs:
            needed = ', needed' * known_input.needed
            type = one_line(known_input.type) or 'any type'
            shown.append(
                f'    input {one_line(known_input.key)} ({type}{needed})  {one_line(known_input.description)}'.rstrip()
            )
        machine = machine_text_lines(behavior)
        if with_machines or behavior.lacks_machine:
            shown += [toned(f'    {line}', line) for line in machine]
        elif machine:
            shown.append(f'    machine of {pluralize(len(machine), "line")}: behaviors {one_line(behavior.name)}')
    return shown or ['no behaviors are installed on the robot']


def structure_lines(known: Structure, view: View) -> list[str]:
    """Return the state machine, indented; active states are marked, each transition with what it requires."""
    active = set(view.active_levels)
    shown = [f'{one_line(known.behavior)}']
    for state in known.states:
        depth = 0 if state.path == '/' else state.path.count('/')
        label = state.path.rsplit('/', 1)[-1] or '/'
        mark = '>' if state.path in active else ' '
        kind = '' if state.kind is StateKind.STATE else f' {state.kind.name.lower()}'
        shown.append(f'{mark} {"  " * depth}{one_line(label)}  ({one_line(state.type)}{kind})')
        for one in state.transitions:
            arrow = f'{one_line(one.outcome)} -> {one_line(one.target)}' if one.target else one_line(one.outcome)
            needed = f'  requires {autonomy_text(one.autonomy)}' if one.autonomy >= 0 else ''
            shown.append(f'  {"  " * depth}    {arrow}{needed}')
    return shown


def log_lines(line: LogLine, *, with_time: bool = False) -> list[str]:
    """Return a line of the log with severity and state; continuation lines are indented."""
    severity = '' if line.severity in (LogSeverity.INFO, LogSeverity.UNKNOWN) else f'{line.severity.name}: '
    where = f'{one_line(line.path)}: ' if line.path else ''
    stamp = f'{stamp_text(line.stamp)}  ' if with_time else ''
    first, *more = escape_lines(line.text)
    tone = _SEVERITY_TONES.get(line.severity, Tone.PLAIN)
    return [Line(text, tone) for text in (f'{stamp}{severity}{where}{first}', *(f'    {text}' for text in more))]


def alarm_line(view: View) -> str:
    """Return the alarm about unwanted motion, or about the stop guard that holds the robot; '' for neither."""
    motion = view.unwanted_motion
    if motion is None or (view.guard.told and not view.live):  # the report of the guard is newer
        return Line(view.guard.told, Tone.ERROR) if view.guard.told else ''
    how_far = f'{motion.metres:.2f} m' if motion.metres >= motion.radians else f'{motion.radians:.2f} rad'
    moves = f'MOVES, {how_far} so far,'
    if not view.live or view.robot_pose is None:
        moves = f'MOVED, {how_far} when {"its pose was last known" if view.live else "it was last heard of"},'
    return Line(f'ALARM: THE ROBOT {moves} though {motion.why}; stop it again', Tone.ERROR)


def robot_line(robot: RobotOverview) -> str:
    """Return a robot of a fleet in lines: its need and for how long, its run, its position, and missing nodes."""
    view = robot.view
    if robot.is_unreachable:
        return Line(f'{one_line(robot.name):<12} {unreachable_text(view)}', _URGENCY_TONES[robot.urgency])
    words = {
        Urgency.ALARM: 'MOVES',
        Urgency.DECISION: 'waits',
        Urgency.FAILED: 'failed',
        Urgency.LATE: 'late',
        Urgency.DEGRADED: 'degraded',
    }
    word = words.get(robot.urgency, '')
    waited = age_text(robot.seconds) if robot.seconds else ''
    where = '  '.join(one_line(path) for path in view.active_paths)
    asked = asked_text(view.decision, view.snapshot) if view.decision is not None and view.snapshot else ''
    what = '  '.join(filter(None, (asked, what_runs(view), '' if asked else where, '; '.join(fault_texts(view)))))
    text = f'{one_line(robot.name):<12} {word:<8} {waited:>8}  {what}'
    return Line(text.rstrip(), _URGENCY_TONES.get(robot.urgency, Tone.PLAIN))


def fault_texts(view: View) -> list[str]:
    """Return what is wrong around a robot: the nodes that are missing, a held tree, the stop guard."""
    return list(dict.fromkeys(need_text(need, view) for need in needs_of(view) if need.urgency is Urgency.DEGRADED))


def need_text(need: Need, view: View) -> str:
    """Return one of the needs of a robot in words."""
    if isinstance(need.about, Decision) and view.snapshot is not None:
        return asked_text(need.about, view.snapshot)
    if isinstance(need.about, Peer):
        return peer_line(need.about)
    if isinstance(need.about, IncidentReport):
        return one_line(f'{need.about.folder}: {need.about.text}')
    if isinstance(need.about, TreeHold):
        return Line('a tree is held: "status" tells where', Tone.WARNING)
    texts = {
        Urgency.ALARM: alarm_line,
        Urgency.FAILED: behavior_line,
        Urgency.UNREACHABLE: unreachable_text,
        Urgency.LATE: link_line,
    }
    return texts[need.urgency](view) if need.urgency in texts else view.guard.told


def unreachable_text(view: View) -> str:
    """Return that a robot is not heard, for how long, and what it did then."""
    if view.age is None:
        return 'unreachable: never heard'
    then = '  '.join(filter(None, (what_runs(view), *map(one_line, view.active_paths))))
    return f'unreachable: last heard {view.age:.0f} s ago; {alarm_line(view) or f"then {then}"}'


def left_out_text(count: int, option: str = '--namespace') -> list[str]:
    """Return how many robots were found but not listed, and the option that selects one; nothing if all are listed."""
    return [f'{count} more not listed; name one with {option}'] if count else []


def event_line(event: ExecutiveEvent, *, with_time: bool = False) -> str:
    """Return a transition, or the result of an operator's command."""
    stamp = f'{stamp_text(event.stamp)}  ' if with_time else ''
    if event.kind is EventKind.TRANSITION:
        way = one_line(event.outcome) or one_line(event.reason)
        target = f' -> {one_line(event.target)}' if event.target else ''  # none in a container that waits for others
        return Line(f'{stamp}{one_line(event.path)}: {way}{target}', Tone.DIM)
    text = f'"{event.text}"' if event.text else ''
    what = ' '.join(filter(None, (event.command.lower(), event.target, event.path, event.outcome, text)))
    end = 'applied' if event.applied else f'refused: {event.reason}'
    told = one_line(f'{event.operator or "somebody"}: {what}: {end}')
    return Line(f'{stamp}{told}', Tone.PLAIN if event.applied else Tone.WARNING)


def progress_text(progress: DriveProgress, places: Mapping[str, FramedPose]) -> str:
    """Return the progress of a drive, such as "to kitchen  4.2 m  18 s  2 poses  1 recovery"; '' if none is known."""
    goal = progress.goal
    parts = [
        f'to {place_text(goal, places)}' if goal is not None else '',
        f'{progress.distance:.1f} m' if progress.distance is not None else '',
        f'{progress.time:.0f} s' if progress.time is not None else '',
        f'{progress.poses} poses' if progress.poses is not None and progress.poses > 1 else '',
        pluralize(progress.recoveries, 'recovery', 'recoveries') if progress.recoveries else '',
    ]
    return '  '.join(filter(None, parts))


def place_text(pose: FramedPose, places: Mapping[str, FramedPose]) -> str:
    """Return the name of the place at a pose; where there is none, its x and y, and the frame if it is not a map's."""
    frame = '' if pose.frame in ('map', *(place.frame for place in places.values())) else f' in {one_line(pose.frame)}'
    return one_line(pose.place(places)) or f'x {pose.x:.2f} y {pose.y:.2f}{frame}'


def stamp_text(stamp: float) -> str:
    """Return a time on the executive's clock: the time of day here, or the seconds of simulated time."""
    if stamp >= FIRST_WALL_TIME:
        return time.strftime('%H:%M:%S', time.localtime(stamp))
    return f'{stamp:.1f} s'.rjust(8)


def command_result_lines(tracked: TrackedCommand) -> list[str]:
    """Return the result of a command; continuation lines of the reason are indented."""
    name, duration = one_line(tracked.label, LABEL_LENGTH), tracked.duration
    is_stop = tracked.command.kind is CommandKind.STOP
    if tracked.state is CommandState.APPLIED:
        text = [f'{name}: applied ({(duration or 0.0) * 1e3:.0f} ms)']
        if is_stop and tracked.confirmed_by is Confirmation.STOP_GUARD:
            told = 'confirmed by the stop guard, which holds the robot, not by the executive'
            return [Line(f'{text[0]}, {told}', Tone.WARNING)]
        if is_stop:
            text = [f'{text[0]}, confirmed by the executive']
    elif tracked.state is CommandState.PENDING:
        text = [f'{name}: sent, {"NOT CONFIRMED yet" if is_stop else "no answer yet"}']
    else:
        first, *more = escape_lines(tracked.reason)
        end = 'refused' if tracked.state is CommandState.REFUSED else 'NO ANSWER'
        text = [f'{name}: {end}: {first}', *(f'    {line}' for line in more)]
    return [Line(line, _COMMAND_TONES[tracked.state]) for line in text]


def userdata_lines(scopes: tuple[UserdataScope, ...]) -> list[str]:
    """Return the keys of each machine with type and value; long values are cut."""
    shown = []
    for scope in scopes:
        shown.append(one_line(scope.path))
        writes = dict(enumerate(zip(scope.writers, scope.written, strict=False)))
        for number, value in enumerate(scope.values):
            text = one_line(value.text[:VALUE_LENGTH])
            if len(value.text) > VALUE_LENGTH:
                text += f'... ({len(value.text)} characters; all of them: --json)'
            writer, when = writes.get(number, ('', 0.0))
            by = f'  (by {one_line(writer)} at {stamp_text(when)})' if writer else ''
            shown.append(f'  {one_line(value.key)} ({one_line(value.type) or "cannot be sent"}) = {text}{by}')
    return shown or ['no userdata']


def synthesis_lines(made: Synthesis) -> list[str]:
    """Return the synthesized machine, its assumptions, and how to start it; or why none exists."""
    if not made.behavior:
        return [one_line(line) for line in made.explanation]
    return [
        *(one_line(line) for line in made.machine.splitlines()),
        *(f'note: {one_line(note)}' for note in made.notes),
        f'behavior {one_line(made.behavior)!r} is ready; run `start {one_line(made.behavior)}`',
    ]


def places_lines(known: Mapping[str, FramedPose]) -> list[str]:
    """Return the named places."""
    shown = [
        f'{one_line(name)}  x {place.x:.2f}  y {place.y:.2f}  yaw {place.yaw:.2f}  ({one_line(place.frame)})'
        for name, place in sorted(known.items())
    ]
    return shown or ['no named places; set the parameter "places" of the executive or the option --places']
