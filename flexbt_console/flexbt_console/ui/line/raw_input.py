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
"""Maximum characters of a line. Further characters are dropped and the line is refused: prompt_toolkit keeps a copy of
the line for each key, for undo."""

AT_ONCE: Final = 64
"""Maximum number of characters that arrive at once and count as typed; more are a paste."""

_BEGIN: Final = '\x1b[200~'
_END: Final = '\x1b[201~'
"""Marks around a paste, sent by terminals that support it."""

MOST_ESCAPE: Final = 32
"""Maximum characters of the sequence that a key sends, without the escape character."""

_CONTROL: Final = re.compile(r'([\x00-\x1f\x7f])')
_GONE: Final = frozenset({errno.EIO, errno.EBADF, errno.ENXIO, errno.EPIPE})


class Typed:
    """A filter of the input of a terminal, which drops characters that do not fit into a line.

    Between two control characters it passes :data:`MOST_TYPED` characters and one more, which shows that the line is
    too long. It passes a paste as a whole or not at all.

    prompt_toolkit searches all of a paste again with each kilobyte of it, and needs milliseconds for each typed
    character. So this passes a refused paste as an empty one, and many characters that arrive at once as a paste.
    """

    def __init__(self, on_refused: Callable[[int], object]) -> None:
        self._on_refused = on_refused
        self._typed = 0
        self._escape: str | None = None
        self._last = ''
        self._pasted: str | None = None
        self._dropped = 0

    def take(self, text: str) -> str:
        """Return the part of the received text to parse now; a paste is held back until its end has arrived."""
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
                drop = max(0, len(pasted) - MOST_TYPED - len(_END))  # the end mark may be split
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
        """Return the leading characters that belong to a key: ESC [ ... final character (ECMA-48), ESC O x, ESC x, and
        ESC [ [ x of Linux."""
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
    """The keyboard of this process. It stays raw while text is printed above the line.

    So Ctrl-C is still a key at that moment. In a cooked terminal it would be a signal to every process of the terminal,
    such as a demonstration that drives the robot.
    """

    def __init__(self, on_refused: Callable[[int], object] = lambda characters: None) -> None:
        """Call ``on_refused`` with the number of characters of each paste that was dropped because it was too long."""
        super().__init__(sys.stdin)
        self.stdin_reader = _BoundedReader(self.fileno(), sys.stdin.encoding, Typed(on_refused))

    def cooked_mode(self) -> AbstractContextManager[None]:
        """Return a context that leaves the terminal raw."""
        return contextlib.nullcontext()


def is_gone(error: BaseException | None) -> bool:
    """Return whether the error shows that the terminal no longer exists."""
    return isinstance(error, OSError) and error.errno in _GONE
