# SPDX-License-Identifier: BSD-3-Clause
"""The raw terminal of the prompt, with bounds on what is typed or pasted, and a check that it still exists."""

from __future__ import annotations

import contextlib
import errno
import re
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from prompt_toolkit.input.posix_utils import PosixStdinReader
from prompt_toolkit.input.vt100 import Vt100Input

MOST_TYPED: Final = 5_000
"""Characters of a line; what is beyond is dropped, and the line refused. prompt_toolkit keeps a copy of the line for
each key, to undo it."""

AT_ONCE: Final = 64
"""More characters that came at once were not typed."""

_BEGIN: Final = '\x1b[200~'
_END: Final = '\x1b[201~'
"""Marks around a paste, sent by terminals that support it."""

MOST_ESCAPE: Final = 32
"""Characters of what a key sends behind the escape character."""

_CONTROL: Final = re.compile(r'([\x00-\x1f\x7f])')
_GONE: Final = frozenset({errno.EIO, errno.EBADF, errno.ENXIO, errno.EPIPE})


class Typed:
    """The input of a terminal, without what no line has room for: :data:`MOST_TYPED` characters between two control
    characters, and one more, by which the line is known to be too long; of what was pasted as a whole, all or nothing.

    prompt_toolkit looks through all of a paste again with each kilobyte of it, and takes milliseconds for each typed
    character. So a paste that is left out is an empty one to it, and many characters that came at once are a paste.
    """

    def __init__(self, on_refused: Callable[[int], object]) -> None:
        self._on_refused = on_refused
        self._typed = 0
        self._escape: str | None = None
        self._last = ''
        self._pasted: str | None = None
        self._dropped = 0

    def take(self, text: str) -> str:
        """Return the text that came, as far as it is to be parsed now: a paste is when its end has come."""
        kept = ''
        while text:
            if self._pasted is None:
                typed, begin, rest = f'{self._last}{text}'.partition(_BEGIN)
                kept += self._bounded(f'{typed}{begin}'[len(self._last) :])
                self._last = '' if begin else typed[-len(_BEGIN) + 1 :]
                self._pasted, text = ('', rest) if begin else (None, '')
                continue
            pasted, end, text = f'{self._pasted}{text}'.partition(_END)
            if end:
                size = len(pasted) + self._dropped
                kept += f'{pasted if size <= MOST_TYPED else ""}{_END}'
                if size > MOST_TYPED:
                    self._on_refused(size)
                self._pasted, self._dropped = None, 0
                self._typed, self._escape = 0, None
            else:
                drop = max(0, len(pasted) - MOST_TYPED - len(_END))  # in the rest may be the begin of its end
                self._pasted, self._dropped = pasted[drop:], self._dropped + drop
        return kept

    def _bounded(self, text: str) -> str:
        kept = []
        for part in _CONTROL.split(text):
            if len(part) == 1 and _CONTROL.match(part):
                kept.append(part)
                self._typed, self._escape = 0, '' if part == '\x1b' else None
            else:
                sequence = self._of_key(part)
                typed = part[len(sequence) :]
                fits = typed[: max(0, MOST_TYPED + 1 - self._typed)]
                kept += [sequence, f'{_BEGIN}{fits}{_END}' if len(fits) > AT_ONCE else fits]
                self._typed += len(typed)
        return ''.join(kept)

    def _of_key(self, part: str) -> str:
        """Its begin that belongs to a key: ESC [ ... final character (ECMA-48), ESC O x, ESC x, Linux's ESC [ [ x."""
        for count, character in enumerate(part):
            if self._escape is None:
                return part[:count]
            self._escape += character
            is_final = self._escape not in ('[', 'O', '[[') and '@' <= character <= '~'
            if is_final or self._escape[0] not in '[O' or len(self._escape) == MOST_ESCAPE:
                self._escape = None
        return part


class _BoundedReader(PosixStdinReader):
    def __init__(self, file: int, encoding: str, typed: Typed) -> None:
        super().__init__(file, encoding=encoding)
        self._taken = typed

    def read(self, count: int = 1024) -> str:
        return self._taken.take(super().read(count))


class RawInput(Vt100Input):
    """The keyboard of this process. It stays raw also while something is printed above the line.

    A key such as Ctrl-C at that moment is a key as ever. In a cooked terminal it would be a signal to every process
    that belongs to it, such as a demonstration that drives the robot.
    """

    def __init__(self, on_refused: Callable[[int], object] = lambda characters: None) -> None:
        """``on_refused`` gets the number of characters of a paste that was left out: it was longer than any line."""
        super().__init__(sys.stdin)
        self.stdin_reader = _BoundedReader(self.fileno(), sys.stdin.encoding, Typed(on_refused))

    def cooked_mode(self) -> AbstractContextManager[None]:
        """Nothing changes."""
        return contextlib.nullcontext()


def is_gone(error: BaseException | None) -> bool:
    """Return whether this was raised because the terminal is not there any more."""
    return isinstance(error, OSError) and error.errno in _GONE
