# SPDX-License-Identifier: BSD-3-Clause
"""The course of a demonstration, from its command line to its exit code.

It covers processes, a node that watches them like an operator station, ROS domain, signals, errors, and the operator's
console.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import secrets
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeVar

from flexbt_common import discovery
from flexbt_common.command_line import SuggestingArgumentParser
from flexbt_common.domains import NoFreeDomainError, own_domain
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.errors import ConsoleError
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Change, Mirror
from flexbt_console.mirror.records import ExecutiveSnapshot, ExecutiveState, LogLine, LogSeverity
from flexbt_core.values.text import escape_lines

from .demo_processes import Process, page_command
from .process_group import END_TIMEOUT_S, ProcessGroup
from .report import DemoError, RobotTrack, Timeline, subscribe_to_robot
from .scripted_operator import ScriptedOperator

DEFAULT_SPEED = 1.0
DEFAULT_SCRIPT_SPEED = 10.0

EPILOG = """\
Without a terminal, or with --script, a scripted operator drives the demonstrations (both, unless one is
chosen); the exit code is 0 only when the robot was at its goals and every branch was taken, and a summary
picture of each is written. The environment variables DEMO, SPEED and OUTPUT stand for --demo, --speed and --output.
"""


SCRIPT_EPILOG = """\
Without a terminal, or with --script, a scripted operator takes every branch; the exit code is 0 only when nothing
was otherwise than expected, and a picture is written. The environment variables SPEED and OUTPUT stand for --speed
and --output.
"""


@dataclass(frozen=True)
class RunOptions:
    """Options of all demonstrations: the operator, the speed factor, and the directory of pictures and logs."""

    interactive: bool
    speed: float
    output: Path

    @property
    def logs(self) -> Path:
        """Directory of the process logs."""
        return self.output / 'logs'


@dataclass(frozen=True)
class DemoOptions(RunOptions):
    """Options of the demonstration Navigate. `map` and `places` are empty for the built-in files."""

    demos: tuple[int, ...]
    map: str
    places: str


def parse_run_options(program: str, description: str) -> RunOptions:
    """Parse the command line of a program with one demonstration. If it is invalid, exit with a message."""
    parser = SuggestingArgumentParser(prog=program, description=description, epilog=SCRIPT_EPILOG)
    _add_run_options(parser, os.environ)
    return _run_options(parser, parser.parse_args(), sys.stdin.isatty() and sys.stdout.isatty())


def parse_options(arguments: Sequence[str], environment: Mapping[str, str], terminal: bool) -> DemoOptions:
    """Parse the command line. If it is invalid, exit with a message for the user (exit code 2)."""
    parser = SuggestingArgumentParser(
        prog='demo', description='Run the FlexBT demonstrations in simulation.', epilog=EPILOG
    )
    parser.add_argument('--demo', default=environment.get('DEMO', ''), help='1: one tree navigates; 2: three trees')
    _add_run_options(parser, environment)
    parser.add_argument('--map', default='', help='ROS map YAML file; default: the built-in map')
    parser.add_argument(
        '--places',
        default='',
        help='YAML file of named places; on a map of your own, the robot starts at the first of them',
    )
    given = parser.parse_args(arguments)

    if given.demo not in ('', '1', '2'):
        others = '3 to 5, by make only, are the executables night_watch, nav2_robot and goals'
        parser.error(f'--demo {given.demo}: there are the demonstrations 1 and 2; {others}')
    if given.map and not given.places:
        parser.error('--map needs --places: the places in that map, {name: {x: 1.0, y: 2.0, yaw: 0.0}}')
    for name in ('map', 'places'):
        if getattr(given, name) and not Path(getattr(given, name)).is_file():
            parser.error(f'--{name} {getattr(given, name)}: there is no such file')
    run = _run_options(parser, given, terminal)
    return DemoOptions(
        run.interactive,
        run.speed,
        run.output,
        demos=(int(given.demo),) if given.demo else ((1,) if run.interactive else (1, 2)),
        map=str(Path(given.map).resolve()) if given.map else '',
        places=str(Path(given.places).resolve()) if given.places else '',
    )


def _add_run_options(parser: argparse.ArgumentParser, environment: Mapping[str, str]) -> None:
    parser.add_argument(
        '--speed',
        default=environment.get('SPEED', ''),
        help='seconds of simulated time in one second; default 1, with the scripted operator 10',
    )
    output = Path(environment.get('OUTPUT') or 'out')
    parser.add_argument('--output', type=Path, default=output, help='directory of pictures and logs; default: out')
    parser.add_argument('--script', action='store_true', help='let the scripted operator act, also in a terminal')


def _run_options(parser: argparse.ArgumentParser, given: argparse.Namespace, terminal: bool) -> RunOptions:
    interactive = terminal and not given.script
    speed = _speed_factor(parser, given.speed) or (DEFAULT_SPEED if interactive else DEFAULT_SCRIPT_SPEED)
    return RunOptions(interactive, speed, given.output)


def _speed_factor(parser: argparse.ArgumentParser, text: str) -> float:
    """Return the speed factor of an option --speed, 0 if it is not given. Exit with a message if it is invalid."""
    if not text:
        return 0.0
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0.0 < speed <= 100.0:
        parser.error(f'--speed {text}: expected a number above 0, up to 100')
    return speed


# Time limit from the start of the first process until the demonstration is ready, s of wall time.
READY_TIMEOUT_S = 180.0


@dataclass(frozen=True)
class DemoSession:
    """A running demonstration, and an operator connected to it on a separate node."""

    operator: ScriptedOperator
    track: RobotTrack
    runtime: NodeRuntime


def set_environment() -> None:
    """Set discovery to be quick and limited to this computer, unless the user has set it.

    Raises OSError if that is impossible, see :func:`check_loopback`.
    """
    if not os.environ.get(discovery.RANGE) and not os.environ.get(discovery.PROFILE):
        discovery.only_this_computer()
    discovery.check_loopback()
    # Each process computes little; extra threads would only compete for the cores.
    os.environ.setdefault('OMP_NUM_THREADS', '1')


@contextlib.contextmanager
def open_session(
    group: ProcessGroup, processes: Sequence[Process], operator: str, timeline: Timeline, *, is_on_call: bool = False
) -> Iterator[DemoSession]:
    """Start processes in `group`, wait until all are ready, and watch them while the context is open.

    Raises DemoError if they are not ready in time or one of them dies meanwhile. ``is_on_call`` as for
    :func:`join_robot`.
    """
    for process in processes:
        group.start(process.name, process.command(), respawn=True)
    with join_robot(operator, timeline, is_on_call=is_on_call) as session:
        group.watch(lambda ended: session.operator.abandon(ended.report()))
        session.operator.wait_ready(peers=len(processes) - 1, timeout=READY_TIMEOUT_S)
        yield session


@contextlib.contextmanager
def join_robot(
    operator: str, timeline: Timeline, namespace: str | None = None, *, is_on_call: bool = False
) -> Iterator[DemoSession]:
    """Connect an operator to the robot in a namespace, and watch the robot, while the context is open.

    ``is_on_call``: another program starts the behaviors, so their end is expected.
    """
    with NodeRuntime.open('demo', namespace=namespace) as runtime:
        track = RobotTrack()
        subscribe_to_robot(runtime, track)  # first, so that tree events are handled before their consequences
        mirror = Mirror(runtime.steady)
        link = ExecutiveLink(runtime, mirror)
        scripted = ScriptedOperator(mirror, track, link.send, CommandBuilder(operator), timeline, is_on_call)
        track.on_change = scripted.notify
        mirror.add_listener(Narrator(mirror, timeline))
        yield DemoSession(scripted, track, runtime)


class Narrator:
    """A narrator that reports events of the mirror to the timeline.

    The events are state changes, log lines of the behavior, and peers that appear and disappear.
    """

    def __init__(self, mirror: Mirror, timeline: Timeline) -> None:
        self._mirror = mirror
        self._timeline = timeline
        self._active: tuple[str, ...] = ()
        self._alive: dict[str, bool] = {}
        self._told: set[LogLine] = set()

    def __call__(self, change: Change) -> None:
        """Report a change. Called on the thread on which it arrived."""
        if change is Change.LOG:
            log = self._mirror.log()
            for line in log:
                if line not in self._told:
                    self._tell_line(line)
            self._told = set(log)
        elif change is Change.STATUS:
            snapshot = self._mirror.view().snapshot
            if snapshot is not None:
                self._tell_snapshot(snapshot)

    def _tell_line(self, line: LogLine) -> None:
        if line.severity >= LogSeverity.INFO:
            where = f'{line.path}: ' if line.path else ''
            mark = f'{line.severity.name.lower()}: ' if line.severity >= LogSeverity.WARN else ''
            self._timeline.tell('log', f'{where}{mark}{line.text}')

    def _tell_snapshot(self, snapshot: ExecutiveSnapshot) -> None:
        active = tuple(state.path for state in snapshot.active_states)
        if active != self._active:
            self._active = active
            running = snapshot.state is not ExecutiveState.IDLE
            self._timeline.tell('state', ', '.join(active) or ('(between states)' if running else '(idle)'))
        for peer in snapshot.peers:
            if self._alive.get(peer.name) and not peer.alive:
                self._timeline.tell('peer', f'{peer.name} died')
            self._alive[peer.name] = peer.alive


class Interrupted(BaseException):
    """The user or the system asked the demonstration to stop."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


Options = TypeVar('Options', bound=RunOptions)


def run_demonstration(program: str, options: Options, run: Callable[[Options, ProcessGroup, Timeline], int]) -> int:
    """Call `run` with the options, a process group that logs to the directory of the options, and a timeline.

    Return the exit code of the process: that of `run`, or 1 after an error, which is reported under the name `program`.
    If a signal ends it, an interactive demonstration counts as successful, a scripted one as incomplete. All processes
    have ended on return.
    """
    _raise_on_signals()
    try:
        with own_domain() as domain:
            set_environment()
            timeline = Timeline()
            timeline.tell('demo', f'starts its processes in ROS domain {domain}, at speed factor {options.speed:g}')
            with ProcessGroup(options.logs) as group:
                try:
                    return run(options, group, timeline)
                finally:
                    _ignore_signals()
    except (DemoError, ConsoleError, NoFreeDomainError, OSError, LookupError) as error:
        print(*escape_lines(f'{program}: {error}'), sep='\n', file=sys.stderr)
        return 1
    except Interrupted as interruption:
        return 0 if options.interactive else 128 + interruption.number


def _raise_on_signals() -> None:
    def interrupt(number: int, _frame: FrameType | None) -> None:
        _ignore_signals()  # a second signal must not interrupt the shutdown
        raise Interrupted(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


# The operator's console in the terminal, and the operator's page in a browser.


def serve_page(group: ProcessGroup) -> str:
    """Serve the operator's page of all robots, with the studio for the demonstrations if it is installed.

    Return the address of the page, with its token; '' if aiohttp is missing.
    """
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    command = page_command(port)
    if not command:
        return ''
    token = secrets.token_urlsafe(9)
    group.start('web', command, {**os.environ, 'FLEXBT_WEB_TOKEN': token})
    return f'http://127.0.0.1:{port}/#token={token}'


def page_line(page: str) -> str:
    """Return the line with the address of the page; empty without a page."""
    return f'In a browser: {page}\n' if page else ''


def run_console(group: ProcessGroup, command: Sequence[str]) -> int:
    """Run a console until the operator leaves it, then report dead processes. Return its exit code."""
    with _restored_terminal(), subprocess.Popen(command) as console:  # noqa: S603 - it comes from the process table
        try:
            exit_code = console.wait()
        finally:
            console.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                console.wait(END_TIMEOUT_S)
            console.kill()
    tell_ended(group)
    return exit_code


def tell_ended(group: ProcessGroup) -> None:
    """Print the processes that have died since the last report."""
    for process in group.take_ended():
        if process.exit_code != 0 or not process.may_end:
            print(process.report(), file=sys.stderr, flush=True)


@contextlib.contextmanager
def _restored_terminal() -> Iterator[None]:
    """Restore the terminal, however the console ends."""
    before = termios.tcgetattr(sys.stdin)
    try:
        yield
    finally:
        with contextlib.suppress(termios.error):  # it is gone
            termios.tcsetattr(sys.stdin, termios.TCSANOW, before)
