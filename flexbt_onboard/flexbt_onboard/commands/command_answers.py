# SPDX-License-Identifier: BSD-3-Clause
"""Answers of commands to a run: each is given once, and not before what the command has done is shown and written."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from flexbt_core.state_machine import Answer

Decided = tuple[Answer, 'str | None']
"""An answer, and why the command was refused; None when it was applied."""


@dataclass(frozen=True, eq=False)
class CommandAnswer:
    """An answer that knows which command it is for; ``tell`` is called on any thread."""

    command_id: str
    tell: Answer

    def __call__(self, reason: str | None) -> None:
        self.tell(reason)


class CommandAnswers:
    """The answers that are owed, and those that are decided and not told yet. From any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._owed: list[Answer] = []
        self._decided: list[Decided] = []
        self._is_closed = False

    def owe(self, answer: Answer) -> bool:
        """Take an answer in; False when it is too late."""
        with self._lock:
            if not self._is_closed:
                self._owed.append(answer)
            return not self._is_closed

    def decide(self, answer: Answer, reason: str | None) -> None:
        """What became of the command; the first decision counts."""
        with self._lock:
            if answer in self._owed:
                self._owed.remove(answer)
                self._decided.append((answer, reason))

    def take_decided(self) -> list[Decided]:
        """What was decided, to be told by the caller."""
        with self._lock:
            decided, self._decided = self._decided, []
            return decided

    @property
    def has_decided(self) -> bool:
        """Whether there is something to tell."""
        return bool(self._decided)

    def close(self, reason: str) -> None:
        """Refuse what is owed, and take nothing in any more."""
        with self._lock:
            self._is_closed = True
            self._decided += [(answer, reason) for answer in self._owed]
            self._owed = []
