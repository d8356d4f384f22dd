# SPDX-License-Identifier: BSD-3-Clause
"""The argument parser, standard streams and signals that command-line programs share."""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import re
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import Any, Final, NoReturn

from flexbt_core.values.text import did_you_mean, one_line

_OPTION: Final = re.compile(r'(?<![\w-])--[a-z][\w-]*')
_CHOICE: Final = re.compile(r"invalid choice: '(.*)' \(choose from (.*)\)", re.DOTALL)


class SuggestingArgumentParser(argparse.ArgumentParser):
    """An argparse parser that suggests similar names for misspelled arguments, also in its sub-commands."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """As in the base, but nothing may be left."""
        found, left = super().parse_known_args(args, namespace)
        if left:
            near = did_you_mean(left[0].partition('=')[0], _OPTION.findall(self.format_help()), '')
            self.error(f'unrecognized arguments: {" ".join(left)}{near}')
        return found, left

    def error(self, message: str) -> NoReturn:
        """As in the base."""
        if choice := _CHOICE.search(message):
            message += did_you_mean(choice[1], re.findall(r"[^\s,']+", choice[2]), '')
        super().error(message)


# The standard streams of a command-line program.

_FULL: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def make_streams_safe() -> None:
    """Show characters that a terminal or pipe lacks as escapes, in place of an encoding error that ends the program."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, 'reconfigure', None)
        if reconfigure is not None:
            reconfigure(errors='backslashreplace')


def abandon_stdout() -> None:
    """Call this when the output has no reader any more: nothing may be written from then on, not even at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def is_full(error: OSError) -> bool:
    """Return whether an error says that something does not fit onto a disk."""
    return error.errno in _FULL


def report_full_output(program: str, error: OSError) -> bool:
    """Return whether an error means that the disk of the output is full; it is reported then, and nothing more is
    written."""
    if not is_full(error):
        return False
    abandon_stdout()
    print(one_line(f'{program}: the output is not whole: {error.strerror}'), file=sys.stderr)
    return True


def keep_stdout_for_python() -> None:
    """Send what native code writes to standard output to standard error from now on; answers are Python's alone.

    Fast DDS writes its errors there, with colours (its default consumer of logs): in front of an answer in JSON, a
    program could not read that any more. Nothing is done where ``sys.stdout`` is not that of the process.
    """
    stdout, stderr = sys.stdout, sys.stderr
    if stdout is not sys.__stdout__ or stdout is None or stderr is None:
        return
    stdout.flush()
    own = os.dup(stdout.fileno())
    os.dup2(stderr.fileno(), stdout.fileno())
    sys.stdout = open(own, 'w', encoding=stdout.encoding, errors=stdout.errors)  # noqa: SIM115, PTH123


# Signals that a part of a program handles for a while.


@contextlib.contextmanager
def restored_signals(*numbers: int) -> Iterator[None]:
    """After the context, these signals do what they did before it. On the main thread."""
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
