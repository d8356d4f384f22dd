# SPDX-License-Identifier: BSD-3-Clause
"""The text that definitions were read from, and where in it something is wrong."""

from __future__ import annotations

import bisect
import re

from flexbt_core.values import excerpt

from .errors import LoadError


class Source:
    """The text of one file, and the lines and columns of its offsets."""

    def __init__(self, file: str, text: str) -> None:
        self.file = file
        self.text = text
        self._line_starts: list[int] | None = None

    def position(self, offset: int) -> tuple[int, int]:
        """Line and column, from 1, of the character at ``offset``."""
        if self._line_starts is None:
            self._line_starts = [0, *(match.end() for match in re.finditer('\n', self.text))]
        line = bisect.bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def error(self, offset: int, message: str, node: str = '') -> LoadError:
        """An error at this offset. ``node`` is the element, as it is named to users."""
        line, column = self.position(offset)
        return LoadError(self.file, line, column, excerpt(node, 200), excerpt(message, 500))
