# SPDX-License-Identifier: BSD-3-Clause
"""What a tick of a node may give, and which of its children it may tick: the rule that a node class declares.

A rule looks at one node and at what its children may give, not at what they do: all that a run can bring is within what
it says, and ``bt_tool check`` warns of the children that are outside of it in every run.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import Final, NamedTuple

from .ports import PortValue
from .status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeStatus

Results = frozenset[NodeStatus]
"""What ticks may give."""

_NOTHING: Final[Results] = frozenset()
_FAILURE: Final = frozenset((FAILURE,))
_RUNNING: Final = frozenset((RUNNING,))
_SKIPPED: Final = frozenset((SKIPPED,))
_SUCCESS: Final = frozenset((SUCCESS,))


class Possible(NamedTuple):
    """What is possible for a node: the ``results`` of its ticks, and for each child whether it may be ``ticked``."""

    results: Results
    ticked: Sequence[bool]


class Outcomes(ABC):
    """The rule of a node class, for nodes that have the number of children with which they can be ticked."""

    __slots__ = ()

    @abstractmethod
    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        """What is possible with these ports, when the children may give ``children``, one for each."""

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        """The child whose results decide whether ``child`` is ticked; None when it is these ports of the node."""
        return child - 1 if child else None


@dataclass(frozen=True, slots=True)
class OneOf(Outcomes):
    """One of some results, whatever the children give; each of these may be ticked."""

    results: tuple[NodeStatus, ...]

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        return Possible(frozenset(self.results), (True,) * len(children))


@dataclass(frozen=True, slots=True)
class WithDefault(Outcomes):
    """A leaf that ends at once, and fails only where ``port`` has no text: it is known before a run, or may lack."""

    port: str

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        default = values.get(self.port)
        is_given = default is not None and default.key is None and bool(default.text)
        return Possible(_SUCCESS if is_given else _SUCCESS | _FAILURE, ())


@dataclass(frozen=True, slots=True)
class InOrder(Outcomes):
    """The next child is ticked when one gives ``passing`` or is skipped; anything else is the result.

    A node that ``yields`` may be RUNNING between two children.
    """

    passing: NodeStatus
    yields: bool = False

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
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
        return Possible(results, ticked)


@dataclass(frozen=True, slots=True)
class Choice(Outcomes):
    """The first child decides between the second and the third, if there is one; without it, FAILURE is the result."""

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        condition, then, *others = children
        ticked = [True, SUCCESS in condition, *(FAILURE in condition for _ in others)]
        results = (condition & _RUNNING) | (then if SUCCESS in condition else _NOTHING)
        otherwise = others[0] if others else _FAILURE
        return Possible(results | (otherwise if FAILURE in condition else _NOTHING), ticked)

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        return 0


@dataclass(frozen=True, slots=True)
class Exchanged(Outcomes):
    """A decorator that gives something else for some results of its child. One that ``waits`` may be RUNNING before."""

    success: NodeStatus = SUCCESS
    failure: NodeStatus = FAILURE
    skipped: NodeStatus = SKIPPED
    waits: bool = False

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        exchanged = {SUCCESS: self.success, FAILURE: self.failure, SKIPPED: self.skipped, RUNNING: RUNNING}
        results = frozenset(exchanged[result] for result in children[0])
        return Possible(results | _RUNNING if self.waits else results, (True,))


@dataclass(frozen=True, slots=True)
class Repeated(Outcomes):
    """A decorator that begins its child anew after ``repeated``, as often as ``port`` says; -1: without end."""

    port: str
    repeated: NodeStatus

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        count = values[self.port].literal
        others = children[0] - {self.repeated}
        again = _RUNNING if self.repeated in children[0] else _NOTHING
        if count == -1:
            return Possible(others | again, (True,))
        if isinstance(count, int) and count <= 0:
            return Possible(frozenset((self.repeated,)), (False,))
        if isinstance(count, int):
            return Possible(children[0] | again, (True,))
        # Not known: with 0 the result is as if it had been repeated enough.
        return Possible(others | again | {self.repeated}, (True,))


@dataclass(frozen=True, slots=True)
class Recovered(Outcomes):
    """The second child is ticked when the first fails, and then the first again, as often as ``port`` says.

    0: never the second. Less than 0: no child is ever ticked.
    """

    port: str

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        count = self._count(values)
        if count is not None and count < 0:
            return Possible(_FAILURE, (False, False))
        first, recovery = children
        is_recovered = FAILURE in first and count != 0
        results = first | (recovery & _RUNNING if is_recovered else _NOTHING)
        return Possible(results if count is not None else results | _FAILURE, (True, is_recovered))

    def deciding(self, values: Mapping[str, PortValue], child: int) -> int | None:
        return None if self._count(values) == 0 else Outcomes.deciding(self, values, child)

    def _count(self, values: Mapping[str, PortValue]) -> int | None:
        """None when it is not known before a run."""
        count = values[self.port].literal if self.port in values else None
        return count if isinstance(count, int) else None


@dataclass(frozen=True, slots=True)
class TimeLimit(Outcomes):
    """A decorator that fails when its child is RUNNING for too long."""

    def possible(self, values: Mapping[str, PortValue], children: Sequence[Results]) -> Possible:
        return Possible(children[0] | (_FAILURE if RUNNING in children[0] else _NOTHING), (True,))
