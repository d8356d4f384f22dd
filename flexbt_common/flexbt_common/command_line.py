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
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NoReturn

from flexbt_core.values.text import did_you_mean, one_line

_OPTION: Final = re.compile(r'(?<![\w-])--[a-z][\w-]*')
_CHOICE: Final = re.compile(r"invalid choice: '(.*)' \(choose from (.*)\)", re.DOTALL)


class SuggestingArgumentParser(argparse.ArgumentParser):
    """An argparse parser that suggests similar names for misspelled arguments, also in its sub-commands."""

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> tuple[Any, list[str]]:  # type: ignore[override]
        """Parse as the base class does, but report leftover arguments as errors."""
        found, left = super().parse_known_args(args, namespace)
        if left:
            near = did_you_mean(left[0].partition('=')[0], _OPTION.findall(self.format_help()), '')
            self.error(f'unrecognized arguments: {" ".join(left)}{near}')
        return found, left

    def error(self, message: str) -> NoReturn:
        """Print the error with a suggestion, and exit."""
        if choice := _CHOICE.search(message):
            message += did_you_mean(choice[1], re.findall(r"[^\s,']+", choice[2]), '')
        super().error(message)


# The standard streams of a command-line program.

_FULL: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def run_program(program: str, run: Callable[[], int], exit_code_if_full: int = 2) -> int:
    """Return what ``run`` returns: the exit code of a program.

    It is 130 after Ctrl-C, 0 if the output has no reader any more, and ``exit_code_if_full`` if the disk of the output
    is full, which is reported. Characters that the encoding of an output lacks are written as escapes.
    """
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, 'reconfigure', None)
        if reconfigure is not None:
            reconfigure(errors='backslashreplace')
    try:
        exit_code = run()
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        abandon_stdout()
        return 0
    except OSError as error:
        if not is_full(error):
            raise
        abandon_stdout()
        print(one_line(f'{program}: the output is not whole: {error.strerror}'), file=sys.stderr)
        return exit_code_if_full
    return exit_code


def abandon_stdout() -> None:
    """Drop all further output, even that at exit. Call this when the output has no reader any more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def is_full(error: OSError) -> bool:
    """Return whether the cause of an error is a full disk."""
    return error.errno in _FULL


def keep_stdout_for_python() -> None:
    """Redirect what native code writes to standard output to standard error, so that only Python writes answers there.

    Fast DDS's default log consumer writes coloured errors to standard output. In front of an answer in JSON, they would
    make it unreadable for programs. No effect if ``sys.stdout`` is not that of the process.
    """
    stdout, stderr = sys.stdout, sys.stderr
    if stdout is not sys.__stdout__ or stdout is None or stderr is None:
        return
    stdout.flush()
    own = os.dup(stdout.fileno())
    os.dup2(stderr.fileno(), stdout.fileno())
    sys.stdout = open(own, 'w', encoding=stdout.encoding, errors=stdout.errors)  # noqa: SIM115, PTH123


# Signals that a part of a program handles temporarily.


@contextlib.contextmanager
def restored_signals(*numbers: int) -> Iterator[None]:
    """Restore the handlers of these signals at the end of the context. On the main thread."""
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
