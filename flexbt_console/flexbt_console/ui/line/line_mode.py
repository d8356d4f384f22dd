# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: one command, its answer on stdout, and an exit code that a script can act on."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from flexbt_console.commands import Ask, CommandBuilder, CommandLine, CommandSpec, LinkNeed, Send, Show, Shown, build
from flexbt_console.errors import ExitCode, NoAnswerError, NoLinkError, RefusedError
from flexbt_console.link import OperatorLink
from flexbt_console.mirror import (
    CommandKind,
    CommandState,
    ExecutiveEvent,
    ExecutiveState,
    LinkState,
    LogLine,
    Mirror,
    Snapshot,
    TrackedCommand,
    View,
)
from flexbt_console.present import (
    behavior_line,
    coloured,
    command_result_lines,
    encode_json,
    has_colours,
    result_json,
)
from flexbt_core.clock import Clock

from .waiting import tell_progress, told_wait
from .watch import watch

T = TypeVar('T')

LATCHED_SECONDS: Final = 1.0
"""How long to wait for what is latched beside the status, once that has arrived."""

QUIET_SECONDS: Final = 0.1
"""The latched lines of the log arrive one after the other: they are complete when none comes for so long."""

EXIT_CODES: Final = {
    CommandState.APPLIED: ExitCode.OK,
    CommandState.REFUSED: ExitCode.REFUSED,
    CommandState.TIMEOUT: ExitCode.TIMEOUT,
    CommandState.PENDING: ExitCode.TIMEOUT,
}


@dataclass(frozen=True)
class Session:
    """What a command works with; ``timeout`` in seconds, for the executive and for its answer."""

    mirror: Mirror
    link: OperatorLink
    make: CommandBuilder
    line: CommandLine
    timeout: float
    clock: Clock

    def waiting_for(self, what: Callable[[], str]) -> AbstractContextManager[None]:
        """As :func:`flexbt_console.ui.line.waiting.told_wait`."""
        return told_wait(self.clock, what, self.timeout)

    def live_view(self) -> View:
        """As that of the link, within the time-out."""

        def wanted() -> str:
            view = self.mirror.view()
            if view.snapshot is None:
                return f'an executive ({view.problem or "none was heard yet"})'
            return f'a picture that is live ({view.problem or f"the last one is {view.age or 0.0:.1f} s old"})'

        with self.waiting_for(wanted):
            return self.link.live_view(self.timeout)

    @property
    def json(self) -> bool:
        """Whether the answer is for a program."""
        return self.line.has('--json')

    def log(self, count: int) -> tuple[LogLine, ...]:
        """The latest lines of the log, as soon as those that are latched have arrived."""
        return self._settled(lambda: self.mirror.log(count))

    def events(self, count: int) -> tuple[ExecutiveEvent, ...]:
        """The latest transitions and commands, as soon as those that are latched have arrived."""
        return self._settled(lambda: self.mirror.events(count))

    def _settled(self, known: Callable[[], tuple[T, ...]]) -> tuple[T, ...]:
        """What arrives piece by piece, when no more of it comes."""
        now = self.link.wait_for(lambda _: known() or None, LATCHED_SECONDS) or ()
        while True:
            more = self.link.wait_for(lambda _, seen=now: _other(known(), seen), QUIET_SECONDS)  # type: ignore[misc]
            if more is None:
                return now
            now = more


def run(session: Session) -> ExitCode:
    """Run the command of the session and print its answer.

    Raises:
        ConsoleError: it had no effect, or there is no answer; the exit code is that of the error.
    """
    spec = session.line.spec
    assert spec is not None
    if isinstance(spec.action, Send):
        return _send(session, spec)
    if isinstance(spec.action, Show):
        return _show(session, spec, spec.action)
    if isinstance(spec.action, Ask):
        session.live_view()
        shown = spec.action.ask(session.line, session.link, session.timeout, tell_progress)
        _print(session, shown)
        return ExitCode.REFUSED if shown.is_refusal else ExitCode.OK
    as_json = session.json or session.line.has('--jsonl')
    return watch(session.mirror, session.link, as_json=as_json, seconds=session.line.seconds('--timeout'))


def _show(session: Session, spec: CommandSpec, action: Show) -> ExitCode:
    exit_code = ExitCode.OK
    view = session.mirror.view()
    if spec.link is not LinkNeed.NONE:
        try:
            view = session.live_view()
        except NoLinkError:
            view = session.mirror.view()
            if view.snapshot is None or spec.link is LinkNeed.LIVE:
                raise
            exit_code = ExitCode.NO_LINK
    view = _prepared(session, spec, view, session.timeout)
    _print(session, action.show(session.line, view, session))
    return exit_code


def _prepared(session: Session, spec: CommandSpec, view: View, timeout: float) -> View:
    """The view with what the command shows, or is checked against, if that arrives within so many seconds."""
    has_arrived = spec.has_arrived
    if has_arrived is None:
        return view
    with session.waiting_for(lambda: f'what {spec.name} needs to know of the robot'):
        return session.link.wait_for(lambda now: now if has_arrived(now) else None, timeout) or view


def _send(session: Session, spec: CommandSpec) -> ExitCode:
    assert isinstance(spec.action, Send)
    is_stop = CommandKind.STOP in spec.action.kinds  # which waits for nothing: the stop guard may be all that is there
    seen = session.mirror.view() if is_stop else session.live_view()
    view = _prepared(session, spec, seen, LATCHED_SECONDS)
    run_before = view.snapshot.run_id if view.snapshot else ''
    command = build(session.line, view, session.make)
    session.link.send(command, session.timeout, spec.name)
    with session.waiting_for(lambda: f'the answer of the executive{" or the stop guard" if is_stop else ""}'):
        tracked = session.link.settled(command.id, session.timeout + 1.0) or session.mirror.command(command.id)
    if tracked is None:
        raise NoAnswerError('no answer')
    exit_code = EXIT_CODES[tracked.state]
    if exit_code is ExitCode.TIMEOUT and session.mirror.view().link is LinkState.LOST:
        exit_code = ExitCode.NO_LINK
    if exit_code is ExitCode.OK and session.line.has('--wait'):
        return _wait_for_end(session, spec.name, tracked, run_before)
    _print(session, Shown(result_json(spec.name, tracked, exit_code), command_result_lines(tracked)))
    return exit_code


def _wait_for_end(session: Session, name: str, tracked: TrackedCommand, run_before: str) -> ExitCode:
    if not session.json:
        _print(session, Shown(None, command_result_lines(tracked)))
    starting = name == 'start'
    answer = session.mirror.view().snapshot
    if answer is None:
        raise NoLinkError('no executive is there, whose run could be waited for')
    executive_id = tracked.command.executive_id or answer.executive_id  # a STOP names none
    run: list[str] = [] if starting else [answer.run_id]

    def end_of_run(view: View) -> Snapshot | None:
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

    ended = session.link.wait_for(end_of_run, session.line.seconds('--wait-timeout'), every=0.5)
    if ended is None:
        raise NoAnswerError('the run has not ended in the time of --wait-timeout; it goes on')
    by_itself = ended.outcome not in ('', 'preempted', 'error')
    exit_code = ExitCode.OK if by_itself or not starting else ExitCode.REFUSED
    result = result_json(name, tracked, exit_code, outcome=ended.outcome, message=ended.message)
    _print(session, Shown(result, [behavior_line(session.mirror.view())]))
    return exit_code


def _print(session: Session, shown: Shown) -> None:
    colours = has_colours(sys.stdout)
    text = '\n'.join(coloured(line, colours) for line in shown.text)
    print(encode_json(shown.value) if session.json else text, file=sys.stdout, flush=True)


def _other(now: tuple[Any, ...], before: tuple[Any, ...]) -> tuple[Any, ...] | None:
    return now if now != before else None
