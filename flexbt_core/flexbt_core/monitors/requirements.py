# SPDX-License-Identifier: BSD-3-Clause
"""The requirements of one mission, written by its engineer and checked during a run.

Events of a machine are ``/Path`` (a state or machine is entered), ``/Path > outcome`` (it was left by the outcome),
and ``=outcome`` (the machine ends by it). Those of a tree are ``name`` (a leaf begins to work, or is done at once),
``name > SUCCESS``, ``name > FAILURE``, ``name > halted``, and ``=SUCCESS`` or ``=FAILURE``. A leaf without a name is
called by its type. This name means all such leaves of the type, unless a leaf has it as its name: then only that one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import permutations
from typing import NamedTuple

from flexbt_core.values.text import pluralize, short_repr

from .properties import Property, Violation


@dataclass(frozen=True)
class Never:
    """A requirement that ``event`` does not happen."""

    event: str

    def __str__(self) -> str:
        return f'never {self.event}'


@dataclass(frozen=True)
class AtMost:
    """A requirement that ``event`` happens at most ``times`` times, in any period of ``seconds`` if that is set."""

    event: str
    times: int
    seconds: float | None = None

    def __str__(self) -> str:
        when = '' if self.seconds is None else f' in {_decimal(self.seconds)} s'
        return f'{self.event} at most {pluralize(self.times, "time")}{when}'


@dataclass(frozen=True)
class Before:
    """A requirement that ``event`` happens only after ``needs`` has happened ``times`` times since the beginning or,
    with ``again``, since the last ``event``."""

    event: str
    needs: str
    again: bool = False
    times: int = 1

    def __str__(self) -> str:
        times = '' if self.times == 1 else f', {self.times} times'
        return f'{self.event} only after {self.needs}{times}{", each time anew" if self.again else ""}'


@dataclass(frozen=True)
class After:
    """A requirement that one of ``allowed`` (states or outcomes) follows ``event`` (a state left by an outcome) at
    once."""

    event: str
    allowed: tuple[str, ...]

    def __str__(self) -> str:
        return f'after {self.event} comes {" or ".join(self.allowed)}'


@dataclass(frozen=True)
class Within:
    """A requirement that ``then`` follows ``event`` within ``seconds``, or (None) before the end, except after a stop.

    With ``times``, the requirement also holds once ``then`` has happened that often, for retries. Seconds are those of
    the run's clock, without the time for which the run is paused.
    """

    event: str
    then: str
    seconds: float | None = None
    times: int | None = None

    def __str__(self) -> str:
        when = 'before the end' if self.seconds is None else f'within {_decimal(self.seconds)} s'
        times = '' if self.times is None else f', up to {pluralize(self.times, "time")}'
        return f'after {self.event}, {self.then} {when}{times}'


@dataclass(frozen=True)
class Apart:
    """A requirement that ``one`` and ``other`` (states or leaves) do not work at the same time."""

    one: str
    other: str

    def __str__(self) -> str:
        return f'{self.one} never while {self.other}'


@dataclass(frozen=True)
class While:
    """A requirement that ``condition`` is checked in each tick of the leaf ``works`` and ``holds`` (or fails)."""

    works: str
    condition: str
    holds: bool = True

    def __str__(self) -> str:
        return f'{self.works} works only while {self.condition} {"holds" if self.holds else "fails"}'


@dataclass(frozen=True)
class Written:
    """A requirement that the machine ends by ``event`` only after ``keys`` were written: a default is not a result."""

    event: str
    keys: tuple[str, ...]

    def __str__(self) -> str:
        return f'{self.event} only with {" and ".join(self.keys)} written'


@dataclass(frozen=True)
class Possible:
    """A requirement that ``event`` is still possible at every point before the end, without a stop."""

    event: str

    def __str__(self) -> str:
        return f'{self.event} is always still possible'


@dataclass(frozen=True)
class IsA:
    """A requirement that the node or state ``name`` is of this ``type``."""

    name: str
    type: str

    def __str__(self) -> str:
        return f'{self.name} is a {self.type}'


@dataclass(frozen=True)
class Has:
    """A requirement that the node or state ``name`` has these ``values``: pairs of a port and a text or ``{key}``.
    The key has its name in the outermost tree, or in the machine of the state."""

    name: str
    values: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        return f'{self.name} has {" and ".join(f"{port}={text}" for port, text in self.values)}'


Requirement = Never | AtMost | Before | After | Within | Apart | While | Written | Possible | IsA | Has


class NodeOrState(NamedTuple):
    """A part of a tree or machine: its type and the values of its ports."""

    type: str
    values: Mapping[str, str]


NodesOrStates = Mapping[str, Sequence[NodeOrState]]
"""The nodes of a tree, or the states of a machine, by their names."""

_ROUNDING = 1e-6
"""Tolerance for the rounding of points in time, s."""

PROVED_ONLY = (Written, Possible)
"""Requirements about possible events, which an observed run cannot show: no monitor watches them."""


class Requirements:
    """A monitor that checks the events of a run against the requirements of the mission.

    Its memory is part of a configuration: a bit or a number for each requirement. ``now`` returns the time of the
    run's clock in s; ``found`` is called with each violation.
    """

    def __init__(
        self, requirements: Iterable[Requirement], now: Callable[[], float], found: Callable[[Violation], None]
    ) -> None:
        self.requirements: Sequence[Requirement] = tuple(dict.fromkeys(requirements))  # of two that are equal, one
        self.met: set[str] = set()
        """The requirements whose condition has been met, or that wait for an event."""
        self.counts: dict[str, int] = {}
        self.due: dict[str, float] = {}
        """Deadlines of the events that must follow."""
        self.recent: dict[str, tuple[float, ...]] = {}
        """For limits within a period: the times until which the last events count."""
        self.paused_at: float | None = None
        self._now = now
        self._found = found
        self._by_event: dict[str, list[Requirement]] = {}
        for one in self.requirements:
            for event in _events(one):
                self._by_event.setdefault(event, []).append(one)
        self.happened: set[str] = set()
        """Events that must stay possible and have happened since this was last cleared."""
        self.whiles = [one for one in self.requirements if isinstance(one, While)]
        self.aparts = [one for one in self.requirements if isinstance(one, Apart)]

    @property
    def possible(self) -> list[Possible]:
        """Requirements of events that must stay possible."""
        return [one for one in self.requirements if isinstance(one, Possible)]

    @property
    def are_about_parts(self) -> bool:
        """True if a requirement is about the parts rather than about events: see :meth:`check_parts`."""
        return any(isinstance(one, IsA | Has) for one in self.requirements)

    def check_parts(self, parts: NodesOrStates) -> None:
        """Check the parts of the machine or tree that runs."""
        for one in self.requirements:
            if isinstance(one, IsA | Has):
                for text in dict.fromkeys(_otherwise(one, parts.get(one.name, ()))):
                    self._found(violation_of(one, one.name, text)._replace(is_lasting=True))

    @property
    def names(self) -> frozenset[str]:
        """Paths of the states or nodes whose events occur in requirements."""
        events = {*self._by_event, *(name for one in self.whiles for name in (one.works, one.condition))}
        return frozenset(event.partition(' > ')[0] for event in events)

    def resume(self) -> None:
        """Continue after another run. Its events are unknown, so they cause no violation."""
        for one in self.requirements:
            if isinstance(one, Before):
                self.met.add(str(one))
            elif isinstance(one, Within) and one.times is not None:  # it may have happened this often already
                self.counts[str(one)] = one.times

    def event(self, event: str) -> None:
        """Check an event that has happened."""
        for one in self._by_event.get(event, ()):
            self._meet(one, event)

    def follows(self, left: str, follows: str) -> None:
        """Check what follows a state that was left: a state, ``=outcome`` of the machine, or ''."""
        for one in self._by_event.get(left, ()):
            if isinstance(one, After) and follows not in one.allowed:
                self._tell(one, left, f'{follows or "nothing"} follows {left}')

    def works(self, working: Sequence[Sequence[str]]) -> None:
        """Check which parts work at the same time: active states, or leaves, each with all its names."""
        for one in self.aparts:
            if any(one.one in first and one.other in second for first, second in permutations(working, 2)):
                self._tell(one, one.one, f'{one.one} works while {one.other} does')

    def unguarded(self, working: Sequence[Sequence[str]], holding: Collection[str], failing: Collection[str]) -> None:
        """Check, after a tick, that working leaves have their conditions. ``working`` has all names of each leaf;
        ``holding`` and ``failing`` are the conditions that the tick checked."""
        for one in self.whiles:
            wanted, unwanted = (holding, failing) if one.holds else (failing, holding)
            is_so = one.condition in wanted and one.condition not in unwanted
            if any(one.works in names for names in working) and not is_so:
                does = 'does not hold' if one.holds else 'holds'
                self._tell(one, one.works, f'{one.works} works on, and {one.condition} was not asked, or {does}')

    def rests(self, is_paused: bool) -> None:
        """Check whether an event is overdue. Deadlines exclude the time for which the run is paused; limits within a
        period include it."""
        if not self.due and not self.recent:
            self.paused_at = None
            return
        now = self._now()
        if is_paused or self.paused_at is not None:
            self._pause(is_paused, now)
            return
        recent = {name: _counting(times, now) for name, times in self.recent.items()}
        self.recent = {name: times for name, times in recent.items() if times}
        for one in [one for one in self.requirements if isinstance(one, Within)]:
            if self.due.get(str(one), now + 1.0) <= now:
                del self.due[str(one)]
                self._tell(one, one.event, f'{one.then} has not come {one.seconds:g} s after {one.event}')

    def _pause(self, is_paused: bool, now: float) -> None:
        if self.paused_at is None:
            self.paused_at = now
        elif not is_paused:
            passed, self.paused_at = now - self.paused_at, None
            self.due = {one: due + passed for one, due in self.due.items()}

    def next_due(self) -> float | None:
        """Return the earliest deadline; None without one or while paused."""
        return min(self.due.values(), default=None) if self.due and self.paused_at is None else None

    def ended(self) -> None:
        """Check events that had to follow before the end. Call it after an end that was not a stop."""
        for one in self.requirements:
            if isinstance(one, Within) and one.seconds is None and str(one) in self.met:
                self._tell(one, one.event, f'it ends, and {one.then} has not come after {one.event}')

    def _meet(self, one: Requirement, event: str) -> None:
        name = str(one)
        if isinstance(one, Never):
            self._tell(one, event, f'{event} happens')
        elif isinstance(one, Possible):
            self.happened.add(event)
        elif isinstance(one, AtMost) and one.seconds is not None:
            now = self._now()
            recent = _counting(self.recent.get(name, ()), now)
            if len(recent) >= one.times:
                self._tell(one, event, f'{event} happens more than {_times(one.times)} in {one.seconds:g} s')
            self.recent[name] = (*recent, now + one.seconds)[-one.times :]
        elif isinstance(one, AtMost):
            count = self.counts[name] = min(self.counts.get(name, 0) + 1, one.times + 1)
            if count > one.times:
                self._tell(one, event, f'{event} happens more than {_times(one.times)}')
        elif isinstance(one, Before):
            if event == one.event:
                if name not in self.met:
                    came = self.counts.get(name, 0)
                    lacks = f'without {one.needs}' if not came else f'when {one.needs} has come {_times(came)} only'
                    self._tell(one, event, f'{event} comes {lacks}')
                if one.again:
                    self.met.discard(name)
                    self.counts.pop(name, None)
            if event == one.needs and name not in self.met:
                came = self.counts.pop(name, 0) + 1
                if came == one.times:
                    self.met.add(name)
                else:
                    self.counts[name] = came
        elif isinstance(one, Within):
            if event == one.then:
                self.met.discard(name)
                if self.due.pop(name, math.inf) < self._now() and self.paused_at is None:
                    self._tell(one, one.event, f'{one.then} has not come {one.seconds:g} s after {one.event}')
                if one.times is not None:
                    self.counts[name] = min(self.counts.get(name, 0) + 1, one.times)
            if event == one.event and one.seconds is None:
                if one.times is None or self.counts.get(name, 0) < one.times:
                    self.met.add(name)
            elif event == one.event and one.seconds is not None and name not in self.due:
                begins = self._now() if self.paused_at is None else self.paused_at  # the rest of the pause is added
                self.due[name] = begins + one.seconds

    def _tell(self, requirement: Requirement, where: str, what: str) -> None:
        self._found(violation_of(requirement, where, what))


def _events(one: Requirement) -> set[str]:
    """Return the events that concern a requirement."""
    if isinstance(one, Never | AtMost | After | Possible):
        return {one.event}
    if isinstance(one, Before):
        return {one.event, one.needs}
    return {one.event, one.then} if isinstance(one, Within) else set()


def _otherwise(one: IsA | Has, parts: Sequence[NodeOrState]) -> Iterator[str]:
    """Yield how parts of one name differ from a requirement.

    A leaf without a name is called by its type, and a control, decorator or sub-tree may have the same name. Then a
    required type applies to the latter. Required ports apply to all parts that have them and all of the same type.
    """
    if isinstance(one, IsA):
        named = [part for part in parts if part.type != one.name.rpartition('/')[2]]
        yield from (f'{one.name} is a {part.type}' for part in named or parts if part.type != one.type)
        return
    for port, text in one.values:
        given = [part.values[port] for part in parts if port in part.values]
        types = {part.type for part in parts if port in part.values}
        if (parts and not given) or any(part.type in types and port not in part.values for part in parts):
            yield f'{one.name} is given no {port}'
        yield from (f'{one.name} has {port}={short_repr(other)}' for other in given if not _is_same(other, text))


def _is_same(given: str, text: str) -> bool:
    """Return whether both texts have the same meaning: numbers may be written in several ways."""
    given = ' '.join(given.split())
    try:
        return given == text or float(given) == float(text)
    except ValueError:
        return False


def violation_of(requirement: Requirement, where: str, what: str) -> Violation:
    """Return the violation of a requirement."""
    return Violation(Property.REQUIREMENT, where, f'{what}; required is: {requirement}')


def _counting(times: tuple[float, ...], now: float) -> tuple[float, ...]:
    """Return the times after ``now``, with a tolerance for rounding."""
    return tuple(time for time in times if time > now + _ROUNDING)


def _decimal(seconds: float) -> str:
    """Return a number as a requirement has it: all digits, without an exponent."""
    return format(Decimal(repr(seconds)).normalize(), 'f')


def _times(number: int) -> str:
    return 'once' if number == 1 else f'{number} times'
