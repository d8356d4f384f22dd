# SPDX-License-Identifier: BSD-3-Clause
"""Random damage to texts: what is left of a text, of two texts, of a text with foreign words in it."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from typing import Final

LONGEST: Final = 240_000
"""Characters that no damaged text is longer than."""

TOKEN: Final = re.compile(r'<!--|-->|<\?|\?>|</|/>|[<>="\'&;{}\[\],:()]|\w+|\s+|.', re.DOTALL)

ANYWHERE: Final = tuple('\0\x1b\x1f\ufeff\u2028\u202e\ud800é\U0001f600\n\r \t')
"""Characters that are somewhere special."""


class Damage:
    """Damages texts of one language, whose ``words`` come in between; ``chance`` decides."""

    def __init__(self, chance: random.Random, words: Sequence[str]) -> None:
        self._chance = chance
        self._words = (*words, *ANYWHERE)

    def damaged(self, text: str, other: str) -> str:
        """A text that differs from ``text`` in some places, in which parts of ``other`` may be."""
        chance = self._chance
        for _ in range(chance.choice([1, 1, 1, 2, 3, 6])):
            damage = chance.choice([self._cut, self._insert, self._swap, self._repeat, self._splice, self._flip])
            text = damage(text, other)[:LONGEST]
        return text

    def damaged_bytes(self, data: bytes) -> bytes:
        """Now and then, with some bytes of it replaced."""
        if self._chance.random() >= 0.1 or not data:
            return data
        position = self._chance.randrange(len(data))
        return data[:position] + self._chance.randbytes(self._chance.randint(1, 4)) + data[position + 1 :]

    def _span(self, text: str) -> tuple[int, int]:
        """A few tokens of a text."""
        start = self._chance.randrange(len(text) + 1)
        end = start
        for _ in range(self._chance.choice([1, 1, 2, 4, 30])):
            match = TOKEN.match(text, end)
            if match is None:
                break
            end = match.end()
        return start, end

    def _cut(self, text: str, other: str) -> str:
        start, end = self._span(text)
        return text[:start] + text[end:]

    def _insert(self, text: str, other: str) -> str:
        start, end = self._span(text)
        return text[:start] + self._chance.choice(self._words) + text[self._chance.choice([start, end]) :]

    def _swap(self, text: str, other: str) -> str:
        (a, b), (c, d) = sorted([self._span(text), self._span(text)])
        return text if b > c else text[:a] + text[c:d] + text[b:c] + text[a:b] + text[d:]

    def _repeat(self, text: str, other: str) -> str:
        start, end = self._span(text)
        return text[:end] + text[start:end] * self._chance.choice([1, 2, 10, 300]) + text[end:]

    def _splice(self, text: str, other: str) -> str:
        (start, end), (first, last) = self._span(text), self._span(other)
        return text[:start] + other[first:last] + text[end:]

    def _flip(self, text: str, other: str) -> str:
        if not text:
            return text
        position = self._chance.randrange(len(text))
        code = ord(text[position]) ^ (1 << self._chance.randrange(8))
        return text[:position] + chr(code) + text[position + 1 :]
