# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's form of a machine: the fields of ``flexbe_msgs/StateInstantiation``."""

from __future__ import annotations

from typing import Any, Final

from flexbt_formal.synthesis.errors import SynthesisError

from .machine import Part, State, SynthesizedMachine
from .yaml_text import is_code

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
