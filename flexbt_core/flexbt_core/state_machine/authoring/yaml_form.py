# SPDX-License-Identifier: BSD-3-Clause
"""State machines written in YAML, made of existing states.

The text names states, machines and data; it holds no code and names no module. The reader provides the existing
states. Names are read literally: ``off`` is a name, not a boolean. A state with ``retry`` is entered again when it
would be left by an outcome in ``on``, up to ``attempts`` attempts in total (:func:`with_retry`). ::

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

from collections.abc import Callable, Mapping
from typing import Any, Final

import yaml

from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, MachineDefinition
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError, StateError
from flexbt_core.values.text import did_you_mean
from flexbt_core.values.yaml_data import YamlParts, line_of

from .checked_definition import define
from .machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from .wrappers import with_retry

States = Mapping[str, Callable[..., EventState]]
"""The states that a text may name, with the functions that make them from their parameters."""

_CONTAINERS: Final[dict[str, type[OperatableStateMachine]]] = {
    'machine': OperatableStateMachine,
    'concurrency': ConcurrencyContainer,
    'priority': PriorityContainer,
}
_KEYS: Final = ('outcomes', 'input_keys', 'output_keys', 'io_keys')
_LEVELS: Final = {'off': Autonomy.Off, 'low': Autonomy.Low, 'high': Autonomy.High, 'full': Autonomy.Full}


def read_machine(text: str, states: States, source: str = '<text>') -> MachineDefinition:
    """Return the checked definition of the machine in a text.

    Raises:
        MachineError: the machine has problems; the error lists each as ``source:line: problem``.
    """
    return _Reader(states, source).read(text)


class _Reader(YamlParts):
    def __init__(self, states: States, source: str) -> None:
        super().__init__(source)
        self._states = states
        self._lines: dict[str, int] = {}  # of states and machines, by their paths

    def read(self, text: str) -> MachineDefinition:
        machine = self._machine_of(text)
        self._raise_problems()
        assert machine is not None  # else a problem was raised
        try:
            return define(machine)
        except MachineError as error:
            for problem in error.problems:
                path = problem.partition(': ')[0]
                self.problems.append(f'{self.source}:{self._lines.get(path, 1)}: {problem}')
        self._raise_problems()
        raise AssertionError('a wrong machine has problems')

    def _machine_of(self, text: str) -> OperatableStateMachine | None:
        root = self.root(text)
        if root is None:
            return None
        entries = self.mapping(root, 'the text')
        self.refuse_others(entries, _CONTAINERS, 'the text')
        kinds = [kind for kind in _CONTAINERS if kind in entries]
        if len(kinds) != 1:
            self.problem(root, f'the text has to have one of {", ".join(_CONTAINERS)}')
            return None
        return self._container(kinds[0], entries[kinds[0]], '/', root)

    # -- the parts of a machine --------------------------------------------------------------------------------------

    def _container(self, kind: str, node: yaml.Node, path: str, at: yaml.Node) -> OperatableStateMachine | None:
        self._lines[path] = line_of(at)
        what = f'{path} ({kind})'
        entries = self.mapping(node, what)
        known = [*_KEYS, 'userdata', 'states', *(['conditions'] if kind == 'concurrency' else [])]
        self.refuse_others(entries, known, what)
        for needed in ('outcomes', 'states'):
            if needed not in entries:
                self.problem(at, f'{what} has no {needed}')
        options: dict[str, Any] = {key: self.names(entries[key], f'{key} of {what}') for key in _KEYS if key in entries}
        if 'conditions' in entries:
            options['conditions'] = self._conditions(entries['conditions'], what)
        if 'userdata' in entries:
            options['userdata'] = self.values(entries['userdata'], f'userdata of {what}')
        children = []
        for label, child in self.mapping(entries.get('states'), f'states of {what}').items():
            made = self._child(label, child, f'{path.rstrip("/")}/{label}')
            children += [made] if made is not None else []
        return _CONTAINERS[kind](children=children, **options)

    def _child(self, label: str, node: yaml.Node, path: str) -> Child | None:
        self._lines[path] = line_of(node)
        entries = self.mapping(node, path)
        kinds = [kind for kind in ('state', *_CONTAINERS) if kind in entries]
        known = [
            *kinds[:1],
            'transitions',
            'autonomy',
            'remapping',
            *(['parameters', 'retry'] if kinds == ['state'] else []),
        ]
        if len(kinds) != 1:
            self.problem(node, f'{path} has to have one of state, {", ".join(_CONTAINERS)}')
            return None
        self.refuse_others(entries, known, path)
        state: EventState | OperatableStateMachine | None
        if kinds == ['state']:
            state = self._state(entries, path)
        else:
            state = self._container(kinds[0], entries[kinds[0]], path, node)
        ways = {key: self.pairs(entries.get(key), f'{key} of {path}') for key in ('transitions', 'remapping')}
        levels = self.mapping(entries.get('autonomy'), f'autonomy of {path}')
        autonomy = {outcome: self._level(one, f'autonomy of {path}') for outcome, one in levels.items()}
        if state is None:
            return None
        return Child(label, state, autonomy=autonomy, **ways)

    def _state(self, entries: Mapping[str, yaml.Node], path: str) -> EventState | None:
        name = self.name(entries['state'], f'state of {path}')
        parameters = self.values(entries['parameters'], f'parameters of {path}') if 'parameters' in entries else {}
        make = self._states.get(name)
        if make is None:
            self.problem(entries['state'], f"{path}: there is no state '{name}'{did_you_mean(name, self._states)}")
            return None
        try:
            made = make(**parameters)
        except Exception as error:  # code of the state
            self.problem(entries['state'], f'{path}: {name} cannot be made: {type(error).__name__}: {error}')
            return None
        return self._repeated(made, entries['retry'], path) if 'retry' in entries else made

    def _repeated(self, state: EventState, node: yaml.Node, path: str) -> EventState | None:
        what = f'retry of {path}'
        entries = self.mapping(node, what)
        self.refuse_others(entries, ('attempts', 'on', 'delay'), what)
        values = {name: value for name, value in self.values(node, what).items() if name != 'on'}
        attempts, delay = values.get('attempts'), values.get('delay', 0.0)
        if type(attempts) is not int or type(delay) not in (int, float) or 'on' not in entries:
            self.problem(node, f'{what} has to have attempts (a number) and on (outcomes); delay is in seconds')
            return None
        try:
            return with_retry(state, attempts, self.names(entries['on'], f'on of {what}'), delay=delay)
        except StateError as error:
            self.problem(node, f'{path}: {error}')
            return None

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

    def _raise_problems(self) -> None:
        if self.problems:
            raise MachineError(self.problems)
