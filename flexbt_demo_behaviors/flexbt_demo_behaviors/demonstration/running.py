# SPDX-License-Identifier: BSD-3-Clause
"""The course of a demonstration, from its start to its exit code: ROS domain, signals, errors, the operator's
console."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Callable, Iterable, Iterator, Sequence
from types import FrameType
from typing import TypeVar

from flexbt_console.errors import ConsoleError
from flexbt_core.values.text import escape_lines

from .demo_processes import page_command
from .options import RunOptions
from .process_group import ProcessGroup
from .report import DemoError, Timeline
from .session import set_environment


class Interrupted(BaseException):
    """The user, or the system, wants the demonstration to end."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


Options = TypeVar('Options', bound=RunOptions)


def run_demonstration(program: str, options: Options, run: Callable[[Options, ProcessGroup, Timeline], int]) -> int:
    """Call `run` with the options, a group of processes, whose logs are in the directory of the options, and a
    timeline.

    Gives the exit code of the process: that of `run`, or 1 after an error, which is reported in the name of `program`.
    Asked to end by a signal, an interactive demonstration has done what it should; a script has not come to its end.
    All processes have ended then.
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
        _ignore_signals()  # the end has begun; a second signal must not break it off
        raise Interrupted(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)


def _ignore_signals() -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)


# The operator's console and page of a demonstration, in the terminal and in a browser.


def serve_page(group: ProcessGroup) -> str:
    """Serve the operator's page of all robots, too, and return its address; '' where aiohttp is missing."""
    with socket.socket() as free:
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    command = page_command(port)
    if not command:
        return ''
    group.start('web', command)
    return f'http://127.0.0.1:{port}/'


def page_line(page: str) -> str:
    """Return the line with the address of the page; empty where there is none."""
    return f'In a browser: {page}\n' if page else ''


def run_console(group: ProcessGroup, command: Sequence[str]) -> int:
    """Hand the terminal to a console until the operator leaves it, then report what has died; gives its exit code."""
    with _restored_terminal(), subprocess.Popen(command) as console:  # noqa: S603 - it comes from the process table
        try:
            exit_code = console.wait()
        finally:
            console.terminate()
    tell_ended(group)
    return exit_code


def tell_ended(group: ProcessGroup) -> None:
    """Print the processes that have died since the last report."""
    for process in group.take_ended():
        if process.exit_code != 0 or not process.may_end:
            print(process.report(), file=sys.stderr, flush=True)


@contextlib.contextmanager
def _restored_terminal() -> Iterator[None]:
    """Give the terminal back as it was, however the console ends."""
    before = termios.tcgetattr(sys.stdin)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSANOW, before)


# A separate ROS domain for a demonstration, so that it neither disturbs nor receives other robots.

# ROS's domain_coordinator, with which tests keep their domains apart: the process that binds TCP port 32768 + N owns
# domain N. The system closes the port when its holder ends, in whatever way.
COORDINATION_PORT = 32768
DOMAINS = range(1, 101)

# RTPS 2.5, 9.6.2.3: unicast discovery port of the first participant of a domain.
DISCOVERY_PORT = 7410
DISCOVERY_PORT_STEP = 250


class NoFreeDomainError(RuntimeError):
    """Every domain is taken on this computer."""


@contextlib.contextmanager
def own_domain(candidates: Iterable[int] | None = None) -> Iterator[int]:
    """Keep a ROS domain for the time of the context, in ROS_DOMAIN_ID, and give its number.

    An explicit ROS_DOMAIN_ID is respected and not reserved: then the user wants to meet other nodes there.
    Otherwise a domain is taken that nobody has reserved and in which no participant runs on this computer.
    Raises NoFreeDomainError when there is none.
    """
    chosen = os.environ.get('ROS_DOMAIN_ID', '')
    if chosen:
        yield int(chosen)
        return
    with contextlib.ExitStack() as reservation:
        domain = _reserve(list(candidates or random.sample(DOMAINS, len(DOMAINS))), reservation)
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        reservation.callback(os.environ.pop, 'ROS_DOMAIN_ID', None)
        yield domain


def _reserve(candidates: list[int], reservation: contextlib.ExitStack) -> int:
    for domain in candidates:
        holder = _bind(socket.SOCK_STREAM, COORDINATION_PORT + domain)
        if holder is None:
            continue
        participant = _bind(socket.SOCK_DGRAM, DISCOVERY_PORT + DISCOVERY_PORT_STEP * domain)
        if participant is None:
            holder.close()
            continue
        participant.close()
        reservation.enter_context(holder)
        return domain
    raise NoFreeDomainError(f'no free ROS domain among {len(candidates)}: set ROS_DOMAIN_ID to one that may be used')


def _bind(kind: socket.SocketKind, port: int) -> socket.socket | None:
    holder = socket.socket(socket.AF_INET, kind)
    try:
        holder.bind(('', port))
    except OSError:
        holder.close()
        return None
    return holder
