# SPDX-License-Identifier: BSD-3-Clause
"""The terms of an exploration: choices, steps, what is wrong, what was covered."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirements import Requirements
from flexbt_core.values.text import pluralize

from .configuration import Configuration, StateSnapshotter
from .virtual_time import VirtualClock


class EnvironmentChoice(NamedTuple):
    """An answer that was given: to what, what was possible, and the place of what was taken."""

    question: str
    options: tuple[str, ...]
    taken: int

    def __str__(self) -> str:
        return f'{self.question}: {self.options[self.taken]}'


class EnvironmentChoices:
    """The answers of one step: the ``given`` ones, then the first option of each further question."""

    def __init__(self, given: Sequence[int] = ()) -> None:
        self._given = tuple(given)
        self.made: list[EnvironmentChoice] = []

    def choose(self, question: str, options: Sequence[str]) -> int:
        """Return the place of the answer among the options. With one option nothing is asked.

        Raises:
            IndexError: what was given is none of the options: it belongs to another system.
        """
        if len(options) == 1:
            return 0
        place = len(self.made)
        taken = self._given[place] if place < len(self._given) else 0
        if not 0 <= taken < len(options):
            raise IndexError(f'{question}: there is no answer {taken} among {", ".join(options)}')
        self.made.append(EnvironmentChoice(question, tuple(options), taken))
        return taken

    @property
    def answers(self) -> tuple[int, ...]:
        """All answers, as places."""
        return tuple(one.taken for one in self.made)

    @classmethod
    def all(cls) -> Iterator[Self]:
        """Yield the choices of each way to answer in a step; those that follow depend on what a step has asked."""
        ahead: list[tuple[int, ...]] = [()]
        while ahead:
            choices = cls(ahead.pop())
            yield choices
            taken = choices.answers
            others = [
                (*taken[:place], other)
                for place in range(len(choices._given), len(taken))
                for other in range(1, len(choices.made[place].options))
            ]
            ahead += reversed(others)


# What an exploration speaks of: steps, what is wrong, what was covered.


class Label(NamedTuple):
    """An event from outside in a step: its ``kind``, the ``subject`` that it happens to, and a ``value``."""

    kind: str
    subject: str = ''
    value: str = ''

    @property
    def is_stop(self) -> bool:
        """True if the label stops everything."""
        return self.kind == STOP

    @property
    def actor(self) -> str:
        """Name of the actor: OPERATOR, or the path of a state or leaf; '' for time."""
        return OPERATOR if self.kind.startswith((OPERATOR, STOP, START)) else self.subject

    def __str__(self) -> str:
        return ' '.join(part for part in self if part)


STOP: Final = 'stop'
"""The kind of label by which everything is stopped."""

START: Final = 'start'
"""The kind of label by which it begins."""

TIMER: Final = 'time goes by'
"""The kind of label by which the next time comes for which something waits."""

OPERATOR: Final = 'operator'
"""With this the other kinds of labels begin that are the operator's."""


class Move(NamedTuple):
    """A step: what happens, and how the environment answers what is asked in it, as places among what is possible."""

    label: Label
    answers: tuple[int, ...] = ()


class LabelEffect(NamedTuple):
    """The effect of a label that ends something which needs a server or an external cause.

    ``server`` is the one that it needs ('' for none). ``is_caused``: the system itself causes it; otherwise only an
    outside cause makes it happen, such as a client that cancels a goal.
    """

    server: str
    is_success: bool
    is_caused: bool = True


def servers_gone(number: int) -> str:
    """Return this bound in words."""
    return f'at most {pluralize(number, "server")} gone for good'


class System(ABC):
    """A system to explore: engines with an environment, and a clock of their own. A step is deterministic but for the
    choices."""

    requirements: Requirements
    """Requirements of the mission, and their events in the last step."""

    _memory: StateSnapshotter

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self._events: list[str] = []
        self._found: list[Violation] = []

    def capture(self) -> Configuration:
        """Return what it is in now."""
        return self._memory.capture()

    def restore(self, configuration: Configuration) -> None:
        """Be in that again."""
        self._memory.restore(configuration)

    @abstractmethod
    def labels(self) -> Sequence[Label]:
        """Return what can happen now; none when it has ended."""

    @abstractmethod
    def answer(self, label: Label) -> LabelEffect | None:
        """Return what a label that is possible now tells of a server, or of who causes it; None when it tells
        nothing."""

    def is_due(self, label: Label) -> bool:
        """Return whether a label that is possible now is that of a time that has come already: none goes by, and
        nothing comes from outside."""
        return label.kind == TIMER and self.clock.is_due(self._next_due())

    @abstractmethod
    def _next_due(self) -> float | None:
        """Return the next time for which something waits."""

    @abstractmethod
    def step(self, label: Label, choices: EnvironmentChoices) -> list[Violation]:
        """Let it happen, with all that follows at once; what is wrong with that."""

    def _note(self, violation: Violation) -> None:
        """Add what is wrong with a step, once."""
        if violation not in self._found:
            self._found.append(violation)

    @property
    @abstractmethod
    def ended(self) -> str | None:
        """Outcome; None while it goes on."""

    @property
    @abstractmethod
    def is_over(self) -> bool:
        """True if its end is decided; canceled work may still continue."""

    @property
    def written(self) -> frozenset[str]:
        """Keys of the outermost blackboard that it has written for its successors up to now."""
        return frozenset()

    @property
    def waits(self) -> str:
        """Name of the one that it visibly waits for; '' if it waits for none."""
        return ''

    @property
    def is_asking(self) -> bool:
        """True if a person is asked how to continue and can also do something else."""
        return False

    @abstractmethod
    def position(self) -> str:
        """Return where it is, in words."""

    def happened(self) -> Sequence[str]:
        """Return what has happened in the last step, a line each."""
        return [*self._events, self.position()]

    @abstractmethod
    def covered(self) -> frozenset[str]:
        """Return what was taken up to now of :meth:`coverable`, with all steps that were made on this object."""

    @abstractmethod
    def coverable(self) -> frozenset[str]:
        """Transitions and nodes that there are."""

    @abstractmethod
    def promised(self) -> frozenset[str]:
        """Return what of these is wrong when it can never be taken."""

    def idle(self) -> Iterable[Violation]:
        """Return what has never made a difference, with all steps that were made on this object, and should."""
        return ()

    # -- what two versions of a system are compared by ---------------------------------------------------------------

    @abstractmethod
    def paths(self) -> Sequence[str]:
        """Return what labels and lines name, in the order in which it stands in the file."""

    @abstractmethod
    def begun(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """Return what has begun to work in the last step, or was done at once: its path, and its type and inputs."""

    @abstractmethod
    def asked(self) -> Mapping[str, tuple[str, ...]]:
        """Return what has looked at the robot in the last step without any work: by its path, its type and inputs."""

    def handed_over(self) -> Mapping[str, str]:
        """Plain values that others find on the blackboard when it has ended by itself, by their keys."""
        return {}


def livelock(system: System) -> Violation:
    """Return what is wrong when a system has come back to where it is, and no time has gone by."""
    where = system.position()
    text = f'it goes round without any time going by, and waits for nothing: {where}'
    return Violation(Property.NO_LIVELOCK, where, text)


@dataclass(frozen=True)
class Counterexample:
    """A violation, and the shortest way to it, which ``lines`` describe in words."""

    violation: Violation
    moves: tuple[Move, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Report:
    """The result of an exploration.

    ``is_complete``: everything that the bounds allow was followed; otherwise ``stopped_by`` says what ended it.
    ``bounds`` says of what it was all. ``ends`` are the ways to end that were found, ``uncovered`` what was never
    taken. ``written`` are the keys that are written whenever it has ended so, by the ways to end. ``make`` makes the
    system anew, at its beginning.
    """

    name: str
    bounds: str
    is_complete: bool
    stopped_by: str
    configurations: int
    steps: int
    depth: int
    seconds: float
    counterexamples: tuple[Counterexample, ...]
    notes: tuple[str, ...]
    ends: Mapping[str, int]
    covered: int
    coverable: int
    uncovered: tuple[str, ...]
    checked_restores: int = 0
    written: Mapping[str, frozenset[str]] = field(default_factory=dict)
    make: Callable[[], System] | None = field(default=None, compare=False, repr=False)

    @property
    def holds(self) -> bool:
        """True if no violation was found in the covered part."""
        return not self.counterexamples

    @property
    def is_proof(self) -> bool:
        """True if everything was explored. What follows a violation is not, except that something never happens."""
        never = (Property.REACHABLE, Property.LIMITS, Property.LISTENS)
        return self.is_complete and all(one.violation.property in never for one in self.counterexamples)

    @property
    def is_dead_code(self) -> bool:
        """True if the only violation is that something can never happen: a success, an outcome, a state, a node."""
        return not self.holds and all(one.violation.property is Property.REACHABLE for one in self.counterexamples)
