# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's form of a machine: the fields of ``flexbe_msgs/StateInstantiation``, and machines that are written as YAML
for flexbe_synthesis' ``sm_loader``."""

from __future__ import annotations

from typing import Any, Final

from flexbt_core.synthesis.errors import SynthesisError
from flexbt_core.synthesis.inputs import YamlFile

from .machine import Part, State, SynthesizedMachine
from .yaml_text import is_code

_STATE_KEYS: Final = (
    'name',
    'state_class',
    'behavior_class',
    'parameters',
    'outcomes',
    'transitions',
    'autonomy',
    'userdata_keys',
    'userdata_remapping',
)

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
    """The machine as FlexBE's editor takes it: the root, the states, and a pseudo-state for each outcome, each with all
    fields of a ``StateInstantiation``.

    Raises:
        SynthesisError: the machine repeats states, which this form does not have.
    """
    if machine.attempts > 1 and any(part.retry_on for state in machine.states.values() for part in state.parts):
        raise SynthesisError(["FlexBE's form has no retries: use --retries 0, or ask for YAML or Python"])
    root = {'outcomes': list(machine.outcomes), 'initial_state_name': machine.initial, 'input_keys': list(machine.keys)}
    found = [_entry('/', ':STATEMACHINE', **root)]
    for state in machine.states.values():
        found += _state(state)
    found += (_entry(outcome, ':OUTCOME') for outcome in machine.outcomes)
    places = _places(machine)
    return [{**one, 'position': places.get(one['state_path'].lstrip('/'), [0.0, 0.0])} for one in found]


def _places(machine: SynthesizedMachine) -> dict[str, list[float]]:
    """Where states and outcomes are in the editor: by how many transitions from the first, those of as many below each
    other."""
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


def _state(state: State) -> list[dict[str, Any]]:
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


def _of_class(part: Part) -> dict[str, Any]:
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


def read_sm_loader(text: str, source: str) -> SynthesizedMachine:
    """A machine that was written for ``sm_loader``.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    file = YamlFile(text, source)
    top = file.top('a machine', ('sm', 'states'))
    whole = file.entries(top.get('sm'), 'sm', ('outcomes', 'initial_state'))
    outcomes = tuple(one.text for one in file.words(whole.get('outcomes'), 'outcomes'))
    states: dict[str, State] = {}
    nodes = file.sequence(top['states'], 'states') if 'states' in top else []
    for node in nodes:
        entries = file.entries(node, 'a state', _STATE_KEYS)
        name = file.word(entries['name'], 'name') if 'name' in entries else ''
        words = {
            key: [one.text for one in file.words(entries.get(key), f'{key} of {name}')]
            for key in ('outcomes', 'transitions', 'autonomy', 'userdata_keys', 'userdata_remapping')
        }
        if not name or name in states or 'state_class' not in entries:
            file.problem(node, f"a state has to have a name of its own and a state_class, not '{name}'")
            continue
        if len(words['outcomes']) != len(words['transitions']):
            file.problem(
                node, f'{name} has {len(words["outcomes"])} outcomes and {len(words["transitions"])} transitions'
            )
        levels = [file.number(node, level, f'autonomy of {name}') for level in words['autonomy']]
        if any(level not in range(4) for level in levels) or len(levels) not in (0, len(words['outcomes'])):
            file.problem(node, f'autonomy of {name} has to be a level from 0 to 3 for each outcome')
            levels = []
        given = file.values(entries['parameters'], f'parameters of {name}') if 'parameters' in entries else {}
        part = Part(
            name,
            file.word(entries['state_class'], f'state_class of {name}'),
            {key: _constant(value) for key, value in given.items()},
            tuple(words['outcomes']),
            dict(zip(words['userdata_keys'], words['userdata_remapping'] or words['userdata_keys'], strict=False)),
        )
        autonomy = dict(zip(words['outcomes'], levels or [1] * len(words['outcomes']), strict=False))
        states[name] = State(name, (part,), dict(zip(words['outcomes'], words['transitions'], strict=False)), autonomy)
    initial = file.word(whole['initial_state'], 'initial_state') if 'initial_state' in whole else next(iter(states), '')
    if initial not in states:
        file.note(1, f"the initial state '{initial}' is none of the states")
    for state, outcome, target in SynthesizedMachine('', outcomes, states).edges():
        if target not in states and target not in outcomes:
            file.note(1, f"{state}: '{outcome}' leads to '{target}', which is no state and no outcome")
    file.end()
    ordered = {initial: states[initial], **states}
    return SynthesizedMachine(source.rpartition('/')[2].partition('.')[0], outcomes, ordered)


def _constant(value: Any) -> Any:
    """A parameter as Python source: quoted text is text, anything else code."""
    if isinstance(value, str) and len(value) > 1 and value[0] == value[-1] and value[0] in '\'"':
        return value[1:-1]
    return f'*{value}' if isinstance(value, str) else value
