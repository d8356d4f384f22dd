# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: one command, its answer on stdout, and an exit code that a script can act on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flexbt_console import json_form, rendering
from flexbt_console.command_line import CommandLine, autonomy_level
from flexbt_console.errors import ConsoleError, ExitCode, NoAnswerError, NoLinkError, RefusedError, UsageError
from flexbt_console.mirror import CommandState, LinkState, Mirror, TrackedCommand, View
from flexbt_console.mirror.records import AutonomyLevel, Command, ExecutiveState, Snapshot
from flexbt_console.operator_values import start_input
from flexbt_console.requests import Requests
from flexbt_console.watch import watch

if TYPE_CHECKING:
    from flexbt_console.operator_link import OperatorLink

DEFAULT_TIMEOUT: Final = 5.0
LOG_COUNT: Final = 20
LATCHED_SECONDS: Final = 1.0
"""How long to wait for what is latched beside the status, once that has arrived."""

EXIT_CODES: Final = {
    CommandState.APPLIED: ExitCode.OK,
    CommandState.REFUSED: ExitCode.REFUSED,
    CommandState.TIMEOUT: ExitCode.TIMEOUT,
    CommandState.PENDING: ExitCode.TIMEOUT,
}


@dataclass(frozen=True)
class Session:
    """What a command works with."""

    mirror: Mirror
    link: OperatorLink
    requests: Requests
    line: CommandLine

    @property
    def timeout(self) -> float:
        """Seconds to wait for the executive and for its answer."""
        return self.line.seconds('--timeout') or DEFAULT_TIMEOUT

    @property
    def json(self) -> bool:
        """Whether the answer is for a program."""
        return self.line.has('--json')

    @property
    def reason(self) -> str:
        """Why the command is given, for the record."""
        return self.line.value('--reason') or ''

    def word(self, index: int) -> str:
        """The word at that place, or an empty one."""
        return self.line.words[index] if index < len(self.line.words) else ''


def run(session: Session) -> ExitCode:
    """Run the command of the session and print its result.

    Raises:
        ConsoleError: it had no effect, or there is no answer; the exit code is that of the error.
    """
    assert session.line.spec is not None
    name = session.line.spec.name
    show = SHOW.get(name)
    if show is not None:
        return show(session)
    return _send(session, name, COMMANDS[name])


def check(line: CommandLine) -> None:
    """Find what is wrong with a line before anything is started for it.

    Raises:
        UsageError: a number or a level is none, or a pair is not one.
    """
    for option in ('--timeout', '--wait-timeout'):
        line.seconds(option)
    assert line.spec is not None
    if line.spec.name == 'autonomy':
        autonomy_level(line.words[0])
    if line.spec.name == 'start':
        _arguments(line)
        _start_autonomy(line)
    if line.spec.name == 'log' and line.words:
        _count(line.words[0])
    if line.spec.name == 'input' and not line.has('--decline') and not line.words:
        raise UsageError(f'usage: {line.spec.usage}')


# Showing


def _status(session: Session) -> ExitCode:
    try:
        view = session.link.live_view(session.timeout)
    except NoLinkError:
        view = session.mirror.view()
        if view.snapshot is None:
            raise
        _print(session, json_form.status(view), rendering.status(view))
        return ExitCode.NO_LINK
    _print(session, json_form.status(view), rendering.status(view))
    return ExitCode.OK


def _watch(session: Session) -> ExitCode:
    return watch(session.mirror, session.link, as_json=session.json, seconds=session.line.seconds('--timeout'))


def _behaviors(session: Session) -> ExitCode:
    session.link.live_view(session.timeout)
    known = session.link.wait_for(lambda view: view.behaviors, session.timeout)
    if known is None:
        raise NoAnswerError('the executive has not said which behaviors it has')
    _print(session, known, rendering.behaviors(known))
    return ExitCode.OK


def _structure(session: Session) -> ExitCode:
    view = session.link.live_view(session.timeout)
    if view.snapshot is None or not view.snapshot.run_id:
        raise RefusedError('nothing has run yet: there is no state machine to show')
    view = session.link.wait_for(lambda now: now if now.structure else None, session.timeout) or view
    if view.structure is None:
        raise NoAnswerError('the state machine of the run has not arrived')
    _print(session, json_form.structure(view.structure), rendering.structure(view.structure, view))
    return ExitCode.OK


def _log(session: Session) -> ExitCode:
    session.link.live_view(session.timeout)
    count = _count(session.word(0)) if session.word(0) else LOG_COUNT
    known = session.link.wait_for(lambda _: session.mirror.log(count) or None, LATCHED_SECONDS) or ()
    # The kept lines arrive one after the other: take those that come without a pause.
    while True:
        more = session.link.wait_for(
            lambda _, seen=known: _other(session.mirror.log(count), seen),  # type: ignore[misc]
            0.1,
        )
        if more is None:
            break
        known = more
    text = [line for entry in known for line in rendering.log_line(entry)]
    _print(session, known, text or ['the log is empty'])
    return ExitCode.OK


def _other(now: tuple[Any, ...], before: tuple[Any, ...]) -> tuple[Any, ...] | None:
    return now if now != before else None


def _places(session: Session) -> ExitCode:
    _print(session, session.requests.places, rendering.places(dict(session.requests.places)))
    return ExitCode.OK


SHOW: Final[Mapping[str, Callable[[Session], ExitCode]]] = {
    'status': _status,
    'watch': _watch,
    'behaviors': _behaviors,
    'structure': _structure,
    'log': _log,
    'places': _places,
}


# Commanding


def _start(session: Session, view: View) -> Command:
    line = session.line
    session.link.wait_for(lambda view: view.behaviors, LATCHED_SECONDS)
    inputs = [start_input(text, session.requests.places) for text in line.values('--input')]
    return session.requests.start(session.mirror.view(), line.words[0], _arguments(line), _start_autonomy(line), inputs)


def _stop(session: Session, view: View) -> Command:
    return session.requests.stop(view, session.reason)


def _autonomy(session: Session, view: View) -> Command:
    return session.requests.autonomy(view, autonomy_level(session.word(0)))


def _confirm(session: Session, view: View) -> Command:
    return session.requests.confirm(view, session.word(0), session.reason)


def _force(session: Session, view: View) -> Command:
    path, outcome = session.line.words if len(session.line.words) == 2 else ('', session.word(0))
    if path and view.running and view.structure is None:
        view = session.link.wait_for(lambda now: now if now.structure else None, LATCHED_SECONDS) or view
    decision_id = session.line.value('--decision') or ''
    return session.requests.force(view, path, outcome, decision_id, session.reason)


def _input(session: Session, view: View) -> Command:
    decision_id, words = session.line.value('--decision') or '', session.line.words
    if not decision_id and words and (session.line.has('--decline') or len(words) > 1):
        named = view.snapshot.decision(words[0]) if view.snapshot else None
        if named is not None or session.line.has('--decline'):
            decision_id, words = words[0], words[1:]
    if session.line.has('--decline'):
        return session.requests.decline(view, decision_id, session.reason)
    return session.requests.answer(view, decision_id, input_text(view, decision_id, words), session.reason)


def _decline(session: Session, view: View) -> Command:
    return session.requests.decline(view, session.word(0), session.reason)


def input_text(view: View, decision_id: str, words: tuple[str, ...]) -> str:
    """The words of a value as one text.

    Raises:
        RefusedError: several words for a text: the first might be meant as the name of a question that is gone.
    """
    asked = [d for d in view.decisions if d.input_type in ('string', 'str') and decision_id in ('', d.id)]
    if len(words) > 1 and asked and not decision_id:
        raise RefusedError('a text of several words is one word in quotes, or goes with --decision ID')
    return ' '.join(words)


COMMANDS: Final[Mapping[str, Callable[[Session, View], Command]]] = {
    'start': _start,
    'stop': _stop,
    'autonomy': _autonomy,
    'confirm': _confirm,
    'force': _force,
    'input': _input,
    'decline': _decline,
}


def _send(session: Session, name: str, make: Callable[[Session, View], Command]) -> ExitCode:
    view = session.link.live_view(session.timeout)
    run_before = view.snapshot.run_id if view.snapshot else ''
    command = make(session, view)
    session.link.send(command, session.timeout)
    tracked = session.link.settled(command.id, session.timeout + 1.0) or session.mirror.command(command.id)
    if tracked is None:
        raise NoAnswerError('no answer')
    exit_code = EXIT_CODES[tracked.state]
    if exit_code is ExitCode.TIMEOUT and session.mirror.view().link is LinkState.LOST:
        exit_code = ExitCode.NO_LINK
    if exit_code is ExitCode.OK and session.line.has('--wait'):
        return _wait_for_end(session, name, tracked, run_before)
    _print(session, json_form.result(name, tracked, exit_code), [rendering.command_result(name, tracked)])
    return exit_code


def _wait_for_end(session: Session, name: str, tracked: TrackedCommand, run_before: str) -> ExitCode:
    if not session.json:
        _print(session, None, [rendering.command_result(name, tracked)])
    starting = name == 'start'
    executive_id = tracked.executive_id

    def look(view: View) -> Snapshot | ConsoleError | None:
        snapshot = view.snapshot
        if view.link is LinkState.LOST and view.age is not None and view.age > session.timeout:
            return NoLinkError(f'the link was lost {view.age:.1f} s ago; the run may go on')
        if snapshot is None:
            return None
        if snapshot.executive_id != executive_id:
            return RefusedError('the executive was restarted; the run is gone')
        if starting and snapshot.run_id == run_before:
            return None
        return snapshot if snapshot.state is ExecutiveState.IDLE else None

    ended = session.link.wait_for(look, session.line.seconds('--wait-timeout'), every=0.5)
    if isinstance(ended, ConsoleError):
        raise ended
    if ended is None:
        raise NoAnswerError('the run has not ended in the time of --wait-timeout; it goes on')
    by_itself = ended.outcome not in ('', 'preempted', 'error')
    exit_code = ExitCode.OK if by_itself or not starting else ExitCode.REFUSED
    result = json_form.result(name, tracked, exit_code, outcome=ended.outcome, message=ended.message)
    _print(session, result, [rendering.behavior_line(session.mirror.view())])
    return exit_code


def _arguments(line: CommandLine) -> list[tuple[str, str]]:
    pairs = []
    for word in line.words[1:]:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise UsageError(f'{word!r}: expected PARAMETER=VALUE')
        pairs.append((key, value))
    return pairs


def _start_autonomy(line: CommandLine) -> AutonomyLevel:
    text = line.value('--autonomy')
    return AutonomyLevel.LOW if text is None else autonomy_level(text)


def _count(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) == 0:
        raise UsageError(f'{text!r}: expected a number of lines above 0')
    return int(text)


def _print(session: Session, value: object, text: list[str]) -> None:
    print(json_form.encode(value) if session.json else '\n'.join(text), file=sys.stdout, flush=True)
