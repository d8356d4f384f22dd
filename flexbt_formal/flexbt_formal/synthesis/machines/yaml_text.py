# SPDX-License-Identifier: BSD-3-Clause
"""A machine as YAML, as :func:`flexbt_core.state_machine.read_machine` reads it, with why each state is there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import yaml

from flexbt_formal.synthesis.errors import SynthesisError

from .machine import Part, State, SynthesizedMachine

LEVELS: Final = ('off', 'low', 'high', 'full')


def is_code(value: Any) -> bool:
    """Whether a parameter is Python and no value: ``*name``, or text with ``self.``"""
    return isinstance(value, str) and (value.startswith('*') or 'self.' in value)


def machine_as_yaml(machine: SynthesizedMachine) -> str:
    """The text of a machine.

    Raises:
        SynthesisError: a parameter is Python code, which YAML does not hold.
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
    return '\n'.join(_lines(machine)) + '\n'


def _lines(machine: SynthesizedMachine) -> Iterator[str]:
    yield f'# {machine.name}: synthesized. Each state tells what it stands for in the strategy.'
    yield 'machine:'
    yield f'  outcomes: {_flow(list(machine.outcomes))}'
    if machine.keys:
        yield f'  input_keys: {_flow(list(machine.keys))}'
    yield '  states:'
    for state in machine.states.values():
        yield f'    {_flow(state.name)}:  # {why(state)}'
        yield from (f'      {line}' for line in _state(state, machine.attempts))


def why(state: State) -> str:
    """Where a state comes from: its capabilities, the nodes of the strategy, and what is known in all of them."""
    said = ' and '.join(part.capability for part in state.parts)
    nodes = f'; node{"s" if len(state.nodes) > 1 else ""} {", ".join(map(str, state.nodes))}' if state.nodes else ''
    return f'{said}{nodes}' + (f'; holds {", ".join(state.holds)}' if state.holds else '')


def _state(state: State, attempts: int) -> Iterator[str]:
    if len(state.parts) == 1:
        yield from _part(state.parts[0], attempts)
    else:
        yield 'concurrency:'
        yield f'  outcomes: {_flow(list(state.transitions))}'
        keys = sorted({key for part in state.parts for key in part.reads.values()})
        made = sorted({key for part in state.parts for key in part.writes.values()})
        yield from ([f'  input_keys: {_flow(keys)}'] if keys else [])
        yield from ([f'  output_keys: {_flow(made)}'] if made else [])
        yield '  conditions:'
        for outcome, pairs in state.combinations.items():
            yield f'    - {{outcome: {_flow(outcome)}, when: {_flow(dict(pairs))}}}'
        yield '  states:'
        for part in state.parts:
            yield f'    {_flow(part.capability)}:'
            yield from (f'      {line}' for line in _part(part, attempts))
    yield f'transitions: {_flow(dict(state.transitions))}'
    yield f'autonomy: {_flow({outcome: LEVELS[level] for outcome, level in state.autonomy.items()})}'


def _part(part: Part, attempts: int) -> Iterator[str]:
    yield f'state: {_flow(part.state_class)}'
    if part.parameters:
        yield f'parameters: {_flow(dict(part.parameters))}'
    if part.remapping:
        yield f'remapping: {_flow(part.remapping)}'
    if part.retry_on and attempts > 1:
        yield f'retry: {_flow({"attempts": attempts, "on": list(part.retry_on)})}'


def _flow(value: Mapping[str, Any] | list[Any] | str) -> str:
    """A value on one line."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10**9, sort_keys=False, allow_unicode=True)
    return text.removesuffix('\n').removesuffix('\n...')
