# SPDX-License-Identifier: BSD-3-Clause
"""The standard streams of a command-line program."""

from __future__ import annotations

import errno
import os
import sys
from typing import Final

from flexbt_core.values import one_line

_FULL: Final = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def make_streams_safe() -> None:
    """A terminal or pipe that is not UTF-8 must not end the program with an encoding error: characters that it lacks
    are shown as escapes."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, 'reconfigure', None)
        if reconfigure is not None:
            reconfigure(errors='backslashreplace')


def abandon_stdout() -> None:
    """To be called when nobody reads the output any more: nothing may be written any more, at the end neither."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def is_full(error: OSError) -> bool:
    """Whether an error says that something does not fit onto a disk."""
    return error.errno in _FULL


def report_full_output(program: str, error: OSError) -> bool:
    """Whether an error is that the output does not fit onto its disk; it is told then, and nothing more is written."""
    if not is_full(error):
        return False
    abandon_stdout()
    print(one_line(f'{program}: the output is not whole: {error.strerror}'), file=sys.stderr)
    return True


def keep_stdout_for_python() -> None:
    """What native code writes to standard output goes to standard error from now on; answers are Python's alone.

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
