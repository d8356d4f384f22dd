# SPDX-License-Identifier: BSD-3-Clause
"""What the environment answers within a step: asked as the step goes, and tried one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Choice(NamedTuple):
    """An answer that was given: to what, what was possible, and the place of what was taken."""

    question: str
    options: tuple[str, ...]
    taken: int

    def __str__(self) -> str:
        return f'{self.question}: {self.options[self.taken]}'


class Choices:
    """The answers of one step: those that are ``given``, and the first option for whatever is asked after them."""

    def __init__(self, given: Sequence[int] = ()) -> None:
        self._given = tuple(given)
        self.made: list[Choice] = []

    def choose(self, question: str, options: Sequence[str]) -> int:
        """The place of the answer among the options. With one option nothing is asked.

        Raises:
            IndexError: what was given is none of the options: it belongs to another system.
        """
        if len(options) == 1:
            return 0
        place = len(self.made)
        taken = self._given[place] if place < len(self._given) else 0
        if not 0 <= taken < len(options):
            raise IndexError(f'{question}: there is no answer {taken} among {", ".join(options)}')
        self.made.append(Choice(question, tuple(options), taken))
        return taken

    @property
    def answers(self) -> tuple[int, ...]:
        """All answers, as places."""
        return tuple(one.taken for one in self.made)

    def others(self) -> list[tuple[int, ...]]:
        """The answers to try besides, of which no two sets of choices give the same."""
        taken = self.answers
        return [
            (*taken[:place], other)
            for place in range(len(self._given), len(taken))
            for other in range(1, len(self.made[place].options))
        ]
