# SPDX-License-Identifier: BSD-3-Clause
"""The commands behind the Makefile."""

from __future__ import annotations

import argparse
import fcntl
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from workspace import bench, lint, prerequisites, test_run
from workspace.errors import WorkspaceError, of_system
from workspace.layout import Layout, remove
from workspace.terminal import report
from workspace.underlay import with_spaces
from workspace.workspace import Workspace

_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; gives the exit code."""
    parser = argparse.ArgumentParser(
        prog='tools/workspace.sh', description='Set-up, checks and tests of the workspace.'
    )
    commands = parser.add_subparsers(dest='command', required=True)
    commands.add_parser('setup', help='install what is missing, build what changed')
    run = commands.add_parser('run', help='set up, then run a program of the workspace')
    run.add_argument('program', nargs=argparse.REMAINDER)
    commands.add_parser('lint', help='set up, then ruff, mypy and shellcheck')
    commands.add_parser('test', help='set up, then lint and all tests')
    commands.add_parser('bench', help='set up, then the benchmarks')
    clean = commands.add_parser('clean', help='remove build, install, log and out')
    clean.add_argument('--all', action='store_true', help='also .venv and the caches')
    options = parser.parse_args(arguments)

    layout = Layout.of_this_file()
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, _interrupt)
    try:
        layout = with_spaces(layout, os.environ)
        if options.command == 'clean':
            return _clean(layout, everything=options.all)
        workspace = _set_up(layout)
        if options.command == 'run':
            workspace.become(options.program)
        runners = {'lint': lint.run, 'test': test_run.run, 'bench': bench.run}
        return runners[options.command](workspace) if options.command in runners else 0
    except WorkspaceError as error:
        report(error)
        return 1
    except OSError as error:
        report(of_system(error, layout.root))
        return 1
    except KeyboardInterrupt:
        print('\ninterrupted; the same command goes on from here', file=sys.stderr)
        return _INTERRUPTED


def _set_up(layout: Layout) -> Workspace:
    """Make sure that everything is installed and built."""
    start = time.monotonic()
    workspace = Workspace(layout, os.environ)
    with _alone(layout) as lock:
        if not workspace.is_installed():
            print(f'set-up on {workspace.underlay.describe()}', flush=True)
            prerequisites.check(workspace.underlay, layout, workspace.clean_environment)
        workspace.ensure(lock)
    print(f'set-up is complete ({time.monotonic() - start:.1f} s)', flush=True)
    return workspace


@contextmanager
def _alone(layout: Layout) -> Iterator[int]:
    """Wait until no other set-up or clean of this workspace is at work; gives the descriptor that keeps it so."""
    lock = os.open(layout.root, os.O_RDONLY)
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print('another set-up of this workspace is at work; waiting for it', flush=True)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield lock
    finally:
        os.close(lock)


def _clean(layout: Layout, *, everything: bool) -> int:
    places = [layout.build, layout.install, layout.log, layout.out]
    if everything:
        places += [
            layout.venv,
            *(layout.root / name for name in ('.mypy_cache', '.pytest_cache', '.ruff_cache', '.hypothesis')),
        ]
    with _alone(layout):
        for place in places:
            remove(place)
    return 0


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
