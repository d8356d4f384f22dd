# SPDX-License-Identifier: BSD-3-Clause
"""The visits of states: each is entered, and left once, before anything follows it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from .properties import Property, Violation

_OUTSIDE: Final = 0
_ENTERED: Final = 1
_EXITED: Final = 2


class Visits:
    """Two bits for each state: outside, entered, or exited and not passed on yet."""

    def __init__(self) -> None:
        self._at: dict[str, int] = {}

    def resume(self, paths: Iterable[str]) -> None:
        """These states are to be left, and were exited in a run before."""
        self._at = dict.fromkeys(paths, _EXITED)

    def entered(self, path: str) -> Violation | None:
        """A state is entered."""
        at = self._at
        was = at.get(path)
        at[path] = _ENTERED
        return _wrong(path, f'{path} was entered again without having been left') if was == _ENTERED else None

    def exited(self, path: str) -> Violation | None:
        """``on_exit`` of a state is called."""
        at = self._at
        was = at.get(path)
        at[path] = _EXITED
        return None if was == _ENTERED else _wrong(path, f'{path} was left without having been entered')

    def passed_on(self, path: str) -> Violation | None:
        """What follows a state comes next."""
        at = self._at
        was = at.get(path)
        if was is None:  # a machine has no callbacks
            return None
        at[path] = _OUTSIDE
        if was == _EXITED:
            return None
        what = 'on_exit was not called' if was == _ENTERED else 'it was left before'
        return _wrong(path, f'{path} was left by an outcome, and {what}')

    def left_open(self) -> list[Violation]:
        """At the end: who was entered, and never left."""
        return [
            _wrong(path, f'{path} was entered, and never left: on_exit was not called')
            for path, was in self._at.items()
            if was == _ENTERED
        ]

    @property
    def inside(self) -> list[str]:
        """The states that were entered and not left."""
        return [path for path, was in self._at.items() if was == _ENTERED]


def _wrong(path: str, text: str) -> Violation:
    return Violation(Property.BALANCED, path, text)
