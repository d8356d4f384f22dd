# SPDX-License-Identifier: BSD-3-Clause
"""The standard streams of a command-line program."""

from __future__ import annotations

import os
import sys


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
