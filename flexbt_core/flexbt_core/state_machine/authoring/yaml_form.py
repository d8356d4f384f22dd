# SPDX-License-Identifier: BSD-3-Clause
"""State machines as YAML, of states that exist.

The text names states, machines and data; it holds no code, and names no module. Which states there are is said by
whoever reads it. Names are taken as they are written: ``off`` is a name, and no truth value. ::

    machine:
      outcomes: [finished, failed]
      userdata: {place: dock}
      states:
        Wait:
          state: WaitState
          parameters: {wait_time: 2.0}
          transitions: {done: Both}
          autonomy: {done: low}
        Both:
          concurrency:
            outcomes: [done, failed]
            conditions:
              - {outcome: done, when: {Go: done, Watch: calm}}
              - {outcome: failed, when: {Go: failed}}
              - {outcome: failed, when: {Watch: alarm}}
            states:
              Go: {state: GoState, remapping: {goal: place}}
              Watch: {state: WatchState}
          transitions: {done: finished, failed: failed}
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import yaml

from flexbt_core.state_machine.model import Autonomy, Child, EventState, MachineDefinition, MachineError, hint
from flexbt_core.values import YamlError, compose_yaml, construct_yaml

from .checked_definition import define
from .machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer

States = Mapping[str, Callable[..., EventState]]
"""The states that a text may name: what makes one, from its parameters."""

_CONTAINERS: Final[dict[str, type[OperatableStateMachine]]] = {
    'machine': OperatableStateMachine,
    'concurrency': ConcurrencyContainer,
    'priority': PriorityContainer,
}
_KEYS: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys')
_LEVELS: Final = {'off': Autonomy.Off, 'low': Autonomy.Low, 'high': Autonomy.High, 'full': Autonomy.Full}


def read_machine(text: str, states: States, source: str = '<text>') -> MachineDefinition:
    """The checked definition of the machine in a text.

    Raises:
        MachineError: with every problem of it, each as ``source:line: what``.
    """
    return _Reader(states, source).read(text)


class _Reader:
    def __init__(self, states: States, source: str) -> None:
        self._states = states
        self._source = source
        self._problems: list[str] = []
        self._lines: dict[str, int] = {}  # of states and machines, by their paths

    def read(self, text: str) -> MachineDefinition:
        machine = self._machine_of(text)
        self._raise_problems()
        assert machine is not None  # otherwise there is a problem
        try:
            return define(machine)
        except MachineError as error:
            for problem in error.problems:
                path = problem.partition(': ')[0]
                self._problems.append(f'{self._source}:{self._lines.get(path, 1)}: {problem}')
        self._raise_problems()
        raise AssertionError('a wrong machine has problems')

    def _machine_of(self, text: str) -> OperatableStateMachine | None:
        try:
            root = compose_yaml(text)
        except YamlError as error:
            self._problems.append(f'{self._source}:{error.line}: {error.reason}')
            return None
        if root is None:
            self._problems.append(f'{self._source}:1: the text is empty')
            return None
        entries = self._mapping(root, 'the text')
        self._refuse_others(entries, _CONTAINERS, 'the text')
        kinds = [kind for kind in _CONTAINERS if kind in entries]
        if len(kinds) != 1:
            self._problem(root, f'the text has to have one of {", ".join(_CONTAINERS)}')
            return None
        return self._container(kinds[0], entries[kinds[0]], '/', root)

    # -- the parts of a machine --------------------------------------------------------------------------------------

    def _container(self, kind: str, node: yaml.Node, path: str, at: yaml.Node) -> OperatableStateMachine | None:
        self._lines[path] = _line(at)
        what = f'{path} ({kind})'
        entries = self._mapping(node, what)
        known = [*_KEYS, 'userdata', 'states', *(['conditions'] if kind == 'concurrency' else [])]
        self._refuse_others(entries, known, what)
        for needed in ('outcomes', 'states'):
            if needed not in entries:
                self._problem(at, f'{what} has no {needed}')
        options: dict[str, Any] = {
            key: self._names(entries[key], f'{key} of {what}') for key in _KEYS if key in entries
        }
        if 'conditions' in entries:
            options['conditions'] = self._conditions(entries['conditions'], what)
        if 'userdata' in entries:
            options['userdata'] = self._values(entries['userdata'], f'userdata of {what}')
        children = []
        for label, child in self._mapping(entries.get('states'), f'states of {what}').items():
            made = self._child(label, child, f'{path.rstrip("/")}/{label}')
            children += [made] if made is not None else []
        return _CONTAINERS[kind](children=children, **options)

    def _child(self, label: str, node: yaml.Node, path: str) -> Child | None:
        self._lines[path] = _line(node)
        entries = self._mapping(node, path)
        kinds = [kind for kind in ('state', *_CONTAINERS) if kind in entries]
        known = [*kinds[:1], 'transitions', 'autonomy', 'remapping', *(['parameters'] if kinds == ['state'] else [])]
        if len(kinds) != 1:
            self._problem(node, f'{path} has to have one of state, {", ".join(_CONTAINERS)}')
            return None
        self._refuse_others(entries, known, path)
        state: EventState | OperatableStateMachine | None
        if kinds == ['state']:
            state = self._state(entries, path)
        else:
            state = self._container(kinds[0], entries[kinds[0]], path, node)
        ways = {key: self._pairs(entries.get(key), f'{key} of {path}') for key in ('transitions', 'remapping')}
        levels = self._mapping(entries.get('autonomy'), f'autonomy of {path}')
        autonomy = {outcome: self._level(one, f'autonomy of {path}') for outcome, one in levels.items()}
        if state is None:
            return None
        return Child(label, state, autonomy=autonomy, **ways)

    def _state(self, entries: Mapping[str, yaml.Node], path: str) -> EventState | None:
        name = self._name(entries['state'], f'state of {path}')
        parameters = self._values(entries['parameters'], f'parameters of {path}') if 'parameters' in entries else {}
        make = self._states.get(name)
        if make is None:
            self._problem(entries['state'], f"{path}: there is no state '{name}'{hint(name, self._states)}")
            return None
        try:
            return make(**parameters)
        except Exception as error:  # code of the state
            self._problem(entries['state'], f'{path}: {name} cannot be made: {type(error).__name__}: {error}')
            return None

    def _conditions(self, node: yaml.Node, what: str) -> list[tuple[str, list[tuple[str, str]]]]:
        conditions = []
        for one in self._sequence(node, f'conditions of {what}'):
            entries = self._mapping(one, f'condition of {what}')
            self._refuse_others(entries, ('outcome', 'when'), f'condition of {what}')
            if entries.keys() >= {'outcome', 'when'}:
                outcome = self._name(entries['outcome'], f'outcome of a condition of {what}')
                ended = self._pairs(entries['when'], f'a condition of {what}')
                conditions.append((outcome, list(ended.items())))
            else:
                self._problem(one, f'a condition of {what} has to have outcome and when')
        return conditions

    def _level(self, node: yaml.Node, what: str) -> int:
        text = self._name(node, what)
        level = _LEVELS.get(text.lower(), text)
        if str(level) not in map(str, _LEVELS.values()):
            self._problem(node, f"{what}: '{text}' is none of the levels off, low, high, full")
            return Autonomy.Off
        return int(level)

    # -- the parts of a text -----------------------------------------------------------------------------------------

    def _mapping(self, node: yaml.Node | None, what: str) -> dict[str, yaml.Node]:
        """The entries of a mapping by their names; empty when there is none."""
        if node is None:
            return {}
        if not isinstance(node, yaml.MappingNode):
            self._problem(node, f'{what} has to be a mapping, not {_shown(node)}')
            return {}
        entries: dict[str, yaml.Node] = {}
        for key, value in node.value:
            name = self._name(key, f'a name in {what}')
            if name in entries:
                self._problem(key, f"{what} has '{name}' twice")
            entries[name] = value
        return entries

    def _sequence(self, node: yaml.Node, what: str) -> list[yaml.Node]:
        if not isinstance(node, yaml.SequenceNode):
            self._problem(node, f'{what} has to be a list, not {_shown(node)}')
            return []
        return list(node.value)

    def _names(self, node: yaml.Node, what: str) -> list[str]:
        return [self._name(one, what) for one in self._sequence(node, what)]

    def _name(self, node: yaml.Node, what: str) -> str:
        """A name as it is written."""
        if not isinstance(node, yaml.ScalarNode):
            self._problem(node, f'{what} has to be a name, not {_shown(node)}')
            return ''
        return str(node.value)

    def _pairs(self, node: yaml.Node | None, what: str) -> dict[str, str]:
        return {name: self._name(value, what) for name, value in self._mapping(node, what).items()}

    def _values(self, node: yaml.Node, what: str) -> dict[str, Any]:
        """Plain data by names: numbers, texts, truth values, lists, mappings."""
        values = {}
        for name, value in self._mapping(node, what).items():
            try:
                values[name] = construct_yaml(value)
            except YamlError as error:
                self._problem(value, f"{what}: '{name}' is no plain value: {error.reason}")
        return values

    def _refuse_others(self, entries: Mapping[str, yaml.Node], known: Iterable[str], what: str) -> None:
        for name, value in entries.items():
            if name not in known:
                self._problem(value, f"{what} cannot have '{name}'{hint(name, list(known))}")

    def _problem(self, node: yaml.Node, text: str) -> None:
        self._problems.append(f'{self._source}:{_line(node)}: {text}')

    def _raise_problems(self) -> None:
        if self._problems:
            raise MachineError(self._problems)


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1 if node.start_mark is not None else 1


def _shown(node: yaml.Node) -> str:
    if isinstance(node, yaml.MappingNode):
        return 'a mapping'
    return 'a list' if isinstance(node, yaml.SequenceNode) else f"'{node.value:.80}'"
