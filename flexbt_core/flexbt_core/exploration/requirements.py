# SPDX-License-Identifier: BSD-3-Clause
"""What a mission requires beside what holds for all: written by its engineer, checked in each step.

Events of a machine are ``/Path > outcome`` (a state was left by it), ``/Path`` (it is entered after another), and
``=outcome`` (the machine ends by it).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from .model import Property, Violation


@dataclass(frozen=True)
class Before:
    """``event`` only after ``needs``, at some time since the beginning; with ``again``, since the last ``event``."""

    event: str
    needs: str
    again: bool = False

    def __str__(self) -> str:
        return f'{self.event} only after {self.needs}{", each time anew" if self.again else ""}'


@dataclass(frozen=True)
class After:
    """What follows ``event`` (a state left by an outcome) at once is one of ``allowed``: a state, or an outcome."""

    event: str
    allowed: tuple[str, ...]

    def __str__(self) -> str:
        return f'after {self.event} comes {" or ".join(self.allowed)}'


@dataclass(frozen=True)
class While:
    """As long as the leaf ``works``, the ``condition`` is asked in each tick, and holds."""

    works: str
    condition: str

    def __str__(self) -> str:
        return f'{self.works} works only while {self.condition} holds'


Requirement = Before | After | While


class Monitor:
    """Watches the events of a run. What it remembers is part of a configuration: for each requirement one bit."""

    def __init__(self, requirements: Iterable[Requirement]) -> None:
        self.requirements = tuple(requirements)
        self.met: set[str] = set()
        """The requirements whose condition has been met."""

    def transition(self, left: str, follows: str) -> Iterator[Violation]:
        """A state was left, with what follows: a state, ``=outcome`` of the machine, or ''."""
        for one in self.requirements:
            if isinstance(one, After) and one.event == left and follows not in one.allowed:
                yield _violation(one, left, f'{follows or "nothing"} follows {left}')
        for event in (left, follows):
            for one in self.requirements:
                if not isinstance(one, Before):
                    continue
                if event == one.event:
                    if str(one) not in self.met:
                        yield _violation(one, event, f'{event} comes without {one.needs}')
                    elif one.again:
                        self.met.discard(str(one))
                if event == one.needs:
                    self.met.add(str(one))


def unguarded(requirements: Iterable[Requirement], works: Iterable[str], held: Iterable[str]) -> Iterator[Violation]:
    """After a tick: leaves that work, and the conditions that were asked in it and held."""
    working, holding = set(works), set(held)
    for one in requirements:
        if isinstance(one, While) and one.works in working and one.condition not in holding:
            yield _violation(
                one, one.works, f'{one.works} works on, and {one.condition} was not asked, or does not hold'
            )


def _violation(requirement: Requirement, where: str, what: str) -> Violation:
    return Violation(Property.REQUIREMENT, where, f'{what}; required is: {requirement}')
