# SPDX-License-Identifier: BSD-3-Clause
"""The terms of an exploration: choices, labels, steps, systems, counterexamples, reports."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, Self

from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirements import Requirements
from flexbt_core.values.text import pluralize

from .configuration import Configuration, StateSnapshotter
from .virtual_time import SHORT, VirtualClock


class EnvironmentChoice(NamedTuple):
    """An answer to a question: the question, the options, and the index of the chosen one."""

    question: str
    options: tuple[str, ...]
    taken: int

    def __str__(self) -> str:
        return f'{self.question}: {self.options[self.taken]}'


_MOST_ANSWERS: Final = 3
"""Answers to one question in a step; the last one stays, so that an endless loop has few ways."""


def question_anew(question: str, known: Container[str]) -> str:
    """Return a question as it is asked in a step in which the ``known`` ones were asked: each time another one, up to
    the last."""
    for _ in range(1, _MOST_ANSWERS):
        if question not in known:
            break
        question += ', again'
    return question


class EnvironmentChoices:
    """The answers of one step: those in ``given``, then the first option of each further question."""

    def __init__(self, given: Sequence[int] = ()) -> None:
        self._given = tuple(given)
        self.made: list[EnvironmentChoice] = []

    def choose(self, question: str, options: Sequence[str]) -> int:
        """Return the index of the chosen option. A question with one option is not recorded.

        Raises:
            IndexError: a given answer is not among the options, because it belongs to another system.
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
        """Indices of all chosen options."""
        return tuple(one.taken for one in self.made)

    @classmethod
    def all(cls) -> Iterator[Self]:
        """Yield each combination of answers. Use each in a step before the next: its questions determine the others."""
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


# Steps, violations, coverage.


class Label(NamedTuple):
    """The external event of a step: its ``kind``, the ``subject`` that it affects, and a ``value``."""

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
"""The kind of label that stops the system."""

START: Final = 'start'
"""The kind of label that starts the system."""

TIMER: Final = 'time goes by'
"""The kind of label that advances the clock to the next deadline or timer."""

LAPSE: Final = 'time goes by, and nothing is due yet'
"""The kind of label that advances the clock until just before the next deadline or timer, or by a long time."""

CONFIRMED: Final = 'cancel confirmed'

OPERATOR: Final = 'operator'
"""Prefix of the other kinds of labels that the operator causes."""


class Move(NamedTuple):
    """A step: its label, and the answers of the environment, as indices of the options."""

    label: Label
    answers: tuple[int, ...] = ()


class LabelEffect(NamedTuple):
    """The effect of a label that ends an action which needs a server or an external cause.

    ``server`` is the one that it needs ('' for none). ``is_caused``: the system itself causes it; otherwise only an
    external cause does, such as a client that cancels a goal.
    """

    server: str
    is_success: bool
    is_caused: bool = True


def servers_gone(number: int) -> str:
    """Return this bound in words."""
    return f'at most {pluralize(number, "server")} gone for good'


class System(ABC):
    """A system to explore: engines with an environment and a virtual clock. A step is deterministic except for its
    choices."""

    requirements: Requirements
    """Requirements of the mission, and their events in the last step."""

    _memory: StateSnapshotter

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.lapses = False
        """True if time may pass without a timer: not useful if at most one thing waits for a time."""
        self._events: list[str] = []
        self._found: list[Violation] = []

    def capture(self) -> Configuration:
        """Return the current configuration."""
        return self._memory.capture()

    def restore(self, configuration: Configuration) -> None:
        """Restore a configuration of this system."""
        self._memory.restore(configuration)

    @abstractmethod
    def labels(self) -> Sequence[Label]:
        """Return the labels that are possible now; none after the end."""

    @abstractmethod
    def answer(self, label: Label) -> LabelEffect | None:
        """Return the effect of a label that is possible now; None if it involves neither a server nor an external
        cause."""

    def is_due(self, label: Label) -> bool:
        """Return whether a label that is possible now is a timer that is already due, so that no time passes and no
        external event occurs."""
        return label.kind == TIMER and self.clock.is_due(self._next_due())

    @abstractmethod
    def _next_due(self) -> float | None:
        """Return the next time at which a timer or deadline is due, s; None without one."""

    @property
    def _times_required(self) -> int:
        """Number of requirements that wait for a time."""
        return sum(getattr(one, 'seconds', None) is not None for one in self.requirements.requirements)

    def _lapse_labels(self) -> list[Label]:
        """Return the label by which time passes without a timer, if it is possible."""
        due = self._next_due()
        is_possible = self.lapses and (due is None or due - self.clock.now() > 2 * SHORT)
        return [Label(LAPSE)] if is_possible else []

    @abstractmethod
    def step(self, label: Label, choices: EnvironmentChoices) -> list[Violation]:
        """Apply a label and everything that follows at once; return the violations."""

    def _note(self, violation: Violation) -> None:
        """Add a violation of the current step, once."""
        if violation not in self._found:
            self._found.append(violation)

    @property
    @abstractmethod
    def ended(self) -> str | None:
        """Outcome; None while the system runs."""

    @property
    @abstractmethod
    def is_over(self) -> bool:
        """True if its end is decided; canceled work may still continue."""

    @property
    def written(self) -> frozenset[str]:
        """Keys of the outermost blackboard that the system has written so far, of those that distinguish its
        configurations."""
        return frozenset()

    @property
    def waits(self) -> str:
        """Name of the person or state that the system visibly waits for; '' if it waits for none."""
        return ''

    @property
    def is_asking(self) -> bool:
        """True if a person is asked how to continue and can also do something else."""
        return False

    @abstractmethod
    def position(self) -> str:
        """Return a description of the active nodes, for people."""

    def happened(self) -> Sequence[str]:
        """Return the events of the last step, and the position, a line each."""
        return [*self._events, self.position()]

    @abstractmethod
    def covered(self) -> frozenset[str]:
        """Return the part of :meth:`coverable` that all steps on this object have covered."""

    @abstractmethod
    def coverable(self) -> frozenset[str]:
        """Return all transitions and nodes."""

    @abstractmethod
    def promised(self) -> frozenset[str]:
        """Return the transitions and nodes that must be reachable."""

    def idle(self) -> Iterable[Violation]:
        """Return a violation for each node that should have an effect, and had none in any step on this object."""
        return ()

    # -- comparison of two versions of a system ---------------------------------------------------------------------

    @abstractmethod
    def paths(self) -> Sequence[str]:
        """Return the paths that labels and lines mention, in the order of the file."""

    @abstractmethod
    def begun(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """Return the path of each node that began in the last step, with its type and inputs."""

    @abstractmethod
    def asked(self) -> Mapping[str, tuple[str, ...]]:
        """Return the type and inputs of each node that only checked a condition in the last step, by path."""

    def handed_over(self) -> Mapping[str, str]:
        """Return the plain values on the blackboard after an end without a stop, by key."""
        return {}


def livelock(system: System) -> Violation:
    """Return the violation of a system that has returned to its configuration without time passing."""
    where = system.position()
    text = f'it goes round without any time going by, and waits for nothing: {where}'
    return Violation(Property.NO_LIVELOCK, where, text)


@dataclass(frozen=True)
class Counterexample:
    """A violation, and the shortest path to it, which ``lines`` describe in words."""

    violation: Violation
    moves: tuple[Move, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Report:
    """The result of an exploration.

    ``is_complete``: everything within ``bounds`` was explored; otherwise ``stopped_by`` names the limit that ended it.
    ``ends`` counts the final configurations of each outcome. ``uncovered`` are the transitions and nodes that were
    never taken. ``written`` are the keys that are always written at the end, by outcome. ``make`` returns a new system
    in its initial configuration.
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
        """True if everything was explored. A violation prevents that, except one about something that never happens."""
        never = (Property.REACHABLE, Property.LIMITS, Property.LISTENS)
        return self.is_complete and all(one.violation.property in never for one in self.counterexamples)

    @property
    def is_dead_code(self) -> bool:
        """True if the only violation is that something can never happen: a success, an outcome, a state, a node."""
        return not self.holds and all(one.violation.property is Property.REACHABLE for one in self.counterexamples)
