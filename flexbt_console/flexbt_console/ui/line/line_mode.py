# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: run one command, print its answer on stdout, and return an exit code for scripts."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Final, TypeVar

from flexbt_console.commands.spec import CommandLine, LinkNeed, Mode, Send, Show
from flexbt_console.errors import ExitCode, NoAnswerError, NoLinkError, RefusedError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.command_tracker import CommandState, TrackedCommand
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import CommandKind, ExecutiveSnapshot, ExecutiveState, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_console.present.events import SETTLE_SECONDS, Event, Follower
from flexbt_console.present.json_form import encode_json, result_json, robots_json
from flexbt_console.present.rendering import behavior_line, command_result_lines, left_out_text, robot_line
from flexbt_console.present.style import coloured, has_colours
from flexbt_console.ui.answers import Meaning, meaning_of
from flexbt_console.ui.station import RobotRequest, Station
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.work_thread import watchdog
from flexbt_core.values.text import one_line

T = TypeVar('T')

LATCHED_SECONDS: Final = 1.0
"""Time to wait for latched messages once the status has arrived, s."""

QUIET_SECONDS: Final = 0.1
"""The latched lines of the log arrive one by one. They are complete when none arrives for this long."""

EXIT_CODES: Final = {
    CommandState.APPLIED: ExitCode.OK,
    CommandState.REFUSED: ExitCode.REFUSED,
    CommandState.TIMEOUT: ExitCode.TIMEOUT,
    CommandState.PENDING: ExitCode.TIMEOUT,
}


class LineMode:
    """One command from its words to its exit code. It shares the session with prompt, screen and page."""

    def __init__(self, line: CommandLine, station: Station, link: ExecutiveLink, clock: Clock) -> None:
        """Prepare the command of ``line``. ``station.timeout`` is that of the link and of the answer."""
        self._line = line
        self._spec = line.spec
        self._station = station
        self._mirror = station.mirror
        self._link = link
        self._clock = clock
        self._as_json = line.has('--json') or line.has('--jsonl')
        self._has_colours = has_colours(sys.stdout)

    def run(self) -> ExitCode:
        """Run the command and print its answer.

        Raises:
            ConsoleError: it had no effect, or there is no answer; the exit code is that of the error.
        """
        if isinstance(self._spec.action, Mode):
            return self._watch(self._line.seconds('--timeout'))
        view, is_heard = self._seen()
        meaning = self.identified(meaning_of(self._line, view, self._station.builder, self._spec.name))
        done = self._station.carry_out(meaning, view)
        if isinstance(done, OperatorCommand):
            return self._wait_for_answer(done)
        if isinstance(done, RobotRequest):
            done = done.ask(self._link, print_progress)
        assert done is not None
        self.tell(done.value, done.text)
        return ExitCode.REFUSED if done.is_refusal else ExitCode.OK if is_heard else ExitCode.NO_LINK

    def _seen(self) -> tuple[View, bool]:
        """Return the view that the command needs, and whether the link was there if it needs one."""
        spec, action, is_heard = self._spec, self._spec.action, True
        view, is_command = self._mirror.view(), isinstance(action, Send)
        if spec.link is LinkNeed.LIVE or (spec.link is LinkNeed.HEARD and not is_command):  # STOP waits for nothing
            try:
                view = self._live_view()
            except NoLinkError:
                view, is_heard = self._mirror.view(), False
                if view.snapshot is None or spec.link is LinkNeed.LIVE:
                    raise
        if spec.needs:
            timeout = LATCHED_SECONDS if is_command else self._station.timeout
            with self.waiting_for(lambda: f'what {spec.name} needs to know of the robot'):
                view = self._link.wait_for(lambda now: now if spec.has_arrived(now) else None, timeout) or view
        if isinstance(action, Show) and action.history is not None:
            self._settle(action.history)
        return view, is_heard

    def _live_view(self) -> View:
        def wanted() -> str:
            view = self._mirror.view()
            if view.snapshot is None:
                return f'an executive ({view.problem or "none was heard yet"})'
            return f'a live status ({view.problem or f"the last one is {view.age or 0.0:.1f} s old"})'

        with self.waiting_for(wanted):
            return self._link.live_view(self._station.timeout)

    def _settle(self, history: Callable[[Mirror], tuple[object, ...]]) -> None:
        """Wait until no more latched messages arrive."""
        seen = self._link.wait_for(lambda _: history(self._mirror) or None, LATCHED_SECONDS)
        while seen is not None:
            before = seen
            seen = self._link.wait_for(
                lambda _, before=before: now if (now := history(self._mirror)) != before else None,  # type: ignore[misc]
                QUIET_SECONDS,
            )

    def identified(self, meaning: Meaning) -> Meaning:
        """Return the meaning with the identifier that its command is to have."""
        return meaning

    def waiting_for(self, what: Callable[[], str]) -> AbstractContextManager[None]:
        """Tell the user, during a ``with`` block that takes long, what is waited for."""
        return report_wait(self._clock, what, self._station.timeout)

    def _wait_for_answer(self, command: OperatorCommand) -> ExitCode:
        name, timeout = self._spec.name, self._station.timeout
        guard = ' or the stop guard' if command.kind is CommandKind.STOP else ''
        with self.waiting_for(lambda: f'the answer of the executive{guard}'):
            tracked = self._link.settled(command.id, timeout + 1.0) or self._mirror.command(command.id)
        if tracked is None:
            raise NoAnswerError('no answer')
        exit_code = EXIT_CODES[tracked.state]
        if exit_code is ExitCode.TIMEOUT and self._mirror.view().link is LinkState.LOST:
            exit_code = ExitCode.NO_LINK
        if exit_code is ExitCode.OK and self._line.has('--wait'):
            return self._wait_for_end(tracked)
        self.tell(result_json(name, tracked, exit_code), command_result_lines(tracked))
        return exit_code

    def _wait_for_end(self, tracked: TrackedCommand) -> ExitCode:
        if not self._as_json:
            self.tell(None, command_result_lines(tracked))
        answer = self._mirror.view().snapshot
        if answer is None:
            raise NoLinkError('there is no executive whose run could be waited for')
        executive_id = tracked.command.executive_id or answer.executive_id  # a STOP names none
        run_id = tracked.run_id or answer.run_id  # the stop guard shows none
        lost: list[float] = []  # since when: not by its age, as this computer or process may have stood still

        def end_of_run(view: View) -> ExecutiveSnapshot | None:
            snapshot, now = view.snapshot, self._clock.now()
            lost[:] = (lost or [now]) if view.link is LinkState.LOST else []
            if lost and now - lost[0] > self._station.timeout:
                raise NoLinkError(f'the link was lost {view.age or 0.0:.1f} s ago; the run may continue')
            if snapshot is None:
                return None
            if snapshot.executive_id != executive_id:
                is_kept = snapshot.state is ExecutiveState.INTERRUPTED and snapshot.run_id == run_id
                what = 'interrupted; "resume" continues it' if is_kept else 'gone'
                raise RefusedError(f'the executive was restarted; the run is {what}')
            if snapshot.run_id != run_id:
                raise RefusedError('another run was started meanwhile; how this one ended was not seen')
            return snapshot if snapshot.state is ExecutiveState.IDLE else None

        ended = self._link.wait_for(end_of_run, self._line.seconds('--wait-timeout'), every=0.5)
        if ended is None:
            raise NoAnswerError('the run did not end within --wait-timeout; it continues')
        by_itself = ended.outcome not in ('', 'preempted', 'error')
        exit_code = ExitCode.OK if by_itself or self._spec.name != 'start' else ExitCode.REFUSED
        result = result_json(self._spec.name, tracked, exit_code, outcome=ended.outcome, message=ended.message)
        self.tell(result, [behavior_line(self._mirror.view())])
        return exit_code

    def _watch(self, seconds: float | None) -> ExitCode:
        """Print a line for each event, for people or programs, until interrupted or for ``seconds``.

        Raises:
            NoLinkError: no executive was heard in that time.
        """
        follower = Follower(self._mirror)
        end = None if seconds is None else time.monotonic() + seconds
        is_settled = self._as_json  # for people, wait for the latched messages and show events in order

        def further_events(view: View) -> list[Event] | None:
            return [] if view.snapshot is not None and not is_settled else follower.events(view) or None

        while True:
            left = None if end is None else max(0.0, end - time.monotonic())
            events = self._link.wait_for(further_events, left)
            if events is None:
                break
            if not events:
                self._link.wait_for(lambda view: None, SETTLE_SECONDS)
                is_settled = True
            for name, value, text in events:
                if self._as_json or text:
                    stamp = f'{time.strftime("%H:%M:%S")} '
                    self.tell({'event': name, 'time': time.time(), **value}, text, stamp)
        view = self._mirror.view()
        if view.snapshot is None:
            raise NoLinkError(f'no executive was heard in {seconds:g} s')
        return ExitCode.OK if view.link is not LinkState.LOST else ExitCode.NO_LINK

    def tell(self, value: Any, text: list[str], prefix: str = '') -> None:
        """Print an answer: its value for programs, or its lines for people."""
        lines = '\n'.join(prefix + coloured(line, self._has_colours) for line in text)
        print(encode_json(value) if self._as_json else lines, flush=True)


# Listing the robots of the domain, the most urgent first.

ROBOTS_QUIET_SECONDS: Final = 1.0
"""Time without a new or newly live robot after which all robots are found, s: they appear one after the other."""

HEAR_SECONDS: Final = 5.0
"""Time for which a robot that was found, but not received yet, is awaited, s."""

NAME_SECONDS: Final = 1.2
"""Time without a new name after which all names of robots are known, s: longer than between two searches."""


def found_robots(fleet: Fleet, clock: Clock, timeout: float) -> tuple[str, ...]:
    """Return the names of the robots that are found within ``timeout`` seconds; return earlier when no further robot
    appears."""
    return _settled(fleet, clock, timeout, lambda: tuple(fleet.names), lambda _: NAME_SECONDS)


def list_robots(fleet: Fleet, clock: Clock, timeout: float, *, as_json: bool) -> ExitCode:
    """Print the robots found within ``timeout`` seconds. One without a status within HEAR_SECONDS is unreachable.

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
    """Return the robots once they have not changed for this time, and all found ones that may be joined are joined, or
    after ``timeout`` seconds."""
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


# Progress of a command that waits: on standard error, and only if it takes long.

SILENT_SECONDS: Final = 1.0
"""Time for which no progress needs to be shown, s."""


def report_wait(clock: Clock, what: Callable[[], str], timeout: float) -> AbstractContextManager[None]:
    """Report on standard error what the block waits for, at most ``timeout`` seconds, after SILENT_SECONDS; nothing if
    ``what`` is '' then."""

    def tell() -> None:
        if wanted := what():
            print_progress(f'waiting for {one_line(wanted)}, {timeout:g} s at most ...')

    return watchdog(clock, SILENT_SECONDS, tell)


def print_progress(text: str) -> None:
    """Print a line that is not part of the answer."""
    print(text, file=sys.stderr, flush=True)
