# SPDX-License-Identifier: BSD-3-Clause
"""The demonstration with a person at the console."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import termios
from collections.abc import Iterator, Sequence

from flexbt_console.mirror import AutonomyLevel

from .demo_processes import DemoSettings, console_command, page_command
from .process_group import ProcessGroup
from .report import Timeline
from .scripts import Demonstration
from .session import open_session

INTRODUCTION = """
The robot is ready, and the behavior "{behavior}" asks you where to go: ":{place}" answers, "g" points at the map.
"?" shows the keys, "!" stops the robot, "q" ends the demonstration.
"""


def run_interactive(
    group: ProcessGroup, settings: DemoSettings, demonstration: Demonstration, timeline: Timeline
) -> int:
    """Start the processes and the behavior, hand the terminal to the console, and give the console's exit code."""
    with open_session(group, settings, 'demo', timeline) as session:
        place = session.operator.places(('kitchen',))[0]
        session.operator.start(demonstration.behavior, AutonomyLevel.HIGH)
        session.operator.wait_state('/AskGoal')
    print(INTRODUCTION.format(behavior=demonstration.behavior, place=place), end='')
    page = serve_page(group)
    print(page_line(page), flush=True)
    return run_console(group, console_command(page=page))


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
    """Return the line that tells where the page is; empty where there is none."""
    return f'In a browser: {page}\n' if page else ''


def run_console(group: ProcessGroup, command: Sequence[str]) -> int:
    """Hand the terminal to a console until the operator leaves it, then tell what has died; gives its exit code."""
    with _restored_terminal(), subprocess.Popen(command) as console:  # noqa: S603 - it comes from the process table
        try:
            exit_code = console.wait()
        finally:
            console.terminate()
    tell_ended(group)
    return exit_code


def tell_ended(group: ProcessGroup) -> None:
    """Print which processes have died since that was told last."""
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
