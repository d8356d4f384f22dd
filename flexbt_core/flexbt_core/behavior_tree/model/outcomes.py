# SPDX-License-Identifier: BSD-3-Clause
"""Declarations of a node class about its ticks: which statuses it can return, when, and an example.

A rule looks at one node and the possible results of its children, not at what the children do. It includes every result
that a run can have. This lets ``bt_tool check`` warn about children that no run reaches, and about time limits that
expire before anything can succeed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Any, Final, NamedTuple

from .ports import PortValue
from .status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeStatus

Results = frozenset[NodeStatus]
"""Possible results of ticks."""

_NOTHING: Final[Results] = frozenset()
_FAILURE: Final = frozenset((FAILURE,))
_RUNNING: Final = frozenset((RUNNING,))
_SKIPPED: Final = frozenset((SKIPPED,))
_SUCCESS: Final = frozenset((SUCCESS,))


class PossibleTick(NamedTuple):
    """The possible ``results`` of a node's ticks and, for each child, whether it may be ``ticked``."""

    results: Results
    ticked: Sequence[bool]


Times = Mapping[NodeStatus, float]
"""Minimum time until a node returns each result, s after its first tick. It never returns a missing result."""


class Earliest(NamedTuple):
    """The earliest times of the ``results`` of a node and, for each child, the time at which it ``begins``.

    Times are in s after the tick that begins the node; infinity means never.
    """

    results: Times
    begins: Sequence[float]


def _at_once(results: Iterable[NodeStatus]) -> dict[NodeStatus, float]:
    return {result: 0.0 for result in results if result is not RUNNING}


def _earlier(results: dict[NodeStatus, float], result: NodeStatus, time: float) -> None:
    """Record that a result is possible at this time."""
    if time < results.get(result, math.inf):
        results[result] = time


class Outcomes(ABC):
    """The rule of a node class, for nodes with a valid number of children."""

    __slots__ = ()

    @abstractmethod
    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        """Return what is possible with these ports, given the possible results of each child."""

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        """Return the earliest times with these ports, given those of the children; 0 if a rule does not define them."""
        return Earliest(_at_once((SUCCESS, FAILURE, SKIPPED)), (0.0,) * len(children))

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        """Return the child whose results decide whether ``child`` is ticked; None if the ports of the node decide."""
        return child - 1 if child else None


def _milliseconds(values: Mapping[str, PortValue], port: str) -> float | None:
    """Return the time of a port in milliseconds, in s; None if it is unknown before a run."""
    value = values[port].literal if port in values else None
    return value / 1000.0 if isinstance(value, int) else None


@dataclass(frozen=True, slots=True)
class OneOf(Outcomes):
    """One of several results, independent of the results of the children. Each child may be ticked."""

    results: tuple[NodeStatus, ...]

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        return PossibleTick(frozenset(self.results), (True,) * len(children))

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        return Earliest(_at_once(self.results), (0.0,) * len(children))


@dataclass(frozen=True, slots=True)
class Lasting(OneOf):
    """A leaf that waits: it succeeds after the time in ``port``, in units of ``unit`` seconds."""

    port: str = ''
    unit: float = 1.0

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        time = values[self.port].literal if self.port in values else None
        results = _at_once(self.results)
        if isinstance(time, int | float) and math.isfinite(time):
            results[SUCCESS] = abs(time) * self.unit
        return Earliest(results, ())


@dataclass(frozen=True, slots=True)
class WithDefault(Outcomes):
    """A leaf that ends at once. It may fail unless ``port`` has a literal text."""

    port: str

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        default = values.get(self.port)
        is_given = default is not None and default.key is None and bool(default.text)
        return PossibleTick(_SUCCESS if is_given else _SUCCESS | _FAILURE, ())

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        return Earliest(_at_once(self.possible(values, ()).results), ())


@dataclass(frozen=True, slots=True)
class InOrder(Outcomes):
    """Children in order: when one returns ``passing`` or is skipped, the next is ticked; else its status is the result.

    A node that ``yields`` may be RUNNING between two children. A node that ``remembers`` continues at the same child
    after a failure or a halt.
    """

    passing: NodeStatus
    yields: bool = False
    remembers: bool = False

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        ticked: list[bool] = []
        results = _RUNNING if self.yields else _NOTHING
        goes_on = True
        for child in children:
            ticked.append(goes_on)
            if goes_on:
                results |= child - {self.passing, SKIPPED}
                goes_on = self.passing in child or SKIPPED in child
        if goes_on:
            results |= reduce(or_, children, _NOTHING) & {self.passing}
            results |= _SKIPPED if all(SKIPPED in child for child in children) else _NOTHING
        return PossibleTick(results, ticked)

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        results: dict[NodeStatus, float] = {}
        begins: list[float] = []
        begin = passed = 0.0
        for child in children:
            begins.append(begin)
            for result, time in child.items():
                if result not in (self.passing, SKIPPED):
                    _earlier(results, result, begin + time)
            passed = begin + min(child.get(self.passing, math.inf), child.get(SKIPPED, math.inf))
            begin = 0.0 if self.remembers else passed
        if any(self.passing in child for child in children):
            _earlier(results, self.passing, passed)
        if all(SKIPPED in child for child in children):
            results[SKIPPED] = passed
        return Earliest(results, begins)


@dataclass(frozen=True, slots=True)
class Choice(Outcomes):
    """A condition, the first child, that selects the second or third child; FAILURE without a third."""

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        condition, then, *others = children
        ticked = [True, SUCCESS in condition, *(FAILURE in condition for _ in others)]
        results = (condition & _RUNNING) | (then if SUCCESS in condition else _NOTHING)
        otherwise = others[0] if others else _FAILURE
        return PossibleTick(results | (otherwise if FAILURE in condition else _NOTHING), ticked)

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        condition, *branches = children
        decided = [condition.get(result, math.inf) for result in (SUCCESS, FAILURE)][: len(branches)]
        results: dict[NodeStatus, float] = {}
        for begin, branch in zip(decided, branches, strict=True):
            for result, time in branch.items():
                _earlier(results, result, begin + time)
        if len(branches) == 1 and FAILURE in condition:
            _earlier(results, FAILURE, 0.0)  # the condition may keep an earlier result
        return Earliest(results, (0.0, *decided))

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        return 0


@dataclass(frozen=True, slots=True)
class Exchanged(Outcomes):
    """A decorator that replaces some results of its child.

    If it ``waits``, it may be RUNNING first, for the milliseconds of the port ``delay`` if it has one.
    """

    success: NodeStatus = SUCCESS
    failure: NodeStatus = FAILURE
    skipped: NodeStatus = SKIPPED
    waits: bool = False
    delay: str = ''

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        exchanged = self._exchanged()
        results = frozenset(exchanged[result] for result in children[0])
        return PossibleTick(results | _RUNNING if self.waits else results, (True,))

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        # After the child was skipped the delay is over, even when the node starts again.
        delay = 0.0 if SKIPPED in children[0] else _milliseconds(values, self.delay) or 0.0
        results: dict[NodeStatus, float] = {}
        for result, time in children[0].items():
            _earlier(results, self._exchanged()[result], delay + time)
        return Earliest({one: time for one, time in results.items() if one is not RUNNING}, (delay,))

    def _exchanged(self) -> Mapping[NodeStatus, NodeStatus]:
        return {SUCCESS: self.success, FAILURE: self.failure, SKIPPED: self.skipped, RUNNING: RUNNING}


@dataclass(frozen=True, slots=True)
class Repeated(Outcomes):
    """A decorator that restarts its child after ``repeated``, up to the number in ``port``; -1: without limit."""

    port: str
    repeated: NodeStatus

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        count = values[self.port].literal
        others = children[0] - {self.repeated}
        again = _RUNNING if self.repeated in children[0] else _NOTHING
        if count == -1:
            return PossibleTick(others | again, (True,))
        if isinstance(count, int) and count <= 0:
            return PossibleTick(frozenset((self.repeated,)), (False,))
        if isinstance(count, int):
            return PossibleTick(children[0] | again, (True,))
        # The count is unknown; with 0 the result is as if all repetitions were done.
        return PossibleTick(others | again | {self.repeated}, (True,))

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        count = values[self.port].literal
        [child] = children
        results = {result: time for result, time in child.items() if result is not self.repeated}
        if not isinstance(count, int) or count == 0 or count < -1:
            results[self.repeated] = 0.0
        elif self.repeated in child and count > 0:
            # The node keeps its count when the child is skipped, even when the node starts again.
            results[self.repeated] = child[self.repeated] * (1 if SKIPPED in child else count)
        return Earliest(results, (0.0,))


@dataclass(frozen=True, slots=True)
class Recovered(Outcomes):
    """A retry: when the first child fails, the second is ticked, then the first again, up to the number in ``port``.

    0: the second child is never ticked. Less than 0: no child is ever ticked.
    """

    port: str

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        count = self._count(values)
        if count is not None and count < 0:
            return PossibleTick(_FAILURE, (False, False))
        first, recovery = children
        is_recovered = FAILURE in first and count != 0
        results = first | (recovery & _RUNNING if is_recovered else _NOTHING)
        return PossibleTick(results if count is not None else results | _FAILURE, (True, is_recovered))

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        count = self._count(values)
        first = children[0]
        failed = first.get(FAILURE, math.inf)
        if count is None:
            return Earliest({**first, FAILURE: 0.0}, (0.0, failed))
        return Earliest(first if count >= 0 else {FAILURE: 0.0}, (0.0, failed))

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        return None if self._count(values) == 0 else Outcomes.deciding(self, values, child)

    def _count(self, values: Mapping[str, PortValue]) -> int | None:
        """Return the number of retries; None if it is unknown before a run."""
        count = values[self.port].literal if self.port in values else None
        return count if isinstance(count, int) else None


@dataclass(frozen=True, slots=True)
class TimeLimit(Outcomes):
    """A decorator that fails when its child is RUNNING for longer than the milliseconds of ``port``, if it has one.

    0: without limit.
    """

    port: str = ''

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> PossibleTick:
        may_expire = RUNNING in children[0] and _milliseconds(values, self.port) != 0.0
        return PossibleTick(children[0] | (_FAILURE if may_expire else _NOTHING), (True,))

    def earliest(self, values: Mapping[str, PortValue], children: Sequence[Times]) -> Earliest:
        limit = self.limit(values, children[0])
        results = {result: time for result, time in children[0].items() if limit is None or time < limit}
        if _milliseconds(values, self.port) != 0.0:
            _earlier(results, FAILURE, limit or 0.0)
        return Earliest(results, (0.0,))

    def limit(self, values: Mapping[str, PortValue], child: Times) -> float | None:
        """Return the time after which the child never continues, s; None if it may continue.

        It may continue if the time is unknown before a run, or if the child may be skipped earlier: in such a tick the
        limit no longer applies.
        """
        limit = _milliseconds(values, self.port)
        return limit if limit and limit <= child.get(SKIPPED, math.inf) else None


# The example that the class of a node type declares.

_NO_ENTRIES: Final[Mapping[str, Any]] = {}


class Example(NamedTuple):
    """A tree that shows a node type: the reference page prints it, and a test runs it.

    ``xml`` is the content of the main tree, ``trees`` contains the other trees. Both may be indented like docstrings.
    ``ticks`` are the results of the ticks, in order, each at the time that the tree asks for. ``before`` and ``after``
    are blackboard entries. The example of a node that needs servers has no ticks; the test only loads it.
    """

    xml: str
    ticks: tuple[NodeStatus, ...] = ()
    before: Mapping[str, Any] = _NO_ENTRIES
    after: Mapping[str, Any] = _NO_ENTRIES
    trees: str = ''
