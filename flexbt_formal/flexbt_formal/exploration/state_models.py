# SPDX-License-Identifier: BSD-3-Clause
"""Models of the states of a machine, and which of its children are interchangeable.

A state is active until the environment returns its outcome. If it is left earlier, its goal or service call is
unfinished until the environment confirms the end. A state that only computes gets its outcome at once. A decision asks
the operator as the real state does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from hashlib import blake2b
from itertools import groupby
from types import CodeType, FunctionType
from typing import Any, Final

from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.skills.skill import OutcomeClass, Skill
from flexbt_core.state_machine.authoring.wrappers import StateWrapper
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition, StateKind
from flexbt_core.state_machine.model.event_state import EventState, ExitReason, state_skill
from flexbt_core.state_machine.model.userdata import UserData

from .model import EnvironmentChoices, question_anew


class StateModelKind(Enum):
    """The model of a state. REAL: the state itself, which has to be free of ROS and quick to copy."""

    REAL = 'real'
    WORK = 'work'
    INSTANT = 'instant'
    DECISION = 'decision'


@dataclass(frozen=True)
class StateModel:
    """The behavior that a state may show.

    ``outcomes`` are the possible ones (None: all that it declares). ``resources`` are the actuators that it uses while
    it is active. ``ends_later``: if it is left before its end, its work must be canceled, and the cancel confirmed.
    ``not_written``: outcomes that leave its output keys unchanged. ``suggestion`` is that of a DECISION.
    ``reads`` are the keys on the blackboards of trees that it needs when it begins, ``writes`` those that exist after
    an outcome, ``removes`` those that otherwise may not exist any more, and ``outputs`` those that it writes while it
    works.
    ``server`` is the one that it needs to succeed ('' for none), ``successes`` are its successful outcomes, and
    ``canceled`` those that occur only if an external cause cancels its work.
    """

    kind: StateModelKind
    outcomes: tuple[str, ...] | None = None
    resources: frozenset[str] = frozenset()
    ends_later: bool = False
    not_written: frozenset[str] = frozenset()
    suggestion: str | None = None
    server: str = ''
    successes: frozenset[str] = frozenset()
    canceled: frozenset[str] = frozenset()
    reads: frozenset[str] = frozenset()
    removes: frozenset[str] = frozenset()
    outputs: frozenset[str] = frozenset()
    writes: Mapping[str, frozenset[str]] = field(default_factory=dict)


StateModels = Callable[[StateDefinition], StateModel]
"""A function that returns the model of a state."""

_UNSUCCESSFUL: Final = (OutcomeClass.FAILED, OutcomeClass.TIMED_OUT, OutcomeClass.CANCELED)
"""With these classes of outcomes, a state does not write its outputs."""


def state_model(definition: StateDefinition) -> StateModel:
    """Return the model of a state, derived only from its class and its skill."""
    state = definition.state.unwrapped
    kind = StateModelKind.INSTANT if state.is_instant else StateModelKind.WORK
    ends_later = type(state).halting is not EventState.halting
    skill = state_skill(state)
    not_written = frozenset(name for name, one in skill.outcomes.items() if one.kind in _UNSUCCESSFUL)
    return StateModel(
        kind,
        resources=frozenset(skill.resources),
        ends_later=ends_later,
        server=definition.path if ends_later else '',
        successes=frozenset(state.outcomes) - not_written,
        canceled=frozenset(name for name, one in skill.outcomes.items() if one.kind is OutcomeClass.CANCELED),
        not_written=not_written,
    )


def parameters_of(state: EventState) -> tuple[str, ...]:
    """Return the comparable attributes of a state, which distinguish it from others of its class."""
    common = vars(EventState()).keys() - {'desired_rate'}
    return plain_values({name: value for name, value in vars(state.unwrapped).items() if name not in common})


def plain_values(values: Mapping[str, object]) -> tuple[str, ...]:
    """Return the comparable values, as `name=value`."""
    return tuple(f'{name.lstrip("_")}={text}' for name, value in values.items() if (text := _shown(value)))


def _shown(value: object, depth: int = 5) -> str:
    """Return a text that is the same for equal values; '' for objects that have no such text."""
    if value is None or isinstance(value, bool | int | float | str | bytes | Enum):
        return repr(value)
    if isinstance(value, type):
        return value.__qualname__
    if depth == 0:  # it may contain itself
        return '...'

    def inner(values: Iterable[object]) -> list[str]:
        return [_shown(one, depth - 1) for one in values]

    if isinstance(value, FunctionType):
        # A cell of an unassigned variable has no contents.
        bound = inner(getattr(cell, 'cell_contents', None) for cell in value.__closure__ or ())
        digest = blake2b(f'{_code(value.__code__)} {bound}'.encode(), digest_size=4)
        return f'{value.__name__} ({digest.hexdigest()})'
    if is_dataclass(value):
        return f'{type(value).__name__}({", ".join(inner(getattr(value, one.name, None) for one in fields(value)))})'
    if isinstance(value, Mapping):
        pairs = zip(inner(value), inner(value.values()), strict=True)
        return f'{{{", ".join(f"{key}: {one}" for key, one in pairs)}}}'
    if isinstance(value, list | tuple):
        return f'[{", ".join(inner(value))}]'
    if isinstance(value, set | frozenset):
        return f'{{{", ".join(sorted(inner(value)))}}}'
    return ''


def _code(code: CodeType) -> str:
    """Return a text of the instructions of a function, independent of its position in the file."""
    constants = [_code(one) if isinstance(one, CodeType) else repr(one) for one in code.co_consts]
    return f'{code.co_code!r} {code.co_names} {constants}'


class MachineEnvironment:
    """State that all models share: the active states, and for the current step its answers and the paths of the states
    that have ``begun``.

    ``active`` are the working states, ``ending`` those that were left with unfinished work, both by path. ``overdue``
    are the paths that the run no longer waits for. ``board`` holds the keys on the blackboards of trees.
    """

    def __init__(self, found: Callable[[Violation], None]) -> None:
        self.active: dict[str, ModelState] = {}
        self.ending: dict[str, ModelState] = {}
        self.overdue: set[str] = set()
        self.board: set[str] = set()
        self.found = found
        self.choices = EnvironmentChoices()
        self.answers: dict[str, int] = {}
        self.begun: list[str] = []


class ModelState(EventState):
    """A stand-in for a state, with the same outcomes and keys."""

    def __init__(self, state: EventState, model: StateModel, path: str, environment: MachineEnvironment) -> None:
        super().__init__(state.outcomes, desired_rate=None)
        self.input_keys, self.output_keys = state.input_keys, state.output_keys
        self.is_instant = state.is_instant  # type: ignore[misc]
        self.runs_while_blocked = state.runs_while_blocked  # type: ignore[misc]
        self.model = model
        self.own_path = path
        self.environment = environment
        self.result: str | None = None
        self.skill = Skill.of(resources=sorted(model.resources))
        self._type_name = state.type_name
        self._made_with = state.made_with

    @property
    def type_name(self) -> str:
        return self._type_name

    @property
    def made_with(self) -> Mapping[str, str]:
        return self._made_with

    @property
    def results(self) -> tuple[str, ...]:
        """Possible outcomes."""
        return self.model.outcomes if self.model.outcomes is not None else self.outcomes

    def on_enter(self, userdata: UserData) -> None:
        self.result = None
        self.environment.begun.append(self.own_path)
        for key in self.input_keys:
            userdata[key]
        for key in sorted(self.model.reads - self.environment.board):
            text = f'{self.own_path} begins, and its tree reads {key}, which nothing has written on this way'
            self.environment.found(Violation(Property.DATA, self.own_path, text))
        self.environment.board -= self.model.removes
        if self.model.kind is StateModelKind.DECISION:
            self.ask('', self.model.suggestion)
        else:
            self.environment.active[self.own_path] = self

    def execute(self, userdata: UserData) -> str | None:
        outcome = self.result
        if self.model.kind is StateModelKind.INSTANT and outcome is None:
            outcome = self._answer()
        if outcome is not None and outcome not in self.model.not_written:
            for key in self.output_keys:
                userdata[key] = 'value'
        if outcome is not None:
            self.environment.board -= self.model.removes
            self.environment.board |= self.model.writes.get(outcome, frozenset())
        return outcome

    def _answer(self) -> str:
        known = self.environment.answers
        question = question_anew(self.own_path, known)
        if question not in known:
            known[question] = self.environment.choices.choose(question, self.results)
        return self.results[known[question]]

    def on_exit(self, userdata: UserData) -> None:
        self.environment.active.pop(self.own_path, None)
        is_done = self.exit_reason is ExitReason.OUTCOME and self.result is not None
        if not is_done:
            self.environment.board -= self.model.removes
        if self.model.ends_later and not is_done and self.model.kind is StateModelKind.WORK:
            self.environment.ending[self.own_path] = self

    def halting(self) -> str | None:
        return 'what it has begun is not confirmed canceled' if self.own_path in self.environment.ending else None

    def confirm(self) -> None:
        """Confirm the end of unfinished work."""
        del self.environment.ending[self.own_path]
        self.environment.overdue.discard(self.own_path)
        self.wake()


def modelled(machine: MachineDefinition, models: StateModels, environment: MachineEnvironment) -> MachineDefinition:
    """Return the machine with models in place of its states; wrappers for time-outs and retries are kept."""
    children = {
        label: modelled(child, models, environment)
        if isinstance(child, MachineDefinition)
        else replace(child, state=_modelled_state(child.state, child, models, environment))
        for label, child in machine.children.items()
    }
    return replace(machine, children=children)


def _modelled_state(
    state: EventState, definition: StateDefinition, models: StateModels, environment: MachineEnvironment
) -> EventState:
    if isinstance(state, StateWrapper):
        around = copy(state)
        around.inner = _modelled_state(state.inner, definition, models, environment)
        return around
    model = models(definition)
    if model.kind is StateModelKind.REAL:
        return copy(state)
    return ModelState(state, model, definition.path, environment)


# Children of concurrency containers that are interchangeable, such as robots that do the same.
#
# If two of them are in the same situation, their possible steps mirror each other, so it is enough to explore one. The
# reduction only omits labels and never changes a configuration. So every reported path is a real one, and the shortest
# path to a violation is as long as without the reduction.

InterchangeableGroup = tuple[str, ...]
"""The paths of children that are interchangeable, in their order."""


def interchangeable(machine: MachineDefinition) -> list[InterchangeableGroup]:
    """Return the groups of all containers in a machine of models, outermost first. Children with a timer are excluded:
    if two are due at once, the first may end the container of the other. So are priority containers, whose first child
    takes precedence."""
    return [group for node in machine.nodes() if isinstance(node, MachineDefinition) for group in _groups(node)]


def _groups(container: MachineDefinition) -> Iterator[InterchangeableGroup]:
    if container.kind is not StateKind.CONCURRENCY:
        return
    groups: list[list[StateDefinition | MachineDefinition]] = []
    for child in container.children.values():
        for group in groups:
            if _shape(group[0]) == _shape(child) and _ends(container, group[0].label, child.label) == _ends(container):
                group.append(child)
                break
        else:
            groups.append([child])
    yield from (tuple(one.path for one in group) for group in groups if len(group) > 1)


def _ends(container: MachineDefinition, one: str = '', other: str = '') -> list[tuple[str, Any]]:
    """Return the end conditions of a container with two of its children exchanged. The order of conditions only matters
    between different outcomes."""
    exchanged = {one: other, other: one}
    return [
        (outcome, {frozenset((exchanged.get(label, label), by) for label, by in one.children) for one in conditions})
        for outcome, conditions in groupby(container.conditions, lambda one: one.outcome)
    ]


def _shape(node: StateDefinition | MachineDefinition) -> Any:
    """Return a description of a child without its path. Interchangeable children have equal ones."""
    around = dict(node.transitions), dict(node.remap), node.outcomes
    if isinstance(node, StateDefinition):
        state = node.state
        if not isinstance(state, ModelState):  # a real state, or a wrapper for a time-out or retries
            return node.path
        keys = set(state.input_keys), set(state.output_keys)
        return *around, *keys, state.model, state.is_instant, state.runs_while_blocked
    if node.kind is StateKind.PRIORITY:
        return node.path
    children: Mapping[str, Any] = {label: _shape(child) for label, child in node.children.items()}
    keys = set(node.input_keys), set(node.output_keys)
    return *around, *keys, node.kind, node.initial, set(node.defaults), _ends(node), children
