# SPDX-License-Identifier: BSD-3-Clause
"""POSIX extended regular expressions for names, in a time that is bounded by the lengths of both.

The expression comes from another process. Python's ``re`` goes back and forth for some expressions for longer than a
robot drives, and nothing can stop it; here all ways through an expression are followed at once (Thompson, 1968).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final

from flexbt_core.values import shown
from flexbt_sim.errors import SimulationError

MAX_STATES: Final = 2_000
"""Size of an expression, as written out: {2,5} stands for five."""

_CLASSES: Final = {
    'alpha': 'A-Za-z', 'digit': '0-9', 'alnum': 'A-Za-z0-9', 'upper': 'A-Z', 'lower': 'a-z', 'xdigit': '0-9A-Fa-f',
    'space': r'\s', 'blank': r' \t', 'punct': r'!-/:-@\[-`{-~',
}  # fmt: skip

_Test = Callable[[str], bool]
_Edges = list[tuple['_Test | None', int]]


class NameFilter:
    """Whether a whole name is matched by ``pattern``; an empty one matches every name.

    Raises:
        SimulationError: the pattern is none, or is too large.
    """

    def __init__(self, pattern: str) -> None:
        self._pattern = pattern
        self._at = 0
        self._states: list[_Edges] = []
        self._start, self._end = self._alternatives() if pattern else (self._state(), self._state())
        if self._at < len(pattern):
            raise self._error(f'{pattern[self._at]!r} has no beginning')

    def __call__(self, name: str) -> bool:
        """Whether the name is matched."""
        if not self._pattern:
            return True
        now = self._reached({self._start})
        for character in name:
            now = self._reached(
                {to for state in now for test, to in self._states[state] if test is not None and test(character)}
            )
            if not now:
                return False
        return self._end in now

    def _reached(self, states: set[int]) -> set[int]:
        """With all that is reached from there without a character."""
        left = list(states)
        while left:
            for test, to in self._states[left.pop()]:
                if test is None and to not in states:
                    states.add(to)
                    left.append(to)
        return states

    # -- reading the expression: each part becomes two states, and the ways between them -----------------------------

    def _error(self, problem: str) -> SimulationError:
        return SimulationError(f'{shown(self._pattern)} is no extended regular expression, at {self._at}: {problem}')

    def _state(self) -> int:
        if len(self._states) >= MAX_STATES:
            raise self._error(f'it stands for more than {MAX_STATES} characters')
        self._states.append([])
        return len(self._states) - 1

    def _edge(self, start: int, end: int, test: _Test | None = None) -> None:
        self._states[start].append((test, end))

    def _next(self) -> str:
        return self._pattern[self._at : self._at + 1]

    def _alternatives(self) -> tuple[int, int]:
        start, end = self._state(), self._state()
        while True:
            first, last = self._sequence()
            self._edge(start, first)
            self._edge(last, end)
            if self._next() != '|':
                return start, end
            self._at += 1

    def _sequence(self) -> tuple[int, int]:
        start = end = self._state()
        while self._next() not in ('', '|', ')'):
            began = self._at
            first, last = self._atom()
            if self._next() in ('*', '+', '?', '{'):
                first, last = self._repeated(began, first, last)
            self._edge(end, first)
            end = last
        return start, end

    def _atom(self) -> tuple[int, int]:
        character = self._next()
        self._at += 1
        if character == '(':
            if self._pattern[: self._at].count('(') > 100:
                raise self._error('too many groups')
            part = self._alternatives()
            if self._next() != ')':
                raise self._error("')' is missing")
            self._at += 1
            return part
        if character in ('*', '+', '?', '{'):
            raise self._error('there is nothing to repeat')
        start, end = self._state(), self._state()
        if character in ('^', '$'):  # the whole name is matched anyway
            self._edge(start, end)
        elif character == '.':
            self._edge(start, end, lambda _: True)
        elif character == '[':
            self._edge(start, end, self._bracket())
        else:
            if character == '\\':
                character = self._next()
                self._at += 1
            if not character:
                raise self._error('nothing comes after the backslash')
            self._edge(start, end, character.__eq__)
        return start, end

    def _bracket(self) -> _Test:
        end = self._pattern.find(']', self._at + (2 if self._next() == '^' else 1))
        while end >= 0 and self._pattern[self._at : end].rfind('[:') > self._pattern[self._at : end].rfind(':]'):
            end = self._pattern.find(']', end + 1)
        if end < 0:
            raise self._error("']' is missing")
        inside, self._at = self._pattern[self._at : end], end + 1
        negated = '^' if inside.startswith('^') else ''
        inside = inside.removeprefix('^').replace('\\', r'\\').replace('[', r'\[').replace(']', r'\]')
        inside = re.sub(r'\\\[:(\w+):(?:\\\])?', lambda found: _CLASSES.get(found[1], ''), inside)
        try:
            one_of = re.compile(f'[{negated}{inside}]')
        except re.error as error:
            raise self._error(str(error)) from None
        return lambda character: one_of.match(character) is not None

    def _repeated(self, began: int, first: int, last: int) -> tuple[int, int]:
        least, most = self._bounds()
        end = self._at
        start = finish = self._state()
        copies = max(least, most if most is not None else least + 1, 1)
        for copy in range(copies):
            if copy:
                self._at = began
                first, last = self._atom()
            self._edge(finish, first)
            if copy >= least:
                self._edge(finish, last)  # it may be left out
            if most is None and copy == copies - 1:
                self._edge(last, first)
            finish = last
        self._at = end
        return (start, finish) if most != 0 else (start, start)

    def _bounds(self) -> tuple[int, int | None]:
        character = self._next()
        self._at += 1
        if character != '{':
            return {'*': (0, None), '+': (1, None), '?': (0, 1)}[character]
        found = re.compile(r'(\d{1,3})(,?)(\d{0,3})\}').match(self._pattern, self._at)
        if found is None:
            raise self._error('give {least,most} of at most 999')
        self._at = found.end()
        least = int(found[1])
        most = int(found[3]) if found[3] else None if found[2] else least
        if most is not None and most < least:
            raise self._error(f'{most} is less than {least}')
        return least, most
