# SPDX-License-Identifier: BSD-3-Clause
"""Breadth-first search through all configurations of a system, so that the path to each is the shortest.

The real engines make every step, from a restored configuration. A sample of the restored configurations is compared
with the result of replaying the steps from the start. This detects configurations that miss a part of the state.
"""

from __future__ import annotations

import gc
import itertools
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from flexbt_core.monitors.properties import Property, Violation

from .configuration import Configuration
from .graph import ConfigurationGraph
from .model import Counterexample, EnvironmentChoices, Label, LabelEffect, Move, Report, System, livelock

DEFAULT_SECONDS: Final = 60.0
DEFAULT_CONFIGURATIONS: Final = 200_000
ANSWERS_OF_A_STEP: Final = 4096
"""Maximum number of answer combinations tried in one step; a tick that asks many conditions may have more."""
_CHECKED: Final = 100
"""One of this many configurations is compared with a replay from the start."""
_ALIKE: Final = 3
"""Counterexamples of one property that are reported; the rest are counted."""


OnProgress = Callable[[int, int], None]
"""A progress callback that is called often, with the numbers of known and of unexpanded situations."""


def unreported(*_: object) -> None:
    """Report no progress."""


@dataclass
class ExplorationLimits:
    """Limits at which an exploration ends early: ``seconds`` of processor time, independent of other load, and a
    number of configurations. ``whole`` is the total time, s, if several explorations share it."""

    seconds: float = DEFAULT_SECONDS
    configurations: int = DEFAULT_CONFIGURATIONS
    whole: float | None = None

    @property
    def told_seconds(self) -> str:
        """The time limit in words, as the user set it."""
        return f'the time limit of {self.seconds if self.whole is None else self.whole:g} s'


class RestoreError(AssertionError):
    """A restored configuration differs from a replay of its steps: a part of the state is not saved."""


def explore(
    make: Callable[[], System],
    name: str,
    bounds: str = '',
    limits: ExplorationLimits | None = None,
    on_progress: OnProgress = unreported,
    *,
    faults: int = 1,
) -> Report:
    """Explore the system that ``make`` returns in its initial configuration.

    The system must still be able to end after up to ``faults`` of its servers fail permanently, at any time. Raises
    RestoreError.
    """
    return _Exploration(make, name, limits or ExplorationLimits(), on_progress, faults).report(bounds)


class _Exploration:
    def __init__(
        self, make: Callable[[], System], name: str, limits: ExplorationLimits, on_progress: OnProgress, faults: int
    ) -> None:
        self._make = make
        self._name = name
        self._faults = faults
        self._limits = limits
        self._on_progress = on_progress
        self._system = make()
        self._first = self._system.capture()
        self._graph = ConfigurationGraph(self._first.key)
        self._found: dict[Violation, tuple[Move, ...]] = {}
        self._alike: defaultdict[Property, set[Violation]] = defaultdict(set)
        self._steps = 0
        self._written: dict[str, frozenset[str]] = {}
        self._checked = 0
        self._begin = time.process_time()
        self._stopped_by = ''
        self._cut = False

    # -- the search --------------------------------------------------------------------------------------------------

    def _search(self) -> None:
        graph = self._graph
        self._describe(self._first.key)
        ahead = deque([self._first])
        expanded = 0
        while ahead:
            configuration = ahead.popleft()
            self._on_progress(len(graph), len(ahead))
            system = self._system
            system.restore(configuration)
            for label, answer, is_due in [(each, system.answer(each), system.is_due(each)) for each in system.labels()]:
                ahead += self._follow(configuration, label, answer, is_due)
            expanded += 1
            if expanded % _CHECKED == _CHECKED // 10:
                self._check_restore(configuration)
            if self._is_late():
                self._stopped_by = self._limits.told_seconds
            elif len(graph) > self._limits.configurations:
                self._stopped_by = f'the limit of {self._limits.configurations} configurations'
            if self._stopped_by:
                graph.unfinished.update(waiting.key for waiting in ahead)
                return

    def _follow(
        self, configuration: Configuration, label: Label, answer: LabelEffect | None, is_due: bool
    ) -> list[Configuration]:
        """Make all steps from a configuration with a label and return the new configurations. ``answer`` is the effect
        of the label."""
        found: list[Configuration] = []
        system, graph = self._system, self._graph
        for tried, choices in enumerate(EnvironmentChoices.all()):
            if self._is_late() or tried == ANSWERS_OF_A_STEP:
                self._cut |= tried == ANSWERS_OF_A_STEP
                graph.unfinished.add(configuration.key)
                break
            system.restore(configuration)
            system.requirements.happened.clear()
            violations = system.step(label, choices)
            self._steps += 1
            for event in system.requirements.happened if not label.is_stop else ():
                graph.comes_about(event, configuration.key)
            move = Move(label, choices.answers)
            for violation in violations:
                self._note(violation, (*graph.way_to(configuration.key), move))
            is_sound = all(violation.is_lasting for violation in violations)
            reached = system.capture()
            if system.ended is not None:
                known = self._written.get(system.ended)
                self._written[system.ended] = system.written if known is None else known & system.written
            if is_due and is_sound and system.ended is None:
                graph.add_turn(configuration.key, reached.key, move)
            if graph.add(reached.key, configuration.key, move, answer):
                self._describe(reached.key)
                # Do not expand a configuration after a violation: its successors would show it too.
                if is_sound:
                    found.append(reached)
                else:
                    graph.broken.add(reached.key)
        return found

    def _is_late(self) -> bool:
        return time.process_time() - self._begin > self._limits.seconds

    def _describe(self, key: bytes) -> None:
        system = self._system
        self._graph.ended[key] = system.ended
        if system.is_over:
            self._graph.over.add(key)
        if system.waits:
            self._graph.waiting.add(key)
        if system.is_asking:
            self._graph.asking.add(key)

    def _note(self, violation: Violation, moves: tuple[Move, ...]) -> None:
        alike = self._alike[violation.property]
        alike.update(() if violation.is_lasting else (violation,))
        if violation not in self._found and (violation.is_lasting or len(alike) <= _ALIKE):
            self._found[violation] = moves

    def _check_restore(self, configuration: Configuration) -> None:
        """Compare a configuration with a replay of its steps. Raises RestoreError."""
        if self._at(self._graph.way_to(configuration.key)).capture().key != configuration.key:
            way = '; '.join(str(move.label) for move in self._graph.way_to(configuration.key))
            raise RestoreError(
                f'{self._name}: after "{way}" the engine is not where it was: something is remembered that is not kept'
            )
        self._checked += 1

    # -- the report --------------------------------------------------------------------------------------------------

    def report(self, bounds: str) -> Report:
        """Search, and return the result."""
        is_collecting = gc.isenabled()
        gc.disable()  # the saved objects all stay alive, and each collection would scan them
        try:
            self._search()
        finally:
            if is_collecting:
                gc.enable()
        graph, system = self._graph, self._system
        notes: list[str] = []
        if self._cut:
            notes.append(f'in a step, more than {ANSWERS_OF_A_STEP} ways to answer; the rest was not tried')
        turn = graph.round()
        if turn is not None:
            self._note(livelock(self._at(turn)), turn)
        for violation, moves in graph.problems(self._position, self._faults):
            self._note(violation, moves)
        for violation, moves in graph.lost(system.requirements.possible, self._position):
            self._note(violation, moves)
        # A violation may be the reason why something is never reached: its successors were not explored.
        is_known = self._is_complete and all(violation.is_lasting for violation in self._found)
        for missing in sorted(system.promised() - system.covered()) if is_known else ():
            text = f'{missing} is never reached: nothing that can happen leads to it'
            self._note(Violation(Property.REACHABLE, missing, text), ())
        for violation in system.idle() if is_known else ():
            self._note(violation, ())
        for found, alike in self._alike.items():
            if len(alike) > _ALIKE:
                notes.append(f'{len(alike) - _ALIKE} more of "{found.value}"')
        if not self._stopped_by and not graph.can_end_by_itself():
            notes.append('it never ends by itself; only a stop ends it')
        unlimited = graph.unlimited()
        if unlimited:
            which = ', '.join(unlimited)
            notes.append(f'no time limit: if one of these never answers, only a stop ends it: {which}')
        uncovered = tuple(sorted(system.coverable() - system.covered()))
        return Report(
            name=self._name,
            bounds=bounds,
            is_complete=self._is_complete,
            stopped_by=self._stopped_by,
            configurations=len(graph),
            steps=self._steps,
            depth=graph.depth,
            seconds=time.process_time() - self._begin,
            counterexamples=tuple(
                Counterexample(violation, moves, tuple(narrate(self._make, moves, [violation])))
                for violation, moves in self._found.items()
            ),
            notes=tuple(notes),
            ends=Counter(ended for ended in graph.ended.values() if ended is not None),
            covered=len(system.coverable()) - len(uncovered),
            coverable=len(system.coverable()),
            uncovered=uncovered,
            checked_restores=self._checked,
            written=self._written,
            make=self._make,
        )

    @property
    def _is_complete(self) -> bool:
        return not self._stopped_by and not self._cut

    def _at(self, moves: tuple[Move, ...]) -> System:
        system = self._make()
        for label, answers in moves:
            system.step(label, EnvironmentChoices(answers))
        return system

    def _position(self, moves: tuple[Move, ...]) -> str:
        return self._at(moves).position()


class Moment(NamedTuple):
    """A step that was just made on ``system``: the choices in it, and its violations."""

    system: System
    label: Label
    chosen: str
    violations: Sequence[Violation]

    @property
    def happened(self) -> list[str]:
        """Events of the step, a line each; equal lines in a row are counted."""
        counted = [(line, len(list(same))) for line, same in itertools.groupby(self.system.happened())]
        return [f'{line} ({count} times)' if count > 1 else line for line, count in counted]

    def __str__(self) -> str:
        return f'{self.label}{f" ({self.chosen})" if self.chosen else ""}'


def walk(make: Callable[[], System], moves: Iterable[Move]) -> Iterator[Moment]:
    """Make the steps of a path on a new system, and yield each.

    Stop early if a step is not possible any more, or asks other questions.
    """
    system = make()
    met: set[bytes] = set()  # since time passed, or an external event occurred
    for label, answers in moves:
        if label not in system.labels():
            return
        choices = EnvironmentChoices(answers)
        if system.is_due(label):
            met.add(system.capture().key)
        else:
            met.clear()
        try:
            violations = system.step(label, choices)
        except IndexError:
            return
        if met and system.ended is None and system.capture().key in met:
            violations.append(livelock(system))
        yield Moment(system, label, ', '.join(str(one) for one in choices.made), violations)


def narrate(
    make: Callable[[], System], moves: tuple[Move, ...], about: Collection[Violation] | None = None
) -> list[str]:
    """Replay a path on a new system, and return a line for each step and each of its events. Of the violations, include
    only those in ``about``; None: all."""
    lines = [f'it begins: {make().position()}']
    for number, moment in enumerate(walk(make, moves), start=1):
        lines.append(f'{number}. {moment}')
        lines += [f'     {line}' for line in moment.happened]
        lines += [f'     ! {one.text}' for one in moment.violations if about is None or one in about]
    return lines


def replay(make: Callable[[], System], moves: tuple[Move, ...]) -> list[Violation]:
    """Replay a path on a new system, and return its violations; for tests.

    Stop early if a step is not possible any more, as in :func:`walk`.
    """
    return [violation for moment in walk(make, moves) for violation in moment.violations]
