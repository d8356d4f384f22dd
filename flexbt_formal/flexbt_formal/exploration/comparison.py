# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of two versions of a tree, or of a machine: the steps at which they behave differently.

Both make the same steps with the same answers from the start. Only differences that the environment and the operator
can observe count: which nodes begin, with which inputs, which end, which labels are possible next, and the time that
passes. The control nodes and conditions that lead there do not count.
"""

from __future__ import annotations

import re
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from .configuration import Configuration
from .explorer import ANSWERS_OF_A_STEP, ExplorationLimits, OnProgress, unreported
from .model import LAPSE, TIMER, EnvironmentChoices, Label, Move, System

_DIGITS: Final = 6
"""Number of decimal digits of seconds that are compared."""
_UNNAMED: Final = re.compile(r'::\d+$')


@dataclass(frozen=True)
class Difference:
    """A step after which the versions differ: the observations of it in ``before`` and ``now``. ``lines`` describe the
    shortest path to it, which both versions share; ``moves`` are its steps in the version now."""

    lines: tuple[str, ...]
    before: tuple[str, ...]
    now: tuple[str, ...]
    moves: tuple[Move, ...]


@dataclass(frozen=True)
class Comparison:
    """The result of comparing two versions in this many ``situations`` (pairs of configurations).

    ``differences`` are the first of each kind, nearest first; ``more`` counts the others.
    ``is_complete``: every common step was explored up to the first difference; otherwise ``stopped_by`` names the
    limit that ended the search. ``make`` makes a new system of the version now.
    """

    situations: int
    steps: int
    seconds: float
    stopped_by: str
    differences: tuple[Difference, ...]
    more: int
    make: Callable[[], System] | None = None

    @property
    def is_complete(self) -> bool:
        """True if everything was explored."""
        return not self.stopped_by

    @property
    def is_same(self) -> bool:
        """True if no step was found at which the versions differ."""
        return not self.differences and not self.more


def compare(
    before: Callable[[], System],
    now: Callable[[], System],
    limits: ExplorationLimits | None = None,
    on_progress: OnProgress = unreported,
    *,
    most: int = 3,
) -> Comparison:
    """Explore two versions side by side from their initial configurations, and return at most ``most`` differences,
    nearest to the start first. ``before`` and ``now`` make a new system."""
    found = _SideBySide(_Version(before()), _Version(now()), limits or ExplorationLimits(), on_progress).result(most)
    return replace(found, make=now)


def names_of(paths: Iterable[str]) -> dict[str, str]:
    """Return names that stay stable when other nodes are inserted, by path: an unnamed node is numbered among the
    nodes of its type, not among all nodes."""
    paths = list(paths)
    taken = frozenset(paths)
    counts: Counter[str] = Counter()
    found: dict[str, str] = {}

    def name(path: str) -> str:
        if path in found:
            return found[path]
        above, slash, part = path.rpartition('/')
        scope = f'{name(above)}/' if slash else ''
        plain = named = _UNNAMED.sub('', part)
        while plain != part:
            counts[f'{scope}{plain}'] += 1
            number = counts[f'{scope}{plain}']
            named = plain if number == 1 else f'{plain} ({number})'
            if f'{above}{slash}{named}' not in taken:  # otherwise another node has this name
                break
        found[path] = f'{scope}{named}'
        return found[path]

    return {path: name(path) for path in paths}


class _Seen(NamedTuple):
    """Observations of a step: event lines, outcome, seconds passed, nodes begun, labels possible next, texts of
    violations by property and node, nodes asked, and blackboard values left after the end.

    ``asked`` and ``handed_over`` are compared only where both versions have an entry: a version need not ask or write
    anything that does not affect it.
    """

    lines: tuple[str, ...]
    ended: str | None
    passed: float
    begun: tuple[tuple[str, tuple[str, ...]], ...]
    possible: frozenset[Label]
    wrong: Mapping[tuple[str, str], str]
    asked: Mapping[str, tuple[str, ...]]
    handed_over: Mapping[str, str]

    def is_told_from(self, other: _Seen) -> bool:
        """Return whether an observer could distinguish the two versions by this step."""
        return self[:5] != other[:5] or self.wrong.keys() != other.wrong.keys() or bool(self.differing(other))

    def differing(self, other: _Seen) -> frozenset[str]:
        """Return the paths that were asked with different inputs, and the keys with different values after the end."""
        asked = {name for name, parts in self.asked.items() if other.asked.get(name, parts) != parts}
        return frozenset(
            asked | {key for key, value in self.handed_over.items() if other.handed_over.get(key, value) != value}
        )

    def leads_where(self, other: _Seen) -> bool:
        """Return whether both steps had the same events, outcome and duration, so that their successors correspond."""
        return self[:3] == other[:3]

    def beside(self, other: _Seen) -> Iterator[str]:
        """Yield the observations as lines, with the details that differ from the other version."""
        if self.passed != other.passed:
            yield f'{self.passed:g} s go by'
        yield from self.lines
        if not self.lines:
            yield 'nothing begins, and nothing ends'
        theirs = {**other.asked, **dict(other.begun)}
        for path, parts in (*self.begun, *self.asked.items()):
            if path in theirs and parts != theirs[path]:
                yield f'{path}: {" ".join(part for part in parts if part not in theirs[path])}'
        for key, value in self.handed_over.items():
            if other.handed_over.get(key, value) != value:
                yield f'after the end, {{{key}}} is {value}'
        yield from (f'wrong: {text}' for place, text in self.wrong.items() if place not in other.wrong)
        only = self.possible - other.possible
        if only and self.leads_where(other):
            yield f'can happen next, only here: {", ".join(sorted(map(str, only)))}'


class _Version:
    """One of the two versions, described by the names that both share."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.first = system.capture()
        self._paths = frozenset(system.paths())
        changed = {path: name for path, name in names_of(system.paths()).items() if path != name}
        self._names: Mapping[str, str] = changed
        words = sorted(changed, key=len, reverse=True)
        self._pattern = re.compile('|'.join(rf'{re.escape(word)}(?!\d)' for word in words)) if words else None

    def named(self, text: str) -> str:
        if self._pattern is None:
            return text
        return self._pattern.sub(lambda match: self._names[match.group()], text)

    def labels(self) -> dict[Label, Label]:
        """Return the possible labels of the system, by their labels in shared names."""
        return {Label(*map(self.named, label)): label for label in self.system.labels()}

    def step(self, label: Label, choices: _SharedChoices) -> _Seen:
        """Make a step and return its observations."""
        system, begin = self.system, self.system.clock.now()
        choices.asks(self.named)
        violations = system.step(label, choices)
        return _Seen(
            lines=tuple(map(self.named, system.happened()[:-1])),
            ended=system.ended,
            passed=round(system.clock.now() - begin, _DIGITS) if label.kind in (TIMER, LAPSE) else 0.0,
            begun=tuple((self.named(path), parts) for path, parts in system.begun()),
            possible=frozenset(label for label in self.labels() if label.kind != LAPSE),
            wrong={
                (one.property.value, self.named(one.where) if one.where in self._paths else ''): self.named(one.text)
                for one in violations
            },
            asked={self.named(path): parts for path, parts in system.asked().items()},
            handed_over=dict(system.handed_over()),
        )


class _SharedChoices(EnvironmentChoices):
    """The answers of one step in both versions: both get the same answer to the same question."""

    def __init__(self, given: Sequence[int] = ()) -> None:
        super().__init__(given)
        self._told: dict[tuple[str, int], str] = {}
        self._asked: Counter[str] = Counter()
        self._named: Callable[[str], str] = str
        self.given_last: list[int] = []
        """The answers to the version that has asked last, without those to questions with one option."""

    def asks(self, named: Callable[[str], str]) -> None:
        """Begin the questions of a version, which ``named`` maps to shared names."""
        self._named = named
        self._asked.clear()
        self.given_last.clear()

    def choose(self, question: str, options: Sequence[str]) -> int:
        name = self._named(question)
        self._asked[name] += 1
        place = (name, self._asked[name])
        told = self._told.get(place)
        taken = list(options).index(told) if told is not None and told in options else super().choose(name, options)
        self._told[place] = options[taken]
        self.given_last += [taken] if len(options) > 1 else []
        return taken


class _Place(NamedTuple):
    """The step by which a pair was first reached, and its source."""

    source: tuple[bytes, bytes]
    label: Label
    answers: tuple[int, ...]


class _SideBySide:
    def __init__(
        self,
        before: _Version,
        now: _Version,
        limits: ExplorationLimits,
        on_progress: OnProgress,
    ) -> None:
        self._before, self._now, self._limits = before, now, limits
        before.system.lapses = now.system.lapses = before.system.lapses or now.system.lapses
        self._on_progress = on_progress
        self._from: dict[tuple[bytes, bytes], _Place | None] = {}
        self._found: dict[tuple[object, ...], tuple[_Place, _Seen, _Seen]] = {}
        self._steps = 0
        self._cut = ''
        self._begin = time.process_time()

    def result(self, most: int) -> Comparison:
        stopped_by = self._search()
        differences = [self._told(*found) for found in list(self._found.values())[:most]]
        return Comparison(
            situations=len(self._from),
            steps=self._steps,
            seconds=time.process_time() - self._begin,
            stopped_by=stopped_by,
            differences=tuple(differences),
            more=len(self._found) - len(differences),
        )

    def _search(self) -> str:
        """Explore all pairs; return the limit that ended the search early, or ''."""
        first = (self._before.first, self._now.first)
        key = (first[0].key, first[1].key)
        self._from[key] = None
        ahead = deque([first])
        while ahead:
            pair = ahead.popleft()
            self._on_progress(len(self._from), len(ahead))
            source = (pair[0].key, pair[1].key)
            for label, answers, before, now in self._steps_from(pair):
                place = _Place(source, label, answers)
                if before.is_told_from(now):
                    self._found.setdefault(_kind(label, before, now), (place, before, now))
                if not before.leads_where(now):
                    continue
                reached = (self._before.system.capture(), self._now.system.capture())
                key = (reached[0].key, reached[1].key)
                if key not in self._from:
                    self._from[key] = place
                    ahead.append(reached)
            if time.process_time() - self._begin > self._limits.seconds:
                return self._limits.told_seconds
            if len(self._from) > self._limits.configurations:
                return f'the limit of {self._limits.configurations} situations'
        return self._cut

    def _steps_from(
        self, pair: tuple[Configuration, Configuration]
    ) -> Iterator[tuple[Label, tuple[int, ...], _Seen, _Seen]]:
        """Yield the steps that both versions can make, with their observations, and leave both in the successor."""
        versions = (self._before, self._now)
        for version, configuration in zip(versions, pair, strict=True):
            version.system.restore(configuration)
        labels = [version.labels() for version in versions]
        for name in [label for label in labels[0] if label in labels[1]]:
            for tried, choices in enumerate(_SharedChoices.all()):
                if tried == ANSWERS_OF_A_STEP:
                    self._cut = f'more than {ANSWERS_OF_A_STEP} ways to answer in one step'
                    break
                seen = []
                for version, configuration, known in zip(versions, pair, labels, strict=True):
                    version.system.restore(configuration)
                    seen.append(version.step(known[name], choices))
                self._steps += 1
                yield name, choices.answers, seen[0], seen[1]

    def _told(self, place: _Place, before: _Seen, now: _Seen) -> Difference:
        way = [place]
        while (earlier := self._from[way[-1].source]) is not None:
            way.append(earlier)
        versions = (self._before, self._now)
        for version in versions:
            version.system.restore(version.first)
        lines: list[str] = []
        moves: list[Move] = []
        for number, step in enumerate(reversed(way), start=1):
            choices = _SharedChoices(step.answers)
            own = self._now.labels()[step.label]
            seen = [version.step(version.labels()[step.label], choices) for version in versions]
            moves.append(Move(own, tuple(choices.given_last)))
            chosen = ', '.join(map(str, choices.made))
            lines.append(f'{number}. {step.label}{f" ({chosen})" if chosen else ""}')
            if step is not place:
                lines += [f'     {line}' for line in seen[0].lines]
        return Difference(tuple(lines), tuple(before.beside(now)), tuple(now.beside(before)), tuple(moves))


def _kind(label: Label, before: _Seen, now: _Seen) -> tuple[object, ...]:
    """Return a key that is equal for differences of one kind."""
    if before.leads_where(now):
        begun = frozenset(before.begun) ^ frozenset(now.begun)
        wrong = frozenset(before.wrong) ^ frozenset(now.wrong)
        inputs = before.differing(now)
        return (begun, before.possible - now.possible, now.possible - before.possible, wrong, inputs)
    return (label, before[:3], now[:3])
