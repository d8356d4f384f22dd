# SPDX-License-Identifier: BSD-3-Clause
"""State machines and whole behaviors written in YAML, made of existing states.

The text names states, machines, behaviors and data; it holds no code and names no module. The reader provides the
existing states and behaviors. Names are read literally: ``off`` is a name, not a boolean. ::

    behavior:                         # the head; a machine that is not a behavior of its own needs none
      name: Round
      description: Drive to a place and watch.
      author: A. Person
      parameters:                     # default determines the type; all but default may be left out
        tree: {default: my_robot/trees/drive.xml, description: tree that drives}
        limit: {default: 60.0, description: time to drive, label: Time, unit: s, minimum: 1.0, maximum: 600.0}
        mode: {default: fast, choices: [fast, slow]}
      inputs:                         # userdata that the operator gives at the start
        goal: {type: geometry_msgs/PoseStamped, description: where to, needed: true}
      operator_gone: hold             # continue, hold, stop
      operator_gone_after: 10.0       # s
    machine:                          # or concurrency, or priority
      outcomes: [finished, failed]
      input_keys: [goal]              # output_keys, io_keys likewise
      autonomy: off                   # level of outcomes of children that declare none: off, low, high, full
      userdata: {place: dock, tries: 3}
      states:                         # the first one is the initial one
        Drive:
          state: BtExecuteGoalState
          parameters: {bt_file: $tree}
          timeout: {after: $limit, outcome: failed}
          retry: {attempts: 3, on: [failed], delay: 2.0, timeout: {after: 20.0, outcome: failed}}
          transitions: {done: Watch, canceled: failed, failed: failed}
          autonomy: {done: low}
        Watch:
          concurrency:
            outcomes: [done, failed]
            conditions:
              - {outcome: done, when: {Go: done, Look: calm}}
              - {outcome: failed, when: {Look: alarm}}
            states:
              Go: {state: GoState, remapping: {goal: place}}
              Look: {state: LookState}
          transitions: {done: Inspect, failed: failed}
        Inspect:
          behavior: {use: Inspect Site, parameters: {duration: 2.0}, default_keys: [report]}
          transitions: {finished: finished, failed: failed}
          remapping: {site: place}

A state has one of ``state``, ``machine``, ``concurrency``, ``priority``, ``behavior``. ``retry`` enters a state again
when it would be left by an outcome in ``on`` (:func:`with_retry`); its ``timeout`` limits one attempt. The ``timeout``
of a state limits all attempts together (:func:`with_timeout`); its outcome is ``timeout`` if none is given.
``behavior`` embeds an installed behavior; the machine around it supplies its input keys, except ``default_keys``,
which keep the behavior's own values.

Values are those of parameters, userdata, defaults and times. ``$name`` as a whole value is the value of a parameter of
the behavior, with its type, with or without quotes. A text that begins with ``$$`` is one with ``$``, so ``$$name`` is
the text ``$name``. Other texts have no reference in them, and names, outcomes and keys are no values. What readers of
YAML 1.1 and 1.2 read in different ways is refused: ``yes``, ``010``, ``1:30``, ``1e3``, a date. An enumeration is
written by the name or the value of its member, where the state declares it as the type of its parameter.
"""

from __future__ import annotations

import collections.abc
import inspect
import math
import sys
import typing
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from enum import Enum
from typing import Any, Final, Protocol

import yaml

from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, Machine, MachineDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError, MachineProblem, StateError
from flexbt_core.values.findings import FindingRecord
from flexbt_core.values.text import did_you_mean, one_line, short_repr
from flexbt_core.values.yaml_data import StrictYamlParts

from .checked_definition import define
from .machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer, embedded
from .wrappers import TIMEOUT, with_retry, with_timeout

States = Mapping[str, Callable[..., EventState]]
"""The states that a text may name, with the functions that make them from their parameters."""


class EmbeddableBehavior(Protocol):
    """A behavior that a text may embed."""

    @property
    def parameters(self) -> Mapping[str, object]:
        """Declared parameters by name."""

    def set_parameter(self, name: str, value: Any) -> None:
        """Set a parameter, or raise an error that says why not."""

    def create(self) -> Machine | MachineDefinition:
        """Build the machine."""


Behaviors = Callable[[str], EmbeddableBehavior]
"""Returns a new behavior by its name, or raises an error that says why there is none."""

MAX_CHARACTERS: Final = 1_000_000
"""Maximum length of a text."""

MAX_STATES: Final = 5000
"""Maximum number of states of one machine in a text."""

_MOST_PROBLEMS: Final = 100
_CONTAINERS: Final[dict[str, type[OperatableStateMachine]]] = {
    'machine': OperatableStateMachine,
    'concurrency': ConcurrencyContainer,
    'priority': PriorityContainer,
}
_KINDS: Final = ('state', *_CONTAINERS, 'behavior')
_ANY: Final = ('transitions', 'autonomy', 'remapping')
_OF_INTERFACES: Final = ('remapping', 'output_keys', 'conditions', 'autonomy')  # wrong only if all states are known
_OF_STATES: Final = ('parameters', 'timeout', 'retry')
_KEYS: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys')
_LEVELS: Final = {'off': Autonomy.Off, 'low': Autonomy.Low, 'high': Autonomy.High, 'full': Autonomy.Full}


def read_machine(
    text: str,
    states: States,
    source: str = '<text>',
    *,
    parameters: Mapping[str, Any] | None = None,
    behaviors: Behaviors | None = None,
) -> MachineDefinition:
    """Return the checked definition of the machine in a text.

    ``parameters`` are values of the parameters in its head; others have their defaults. Of the head only these are
    read. ``behaviors`` are those that may be embedded.

    Raises:
        MachineError: the machine has problems; the error lists each as ``source:line:column: problem``.
    """
    return _Reader(states, source, parameters or {}, behaviors).read(text)


class _Reader(StrictYamlParts):
    def __init__(self, states: States, source: str, given: Mapping[str, Any], behaviors: Behaviors | None) -> None:
        super().__init__(source)
        self._states = states
        self._given = given
        self._behaviors = behaviors
        self._nodes: dict[str, list[yaml.Node]] = {}  # of states and machines, by path: the label, and the mappings
        self._unknown: set[str] = set()  # paths of states that cannot be made

    def read(self, text: str) -> MachineDefinition:
        machine = self._machine_of(text)
        try:
            if machine is not None:
                definition = define(machine)
                if not self.records:
                    return definition
        except MachineError as error:
            for problem in error.found:
                assert isinstance(problem, MachineProblem)
                if not (self._unknown and problem.part and problem.part[0] in _OF_INTERFACES):
                    self.owner = problem.path
                    self.problem(self._place(problem), str(problem))
        raise machine_error(self.records)

    def _machine_of(self, text: str) -> OperatableStateMachine | None:
        root = self.root(text, MAX_CHARACTERS)
        if root is None:
            return None
        entries = self.mapping(root, 'the text')
        self.refuse_others(entries, ('behavior', *_CONTAINERS), 'the text')
        self._declare(entries.get('behavior'))
        kinds = [kind for kind in _CONTAINERS if kind in entries]
        if len(kinds) != 1:
            self.problem(root, f'the text has to have one of {", ".join(_CONTAINERS)}')
            return None
        content = entries[kinds[0]]
        self._nodes['/'] = [self.key_of(content), content]
        return self._container(kinds[0], content, '/')

    def _declare(self, head: yaml.Node | None) -> None:
        """Read the parameters of the head with their values."""
        declared = self.mapping(self.mapping(head, 'behavior').get('parameters'), 'parameters of the behavior')
        defaults = {name: self.mapping(one, f'parameter {name}').get('default') for name, one in declared.items()}
        self.references = {
            name: self._given[name]
            if name in self._given
            else node and self.value(node, f'default of parameter {name}')
            for name, node in defaults.items()
        }

    def _number(self, node: yaml.Node | None, what: str, default: float = math.nan) -> float:
        """Return a number; NaN for another value, with a problem."""
        if node is None:
            return default
        before, value = len(self.records), self.value(node, what)
        if type(value) in (int, float) and abs(value) <= sys.float_info.max:
            return float(value)
        if len(self.records) == before:
            self.problem(node, f'{what} has to be a number, not {short_repr(value)}')
        return math.nan

    # -- the parts of a machine --------------------------------------------------------------------------------------

    def _container(self, kind: str, node: yaml.Node, path: str) -> OperatableStateMachine:
        self.owner = path
        what = f'{path} ({kind})'
        entries = self.mapping(node, what)
        is_concurrent = kind == 'concurrency'
        known = [*_KEYS, 'userdata', 'autonomy', 'states', *(['conditions'] if is_concurrent else [])]
        self.refuse_others(entries, known, what)
        options: dict[str, Any] = {key: self.names(entries[key], f'{key} of {what}') for key in _KEYS if key in entries}
        if is_concurrent and 'conditions' in entries:
            options['conditions'] = self._conditions(entries['conditions'], what)
        if 'userdata' in entries:
            options['userdata'] = self.values(entries['userdata'], f'userdata of {what}')
        if 'autonomy' in entries:
            options['autonomy'] = self._level(entries['autonomy'], f'autonomy of {what}')
        states = self.mapping(entries.get('states'), f'states of {what}')
        if len(states) > MAX_STATES:
            self.problem(self.key_of(entries['states']), f'{what} has {len(states)} states; at most {MAX_STATES}')
            states = {}
        children = [self._child(label, one, f'{path.rstrip("/")}/{label}') for label, one in states.items()]
        return _CONTAINERS[kind](children=children, **options)

    def _child(self, label: str, node: yaml.Node, path: str) -> Child:
        self.owner = path
        self._nodes[path] = [self.key_of(node), node]
        entries = self.mapping(node, path)
        kinds = [kind for kind in _KINDS if kind in entries]
        if len(kinds) != 1:
            self.problem(self.key_of(node), f'{path} has to have one of {", ".join(_KINDS)}')
        kind = kinds[0] if len(kinds) == 1 else ''
        known = (*_ANY, *_OF_STATES, *_KINDS) if not kind else (kind, *_ANY, *(_OF_STATES if kind == 'state' else ()))
        self.refuse_others(entries, known, path)
        ways = {key: self.pairs(entries.get(key), f'{key} of {path}') for key in ('transitions', 'remapping')}
        levels = self.mapping(entries.get('autonomy'), f'autonomy of {path}')
        autonomy = {outcome: self._level(one, f'autonomy of {path}') for outcome, one in levels.items()}
        state: EventState | Machine | None = None
        if kind == 'state':
            state = self._state(entries, path)
        elif kind == 'behavior':
            state = self._embedded(entries[kind], path)
        elif kind:
            self._nodes[path].append(entries[kind])
            state = self._container(kind, entries[kind], path)
        if state is None:
            self._unknown.add(path)
            state = EventState(outcomes=ways['transitions'])
        return Child(label, state, autonomy=autonomy, **ways)

    def _state(self, entries: Mapping[str, yaml.Node], path: str) -> EventState | None:
        name = self.name(entries['state'], f'state of {path}')
        make = self._states.get(name)
        arguments = self._arguments(make, name, entries.get('parameters'), path)
        if make is None:
            self.problem(entries['state'], f"{path}: there is no state '{name}'{did_you_mean(name, self._states)}")
        if make is None or arguments is None:
            return None
        try:
            made = make(**arguments)
        except Exception as error:  # code of the state
            faulty = self.mapping(entries.get('parameters'), path).get(str(getattr(error, 'parameter', '')))
            text = f'{path}: {name} cannot be made: {type(error).__name__}: {one_line(str(error), 1000)}'
            self.problem(entries['state'] if faulty is None else faulty, text)
            return None
        repeated = self._repeated(made, entries['retry'], path) if 'retry' in entries else made
        if repeated is None or 'timeout' not in entries:
            return repeated
        return self._limited(repeated, entries['timeout'], f'timeout of {path}')

    def _arguments(
        self, make: Callable[..., EventState] | None, name: str, node: yaml.Node | None, path: str
    ) -> dict[str, Any] | None:
        """Return the arguments that make a state; None if one of them has a problem."""
        before = len(self.records)
        what = f'parameters of {path}'
        known, hints = _signature(make) if make is not None else (None, {})
        arguments: dict[str, Any] = {}
        for parameter, one in self.mapping(node, what).items():
            if known is not None and parameter not in known:
                near = did_you_mean(parameter, known)
                self.problem(self.key_of(one), f'{path}: {name} has no parameter {short_repr(parameter)}{near}')
                continue
            value = self.value(one, f'{what}: {short_repr(parameter)}')
            members = _members(hints.get(parameter))
            if isinstance(value, str) and members:
                if value not in members:
                    near = did_you_mean(value, members)
                    self.problem(one, f'{what}: {short_repr(value)} is none of the values of {parameter}{near}')
                value = members.get(value)
            elif typing.get_origin(hints.get(parameter)) is collections.abc.Callable:
                text = f'{what}: {parameter} is code, which YAML does not hold; derive a state from {name} in Python'
                self.problem(one, text)
            arguments[parameter] = value
        return arguments if len(self.records) == before else None

    def _repeated(self, state: EventState, node: yaml.Node, path: str) -> EventState | None:
        before, what = len(self.records), f'retry of {path}'
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('attempts', 'on', 'delay', 'timeout'), what)
        attempts = self._number(entries.get('attempts'), f'attempts of {what}')
        delay = self._number(entries.get('delay'), f'delay of {what}', 0.0)
        on = self._named(entries.get('on'), f'on of {what}')
        limited = self._limited(state, entries['timeout'], f'timeout of {what}') if 'timeout' in entries else state
        if len(self.records) == before and (attempts % 1 != 0.0 or not on):
            text = f'{what} has to have attempts (a whole number) and on (outcomes); delay is in seconds'
            self.problem(self.key_of(node), text)
        if len(self.records) > before or limited is None:
            return None
        try:
            return with_retry(limited, int(attempts), on, delay=delay)
        except StateError as error:
            place = next((one for name, one in on.items() if name not in limited.outcomes), self.key_of(node))
            self.problem(place, f'{path}: {error}')
            return None

    def _limited(self, state: EventState, node: yaml.Node, what: str) -> EventState | None:
        before = len(self.records)
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('after', 'outcome'), what)
        seconds = self._number(entries.get('after'), f'after of {what}')
        outcome = self.name(entries['outcome'], f'outcome of {what}') if 'outcome' in entries else TIMEOUT
        if len(self.records) > before:
            return None
        try:
            return with_timeout(state, seconds, outcome)
        except StateError as error:
            text = f'{what}: {error}' if 'after' in entries else f'{what} has no after; give the time in seconds'
            self.problem(entries.get('after', self.key_of(node)), text)
            return None

    def _embedded(self, node: yaml.Node, path: str) -> Machine | None:
        before, what = len(self.records), f'behavior of {path}'
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('use', 'parameters', 'default_keys'), what)
        kept = self._named(entries.get('default_keys'), f'default_keys of {what}')
        values = self.mapping(entries.get('parameters'), f'parameters of {what}')
        given = {name: self.value(one, f'parameters of {what}: {short_repr(name)}') for name, one in values.items()}
        if 'use' not in entries or self._behaviors is None:
            text = 'behaviors cannot be embedded here' if 'use' in entries else 'it has no use; name a behavior'
            self.problem(self.key_of(node), f'{what}: {text}')
        if len(self.records) > before or self._behaviors is None:
            return None
        place, name = entries['use'], self.name(entries['use'], f'use of {what}')
        try:
            behavior = self._behaviors(name)
            for parameter, value in given.items():
                place = values[parameter]
                if parameter not in behavior.parameters:
                    place = self.key_of(place)
                    near = did_you_mean(parameter, behavior.parameters)
                    raise LookupError(f'{name} has no parameter {short_repr(parameter)}{near}')
                behavior.set_parameter(parameter, value)
            place = entries['use']
            made = behavior.create()
            for key, node in kept.items():
                if key not in made.input_keys:
                    place, near = node, did_you_mean(key, made.input_keys)
                    raise LookupError(f'{short_repr(key)} is no input key of {name}{near}')
            return embedded(made, kept)
        except MachineError as error:
            self.problem(place, f'{what}: {name} cannot be built: {error.problems[0]}')
        except Exception as error:  # code of the behavior
            self.problem(place, f'{what}: {one_line(str(error), 1000)}')
        return None

    def _named(self, node: yaml.Node | None, what: str) -> dict[str, yaml.Node]:
        """Return the nodes of a list of names, by name; empty without a list."""
        return {self.name(one, what): one for one in (self.sequence(node, what) if node is not None else ())}

    def _conditions(self, node: yaml.Node, what: str) -> list[tuple[str, list[tuple[str, str]]]]:
        conditions = []
        for one in self.sequence(node, f'conditions of {what}'):
            entries = self.mapping(one, f'condition of {what}')
            self.refuse_others(entries, ('outcome', 'when'), f'condition of {what}')
            if entries.keys() >= {'outcome', 'when'}:
                outcome = self.name(entries['outcome'], f'outcome of a condition of {what}')
                ended = self.pairs(entries['when'], f'a condition of {what}')
                conditions.append((outcome, list(ended.items())))
            else:
                self.problem(one, f'a condition of {what} has to have outcome and when')
        return conditions

    def _level(self, node: yaml.Node, what: str) -> int:
        text = self.name(node, what)
        level = _LEVELS.get(text.lower(), text)
        if str(level) not in map(str, _LEVELS.values()):
            self.problem(node, f"{what}: '{text}' is none of the levels off, low, high, full")
            return Autonomy.Off
        return int(level)

    # -- places ------------------------------------------------------------------------------------------------------

    def _place(self, problem: MachineProblem) -> yaml.Node:
        """Return the node of what is wrong, or else the label of the state. What is inside of an embedded behavior is
        wrong at the state that embeds it."""
        path = problem.path
        while path not in self._nodes:
            path = path.rpartition('/')[0] or '/'
        label, *mappings = self._nodes[path]
        if path == problem.path:
            for node in mappings:
                found = _part(node, problem.part)
                if found is not None:
                    return found[problem.is_value]
        return label


def _part(node: yaml.Node, part: tuple[str | int, ...]) -> tuple[yaml.Node, yaml.Node] | None:
    """Return the name and the value of a part below a node; None without this part."""
    key = node
    for one in part:
        if isinstance(node, yaml.MappingNode):
            pair = next(((key, value) for key, value in node.value if key.value == one), None)
        else:
            entries = list(node.value) if isinstance(node, yaml.SequenceNode) else []
            pair = next(((each, each) for index, each in enumerate(entries) if one in (index, each.value)), None)
        if pair is None:
            return None
        key, node = pair
    return (key, node) if part else None


def _signature(make: Callable[..., EventState]) -> tuple[list[str] | None, dict[str, Any]]:
    """Return the names of the parameters of a function, None if it takes any, and their types as far as known."""
    for with_types in (True, False):
        with suppress(Exception):  # a type that only type checkers see, or a function without a signature
            known = inspect.signature(make, eval_str=with_types).parameters
            takes_any = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in known.values())
            return None if takes_any else list(known), {name: one.annotation for name, one in known.items()}
    return None, {}


def _members(hint: Any) -> dict[str, Enum]:
    """Return the members of the enumerations in a type, by their names and by their values that are texts."""
    kinds = [one for one in (hint, *typing.get_args(hint)) if isinstance(one, type) and issubclass(one, Enum)]
    members = [member for kind in kinds for member in kind]
    return {text: one for one in members for text in (one.value, one.name) if isinstance(text, str)}


def machine_error(records: Iterable[FindingRecord]) -> MachineError:
    """Return the error of a text with these problems, in the order of the text."""
    places = sorted(records, key=lambda one: (one['line'], one['column']))
    found = list({(one['line'], one['column'], one['message']): one for one in places}.values())
    if len(found) > _MOST_PROBLEMS:
        last = found[_MOST_PROBLEMS]
        last['message'] = last['fix'] = 'there are too many problems to show; mend these first'
        del found[_MOST_PROBLEMS + 1 :]
    return MachineError((f'{one["file"]}:{one["line"]}:{one["column"]}: {one["message"]}' for one in found), found)
