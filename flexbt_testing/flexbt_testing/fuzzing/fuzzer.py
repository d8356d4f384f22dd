# SPDX-License-Identifier: BSD-3-Clause
"""Read damaged texts for a given time. Texts with a new kind of result are damaged further."""

from __future__ import annotations

import collections
import faulthandler
import random
import re
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from pathlib import Path
from types import FrameType
from typing import ClassVar, Final, NoReturn

SLOW: Final = 2.0
"""Maximum processor time for reading a text, s."""
HANGING: Final = 20.0
"""Seconds after which reading is interrupted. If that fails, the process ends after three times as long."""
LONGEST_SEED: Final = 20_000
"""Maximum length of a seed to damage, characters; longer ones are only read unchanged."""
LONGEST_KEPT: Final = 60_000
MOST_KEPT: Final = 2000
CORPUS: Final = Path(__file__).parent / 'corpus'
"""A directory for each target, with one file for each text that once exposed a defect."""


class Target(ABC):
    """A target of fuzzing: a reader of untrusted texts. ``words`` are words of their language."""

    words: ClassVar[Sequence[str]]

    @abstractmethod
    def seeds(self) -> list[str]:
        """Return the texts to begin with."""

    @abstractmethod
    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        """Read a text and return its kind; ``counts`` counts the events.

        Raises:
            Exception: a defect. The target handles the errors that a bad text should cause.
        """

    def close(self) -> None:  # noqa: B027 most have nothing to close
        """Release what the target uses."""


class Fuzzer:
    """A run of fuzzing on one target. ``counts`` counts the events; ``slowest`` is the longest read, s."""

    def __init__(self, name: str, target: Target, seed: int) -> None:
        self.counts: collections.Counter[str] = collections.Counter()
        self.slowest = 0.0
        self._name = name
        self._target = target
        self._chance = random.Random(seed)
        self._damage = Damage(self._chance, target.words)
        self._seeds = target.seeds()
        self._short = [text for text in self._seeds if len(text) < LONGEST_SEED]
        self._kept = list(self._short)
        self._known: set[Hashable] = set()

    def run(self, seconds: float, directory: Path) -> None:
        """Read the texts that once exposed a defect and the seeds, then damaged texts for ``seconds``.

        Raises:
            Exception: a defect, with a note that names the file in ``directory`` that contains the text.
        """
        for file in sorted((CORPUS / self._name).glob('*')):
            self._read(file.read_bytes(), directory)
        for text in self._seeds:
            self._read(_encoded(text), directory)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.counts['rounds'] += 1
            text = self._chance.choice(self._short if self._chance.random() < 0.6 else self._kept)
            text = self._damage.damaged(text, self._chance.choice(self._kept))
            kind = self._read(self._damage.damaged_bytes(_encoded(text)), directory)
            if kind not in self._known and len(text) < LONGEST_KEPT:
                self._known.add(kind)
                self._keep(text)

    def _keep(self, text: str) -> None:
        if len(self._kept) < MOST_KEPT:
            self._kept.append(text)
        else:
            self._kept[self._chance.randrange(MOST_KEPT)] = text

    def _read(self, data: bytes, directory: Path) -> Hashable:
        faulthandler.dump_traceback_later(3 * HANGING, exit=True)
        before = signal.signal(signal.SIGALRM, _interrupt)
        signal.setitimer(signal.ITIMER_REAL, HANGING)
        began = time.process_time()
        try:
            kind = self._target.read(data, self.counts)
            took = time.process_time() - began
            self.slowest = max(self.slowest, took)
            assert took < SLOW, f'reading the text took {took:.1f} s of processor time'
        except Exception as error:
            file = directory / f'{self._name}_{self.counts["rounds"]}'
            file.write_bytes(data)
            error.add_note(f'the text is in {file}; when the defect is mended, it belongs into {CORPUS / self._name}')
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)
            faulthandler.cancel_dump_traceback_later()
        return kind


def _interrupt(_signal: int, _frame: FrameType | None) -> NoReturn:
    raise TimeoutError(f'reading the text took longer than {HANGING:g} s')


def _encoded(text: str) -> bytes:
    return text.encode('utf-8', 'surrogatepass')


# Random damage to texts: parts of a text, of two texts, or of a text with foreign words in it.

LONGEST: Final = 240_000
"""Maximum length of a damaged text, characters."""

TOKEN: Final = re.compile(r'<!--|-->|<\?|\?>|</|/>|[<>="\'&;{}\[\],:()]|\w+|\s+|.', re.DOTALL)

ANYWHERE: Final = tuple('\0\x1b\x1f\ufeff\u2028\u202e\ud800é\U0001f600\n\r \t')
"""Characters that are special in some language."""


class Damage:
    """A source of damage to texts of one language. It inserts ``words``; ``chance`` decides."""

    def __init__(self, chance: random.Random, words: Sequence[str]) -> None:
        self._chance = chance
        self._words = (*words, *ANYWHERE)

    def damaged(self, text: str, other: str) -> str:
        """Return a text that differs from ``text`` in some places, and may contain parts of ``other``."""
        chance = self._chance
        for _ in range(chance.choice([1, 1, 1, 2, 3, 6])):
            damage = chance.choice([self._cut, self._insert, self._swap, self._repeat, self._splice, self._flip])
            text = damage(text, other)[:LONGEST]
        return text

    def damaged_bytes(self, data: bytes) -> bytes:
        """Return the data, sometimes with some bytes replaced."""
        if self._chance.random() >= 0.1 or not data:
            return data
        position = self._chance.randrange(len(data))
        return data[:position] + self._chance.randbytes(self._chance.randint(1, 4)) + data[position + 1 :]

    def _span(self, text: str) -> tuple[int, int]:
        """Return a few tokens of a text."""
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
