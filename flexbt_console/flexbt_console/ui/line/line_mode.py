# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: one command, its answer on stdout, and an exit code that a script can act on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from flexbt_console.commands.building import build, check_command
from flexbt_console.commands.command_line import CommandLine
from flexbt_console.commands.requests import Requests
from flexbt_console.errors import ExitCode, NoAnswerError, NoLinkError, RefusedError, UsageError
from flexbt_console.mirror import CommandState, LinkState, Mirror, TrackedCommand, View
from flexbt_console.mirror.records import ExecutiveState, Snapshot
from flexbt_console.present import json_form, rendering

from .watch import watch

if TYPE_CHECKING:
    from flexbt_console.link.operator_link import OperatorLink

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
    return _send(session, name)


def check(line: CommandLine) -> None:
    """Find what is wrong with a line before anything is started for it.

    Raises:
        UsageError: a number or a level is none, or a pair is not one.
    """
    for option in ('--timeout', '--wait-timeout'):
        line.seconds(option)
    assert line.spec is not None
    if line.spec.name == 'log':
        log_count(line)
    check_command(line)


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


def _userdata(session: Session) -> ExitCode:
    session.link.live_view(session.timeout)
    path, *keys = session.line.words or ('',)
    scopes = session.link.userdata(path, keys, session.timeout)
    _print(session, scopes, rendering.userdata(scopes))
    return ExitCode.OK


def _log(session: Session) -> ExitCode:
    session.link.live_view(session.timeout)
    count = log_count(session.line)
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


def log_count(line: CommandLine) -> int:
    """How many lines of the log are asked for.

    Raises:
        UsageError: it is no number above 0.
    """
    if not line.words:
        return LOG_COUNT
    text = line.words[0]
    if not text.isascii() or not text.isdigit() or int(text) == 0:
        raise UsageError(f'{text!r}: expected a number of lines above 0')
    return int(text)


def _places(session: Session) -> ExitCode:
    _print(session, session.requests.places, rendering.places(dict(session.requests.places)))
    return ExitCode.OK


SHOW: Final[Mapping[str, Callable[[Session], ExitCode]]] = {
    'status': _status,
    'watch': _watch,
    'behaviors': _behaviors,
    'structure': _structure,
    'userdata': _userdata,
    'log': _log,
    'places': _places,
}


# Commanding


def _prepared(session: Session, view: View, name: str) -> View:
    """The view with what the command is checked against, as far as that arrives soon."""
    if name in ('start', 'switch'):
        found = session.link.wait_for(lambda now: now if now.behaviors is not None else None, LATCHED_SECONDS)
    elif name in ('force', 'lock', 'breakpoint', 'autonomy') and view.running:
        found = session.link.wait_for(lambda now: now if now.structure else None, LATCHED_SECONDS)
    else:
        found = None
    return found or view


def _send(session: Session, name: str) -> ExitCode:
    view = _prepared(session, session.link.live_view(session.timeout), name)
    run_before = view.snapshot.run_id if view.snapshot else ''
    command = build(session.line, view, session.requests)
    session.link.send(command, session.timeout)
    tracked = session.link.settled(command.id, session.timeout + 1.0) or session.mirror.command(command.id)
    if tracked is None:
        raise NoAnswerError('no answer')
    exit_code = EXIT_CODES[tracked.state]
    if exit_code is ExitCode.TIMEOUT and session.mirror.view().link is LinkState.LOST:
        exit_code = ExitCode.NO_LINK
    if exit_code is ExitCode.OK and session.line.has('--wait'):
        return _wait_for_end(session, name, tracked, run_before)
    _print(session, json_form.result(name, tracked, exit_code), rendering.command_result(name, tracked))
    return exit_code


def _wait_for_end(session: Session, name: str, tracked: TrackedCommand, run_before: str) -> ExitCode:
    if not session.json:
        _print(session, None, rendering.command_result(name, tracked))
    starting = name == 'start'
    executive_id = tracked.command.executive_id
    run: list[str] = [] if starting else [run_before]

    def look(view: View) -> Snapshot | None:
        snapshot = view.snapshot
        if view.link is LinkState.LOST and view.age is not None and view.age > session.timeout:
            raise NoLinkError(f'the link was lost {view.age:.1f} s ago; the run may go on')
        if snapshot is None:
            return None
        if snapshot.executive_id != executive_id:
            is_kept = snapshot.state is ExecutiveState.INTERRUPTED and snapshot.run_id in run
            what = 'interrupted; "resume" goes on with it' if is_kept else 'gone'
            raise RefusedError(f'the executive was restarted; the run is {what}')
        if starting and snapshot.run_id == run_before:
            return None
        run[:] = run or [snapshot.run_id]
        if snapshot.run_id != run[0]:
            raise RefusedError('another run was started meanwhile; how this one ended was not seen')
        return snapshot if snapshot.state is ExecutiveState.IDLE else None

    ended = session.link.wait_for(look, session.line.seconds('--wait-timeout'), every=0.5)
    if ended is None:
        raise NoAnswerError('the run has not ended in the time of --wait-timeout; it goes on')
    by_itself = ended.outcome not in ('', 'preempted', 'error')
    exit_code = ExitCode.OK if by_itself or not starting else ExitCode.REFUSED
    result = json_form.result(name, tracked, exit_code, outcome=ended.outcome, message=ended.message)
    _print(session, result, [rendering.behavior_line(session.mirror.view())])
    return exit_code


def _print(session: Session, value: object, text: list[str]) -> None:
    print(json_form.encode(value) if session.json else '\n'.join(text), file=sys.stdout, flush=True)
