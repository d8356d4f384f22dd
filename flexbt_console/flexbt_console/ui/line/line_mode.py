# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: run one command, print its answer on stdout, and return an exit code for scripts."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.registry import build
from flexbt_console.commands.spec import Ask, CommandLine, CommandSpec, LinkNeed, Send, Show, ShownAnswer
from flexbt_console.errors import ExitCode, NoAnswerError, NoLinkError, RefusedError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import CommandKind, ExecutiveEvent, ExecutiveSnapshot, ExecutiveState, LogLine
from flexbt_console.mirror.view import View
from flexbt_console.present.events import SETTLE_SECONDS, Event, Follower
from flexbt_console.present.json_form import encode_json, result_json, robots_json
from flexbt_console.present.rendering import behavior_line, command_result_lines, left_out_text, robot_line
from flexbt_console.present.style import coloured, has_colours
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.work_thread import watchdog
from flexbt_core.values.text import one_line

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
class LineSession:
    """What a command works with; ``timeout`` in seconds, for the executive and for its answer."""

    mirror: Mirror
    link: ExecutiveLink
    make: CommandBuilder
    line: CommandLine
    timeout: float
    clock: Clock

    def waiting_for(self, what: Callable[[], str]) -> AbstractContextManager[None]:
        """As :func:`report_wait`."""
        return report_wait(self.clock, what, self.timeout)

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
        """Return the latest lines of the log, as soon as those that are latched have arrived."""
        return self._settled(lambda: self.mirror.log(count))

    def events(self, count: int) -> tuple[ExecutiveEvent, ...]:
        """Return the latest transitions and commands, as soon as those that are latched have arrived."""
        return self._settled(lambda: self.mirror.events(count))

    def _settled(self, known: Callable[[], tuple[T, ...]]) -> tuple[T, ...]:
        """Return what arrives piece by piece, when no more of it comes."""
        now = self.link.wait_for(lambda _: known() or None, LATCHED_SECONDS) or ()
        while True:
            more = self.link.wait_for(lambda _, seen=now: _other(known(), seen), QUIET_SECONDS)  # type: ignore[misc]
            if more is None:
                return now
            now = more


def run(session: LineSession) -> ExitCode:
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
        shown = spec.action.ask(session.line, session.link, session.timeout, print_progress)
        _print(session, shown)
        return ExitCode.REFUSED if shown.is_refusal else ExitCode.OK
    as_json = session.json or session.line.has('--jsonl')
    return watch(session.mirror, session.link, as_json=as_json, seconds=session.line.seconds('--timeout'))


def _show(session: LineSession, spec: CommandSpec, action: Show) -> ExitCode:
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


def _prepared(session: LineSession, spec: CommandSpec, view: View, timeout: float) -> View:
    """Return the view with what the command shows, or is checked against, if that arrives within so many seconds."""
    has_arrived = spec.has_arrived
    if has_arrived is None:
        return view
    with session.waiting_for(lambda: f'what {spec.name} needs to know of the robot'):
        return session.link.wait_for(lambda now: now if has_arrived(now) else None, timeout) or view


def _send(session: LineSession, spec: CommandSpec) -> ExitCode:
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
    _print(session, ShownAnswer(result_json(spec.name, tracked, exit_code), command_result_lines(tracked)))
    return exit_code


def _wait_for_end(session: LineSession, name: str, tracked: TrackedCommand, run_before: str) -> ExitCode:
    if not session.json:
        _print(session, ShownAnswer(None, command_result_lines(tracked)))
    starting = name == 'start'
    answer = session.mirror.view().snapshot
    if answer is None:
        raise NoLinkError('no executive is there, whose run could be waited for')
    executive_id = tracked.command.executive_id or answer.executive_id  # a STOP names none
    run: list[str] = [] if starting else [answer.run_id]

    def end_of_run(view: View) -> ExecutiveSnapshot | None:
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
    _print(session, ShownAnswer(result, [behavior_line(session.mirror.view())]))
    return exit_code


def _print(session: LineSession, shown: ShownAnswer) -> None:
    colours = has_colours(sys.stdout)
    text = '\n'.join(coloured(line, colours) for line in shown.text)
    print(encode_json(shown.value) if session.json else text, file=sys.stdout, flush=True)


def _other(now: tuple[Any, ...], before: tuple[Any, ...]) -> tuple[Any, ...] | None:
    return now if now != before else None


# Following an executive: a line for each event, for people or for programs.


def watch(mirror: Mirror, link: ExecutiveLink, *, as_json: bool, seconds: float | None) -> ExitCode:
    """Print every change, until interrupted or for so many seconds.

    Raises:
        NoLinkError: the time is over, and no executive was heard.
    """
    follower, colours = Follower(mirror), has_colours(sys.stdout)
    end = None if seconds is None else time.monotonic() + seconds
    is_settled = as_json  # people are told in its order what is latched beside the first status

    def further_events(view: View) -> list[Event] | None:
        return [] if view.snapshot is not None and not is_settled else follower.events(view) or None

    while True:
        left = None if end is None else max(0.0, end - time.monotonic())
        events = link.wait_for(further_events, left)
        if events is None:
            break
        if not events:
            link.wait_for(lambda view: None, SETTLE_SECONDS)
            is_settled = True
        for name, value, text in events:
            if as_json:
                print(encode_json({'event': name, 'time': time.time(), **value}), flush=True)
            elif text:
                stamp = time.strftime('%H:%M:%S')
                print('\n'.join(f'{stamp} {coloured(line, colours)}' for line in text), flush=True)
    view = mirror.view()
    if view.snapshot is None:
        raise NoLinkError(f'no executive was heard in {seconds:g} s')
    return ExitCode.OK if view.link is not LinkState.LOST else ExitCode.NO_LINK


# Listing the robots of the domain, the most urgent first.

ROBOTS_QUIET_SECONDS: Final = 1.0
"""Robots are found one after the other: they are all there when none comes, and none becomes live, for so long."""

HEAR_SECONDS: Final = 5.0
"""For so long a robot that was found, and not heard yet, is waited for."""

NAME_SECONDS: Final = 1.2
"""The names of robots are all there when none has come for so long, which is longer than from look to look."""


def found_robots(fleet: Fleet, clock: Clock, timeout: float) -> tuple[str, ...]:
    """Return the names of the robots that are found: of all as soon as no further one comes, within ``timeout``
    seconds."""
    return _settled(fleet, clock, timeout, lambda: tuple(fleet.names), lambda _: NAME_SECONDS)


def list_robots(fleet: Fleet, clock: Clock, timeout: float, *, as_json: bool) -> ExitCode:
    """Print the robots that are found within ``timeout`` seconds; who is not heard within HEAR_SECONDS is unreachable.

    Raises:
        NoLinkError: there is none.
    """

    def heard() -> tuple[tuple[str, bool, bool], ...]:
        return tuple(sorted((one.name, one.view.snapshot is not None, one.view.live) for one in fleet.overview()))

    def quiet(robots: tuple[tuple[str, bool, bool], ...]) -> float:
        return ROBOTS_QUIET_SECONDS if all(one[1] for one in robots) else HEAR_SECONDS

    def wanted() -> str:
        unheard = [name for name, is_heard, _ in heard() if not is_heard]
        return f'the status of {", ".join(unheard)}' if unheard else '' if heard() else 'robots'

    with report_wait(clock, wanted, timeout):
        _settled(fleet, clock, timeout, heard, quiet)
    robots = fleet.overview()
    if not any(one.view.snapshot for one in robots):
        raise NoLinkError(f'no robot was heard within {timeout:g} s in this ROS_DOMAIN_ID')
    colours = has_colours(sys.stdout)
    lines = [coloured(robot_line(one), colours) for one in robots]
    print(encode_json(robots_json(robots)) if as_json else '\n'.join(lines), flush=True)
    for text in left_out_text(fleet.left_out):
        print_progress(text)
    return ExitCode.OK


def _settled(
    fleet: Fleet,
    clock: Clock,
    timeout: float,
    look: Callable[[], tuple[T, ...]],
    quiet: Callable[[tuple[T, ...]], float],
) -> tuple[T, ...]:
    """Return what is known of the robots when nothing of it has changed for so long, and all that are found are joined
    that may be, or after ``timeout`` seconds."""
    changed = threading.Event()
    fleet.add_listener(changed.set)
    until = end = clock.now() + timeout
    known: tuple[tuple[T, ...], bool] = (), False
    while True:
        changed.clear()
        found, is_growing, now = look(), fleet.is_growing, clock.now()
        if (found, is_growing) != known:
            known, until = (found, is_growing), end if is_growing else min(end, now + quiet(found))
        if now >= until:
            return found
        changed.wait(until - now)


# What a command waits for is said, beside its answer: on standard error, and only when it takes long.

SILENT_SECONDS: Final = 1.0
"""For so long nobody wonders what is going on."""


def report_wait(clock: Clock, what: Callable[[], str], timeout: float) -> AbstractContextManager[None]:
    """Say what the block waits for, ``timeout`` seconds at most, when it takes longer than SILENT_SECONDS; nothing when
    ``what`` is '' then."""

    def tell() -> None:
        if wanted := what():
            print_progress(f'waiting for {one_line(wanted)}, {timeout:g} s at most ...')

    return watchdog(clock, SILENT_SECONDS, tell)


def print_progress(text: str) -> None:
    """Say a line that is no part of the answer."""
    print(text, file=sys.stderr, flush=True)
