# SPDX-License-Identifier: BSD-3-Clause
"""A synthesized machine as YAML, as a behavior in Python, and in FlexBE's form."""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Final

from flexbt_core.skills.skill import LEVELS
from flexbt_core.values.text import one_line
from flexbt_core.values.yaml_data import strict_yaml, yaml_line

from .errors import SynthesisError
from .from_strategy import MachinePart, MachineState, SynthesizedMachine


def is_code(value: Any) -> bool:
    """Return whether a parameter is Python and no value: ``*name``, or text with ``self.``"""
    return isinstance(value, str) and (value.startswith('*') or 'self.' in value)


def machine_as_yaml(machine: SynthesizedMachine) -> str:
    """Return the text of a machine.

    Raises:
        SynthesisError: a parameter is Python code, which YAML does not hold; or the machine never ends.
    """
    code = [
        f'{state.name}: parameter {key} is Python ({value}), which YAML does not hold: ask for Python'
        for state in machine.states.values()
        for part in state.parts
        for key, value in part.parameters.items()
        if is_code(value)
    ]
    if code:
        raise SynthesisError(code)
    _check_end(machine)
    return '\n'.join(_yaml_lines(machine)) + '\n'


def _check_end(machine: SynthesizedMachine) -> None:
    if not machine.outcomes:
        raise SynthesisError(
            ['the machine never ends, and no engine takes it: ask for an outcome that is a success, such as finished']
        )


def _yaml_lines(machine: SynthesizedMachine) -> Iterator[str]:
    name = one_line(machine.name)
    yield f'# {name}: synthesized. The comment of each state names what it stands for in the strategy.'
    yield 'machine:'
    yield f'  outcomes: {yaml_line(list(machine.outcomes))}'
    if machine.keys:
        yield f'  input_keys: {yaml_line(list(machine.keys))}'
    yield '  states:'
    for state in machine.states.values():
        yield f'    {yaml_line(state.name)}:  # {why(state)}'
        yield from (f'      {line}' for line in _yaml_state(state, machine.attempts))


def why(state: MachineState) -> str:
    """Return in one line where a state comes from: its capabilities, the nodes of the strategy, and what is known in
    all of them."""
    said = ' and '.join(part.capability for part in state.parts)
    nodes = f'; node{"s" if len(state.nodes) > 1 else ""} {", ".join(map(str, state.nodes))}' if state.nodes else ''
    return one_line(f'{said}{nodes}' + (f'; holds {", ".join(state.holds)}' if state.holds else ''))


def _yaml_state(state: MachineState, attempts: int) -> Iterator[str]:
    if len(state.parts) == 1:
        yield from _part(state.parts[0], attempts)
    else:
        yield 'concurrency:'
        yield f'  outcomes: {yaml_line(list(state.transitions))}'
        keys = sorted({key for part in state.parts for key in part.reads.values()})
        made = sorted({key for part in state.parts for key in part.writes.values()})
        yield from ([f'  input_keys: {yaml_line(keys)}'] if keys else [])
        yield from ([f'  output_keys: {yaml_line(made)}'] if made else [])
        yield '  conditions:'
        for outcome, pairs in state.combinations.items():
            yield f'    - {{outcome: {yaml_line(outcome)}, when: {yaml_line(dict(pairs))}}}'
        yield '  states:'
        for part in state.parts:
            yield f'    {yaml_line(part.capability)}:'
            yield from (f'      {line}' for line in _part(part, attempts))
    yield f'transitions: {yaml_line(dict(state.transitions))}'
    yield f'autonomy: {yaml_line({outcome: LEVELS[level] for outcome, level in state.autonomy.items()})}'


def _part(part: MachinePart, attempts: int) -> Iterator[str]:
    yield f'state: {yaml_line(part.state_class)}'
    if part.parameters:
        yield f'parameters: {strict_yaml(dict(part.parameters))}'
    if part.remapping:
        yield f'remapping: {yaml_line(part.remapping)}'
    if part.retry_on and attempts > 1:
        yield f'retry: {yaml_line({"attempts": attempts, "on": list(part.retry_on)})}'


# A machine as a behavior in Python, for parameters that are code, and for who goes on from there by hand.


def machine_as_python(machine: SynthesizedMachine, module_of: Callable[[str], str]) -> str:
    """Return the text of a module with a behavior; ``module_of`` says from where a state class is imported.

    Raises:
        SynthesisError: a name cannot be one in Python; or the machine never ends.
    """
    _check_end(machine)
    return '\n'.join(_python_lines(machine, module_of)) + '\n'


def class_name(name: str, others: Collection[str]) -> str:
    """Return a name for a class besides others: ``night watch`` is ``NightWatch``."""
    words = re.findall(r'[A-Za-z0-9]+', name)
    joined = ''.join(word[:1].upper() + word[1:] for word in words)
    return joined if joined.isidentifier() and joined not in {*others, *keyword.kwlist} else f'Machine{joined}'


def _python_lines(machine: SynthesizedMachine, module_of: Callable[[str], str]) -> Iterator[str]:
    classes = sorted({part.state_class for state in machine.states.values() for part in state.parts})
    bad = [one for one in classes if not _local(one).isidentifier() or keyword.iskeyword(_local(one))]
    if bad:
        raise SynthesisError([f"'{one}' is not a name of a class" for one in bad])
    modules: dict[str, str] = {}
    for one in classes:
        module = modules.setdefault(_local(one), module_of(one))
        if module != module_of(one):
            raise SynthesisError([f'{_local(one)} is of {module} and of {module_of(one)}: one module can import one'])
    several = any(len(state.parts) > 1 for state in machine.states.values())
    retries = machine.attempts > 1 and any(part.retry_on for state in machine.states.values() for part in state.parts)
    taken = ['Autonomy', 'Child', *(['ConcurrencyContainer'] if several else []), 'OperatableStateMachine']
    yield f'"""{_doc(machine.name)}: synthesized; the comment of a state tells what it stands for."""'
    yield ''
    yield f'from flexbt_core import {", ".join([*taken, *(["with_retry"] if retries else [])])}'
    yield 'from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest'
    for module in sorted(set(modules.values())):
        yield f'from {module} import {", ".join(one for one, of in modules.items() if of == module)}'
    name = class_name(machine.name, {*modules, *taken, 'with_retry', 'Behavior', 'BehaviorManifest'})
    yield from ('', '', f'class {name}(Behavior):')
    yield f"    manifest = BehaviorManifest(name={machine.name!r}, description='Synthesized.', author='behavior_tool')"
    yield from ('', '    def create(self) -> OperatableStateMachine:', '        return OperatableStateMachine(')
    yield f'            outcomes={list(machine.outcomes)!r},'
    if machine.keys:
        yield f'            input_keys={list(machine.keys)!r},'
    yield '            children=['
    for state in machine.states.values():
        yield f'                # {_doc(why(state))}'
        yield from (f'                {line}' for line in _child(state, machine.attempts))
    yield from ('            ],', '        )')


def _child(state: MachineState, attempts: int) -> Iterator[str]:
    yield 'Child('
    yield f'    {state.name!r},'
    if len(state.parts) == 1:
        yield f'    {_made(state.parts[0], attempts)},'
    else:
        yield '    ConcurrencyContainer('
        yield f'        outcomes={list(state.transitions)!r},'
        for kind in ('reads', 'writes'):
            keys = sorted({key for part in state.parts for key in getattr(part, kind).values()})
            if keys:
                yield f'        {"input_keys" if kind == "reads" else "output_keys"}={keys!r},'
        yield f'        conditions={[(outcome, list(pairs)) for outcome, pairs in state.combinations.items()]!r},'
        yield '        children=['
        for part in state.parts:
            remapping = f', remapping={part.remapping!r}' if part.remapping else ''
            yield f'            Child({part.capability!r}, {_made(part, attempts)}{remapping}),'
        yield from ('        ],', '    ),')
    yield f'    {dict(state.transitions)!r},'
    levels = ', '.join(f'{outcome!r}: Autonomy.{LEVELS[level].title()}' for outcome, level in state.autonomy.items())
    yield f'    autonomy={{{levels}}},'
    if len(state.parts) == 1 and state.parts[0].remapping:
        yield f'    remapping={state.parts[0].remapping!r},'
    yield '),'


def _made(part: MachinePart, attempts: int) -> str:
    made = f'{_local(part.state_class)}({_arguments(part.parameters)})'
    return f'with_retry({made}, {attempts}, on={list(part.retry_on)!r})' if part.retry_on and attempts > 1 else made


def _arguments(parameters: Mapping[str, Any]) -> str:
    bad = [key for key in parameters if not key.isidentifier() or keyword.iskeyword(key)]
    if bad:
        raise SynthesisError([f"'{key}' is not a name of a parameter" for key in bad])
    return ', '.join(
        f'{key}={value.removeprefix("*") if is_code(value) else repr(value)}' for key, value in parameters.items()
    )


def _local(name: str) -> str:
    return name.rpartition('/')[2]


def _doc(text: str) -> str:
    """Return a text that cannot end what it stands in."""
    return one_line(text).replace('\\', '/').replace('"', "'")


# FlexBE's form of a machine: the fields of ``flexbe_msgs/StateInstantiation``.

_LISTS: Final = (
    'input_keys',
    'output_keys',
    'cond_outcome',
    'cond_transition',
    'parameter_names',
    'parameter_values',
    'outcomes',
    'transitions',
    'autonomy',
    'userdata_keys',
    'userdata_remapping',
)
_COLUMN: Final = 250.0
_ROW: Final = 120.0
"""Pixels of the editor between two states."""


def state_instantiations(machine: SynthesizedMachine) -> list[dict[str, Any]]:
    """Return the machine as FlexBE's editor takes it: the root, the states, and a pseudo-state for each outcome, each
    with all fields of a ``StateInstantiation``.

    Raises:
        SynthesisError: the machine repeats states, which this form does not have.
    """
    if machine.attempts > 1 and any(part.retry_on for state in machine.states.values() for part in state.parts):
        raise SynthesisError(["FlexBE's form has no retries: use --retries 0, or ask for YAML or Python"])
    root = {'outcomes': list(machine.outcomes), 'initial_state_name': machine.initial, 'input_keys': list(machine.keys)}
    found = [_entry('/', ':STATEMACHINE', **root)]
    for state in machine.states.values():
        found += _flexbe_state(state)
    found += (_entry(outcome, ':OUTCOME') for outcome in machine.outcomes)
    places = _places(machine)
    return [{**one, 'position': places.get(one['state_path'].lstrip('/'), [0.0, 0.0])} for one in found]


def _places(machine: SynthesizedMachine) -> dict[str, list[float]]:
    """Return where states and outcomes are in the editor: by how many transitions from the first, those of as many
    below each other."""
    columns = {machine.initial: 0}
    for name in (waiting := [machine.initial]):
        for target in machine.states[name].transitions.values():
            if target in machine.states and target not in columns:
                columns[target] = columns[name] + 1
                waiting.append(target)
    rows: dict[int, int] = {}
    places = {}
    last = max(columns.values()) + 1
    for name in (*machine.states, *machine.outcomes):
        column = columns.get(name, last)
        row = rows[column] = rows.get(column, -1) + 1
        places[name] = [50.0 + column * _COLUMN, 50.0 + row * _ROW]
    return places


def _flexbe_state(state: MachineState) -> list[dict[str, Any]]:
    path = f'/{state.name}'
    ways = {
        'outcomes': list(state.transitions),
        'transitions': list(state.transitions.values()),
        'autonomy': list(state.autonomy.values()),
    }
    if len(state.parts) == 1:
        return [_entry(path, state.parts[0].state_class, **ways, **_of_class(state.parts[0]))]
    conditions = [
        {'state_name': [name for name, _ in pairs], 'state_outcome': [outcome for _, outcome in pairs]}
        for pairs in state.combinations.values()
    ]
    around = _entry(path, ':CONCURRENCY', **ways, cond_outcome=list(state.combinations), cond_transition=conditions)
    parts = (
        _entry(f'{path}/{part.capability}', part.state_class, outcomes=list(part.outcomes), **_of_class(part))
        for part in state.parts
    )
    return [around, *parts]


def _of_class(part: MachinePart) -> dict[str, Any]:
    remapping = {**part.reads, **part.writes}
    return {
        'parameter_names': list(part.parameters),
        'parameter_values': [
            value.removeprefix('*') if is_code(value) else repr(value) for value in part.parameters.values()
        ],
        'userdata_keys': list(remapping),
        'userdata_remapping': list(remapping.values()),
    }


def _entry(path: str, state_class: str, **fields: Any) -> dict[str, Any]:
    empty: dict[str, Any] = {name: [] for name in _LISTS}
    local = state_class.rpartition('/')[2]
    return {'state_path': path, 'state_class': local, 'behavior_class': '', 'initial_state_name': '', **empty, **fields}
