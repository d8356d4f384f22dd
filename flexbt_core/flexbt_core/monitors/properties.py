# SPDX-License-Identifier: BSD-3-Clause
"""The properties that hold for every mission, and violations of them."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple


class Property(Enum):
    """A property that a proof checks for all possible runs, or a monitor for one run; the values are its names
    in reports."""

    STOP_STOPS = 'stop means stopped'
    ONE_OWNER = 'an actuator has one owner'
    NO_LIVELOCK = 'nothing goes round without waiting for anything'
    NO_DEADLOCK = 'something can always happen'
    REACHABLE = 'every outcome and state of a machine, and every node and the success of a tree, can be reached'
    LIMITS = 'what limits how often something begins makes it wait at some time'
    LISTENS = 'what hears of a change is asked while something works'
    CAN_END = 'it can always still end'
    APPROVAL = 'nothing happens without the approval that it needs'
    BALANCED = 'what is entered is left, once'
    PRECONDITION = 'a leaf begins only where what its skill needs holds'
    DEADLINE = 'an attempt is given up at the deadline of its skill'
    DATA = 'nothing is read before it is written'
    ONE_WRITER = 'what is read is written by one at a time'
    HALTED = 'a halt halts everything'
    NO_FAULT = 'no node and no state raises'
    DECLARED = 'it ends only by what it declares'
    RECOVERY = 'it can always be stopped'
    REQUIREMENT = 'what the mission requires'
    POSSIBLE = 'what the mission requires to stay possible'

    @property
    def is_shown_by_a_way(self) -> bool:
        """True if the steps of a counterexample show the violation; otherwise it is about steps that cannot follow."""
        return self not in _OF_WHAT_CANNOT_FOLLOW


_OF_WHAT_CANNOT_FOLLOW = frozenset(
    (
        *(Property.NO_DEADLOCK, Property.CAN_END, Property.REACHABLE, Property.LIMITS, Property.LISTENS),
        *(Property.RECOVERY, Property.POSSIBLE),
    )
)


class Violation(NamedTuple):
    """A violation: its property, its place, and a text for a mission engineer. ``is_lasting``: it holds from the
    beginning, independent of events."""

    property: Property
    where: str
    text: str
    is_lasting: bool = False


def shared_actuators(owners: Iterable[tuple[str, Iterable[str]]]) -> list[Violation]:
    """Return a violation for each actuator with several owners at once; ``owners`` are paths with resources."""
    return [
        Violation(Property.ONE_OWNER, resource, f'{resource} has two owners at once: {" and ".join(paths)}')
        for resource, paths in _shared(owners)
    ]


def shared_keys(writers: Iterable[tuple[str, Iterable[str]]]) -> list[Violation]:
    """Return a violation for each key with several concurrent writers; ``writers`` are paths with keys."""
    return [
        Violation(
            Property.ONE_WRITER,
            key,
            f'{" and ".join(paths)} work at the same time and write {key}: it is chance whose value is read later',
        )
        for key, paths in _shared(writers)
    ]


def _shared(claims: Iterable[tuple[str, Iterable[str]]]) -> list[tuple[str, list[str]]]:
    """Return the things that several paths claim, with these paths."""
    found: dict[str, list[str]] = {}
    for path, things in claims:
        for thing in things:
            found.setdefault(thing, []).append(path)
    return sorted((thing, paths) for thing, paths in found.items() if len(paths) > 1)
