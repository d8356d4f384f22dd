# SPDX-License-Identifier: BSD-3-Clause
"""What a mission would have become: two courses of it, their first difference, and how each has ended."""

from __future__ import annotations

import inspect
import math
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, Final, NamedTuple

from flexbt_core.values.text import did_you_mean
from flexbt_msgs.msg import TreeNode, TreeStatus

TOLERANCE: Final = 0.1
"""Difference of the times of an event that counts as none, s: messages of a change shift what follows by some us."""

TEST: Final = 'the test'
"""Name of the one that fails when an error ends a course."""


class Event(NamedTuple):
    """Something that a robot has decided: when (s), who (the executive or a tree), and what."""

    time: float
    who: str
    what: str
    node: int = 0
    """The node of the tree, by its number, which in another tree is that of another node."""


@dataclass
class Course:
    """What has happened in a world, and how it has ended."""

    events: list[Event] = field(default_factory=list)
    end: float = 0.0
    """Simulated time at which the course was ended, s."""
    ends: list[str] = field(default_factory=list)
    """The state of each robot then, and what has failed."""


@dataclass(frozen=True)
class Difference:
    """The first event that is not the same in two courses; None where one of them has none."""

    before: Event | None
    after: Event | None

    @property
    def time(self) -> float:
        """When they part, s."""
        return min(event.time for event in (self.before, self.after) if event is not None)

    def known_until(self, before: Course, after: Course, tolerance: float) -> float:
        """Return until when it is known that the course without the earlier event does not have it, s."""
        if self.who == TEST:
            return math.inf  # an error ends a course: it has had none at its end
        if self.before is None or (self.after is not None and self.after.time < self.before.time - tolerance):
            return before.end
        return after.end if self.after is None or self.before.time < self.after.time - tolerance else math.inf

    @property
    def who(self) -> str:
        """Who has decided otherwise."""
        return next(event.who for event in (self.before, self.after) if event is not None)


@dataclass(frozen=True)
class Comparison:
    """Two courses from the same moment on."""

    before: Course
    after: Course
    difference: Difference | None
    names: tuple[str, str] = ('as it was', 'changed')

    def __str__(self) -> str:
        return '\n'.join(self._lines())

    def _lines(self) -> Iterator[str]:
        width = max(map(len, self.names)) + 1
        if self.difference is None:
            yield f'no difference in {len(self.before.events)} events'
        else:
            yield f'first difference at {self.difference.time:.2f} s, {self.difference.who}'
            for name, event in zip(self.names, (self.difference.before, self.difference.after), strict=True):
                told = f'{event.what} at {event.time:.2f} s' if event else 'nothing more'
                yield f'  {name + ":":{width}} {told}'
        yield 'the ends'
        for name, course in zip(self.names, (self.before, self.after), strict=True):
            for end in course.ends:
                yield f'  {name + ":":{width}} at {course.end:.2f} s {end}'


def compare(before: Course, after: Course, tolerance: float = TOLERANCE) -> Comparison:
    """Return the comparison of two courses.

    The events of the executive and of each tree are compared in their order, since only the order of what one of them
    does is decided by it. An event that the other course may have had just after its end is no difference.
    """
    found: list[Difference] = []
    for who in dict.fromkeys(event.who for event in (*before.events, *after.events)):
        one, other = ([event for event in course.events if event.who == who] for course in (before, after))
        difference = _first_difference(one, other, tolerance)
        if difference is not None and difference.time + tolerance < difference.known_until(before, after, tolerance):
            found.append(difference)
    return Comparison(before, after, min(found, key=lambda one: one.time, default=None))


def _first_difference(before: Sequence[Event], after: Sequence[Event], tolerance: float) -> Difference | None:
    for one, other in zip_longest(before, after):
        if one is None or other is None or one.what != other.what or abs(one.time - other.time) > tolerance:
            return Difference(one, other)
    return None


_NUMBER: Final = re.compile(r'::\d+$')  # of a node without a name, which another tree numbers otherwise
_STATUSES: Final = {TreeStatus.RUNNING: 'RUNNING', TreeStatus.SUCCESS: 'SUCCESS', TreeStatus.FAILURE: 'FAILURE'}


def tree_event(structure: Any, change: Any) -> str:
    """Return what a leaf or the root of a tree has become, by its TreeStructure and a TreeStatusChange; else ''."""
    node = structure.nodes[change.uid - 1]
    is_told = change.uid == 1 or node.kind in (TreeNode.ACTION, TreeNode.CONDITION)
    return f'{_NUMBER.sub("", node.path)} {_STATUSES[change.status]}' if is_told and change.status in _STATUSES else ''


def executive_event(event: str, fields: Mapping[str, Any]) -> str:
    """Return an event of the event log in words that are the same in each run; '' for one that is not told."""
    match event:
        case 'entered':
            return f'enters {fields["path"]}'
        case 'left':
            return f'leaves {fields["path"]} by {fields["outcome"]} ({fields["reason"]})'
        case 'waiting':
            return f'asks at {fields["path"]} ({fields["kind"]})'
        case 'command':
            return f'{fields["command"]} {fields.get("effect", "")}'
        case 'started' | 'ended':
            return f'{event} {fields["behavior"]} {fields.get("outcome", "")}'.rstrip()
    return ''


def read_change(text: str, world: Any) -> tuple[float, Callable[[], object]]:
    """Return time and action of a change as a command line gives it, such as ``12.5 choose /Drive canceled``.

    The action is a method of the world, or ``robot.method`` with the namespace of one of several robots.

    Raises:
        ValueError: there is no such robot or method, or its arguments do not fit.
    """
    try:
        words = shlex.split(text)
        time, name, *arguments = words if len(words) > 1 else [*words, '']
        robot, _, method = name.rpartition('.')
        if robot and robot not in world.robots:
            raise ValueError(f'there is no robot {robot!r}{did_you_mean(robot, [*filter(None, world.robots)])}')
        owner, kind = (world.robots[robot], 'robot') if robot else (world, 'world')
        known = [one for one in dir(type(owner)) if one[0] != '_' and callable(getattr(type(owner), one))]
        if method not in known:
            raise ValueError(f'a {kind} has no method {method!r}{did_you_mean(method, known)}')
        act = getattr(owner, method)
        bound = inspect.signature(act).bind(*arguments)
        for parameter in bound.signature.parameters.values():
            if parameter.annotation == 'float' and parameter.name in bound.arguments:
                bound.arguments[parameter.name] = float(bound.arguments[parameter.name])
        if not 0.0 <= float(time) < math.inf:
            raise ValueError(f'{time} is no time')
        return float(time), lambda: act(*bound.args, **bound.kwargs)
    except TypeError as error:
        raise ValueError(f'{text!r}: {error}; expected SECONDS METHOD ARGUMENTS') from None
    except ValueError as error:
        raise ValueError(f'{text!r}: {error}') from None
